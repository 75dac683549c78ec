//! One radius class: a stereo pair of damped resonators that ring for every bubble of the class.
//!
//! Below about 0.08 of the sample rate a *circle* form, `v -= g·y + b·v; y += g·v`, whose two small coefficients keep
//! pitch and decay to 1e-7 where a two-pole would lose them; above it a *direct* two-pole. State words are Q32.32 of
//! bus units, so that a long tail loses nothing to rounding.

use crate::bubble::Bubble;
use crate::fixed::to_fixed;
use crate::frame::Frame;

/// Above this part of the sample rate a bubble is not sounded.
pub const PITCH_LIMIT: f64 = 0.45;

/// Largest state word after a birth, bus units: whatever the phase, the next swing stays inside an i32.
const CIRCLE_LIMIT: i64 = 1 << (29 + 32);
const DIRECT_LIMIT: i64 = 1 << (28 + 32);

/// Which recurrence a class runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Too high to be sounded.
    Silent,
    /// `v -= g·y + b·v; y += g·v`.
    Circle,
    /// `y' = a1·y + a2·y1`.
    Direct,
}

/// What a resonator is tuned to. Made in f64 when a radius or the sample rate changes.
#[derive(Clone, Copy, Debug)]
pub struct Tuning {
    /// The recurrence.
    pub form: Form,
    /// Radius of the class, m.
    pub radius: f32,
    /// Circle: −g, Q32. Direct: a1, Q30.
    c0: i32,
    /// Circle: −b, Q32. Direct: a2, Q30.
    c1: i32,
    /// The second state word of a bubble of phase φ is `second[0]·sin φ + second[1]·cos φ`, Q30.
    second: [i32; 2],
    /// Turns a sample, Q32.
    step: u32,
    /// Decay in powers of two a sample, Q31.
    decay: u32,
    /// Below this, in both words of both ears, the resonator is silent; bus units.
    floor: i32,
}

/// A complex number, for the few lines of tuning that want one.
#[derive(Clone, Copy)]
pub(crate) struct Complex {
    pub re: f64,
    pub im: f64,
}

impl Complex {
    pub fn mul(self, o: Self) -> Self {
        Self {
            re: self.re * o.re - self.im * o.im,
            im: self.re * o.im + self.im * o.re,
        }
    }
    pub fn div(self, o: Self) -> Self {
        let n = o.re * o.re + o.im * o.im;
        Self {
            re: (self.re * o.re + self.im * o.im) / n,
            im: (self.im * o.re - self.re * o.im) / n,
        }
    }
}

impl Tuning {
    /// A class that makes no sound.
    pub const SILENT: Self = Self {
        form: Form::Silent,
        radius: 0.0,
        c0: 0,
        c1: 0,
        second: [0; 2],
        step: 0,
        decay: 0,
        floor: 0,
    };

    /// The resonator of a bubble of `radius` metres at `rate` Hz.
    pub fn new(radius: f32, rate: f64) -> Self {
        let bubble = Bubble::new(f64::from(radius));
        let theta = bubble.omega_d() / rate;
        let beta = bubble.beta / rate;
        let turns = theta / (2.0 * core::f64::consts::PI);
        if turns > PITCH_LIMIT {
            return Self {
                radius,
                ..Self::SILENT
            };
        }
        let rho = libm::exp(-beta);
        let z = Complex {
            re: rho * libm::cos(theta),
            im: rho * libm::sin(theta),
        };
        let det = rho * rho;
        // |1 − z|, the circle's coupling.
        let g = libm::sqrt(1.0 + det - 2.0 * z.re);
        let (form, c0, c1, second, floor) = if g < 0.49 {
            let second = Complex {
                re: (z.re - 1.0 + g * g) / (g * det),
                im: z.im / (g * det),
            };
            let c0 = to_fixed(-g, 32);
            (Form::Circle, c0, to_fixed(det - 1.0, 32), second, 16)
        } else {
            let second = Complex { re: 1.0, im: 0.0 }.div(z);
            // Truncation sustains a cycle of at most 1/(1 − ρ²) units.
            let floor = 4 + (1.0 / (1.0 - det)) as i32;
            let c0 = to_fixed(2.0 * z.re, 30);
            (Form::Direct, c0, to_fixed(-det, 30), second, floor)
        };
        Self {
            form,
            radius,
            c0,
            c1,
            second: [to_fixed(second.re, 30), to_fixed(second.im, 30)],
            step: to_fixed(turns, 32) as u32,
            decay: to_fixed(beta * core::f64::consts::LOG2_E, 31) as u32,
            floor,
        }
    }

    /// The decay over a fraction of a sample (Q27) in powers of two, Q20.
    #[inline(always)]
    pub fn decay_over(&self, fraction: u32) -> u32 {
        ((u64::from(self.decay) * u64::from(fraction)) >> 38) as u32
    }

    /// The phase passed in a fraction of a sample (Q27), 2^32 to the turn.
    #[inline(always)]
    pub fn phase_over(&self, fraction: u32) -> u32 {
        ((u64::from(self.step) * u64::from(fraction)) >> 27) as u32
    }

    /// Both state words, Q31 and Q30, of a bubble of amplitude 1 whose sine and cosine are given.
    #[inline(always)]
    pub fn words(&self, (sine, cosine): (i32, i32)) -> (i32, i32) {
        let second = i64::from(self.second[0]) * i64::from(sine)
            + i64::from(self.second[1]) * i64::from(cosine);
        (sine, (second >> 31) as i32)
    }

    /// The same class, ringing out at least as fast as `extra` 1/sample: what a retired bank does.
    pub fn hurried(mut self, extra: f64) -> Self {
        if self.form == Form::Circle {
            self.c1 -= to_fixed(2.0 * extra, 32);
        }
        self
    }

    /// The factors of the second word: of the sine and of the cosine.
    pub fn second_word(&self) -> [f64; 2] {
        self.second.map(|factor| f64::from(factor) * libm::exp2(-30.0))
    }

    /// ln of the pole and the factor of the second word, for the moments of a crowd.
    pub(crate) fn pole(&self, rate: f64) -> (Complex, Complex) {
        let bubble = Bubble::new(f64::from(self.radius));
        let log = Complex {
            re: -bubble.beta / rate,
            im: bubble.omega_d() / rate,
        };
        let [re, im] = self.second_word();
        (log, Complex { re, im })
    }
}

/// The pair's state: two words an ear, Q32.32 of bus units.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    left: [i64; 2],
    right: [i64; 2],
}

impl State {
    /// At rest.
    pub const SILENT: Self = Self {
        left: [0; 2],
        right: [0; 2],
    };

    /// Adds a bubble of `left` and `right` (Q27 of a pascal) whose words are given. True where a word had to be held
    /// at its limit.
    #[inline(always)]
    pub fn strike(&mut self, tuning: &Tuning, left: i32, right: i32, words: (i32, i32)) -> bool {
        let (first, second) = (i64::from(words.0), i64::from(words.1));
        let (l, r) = (i64::from(left), i64::from(right));
        // Q27·Q31 is Q58, which is Q32.32 of a bus unit of 2^-26.
        self.add(
            tuning,
            [l * first, (l * second) << 1],
            [r * first, (r * second) << 1],
        )
    }

    /// Adds to all four words. True where one had to be held at its limit.
    #[inline(always)]
    pub fn add(&mut self, tuning: &Tuning, left: [i64; 2], right: [i64; 2]) -> bool {
        let limit = match tuning.form {
            Form::Circle => CIRCLE_LIMIT,
            Form::Direct | Form::Silent => DIRECT_LIMIT,
        };
        let mut held = false;
        let words = self.left.iter_mut().chain(self.right.iter_mut());
        for (word, add) in words.zip(left.into_iter().chain(right)) {
            let sum = word.wrapping_add(add);
            *word = sum.clamp(-limit, limit);
            held |= *word != sum;
        }
        held
    }

    /// Runs the pair over `out`, adding.
    #[inline(always)]
    pub fn run(&mut self, tuning: &Tuning, out: &mut [Frame]) {
        match tuning.form {
            Form::Silent => {}
            Form::Circle => self.circle(tuning, out),
            Form::Direct => self.direct(tuning, out),
        }
    }

    #[inline(always)]
    fn circle(&mut self, tuning: &Tuning, out: &mut [Frame]) {
        let (g, b) = (i64::from(tuning.c0), i64::from(tuning.c1));
        let [mut ly, mut lv] = self.left;
        let [mut ry, mut rv] = self.right;
        for frame in out {
            lv = lv.wrapping_add(b * (lv >> 32)).wrapping_add(g * (ly >> 32));
            rv = rv.wrapping_add(b * (rv >> 32)).wrapping_add(g * (ry >> 32));
            ly = ly.wrapping_sub(g * (lv >> 32));
            ry = ry.wrapping_sub(g * (rv >> 32));
            frame.left = frame.left.saturating_add((ly >> 32) as i32);
            frame.right = frame.right.saturating_add((ry >> 32) as i32);
        }
        self.left = [ly, lv];
        self.right = [ry, rv];
    }

    #[inline(always)]
    fn direct(&mut self, tuning: &Tuning, out: &mut [Frame]) {
        let (a1, a2) = (i64::from(tuning.c0), i64::from(tuning.c1));
        let [mut l, mut l1] = self.left.map(|word| word >> 32);
        let [mut r, mut r1] = self.right.map(|word| word >> 32);
        for frame in out {
            (l, l1) = (i64::from(((a1 * l + a2 * l1) >> 30) as i32), l);
            (r, r1) = (i64::from(((a1 * r + a2 * r1) >> 30) as i32), r);
            frame.left = frame.left.saturating_add(l as i32);
            frame.right = frame.right.saturating_add(r as i32);
        }
        self.left = [l << 32, l1 << 32];
        self.right = [r << 32, r1 << 32];
    }

    /// Whether nothing is left to hear; then the state is zero, for good.
    #[inline(always)]
    pub fn settle(&mut self, tuning: &Tuning) -> bool {
        let floor = i64::from(tuning.floor) << 32;
        let quiet = |word: &i64| -floor <= *word && *word <= floor;
        let quiet = self.left.iter().all(quiet) && self.right.iter().all(quiet);
        if quiet {
            *self = Self::default();
        }
        quiet
    }
}
