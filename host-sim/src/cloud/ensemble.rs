//! Many bubbles in time: births, deaths and motion at any moment, coupled while they live, ringing out alone after it.
//!
//! Time goes in spans. What changes in a span (who is coupled, where, how large) becomes one new solver at its start; over
//! its first half millisecond the inverse goes smoothly from the old one to the new (CB 14), in which whoever is not
//! part of a solver is alone: so no birth, death or move jumps, and every step on the way is a stable one. Strikes fall at
//! their exact times, between samples too.

use std::collections::HashMap;
use std::f64::consts::PI;

use anyhow::{Result, bail};
use freshet::bubble::RHO;

use super::coupling::{Kernel, Place};
use super::forcing::{Pulse, force};
use super::modes;
use super::reduced::SIZE;
use super::solver::{Indefinite, Member, Method, Solver};
use super::step::{Sharpen, Step, Tone};
use super::wide::{Simd, Wide, wide};

/// A bubble whose pressure stays below this at 1 m is over, Pa: 120 dB below full scale.
const SILENT: f64 = 1e-6;
/// A displacement in m^2.5 that is taken for none: some 300 dB below one that is heard.
const NOTHING: f64 = 1e-30;
/// From so many coupled bubbles on a change of the matrix, whose cost grows with their number, is made less often.
const MANY: usize = 128;
/// Highest pitch that is sounded, over the sample rate; as in the core.
pub const PITCH_LIMIT: f64 = 0.45;

/// A bubble of an ensemble.
pub type Key = usize;

/// Something that happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A bubble appears, silent and coupled.
    Birth {
        /// Not in use.
        key: Key,
        /// Where and how large.
        place: Place,
        /// Its own pitch and decay.
        tone: Tone,
    },
    /// It is elsewhere, or has another size or pitch; what it displaces goes on.
    Change {
        /// Which.
        key: Key,
        /// Where and how large from now on.
        place: Place,
        /// Pitch and decay from now on.
        tone: Tone,
    },
    /// It is struck.
    Strike {
        /// Which.
        key: Key,
        /// When, s.
        time: f64,
        /// With what.
        pulse: Pulse,
    },
    /// It is heard and hears no longer, and rings out. The key is free after it.
    Death {
        /// Which.
        key: Key,
    },
}

/// What an ensemble has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Births.
    pub births: u64,
    /// Bubbles too high for the sample rate, not sounded.
    pub too_high: u64,
    /// Spans in which the dipole's depths made the matrix indefinite and it was left out.
    pub without_dipole: u64,
    /// Solvers made.
    pub solvers: u64,
    /// Most bubbles coupled at once.
    pub most_coupled: usize,
    /// Most bubbles sounding at once, those that ring out included.
    pub most_sounding: usize,
}

#[derive(Clone, Copy, Debug)]
struct Bubble {
    /// Never used twice.
    serial: usize,
    /// None once dead.
    key: Option<Key>,
    place: Place,
    tone: Tone,
    step: Step,
    /// Displacement y and its last step.
    y: f64,
    v: f64,
    /// Lane where it stands; `usize::MAX` none.
    lane: usize,
    /// Sample until which a pulse acts on it.
    struck_until: u64,
    /// Too high to be sounded or coupled.
    mute: bool,
    /// Has become another: alone in the old solver.
    changed: bool,
}

#[derive(Clone, Copy, Debug)]
struct Active {
    /// Index in `bubbles`.
    bubble: usize,
    pulse: Pulse,
    /// s.
    time: f64,
    /// From Pa to what is added to the step.
    gain: f64,
    lane: usize,
}

/// Bubbles that hear each other, at a sample rate.
pub struct Ensemble {
    method: Method,
    /// Nobody hears anybody.
    alone: bool,
    span: usize,
    frame: u64,
    serial: usize,
    bubbles: Vec<Bubble>,
    by_key: HashMap<Key, usize>,
    pulses: Vec<Active>,
    solver: Solver,
    sharpen: Sharpen,
    counts: Counts,
    lanes: Lanes,
    /// Nothing moves.
    silent: bool,
}

/// State side by side: first by the solver's places, then whoever is alone; a whole number of rows.
#[derive(Default)]
struct Lanes {
    /// Places of the solver.
    coupled: usize,
    y: Vec<f64>,
    v: Vec<f64>,
    c: Vec<f64>,
    k: Vec<f64>,
    /// 1/(1 + E).
    own: Vec<f64>,
    /// From a to pressure.
    gain: Vec<f64>,
    x: Vec<f64>,
    a: Vec<f64>,
    /// Index in `bubbles`; `usize::MAX` none.
    bubble: Vec<usize>,
    /// Who is struck in this sample, and how much.
    push: Vec<(usize, f64)>,
}

/// The solver that is on its way out.
struct Fade {
    solver: Solver,
    /// The lane of who stands at each of its places; `usize::MAX` none.
    from: Vec<usize>,
    x: Vec<f64>,
    a: Vec<f64>,
    /// Its answer by lanes.
    answer: Vec<f64>,
}

impl Ensemble {
    /// Nobody yet. `alone`: nobody hears anybody.
    pub fn new(method: Method, alone: bool) -> Self {
        Self {
            method,
            alone,
            // 1 ms.
            span: ((method.rate / 1000.0).round() as usize).max(2),
            frame: 0,
            serial: 0,
            bubbles: Vec::new(),
            by_key: HashMap::new(),
            pulses: Vec::new(),
            solver: Solver::empty(),
            sharpen: Sharpen::new(),
            counts: Counts::default(),
            lanes: Lanes::default(),
            silent: true,
        }
    }

    /// With spans of another length than 1 ms, in samples (at least 2).
    pub fn with_span(mut self, span: usize) -> Self {
        self.span = span.max(2);
        self
    }

    /// Samples that [`Self::play`] makes next: a millisecond's, and four times that from 128 coupled bubbles on.
    pub fn span(&self) -> usize {
        if self.coupled() < MANY {
            self.span
        } else {
            4 * self.span
        }
    }

    /// Samples made; the first of the output is [`Sharpen::REACH`] samples before time 0.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// What was done so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Whether nothing sounds and nobody lives.
    pub fn is_over(&self) -> bool {
        self.bubbles.is_empty()
    }

    /// Bubbles coupled now.
    pub fn coupled(&self) -> usize {
        self.solver.members().len()
    }

    /// Energy of the living, in units of its own: `½dᵀ(M̃ + E' − K/4)d + ½mᵀKm` of [`super::step`], with M̃ between two
    /// keys from `mass`. It cannot grow while nothing happens.
    pub fn energy(&self, mass: impl Fn(Key, Key) -> f64) -> f64 {
        let mut sum = 0.0;
        for (i, a) in self.bubbles.iter().enumerate() {
            let Some(key) = a.key else { continue };
            let middle = a.y - a.v / 2.0;
            sum += 0.5 * a.step.k * middle * middle;
            sum += 0.5 * (1.0 + a.step.slack()) * a.v * a.v;
            for b in &self.bubbles[..i] {
                if let Some(other) = b.key {
                    sum += mass(key, other) * a.v * b.v;
                }
            }
        }
        sum
    }

    /// Gives a living bubble a displacement `√r·y` of its own, m^1.5 in y, for measuring.
    pub fn displace(&mut self, key: Key, y: f64) {
        if let Some(&at) = self.by_key.get(&key) {
            let bubble = &mut self.bubbles[at];
            bubble.y = y;
            self.silent = false;
            if let Some(lane) = self.lanes.y.get_mut(bubble.lane) {
                *lane = y;
            }
        }
    }

    /// Takes what happens in the next span (strikes may come later) and adds its samples to `out`, in Pa at 1 m.
    ///
    /// # Errors
    /// CB's kernel, where its matrix is not positive definite.
    pub fn play(&mut self, events: &[Event], out: &mut Vec<f64>) -> Result<()> {
        let span = self.span();
        let mut changed = self.drop_silent();
        for event in events {
            changed |= self.take(event);
        }
        let mut fade = if changed { self.rearrange()? } else { None };
        for active in &mut self.pulses {
            active.lane = self.bubbles[active.bubble].lane;
        }
        if self.silent && self.pulses.is_empty() {
            for _ in 0..span {
                out.push(self.sharpen.next(0.0));
            }
            self.frame += span as u64;
            return Ok(());
        }
        let half = self.span / 2;
        for n in 0..span {
            if n == half {
                fade = None;
            }
            self.strike();
            let Self { lanes, solver, .. } = self;
            let fade = fade.as_mut().map(|fade| {
                let way = (n + 1) as f64 / (half + 1) as f64;
                // Without corners, which would be heard as a faint tick.
                (fade, way * way * (3.0 - 2.0 * way))
            });
            let sum = wide(OneSample {
                lanes,
                solver,
                fade,
            });
            out.push(self.sharpen.next(sum));
            self.frame += 1;
        }
        self.silent = true;
        for (lane, &bubble) in self.lanes.bubble.iter().enumerate() {
            let (y, v) = (&mut self.lanes.y[lane], &mut self.lanes.v[lane]);
            // Far below anything heard, and before numbers become slow.
            if y.abs() + v.abs() < NOTHING {
                (*y, *v) = (0.0, 0.0);
            } else {
                self.silent = false;
            }
            if let Some(bubble) = self.bubbles.get_mut(bubble) {
                (bubble.y, bubble.v) = (*y, *v);
            }
        }
        let h = 1.0 / self.method.rate;
        let now = self.frame as f64 * h;
        self.pulses
            .retain(|active| !active.pulse.is_over(now - active.time, h));
        Ok(())
    }

    /// Adds the pulses of this sample.
    fn strike(&mut self) {
        let h = 1.0 / self.method.rate;
        let now = self.frame as f64 * h;
        for active in &self.pulses {
            let since = now - active.time;
            if since > -h && active.lane != usize::MAX {
                let push = active.gain * active.pulse.around(since, h);
                self.lanes.push.push((active.lane, push));
            }
        }
    }

    /// Takes in one event; whether it asks for a new arrangement.
    fn take(&mut self, event: &Event) -> bool {
        match *event {
            Event::Birth { key, place, tone } => {
                self.counts.births += 1;
                self.serial += 1;
                let mut bubble = Bubble {
                    serial: self.serial,
                    key: Some(key),
                    place,
                    tone,
                    step: Step::default(),
                    y: 0.0,
                    v: 0.0,
                    lane: usize::MAX,
                    struck_until: 0,
                    mute: false,
                    changed: false,
                };
                self.tune(&mut bubble);
                self.by_key.insert(key, self.bubbles.len());
                self.bubbles.push(bubble);
                true
            }
            Event::Change { key, place, tone } => {
                let Some(&at) = self.by_key.get(&key) else {
                    return false;
                };
                let mut bubble = self.bubbles[at];
                if bubble.place == place && bubble.tone == tone {
                    return false;
                }
                // The volume √r·y goes on.
                let scale = (bubble.place.radius / place.radius).sqrt();
                bubble.y *= scale;
                bubble.v *= scale;
                bubble.changed |= scale != 1.0;
                bubble.place = place;
                if bubble.tone != tone {
                    bubble.tone = tone;
                    self.tune(&mut bubble);
                }
                self.bubbles[at] = bubble;
                true
            }
            Event::Strike { key, time, pulse } => {
                let Some(&at) = self.by_key.get(&key) else {
                    return false;
                };
                let bubble = &mut self.bubbles[at];
                let end = ((time + pulse.length) * self.method.rate).max(0.0) as u64 + 2;
                bubble.struck_until = bubble.struck_until.max(end);
                self.pulses.push(Active {
                    bubble: at,
                    pulse,
                    time,
                    gain: force(1.0, bubble.place.radius) * bubble.step.push,
                    lane: usize::MAX,
                });
                false
            }
            Event::Death { key } => {
                if let Some(at) = self.by_key.remove(&key) {
                    self.bubbles[at].key = None;
                }
                true
            }
        }
    }

    fn tune(&mut self, bubble: &mut Bubble) {
        bubble.step = self.method.step(&bubble.tone);
        let was_mute = bubble.mute;
        bubble.mute = bubble.tone.omega0 > 2.0 * PI * PITCH_LIMIT * self.method.rate;
        if bubble.mute {
            (bubble.y, bubble.v) = (0.0, 0.0);
            self.counts.too_high += u64::from(!was_mute);
        }
    }

    /// Lets go of the dead that are silent; whether there were any.
    fn drop_silent(&mut self) -> bool {
        let before = self.bubbles.len();
        let mut index = vec![usize::MAX; before];
        let mut kept = 0;
        for (at, index) in index.iter_mut().enumerate() {
            let bubble = self.bubbles[at];
            let rings = bubble.struck_until >= self.frame || loudness(&bubble) >= SILENT;
            if bubble.key.is_some() || (rings && !bubble.mute) {
                *index = kept;
                self.bubbles[kept] = bubble;
                kept += 1;
            }
        }
        if kept == before {
            return false;
        }
        self.bubbles.truncate(kept);
        self.by_key.values_mut().for_each(|at| *at = index[*at]);
        self.pulses.retain_mut(|active| {
            active.bubble = index[active.bubble];
            active.bubble != usize::MAX
        });
        true
    }

    /// Makes the solver that is due and lays the state out for it; what to fade from.
    fn rearrange(&mut self) -> Result<Option<Fade>> {
        let mut members = Vec::with_capacity(self.bubbles.len());
        for (index, bubble) in self.bubbles.iter().enumerate() {
            if bubble.key.is_some() && !bubble.mute && !self.alone {
                let was = bubble.lane < self.lanes.coupled;
                members.push(Member {
                    key: bubble.serial,
                    index,
                    was: if was { bubble.lane } else { usize::MAX },
                    place: bubble.place,
                    step: bubble.step,
                });
            }
        }
        let mut before = None;
        if self.solver.is_for(&members) {
            self.solver.renumber(members);
        } else {
            let solver = self.solver_for(members)?;
            self.counts.solvers += 1;
            before = Some(std::mem::replace(&mut self.solver, solver));
        }
        let lanes: Vec<usize> = self.bubbles.iter().map(|bubble| bubble.lane).collect();
        let coupled = self.lanes.coupled;
        self.lay_out();
        self.counts.most_coupled = self.counts.most_coupled.max(self.coupled());
        let sounding = self.bubbles.iter().filter(|b| b.lane != usize::MAX);
        self.counts.most_sounding = self.counts.most_sounding.max(sounding.count());
        let fade = before.map(|solver| {
            let mut from = vec![usize::MAX; coupled];
            for (bubble, was) in self.bubbles.iter().zip(lanes) {
                if was < coupled && !bubble.changed {
                    from[was] = bubble.lane;
                }
            }
            Fade {
                solver,
                from,
                x: vec![0.0; coupled],
                a: vec![0.0; coupled],
                answer: vec![0.0; self.lanes.y.len()],
            }
        });
        self.bubbles.iter_mut().for_each(|b| b.changed = false);
        Ok(fade)
    }

    fn solver_for(&mut self, members: Vec<Member>) -> Result<Solver> {
        let method = &self.method;
        let retry = method.coupling.dipole.then(|| members.clone());
        match Solver::after(&self.solver, method, members) {
            Ok(solver) => Ok(solver),
            Err(Indefinite) if method.coupling.kernel == Kernel::Cb => {
                let time = self.frame as f64 / method.rate;
                bail!("at {time:.4} s: {}", modes::refusal(&method.coupling, ""))
            }
            Err(Indefinite) => {
                // Depths that are not those under a plane: without the image it always holds.
                self.counts.without_dipole += 1;
                let mut plain = *method;
                plain.coupling.dipole = false;
                Solver::after(&Solver::empty(), &plain, retry.unwrap_or_default()).map_err(
                    |Indefinite| {
                        anyhow::anyhow!("a definite matrix was not (this is a fault of freshet)")
                    },
                )
            }
        }
    }

    fn lay_out(&mut self) {
        let lanes = &mut self.lanes;
        lanes.bubble.clear();
        for member in self.solver.places() {
            lanes
                .bubble
                .push(member.map_or(usize::MAX, |member| member.index));
        }
        lanes.coupled = lanes.bubble.len();
        self.bubbles.iter_mut().for_each(|b| b.lane = usize::MAX);
        for (lane, &bubble) in lanes.bubble.iter().enumerate() {
            if let Some(bubble) = self.bubbles.get_mut(bubble) {
                bubble.lane = lane;
            }
        }
        for (index, bubble) in self.bubbles.iter_mut().enumerate() {
            if bubble.lane == usize::MAX && !bubble.mute {
                bubble.lane = lanes.bubble.len();
                lanes.bubble.push(index);
            }
        }
        let whole = lanes.bubble.len().next_multiple_of(SIZE);
        lanes.bubble.resize(whole, usize::MAX);
        for row in [
            &mut lanes.y,
            &mut lanes.v,
            &mut lanes.c,
            &mut lanes.k,
            &mut lanes.own,
            &mut lanes.gain,
            &mut lanes.x,
            &mut lanes.a,
        ] {
            row.clear();
            row.resize(whole, 0.0);
        }
        let pressure = RHO / (4.0 * PI) * self.method.rate * self.method.rate;
        for (lane, &index) in lanes.bubble.iter().enumerate() {
            let Some(bubble) = self.bubbles.get(index) else {
                continue;
            };
            lanes.y[lane] = bubble.y;
            lanes.v[lane] = bubble.v;
            lanes.c[lane] = bubble.step.c;
            lanes.k[lane] = bubble.step.k;
            lanes.own[lane] = 1.0 / (1.0 + bubble.step.extra);
            lanes.gain[lane] = bubble.place.radius.sqrt() * pressure;
        }
    }
}

struct OneSample<'a> {
    lanes: &'a mut Lanes,
    solver: &'a mut Solver,
    fade: Option<(&'a mut Fade, f64)>,
}

impl Wide for OneSample<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) -> f64 {
        self.lanes.step(self.solver, self.fade)
    }
}

impl Lanes {
    /// One sample; the pressure, Pa at 1 m. While one solver gives way to another: that and how far it has come.
    #[inline(always)]
    fn step(&mut self, solver: &mut Solver, fade: Option<(&mut Fade, f64)>) -> f64 {
        let n = self.y.len();
        let Self {
            coupled,
            y,
            v,
            c,
            k,
            own,
            gain,
            push,
            x,
            a,
            ..
        } = self;
        // One length for all: the loops below need no bounds.
        let (y, v, c, k) = (&mut y[..n], &mut v[..n], &c[..n], &k[..n]);
        let (own, gain) = (&own[..n], &gain[..n]);
        let (x, a) = (&mut x[..n], &mut a[..n]);
        for i in 0..n {
            x[i] = -(c[i] * v[i] + k[i] * y[i]);
            a[i] = x[i] * own[i];
        }
        for (lane, push) in push.drain(..) {
            x[lane] += push;
            a[lane] = x[lane] * own[lane];
        }
        if let Some((fade, way)) = fade {
            let answer = &mut fade.answer[..n];
            answer.copy_from_slice(a);
            for (x_old, &lane) in fade.x.iter_mut().zip(&fade.from) {
                *x_old = x.get(lane).copied().unwrap_or(0.0);
            }
            fade.solver.solve(&fade.x, &mut fade.a);
            for (a_old, &lane) in fade.a.iter().zip(&fade.from) {
                if let Some(answer) = answer.get_mut(lane) {
                    *answer = *a_old;
                }
            }
            solver.solve(&x[..*coupled], &mut a[..*coupled]);
            for i in 0..n {
                a[i] = answer[i] + way * (a[i] - answer[i]);
            }
        } else {
            solver.solve(&x[..*coupled], &mut a[..*coupled]);
        }
        let mut sums = [0.0; SIZE];
        let rows = a.as_chunks::<SIZE>().0.iter();
        let rows = rows.zip(gain.as_chunks::<SIZE>().0);
        let rows = rows.zip(v.as_chunks_mut::<SIZE>().0);
        let rows = rows.zip(y.as_chunks_mut::<SIZE>().0);
        for (((a, gain), v), y) in rows {
            for i in 0..SIZE {
                sums[i] += a[i] * gain[i];
                v[i] += a[i];
                y[i] += v[i];
            }
        }
        sums.iter().sum()
    }
}

/// Amplitude of the pressure a bubble gives alone, Pa at 1 m.
fn loudness(bubble: &Bubble) -> f64 {
    let k = bubble.step.k.max(f64::MIN_POSITIVE);
    let swing = (bubble.y * bubble.y + bubble.v * bubble.v / k).sqrt();
    swing * bubble.tone.omega0.powi(2) * bubble.place.radius.sqrt() * RHO / (4.0 * PI)
}
