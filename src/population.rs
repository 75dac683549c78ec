//! A population of bubbles (vdD §5): radius classes, each a Poisson process that strikes one stereo resonator.
//!
//! A class's clock holds the expected births until the next one; each block uses up what the class's rate gives, so a
//! change of rate needs no redraw. A bubble that does not rise is one impulse at its exact time between samples; a
//! rising one asks for a voice. Above one birth a sample a class is a *crowd*: its impulses are drawn by their moments.

mod settings;
mod tuner;

pub use settings::{Drive, Settings};
pub use tuner::{Place, Radii, SLICE, Slice, Tuner, UnitImpulse};

use settings::Ears;

use crate::fixed::{PASCAL, exp2_neg, high, to_fixed};
use crate::frame::{BLOCK, Block};
use crate::kernel::{ALL_STILL, Drawn, Flow, Hits, Source, Stop, ring, walk};
use crate::observer::{Birth, Crowd as CrowdSeen, Observer, Path};
use crate::random::{Random, Stream};
use crate::resonator::{
    Form, Impulse, Resonator, STRIKES_MAX, SWING_MAX, State, StrikeWords, Strikes, Tuning,
    run_struck, run_two_struck,
};
use crate::stats::Stats;
use crate::voices::{Pitch, Start, Voice, Voices};

/// Most radius classes.
pub const CLASSES: usize = 64;

/// Where births are denser than this a sample, a class is a crowd.
pub const CROWD: f32 = 1.0;
/// No bubble of a class is louder than this, Pa: twice full scale.
pub const CLASS_MAX_PA: f32 = 2.0;
/// From 2^this births a block (over ln 2) on they are gathered before the resonator runs: worth it on a desktop, where
/// two resonators in step are faster than one. A Cortex-M gathers only crowds.
const CROSSOVER: Option<u8> = if cfg!(dsp) { None } else { Some(3) };
/// A retired bank rings out at least this fast, 1/s.
const RETIRED_DECAY: f64 = 60.0;

/// The moments of a class with more than one birth a sample.
#[derive(Clone, Copy, Debug)]
pub struct Crowd {
    /// Mean of the births in a block, Q32.
    births: i64,
    /// Its root, over the deviation of `rough_normal`, Q32.
    births_spread: u32,
    /// Mean of both words in a sample, Q28 of a pascal.
    mean: [i32; 2],
    /// Cholesky factor of both words' covariance, over the deviation of `rough_normal`, Q42 of a pascal.
    spread: [i32; 3],
    /// What a block's impulses may come to at most, Q27 of a pascal.
    most: u32,
}

impl Crowd {
    /// Nobody.
    pub const NONE: Self = Self {
        births: 0,
        births_spread: 0,
        mean: [0; 2],
        spread: [0; 3],
        most: 0,
    };

    /// How many are born in a block: Poisson by its first three moments, which 32 births or more make exact enough to
    /// count with.
    #[inline(always)]
    fn count(&self, random: &mut Random) -> u64 {
        // (z² − 1)/6, Q32; 2^48 over 6 squares of the rough normal's deviation is 32 768.
        let normal = i64::from(random.rough_normal());
        let skew = ((normal * normal) >> 1) - (1 << 32) / 6;
        let drawn = self.births + normal * i64::from(self.births_spread) + skew;
        ((drawn + (1 << 31)) >> 32).max(0) as u64
    }

    /// One sample's impulses, for both ears.
    #[inline(always)]
    fn draw(&self, ears: &Ears, random: &mut Random) -> StrikeWords {
        let normals = [(); 2].map(|()| [(); 2].map(|()| i64::from(random.rough_normal())));
        let ear = |words: [i64; 2], part: [i64; 2]| {
            let [a, b, c] = self.spread.map(i64::from);
            let (x, y) = (part[0], part[1]);
            [
                words[0].wrapping_add((x * a) << 16),
                words[1].wrapping_add((x * b + y * c) << 16),
            ]
        };
        let mean = self.mean.map(|m| i64::from(m) * i64::from(ears.mean));
        let [e0, e1, e2] = ears.factor.map(i64::from);
        let [p, q] = normals;
        let left = [(p[0] * e0) >> 30, (p[1] * e0) >> 30];
        let right = [(p[0] * e1 + q[0] * e2) >> 30, (p[1] * e1 + q[1] * e2) >> 30];
        StrikeWords {
            left: ear(mean, left),
            right: ear(mean, right),
        }
    }
}

/// Takes pressure from what there is room for. False where that is not enough.
#[inline(always)]
fn take(room: &mut u32, pressure: u32) -> bool {
    let fits = pressure <= *room;
    if fits {
        *room -= pressure;
    }
    fits
}

/// What a bank is tuned to.
#[derive(Clone, Debug)]
struct Table {
    tuning: [Tuning; CLASSES],
    /// The pitch of a class's rising bubbles.
    pitch: [Pitch; CLASSES],
}

impl Table {
    const SILENT: Self = Self {
        tuning: [Tuning::SILENT; CLASSES],
        pitch: [Pitch::SILENT; CLASSES],
    };
}

/// One set of resonators.
#[derive(Clone, Debug)]
struct Bank {
    resonators: [Resonator; CLASSES],
    /// How far all of them might swing from the end of the last block on, bus units; 0 where none rings.
    swing: u64,
}

impl Bank {
    /// No class rings.
    const SILENT: Self = Self {
        resonators: [Resonator::SILENT; CLASSES],
        swing: 0,
    };

    /// How far all classes may swing from here at most, bus units.
    fn reach(&self, table: &Table) -> u64 {
        (self.resonators.iter().zip(&table.tuning))
            .map(|(resonator, tuning)| tuning.swing(resonator.state.loudest() + 7))
            .sum()
    }

    /// Everything half as loud.
    #[inline(never)]
    fn halve(&mut self) {
        let states = self.resonators.iter_mut().map(|one| &mut one.state);
        states.for_each(State::halve);
    }

    /// Rings on with no births, and decays faster by `hurry`, see [`Tuning::hurried`].
    fn ring_out(&mut self, table: &Table, hurry: i32, hits: &mut Hits, out: &mut Block) {
        if self.swing > 0 {
            self.swing = (table.tuning.iter().enumerate())
                .map(|(k, tuning)| self.ring_on(k, &tuning.hurried(hurry), hits, out))
                .sum();
        }
    }

    /// Class `k` for a block without births: how far it may swing from here, bus units.
    #[inline(always)]
    fn ring_on(&mut self, k: usize, tuning: &Tuning, hits: &mut Hits, out: &mut Block) -> u64 {
        if !self.resonators[k].rings() {
            return 0;
        }
        hits.begin(tuning.form);
        self.ring(k, tuning, hits, out)
    }

    /// Rings for a block, struck by `hits`.
    #[inline(always)]
    fn ring(&mut self, k: usize, tuning: &Tuning, hits: &mut Hits, out: &mut Block) -> u64 {
        let resonator = &mut self.resonators[k];
        let extent = ring(tuning, &mut resonator.state, hits, true, out);
        resonator.settle(tuning, extent)
    }

    /// Class `k` for a block with few births, of which the first are drawn: the resonator runs from one to the next.
    #[inline(never)]
    fn ring_with<S, O>(
        &mut self,
        k: usize,
        mut drawn: Drawn,
        births: &mut Births<'_, S, O>,
        hits: &mut Hits,
        out: &mut Block,
    ) -> u64
    where
        S: AsRef<[Voice]> + AsMut<[Voice]>,
        O: Observer,
    {
        let tuning = &births.table.tuning[k];
        let mut rings = self.resonators[k].rings();
        let mut room = births.source.room.min(STRIKES_MAX);
        hits.begin(tuning.form);
        loop {
            births.strike(k, drawn.count, &mut room, |sample, impulse| {
                hits.push(sample, impulse);
            });
            rings |= !hits.is_empty();
            if !births.goes_on(k, drawn) {
                break;
            }
            ring(tuning, &mut self.resonators[k].state, hits, false, out);
            drawn = births.draw(k);
        }
        births.source.room -= births.source.room.min(STRIKES_MAX) - room;
        if rings {
            self.ring(k, tuning, hits, out)
        } else {
            0
        }
    }

    /// Many births, gathered before.
    #[inline(always)]
    fn ring_struck(
        &mut self,
        k: usize,
        tuning: &Tuning,
        strikes: &Strikes,
        out: &mut Block,
    ) -> u64 {
        let resonator = &mut self.resonators[k];
        run_struck(tuning, &mut resonator.state, strikes, out);
        resonator.settle(tuning, resonator.state.extent())
    }

    /// The same for class `k` and the next one, of the same form.
    #[inline(always)]
    fn ring_struck_pair(
        &mut self,
        k: usize,
        table: &Table,
        strikes: &[Strikes; 2],
        out: &mut Block,
    ) -> u64 {
        let (one, two) = self.resonators.split_at_mut(k + 1);
        let (one, two) = (&mut one[k], &mut two[0]);
        let tuning = [&table.tuning[k], &table.tuning[k + 1]];
        run_two_struck(tuning, [&mut one.state, &mut two.state], strikes, out);
        one.settle(tuning[0], one.state.extent()) + two.settle(tuning[1], two.state.extent())
    }
}

/// The population's state.
#[derive(Clone, Debug)]
pub struct Population {
    /// Births expected until the next one of a class, over ln 2, in its flow's units.
    clock: [u64; CLASSES],
    /// Those units, see [`Flow`].
    scale: [u8; CLASSES],
    source: Source,
    /// Births go to `banks[live]`; the other holds what rings on from before the last retuning.
    banks: [Bank; 2],
    tables: [Table; 2],
    live: usize,
    /// Births that a block may have.
    births_per_block: u32,
    /// How much faster a retired bank decays, see [`Tuning::hurried`].
    hurry: i32,
    /// How far all classes may swing from here, bus units.
    swing: u32,
    hits: Hits,
}

impl Population {
    /// As it is before it starts. All of it is zero, so that a board need not keep it in flash.
    pub const SILENT: Self = Self {
        clock: [0; CLASSES],
        scale: [0; CLASSES],
        source: Source::OFF,
        banks: [Bank::SILENT; 2],
        tables: [Table::SILENT; 2],
        live: 0,
        births_per_block: 0,
        hurry: 0,
        swing: 0,
        hits: Hits::new(),
    };

    /// Starts a silent one at `sample_rate` Hz; `births_per_block` bounds the work of a block.
    pub fn start(&mut self, seed: u64, births_per_block: u32, sample_rate: f64) {
        let random = &mut self.source.random;
        *random = Random::new(seed, Stream::Population);
        for clock in &mut self.clock {
            *clock = Flow::NONE.stroke.gap(random.bits());
        }
        self.scale = [Flow::NONE.scale; CLASSES];
        self.births_per_block = births_per_block;
        self.hurry = to_fixed(2.0 * RETIRED_DECAY / sample_rate, 32);
    }

    /// Counts on by new settings, which are then rendered with.
    pub fn apply(&mut self, settings: &Settings) {
        let clocks = self.clock.iter_mut().zip(&mut self.scale);
        for ((clock, old), flow) in clocks.zip(&settings.flow[..settings.classes]) {
            let new = flow.scale;
            if new != *old {
                *clock = *clock << new.saturating_sub(*old) >> old.saturating_sub(new);
                *old = new;
            }
        }
    }

    /// Tunes some classes. Other radii are another bank: what rings in the old one rings out there.
    pub fn tune(&mut self, slice: &Slice) {
        let place = match slice.place {
            Place::Live => self.live,
            Place::Next => {
                // What has not rung out by now is below the floor of hearing.
                self.banks[self.live ^ 1] = Bank::SILENT;
                self.live ^ 1
            }
        };
        let Table { tuning, pitch } = &mut self.tables[place];
        let places = (tuning.iter_mut().zip(pitch)).skip(slice.first);
        for ((tuning, pitch), class) in places.zip(&slice.classes) {
            (*tuning, *pitch) = (class.tuning, class.pitch);
        }
        if slice.switch {
            self.live ^= 1;
        }
    }

    /// How many resonators ring, those from before a retuning among them.
    pub fn ringing(&self) -> usize {
        let resonators = self.banks.iter().flat_map(|bank| &bank.resonators);
        resonators.filter(|resonator| resonator.rings()).count()
    }

    /// Whether nothing rings.
    pub fn is_silent(&self) -> bool {
        self.banks.iter().all(|bank| bank.swing == 0)
    }

    /// Renders one block that begins at `frame` into a silent `out`; rising bubbles go to `voices`.
    #[inline]
    pub fn render<S, O>(
        &mut self,
        settings: &Settings,
        frame: u64,
        voices: &mut Voices<S>,
        stats: &mut Stats,
        observer: &mut O,
        out: &mut Block,
    ) where
        S: AsRef<[Voice]> + AsMut<[Voice]>,
        O: Observer,
    {
        self.source.room = self.room();
        self.source.left = self.births_per_block;
        let hits = &mut self.hits;
        let old = self.live ^ 1;
        self.banks[old].ring_out(&self.tables[old], self.hurry, hits, out);
        let bank = &mut self.banks[self.live];
        let table = &self.tables[self.live];
        if settings.flows {
            let mut births = Births {
                frame,
                settings,
                table,
                source: &mut self.source,
                clock: &mut self.clock,
                voices,
                stats,
                observer,
            };
            bank.swing = births.ring_all(bank, hits, out);
            let births = u64::from(self.births_per_block - self.source.left);
            stats.births = stats.births.wrapping_add(births);
        } else {
            bank.ring_out(table, 0, hits, out);
        }
        let mut swing = self.banks.iter().map(|bank| bank.swing).sum();
        if swing > SWING_MAX / 2 {
            swing = self.hold(stats);
        }
        self.swing = swing as u32;
    }

    /// Keeps the swing of all classes inside its limit.
    #[inline(never)]
    fn hold(&mut self, stats: &mut Stats) -> u64 {
        let banks = self.banks.iter().zip(&self.tables);
        let mut swing: u64 = banks.map(|(bank, table)| bank.reach(table)).sum();
        while swing > SWING_MAX {
            // Far beyond full scale: everything gives way at once, rather than wrap.
            self.banks.iter_mut().for_each(Bank::halve);
            swing /= 2;
            stats.overloads = stats.overloads.wrapping_add(1);
        }
        swing
    }

    /// Pressure that this block's births may come to, Q27 of a pascal: what with pan (√2) and growth before the birth
    /// (1.13) keeps the sum of all classes inside an i32.
    fn room(&self) -> u32 {
        let left = 30 * PASCAL as u32 - self.swing;
        // 5/8 < 1/(1.13·√2), and Q26 to Q27.
        left / 8 * 10
    }
}

/// Where the bubbles of one block come from and go to.
struct Births<'a, S, O> {
    frame: u64,
    settings: &'a Settings,
    table: &'a Table,
    source: &'a mut Source,
    clock: &'a mut [u64; CLASSES],
    voices: &'a mut Voices<S>,
    stats: &'a mut Stats,
    observer: &'a mut O,
}

impl<'a, S, O> Births<'a, S, O>
where
    S: AsRef<[Voice]> + AsMut<[Voice]>,
    O: Observer,
{
    /// Every class for a block: how far all may swing from here, bus units.
    #[inline(always)]
    fn ring_all(&mut self, bank: &mut Bank, hits: &mut Hits, out: &mut Block) -> u64 {
        let (settings, table) = (self.settings, self.table);
        let mut swing = 0;
        let mut k = 0;
        while k < settings.classes {
            let stop = self.walk(k, bank, out);
            swing += stop.swing;
            k = stop.class;
            if k == settings.classes {
                break;
            }
            let tuning = &table.tuning[k];
            let pair = CROSSOVER.is_some()
                && k + 1 < settings.classes
                && settings.is_dense(k)
                && settings.is_dense(k + 1)
                && tuning.form == table.tuning[k + 1].form;
            swing += if let Some(drawn) = stop.drawn {
                bank.ring_with(k, drawn, self, hits, out)
            } else if pair {
                let strikes = [self.gather(k), self.gather(k + 1)];
                bank.ring_struck_pair(k, table, &strikes, out)
            } else if settings.is_dense(k) {
                bank.ring_struck(k, tuning, &self.gather(k), out)
            } else if self.waits(k) {
                bank.ring_on(k, tuning, hits, out)
            } else {
                bank.ring_with(k, self.draw(k), self, hits, out)
            };
            k += 1 + usize::from(pair);
        }
        swing
    }

    /// From class `k` on all that have nothing out of the ordinary.
    #[inline(always)]
    fn walk(&mut self, k: usize, bank: &mut Bank, out: &mut Block) -> Stop {
        if self.observer.watches_births() {
            return Stop {
                class: k,
                swing: 0,
                drawn: None,
            };
        }
        let (settings, resonators) = (self.settings, &mut bank.resonators);
        let tunings = &self.table.tuning;
        let clocks = &mut *self.clock;
        walk(
            k..settings.classes,
            resonators,
            tunings,
            &settings.flow,
            clocks,
            self.source,
            out,
        )
    }

    /// All births of class `k` in this block.
    #[inline(always)]
    fn gather(&mut self, k: usize) -> Strikes {
        let mut strikes: Strikes = [StrikeWords::default(); BLOCK];
        let settings = self.settings;
        let form = self.table.tuning[k].form;
        let mut room = self.source.room.min(STRIKES_MAX);
        if let Some(crowd) = settings.crowd(k) {
            self.crowd(k, crowd, &mut room, &mut strikes);
        }
        loop {
            let drawn = self.draw(k);
            self.strike(k, drawn.count, &mut room, |sample, impulse| {
                strikes[sample].add(form.strike(impulse));
            });
            if !self.goes_on(k, drawn) {
                break;
            }
        }
        self.source.room -= self.source.room.min(STRIKES_MAX) - room;
        strikes
    }

    /// Whether class `k` has no birth in this block; then its clock is set for the next one.
    #[inline(always)]
    fn waits(&mut self, k: usize) -> bool {
        let clock = &mut self.clock[k];
        let per_block = u64::from(self.settings.flow[k].stroke.per_block);
        let waits = *clock >= per_block;
        if waits {
            *clock -= per_block;
        }
        waits
    }

    /// Draws births of class `k` in this block.
    #[inline(always)]
    fn draw(&mut self, k: usize) -> Drawn {
        let stroke = &self.settings.flow[k].stroke;
        let watched = self.observer.watches_births();
        let silent_below = if watched { 0 } else { stroke.silent_below };
        self.source.draw(stroke, &mut self.clock[k], silent_below)
    }

    /// Whether there may be more births of class `k` in this block than those drawn. Where the block is full, the next
    /// one begins with a birth.
    #[inline(always)]
    fn goes_on(&mut self, k: usize, drawn: Drawn) -> bool {
        let full = drawn.more && self.source.left == 0;
        if full {
            self.stats.late = self.stats.late.wrapping_add(1);
            self.clock[k] = 0;
        }
        drawn.more && !full
    }

    /// What becomes of the bubbles drawn last: each a voice if it rises and finds one; else `hit` is told what the class
    /// is struck with, and after which sample.
    #[inline(always)]
    fn strike(
        &mut self,
        k: usize,
        count: usize,
        room: &mut u32,
        mut hit: impl FnMut(usize, Impulse),
    ) {
        let (flow, tuning) = (&self.settings.flow[k], &self.table.tuning[k]);
        let stroke = &flow.stroke;
        for i in 0..count {
            let [position, bits] = self.source.drawn[i];
            let mut draw = bits;
            if flow.is_crowd() {
                // The crowd has the softer ones.
                draw = stroke.still + high(bits, u32::MAX - stroke.still);
            }
            if tuning.form == Form::Silent {
                self.stats.too_high = self.stats.too_high.wrapping_add(1);
                self.report(k, position, [0; 2], Path::TooHigh);
                continue;
            }
            let soft = stroke.softness(draw);
            let pan = stroke.pan(bits);
            let rises = stroke.still < ALL_STILL && draw > stroke.still;
            if rises && self.voice(k, position, soft, pan) {
                continue;
            }
            if draw < stroke.silent_below || (rises && soft > flow.inaudible) {
                self.report(k, position, [0; 2], Path::Class);
                continue;
            }
            let (impulse, pressure) = stroke.impulse(tuning, position, soft, pan);
            if !take(room, pressure >> 2) {
                self.stats.overloads = self.stats.overloads.wrapping_add(1);
                self.report(k, position, [0; 2], Path::Dropped);
                continue;
            }
            let gain = [impulse.left, impulse.right].map(|gain| gain >> 1);
            self.report(k, position, gain, Path::Class);
            hit((position >> 27) as usize, impulse);
        }
    }

    /// Tells the observer of a birth.
    #[inline(always)]
    fn report(&mut self, k: usize, position: u32, gain: [i32; 2], path: Path) {
        let rises = path == Path::Voice;
        self.observer.birth(&Birth {
            frame: self.frame.wrapping_add(u64::from(position >> 27)),
            fraction: position & 0x07ff_ffff,
            radius: self.table.tuning[k].radius,
            rise_factor: if rises {
                self.table.pitch[k].rise_factor
            } else {
                0.0
            },
            gain,
            class: k as u8,
            path,
        });
    }

    /// Gives a rising bubble a voice. False where none was to be had.
    #[inline(never)]
    fn voice(&mut self, k: usize, position: u32, soft: u32, pan: [u32; 2]) -> bool {
        let flow = &self.settings.flow[k];
        let product = |a: u32, b: u32| (u64::from(a) * u64::from(b)) >> 31;
        let pressure = product(flow.voice_pressure, exp2_neg(soft)) as u32;
        // At most √2 of CLASS_MAX_PA.
        let gain = pan.map(|gain| product(pressure, gain) as i32);
        let age = (1 << 27) - (position & 0x07ff_ffff);
        let delay = (position >> 27) + 1;
        let start = self.voices.start(&self.table.pitch[k], delay, age, gain);
        let stats = &mut *self.stats;
        stats.rising = stats.rising.wrapping_add(1);
        match start {
            Start::Sounds => {}
            Start::Stole => stats.stolen = stats.stolen.wrapping_add(1),
            Start::Refused => {
                stats.unvoiced = stats.unvoiced.wrapping_add(1);
                return false;
            }
        }
        self.report(k, position, gain, Path::Voice);
        true
    }

    /// A block of a class with more than one birth a sample.
    #[inline(never)]
    fn crowd(&mut self, k: usize, crowd: &Crowd, room: &mut u32, strikes: &mut Strikes) {
        let tuning = &self.table.tuning[k];
        let births = crowd.count(&mut self.source.random);
        self.stats.births = self.stats.births.wrapping_add(births);
        let mut seen = CrowdSeen {
            frame: self.frame,
            radius: tuning.radius,
            class: k as u8,
            words: StrikeWords::default(),
            births,
            path: Path::Class,
        };
        if tuning.form == Form::Silent {
            self.stats.too_high = self.stats.too_high.wrapping_add(births);
            seen.path = Path::TooHigh;
        } else if !take(room, crowd.most) {
            self.stats.overloads = self.stats.overloads.wrapping_add(births);
            seen.path = Path::Dropped;
        }
        if seen.path != Path::Class {
            self.observer.crowd(&seen);
            return;
        }
        for (i, strike) in strikes.iter_mut().enumerate() {
            *strike = crowd.draw(&self.settings.ears, &mut self.source.random);
            let i = i as u64;
            self.observer.crowd(&CrowdSeen {
                frame: self.frame.wrapping_add(i),
                words: *strike,
                births: births * (i + 1) / BLOCK as u64 - births * i / BLOCK as u64,
                ..seen
            });
        }
    }
}
