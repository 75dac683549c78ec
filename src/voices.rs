//! Bubbles with a pitch of their own: rising ones and single events, as exact damped rotations.
//!
//! The phase is the integral of `f0·(1 + σt)` (vdD §4), kept to 2^-64 turn from block to block; the envelope is
//! re-anchored every block; so pitch and decay do not drift however long a bubble rings.

use core::ops::Range;

use crate::bubble::Ringing;
use crate::fixed::{ATTACK, mul_high, mul_high_down, sine, to_fixed, to_fixed_u64};
use crate::frame::BLOCK;
use crate::resonator::PITCH_LIMIT;

/// A rising pitch stops at this multiple of where it began. From deep water to the surface the geometry of HF (6)
/// gives 1.6 to 4.3.
pub const RISE_CAP: f64 = 4.0;
/// A rising bubble fades from this part of the sample rate, down to nothing at [`PITCH_LIMIT`].
pub const RISE_FADE: f64 = 0.42;
/// A stolen voice fades out over this many frames (4 ms at 48 kHz).
pub const STEAL_FADE: u32 = 192;
/// Voices that may be stolen in one block.
pub const STEALS: usize = 8;

/// Envelopes end 102 dB below where they began …
const ENVELOPE_FLOOR: u32 = 1 << (31 - 17);
/// … or where they are worth this many bus units.
const AUDIBLE_FLOOR: i64 = 2;
/// `e = 0.85` in Q31, where the soft attack is over.
const ATTACK_END: i32 = 1_825_361_101;
/// Sum of all voices' amplitudes the bus takes, in units of the gains (Q28 of a pascal): 16 Pa.
const LOUDNESS_MAX: u64 = 16 << 28;
const EDGE_START: u32 = (RISE_FADE * 4_294_967_296.0) as u32;
const EDGE_END: u32 = (PITCH_LIMIT * 4_294_967_296.0) as u32;

/// Pitch and decay of a kind of bubble, ready for the audio path. Made in f64.
#[derive(Clone, Copy, Debug)]
pub struct Pitch {
    /// Radius, m.
    pub radius: f32,
    /// Rise factor ξ: σ = ξ·β.
    pub rise_factor: f32,
    /// Turns a sample at birth, Q64. Zero: too high to be sounded.
    begin: u64,
    /// Turns a sample at the cap, Q64.
    limit: u64,
    /// Growth of turns a sample, a sample, Q64.
    slope: u64,
    /// Samples until the cap, Q32.32.
    ramp: u64,
    /// Part of the envelope kept over a block, Q32.
    keep: u32,
    /// Part of the envelope lost in a sample, Q32.
    loss: i32,
    /// Decay a sample, β over the sample rate, Q31.
    decay: u32,
}

impl Pitch {
    /// A pitch that is not sounded.
    pub const SILENT: Self = Self {
        radius: 0.0,
        rise_factor: 0.0,
        begin: 0,
        limit: 0,
        slope: 0,
        ramp: 0,
        keep: 0,
        loss: 0,
        decay: 0,
    };

    /// The pitch of a bubble of `radius` metres and rise factor `rise_factor` at `rate` Hz.
    pub fn new(radius: f32, rise_factor: f32, rate: f64) -> Self {
        Self::of(&Ringing::new(radius, rate), rise_factor)
    }

    /// The pitch of a bubble of rise factor `rise_factor`.
    pub fn of(ringing: &Ringing, rise_factor: f32) -> Self {
        let Ringing {
            radius,
            turns,
            decay: beta,
            loss,
            ..
        } = *ringing;
        if turns > PITCH_LIMIT {
            return Self {
                radius,
                rise_factor,
                ..Self::SILENT
            };
        }
        let cap = (turns * RISE_CAP).min(PITCH_LIMIT);
        // Half a turn a sample each sample reaches any cap within one sample: faster is the same.
        let slope = (turns * f64::from(rise_factor) * beta).min(0.5);
        let (slope, ramp) = if slope > 0.0 {
            // A ramp of weeks is none.
            let ramp = ((cap - turns) / slope).min(2_147_483_647.0);
            (to_fixed_u64(slope, 64), to_fixed_u64(ramp, 32))
        } else {
            (0, 0)
        };
        let begin = to_fixed_u64(turns, 64);
        // Kept over a block, by squaring.
        let keep = (0..BLOCK.ilog2()).fold(1.0 - loss, |keep, _| keep * keep);
        // The cap as the fixed-point ramp reaches it, so that the pitch has no step there.
        let limit = begin + ((u128::from(slope) * u128::from(ramp)) >> 32) as u64;
        Self {
            radius,
            rise_factor,
            begin,
            limit,
            slope,
            ramp,
            keep: to_fixed_u64(keep, 32).min(u64::from(u32::MAX)) as u32,
            loss: to_fixed(loss, 32),
            decay: to_fixed(beta, 31) as u32,
        }
    }

    /// Whether the pitch is below [`PITCH_LIMIT`].
    pub fn sounds(&self) -> bool {
        self.begin != 0
    }

    /// A bubble born `fraction` (Q27) of a sample before its first sample is due in `delay` frames; `gain` is its
    /// pressure in the two ears, Q28 of a pascal.
    pub fn start(&self, fraction: u32, delay: u32, gain: [i32; 2]) -> Voice {
        let wide = |a: u64, b: u64| ((u128::from(a) * u128::from(b)) >> 32) as u64;
        let age = u64::from(fraction) << 5;
        let ramped = age.min(self.ramp);
        // ∫ f dt, with the corner at the cap if it comes before the first sample.
        let rise = wide(wide(self.slope, ramped), ramped) >> 1;
        let phase = wide(self.begin, ramped)
            .wrapping_add(rise)
            .wrapping_add(wide(self.limit, age - ramped));
        let pitch = self.begin + wide(self.slope, ramped);
        let lost = ((u64::from(self.decay) * u64::from(fraction)) >> 27) as i64;
        let loudest = i64::from(gain[0].unsigned_abs().max(gain[1].unsigned_abs()));
        let audible = (AUDIBLE_FLOOR << (31 + 2)) / loudest.max(1);
        Voice {
            delay,
            phase,
            pitch,
            slope: self.slope,
            limit: self.limit,
            ramp: self.ramp - ramped,
            envelope: exp_neg(lost) << 32,
            keep: self.keep,
            loss: self.loss,
            gain,
            floor: ENVELOPE_FLOOR.max(audible.min(1 << 31) as u32),
            fade: 0,
        }
    }
}

/// One sounding bubble.
#[derive(Clone, Copy, Debug, Default)]
pub struct Voice {
    /// Turns, Q64.
    phase: u64,
    /// Turns a sample now, Q64.
    pitch: u64,
    slope: u64,
    limit: u64,
    /// Samples until the cap, Q32.32.
    ramp: u64,
    /// Q63.
    envelope: u64,
    keep: u32,
    loss: i32,
    /// Q28 of a pascal.
    gain: [i32; 2],
    /// The envelope (Q31) at which the voice is over.
    floor: u32,
    /// Frames until the first sample.
    delay: u32,
    /// Frames left of the fade of a stolen voice; 0: not stolen.
    fade: u32,
}

/// A single bubble that is to sound.
#[derive(Clone, Copy, Debug)]
pub struct Strike {
    /// Its pitch and decay.
    pub pitch: Pitch,
    /// Frames until its first sample, at least 1.
    pub delay: u32,
    /// Its age at the first sample, in samples, Q27.
    pub age: u32,
    /// Its pressure in the two ears, Q28 of a pascal.
    pub gain: [i32; 2],
}

impl Strike {
    /// A bubble born `at` frames from now, with `gain` in the two ears, Q28 of a pascal.
    pub fn new(pitch: Pitch, at: f64, gain: [i32; 2]) -> Self {
        let whole = libm::floor(at.max(0.0));
        Self {
            pitch,
            delay: (whole as u32).saturating_add(1),
            age: to_fixed_u64(1.0 - (at.max(0.0) - whole), 27) as u32,
            gain,
        }
    }
}

/// What the voices add to: a block of one ear, then of the other. Apart, a desktop's compiler keeps the two sums in
/// general registers, which is twice as fast.
pub type Ears = [[i32; BLOCK]; 2];

/// The registers of one run of samples.
struct Run {
    phase: u32,
    step: u32,
    slope: u32,
    /// How far the step, a mean over the sample to come, is ahead of the pitch at the sample itself.
    ahead: u32,
    envelope: i32,
}

impl Voice {
    /// Amplitude of the louder ear now, Q28 of a pascal.
    fn level(&self) -> u32 {
        let gain = self.gain[0].unsigned_abs().max(self.gain[1].unsigned_abs());
        ((u64::from(gain) * (self.envelope >> 32)) >> 31) as u32
    }

    /// Adds one block. True while there is more to come.
    #[inline(always)]
    fn render(&mut self, out: &mut Ears) -> bool {
        if self.delay >= BLOCK as u32 {
            self.delay -= BLOCK as u32;
            return true;
        }
        let begin = self.delay as usize;
        self.delay = 0;
        let mut envelope = (self.envelope >> 32) as i32;
        let grown = self.slope.saturating_mul(BLOCK as u64);
        let highest = self.pitch.saturating_add(grown).min(self.limit);
        let plain = envelope < ATTACK_END
            && self.fade == 0
            && (self.slope == 0 || (highest >> 32) as u32 <= EDGE_START);
        let ramping = (self.ramp >> 32).min((BLOCK - begin) as u64) as usize;
        let steady = begin + ramping;
        if ramping > 0 {
            let step = self.pitch + (self.slope >> 1);
            let pace = [self.pitch, step, self.slope];
            envelope = self.run(out, begin..steady, envelope, pace, plain);
            self.ramp -= (ramping as u64) << 32;
        }
        if steady < BLOCK && self.ramp > 0 {
            // The sample in which the ramp ends: ∫ = limit − slope·f²/2.
            let f = u128::from(self.ramp);
            let missing = ((u128::from(self.slope) * f * f) >> 65) as u64;
            let pitch = self.limit - ((u128::from(self.slope) * f) >> 32) as u64;
            let pace = [pitch, self.limit - missing, 0];
            self.ramp = 0;
            envelope = self.run(out, steady..steady + 1, envelope, pace, plain);
            self.pitch = self.limit;
            let pace = [self.limit, self.limit, 0];
            envelope = self.run(out, steady + 1..BLOCK, envelope, pace, plain);
        } else {
            let pace = [self.pitch, self.pitch, 0];
            envelope = self.run(out, steady..BLOCK, envelope, pace, plain);
        }
        let whole = begin == 0;
        if whole {
            let low = ((self.envelope & 0xffff_ffff) * u64::from(self.keep)) >> 32;
            self.envelope = (self.envelope >> 32) * u64::from(self.keep) + low;
        } else {
            self.envelope = (envelope.max(0) as u64) << 32;
        }
        // Past the fade at the edge of the band, or faded out, or too soft.
        let edge = self.slope != 0 && self.ramp == 0 && (self.pitch >> 32) as u32 >= EDGE_END;
        self.fade != 1 && !edge && (self.envelope >> 32) as u32 > self.floor
    }

    /// Runs over the frames of `span`. `pace` is the pitch at the first one, the mean over the sample to come and its
    /// growth from sample to sample. Returns the envelope after it.
    #[inline(always)]
    fn run(
        &mut self,
        out: &mut Ears,
        span: Range<usize>,
        envelope: i32,
        [pitch, step, slope]: [u64; 3],
        plain: bool,
    ) -> i32 {
        let n = span.len() as u64;
        let mut run = Run {
            phase: (self.phase >> 32) as u32,
            step: (step >> 32) as u32,
            slope: (slope >> 32) as u32,
            ahead: ((step - pitch) >> 32) as u32,
            envelope,
        };
        let [left, right] = out;
        let ears = [&mut left[span.clone()], &mut right[span]];
        if plain {
            self.steady(&mut run, ears);
        } else {
            self.shaped(&mut run, ears);
        }
        let triangle = slope.wrapping_mul(n * n.saturating_sub(1) / 2);
        self.phase = self
            .phase
            .wrapping_add(step.wrapping_mul(n))
            .wrapping_add(triangle);
        self.pitch = pitch.wrapping_add(slope.wrapping_mul(n));
        run.envelope
    }

    /// The plain life of a voice: sine, envelope, two ears.
    #[inline(always)]
    fn steady(&self, run: &mut Run, [left, right]: [&mut [i32]; 2]) {
        let whole = (
            <&mut [i32; BLOCK]>::try_from(&mut *left),
            <&mut [i32; BLOCK]>::try_from(&mut *right),
        );
        if let (Ok(left), Ok(right)) = whole {
            // The length known, a compiler unrolls.
            self.sing(run, left, right);
        } else {
            self.sing(run, left, right);
        }
    }

    #[inline(always)]
    fn sing(&self, run: &mut Run, left: &mut [i32], right: &mut [i32]) {
        for (left, right) in left.iter_mut().zip(right) {
            let swing = mul_high_down(sine(run.phase), run.envelope);
            *left = left.wrapping_add(mul_high(swing, self.gain[0]));
            *right = right.wrapping_add(mul_high(swing, self.gain[1]));
            run.advance(self.loss);
        }
    }

    /// The same under soft attack, the fade at the edge of the band, and the fade of a stolen voice.
    #[inline(never)]
    fn shaped(&mut self, run: &mut Run, [left, right]: [&mut [i32]; 2]) {
        let edged = self.slope != 0;
        for (left, right) in left.iter_mut().zip(right) {
            let mut shape = run.envelope;
            if shape >= ATTACK_END {
                shape = mul_high(shape, soft_attack(shape)) << 1;
            }
            let pitch = run.step - run.ahead;
            if edged && pitch > EDGE_START {
                let left = EDGE_END.saturating_sub(pitch);
                let part = (u64::from(left) << 31) / u64::from(EDGE_END - EDGE_START);
                shape = mul_high(shape, part.min(0x7fff_ffff) as i32) << 1;
            }
            if self.fade > 0 {
                shape = mul_high(shape, smooth_step(self.fade)) << 1;
                self.fade = (self.fade - 1).max(1);
            }
            let swing = mul_high_down(sine(run.phase), shape);
            *left = left.wrapping_add(mul_high(swing, self.gain[0]));
            *right = right.wrapping_add(mul_high(swing, self.gain[1]));
            run.advance(self.loss);
        }
    }
}

impl Run {
    #[inline(always)]
    fn advance(&mut self, loss: i32) {
        self.phase = self.phase.wrapping_add(self.step);
        self.step = self.step.wrapping_add(self.slope);
        self.envelope = self.envelope - mul_high_down(self.envelope, loss);
    }
}

/// `e^-x` for `x` from 0 to 0.2, both Q31, within 3e-6; the attack is steep, and an error here is ten there.
fn exp_neg(x: i64) -> u64 {
    const ONE: i64 = 1 << 31;
    let cubic = ONE - x / 4;
    let square = ONE - ((x * cubic) >> 31) / 3;
    let line = ONE - ((x * square) >> 31) / 2;
    (ONE - ((x * line) >> 31)).min(ONE - 1) as u64
}

/// HF (39) at the envelope `e` (Q31, from 0.85 to 1), Q31.
fn soft_attack(e: i32) -> i32 {
    // 512 steps over 0.15, Q32.
    const STEPS: u64 = (512 << 48) / (i32::MAX - ATTACK_END + 1) as u64;
    let at = ((e - ATTACK_END) as u64 * STEPS) >> 16;
    let i = (at >> 32) as usize;
    let (a, b) = (ATTACK[i], ATTACK[(i + 1).min(512)]);
    a - ((i64::from(a - b) * i64::from(at as u32 >> 1)) >> 31) as i32
}

/// From 1 to 0 with no corner as `left` falls from [`STEAL_FADE`] to 1, Q31.
fn smooth_step(left: u32) -> i32 {
    let x = (u64::from(left - 1) << 16) / u64::from(STEAL_FADE - 1);
    // x²(3 − 2x), Q48 → Q31.
    (((x * x * ((3 << 16) - 2 * x)) >> 17) as u32).min(0x7fff_ffff) as i32
}

/// What became of a bubble that asked for a voice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// It sounds.
    Sounds,
    /// It sounds, in the place of the least audible voice.
    Stole,
    /// Every voice is louder, or there were too many thefts in this block.
    Refused,
}

/// The least audible voices, softest first, found while rendering the last block.
#[derive(Clone, Copy, Debug, Default)]
struct Weakest {
    found: [(u32, u32); STEALS],
    count: usize,
}

impl Weakest {
    /// Keeps `level` of voice `index` if it is among the softest.
    #[inline(always)]
    fn offer(&mut self, level: u32, index: u32) {
        if self.count == STEALS && level >= self.found[STEALS - 1].0 {
            return;
        }
        if self.count < STEALS {
            self.count += 1;
        }
        let mut i = self.count - 1;
        while i > 0 && self.found[i - 1].0 > level {
            self.found[i] = self.found[i - 1];
            i -= 1;
        }
        self.found[i] = (level, index);
    }
}

/// All voices. `S` holds the slots; three quarters of them sound, the rest are for stolen voices that fade.
#[derive(Clone, Debug)]
pub struct Voices<S> {
    slots: S,
    /// Slots in use; they come first.
    count: usize,
    /// Of these, how many fade.
    fading: usize,
    weakest: Weakest,
    /// Thefts in this block.
    next_weakest: usize,
    /// Sum of the amplitudes, Q28 of a pascal.
    loudness: u64,
}

impl<S: AsRef<[Voice]> + AsMut<[Voice]>> Voices<S> {
    /// No voice sounding.
    pub fn new(slots: S) -> Self {
        Self {
            slots,
            count: 0,
            fading: 0,
            weakest: Weakest::default(),
            next_weakest: 0,
            loudness: 0,
        }
    }

    /// Voices that may sound at once, stolen ones apart.
    pub fn capacity(&self) -> usize {
        let slots = self.slots.as_ref().len();
        slots - slots / 4
    }

    /// Voices sounding now, stolen ones included.
    pub fn sounding(&self) -> usize {
        self.count
    }

    /// Takes a bubble in, if need be in the place of the least audible one.
    #[inline]
    pub fn start(&mut self, mut voice: Voice) -> Start {
        let level = voice.level();
        if self.loudness + u64::from(level) > LOUDNESS_MAX {
            return Start::Refused;
        }
        let (capacity, total) = (self.capacity(), self.slots.as_ref().len());
        let mut outcome = Start::Sounds;
        if self.count - self.fading >= capacity {
            if self.count >= total || self.next_weakest >= self.weakest.count {
                return Start::Refused;
            }
            let (weak, index) = self.weakest.found[self.next_weakest];
            if weak >= level {
                return Start::Refused;
            }
            self.next_weakest += 1;
            self.slots.as_mut()[index as usize].fade = STEAL_FADE;
            self.fading += 1;
            outcome = Start::Stole;
        }
        voice.fade = 0;
        self.loudness += u64::from(level);
        self.slots.as_mut()[self.count] = voice;
        self.count += 1;
        outcome
    }

    /// Adds one block of every voice.
    pub fn render(&mut self, out: &mut Ears) {
        let slots = self.slots.as_mut();
        let mut weakest = Weakest::default();
        let mut loudness = 0;
        let mut fading = 0;
        let mut i = 0;
        while i < self.count {
            let voice = &mut slots[i];
            if voice.render(out) {
                let level = voice.level();
                loudness += u64::from(level);
                if voice.fade > 0 {
                    fading += 1;
                } else if voice.delay == 0 {
                    weakest.offer(level, i as u32);
                }
                i += 1;
            } else {
                self.count -= 1;
                slots[i] = slots[self.count];
            }
        }
        self.fading = fading;
        self.weakest = weakest;
        self.next_weakest = 0;
        self.loudness = loudness;
    }
}
