//! The terminal interface: what it draws, and typed into through a pseudo-terminal.
#![cfg(unix)]

use std::fs;
use std::io::{Read, Write};
use std::num::NonZeroU16;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use freshet::param::{self, COUNT, TABLE};
use freshet_host::built_in;
use freshet_host::client::{Client, Hello, Report};
use freshet_host::control::action::Action;
use freshet_host::control::fit;
use freshet_host::control::input::{self, Grip};
use freshet_host::control::layout::Layout;
use freshet_host::control::model::{
    Ask, Errand, Focus, Known, Model, Overlay, SaveError, Standing,
};
use freshet_host::control::outbox::Order;
use freshet_host::control::save;
use freshet_host::control::slider::Step;
use freshet_host::control::sound::{BANDS, Sound};
use freshet_host::control::view::{Theme, draw};
use freshet_host::scene_file::SceneFile;
use portable_pty::{CommandBuilder, MasterPty, PtySize, native_pty_system};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{
    KeyCode, KeyEvent, KeyModifiers, MouseButton, MouseEvent, MouseEventKind,
};
use ratatui::layout::Rect;

// ---- the model and its picture

fn known() -> Vec<Known> {
    let scenes = built_in::all().map(Result::unwrap);
    scenes
        .map(|(name, file)| Known {
            name: name.to_owned(),
            file: Some(file),
        })
        .collect()
}

fn values(scene: &str) -> [f32; COUNT] {
    let file = built_in::scene(scene).unwrap().unwrap();
    std::array::from_fn(|index| file.value(index))
}

fn standing(scene: &str) -> Standing {
    let pairs = TABLE.iter().zip(values(scene));
    Standing {
        hello: Hello {
            version: "0.1.0".to_owned(),
            board: "f407".to_owned(),
            rate: 48_000.0,
            seed: 7,
            schema: param::SCHEMA,
            at: 128,
            scene: scene.to_owned(),
        },
        values: pairs.map(|(param, value)| (param.id, value)).collect(),
        scenes: known().into_iter().map(|known| known.name).collect(),
        presets: Vec::new(),
    }
}

fn model() -> Model {
    Model::new("/dev/ttyACM0", false, standing("brook"), known())
}

/// All orders that wait.
fn orders(model: &mut Model) -> Vec<Order> {
    std::iter::from_fn(|| model.order()).collect()
}

fn press(model: &mut Model, keys: &str) {
    for c in keys.chars() {
        let code = match c {
            '\n' => KeyCode::Enter,
            '\t' => KeyCode::Tab,
            '\u{1b}' => KeyCode::Esc,
            '\u{8}' => KeyCode::Backspace,
            c => KeyCode::Char(c),
        };
        if let Some(action) = input::key(model, KeyEvent::new(code, KeyModifiers::NONE)) {
            model.act(action);
        }
    }
}

fn picture(model: &mut Model, width: u16, height: u16) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    fit(model, Rect::new(0, 0, width, height));
    let theme = Theme::new(false);
    terminal.draw(|frame| draw(frame, model, &theme)).unwrap();
    let buffer = terminal.backend().buffer();
    let rows = (0..height).map(|y| {
        let row: String = (0..width).map(|x| buffer[(x, y)].symbol()).collect();
        format!("{}\n", row.trim_end())
    });
    rows.collect()
}

#[test]
fn keys_turn_parameters_and_u_takes_it_back() {
    let mut model = model();
    press(&mut model, "9");
    assert_eq!(orders(&mut model), [Order::Set(vec![(1, 1.0)], None)]);
    // What the intensity moves is shown where it will be.
    assert_eq!(model.settings.values[param::RATE], 25_000.0);
    assert!(!model.is_turned(param::RATE) && model.is_turned(param::INTENSITY));

    press(&mut model, "j-");
    assert_eq!(model.parameter, param::RATE);
    assert_eq!(
        orders(&mut model),
        [Order::Set(vec![(101, 23_600.0)], None)]
    );
    press(&mut model, "u");
    assert_eq!(
        orders(&mut model),
        [Order::Set(vec![(101, 25_000.0)], None)]
    );
    press(&mut model, "u");
    // The intensity at once, and with it what it moves.
    let Some(Order::Set(pairs, Some(0.0))) = model.order() else {
        panic!()
    };
    assert_eq!((pairs[0], pairs.len()), ((1, 0.5), 4));
    assert!(pairs[1..].contains(&(101, 4000.0)));
    assert_eq!(model.order(), None);
    assert_eq!(model.settings.values, values("brook"));
    press(&mut model, "U");
    assert_eq!(model.settings.values[param::INTENSITY], 1.0);
    press(&mut model, "uu");
    assert!(
        model
            .message
            .as_ref()
            .unwrap()
            .text
            .contains("nothing to undo")
    );
}

#[test]
fn a_value_may_be_typed_with_its_unit_and_a_wrong_one_is_refused_in_words() {
    let mut model = model();
    press(&mut model, "j\n2000 1/s\n");
    assert_eq!(orders(&mut model), [Order::Set(vec![(101, 2000.0)], None)]);
    press(&mut model, "\n1e9\n");
    assert_eq!(orders(&mut model), []);
    let text = &model.message.as_ref().unwrap().text;
    assert_eq!(
        text,
        "water.rate = 1e9: expected a number from 0 to 1000000 1/s"
    );
    model.act(Action::Select(param::LAW));
    press(&mut model, "\nflat\n");
    assert_eq!(orders(&mut model), [Order::Set(vec![(105, 0.0)], None)]);
    press(&mut model, "d");
    assert_eq!(orders(&mut model), [Order::Set(vec![(105, 1.0)], None)]);
}

#[test]
fn drawing_makes_the_law_custom_and_begins_from_what_was_heard() {
    let mut model = model();
    let before = model.settings.clone();
    let area = Rect::new(0, 0, 80, 24);
    fit(&mut model, area);
    let layout = Layout::new(area).unwrap();
    let bars = layout.bars();
    let mut grip = Grip::None;
    let mut mouse = |model: &mut Model, kind, column, row| {
        let event = MouseEvent {
            kind,
            column,
            row,
            modifiers: KeyModifiers::NONE,
        };
        for action in input::mouse(model, &layout, event, &mut grip) {
            model.act(action);
        }
    };
    let (left, top) = (bars.x, bars.y);
    mouse(
        &mut model,
        MouseEventKind::Down(MouseButton::Left),
        left + 10,
        top,
    );
    mouse(
        &mut model,
        MouseEventKind::Drag(MouseButton::Left),
        left + 20,
        top + bars.height - 1,
    );
    mouse(
        &mut model,
        MouseEventKind::Up(MouseButton::Left),
        left + 20,
        top,
    );
    let values = &model.settings.values;
    assert_eq!(values[param::LAW], 2.0);
    assert_eq!(values[param::WEIGHT + 10], 1.0);
    assert_eq!(values[param::WEIGHT + 15], 0.125);
    assert_eq!(values[param::WEIGHT + 20], 0.0);
    // A power law, where nothing was drawn.
    let ratio = values[param::WEIGHT + 49] / values[param::WEIGHT];
    let expected = (8.0_f32 / 0.3).powf(-values[param::GAMMA]);
    assert!((ratio - expected).abs() < 1e-4, "{ratio} {expected}");
    assert!(orders(&mut model).iter().all(|order| match order {
        Order::Set(pairs, None) => pairs.len() <= 24,
        _ => false,
    }));
    // One gesture.
    press(&mut model, "u");
    assert_eq!(model.settings, before);

    // A slider is dragged, and what the wheel is over turns.
    let row = layout.sliders.y + 1;
    let track = layout.track(row);
    mouse(
        &mut model,
        MouseEventKind::Down(MouseButton::Left),
        track.x,
        row,
    );
    mouse(
        &mut model,
        MouseEventKind::Drag(MouseButton::Left),
        200,
        row + 7,
    );
    assert_eq!(model.settings.values[param::INTENSITY], 1.0);
    mouse(&mut model, MouseEventKind::Up(MouseButton::Left), 0, 0);
    mouse(&mut model, MouseEventKind::ScrollDown, track.x + 3, row);
    assert_eq!(model.settings.values[param::INTENSITY], 0.99);
    // A click on a scene plays it.
    mouse(
        &mut model,
        MouseEventKind::Down(MouseButton::Left),
        3,
        layout.scenes.y + 2,
    );
    assert_eq!(model.playing(), Some(1));
    assert_eq!(
        orders(&mut model).pop(),
        Some(Order::Scene(model.scenes[1].name.clone()))
    );
}

#[test]
fn what_is_saved_sounds_as_it_stands() {
    let mut model = model();
    press(&mut model, "7");
    model.act(Action::Slide(param::GAMMA, 0.5));
    model.act(Action::Slide(param::RADIUS_MIN, 0.95));
    model.act(Action::Draw((3, 0.2), (8, 0.7)));
    let text = save::scene_file(&model, "a \"title\"");
    let file =
        SceneFile::parse("saved.toml", &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert_eq!(file.title, "a \"title\"");
    for (index, param) in TABLE.iter().enumerate() {
        let expected = match index {
            // Crossed radii are put in order.
            param::RADIUS_MIN => model.settings.values[param::RADIUS_MAX],
            param::RADIUS_MAX => model.settings.values[param::RADIUS_MIN],
            index => model.settings.values[index],
        };
        let saved = file.value(index);
        assert!(
            (saved - expected).abs() <= 1e-5 * expected.abs(),
            "{} {saved} {expected}",
            param.path
        );
    }
    // The intensity goes on moving what was not turned.
    assert_eq!(file.scene.curves.len(), 2);
    for scene in known() {
        let model = Model::new("", true, standing(&scene.name), known());
        let text = save::scene_file(&model, "t");
        let file = SceneFile::parse("t.toml", &text).unwrap();
        for index in 0..COUNT {
            assert_eq!(
                file.value(index),
                scene.file.as_ref().unwrap().value(index),
                "{text}"
            );
        }
    }
}

#[test]
fn a_file_that_is_there_is_asked_about_first() {
    let folder = Folder::new();
    let mut model = model();
    press(&mut model, "s");
    assert_eq!(
        model.overlay,
        Overlay::Prompt(Ask::File, "my-brook.toml".to_owned())
    );
    for _ in 0..20 {
        press(&mut model, "\u{8}");
    }
    let name = folder.0.join("mine");
    press(&mut model, &format!("{}\n", name.display()));
    let path = name.with_extension("toml");
    assert_eq!(model.errands, [Errand::Save(path.clone(), false)]);
    model.errands.clear();
    assert_eq!(save::save(&model, &path, false), Ok(()));
    assert_eq!(save::save(&model, &path, false), Err(SaveError::Exists));
    model.saved(path.clone(), Err(SaveError::Exists));
    press(&mut model, "n");
    assert_eq!(model.errands, []);
    model.saved(path.clone(), Err(SaveError::Exists));
    press(&mut model, "y");
    assert_eq!(model.errands, [Errand::Save(path.clone(), true)]);
    assert_eq!(save::save(&model, &path, true), Ok(()));
    let nowhere = folder.0.join("no/where.toml");
    assert!(matches!(
        save::save(&model, &nowhere, false),
        Err(SaveError::Failed(_))
    ));
    assert_eq!(fs::read_dir(&folder.0).unwrap().count(), 1);
}

#[test]
fn a_board_that_goes_and_comes_back_is_told_and_what_was_can_be_brought_back() {
    let mut model = model();
    press(&mut model, "j+++");
    let before = model.settings.clone();
    assert_eq!(orders(&mut model).len(), 1);
    model.lost("/dev/ttyACM0 is gone".to_owned());
    press(&mut model, "+9mt");
    assert_eq!((orders(&mut model), &model.settings), (Vec::new(), &before));
    assert!(picture(&mut model, 80, 24).contains("trying again: /dev/ttyACM0 is gone"));
    model.connected(standing("surf"));
    assert_eq!(model.settings.scene, "surf");
    assert!(
        model
            .message
            .as_ref()
            .unwrap()
            .text
            .contains("u brings back")
    );
    press(&mut model, "u");
    assert_eq!(model.settings, before);
    let orders = orders(&mut model);
    assert_eq!(orders[0], Order::Scene("brook".to_owned()));
    assert!(orders.len() >= 2, "{orders:?}");
}

#[test]
fn an_old_answer_does_not_undo_a_new_order() {
    let mut model = model();
    press(&mut model, "j+");
    let (given, hello) = (model.given, model.hello.clone());
    let old = standing("brook").values;
    model.standing(given, hello.clone(), &old);
    let turned = model.settings.values[param::RATE];
    assert!(turned > 4000.0, "an order waits still");
    orders(&mut model);
    model.standing(given, hello.clone(), &old);
    assert_eq!(model.settings.values[param::RATE], turned);
    model.standing(model.given, hello, &old);
    assert_eq!(model.settings.values[param::RATE], 4000.0);
    // The board's button.
    let other = standing("surf");
    model.standing(model.given, other.hello, &other.values);
    assert_eq!(
        (model.settings.scene.as_str(), model.is_changed()),
        ("surf", false)
    );
}

/// A model as a person may have it before them.
fn seen() -> Model {
    let mut model = model();
    model.act(Action::Slide(param::GAMMA, 0.15));
    model.act(Action::Select(param::RISE_CUTOFF));
    model.act(Action::Turn(Step::Coarse, 1));
    let status = freshet::protocol::Status {
        frame: 48_000,
        uptime: 754,
        load: 0.41,
        peak: 0.58,
        births: 4000,
        voices: 38,
        temperature: Some(41.0),
        ..Default::default()
    };
    model.reported(Report::from(&freshet::protocol::Status {
        frame: 0,
        births: 0,
        ..status
    }));
    model.births = 4000.0;
    model.reported(Report::from(&status));
    let bands = (0..BANDS).map(|band| {
        let x = (band as f32 - 38.0) / 12.0;
        -38.0 - 14.0 * x * x - (band % 3) as f32 * 2.0
    });
    model.sound = Sound {
        level: [-34.0, -36.0],
        peak: [-21.0, -23.0],
        bands: bands.collect(),
    };
    model
}

/// The pictures in the guide are what the screen shows; FRESHET_BLESS=1 writes them anew.
#[test]
fn the_guide_shows_what_the_screen_shows() {
    let mut model = seen();
    let small = picture(&mut model, 80, 24);
    model.act(Action::Focus(Focus::Classes));
    model.act(Action::Draw((6, 0.9), (24, 0.2)));
    model.act(Action::Draw((24, 0.2), (40, 0.65)));
    model.message = None;
    let large = picture(&mut model, 110, 42);
    let guide = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/control.md");
    let mut text = fs::read_to_string(&guide).unwrap();
    for (name, picture) in [("80x24", &small), ("110x42", &large)] {
        let (from, to) = (format!("<!-- {name} -->\n```text\n"), "```\n");
        let start = text.find(&from).unwrap() + from.len();
        let end = start + text[start..].find(to).unwrap();
        if std::env::var_os("FRESHET_BLESS").is_some() {
            text.replace_range(start..end, picture);
        } else {
            assert_eq!(&text[start..end], picture, "\n{picture}");
        }
    }
    if std::env::var_os("FRESHET_BLESS").is_some() {
        fs::write(&guide, text).unwrap();
    }
}

#[test]
fn every_size_and_every_overlay_is_drawn() {
    let mut model = seen();
    for (width, height) in [
        (1, 1),
        (20, 5),
        (64, 18),
        (80, 24),
        (81, 25),
        (200, 60),
        (300, 20),
    ] {
        for keys in ["", "?", "?p", "\u{1b}s", "\u{1b}v", "\t", "\t", "\t"] {
            press(&mut model, keys);
            let picture = picture(&mut model, width, height);
            assert_eq!(picture.lines().count(), usize::from(height));
        }
    }
    assert!(picture(&mut model, 40, 10).contains("needs 64x18"));
    // Anything that may be typed.
    for c in (' '..='~').cycle().take(3000) {
        model.quit = false;
        press(&mut model, &c.to_string());
        picture(&mut model, 80, 24);
    }
}

// ---- in a pseudo-terminal

/// A folder of its own for each test, gone after it.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        use std::sync::atomic::{AtomicU32, Ordering};
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path =
            std::env::temp_dir().join(format!("freshet-control-{}-{count}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left over is no fault of the test.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// `freshet control …` in a terminal.
struct Tui {
    child: Box<dyn portable_pty::Child + Send + Sync>,
    master: Box<dyn MasterPty + Send>,
    keys: Box<dyn Write + Send>,
    screen: Arc<Mutex<vt100::Parser>>,
}

const PATIENCE: Duration = Duration::from_secs(60);

impl Tui {
    fn start(folder: &Folder, line: &str) -> Self {
        let size = PtySize {
            rows: 24,
            cols: 80,
            ..PtySize::default()
        };
        let pair = native_pty_system().openpty(size).unwrap();
        let mut command = CommandBuilder::new(env!("CARGO_BIN_EXE_freshet"));
        command.arg("control");
        command.args(line.split_whitespace());
        command.cwd(&folder.0);
        command.env("TERM", "xterm-256color");
        command.env("NO_COLOR", "1");
        let child = pair.slave.spawn_command(command).unwrap();
        let mut output = pair.master.try_clone_reader().unwrap();
        let [rows, columns] = [24, 80].map(|count| NonZeroU16::new(count).unwrap());
        let screen = Arc::new(Mutex::new(vt100::Parser::new(rows, columns, 0)));
        let parser = Arc::clone(&screen);
        thread::spawn(move || {
            let mut buffer = [0; 4096];
            while let Ok(count @ 1..) = output.read(&mut buffer) {
                parser.lock().unwrap().process(&buffer[..count]);
            }
        });
        Self {
            child,
            keys: pair.master.take_writer().unwrap(),
            master: pair.master,
            screen,
        }
    }

    fn type_in(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
        self.keys.flush().unwrap();
    }

    fn text(&self) -> String {
        self.screen.lock().unwrap().screen().contents()
    }

    /// Waits until the screen says it.
    fn shows(&self, what: &str) -> String {
        self.comes(&format!("`{what}`"), |text| text.contains(what))
    }

    fn comes(&self, what: &str, is: impl Fn(&str) -> bool) -> String {
        let until = Instant::now() + PATIENCE;
        loop {
            let text = self.text();
            if is(&text) {
                return text;
            }
            assert!(Instant::now() < until, "no {what} in:\n{text}");
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// It ends, and leaves the terminal as it was.
    fn ends(&mut self) -> u32 {
        let until = Instant::now() + PATIENCE;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < until, "it does not end:\n{}", self.text());
            thread::sleep(Duration::from_millis(20));
        };
        // What it has said last may be still on its way.
        thread::sleep(Duration::from_millis(200));
        let parser = self.screen.lock().unwrap();
        let screen = parser.screen();
        assert!(!screen.alternate_screen() && !screen.hide_cursor());
        assert_eq!(screen.mouse_protocol_mode(), vt100::MouseProtocolMode::None);
        #[cfg(target_os = "linux")]
        {
            // A line is a line again, and what is typed is seen.
            let modes = self.master.get_termios().unwrap();
            let modes = format!("{:?}", modes.local_flags);
            assert!(
                modes.contains("ICANON") && modes.contains("ECHO"),
                "{modes}"
            );
        }
        status.exit_code()
    }
}

impl Drop for Tui {
    fn drop(&mut self) {
        // Where a test has failed.
        let _ = self.child.kill();
    }
}

#[test]
fn typed_keys_change_the_sound_of_the_machine_at_hand() {
    let folder = Folder::new();
    let mut tui = Tui::start(
        &folder,
        "--here --silent --scene brook --seed 5 --log log.txt",
    );
    let text = tui.shows("4000 1/s");
    assert!(text.contains("desk's twin, silent"), "{text}");
    tui.comes("a report", |text| text.contains("births/s"));
    // An arrow down and two right.
    tui.type_in("\x1b[B\x1b[C\x1b[C");
    tui.shows("4490 1/s");
    // With shift, and with control.
    tui.type_in("\x1b[1;2C\x1b[1;5C");
    tui.shows("8026 1/s");
    tui.type_in("\r2000\r");
    tui.shows("2000 1/s");
    // The mouse, on the intensity: at the left end of its track.
    tui.type_in("\x1b[<0;36;4M\x1b[<0;36;4m");
    tui.comes("no intensity", |text| {
        text.lines()
            .any(|line| line.contains("intensity") && line.trim_end().ends_with("*0"))
    });
    tui.type_in("u");
    tui.shows("2000 1/s");
    // A preset is kept, forgotten by the hand, and recalled.
    tui.type_in("pwone\r");
    tui.comes("that it is kept", |text| {
        text.trim_end().ends_with("kept in slot 1")
    });
    tui.type_in("j\r50\r");
    tui.shows("50 1/s");
    tui.type_in("p");
    tui.shows("1  one (over brook)");
    tui.type_in("\r");
    tui.shows("2000 1/s");
    tui.type_in("m");
    tui.shows("[muted]");
    tui.type_in("smine\r");
    tui.shows("saved: freshet render my-brook.tomlmine.toml");
    // Ctrl-C is a key like any other.
    tui.type_in("\x03");
    assert_eq!(tui.ends(), 0);
    let log = fs::read_to_string(folder.0.join("log.txt")).unwrap();
    for line in [
        "ok set water.rate=2000 at ",
        "ok set intensity=0 at ",
        "ok recall 1 at ",
        "ok mute on at ",
    ] {
        assert!(log.contains(line), "{log}");
    }
    let saved = SceneFile::open(&folder.0.join("my-brook.tomlmine.toml")).unwrap();
    assert_eq!(saved.value(param::RATE), 2000.0);
}

/// A board's twin behind a port, in a process of its own.
struct Board {
    child: Child,
    port: String,
}

impl Board {
    fn start() -> Self {
        use std::io::BufRead;
        let mut child = Command::new(env!("CARGO_BIN_EXE_freshet"))
            .args(["simulate", "--board", "f407", "--seed", "9"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let output = child.stdout.take().unwrap();
        std::io::BufReader::new(output)
            .read_line(&mut line)
            .unwrap();
        let word = |word: &&str| word.starts_with('/');
        let port = line.split_whitespace().find(word).unwrap_or_default();
        Self {
            child,
            port: port.to_owned(),
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // It may be gone already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn typed_keys_change_the_sound_of_a_board_and_it_may_be_unplugged() {
    let folder = Folder::new();
    let mut board = Board::start();
    let mut tui = Tui::start(&folder, &board.port.clone());
    tui.shows("births/s");
    let text = tui.shows("twin here");
    assert!(text.contains("f407 on "), "{text}");
    // Choose another scene, and change it.
    tui.type_in("\x1b[Z\x1b[B\r");
    tui.comes("another scene", |text| {
        text.lines()
            .next()
            .is_some_and(|line| line.contains("cave-drip"))
    });
    tui.type_in("\t\r0.8\r");
    // Up from the last one to mix.tone.
    tui.type_in("\x1b[F");
    let up = param::WEIGHT - 1 - param::TONE;
    tui.type_in(&"\x1b[A".repeat(up));
    tui.type_in("\r-4.5\r");
    tui.shows("-4.5 dB");
    tui.type_in("q");
    assert_eq!(tui.ends(), 0);
    let mut client = Client::open(&board.port, 115_200).unwrap();
    assert_eq!(client.hello().unwrap().scene, "cave-drip");
    // On its way there.
    let until = Instant::now() + PATIENCE;
    while client.get(&["intensity", "mix.tone"]).unwrap() != [0.8, -4.5] {
        assert!(Instant::now() < until);
        thread::sleep(Duration::from_millis(20));
    }
    drop(client);

    // Again, and the board is unplugged, and plugged in again.
    let plug = folder.0.join("board");
    std::os::unix::fs::symlink(&board.port, &plug).unwrap();
    let mut tui = Tui::start(&folder, plug.to_str().unwrap());
    let text = tui.shows("births/s");
    assert!(text.contains("cave-drip*"), "{text}");
    // Before its number is another terminal's.
    fs::remove_file(&plug).unwrap();
    drop(board);
    tui.shows("[gone]");
    tui.shows("trying again");
    tui.type_in("+");
    tui.shows("nobody is there");
    board = Board::start();
    std::os::unix::fs::symlink(&board.port, &plug).unwrap();
    tui.shows("u brings back");
    tui.type_in("u");
    tui.comes("the scene", |text| first_line(text).contains("cave-drip*"));
    tui.type_in("q");
    assert_eq!(tui.ends(), 0);
    let mut client = Client::open(&board.port, 115_200).unwrap();
    assert_eq!(client.hello().unwrap().scene, "cave-drip");
    let until = Instant::now() + PATIENCE;
    while client.get(&["intensity", "mix.tone"]).unwrap() != [0.8, -4.5] {
        assert!(Instant::now() < until);
        thread::sleep(Duration::from_millis(20));
    }
}

/// What the header says.
fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

#[test]
fn the_screen_follows_the_terminal_and_is_given_back_at_the_end() {
    let folder = Folder::new();
    let mut tui = Tui::start(&folder, "--here --silent --board f411");
    let text = tui.shows("births/s");
    assert!(!text.contains("rise_factor"), "{text}");
    let [rows, columns] = [42, 110].map(|count| NonZeroU16::new(count).unwrap());
    (tui.screen.lock().unwrap().screen_mut()).set_size(rows, columns);
    let size = PtySize {
        rows: 42,
        cols: 110,
        ..PtySize::default()
    };
    tui.master.resize(size).unwrap();
    tui.shows("irregularity");
    // Half an escape sequence, and what no terminal sends.
    tui.type_in("\x1b[<0;9999;9999M\x1b[99~\u{fffd}\x1b");
    let pid = tui.child.process_id().unwrap().to_string();
    let killed = Command::new("kill").args(["-TERM", &pid]).status();
    assert!(killed.unwrap().success());
    assert_eq!(tui.ends(), 0);
}

#[test]
fn errors_come_before_the_screen() {
    let run = |line: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_freshet"))
            .arg("control")
            .args(line.split_whitespace())
            .stdin(Stdio::null())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{line}");
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(run("--here --silent").contains("needs a terminal"));
    assert!(run("").contains("required"));
    let folder = Folder::new();
    let mut tui = Tui::start(&folder, "/dev/no-such-port");
    tui.shows("there is no such port");
    assert_eq!(tui.ends(), 2);
    #[cfg(not(feature = "play"))]
    {
        let mut tui = Tui::start(&folder, "--here");
        tui.shows("libasound2-dev");
        assert_eq!(tui.ends(), 2);
    }
}
