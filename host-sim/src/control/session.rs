//! `freshet control` from the first frame to the last.

use std::fs::OpenOptions;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::Args;
use freshet::mix::Output;
use freshet::scene::Scene;
use ratatui::crossterm::event::{self, Event};
use ratatui::layout::Rect;

use super::engine::{Engine, Mirror, Shared};
use super::input::{self, Grip};
use super::layout::{Layout, Row, rows, scrolled};
use super::link::{DeviceLink, News, Opener, standing};
use super::model::{Errand, Known, Model};
use super::save;
use super::sound::{Meter, Tap};
use super::terminal::{self, Screen};
use super::view::{self, Theme};
use crate::board::Board;
use crate::built_in;
use crate::client::{BAUD, Client};
use crate::source::Source;
use crate::twin::{Kept, Setup, Twin};

/// Time between two frames of the screen.
const FRAME: Duration = Duration::from_millis(50);
/// Sample rate without a sound card, Hz.
const RATE: u32 = 48_000;

/// What `freshet control` is asked.
#[derive(Clone, Debug, Args)]
pub struct Request {
    /// The board's serial port: a path, on Windows a name such as COM3
    #[arg(required_unless_present = "here")]
    pub port: Option<String>,
    /// Bits a second
    #[arg(long, default_value_t = BAUD)]
    pub baud: u32,
    /// Play on this machine's sound card instead (with the feature `play`)
    #[arg(long, conflicts_with = "port")]
    pub here: bool,
    /// With --here: no sound card; all is as if it played
    #[arg(long, requires = "here")]
    pub silent: bool,
    /// With --here: begin with this scene or scene file [default: the first one]
    #[arg(long, requires = "here")]
    pub scene: Option<String>,
    /// With --here: with the capacities of this board
    #[arg(long, value_enum, default_value = "desk")]
    pub board: Board,
    /// With --here: the same seed gives the same sound
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write all that is set to this file, as the board's protocol says it
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
}

/// Runs until a person quits, or until `stop`.
pub fn control(request: &Request, stop: &AtomicBool) -> Result<()> {
    terminal::check()?;
    let log = match &request.log {
        Some(path) => {
            let open = OpenOptions::new().create(true).append(true).open(path);
            Some(open.with_context(|| format!("cannot write {}", path.display()))?)
        }
        None => None,
    };
    let mut known = Vec::new();
    for scene in built_in::all() {
        let (name, file) = scene?;
        known.push(Known {
            name: name.to_owned(),
            file: Some(file),
        });
    }
    let tap = Tap::default();
    let (mut client, open, voice, port): (Client, Opener, Voice, String);
    match &request.port {
        Some(path) => {
            let (path, baud) = (path.clone(), request.baud);
            client = Client::open(&path, baud)?;
            port = path.clone();
            open = Box::new(move || Client::open(&path, baud));
            voice = Voice::Elsewhere;
        }
        None => {
            let twin;
            (twin, voice) = here(request, &mut known, &tap)?;
            client = Client::over(Arc::clone(&twin))?;
            port = if request.silent {
                "silent"
            } else {
                "sound card"
            }
            .to_owned();
            open = Box::new(move || Client::over(Arc::clone(&twin)));
        }
    }
    let standing = standing(&mut client)?;
    let hello = standing.hello.clone();
    let mut rate = hello.rate;
    let (mut mirror, mut engine) = (None, None);
    if let (Voice::Elsewhere, Some(board)) = (&voice, board_of(&hello.board)) {
        rate = rate.round().clamp(8_000.0, 192_000.0);
        let twin = share(twin(board, rate as u32, hello.seed, &known, 0));
        let follower = Mirror(Arc::clone(&twin));
        follower.stand(&hello, &standing.values, true);
        engine = Some(Engine::start(&twin, &tap)?);
        mirror = Some(follower);
    }
    let mut model = Model::new(&port, request.port.is_none(), standing, known);
    let link = DeviceLink::start(client, open, mirror, log)?;
    let meter = Meter::new(tap, rate);
    let mut screen = Screen::open()?;
    let result = run(&mut model, &link, &meter, &voice, &mut screen, stop);
    // First the terminal, then what may take its time.
    drop(screen);
    drop(link);
    drop(engine);
    result
}

/// What plays.
enum Voice {
    /// A board.
    Elsewhere,
    /// Nothing, in real time.
    Silent(#[allow(dead_code)] Engine),
    /// The sound card.
    #[cfg(feature = "play")]
    Card(crate::play::Playing),
}

fn run(
    model: &mut Model,
    link: &DeviceLink,
    meter: &Meter,
    voice: &Voice,
    screen: &mut Screen,
    stop: &AtomicBool,
) -> Result<()> {
    let (start, theme) = (Instant::now(), Theme::of_environment());
    let (mut grip, mut due, mut last) = (Grip::None, Instant::now(), Instant::now());
    let mut area = Rect::default();
    while !model.quit && !stop.load(Ordering::Relaxed) {
        model.tick(start.elapsed().as_secs_f64());
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if !event::poll(left).context("the terminal is gone")? {
                break;
            }
            let event = event::read().context("the terminal is gone")?;
            take(model, area, event, &mut grip);
            // However fast the keys come, the screen goes on.
            if model.quit || Instant::now() >= due + FRAME {
                break;
            }
        }
        let now = Instant::now();
        due = (due + FRAME).max(now + FRAME / 2);
        while let Some(news) = link.news() {
            hear(model, news);
        }
        if !link.is_alive() {
            bail!("the link to the board has broken down (please report it)");
        }
        voice.check()?;
        meter.measure(&mut model.sound, (now - last).as_secs_f32());
        last = now;
        for errand in std::mem::take(&mut model.errands) {
            let Errand::Save(path, over) = errand;
            let result = save::save(model, &path, over);
            model.saved(path, result);
        }
        if link.is_idle()
            && model.lost.is_none()
            && let Some(order) = model.order()
        {
            link.give(order);
        }
        let drawn = screen.terminal.draw(|frame| {
            area = frame.area();
            fit(model, area);
            view::draw(frame, model, &theme);
        });
        drawn.context("the terminal is gone")?;
    }
    // What was turned last is heard too.
    let until = Instant::now() + Duration::from_millis(500);
    while model.lost.is_none() && Instant::now() < until {
        if link.is_idle() {
            match model.order() {
                Some(order) => link.give(order),
                None => break,
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

fn take(model: &mut Model, area: Rect, event: Event, grip: &mut Grip) {
    match event {
        Event::Key(key) => {
            if let Some(action) = input::key(model, key) {
                model.act(action);
            }
        }
        Event::Mouse(event) => {
            if let Some(layout) = Layout::new(area) {
                for action in input::mouse(model, &layout, event, grip) {
                    model.act(action);
                }
            }
        }
        _ => {}
    }
}

fn hear(model: &mut Model, news: News) {
    match news {
        News::Connected(standing) => model.connected(standing),
        News::Standing(after, hello, values) => model.standing(after, hello, &values),
        News::Presets(presets) => model.presets = presets,
        News::Report(report) => model.reported(report),
        News::Lost(why) => model.lost(why),
        News::Refused(why) => model.warn(why),
        News::Done(what) => model.say(what),
    }
}

/// Moves the panes such that their cursors are seen.
pub fn fit(model: &mut Model, area: Rect) {
    let Some(layout) = Layout::new(area) else {
        return;
    };
    let all = rows();
    let cursor = all
        .iter()
        .position(|row| *row == Row::Slider(model.parameter));
    let shown = layout.slider_rows();
    model.scroll.0 = scrolled(model.scroll.0, cursor.unwrap_or(0), shown, all.len());
    let (cursor, count) = (model.scene_cursor, model.scenes.len());
    model.scroll.1 = scrolled(model.scroll.1, cursor, layout.scene_rows(), count);
}

fn board_of(name: &str) -> Option<Board> {
    let boards = [Board::Desk, Board::F407, Board::F411, Board::H743];
    boards.into_iter().find(|board| board.name() == name)
}

fn twin(board: Board, rate: u32, seed: u64, known: &[Known], first: usize) -> Twin {
    let scene = |known: &Known| {
        let scene = known
            .file
            .as_ref()
            .map_or_else(Scene::default, |file| file.scene.clone());
        (known.name.clone(), scene)
    };
    Twin::with(Setup {
        board,
        rate,
        seed,
        scenes: known.iter().map(scene).collect(),
        first: first as u16,
        kept: Kept::default(),
        output: Output::Bits24,
    })
}

fn share(twin: Twin) -> Shared {
    Arc::new(Mutex::new(twin))
}

/// The twin that plays here, and what plays it.
fn here(request: &Request, known: &mut Vec<Known>, tap: &Tap) -> Result<(Shared, Voice)> {
    let mut first = 0;
    if let Some(name) = &request.scene {
        let source = Source::find(name)?;
        if source.events.is_some() {
            bail!("{name}: control takes a scene; render a file of events to a WAV instead");
        }
        first = match known.iter().position(|known| known.name == source.name) {
            Some(place) if source.path.is_none() => place,
            same => {
                // A file that is called like a scene takes its place.
                let own = Known {
                    name: source.name,
                    file: Some(source.scene),
                };
                match same {
                    Some(place) => {
                        known[place] = own;
                        place
                    }
                    None => {
                        known.push(own);
                        known.len() - 1
                    }
                }
            }
        };
    }
    if request.silent {
        let twin = share(twin(request.board, RATE, request.seed, known, first));
        let engine = Engine::start(&twin, tap)?;
        return Ok((twin, Voice::Silent(engine)));
    }
    aloud(request, known, first, tap)
}

#[cfg(feature = "play")]
fn aloud(request: &Request, known: &[Known], first: usize, tap: &Tap) -> Result<(Shared, Voice)> {
    use super::engine::locked;

    let card = crate::play::Card::find().context("add --silent to go without")?;
    let twin = share(twin(request.board, card.rate(), request.seed, known, first));
    let (source, tap) = (Arc::clone(&twin), tap.clone());
    let playing = card.play(move |out| {
        locked(&source).render(out);
        tap.pass(out);
    })?;
    Ok((twin, Voice::Card(playing)))
}

#[cfg(not(feature = "play"))]
fn aloud(_: &Request, _: &[Known], _: usize, _: &Tap) -> Result<(Shared, Voice)> {
    bail!(
        "this freshet was built without a sound card; build it with `cargo run --release -p freshet-host --features play -- control --here` \
         (on Debian and Ubuntu that needs the package libasound2-dev), or add --silent"
    )
}

impl Voice {
    /// Fails where the sound card is gone.
    fn check(&self) -> Result<()> {
        match self {
            #[cfg(feature = "play")]
            Self::Card(playing) => playing.check(),
            _ => Ok(()),
        }
    }
}
