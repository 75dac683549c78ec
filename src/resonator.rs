//! One radius class: a stereo pair of damped resonators that ring for every bubble of the class.
//!
//! Below about 0.08 of the sample rate a *circle* form, `v -= g·y + b·v; y += g·v`, whose two small coefficients keep
//! pitch and decay to 1e-7 where a two-pole would lose them; above it a *direct* two-pole. State words are Q32.32 of
//! bus units, so that a long tail loses nothing to rounding.

use crate::bubble::Ringing;
use crate::fixed::{high, to_fixed};
use crate::frame::{BLOCK, Block, Frame};

/// Above this part of the sample rate a bubble is not sounded.
pub const PITCH_LIMIT: f64 = 0.45;

/// Most pressure that one class may be struck with in a block, Q27 of a pascal: 4 Pa before the pan. With classes that
/// swing no further than [`SWING_MAX`] together, every word stays inside an i32, whatever its phase.
pub const STRIKES_MAX: u32 = 4 << 27;
/// Largest swing of all classes together at the end of a block, bus units: 16 Pa.
pub const SWING_MAX: u64 = 16 << 26;

/// Which recurrence a class runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Form {
    /// Too high to be sounded.
    Silent,
    /// `v -= g·y + b·v; y += g·v`.
    Circle,
    /// `y' = a1·y + a2·y1`.
    Direct,
}

impl Form {
    /// What one bubble adds to the words: sums of it are what one strike after the other comes to.
    #[inline(always)]
    pub fn strike(self, impulse: Impulse) -> StrikeWords {
        let words = StrikeWords::from(impulse);
        if self != Self::Direct {
            return words;
        }
        // The direct form's words are whole.
        let whole = |words: [i64; 2]| words.map(|word| word >> 32 << 32);
        StrikeWords {
            left: whole(words.left),
            right: whole(words.right),
        }
    }
}

/// What a resonator is tuned to. Made in f64 when a radius or the sample rate changes. The assembly knows where its words
/// are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Tuning {
    /// The recurrence.
    pub form: Form,
    /// Radius of the class, m.
    pub radius: f32,
    /// Circle: −g and −b, Q32. Direct: a1 and a2, Q30.
    pub(crate) coefficients: [i32; 2],
    /// The second state word of a bubble of phase φ is `second[0]·sin φ + second[1]·cos φ`, Q30.
    second: [i32; 2],
    /// Turns a sample, Q32.
    step: u32,
    /// Decay in powers of two a sample, Q31.
    decay: u32,
    /// Below this, in both words of both ears, the resonator is silent; bus units.
    pub(crate) floor: i32,
    /// How far the words may swing beyond their size now, in eighths.
    pub(crate) swing: u32,
}

/// A complex number, for the few lines of tuning that want one.
#[derive(Clone, Copy)]
struct Complex {
    re: f64,
    im: f64,
}

impl Complex {
    fn div(self, o: Self) -> Self {
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
        coefficients: [0; 2],
        second: [0; 2],
        step: 0,
        decay: 0,
        floor: 0,
        swing: 0,
    };

    /// The resonator of a bubble of `radius` metres at `rate` Hz.
    pub fn new(radius: f32, rate: f64) -> Self {
        Self::of(&Ringing::new(radius, rate))
    }

    /// The resonator of a bubble.
    pub fn of(ringing: &Ringing) -> Self {
        let radius = ringing.radius;
        if ringing.turns > PITCH_LIMIT {
            return Self {
                radius,
                ..Self::SILENT
            };
        }
        let rho = 1.0 - ringing.loss;
        let (sine, cosine) = libm::sincos(ringing.angle);
        let z = Complex {
            re: rho * cosine,
            im: rho * sine,
        };
        let det = rho * rho;
        // |1 − z|, the circle's coupling.
        let g = libm::sqrt(1.0 + det - 2.0 * z.re);
        let (form, coefficients, second, floor, swing) = if g < 0.49 {
            let second = Complex {
                re: (z.re - 1.0 + g * g) / (g * det),
                im: z.im / (g * det),
            };
            let coefficients = [-g, det - 1.0].map(|c| to_fixed(c, 32));
            (Form::Circle, coefficients, second, 16, 2.0)
        } else {
            let second = Complex { re: 1.0, im: 0.0 }.div(z);
            // Truncation sustains a cycle of at most 1/(1 − ρ²) units.
            let floor = 4 + (1.0 / (1.0 - det)) as i32;
            let coefficients = [2.0 * z.re, -det].map(|c| to_fixed(c, 30));
            // Sine and cosine of half the angle.
            let swing = 1.0 / libm::sqrt((1.0 - cosine.abs()) / 2.0);
            (Form::Direct, coefficients, second, floor, swing)
        };
        Self {
            form,
            radius,
            coefficients,
            second: [to_fixed(second.re, 30), to_fixed(second.im, 30)],
            step: to_fixed(ringing.turns, 32) as u32,
            decay: to_fixed(ringing.decay * core::f64::consts::LOG2_E, 31) as u32,
            floor,
            swing: libm::ceil(8.0 * swing) as u32,
        }
    }

    /// The recurrence's two coefficients; their meaning is the form's.
    pub fn coefficients(&self) -> &[i32; 2] {
        &self.coefficients
    }

    /// The decay over a part of a sample (Q32) in powers of two, Q20.
    #[inline(always)]
    pub fn decay_over(&self, part: u32) -> u32 {
        high(self.decay, part) >> 11
    }

    /// Decay in powers of two a sample, Q31, and turns a sample, Q32.
    pub fn pace(&self) -> (u32, u32) {
        (self.decay, self.step)
    }

    /// The factors of the second word, Q30.
    pub fn second(&self) -> [i32; 2] {
        self.second
    }

    /// Both state words, Q30, of a bubble of amplitude 1 whose sine and cosine (Q30) are given.
    #[inline(always)]
    pub fn words(&self, (sine, cosine): (i32, i32)) -> (i32, i32) {
        let second = i64::from(self.second[0]) * i64::from(sine)
            + i64::from(self.second[1]) * i64::from(cosine);
        (sine, (second >> 30) as i32)
    }

    /// The same class, decaying faster: what a retired bank does. `hurry` is twice the further decay a sample, Q32.
    #[inline(always)]
    pub fn hurried(mut self, hurry: i32) -> Self {
        if self.form == Form::Circle {
            self.coefficients[1] -= hurry;
        }
        self
    }

    /// The factors of the second word: of the sine and of the cosine.
    pub fn second_word(&self) -> [f64; 2] {
        self.second
            .map(|factor| f64::from(factor) * libm::exp2(-30.0))
    }

    /// How far words that are so far out may swing, bus units.
    #[inline(always)]
    pub fn swing(&self, extent: u32) -> u64 {
        u64::from((extent >> 3) + 1) * u64::from(self.swing)
    }
}

/// The pair's state: two words an ear, Q32.32 of bus units.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct State {
    left: [i64; 2],
    right: [i64; 2],
}

/// A class's resonator. The assembly knows where its words are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Resonator {
    /// Its words.
    pub state: State,
    /// How far they were out at the end of the last block, see [`State::extent`]; 0 at rest.
    pub extent: u32,
}

impl Resonator {
    /// At rest.
    pub const SILENT: Self = Self {
        state: State::SILENT,
        extent: 0,
    };

    /// Whether it rings.
    #[inline(always)]
    pub fn rings(&self) -> bool {
        self.extent > 0
    }

    /// Ends a block with words that are so far out: how far it may swing from here, bus units; 0 where it does not ring.
    #[inline(always)]
    pub fn settle(&mut self, tuning: &Tuning, extent: u32) -> u64 {
        if extent <= tuning.floor as u32 {
            *self = Self::SILENT;
            return 0;
        }
        self.extent = extent;
        tuning.swing(extent)
    }
}

/// One bubble's strike.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Impulse {
    /// Pressure in the right ear, Q28 of a pascal.
    pub right: i32,
    /// In the left one.
    pub left: i32,
    /// Both words of a bubble of amplitude 1, Q30.
    pub first: i32,
    /// The second one.
    pub second: i32,
}

impl Impulse {
    /// No bubble.
    pub const NONE: Self = Self {
        right: 0,
        left: 0,
        first: 0,
        second: 0,
    };
}

/// What is added to the four words after one sample, Q32.32 of bus units.
#[derive(Clone, Copy, Debug, Default)]
pub struct StrikeWords {
    /// Left ear.
    pub left: [i64; 2],
    /// Right ear.
    pub right: [i64; 2],
}

/// The strikes of a block, sample by sample.
pub type Strikes = [StrikeWords; BLOCK];

/// Both words of one ear.
#[inline(always)]
fn add_words(mine: &mut [i64; 2], theirs: [i64; 2]) {
    mine[0] += theirs[0];
    mine[1] += theirs[1];
}

impl From<Impulse> for StrikeWords {
    #[inline(always)]
    fn from(impulse: Impulse) -> Self {
        let words = [impulse.first, impulse.second].map(i64::from);
        // Q28·Q30 is Q58, which is Q32.32 of a bus unit of 2^-26.
        let [left, right] = [impulse.left, impulse.right].map(i64::from);
        Self {
            left: words.map(|word| left * word),
            right: words.map(|word| right * word),
        }
    }
}

impl StrikeWords {
    /// Both together.
    #[inline(always)]
    pub fn add(&mut self, other: Self) {
        add_words(&mut self.left, other.left);
        add_words(&mut self.right, other.right);
    }
}

impl State {
    /// At rest.
    pub const SILENT: Self = Self {
        left: [0; 2],
        right: [0; 2],
    };

    /// Adds a strike.
    #[inline(always)]
    pub fn strike(&mut self, strike: StrikeWords) {
        add_words(&mut self.left, strike.left);
        add_words(&mut self.right, strike.right);
    }

    /// Runs the pair over `out`, adding.
    #[inline(always)]
    pub fn run(&mut self, tuning: &Tuning, out: &mut [Frame]) {
        match tuning.form {
            Form::Silent => {}
            Form::Circle => {
                let mut run = Circle::begin(tuning, self);
                out.iter_mut().for_each(|frame| run.step(frame));
                *self = run.end();
            }
            Form::Direct => {
                let mut run = Direct::begin(tuning, self);
                out.iter_mut().for_each(|frame| run.step(frame));
                *self = run.end();
            }
        }
    }

    /// How far the words are out: at least the largest magnitude, and less than twice that; bus units.
    #[inline(always)]
    pub fn extent(&self) -> u32 {
        let bits = |word: i64| {
            let word = (word >> 32) as i32;
            (word ^ (word >> 31)) as u32
        };
        let ear = |words: [i64; 2]| bits(words[0]) | bits(words[1]);
        ear(self.left) | ear(self.right)
    }

    /// How far the largest word is out, bus units.
    pub fn loudest(&self) -> u32 {
        let words = self.left.iter().chain(&self.right);
        words
            .map(|word| ((word >> 32) as i32).unsigned_abs())
            .fold(0, u32::max)
    }

    /// Half as loud.
    pub fn halve(&mut self) {
        for word in self.left.iter_mut().chain(self.right.iter_mut()) {
            *word >>= 1;
        }
    }
}

/// A resonator in registers.
trait Recurrence {
    fn begin(tuning: &Tuning, state: &State) -> Self;
    /// Runs one sample and adds it.
    fn step(&mut self, frame: &mut Frame);
    fn strike(&mut self, strike: &StrikeWords);
    fn end(self) -> State;
}

struct Circle {
    g: i64,
    b: i64,
    left: [i64; 2],
    right: [i64; 2],
}

impl Recurrence for Circle {
    #[inline(always)]
    fn begin(tuning: &Tuning, state: &State) -> Self {
        Self {
            g: i64::from(tuning.coefficients[0]),
            b: i64::from(tuning.coefficients[1]),
            left: state.left,
            right: state.right,
        }
    }
    #[inline(always)]
    fn step(&mut self, frame: &mut Frame) {
        let (g, b) = (self.g, self.b);
        let turn = |[y, v]: &mut [i64; 2]| {
            *v += b * (*v >> 32) + g * (*y >> 32);
            *y -= g * (*v >> 32);
            (*y >> 32) as i32
        };
        frame.left = frame.left.wrapping_add(turn(&mut self.left));
        frame.right = frame.right.wrapping_add(turn(&mut self.right));
    }
    #[inline(always)]
    fn strike(&mut self, strike: &StrikeWords) {
        add_words(&mut self.left, strike.left);
        add_words(&mut self.right, strike.right);
    }
    #[inline(always)]
    fn end(self) -> State {
        State {
            left: self.left,
            right: self.right,
        }
    }
}

struct Direct {
    a1: i64,
    a2: i64,
    left: [i64; 2],
    right: [i64; 2],
}

impl Recurrence for Direct {
    #[inline(always)]
    fn begin(tuning: &Tuning, state: &State) -> Self {
        Self {
            a1: i64::from(tuning.coefficients[0]),
            a2: i64::from(tuning.coefficients[1]),
            left: state.left.map(|word| word >> 32),
            right: state.right.map(|word| word >> 32),
        }
    }
    #[inline(always)]
    fn step(&mut self, frame: &mut Frame) {
        let (a1, a2) = (self.a1, self.a2);
        let turn = |words: &mut [i64; 2]| {
            let y = ((a1 * words[0] + a2 * words[1]) >> 30) as i32;
            *words = [i64::from(y), words[0]];
            y
        };
        frame.left = frame.left.wrapping_add(turn(&mut self.left));
        frame.right = frame.right.wrapping_add(turn(&mut self.right));
    }
    #[inline(always)]
    fn strike(&mut self, strike: &StrikeWords) {
        add_words(&mut self.left, strike.left.map(|word| word >> 32));
        add_words(&mut self.right, strike.right.map(|word| word >> 32));
    }
    #[inline(always)]
    fn end(self) -> State {
        State {
            left: self.left.map(|word| word << 32),
            right: self.right.map(|word| word << 32),
        }
    }
}

/// Runs two resonators of one form in step over a block, each struck after each sample: a desktop's core overlaps
/// their chains of multiplications. The samples are those of running one after the other.
#[inline(always)]
pub fn run_two_struck(
    tuning: [&Tuning; 2],
    state: [&mut State; 2],
    strikes: &[Strikes; 2],
    out: &mut Block,
) {
    match tuning[0].form {
        Form::Silent => {}
        Form::Circle => two_struck::<Circle>(tuning, state, strikes, out),
        Form::Direct => two_struck::<Direct>(tuning, state, strikes, out),
    }
}

#[inline(always)]
fn two_struck<R: Recurrence>(
    tuning: [&Tuning; 2],
    [one, two]: [&mut State; 2],
    strikes: &[Strikes; 2],
    out: &mut Block,
) {
    let mut a = R::begin(tuning[0], one);
    let mut b = R::begin(tuning[1], two);
    for (i, frame) in out.iter_mut().enumerate() {
        a.step(frame);
        b.step(frame);
        a.strike(&strikes[0][i]);
        b.strike(&strikes[1][i]);
    }
    (*one, *two) = (a.end(), b.end());
}

/// Runs one resonator over a block, struck after each sample.
#[inline(always)]
pub fn run_struck(tuning: &Tuning, state: &mut State, strikes: &Strikes, out: &mut Block) {
    match tuning.form {
        Form::Silent => {}
        Form::Circle => one_struck::<Circle>(tuning, state, strikes, out),
        Form::Direct => one_struck::<Direct>(tuning, state, strikes, out),
    }
}

#[inline(always)]
fn one_struck<R: Recurrence>(
    tuning: &Tuning,
    state: &mut State,
    strikes: &Strikes,
    out: &mut Block,
) {
    let mut run = R::begin(tuning, state);
    for (frame, strike) in out.iter_mut().zip(strikes) {
        run.step(frame);
        run.strike(strike);
    }
    *state = run.end();
}
