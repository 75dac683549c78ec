//! All that the screen shows, and what each action makes of it. Nothing here knows a terminal, a port or a clock.

use std::path::PathBuf;

use freshet::control::Control;
use freshet::param::{self, COUNT, TABLE, WEIGHT};
use freshet::protocol::{Pair, SLOTS, Slot};
use freshet::scene::{IntensityCurve, Scene};

use super::action::Action;
use super::classes;
use super::history::{Gesture, History, Settings};
use super::outbox::{Order, Outbox};
use super::slider::{self, Step};
use super::sound::Sound;
use crate::board::Board;
use crate::client::{Hello, PresetInfo, Report};
use crate::scene_file::{SceneFile, parse_value};

/// How long a message stays, s.
const MESSAGE: f64 = 8.0;
/// What a key raises a bar by.
const RAISE: f32 = 0.05;

/// A part of the screen with a cursor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Focus {
    /// The list of scenes.
    Scenes,
    /// The sliders.
    Parameters,
    /// The histogram.
    Classes,
}

/// A scene that can be played.
#[derive(Clone, Debug)]
pub struct Known {
    /// What the instrument calls it.
    pub name: String,
    /// What it is made of, where it is known here.
    pub file: Option<SceneFile>,
}

/// What is asked in the bottom line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ask {
    /// A parameter's value.
    Value(usize),
    /// Where to save.
    File,
    /// Whether a file may be written over.
    Overwrite(PathBuf),
    /// What to call a preset.
    Name(Slot),
    /// Whether a preset may be written over, called so.
    Replace(Slot, String),
    /// Whether a preset may be forgotten.
    Erase(Slot),
}

impl Ask {
    /// Whether the answer is yes or no.
    pub fn is_yes_or_no(&self) -> bool {
        matches!(
            self,
            Self::Overwrite(_) | Self::Replace(..) | Self::Erase(_)
        )
    }
}

/// What lies over the screen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Overlay {
    /// Nothing.
    None,
    /// The keys.
    Help,
    /// The presets, with the cursor on a slot.
    Presets(Slot),
    /// A question, and as much of the answer as there is.
    Prompt(Ask, String),
}

/// A word to the person.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// What is said.
    pub text: String,
    /// Whether something went wrong.
    pub is_warning: bool,
    /// Until when, s.
    pub until: f64,
}

/// What somebody else has to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Errand {
    /// Write a scene file; whether one that is there may be written over.
    Save(PathBuf, bool),
}

/// How the instrument stood when it answered.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Who it is, and what it plays.
    pub hello: Hello,
    /// Every parameter.
    pub values: Vec<Pair>,
    /// Its scenes, by their numbers.
    pub scenes: Vec<String>,
    /// Its presets.
    pub presets: Vec<PresetInfo>,
}

/// The state of the screen.
#[derive(Clone, Debug)]
pub struct Model {
    /// What the port is called.
    pub port: String,
    /// Whether the sound comes from this machine.
    pub here: bool,
    /// Who is there.
    pub hello: Hello,
    /// Why nobody is, if that is so.
    pub lost: Option<String>,
    /// The scenes there are.
    pub scenes: Vec<Known>,
    /// Where everything stands.
    pub settings: Settings,
    /// The same as the scene has it.
    pub scene_values: [f32; COUNT],
    /// Whether it is silent.
    pub muted: bool,
    /// What is kept.
    pub presets: Vec<PresetInfo>,
    /// Where the cursor is.
    pub focus: Focus,
    /// The scene under the cursor.
    pub scene_cursor: usize,
    /// The parameter under the cursor, as an index in the table.
    pub parameter: usize,
    /// The class under the cursor, from 0.
    pub class: usize,
    /// First row that is seen of the sliders, and of the scenes.
    pub scroll: (usize, usize),
    /// Whether the spectrum has the place of the histogram.
    pub wide_spectrum: bool,
    /// What lies over it all.
    pub overlay: Overlay,
    /// The last word.
    pub message: Option<Message>,
    /// The last report, and the births a second since the one before.
    pub report: Option<Report>,
    /// See `report`.
    pub births: f32,
    /// What is heard.
    pub sound: Sound,
    /// What is to be sent.
    pub outbox: Outbox,
    /// What is to be done.
    pub errands: Vec<Errand>,
    /// Orders that were given, since the start.
    pub given: u64,
    /// Time, s.
    pub now: f64,
    /// Whether it is over.
    pub quit: bool,
    history: History,
    known: Vec<Known>,
}

impl Model {
    /// The screen of an instrument; `known` are the scenes whose files are known here.
    pub fn new(port: &str, here: bool, standing: Standing, known: Vec<Known>) -> Self {
        let mut model = Self {
            port: port.to_owned(),
            here,
            hello: standing.hello.clone(),
            lost: None,
            scenes: Vec::new(),
            settings: Settings {
                scene: String::new(),
                values: TABLE.each_ref().map(|param| param.default),
            },
            scene_values: TABLE.each_ref().map(|param| param.default),
            muted: false,
            presets: Vec::new(),
            focus: Focus::Parameters,
            scene_cursor: 0,
            parameter: param::INTENSITY,
            class: 0,
            scroll: (0, 0),
            wide_spectrum: false,
            overlay: Overlay::None,
            message: None,
            report: None,
            births: 0.0,
            sound: Sound::default(),
            outbox: Outbox::default(),
            errands: Vec::new(),
            given: 0,
            now: 0.0,
            quit: false,
            history: History::default(),
            known,
        };
        model.take(standing);
        model
    }

    /// Somebody is there (again).
    pub fn connected(&mut self, standing: Standing) {
        let before = self.settings.clone();
        let was_lost = self.lost.take().is_some();
        self.outbox.clear();
        self.muted = false;
        self.report = None;
        self.take(standing);
        let back = if was_lost {
            "is back"
        } else {
            "has started anew"
        };
        if before == self.settings {
            self.say(format!("the board {back}, and sounds as before"));
        } else {
            self.history.note(&before, Gesture::Single, self.now);
            self.say(format!("the board {back}; u brings back what you had"));
        }
    }

    fn take(&mut self, standing: Standing) {
        self.scenes = (standing.scenes.into_iter())
            .map(|name| Known {
                file: (self.known.iter())
                    .find(|known| known.name == name)
                    .and_then(|known| known.file.clone()),
                name,
            })
            .collect();
        self.presets = standing.presets;
        self.stands(standing.hello, &standing.values);
        self.scene_cursor = self.playing().unwrap_or(0);
    }

    fn stands(&mut self, hello: Hello, values: &[Pair]) {
        for &(id, value) in values {
            if let Some(index) = param::index_of_id(id) {
                self.settings.values[index] = value;
            }
        }
        if self.settings.scene != hello.scene {
            self.settings.scene.clone_from(&hello.scene);
            self.scene_values = match self.file() {
                Some(file) => values_of(&file.scene),
                None => self.settings.values,
            };
        }
        self.hello = hello;
        self.class = self.class.min(classes::count(&self.settings.values) - 1);
    }

    /// How the instrument stood after so many orders. What came too late for the orders since is not looked at.
    pub fn standing(&mut self, after: u64, hello: Hello, values: &[Pair]) {
        if after != self.given || !self.outbox.is_empty() {
            return;
        }
        let other = hello.scene != self.settings.scene;
        if other && self.playing().is_some() && after == self.given {
            let before = self.settings.clone();
            self.history.note(&before, Gesture::Single, self.now);
            self.say(format!("the board plays {}", hello.scene));
        }
        self.stands(hello, values);
        if other {
            self.scene_cursor = self.playing().unwrap_or(self.scene_cursor);
        }
    }

    /// Nobody is there.
    pub fn lost(&mut self, why: String) {
        self.outbox.clear();
        self.lost = Some(why);
    }

    /// A report came.
    pub fn reported(&mut self, report: Report) {
        if let Some(before) = &self.report {
            let (before, after) = (before.status(), report.status());
            let frames = after.frame.wrapping_sub(before.frame);
            if frames > 0 && after.frame > before.frame && self.hello.rate > 0.0 {
                let births = after.births.saturating_sub(before.births) as f32;
                let rate = births * self.hello.rate / frames as f32;
                self.births += (rate - self.births) * 0.5;
            }
        }
        self.report = Some(report);
    }

    /// The next order, if one waits.
    pub fn order(&mut self) -> Option<Order> {
        let order = self.outbox.take()?;
        self.given += 1;
        Some(order)
    }

    /// Place of the scene that plays, in the list.
    pub fn playing(&self) -> Option<usize> {
        (self.scenes.iter()).position(|scene| scene.name == self.settings.scene)
    }

    /// What the scene that plays is made of, where that is known.
    pub fn file(&self) -> Option<&SceneFile> {
        self.scenes[self.playing()?].file.as_ref()
    }

    /// What the intensity moves.
    pub fn curves(&self) -> &[IntensityCurve] {
        self.file().map_or(&[], |file| &file.scene.curves)
    }

    /// Whether a parameter is not as the scene has it.
    pub fn is_turned(&self, index: usize) -> bool {
        let (is, was) = (self.settings.values[index], self.scene_values[index]);
        let by_intensity = (self.curves().iter())
            .find(|curve| curve.param == index)
            .map(|curve| curve.at(self.settings.values[param::INTENSITY]));
        !like(is, by_intensity.unwrap_or(was))
    }

    /// Whether anything is not as the scene has it.
    pub fn is_changed(&self) -> bool {
        (0..COUNT).any(|index| self.is_turned(index))
    }

    /// A word to the person.
    pub fn say(&mut self, text: impl Into<String>) {
        self.word(text.into(), false);
    }

    /// Something went wrong.
    pub fn warn(&mut self, text: impl Into<String>) {
        self.word(text.into(), true);
    }

    fn word(&mut self, text: String, is_warning: bool) {
        self.message = Some(Message {
            text,
            is_warning,
            until: self.now + MESSAGE,
        });
    }

    /// Time goes on.
    pub fn tick(&mut self, now: f64) {
        self.now = now;
        if (self.message.as_ref()).is_some_and(|message| message.until < now) {
            self.message = None;
        }
    }

    /// What became of a scene file.
    pub fn saved(&mut self, path: PathBuf, result: Result<(), SaveError>) {
        match result {
            Ok(()) => self.say(format!(
                "saved: freshet render {} sounds like this",
                path.display()
            )),
            Err(SaveError::Exists) => {
                self.overlay = Overlay::Prompt(Ask::Overwrite(path), String::new());
            }
            Err(SaveError::Failed(why)) => self.warn(why),
        }
    }

    /// Does it.
    pub fn act(&mut self, action: Action) {
        match action {
            Action::Quit => self.quit = true,
            Action::Accept | Action::Cancel | Action::Type(_) | Action::Backspace => {
                self.answer(action);
            }
            Action::Help => {
                self.overlay = match self.overlay {
                    Overlay::Help => Overlay::None,
                    _ => Overlay::Help,
                };
            }
            Action::Presets => {
                self.overlay = match self.overlay {
                    Overlay::Presets(_) => Overlay::None,
                    _ => Overlay::Presets(1),
                };
            }
            Action::Move(by) if matches!(self.overlay, Overlay::Presets(_)) => {
                if let Overlay::Presets(slot) = &mut self.overlay {
                    *slot = stepped((*slot).into(), by, usize::from(SLOTS) + 1) as Slot;
                }
            }
            Action::Store | Action::Erase => self.preset(&action),
            Action::Move(by) => self.move_by(by),
            Action::Next(by) => {
                let order = [Focus::Scenes, Focus::Parameters, Focus::Classes];
                let at = order.iter().position(|focus| *focus == self.focus);
                let next = (at.unwrap_or(0) as i32 + by).rem_euclid(3);
                self.focus(order[next as usize]);
            }
            Action::Focus(focus) => self.focus(focus),
            Action::Select(index) => {
                self.focus(Focus::Parameters);
                self.parameter = index.min(WEIGHT - 1);
            }
            Action::View => {
                self.wide_spectrum = !self.wide_spectrum;
                // Nobody draws in what is not seen.
                if self.wide_spectrum && self.focus == Focus::Classes {
                    self.focus = Focus::Parameters;
                }
            }
            Action::Pause => self.history.pause(),
            Action::Save => {
                let name = format!("my-{}.toml", self.settings.scene.replace(' ', "-"));
                self.overlay = Overlay::Prompt(Ask::File, name);
            }
            // From here on somebody has to be there.
            _ if self.lost.is_some() => {
                self.warn("nobody is there to hear it; waiting for the board");
            }
            Action::Enter => match self.focus {
                Focus::Scenes => self.play(self.scene_cursor),
                Focus::Parameters => {
                    self.overlay = Overlay::Prompt(Ask::Value(self.parameter), String::new());
                }
                Focus::Classes => {
                    self.overlay = Overlay::Prompt(Ask::Value(WEIGHT + self.class), String::new());
                }
            },
            Action::Play(place) => self.play(place),
            Action::Turn(step, count) => self.turn(step, count),
            Action::TurnThat(index, count) if index >= WEIGHT => {
                self.raise(index - WEIGHT, RAISE * count as f32);
            }
            Action::TurnThat(index, count) => {
                let value = self.settings.values[index];
                let turned = slider::turned(&TABLE[index], value, Step::Usual, count);
                self.set(index, turned, Gesture::Turn(index));
            }
            Action::Intensity(value) => {
                self.set(param::INTENSITY, value, Gesture::Turn(param::INTENSITY));
            }
            Action::Slide(index, x) => {
                let value = slider::value_at(&TABLE[index], x);
                self.set(index, value, Gesture::Turn(index));
            }
            Action::Draw(from, to) => self.draw(from, to),
            Action::Default => {
                let index = self.under_cursor();
                self.put(index, TABLE[index].default);
            }
            Action::AsScene => {
                let index = self.under_cursor();
                let curve = self.curves().iter().find(|curve| curve.param == index);
                let own = curve.map(|curve| curve.at(self.settings.values[param::INTENSITY]));
                self.put(index, own.unwrap_or(self.scene_values[index]));
            }
            Action::Undo => match self.history.undo(&self.settings) {
                Some(settings) => self.go(settings),
                None => self.say("nothing to undo"),
            },
            Action::Redo => match self.history.redo(&self.settings) {
                Some(settings) => self.go(settings),
                None => self.say("nothing to redo"),
            },
            Action::Mute => {
                self.muted = !self.muted;
                self.outbox.push(Order::Mute(self.muted));
            }
            Action::Trigger => self.outbox.push(Order::Trigger),
        }
    }

    fn focus(&mut self, focus: Focus) {
        self.focus = focus;
        if focus == Focus::Classes {
            self.wide_spectrum = false;
        }
    }

    /// The parameter under the cursor; among the scenes it is the intensity.
    pub fn under_cursor(&self) -> usize {
        match self.focus {
            Focus::Scenes => param::INTENSITY,
            Focus::Parameters => self.parameter,
            Focus::Classes => WEIGHT + self.class,
        }
    }

    fn move_by(&mut self, by: i32) {
        match self.focus {
            Focus::Scenes => {
                self.scene_cursor = stepped(self.scene_cursor, by, self.scenes.len());
            }
            Focus::Parameters => self.parameter = stepped(self.parameter, by, WEIGHT),
            Focus::Classes => {
                let count = classes::count(&self.settings.values);
                self.class = stepped(self.class, by, count);
            }
        }
    }

    fn turn(&mut self, step: Step, count: i32) {
        let index = self.under_cursor();
        if index >= WEIGHT {
            let size = match step {
                Step::Fine => RAISE / 5.0,
                Step::Usual => RAISE,
                Step::Coarse => RAISE * 4.0,
            };
            return self.raise(index - WEIGHT, size * count as f32);
        }
        let turned = slider::turned(&TABLE[index], self.settings.values[index], step, count);
        self.set(index, turned, Gesture::Turn(index));
    }

    /// Raises a class's bar.
    fn raise(&mut self, class: usize, by: f32) {
        let height = classes::height(classes::weight(&self.settings.values, class));
        // The heights that keys reach do not drift.
        let raised = ((height + by) * 100.0).round() / 100.0;
        self.draw((class, raised), (class, raised));
    }

    fn draw(&mut self, from: (usize, f32), to: (usize, f32)) {
        let last = classes::count(&self.settings.values) - 1;
        let [from, to] = [from, to].map(|(class, height)| (class.min(last), height));
        self.class = to.0;
        let bars: Vec<_> = classes::stroke(from, to).collect();
        let bars = bars
            .into_iter()
            .map(|(class, height)| (WEIGHT + class, classes::weight_at(height)));
        self.weigh(bars.collect(), Gesture::Draw);
    }

    /// Sets weights, and makes them count.
    fn weigh(&mut self, weights: Vec<(usize, f32)>, gesture: Gesture) {
        let before = self.settings.clone();
        if before.values[param::LAW] != classes::CUSTOM {
            // They begin as what was heard until now.
            for class in 0..classes::count(&before.values) {
                let weight = classes::weight(&before.values, class);
                self.change(WEIGHT + class, (weight * 1e4).round() / 1e4);
            }
            self.change(param::LAW, classes::CUSTOM);
            self.say("water.law is custom now: the bars are what is born (u undoes)");
        }
        for (index, weight) in weights {
            self.change(index, weight);
        }
        if self.settings != before {
            self.history.note(&before, gesture, self.now);
        }
    }

    /// A value that was named.
    fn put(&mut self, index: usize, value: f32) {
        if index >= WEIGHT {
            self.weigh(vec![(index, value)], Gesture::Single);
        } else {
            self.set(index, value, Gesture::Single);
        }
    }

    fn set(&mut self, index: usize, value: f32, gesture: Gesture) {
        if self.settings.values[index] == value || !TABLE[index].accepts(value) {
            return;
        }
        self.history.note(&self.settings, gesture, self.now);
        self.change(index, value);
        self.class = self.class.min(classes::count(&self.settings.values) - 1);
    }

    /// Changes a value here and there; what the intensity moves follows.
    fn change(&mut self, index: usize, value: f32) {
        if self.settings.values[index] == value {
            return;
        }
        self.settings.values[index] = value;
        self.outbox.set(index, value, None);
        if index == param::INTENSITY {
            self.follow();
        }
    }

    fn follow(&mut self) {
        let intensity = self.settings.values[param::INTENSITY];
        let moved = self.curves().iter();
        let moved: Vec<_> = moved
            .map(|curve| (curve.param, curve.at(intensity)))
            .collect();
        for (index, value) in moved {
            self.settings.values[index] = value;
        }
    }

    fn play(&mut self, place: usize) {
        let Some(scene) = self.scenes.get(place) else {
            return;
        };
        let (name, file) = (scene.name.clone(), scene.file.clone());
        self.history.note(&self.settings, Gesture::Single, self.now);
        self.scene_cursor = place;
        self.begin(name, file.as_ref());
    }

    fn begin(&mut self, name: String, file: Option<&SceneFile>) {
        self.outbox.push(Order::Scene(name.clone()));
        self.settings.scene = name;
        if let Some(file) = file {
            self.settings.values = values_of(&file.scene);
        }
        self.scene_values = self.settings.values;
        self.class = self.class.min(classes::count(&self.settings.values) - 1);
    }

    /// Goes to other settings.
    fn go(&mut self, settings: Settings) {
        let mut all = false;
        if settings.scene != self.settings.scene {
            let scene = self
                .scenes
                .iter()
                .position(|scene| scene.name == settings.scene);
            let Some(place) = scene else {
                return self.warn(format!(
                    "the board has no scene `{}` any more",
                    settings.scene
                ));
            };
            let file = self.scenes[place].file.clone();
            all = file.is_none();
            self.scene_cursor = place;
            self.begin(settings.scene.clone(), file.as_ref());
        }
        let differs = |index: usize| all || self.settings.values[index] != settings.values[index];
        let mut changes: Vec<usize> = (0..COUNT).filter(|index| differs(*index)).collect();
        if differs(param::INTENSITY) {
            // At once: what follows it would be led away while it moves.
            let value = settings.values[param::INTENSITY];
            self.outbox.set(param::INTENSITY, value, Some(0.0));
            let moved: Vec<usize> = self.curves().iter().map(|curve| curve.param).collect();
            for &index in &moved {
                (self.outbox).set(index, settings.values[index], Some(0.0));
            }
            changes.retain(|index| *index != param::INTENSITY && !moved.contains(index));
        }
        for index in changes {
            self.outbox.set(index, settings.values[index], None);
        }
        self.settings = settings;
        self.class = self.class.min(classes::count(&self.settings.values) - 1);
    }

    fn preset(&mut self, action: &Action) {
        let Overlay::Presets(slot) = self.overlay else {
            return;
        };
        let kept = self.presets.iter().find(|preset| preset.slot == slot);
        self.overlay = match action {
            Action::Store => {
                let name = kept.map_or(String::new(), |preset| preset.name.clone());
                Overlay::Prompt(Ask::Name(slot), name)
            }
            _ if kept.is_some() => Overlay::Prompt(Ask::Erase(slot), String::new()),
            _ => return,
        };
    }

    /// What is typed under a question or in an overlay.
    fn answer(&mut self, action: Action) {
        match (&mut self.overlay, action) {
            (Overlay::Prompt(ask, text), Action::Type(c)) => {
                if ask.is_yes_or_no() {
                    let ask = ask.clone();
                    self.overlay = Overlay::None;
                    if matches!(c, 'y' | 'Y') {
                        self.confirmed(ask);
                    } else {
                        self.say("left as it was");
                    }
                } else if !c.is_control() && text.len() < 200 {
                    text.push(c);
                }
            }
            (Overlay::Prompt(_, text), Action::Backspace) => {
                text.pop();
            }
            (Overlay::Prompt(ask, text), Action::Accept) => {
                let (ask, text) = (ask.clone(), text.trim().to_owned());
                self.overlay = Overlay::None;
                if ask.is_yes_or_no() {
                    self.say("left as it was");
                } else {
                    self.answered(ask, text);
                }
            }
            (Overlay::Presets(slot), Action::Accept) => {
                let slot = *slot;
                let kept = self.presets.iter().any(|preset| preset.slot == slot);
                if !kept {
                    self.say(format!(
                        "nothing is kept in slot {slot}; w keeps the settings there"
                    ));
                } else if self.lost.is_some() {
                    self.warn("nobody is there to hear it; waiting for the board");
                } else {
                    self.history.note(&self.settings, Gesture::Single, self.now);
                    self.outbox.push(Order::Recall(slot));
                    self.overlay = Overlay::None;
                }
            }
            _ => self.overlay = Overlay::None,
        }
    }

    fn answered(&mut self, ask: Ask, text: String) {
        match ask {
            Ask::Value(_) if text.is_empty() => {}
            Ask::Value(index) => {
                let param = &TABLE[index];
                // The unit may be said.
                let number = text.strip_suffix(param.unit).unwrap_or(&text).trim();
                match parse_value(param, number) {
                    Ok(_) if self.lost.is_some() => self.warn("nobody is there to hear it"),
                    Ok(value) => self.put(index, value),
                    Err(error) => self.warn(error.to_string()),
                }
            }
            Ask::File if text.is_empty() => self.say("not saved"),
            Ask::File => {
                let mut path = PathBuf::from(text);
                if path
                    .extension()
                    .is_none_or(|end| !end.eq_ignore_ascii_case("toml"))
                {
                    path.as_mut_os_string().push(".toml");
                }
                self.errands.push(Errand::Save(path, false));
            }
            Ask::Name(slot) => {
                if self.presets.iter().any(|preset| preset.slot == slot) {
                    self.overlay = Overlay::Prompt(Ask::Replace(slot, text), String::new());
                } else {
                    self.confirmed(Ask::Replace(slot, text));
                }
            }
            Ask::Overwrite(_) | Ask::Replace(..) | Ask::Erase(_) => {}
        }
    }

    fn confirmed(&mut self, ask: Ask) {
        match ask {
            Ask::Overwrite(path) => self.errands.push(Errand::Save(path, true)),
            _ if self.lost.is_some() => self.warn("nobody is there to hear it"),
            Ask::Replace(slot, name) => {
                self.outbox.push(Order::Store(slot, name));
                self.say(format!("kept in slot {slot}: the sound pauses meanwhile"));
            }
            Ask::Erase(slot) => self.outbox.push(Order::Erase(slot)),
            Ask::Value(_) | Ask::File | Ask::Name(_) => {}
        }
    }
}

/// Why a scene file was not written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SaveError {
    /// There is one already.
    Exists,
    /// Anything else, in words.
    Failed(String),
}

/// The values of all parameters when a scene starts.
pub fn values_of(scene: &Scene) -> [f32; COUNT] {
    let control = Control::new(scene, 48_000, Board::Desk.limits(), 0);
    std::array::from_fn(|index| control.target(index))
}

/// Whether two values are the same to a person.
pub fn like(a: f32, b: f32) -> bool {
    (a - b).abs() <= 1e-5 * a.abs().max(b.abs())
}

fn stepped(at: usize, by: i32, count: usize) -> usize {
    let last = count.saturating_sub(1) as i64;
    (at as i64 + i64::from(by)).clamp(0, last) as usize
}
