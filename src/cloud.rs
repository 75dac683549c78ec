//! A cloud: bubbles that hear each other (physics.md §3, CB §3–4).
//!
//! Coupling shifts pips down to the low roar of water. Bubbles are kept in clusters of eight. Inside a cluster the
//! coupling is exact: its mass matrix is diagonalised, and each mode is a damped spring whose pitch and decay are exact at
//! any rate. Between clusters sums are coupled, `M ≈ B + S·G·Sᵀ`, which costs a product of k × k (Woodbury). All of it
//! steps at half the sample rate.
//!
//! A mode's step is `(1 + γGγᵀ)·a = −(c·v + k·y)`, `v += a`, `y += v`: central differences, whose energy never grows where
//! `1 − c/2 − k/4 + γGγᵀ` is positive definite. The control path makes sure that it is, so nothing can run away.
//!
//! Scales: y is Q54 of a unit mode's `m^(3/2)`, v an eighth of that in 64 bits; a cluster's sum is 2^11 of v; the core
//! gives Q20 of a pascal. Where v is in 32 bits, so many are rounded to; see `kernel::cloud`.

mod birth;
mod coupling;
mod double;
mod keeper;
mod matrix;
mod slice;
mod slots;

pub use birth::{Body, HIGHEST, Push, Settings};
pub use keeper::{Keep, Keeper, force};
pub use slice::{CHANGED, Changed, Commit, FORCES, Force, Message, Retired, Slice};

use core::f32::consts::FRAC_1_SQRT_2;

use coupling::loudness;
use double::{Double, STEPS};
use matrix::fixed;
use slice::{NOBODY, RINGING_OUT};

use crate::fixed::mul_high;
use crate::frame::{BLOCKS_PER_TICK, Block};
use crate::kernel::cloud::{Cluster, GROUP, MEMBERS, Mode, Row, Run, run, sum};

/// Steps of a mode in a tick.
pub const STEPS_PER_TICK: usize = STEPS * BLOCKS_PER_TICK;
/// Forces at once; others are not felt, and counted.
const PUSHING: usize = 16;
/// Energy that may ring, in squares of v: gathered in a mode of 100 Hz it is 0.7 of y's range, at 96 kHz too.
pub const ENERGY_MAX: f32 = 1.0e13;
/// A jump loses 2^-5 of itself in a step.
const SMOOTHING: u32 = 5;
/// Where all of v is below this, 1e-5 Pa of a bubble of 10 mm, there is silence.
const STILL: i64 = 64 << 32;
/// The same for what pulls at it. The rounding of high modes keeps them going at a third of this.
const SLACK: i32 = 16;

/// Where a cloud lives: `C` clusters, one of them for bubbles that ring out; `D` is two more, and `R` the rows of the core.
#[derive(Clone, Debug)]
pub struct Store<const C: usize, const D: usize, const R: usize> {
    clusters: [Cluster; C],
    core: [Row; R],
    next: [Row; R],
    sums: [i32; C],
    drive: [i32; D],
}

impl<const C: usize, const D: usize, const R: usize> Store<C, D, R> {
    /// All at rest.
    pub const REST: Self = {
        assert!(C % GROUP == 1 && D == C + 2 && R == (C + 1) * (C / GROUP));
        Self {
            clusters: [Cluster::REST; C],
            core: [[0; GROUP]; R],
            next: [[0; GROUP]; R],
            sums: [0; C],
            drive: [0; D],
        }
    };
}

/// What a store holds, whatever its size.
#[derive(Debug)]
pub struct Parts<'a> {
    clusters: &'a mut [Cluster],
    core: &'a mut [Row],
    next: &'a mut [Row],
    sums: &'a mut [i32],
    drive: &'a mut [i32],
}

/// A place for a cloud.
pub trait Hold {
    /// What it holds.
    fn parts(&mut self) -> Parts<'_>;
}

impl<const C: usize, const D: usize, const R: usize> Hold for Store<C, D, R> {
    fn parts(&mut self) -> Parts<'_> {
        Parts {
            clusters: &mut self.clusters,
            core: &mut self.core,
            next: &mut self.next,
            sums: &mut self.sums,
            drive: &mut self.drive,
        }
    }
}

/// What a cloud has done, for a model of what it costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Groups of eight clusters that move now.
    pub groups: usize,
    /// Commits so far.
    pub commits: u32,
    /// Clusters that they changed.
    pub changed: u32,
    /// Forces so far.
    pub forces: u32,
    /// Steps of forces so far.
    pub pushes: u32,
    /// Forces that were not felt: too many, or too much energy.
    pub refused: u32,
}

/// A force on its way. It ends before its tick does, so that nobody changes places meanwhile.
#[derive(Clone, Copy, Debug)]
struct Pushing {
    force: Force,
    /// Steps until it begins.
    wait: u32,
    /// What half a push of 1 is to each mode's v, Q32, and to the cluster's sum over 2^11, Q28.
    kicks: [i32; MEMBERS],
    total: i32,
    /// Twice this step's push, and what it gains until the next one.
    push: i32,
    growth: i32,
}

/// What takes a jump away and dies out: `(1 − t/τ)·e^(−t/τ)`, whose mean is 0, so that many of them do not rumble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Jump {
    decays: i32,
    follows: i32,
}

impl Jump {
    const NONE: Self = Self {
        decays: 0,
        follows: 0,
    };

    fn add(&mut self, jump: i32) {
        self.decays = self.decays.saturating_add(jump);
    }

    fn next(&mut self) -> i32 {
        let now = self.decays.saturating_sub(self.follows);
        // Both towards zero in the end.
        self.follows += (now >> SMOOTHING) + i32::from(now > 0);
        self.decays -= (self.decays >> SMOOTHING) + i32::from(self.decays > 0);
        now
    }
}

/// The cloud's state. `S` is a [`Store`].
#[derive(Clone, Debug)]
pub struct Cloud<S> {
    store: S,
    /// Groups of clusters in use.
    groups: usize,
    /// Clusters that a commit will put in place.
    staged: [Cluster; CHANGED],
    pushing: heapless::Vec<Pushing, PUSHING>,
    /// What is left of jumps at commits.
    jump: [Jump; 2],
    /// Whether something may move.
    moves: bool,
    /// Loudness of bubbles that ring out, as in the core.
    ring_out: i32,
    double: Double,
    work: Work,
}

impl<S: Hold> Cloud<S> {
    /// A silent cloud, before it starts.
    pub const fn new(store: S) -> Self {
        Self {
            store,
            groups: 0,
            staged: [Cluster::REST; CHANGED],
            pushing: heapless::Vec::new(),
            jump: [Jump::NONE; 2],
            moves: false,
            ring_out: 0,
            double: Double::new(),
            work: Work {
                groups: 0,
                commits: 0,
                changed: 0,
                forces: 0,
                pushes: 0,
                refused: 0,
            },
        }
    }

    /// Starts at a sample rate of `sample_rate` Hz.
    pub fn start(&mut self, sample_rate: f64) {
        self.ring_out = fixed(FRAC_1_SQRT_2 * loudness(sample_rate), 32);
    }

    /// Takes a tick's message, before its first block.
    #[inline(never)]
    pub fn apply(&mut self, message: &Message) {
        match &message.slice {
            Some(Slice::Cluster(place, cluster)) => {
                if let Some(staged) = self.staged.get_mut(*place) {
                    *staged = *cluster;
                }
            }
            Some(Slice::Core(first, rows)) => {
                let next = self.store.parts().next.iter_mut().skip(*first);
                next.zip(rows).for_each(|(next, row)| *next = *row);
            }
            None => {}
        }
        if let Some(commit) = &message.commit {
            self.commit(commit);
        }
        if !message.forces.is_empty() {
            let mut energy = self.energy();
            self.work.forces = self.work.forces.wrapping_add(message.forces.len() as u32);
            for force in &message.forces {
                energy += force.energy;
                self.push(force, energy);
            }
        }
    }

    /// Whether nothing moves, and no sample of it is still to come.
    pub fn is_silent(&self) -> bool {
        !self.moves
            && self.pushing.is_empty()
            && self.jump == [Jump::NONE; 2]
            && self.double.is_silent()
    }

    /// What it has done.
    pub fn work(&self) -> Work {
        Work {
            groups: if self.moves { self.groups } else { 0 },
            ..self.work
        }
    }

    /// Adds one block.
    #[inline(never)]
    pub fn render(&mut self, out: &mut Block) {
        if self.is_silent() {
            return;
        }
        let mut samples = [[0; 2]; STEPS];
        let mut rest = &mut samples[..];
        while !rest.is_empty() {
            let waits = self.pushing.iter().map(|pushing| pushing.wait as usize);
            let quiet = waits.min().unwrap_or(rest.len()).min(rest.len());
            if quiet == 0 {
                self.push_on();
            } else {
                self.pushing
                    .iter_mut()
                    .for_each(|pushing| pushing.wait -= quiet as u32);
            }
            let (now, later) = rest.split_at_mut(quiet.max(1));
            if self.moves {
                self.run(now);
            }
            rest = later;
        }
        if self.jump != [Jump::NONE; 2] {
            for sample in &mut samples {
                for (sample, jump) in sample.iter_mut().zip(&mut self.jump) {
                    *sample = sample.saturating_add(jump.next());
                }
            }
        }
        self.double.render(&samples, out);
        self.settle();
    }

    fn run(&mut self, out: &mut [[i32; 2]]) {
        let Parts {
            clusters,
            core,
            sums,
            drive,
            ..
        } = self.store.parts();
        let mut all = Run {
            clusters,
            core,
            sums,
            drive,
            ring_out: self.ring_out,
            groups: self.groups,
        };
        run(&mut all, out);
    }

    /// What the ears would hear now.
    fn ears(&mut self) -> [i32; 2] {
        let groups = self.groups;
        let parts = self.store.parts();
        if groups == 0 {
            return [0; 2];
        }
        let rows = groups * GROUP + 2;
        let rest = mul_high(parts.sums[rows - 2], self.ring_out);
        [0, 1].map(|ear| {
            (0..groups).fold(rest, |total, group| {
                let row = &parts.core[group * rows + ear];
                (row.iter().zip(&parts.sums[group * GROUP..])).fold(total, |total, (word, sum)| {
                    total.wrapping_add(mul_high(*sum, *word))
                })
            })
        })
    }

    /// Other clusters from here on: what rings goes on ringing, and no ear hears a step.
    #[inline(never)]
    fn commit(&mut self, commit: &Commit) {
        self.work.commits = self.work.commits.wrapping_add(1);
        let changed = commit.changed.len() as u32;
        self.work.changed = self.work.changed.wrapping_add(changed);
        let before = self.ears();
        let old = self.groups * GROUP;
        let parts = self.store.parts();
        // Where each bubble that may move is, in the bubbles' own terms.
        let mut bubbles = [[Swing::default(); MEMBERS]; CHANGED];
        for (bubbles, changed) in bubbles.iter_mut().zip(&commit.changed) {
            *bubbles = swings(&parts.clusters[usize::from(changed.cluster)]);
        }
        let find = |from: u8| match from {
            NOBODY => Swing::default(),
            _ => bubbles[usize::from(from) / MEMBERS][usize::from(from) % MEMBERS],
        };
        let new = commit.groups * GROUP;
        if new != old {
            let ringing_out = parts.clusters[old];
            let (low, high) = (new.min(old), new.max(old));
            parts.clusters[low..=high].fill(Cluster::REST);
            parts.sums[low..=high].fill(0);
            parts.clusters[new] = if old == 0 { Cluster::REST } else { ringing_out };
            self.groups = commit.groups;
        }
        for retired in &commit.retired {
            let place = usize::from(retired.to) % RINGING_OUT;
            let mode = &mut parts.clusters[new].modes[place];
            *mode = retired.mode;
            find(retired.from).set(mode, retired.inverse);
        }
        for (changed, cluster) in commit.changed.iter().zip(&mut self.staged) {
            let members = changed.from.map(find);
            for (m, mode) in cluster.modes.iter_mut().enumerate() {
                let turn = &cluster.shape.turn;
                let (mut place, mut speed) = (0i64, 0i64);
                for (member, row) in members.iter().zip(turn) {
                    place += product(row[m], member.place);
                    speed += product(row[m], member.speed);
                }
                let swing = Swing {
                    place: (place >> 31) as i32,
                    speed: (speed >> 31) as i32,
                };
                swing.set(mode, cluster.shape.inverse[m]);
            }
            let place = usize::from(changed.cluster);
            parts.clusters[place] = *cluster;
            parts.sums[place] = sum(&cluster.modes);
        }
        let rows = (new + 2) * commit.groups;
        parts.core[..rows].copy_from_slice(&parts.next[..rows]);
        parts.sums[new] = sum(&parts.clusters[new].modes);
        let after = self.ears();
        for ((jump, before), after) in self.jump.iter_mut().zip(before).zip(after) {
            jump.add(before.saturating_sub(after));
        }
    }

    /// Begins a force, if the `energy` that there will be leaves room for it.
    fn push(&mut self, force: &Force, energy: f32) {
        let place = usize::from(force.cluster);
        let in_time = usize::from(force.start) + usize::from(force.steps) <= STEPS_PER_TICK;
        let fits = place < self.groups * GROUP && energy < ENERGY_MAX;
        if !(fits && in_time && force.steps > 0) {
            self.work.refused = self.work.refused.wrapping_add(1);
            return;
        }
        let Cluster { modes, shape } = &self.store.parts().clusters[place];
        let turn = &shape.turn[usize::from(force.member) % MEMBERS];
        let mut kicks = [0; MEMBERS];
        let mut total = 0;
        for (m, kick) in kicks.iter_mut().enumerate() {
            *kick = (product(shape.gauge[m], turn[m]) >> 31) as i32;
            total += product(modes[m].share, *kick) >> 3;
        }
        let push = force.push.saturating_mul(2);
        let pushing = Pushing {
            force: *force,
            wait: u32::from(force.start),
            kicks,
            total: (total >> 32) as i32,
            push,
            growth: push.saturating_mul(3),
        };
        if self.pushing.push(pushing).is_err() {
            self.work.refused = self.work.refused.wrapping_add(1);
        }
    }

    /// Energy of all modes as if they were alone, and of what still pushes, in squares of v.
    fn energy(&mut self) -> f32 {
        let clusters = self.groups * GROUP;
        let pushing: f32 = self
            .pushing
            .iter()
            .map(|pushing| pushing.force.energy)
            .sum();
        let modes = self.store.parts().clusters.iter().take(clusters);
        let ringing: i64 = (modes.flat_map(|cluster| &cluster.modes))
            .map(|mode| {
                let spring = i64::from(mul_high(mode.spring, mode.place)) * i64::from(mode.place);
                let speed = mode.wide_speed() >> 32;
                speed * speed - (spring >> 3)
            })
            .fold(0, i64::saturating_add);
        ringing as f32 + pushing
    }

    /// One step of all that pushes.
    #[inline(never)]
    fn push_on(&mut self) {
        let parts = self.store.parts();
        let mut pushes = 0;
        self.pushing.retain_mut(|pushing| {
            if pushing.wait > 0 {
                pushing.wait -= 1;
                return true;
            }
            pushes += 1;
            let place = usize::from(pushing.force.cluster);
            let push = pushing.push;
            for (mode, kick) in parts.clusters[place].modes.iter_mut().zip(&pushing.kicks) {
                mode.set_speed(mode.wide_speed().wrapping_add(product(*kick, push)));
            }
            let total = product(pushing.total, push) >> (28 + 1 - SUM);
            parts.sums[place] = parts.sums[place].wrapping_add(total as i32);
            // It grows with the square of time.
            pushing.push = push.saturating_add(pushing.growth);
            let bend = pushing.force.push.saturating_mul(4);
            pushing.growth = pushing.growth.saturating_add(bend);
            pushing.force.steps -= 1;
            pushing.force.steps > 0
        });
        self.moves |= pushes > 0;
        self.work.pushes = self.work.pushes.wrapping_add(pushes);
    }

    /// Comes to rest where nothing is to be heard any more.
    #[inline(never)]
    fn settle(&mut self) {
        if !self.moves || !self.pushing.is_empty() {
            return;
        }
        let clusters = self.groups * GROUP + 1;
        let parts = self.store.parts();
        let modes = || {
            parts
                .clusters
                .iter()
                .take(clusters)
                .flat_map(|cluster| &cluster.modes)
        };
        let still = |mode: &Mode| {
            let speed = mode.wide_speed();
            (-STILL..STILL).contains(&speed) && (-SLACK..=SLACK).contains(&mode.pull())
        };
        if !modes().all(still) {
            return;
        }
        let before = self.ears();
        let parts = self.store.parts();
        for cluster in parts.clusters.iter_mut().take(clusters) {
            for mode in &mut cluster.modes {
                (mode.place, mode.speed) = (0, [0; 2]);
            }
        }
        parts.sums.fill(0);
        parts.drive.fill(0);
        for (jump, before) in self.jump.iter_mut().zip(before) {
            jump.add(before);
        }
        self.moves = false;
    }
}

#[inline(always)]
fn product(a: i32, b: i32) -> i64 {
    i64::from(a) * i64::from(b)
}

const SUM: u32 = crate::kernel::cloud::SUM_BITS;

/// A bubble's own place and speed, in 16ths.
#[derive(Clone, Copy, Debug, Default)]
struct Swing {
    place: i32,
    speed: i32,
}

/// How the bubbles of a cluster swing.
fn swings(cluster: &Cluster) -> [Swing; MEMBERS] {
    let mut modes = [Swing::default(); MEMBERS];
    for ((swing, mode), gauge) in modes
        .iter_mut()
        .zip(&cluster.modes)
        .zip(cluster.shape.gauge)
    {
        // The energy that may ring keeps both below 2^28.
        swing.place = (product(gauge, mode.place) >> 27) as i32;
        swing.speed = (product(gauge, (mode.wide_speed() >> 28) as i32) >> 31) as i32;
    }
    cluster.shape.turn.map(|row| {
        let (mut place, mut speed) = (0i64, 0i64);
        for (mode, turn) in modes.iter().zip(row) {
            place += product(turn, mode.place);
            speed += product(turn, mode.speed);
        }
        Swing {
            place: (place >> 31) as i32,
            speed: (speed >> 31) as i32,
        }
    })
}

impl Swing {
    /// Lets `mode` swing so, whose own inverse gauge is given.
    fn set(&self, mode: &mut Mode, inverse: i32) {
        mode.place = (product(self.place, inverse) >> (23 + 4)) as i32;
        mode.set_speed((product(self.speed, inverse) >> 23) << 28);
    }
}
