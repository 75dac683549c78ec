//! A population of bubbles (vdD §5): radius classes, each a Poisson process that strikes one stereo resonator.
//!
//! A class's clock holds the expected births until the next one; each block uses up what the class's rate gives, so a
//! change of rate needs no redraw. A bubble that does not rise is one impulse at its exact time between samples; a
//! rising one asks for a voice. Above one birth a sample a class is a *crowd*: its impulses are drawn by their moments.

mod settings;
mod tuner;

pub use settings::{Drive, Settings};
pub use tuner::{Impulse, Place, Radii, SLICE, Slice, Tuner};

use settings::{Ears, Law};

use crate::fixed::{PAN, PASCAL, exp2_neg, neg_log2, sine_cosine, to_fixed};
use crate::frame::{BLOCK, Block, Frame};
use crate::observer::{Birth, Crowd as CrowdSeen, Observer, Path};
use crate::random::{Random, Stream};
use crate::resonator::{
    Form, STRIKES_MAX, SWING_MAX, State, StrikeWords, Strikes, Tuning, run_struck, run_two_struck,
};
use crate::stats::Stats;
use crate::voices::{Pitch, Start, Voice, Voices};

/// Most radius classes.
pub const CLASSES: usize = 64;

/// Where births are denser than this a sample, a class is a crowd.
pub const CROWD: f32 = 1.0;
/// No bubble of a class is louder than this, Pa: twice full scale.
pub const CLASS_MAX_PA: f32 = 2.0;
/// From this many births a block (over ln 2, Q32.32) they are gathered before the resonator runs.
const CROSSOVER: u64 = 16 << 32;
/// A retired bank rings out at least this fast, 1/s.
const RETIRED_DECAY: f64 = 60.0;

/// How a class is struck.
#[derive(Clone, Copy, Debug)]
struct Flow {
    /// Births in a block that the clock draws one by one, over ln 2, Q32.32.
    per_block: u64,
    /// 2^63 − 1 over the upper 32 bits of `per_block << shift`.
    inverse: u32,
    /// Pressure of a bubble of depth factor 1, one sample before it is due, Q27 of a pascal.
    pressure: u32,
    /// `-log2 D` (Q20) above which less than half a unit of that is left.
    inaudible: u32,
    /// The same at its birth, Q28, for voices.
    voice_pressure: u32,
    shift: u8,
    /// Which of the crowds draws the others, or [`Self::ALONE`].
    crowd: u8,
}

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

impl Flow {
    /// No crowd.
    const ALONE: u8 = u8::MAX;

    /// No births.
    const NONE: Self = Self {
        per_block: 0,
        inverse: 0,
        pressure: 0,
        inaudible: 0,
        voice_pressure: 0,
        shift: 0,
        crowd: Self::ALONE,
    };

    #[inline(always)]
    fn is_crowd(&self) -> bool {
        self.crowd != Self::ALONE
    }

    /// Where in the block the clock stands: the sample's index in the upper 5 bits, then the fraction, Q27.
    #[inline(always)]
    fn position(&self, clock: u64) -> u32 {
        let top = (clock << self.shift >> 32) as u32;
        ((u64::from(top) * u64::from(self.inverse)) >> 31) as u32
    }
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

/// Gains of both ears, Q30, from 8 random bits and the width (256: full).
#[inline(always)]
fn pan(draw: u32, width: i32) -> [i32; 2] {
    let at = (128 + ((((draw & 0xff) as i32 - 128) * width) >> 8)) as usize & 0xff;
    [PAN[256 - at], PAN[at]]
}

impl Turn<'_> {
    /// Takes pressure from what the block still has room for. False where there is not enough.
    #[inline(always)]
    fn has_room(&mut self, pressure: u32) -> bool {
        let fits = pressure <= self.room;
        if fits {
            self.room -= pressure;
        }
        fits
    }
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
    state: [State; CLASSES],
    /// Which of them ring, a bit each.
    ringing: u64,
}

impl Bank {
    fn new() -> Self {
        Self {
            state: [State::SILENT; CLASSES],
            ringing: 0,
        }
    }

    /// Ends the block: how far all classes may swing from here, bus units.
    #[inline(always)]
    fn settle(&mut self, table: &Table) -> u64 {
        let mut swing = 0;
        let mut left = self.ringing;
        while left != 0 {
            let k = left.trailing_zeros() as usize;
            left &= left - 1;
            let class = self.state[k].settle(&table.tuning[k]);
            swing += class;
            if class == 0 {
                self.ringing &= !(1 << k);
            }
        }
        swing
    }

    /// Everything half as loud.
    #[inline(never)]
    fn halve(&mut self) {
        self.state.iter_mut().for_each(State::halve);
    }

    /// Rings on with no births, and decays faster by `hurry`, see [`Tuning::hurried`].
    fn ring_out(&mut self, table: &Table, hurry: i32, out: &mut Block) {
        let mut left = self.ringing;
        while left != 0 {
            let k = left.trailing_zeros() as usize;
            left &= left - 1;
            self.state[k].run(&table.tuning[k].hurried(hurry), out);
        }
    }

    /// No class rings.
    fn silence(&mut self) {
        let mut left = self.ringing;
        while left != 0 {
            self.state[left.trailing_zeros() as usize] = State::SILENT;
            left &= left - 1;
        }
        self.ringing = 0;
    }

    /// Few births: the resonator runs from one to the next.
    #[cfg_attr(target_arch = "arm", inline(never))]
    #[cfg_attr(not(target_arch = "arm"), inline(always))]
    fn ring_with<S, O>(&mut self, k: usize, births: &mut Births<'_, S, O>, out: &mut Block)
    where
        S: AsRef<[Voice]> + AsMut<[Voice]>,
        O: Observer,
    {
        let mut done = 0;
        let (settings, table) = (births.settings, births.table);
        let mut turn = births.begin(k, &settings.flow[k], &table.tuning[k]);
        while let Some((position, bits)) = births.next(&mut turn) {
            if let Some((sample, strike)) = births.birth(&mut turn, position, bits) {
                self.ring(k, table, &mut out[done..=sample]);
                done = sample + 1;
                self.state[k].strike(strike);
                self.ringing |= 1 << k;
            }
        }
        births.end(turn);
        self.ring(k, table, &mut out[done..]);
    }

    #[inline(always)]
    fn ring(&mut self, k: usize, table: &Table, out: &mut [Frame]) {
        if self.ringing & (1 << k) != 0 {
            self.state[k].run(&table.tuning[k], out);
        }
    }

    /// Many births, gathered before.
    #[inline(always)]
    fn ring_struck(&mut self, k: usize, table: &Table, strikes: &Strikes, out: &mut Block) {
        self.ringing |= 1 << k;
        run_struck(&table.tuning[k], &mut self.state[k], strikes, out);
    }

    /// The same for class `k` and the next one, of the same form.
    #[inline(always)]
    fn ring_struck_pair(
        &mut self,
        k: usize,
        table: &Table,
        strikes: &[Strikes; 2],
        out: &mut Block,
    ) {
        self.ringing |= 3 << k;
        let (one, two) = self.state.split_at_mut(k + 1);
        let tuning = [&table.tuning[k], &table.tuning[k + 1]];
        run_two_struck(tuning, [&mut one[k], &mut two[0]], strikes, out);
    }
}

/// The population's state.
#[derive(Clone, Debug)]
pub struct Population {
    /// Births expected until the next one of a class, over ln 2, Q32.32.
    clock: [u64; CLASSES],
    random: Random,
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
}

impl Population {
    /// A silent population at `sample_rate` Hz; `births_per_block` bounds the work of a block.
    pub fn new(seed: u64, births_per_block: u32, sample_rate: f64) -> Self {
        let mut random = Random::new(seed, Stream::Population);
        Self {
            clock: [(); CLASSES].map(|()| gap(random.bits())),
            random,
            banks: [Bank::new(), Bank::new()],
            tables: [Table::SILENT; 2],
            live: 0,
            births_per_block,
            hurry: to_fixed(2.0 * RETIRED_DECAY / sample_rate, 32),
            swing: 0,
        }
    }

    /// Tunes some classes. Other radii are another bank: what rings in the old one rings out there.
    pub fn tune(&mut self, slice: &Slice) {
        let place = match slice.place {
            Place::Live => self.live,
            Place::Next => {
                // What has not rung out by now is below the floor of hearing.
                self.banks[self.live ^ 1].silence();
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

    /// Whether nothing rings.
    pub fn is_silent(&self) -> bool {
        self.banks.iter().all(|bank| bank.ringing == 0)
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
        let old = self.live ^ 1;
        self.banks[old].ring_out(&self.tables[old], self.hurry, out);
        let room = self.room();
        let bank = &mut self.banks[self.live];
        let table = &self.tables[self.live];
        let mut births = Births {
            frame,
            settings,
            table,
            random: &mut self.random,
            clock: &mut self.clock,
            left: self.births_per_block,
            room,
            voices,
            stats,
            observer,
        };
        let mut k = 0;
        while k < settings.classes {
            let pair = k + 1 < settings.classes
                && settings.is_dense(k)
                && settings.is_dense(k + 1)
                && table.tuning[k].form == table.tuning[k + 1].form;
            if pair {
                bank.ring_struck_pair(k, table, &[births.gather(k), births.gather(k + 1)], out);
                k += 2;
            } else if settings.is_dense(k) {
                bank.ring_struck(k, table, &births.gather(k), out);
                k += 1;
            } else if births.waits(k) {
                bank.ring(k, table, out);
                k += 1;
            } else {
                bank.ring_with(k, &mut births, out);
                k += 1;
            }
        }
        let banks = self.banks.iter_mut().zip(&self.tables);
        let mut swing: u64 = banks.map(|(bank, table)| bank.settle(table)).sum();
        while swing > SWING_MAX {
            // Far beyond full scale: everything gives way at once, rather than wrap.
            self.banks.iter_mut().for_each(Bank::halve);
            swing /= 2;
            stats.overloads = stats.overloads.wrapping_add(1);
        }
        self.swing = swing as u32;
    }

    /// Pressure that this block's births may come to, Q27 of a pascal: what with pan (√2) and growth before the birth
    /// (1.13) keeps the sum of all classes inside an i32.
    fn room(&self) -> u32 {
        let left = 30 * PASCAL as u32 - self.swing;
        // 5/8 < 1/(1.13·√2), and Q26 to Q27.
        left / 8 * 10
    }
}

/// Births expected until the next one, over ln 2, from 32 random bits: −log2(rnd), Q32.32.
#[inline(always)]
fn gap(bits: u32) -> u64 {
    u64::from(neg_log2(bits)) << 6
}

/// Where the bubbles of one block come from and go to.
struct Births<'a, S, O> {
    frame: u64,
    settings: &'a Settings,
    table: &'a Table,
    random: &'a mut Random,
    clock: &'a mut [u64; CLASSES],
    /// Births that this block still takes.
    left: u32,
    /// Pressure that the population still takes in this block, Q27 of a pascal.
    room: u32,
    voices: &'a mut Voices<S>,
    stats: &'a mut Stats,
    observer: &'a mut O,
}

/// A class's turn in a block: what it is drawn by, and what it draws from, in registers.
struct Turn<'a> {
    k: usize,
    law: Law,
    flow: &'a Flow,
    tuning: &'a Tuning,
    clock: u64,
    random: Random,
    /// Births and pressure that the block still takes of this class.
    left: u32,
    room: u32,
}

impl<'a, S, O> Births<'a, S, O>
where
    S: AsRef<[Voice]> + AsMut<[Voice]>,
    O: Observer,
{
    /// Whether class `k` has no birth in this block; its clock is then a block on.
    #[inline(always)]
    fn waits(&mut self, k: usize) -> bool {
        let left = self.clock[k].checked_sub(self.settings.flow[k].per_block);
        if let Some(left) = left {
            self.clock[k] = left;
        }
        left.is_some()
    }

    /// All births of class `k` in this block.
    #[cfg_attr(target_arch = "arm", inline(never))]
    #[cfg_attr(not(target_arch = "arm"), inline(always))]
    fn gather(&mut self, k: usize) -> Strikes {
        let mut strikes: Strikes = [StrikeWords::default(); BLOCK];
        // Copies: nothing else can change them, so that they stay in registers.
        let (flow, tuning) = (self.settings.flow[k], self.table.tuning[k]);
        let mut turn = self.begin(k, &flow, &tuning);
        if let Some(crowd) = self.settings.crowd(k) {
            self.crowd(&mut turn, crowd, &mut strikes);
        }
        while let Some((position, bits)) = self.next(&mut turn) {
            if let Some((sample, strike)) = self.birth(&mut turn, position, bits) {
                strikes[sample].add(strike);
            }
        }
        self.end(turn);
        strikes
    }

    #[inline(always)]
    fn begin<'b>(&self, k: usize, flow: &'b Flow, tuning: &'b Tuning) -> Turn<'b> {
        Turn {
            k,
            law: self.settings.law,
            flow,
            tuning,
            clock: self.clock[k],
            random: self.random.clone(),
            left: self.left,
            room: self.room.min(STRIKES_MAX),
        }
    }

    #[inline(always)]
    fn end(&mut self, turn: Turn<'_>) {
        self.clock[turn.k] = turn.clock;
        *self.random = turn.random;
        let births = u64::from(self.left - turn.left);
        self.stats.births = self.stats.births.wrapping_add(births);
        self.left = turn.left;
        self.room -= self.room.min(STRIKES_MAX) - turn.room;
    }

    /// Where in this block the class's next birth falls, with 32 random bits; its clock is then set for the one after
    /// it.
    #[inline(always)]
    fn next(&mut self, turn: &mut Turn<'_>) -> Option<(u32, u32)> {
        let now = turn.clock;
        if now >= turn.flow.per_block {
            turn.clock = now - turn.flow.per_block;
            return None;
        }
        if turn.left == 0 {
            // The block is full: the next one begins with a birth.
            self.stats.late = self.stats.late.wrapping_add(1);
            turn.clock = 0;
            return None;
        }
        turn.left -= 1;
        turn.clock = now + gap(turn.random.bits());
        Some((turn.flow.position(now), turn.random.bits()))
    }

    /// One bubble: a voice if it rises and finds one; else what its class is struck with, and after which sample.
    #[inline(always)]
    fn birth(
        &mut self,
        turn: &mut Turn<'_>,
        position: u32,
        bits: u32,
    ) -> Option<(usize, StrikeWords)> {
        let Turn {
            k,
            law,
            flow,
            tuning,
            ..
        } = *turn;
        let fraction = position & 0x07ff_ffff;
        let mut draw = bits;
        if flow.is_crowd() {
            // The crowd has the softer ones.
            let span = u64::from(u32::MAX - law.crowd_below);
            draw = law.crowd_below + ((u64::from(bits) * span) >> 32) as u32;
        }
        // -log2 D, Q20.
        let soft = ((u64::from(neg_log2(draw)) * u64::from(law.exponent)) >> 32) as u32;
        // The lowest bits are the generator's weakest: pan takes eight above them.
        let pan = pan(bits >> 4, law.width);
        if tuning.form == Form::Silent {
            self.stats.too_high = self.stats.too_high.wrapping_add(1);
            self.report(k, position, [0; 2], Path::TooHigh);
            return None;
        }
        if soft < law.rise_below && self.voice(k, position, soft, pan) {
            return None;
        }
        let decayed = soft + tuning.decay_over((1 << 27) - fraction);
        if decayed > flow.inaudible {
            self.report(k, position, [0; 2], Path::Class);
            return None;
        }
        let pressure = ((u64::from(flow.pressure) * u64::from(exp2_neg(decayed))) >> 31) as u32;
        let [left, right] = pan.map(|gain| ((i64::from(pressure) * i64::from(gain)) >> 30) as i32);
        if !turn.has_room(pressure) {
            self.stats.overloads = self.stats.overloads.wrapping_add(1);
            self.report(k, position, [0; 2], Path::Dropped);
            return None;
        }
        self.report(k, position, [left, right], Path::Class);
        let words = tuning.words(sine_cosine(tuning.phase_over(fraction).wrapping_neg()));
        let strike = StrikeWords::of_bubble(left, right, words);
        Some(((position >> 27) as usize, strike))
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
    fn voice(&mut self, k: usize, position: u32, soft: u32, pan: [i32; 2]) -> bool {
        let flow = &self.settings.flow[k];
        let pressure = (u64::from(flow.voice_pressure) * u64::from(exp2_neg(soft))) >> 31;
        let gain = pan.map(|gain| ((pressure * gain as u64) >> 30).min(i32::MAX as u64) as i32);
        let age = (1 << 27) - (position & 0x07ff_ffff);
        let delay = (position >> 27) + 1;
        let voice = self.table.pitch[k].start(age, delay, gain);
        let start = self.voices.start(voice);
        let stats = &mut *self.stats;
        stats.rising = stats.rising.wrapping_add(1);
        stats.stolen = stats.stolen.wrapping_add(u64::from(start == Start::Stole));
        stats.unvoiced = stats
            .unvoiced
            .wrapping_add(u64::from(start == Start::Refused));
        if start == Start::Refused {
            return false;
        }
        self.report(k, position, gain, Path::Voice);
        true
    }

    /// A block of a class with more than one birth a sample.
    #[inline(never)]
    fn crowd(&mut self, turn: &mut Turn<'_>, crowd: &Crowd, strikes: &mut Strikes) {
        let births = crowd.count(&mut turn.random);
        self.stats.births = self.stats.births.wrapping_add(births);
        let mut seen = CrowdSeen {
            frame: self.frame,
            radius: turn.tuning.radius,
            class: turn.k as u8,
            words: StrikeWords::default(),
            births,
            path: Path::Class,
        };
        if turn.tuning.form == Form::Silent {
            self.stats.too_high = self.stats.too_high.wrapping_add(births);
            seen.path = Path::TooHigh;
        } else if !turn.has_room(crowd.most) {
            self.stats.overloads = self.stats.overloads.wrapping_add(births);
            seen.path = Path::Dropped;
        }
        if seen.path != Path::Class {
            self.observer.crowd(&seen);
            return;
        }
        for (i, strike) in strikes.iter_mut().enumerate() {
            *strike = crowd.draw(&self.settings.ears, &mut turn.random);
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
