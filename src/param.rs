//! The parameters: one constant table that scenes, commands and the board share.

/// How a slider moves between the ends of a range, and how a ramp moves between two values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve {
    /// In equal steps.
    Linear,
    /// In equal ratios. Where the range begins at 0, the lowest value above 0 is the one given.
    Log(f32),
}

/// What values a parameter takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Any number in the range.
    Real,
    /// Whole numbers in the range.
    Whole,
    /// One of these names; the value is its index.
    Choice(&'static [&'static str]),
}

/// One row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Param {
    /// Stable number; never given to another parameter.
    pub id: u16,
    /// Name in scenes and commands.
    pub path: &'static str,
    /// Unit, empty for plain numbers.
    pub unit: &'static str,
    /// Lowest value.
    pub min: f32,
    /// Highest value.
    pub max: f32,
    /// Value where a scene says nothing.
    pub default: f32,
    /// How it moves.
    pub curve: Curve,
    /// Time a change takes, s.
    pub ramp: f32,
    /// What values it takes.
    pub kind: Kind,
    /// What it does, in a line.
    pub about: &'static str,
}

impl Param {
    /// The value at `x` of the way from `from` to `to`, along the curve.
    pub fn between(&self, from: f32, to: f32, x: f32) -> f32 {
        if x >= 1.0 {
            return to;
        }
        if x <= 0.0 {
            return from;
        }
        let value = match self.curve {
            Curve::Linear => from + (to - from) * x,
            Curve::Log(least) => {
                let log = |v: f32| libm::logf(v.max(least));
                let value = libm::expf(log(from) + (log(to) - log(from)) * x);
                // Near an end at 0 the curve is cut, not raised.
                if value <= least * 1.000_01 {
                    0.0_f32.max(from.min(to))
                } else {
                    value
                }
            }
        };
        match self.kind {
            Kind::Real => value.clamp(self.min, self.max),
            Kind::Whole | Kind::Choice(_) => libm::roundf(value),
        }
    }

    /// Whether `value` may be set.
    pub fn accepts(&self, value: f32) -> bool {
        let whole = matches!(self.kind, Kind::Real) || libm::truncf(value) == value;
        self.min <= value && value <= self.max && whole
    }
}

/// The type's name for every path a weight of a class may have.
const WEIGHT_PATHS: [&str; 64] = weight_paths();

const fn weight_paths() -> [&'static str; 64] {
    macro_rules! paths {
        ($($n:literal)*) => { [$(concat!("water.weight.", $n)),*] };
    }
    paths!(
        1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64
    )
}

/// Number of parameters.
pub const COUNT: usize = NAMED.len() + 64;

/// The table. Indices are an implementation's; ids are for good.
pub static TABLE: [Param; COUNT] = table();

const fn table() -> [Param; COUNT] {
    let mut table = [weight(0); COUNT];
    let mut i = 0;
    while i < NAMED.len() {
        table[i] = NAMED[i];
        i += 1;
    }
    while i < COUNT {
        table[i] = weight(i - NAMED.len());
        i += 1;
    }
    table
}

const fn weight(k: usize) -> Param {
    Param {
        id: 201 + k as u16,
        path: WEIGHT_PATHS[k],
        unit: "",
        min: 0.0,
        max: 1.0,
        default: 1.0,
        curve: Curve::Linear,
        ramp: 0.1,
        kind: Kind::Real,
        about: "relative births of this radius class under water.law = custom; class 1 is the smallest",
    }
}

/// Indices in order of the paths.
static BY_PATH: [u8; COUNT] = by_path();

const fn by_path() -> [u8; COUNT] {
    let table = table();
    let mut order = [0; COUNT];
    let mut i = 0;
    while i < COUNT {
        // Insertion: what comes before `i` is in order.
        let mut j = i;
        while j > 0 && is_before(table[i].path, table[order[j - 1] as usize].path) {
            order[j] = order[j - 1];
            j -= 1;
        }
        order[j] = i as u8;
        i += 1;
    }
    order
}

const fn is_before(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut i = 0;
    while i < a.len() && i < b.len() {
        if a[i] != b[i] {
            return a[i] < b[i];
        }
        i += 1;
    }
    a.len() < b.len()
}

/// Changes where the table does: a program that knows one number knows every id, unit and range.
pub const SCHEMA: u32 = schema();

const fn schema() -> u32 {
    let table = table();
    let mut hash = 0x811c_9dc5;
    let mut i = 0;
    while i < COUNT {
        let param = &table[i];
        hash = fnv(hash, &param.id.to_le_bytes());
        hash = fnv(hash, param.path.as_bytes());
        hash = fnv(hash, param.unit.as_bytes());
        hash = fnv(hash, &param.min.to_le_bytes());
        hash = fnv(hash, &param.max.to_le_bytes());
        hash = fnv(hash, &param.default.to_le_bytes());
        if let Kind::Choice(names) = param.kind {
            let mut n = 0;
            while n < names.len() {
                hash = fnv(hash, names[n].as_bytes());
                n += 1;
            }
        }
        i += 1;
    }
    hash
}

/// FNV-1a.
const fn fnv(mut hash: u32, bytes: &[u8]) -> u32 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    hash
}

/// The parameter's index in [`TABLE`] by its path.
pub fn index_of(path: &str) -> Option<usize> {
    let place = BY_PATH.binary_search_by(|index| TABLE[usize::from(*index)].path.cmp(path));
    place.ok().map(|place| usize::from(BY_PATH[place]))
}

/// The parameter's index in [`TABLE`] by its id.
pub fn index_of_id(id: u16) -> Option<usize> {
    TABLE.iter().position(|param| param.id == id)
}

/// Index of the first class's weight.
pub const WEIGHT: usize = NAMED.len();

macro_rules! params {
    ($($name:ident: $id:literal $path:literal [$unit:literal] $min:literal .. $max:literal = $default:literal,
        $curve:expr, $ramp:literal s, $kind:expr, $about:literal;)*) => {
        params!(@index 0usize; $($name)*);
        const NAMED: &[Param] = &[$(Param {
            id: $id, path: $path, unit: $unit, min: $min, max: $max, default: $default,
            curve: $curve, ramp: $ramp, kind: $kind, about: $about,
        }),*];
    };
    (@index $n:expr; $name:ident $($rest:ident)*) => {
        #[doc = concat!("Index of the parameter `", stringify!($name), "`.")]
        pub const $name: usize = $n;
        params!(@index $n + 1usize; $($rest)*);
    };
    (@index $n:expr;) => {};
}

use Curve::{Linear, Log};
use Kind::{Choice, Real, Whole};

/// The values of `water.law`.
pub const LAWS: &[&str] = &["flat", "power", "custom"];
/// The values of `water.excitation`.
pub const EXCITATIONS: &[&str] = &["impact", "entrainment"];
/// The values of switches.
pub const SWITCH: &[&str] = &["off", "on"];

params! {
    INTENSITY: 1 "intensity" [""] 0.0..1.0 = 0.5, Linear, 0.5 s, Real,
        "how much of it: moves several parameters along the scene's curves";

    RATE: 101 "water.rate" ["1/s"] 0.0..1e6 = 1000.0, Log(0.1), 0.2 s, Real,
        "bubbles born a second";
    RADIUS_MIN: 102 "water.radius_min" ["mm"] 0.15..150.0 = 0.3, Log(0.15), 0.0 s, Real,
        "radius of the smallest class";
    RADIUS_MAX: 103 "water.radius_max" ["mm"] 0.15..150.0 = 10.0, Log(0.15), 0.0 s, Real,
        "radius of the largest class";
    CLASSES: 104 "water.classes" [""] 1.0..64.0 = 50.0, Linear, 0.0 s, Whole,
        "radius classes, evenly spaced by ratio";
    LAW: 105 "water.law" [""] 0.0..2.0 = 1.0, Linear, 0.0 s, Choice(LAWS),
        "how births spread over the classes: evenly, as 1/r^gamma, or by their weights";
    GAMMA: 106 "water.gamma" [""] 0.0..10.0 = 2.0, Linear, 0.2 s, Real,
        "exponent of the power law: 0 to 3 sounds like a stream, above 5 like rain";
    ALPHA: 107 "water.alpha" [""] 0.0..4.0 = 1.5, Linear, 0.2 s, Real,
        "growth of an impact's pressure with radius, r^alpha: low is near, high is far";
    BETA: 108 "water.beta" [""] 0.0..30.0 = 10.0, Linear, 0.2 s, Real,
        "depth factor D = rnd^beta: the higher, the more bubbles are soft";
    DEPTH: 109 "water.depth" [""] 0.0..1.0 = 1.0, Linear, 0.2 s, Real,
        "largest depth factor D";
    RISE_CUTOFF: 110 "water.rise_cutoff" [""] 0.0..1.0 = 0.9, Linear, 0.2 s, Real,
        "bubbles whose depth factor is above this rise in pitch";
    RISE_FACTOR: 111 "water.rise_factor" [""] 0.0..20.0 = 0.1, Log(0.001), 0.0 s, Real,
        "xi, the rise in pitch over the decay: 0.1 a drop, 10 a straw near the surface";
    EXCITATION: 112 "water.excitation" [""] 0.0..1.0 = 0.0, Linear, 0.0 s, Choice(EXCITATIONS),
        "what starts a bubble: an impact (pressure, alpha) or the surface tension at its birth (0.145 Pa)";
    PRESSURE: 113 "water.pressure" ["Pa"] 0.0..8.0 = 0.05, Log(0.0001), 0.2 s, Real,
        "pressure at 1 m of an impact's bubble of 1 mm and depth factor 1";

    SWELL_DEPTH: 301 "swell.depth" [""] 0.0..1.0 = 0.0, Linear, 0.5 s, Real,
        "how far the birth rate falls between waves";
    SWELL_PERIOD: 302 "swell.period" ["s"] 0.2..120.0 = 8.0, Log(0.2), 0.0 s, Real,
        "mean time from wave to wave";
    SWELL_IRREGULARITY: 303 "swell.irregularity" [""] 0.0..1.0 = 0.5, Linear, 0.0 s, Real,
        "how much waves differ in length and height";
    SWELL_ATTACK: 304 "swell.attack" [""] 0.05..0.95 = 0.3, Linear, 0.0 s, Real,
        "part of a wave in which it grows";
    SWELL_FIZZ: 305 "swell.fizz" [""] 0.0..5.0 = 0.0, Linear, 0.5 s, Real,
        "added to water.gamma between waves: only small bubbles stay";

    DROPS_RATE: 401 "drops.rate" ["1/s"] 0.0..50.0 = 0.0, Log(0.01), 0.2 s, Real,
        "drops that fall a second";
    DROPS_REGULARITY: 402 "drops.regularity" [""] 0.0..1.0 = 0.0, Linear, 0.0 s, Real,
        "0: at any time; 1: like a tap, evenly but for 3 %";
    DROPS_RADIUS: 403 "drops.radius" ["mm"] 0.3..20.0 = 2.5, Log(0.3), 0.2 s, Real,
        "usual radius of a drop's main bubble";
    DROPS_SPREAD: 404 "drops.spread" [""] 0.0..1.0 = 0.3, Linear, 0.2 s, Real,
        "how much drops differ in radius (deviation of its logarithm)";
    DROPS_BUBBLES: 405 "drops.bubbles" [""] 1.0..8.0 = 3.0, Linear, 0.0 s, Real,
        "bubbles a drop makes, on average";
    DROPS_PRESSURE: 406 "drops.pressure" ["Pa"] 0.0..8.0 = 0.2, Log(0.0001), 0.2 s, Real,
        "pressure at 1 m of a drop's main bubble";
    DROPS_RISE: 407 "drops.rise_factor" [""] 0.0..20.0 = 0.1, Log(0.001), 0.2 s, Real,
        "rise factor of a drop's bubbles";

    LEVEL: 501 "mix.level" ["dB"] -80.0..24.0 = 0.0, Linear, 0.05 s, Real,
        "level of everything; 0 dB is 1 Pa at full scale";
    WIDTH: 502 "mix.width" [""] 0.0..1.0 = 1.0, Linear, 0.05 s, Real,
        "how far new bubbles spread to the sides; 0 is mono";
    TONE: 503 "mix.tone" ["dB"] -24.0..24.0 = 0.0, Linear, 0.05 s, Real,
        "tilt around 1 kHz: above 0 brighter, below 0 darker";
    LIMITER: 504 "mix.limiter" [""] 0.0..1.0 = 1.0, Linear, 0.0 s, Choice(SWITCH),
        "holds peaks below full scale; off: clips them";

    CLOUD_RATE: 601 "cloud.rate" ["1/s"] 0.0..100.0 = 0.0, Log(0.1), 0.2 s, Real,
        "births a second among bubbles that hear each other";
    CLOUD_BUBBLES: 602 "cloud.bubbles" [""] 0.0..256.0 = 64.0, Linear, 0.0 s, Whole,
        "how many there are at most; then each birth is the oldest one's end (F411: 64, F407: 128)";
    CLOUD_RADIUS_MIN: 603 "cloud.radius_min" ["mm"] 0.5..12.0 = 1.0, Log(0.5), 0.2 s, Real,
        "radius of the smallest of them";
    CLOUD_RADIUS_MAX: 604 "cloud.radius_max" ["mm"] 0.5..12.0 = 5.0, Log(0.5), 0.2 s, Real,
        "radius of the largest of them";
    CLOUD_GAMMA: 605 "cloud.gamma" [""] 0.0..10.0 = 1.5, Linear, 0.2 s, Real,
        "radii are as frequent as r^-gamma";
    CLOUD_SPACING: 606 "cloud.spacing" [""] 2.0..100.0 = 4.0, Log(2.0), 0.2 s, Real,
        "from one to the next, in radii: the closer, the lower they sound together";
    CLOUD_COUPLING: 607 "cloud.coupling" [""] 0.0..1.0 = 1.0, Linear, 0.2 s, Real,
        "how much they hear of each other; 0: nothing";
    CLOUD_DEPTH: 608 "cloud.depth" ["mm"] 5.0..1000.0 = 50.0, Log(5.0), 0.2 s, Real,
        "how far the middle is below the surface, which cancels what it reflects";
    CLOUD_PRESSURE: 609 "cloud.pressure" ["Pa"] 0.0..2.0 = 0.1, Log(0.0001), 0.2 s, Real,
        "pressure at 1 m of the loudest newborn if it were alone";
    CLOUD_DRIFT: 610 "cloud.drift" ["m/s"] 0.0..1.0 = 0.05, Log(0.001), 0.2 s, Real,
        "how fast they change places";
    CLOUD_SPLIT: 611 "cloud.split" [""] 0.0..1.0 = 0.2, Linear, 0.2 s, Real,
        "part of the births that are one of them breaking in two";
    CLOUD_PUSHES: 612 "cloud.pushes" ["1/s"] 0.0..1000.0 = 0.0, Log(0.1), 0.2 s, Real,
        "how often the water pushes one that is there";
}
