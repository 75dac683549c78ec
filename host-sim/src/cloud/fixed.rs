//! The core's own cloud, playing an ensemble's events: what a board with room for 256 bubbles makes of them.
//!
//! What a board does in slices is done at once here: all that changes in a tick is in force at its start. Bubbles too high
//! for the cloud's half rate hear nobody and are voices of the core.

use std::collections::{BTreeMap, HashMap};

use anyhow::{Result, bail};
use freshet::bubble::{Bubble, RADIUS_MAX, RADIUS_MIN};
use freshet::cloud::{Body, Cloud, FORCES, HIGHEST, Keep, Keeper, Message, Push, force};
use freshet::fixed::{BUBBLE_MAX_PA, PASCAL};
use freshet::mix::Output;
use freshet::profile::{H743, Profile};
use freshet::voices::{Pitch, Strike};
use freshet::{BLOCK, Frame, Instrument, TICK};

use super::coupling::{Coupling, Place};
use super::ensemble::{Counts, Event, Key, PITCH_LIMIT, Sounding};
use super::forcing::Pulse;
use super::solver::Method;
use super::step::Tone;
use crate::board::Desk;
use crate::scene_file::SceneFile;

/// Clusters of eight.
const CLUSTERS: usize = 32;
/// Frames from a strike to the sound.
const LATE: usize = 14;
/// Bubbles that are moved in a tick, those first that have waited longest; a board moves fewer still.
const MOVES: usize = 1;
/// A file's pulses are stronger than what the core has room for: so much softer here, and louder again afterwards.
const SOFTER: f64 = 8.0;
/// Where there is no image, the surface is so far above, m: as far as an f32 still tells apart 2 µm.
const FAR: f64 = 30.0;

/// A living bubble.
#[derive(Clone, Copy)]
struct Living {
    place: Place,
    tone: Tone,
    /// Tick in which the core last heard of it.
    heard: u64,
    /// Whether it has moved since.
    moved: bool,
}

/// See above.
pub struct Fixed {
    rate: f64,
    dipole: bool,
    keeper: Keeper<CLUSTERS>,
    cloud: Cloud<<H743 as Profile>::Cloud>,
    voices: Instrument<Desk>,
    message: Message,
    living: BTreeMap<Key, Living>,
    /// Strikes of ticks to come.
    strikes: HashMap<Key, Vec<(f64, Pulse)>>,
    frame: u64,
    /// The voices' last frames, until the cloud's come.
    before: [f64; LATE],
    counts: Counts,
}

impl Fixed {
    /// Nobody yet. `alone`: nobody hears anybody.
    ///
    /// # Errors
    /// A coupling that is not the core's, or a rate that is no whole number.
    pub fn new(method: Method, alone: bool) -> Result<Self> {
        let Coupling { dipole, .. } = method.coupling;
        let own = Coupling {
            dipole,
            ..Coupling::DEFAULT
        };
        if method.coupling != own {
            bail!(
                "--solver fixed: the core has the definite kernel with an epsilon of 2, no other"
            );
        }
        let rate = method.rate as u32;
        let mut keeper = Keeper::OFF;
        keeper.start(0, rate);
        keeper.couple(if alone { 0.0 } else { 1.0 }, 0.0);
        let mut cloud = Cloud::new(H743::CLOUD);
        cloud.start(method.rate);
        let silence = SceneFile::parse("silence", "water = { rate = 0 }")?.scene;
        Ok(Self {
            rate: method.rate,
            dipole,
            keeper,
            cloud,
            voices: Instrument::new(&silence, rate, 0, Output::Raw),
            message: Message::NONE,
            living: BTreeMap::new(),
            strikes: HashMap::new(),
            frame: 0,
            before: [0.0; LATE],
            counts: Counts::default(),
        })
    }

    /// Whether the cloud has it, rather than a voice.
    fn is_low(&self, tone: &Tone) -> bool {
        tone.omega0 / std::f64::consts::TAU <= f64::from(HIGHEST) * self.rate / 2.0
    }

    fn body(&self, key: Key, living: &Living) -> Body {
        let Place { at, radius, depth } = living.place;
        let depth = if self.dipole { depth } else { FAR - at[1] };
        let bubble = Bubble {
            omega0: living.tone.omega0,
            beta: living.tone.beta,
        };
        let place = [at[0], at[2], depth].map(|x| x as f32);
        Body::tuned(radius as f32, bubble, place, key as u32)
    }

    /// What was changed by hand comes into force.
    fn finish_batch(&mut self) {
        while !self.keeper.is_at_rest() {
            self.message.clear();
            self.keeper.go_on(1.0, &mut self.message);
            self.cloud.apply(&self.message);
        }
    }

    fn take(&mut self, event: &Event) {
        match *event {
            Event::Birth { key, place, tone } => {
                let living = Living {
                    place,
                    tone,
                    heard: self.frame,
                    moved: false,
                };
                self.counts.births += 1;
                let too_high = tone.omega0 > std::f64::consts::TAU * PITCH_LIMIT * self.rate;
                self.counts.too_high += u64::from(too_high);
                if self.is_low(&tone) {
                    self.add(key, &living);
                }
                self.living.insert(key, living);
            }
            Event::Change { key, place, tone } => {
                let Some(living) = self.living.get_mut(&key) else {
                    return;
                };
                let before = std::mem::replace(&mut living.place, place);
                living.moved |= before != place || living.tone != tone;
                living.tone = tone;
                // One of another size is another one.
                if (before.radius / place.radius - 1.0).abs() > 0.01 {
                    living.moved = false;
                    let living = *living;
                    let was_there = self.keeper.remove(key as u32);
                    self.finish_batch();
                    if was_there && self.is_low(&tone) {
                        self.add(key, &living);
                    }
                }
            }
            Event::Strike { key, time, pulse } => {
                self.strikes.entry(key).or_default().push((time, pulse));
            }
            Event::Death { key } => {
                self.living.remove(&key);
                self.keeper.remove(key as u32);
                self.finish_batch();
            }
        }
    }

    /// Where all places are taken the oldest makes room.
    fn add(&mut self, key: Key, living: &Living) {
        let body = self.body(key, living);
        if !self.keeper.add(body) {
            let oldest = self.keeper.bodies().map(|(_, body)| body.born).min();
            self.keeper.remove(oldest.unwrap_or_default());
            self.finish_batch();
            self.counts.made_room += 1;
            self.keeper.add(body);
        }
        self.finish_batch();
    }

    /// Those that have moved and waited longest.
    fn move_on(&mut self) {
        let mut moved: Vec<(u64, Key)> = (self.living.iter())
            .filter(|(_, living)| living.moved)
            .map(|(key, living)| (living.heard, *key))
            .collect();
        moved.sort_unstable();
        for (_, key) in moved.into_iter().take(MOVES) {
            let Some(living) = self.living.get_mut(&key) else {
                continue;
            };
            (living.moved, living.heard) = (false, self.frame);
            let living = *living;
            let is_there = self.keeper.find(key as u32).is_some();
            match (is_there, self.is_low(&living.tone)) {
                (true, true) => {
                    self.keeper.change(self.body(key, &living));
                }
                (true, false) => {
                    self.keeper.remove(key as u32);
                }
                // One that had to make room stays out.
                _ => {}
            }
            self.finish_batch();
        }
    }

    /// Strikes that fall into this tick.
    fn strike(&mut self) {
        let end = (self.frame + TICK as u64) as f64 / self.rate;
        let mut due: Vec<(f64, Key, Pulse)> = Vec::new();
        for (key, strikes) in &mut self.strikes {
            strikes.retain(|(time, pulse)| {
                let is_due = *time < end;
                if is_due {
                    due.push((*time, *key, *pulse));
                }
                !is_due
            });
        }
        self.strikes.retain(|_, strikes| !strikes.is_empty());
        due.sort_by(|a, b| {
            (a.0, a.1)
                .partial_cmp(&(b.0, b.1))
                .expect("times are numbers")
        });
        self.message.clear();
        for (time, key, pulse) in due {
            let Some(living) = self.living.get(&key).copied() else {
                continue;
            };
            let after = (time * self.rate - self.frame as f64).max(0.0);
            let Some((place, body)) = self.keeper.find(key as u32) else {
                if !self.is_low(&living.tone) {
                    self.strike_voice(&living, &pulse, after);
                }
                continue;
            };
            let step = (2.0 / self.rate) as f32;
            let growth = (pulse.growth / SOFTER) as f32;
            let mut push = Push::of_pulse(&body, growth, pulse.length as f32, step);
            // It ends in this tick, and so may come 0.6 ms early.
            let latest = TICK / 2 - usize::from(push.steps);
            push.start = ((after / 2.0) as usize).min(latest) as u8;
            if self.message.forces.len() == FORCES {
                self.cloud.apply(&self.message);
                self.message.clear();
            }
            // There is room.
            let _ = self.message.forces.push(force(place, &push));
        }
        self.cloud.apply(&self.message);
    }

    /// A bubble alone, with the amplitude that the pulse gives it.
    fn strike_voice(&mut self, living: &Living, pulse: &Pulse, after: f64) {
        const STEPS: u32 = 64;
        let Tone { omega0, .. } = living.tone;
        // |∫ t² e^(iωt) dt| over the pulse.
        let dt = pulse.length / f64::from(STEPS);
        let (mut re, mut im) = (0.0, 0.0);
        for n in 0..STEPS {
            let t = (f64::from(n) + 0.5) * dt;
            let (sine, cosine) = (omega0 * t).sin_cos();
            (re, im) = (re + t * t * cosine * dt, im + t * t * sine * dt);
        }
        let most = f64::from(BUBBLE_MAX_PA) * 0.999;
        let pressure = (living.place.radius * omega0 * pulse.growth / SOFTER * re.hypot(im))
            .clamp(-most, most);
        let mut radius = 3.26 * std::f64::consts::TAU / omega0;
        for _ in 0..4 {
            let radius_now = radius.clamp(RADIUS_MIN, RADIUS_MAX);
            radius = radius_now * Bubble::new(radius_now).omega0 / omega0;
        }
        let radius = radius.clamp(RADIUS_MIN, RADIUS_MAX) as f32;
        let gain = (pressure * f64::from(1 << 28)) as i32;
        let pitch = Pitch::new(radius, 0.0, self.rate);
        self.voices
            .strike(&Strike::new(pitch, after, [gain; 2]), &mut ());
    }
}

impl Sounding for Fixed {
    fn frame(&self) -> u64 {
        self.frame
    }

    fn span(&self) -> usize {
        TICK
    }

    fn late(&self) -> usize {
        LATE
    }

    fn counts(&self) -> Counts {
        let work = self.cloud.work();
        Counts {
            solvers: u64::from(work.commits),
            refused: u64::from(work.refused),
            ..self.counts
        }
    }

    fn is_over(&self) -> bool {
        self.living.is_empty() && self.cloud.is_silent() && self.voices.synth().is_silent()
    }

    fn play(&mut self, events: &[Event], out: &mut Vec<f64>) -> Result<()> {
        for event in events {
            self.take(event);
        }
        self.move_on();
        self.strike();
        let coupled = self.keeper.bodies().count();
        self.counts.most_coupled = self.counts.most_coupled.max(coupled);
        self.counts.most_sounding = self.counts.most_sounding.max(coupled);
        for _ in 0..TICK / BLOCK {
            let mut voices = [Frame::ZERO; BLOCK];
            self.voices.render(&mut voices, &mut ());
            let mut block = [Frame::ZERO; BLOCK];
            self.cloud.render(&mut block);
            for (frame, voice) in block.iter().zip(&voices) {
                let pascal = SOFTER / f64::from(PASCAL);
                let voice = f64::from(voice.left) * pascal;
                // The cloud is in the middle, each ear 3 dB down.
                let cloud = f64::from(frame.left) * std::f64::consts::SQRT_2 * pascal;
                out.push(cloud + self.before[0]);
                self.before.rotate_left(1);
                self.before[LATE - 1] = voice;
            }
        }
        self.frame += TICK as u64;
        Ok(())
    }
}
