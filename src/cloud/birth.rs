//! Where bubbles of a cloud come from, where they go, and what pushes them. Control path.

use core::f32::consts::PI;
use core::num::NonZeroU16;

use super::matrix::{Spring, UNIT};
use crate::bubble::{Bubble, RHO};
use crate::frame::{BLOCK, TICK};
use crate::kernel::cloud::MEMBERS;
use crate::random::Random;

/// No bubble of a cloud is higher than this part of the cloud's rate.
const HIGHEST: f32 = 0.28;
/// A force ends after this at the latest, s.
const FORCE_MAX: f32 = 0.6e-3;
/// A force ends when sound has gone through the bubble, at 6 m/s (CB, after Czerski and Deane).
const FORCE_SPEED: f32 = 6.0;
/// Steps that a force may take.
pub const FORCE_STEPS: u32 = 32;
/// A cloud of n bubbles has n times the cube of the spacing for them: its radius over spacing and root of n.
const BALL: f32 = 0.62;
/// How much slower or faster than the others a bubble rises.
const SPREAD: f32 = 0.6;
/// Looks for a place that nobody is in.
pub const LOOKS: usize = 3;

/// What a cloud is asked to be; see the parameter table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Bubbles, at most.
    pub bubbles: usize,
    /// Births a second.
    pub rate: f32,
    /// Part of the births that are one bubble's breaking in two.
    pub split: f32,
    /// Pushes a second that bubbles get from the water about them.
    pub pushes: f32,
    /// The smallest radius, m.
    pub radius_min: f32,
    /// The largest radius, m.
    pub radius_max: f32,
    /// Density of radii r^-gamma.
    pub gamma: f32,
    /// From bubble to bubble, in radii.
    pub spacing: f32,
    /// Of the middle of the cloud below the surface, m.
    pub depth: f32,
    /// How much bubbles hear of each other, 0 to 1.
    pub coupling: f32,
    /// Pressure at 1 m of a newborn bubble alone, Pa; others are softer.
    pub pressure: f32,
    /// How fast bubbles change places, m/s.
    pub drift: f32,
    /// Stage width.
    pub width: f32,
}

impl Settings {
    /// No cloud.
    pub const NONE: Self = Self {
        bubbles: 0,
        rate: 0.0,
        split: 0.0,
        pushes: 0.0,
        radius_min: 1e-3,
        radius_max: 1e-3,
        gamma: 0.0,
        spacing: 4.0,
        depth: 1.0,
        coupling: 1.0,
        pressure: 0.0,
        drift: 0.0,
        width: 1.0,
    };

    /// Radius of the ball that the cloud is in, m.
    pub fn extent(&self) -> f32 {
        let radius = libm::sqrtf(self.radius_min * self.radius_max);
        BALL * self.spacing * radius * libm::cbrtf(self.bubbles.max(1) as f32)
    }
}

/// A cluster and a place in it, or nowhere. Never 0, so that nobody is 0: a board need not keep an empty cloud in flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Home(NonZeroU16);

impl Home {
    /// No place.
    pub const NOWHERE: Self = Self(NonZeroU16::MAX);

    /// A place in a cluster.
    pub fn new(cluster: usize, member: usize) -> Self {
        let number = (cluster * MEMBERS + member) as u16;
        Self(NonZeroU16::MIN.saturating_add(number))
    }

    /// Cluster and place, if it is one.
    pub fn place(self) -> Option<(usize, usize)> {
        let number = usize::from(self.0.get() - 1);
        (self != Self::NOWHERE).then_some((number / MEMBERS, number % MEMBERS))
    }
}

/// A bubble of a cloud.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// From the middle of the cloud, and below the surface, m: where it was when the others last asked.
    pub place: [f32; 3],
    /// m/s.
    pub velocity: [f32; 3],
    /// Radius, m.
    pub radius: f32,
    /// ω0, rad/s.
    pub omega: f32,
    /// 2β/ω0², s.
    pub damp: f32,
    /// The root of its radius over ω0.
    pub weight: f32,
    /// The tick of its birth.
    pub born: u32,
    /// The tick in which it was at `place`.
    pub since: u32,
    /// Where the audio path knows it.
    pub home: Home,
}

impl Body {
    /// A bubble of `radius` metres at rest at `place`, m.
    #[inline(never)]
    pub fn new(radius: f32, place: [f32; 3], now: u32) -> Self {
        let bubble = Bubble::new(f64::from(radius));
        let (omega, beta) = (bubble.omega0 as f32, bubble.beta as f32);
        Self {
            place: [place[0], place[1], place[2].max(radius)],
            velocity: [0.0; 3],
            radius,
            omega,
            damp: 2.0 * beta / (omega * omega),
            weight: libm::sqrtf(radius) / omega,
            born: now,
            since: now,
            home: Home::NOWHERE,
        }
    }

    /// Alone, in steps of `step` seconds.
    pub fn spring(&self, step: f32) -> Spring {
        let square = self.omega * self.omega;
        Spring::new(square * step * step, 0.5 * self.damp * square * step)
    }

    /// Where it is now, kept inside a ball of `extent` metres about `depth`.
    pub fn drift_on(&mut self, now: u32, tick: f32, extent: f32, depth: f32) {
        let seconds = now.wrapping_sub(self.since) as f32 * tick;
        self.since = now;
        for (i, (place, velocity)) in self.place.iter_mut().zip(&mut self.velocity).enumerate() {
            let middle = if i == 2 { depth } else { 0.0 };
            *place += *velocity * seconds;
            // Back in at the walls.
            if (*place - middle).abs() > extent {
                *place = middle + extent.copysign(*place - middle);
                *velocity = -*velocity;
            }
        }
        self.place[2] = self.place[2].max(self.radius);
    }
}

/// What chance makes of the settings.
#[derive(Clone, Debug)]
pub struct Births {
    random: Random,
    /// s.
    pub step: f32,
    /// s.
    pub tick: f32,
    /// Births until the next one.
    next: f32,
    next_push: f32,
}

impl Births {
    /// As it is before it starts.
    pub const OFF: Self = Self {
        random: Random::OFF,
        step: 0.0,
        tick: 0.0,
        next: 0.0,
        next_push: 0.0,
    };

    /// At `sample_rate` Hz.
    pub fn new(mut random: Random, sample_rate: f64) -> Self {
        let (next, next_push) = (random.exponential(), random.exponential());
        Self {
            random,
            step: (2.0 / sample_rate) as f32,
            tick: (TICK as f64 / sample_rate) as f32,
            next,
            next_push,
        }
    }

    /// Births that are due in this tick.
    pub fn due(&mut self, settings: &Settings) -> u32 {
        Self::count(&mut self.random, &mut self.next, settings.rate * self.tick)
    }

    /// Pushes that are due in this tick.
    pub fn pushes(&mut self, settings: &Settings) -> u32 {
        Self::count(
            &mut self.random,
            &mut self.next_push,
            settings.pushes * self.tick,
        )
    }

    #[inline(never)]
    fn count(random: &mut Random, next: &mut f32, mean: f32) -> u32 {
        *next -= mean;
        let mut count = 0;
        while *next < 0.0 && count < 16 {
            *next += random.exponential();
            count += 1;
        }
        *next = next.max(0.0);
        count
    }

    /// A number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.random.bits()) * n as u64) >> 32) as usize
    }

    /// Whether something of so much probability happens.
    pub fn happens(&mut self, probability: f32) -> bool {
        self.random.uniform() < probability
    }

    /// A new bubble.
    #[inline(never)]
    pub fn body(&mut self, settings: &Settings, now: u32) -> Body {
        let radius = self.radius(settings);
        let place = self.place(settings);
        self.moving(Body::new(radius, place, now), settings)
    }

    /// Another place for it.
    pub fn elsewhere(&mut self, body: &mut Body, settings: &Settings) {
        body.place = self.place(settings);
        body.place[2] = body.place[2].max(body.radius);
    }

    /// The two that `body` breaks into, if they are not too small.
    pub fn split(&mut self, body: &Body, settings: &Settings, now: u32) -> Option<[Body; 2]> {
        let part = 0.15 + 0.7 * self.random.uniform();
        let radii = [part, 1.0 - part].map(|part| body.radius * libm::cbrtf(part));
        if radii.iter().any(|radius| *radius < self.smallest(settings)) {
            return None;
        }
        let away = self.direction();
        // As far apart as when they part.
        let place = |sign: f32| {
            let way = sign * (radii[0] + radii[1]) / 2.0;
            core::array::from_fn(|i| body.place[i] + way * away[i])
        };
        let bodies = [
            Body::new(radii[0], place(1.0), now),
            Body::new(radii[1], place(-1.0), now),
        ];
        Some(bodies.map(|body| self.moving(body, settings)))
    }

    fn moving(&mut self, mut body: Body, settings: &Settings) -> Body {
        let way = self.direction();
        let speed = settings.drift * (1.0 - SPREAD / 2.0 + SPREAD * self.random.uniform());
        body.velocity = way.map(|way| speed * way);
        body
    }

    fn smallest(&self, settings: &Settings) -> f32 {
        // f0·r is 3.26 m/s and a bit more for small bubbles.
        (settings.radius_min).max(3.3 * self.step / HIGHEST)
    }

    #[inline(never)]
    fn radius(&mut self, settings: &Settings) -> f32 {
        let min = self.smallest(settings);
        let max = settings.radius_max.max(min);
        let u = self.random.uniform();
        let rest = 1.0 - settings.gamma;
        if rest.abs() < 1e-3 {
            return min * libm::powf(max / min, u);
        }
        let ends = libm::powf(max / min, rest);
        (min * libm::powf(1.0 + u * (ends - 1.0), 1.0 / rest)).clamp(min, max)
    }

    /// Anywhere in a ball of radius 1, or nearly so.
    fn direction(&mut self) -> [f32; 3] {
        let mut place = [0.0; 3];
        for _ in 0..4 {
            place = place.map(|_: f32| 2.0 * self.random.uniform() - 1.0);
            if place.iter().map(|x| x * x).sum::<f32>() <= 1.0 {
                return place;
            }
        }
        place.map(|x| 0.577 * x)
    }

    fn place(&mut self, settings: &Settings) -> [f32; 3] {
        let extent = settings.extent();
        let [x, y, z] = self.direction().map(|x| extent * x);
        [x, y, settings.depth + z]
    }

    /// What pushes `body` at most as loud as the settings say, from some step of a tick on.
    pub fn push(&mut self, body: &Body, settings: &Settings, steps_per_tick: usize) -> Push {
        let draw = self.random.uniform();
        let mut push = Push::new(body, settings.pressure * draw * draw, self.step);
        // In the first block there may be a commit: enough to do.
        let last = steps_per_tick - usize::from(push.steps);
        push.start = (BLOCK / 2 + self.below(last - BLOCK / 2)) as u8;
        push
    }
}

/// A force on a bubble: as [`Force`](super::Force).
#[derive(Clone, Copy, Debug)]
pub struct Push {
    /// The step it begins in.
    pub start: u8,
    /// Steps that it lasts.
    pub steps: u8,
    /// In the first step.
    pub push: i32,
    /// At most.
    pub energy: f32,
}

impl Push {
    /// That lets `body` ring with `pressure` Pa at 1 m if it is alone.
    #[inline(never)]
    pub fn new(body: &Body, pressure: f32, step: f32) -> Self {
        let spring = body.spring(step);
        let seconds = (body.radius / FORCE_SPEED).min(FORCE_MAX);
        let steps = ((seconds / step + 0.5) as u32).clamp(1, FORCE_STEPS);
        // y of that pressure, units of v: p = ρ/4π·√r·ω²·y.
        let root = body.weight * body.omega;
        let place = 4.0 * PI * pressure * libm::sqrtf(spring.mass)
            / (RHO as f32 * root * body.omega * body.omega)
            * UNIT;
        // A push of 1 in one step makes a swing of 1/sin; those of the others come at other phases.
        let cosine = (2.0 - spring.k - spring.c) / (2.0 * libm::sqrtf(1.0 - spring.c));
        let sine = libm::sqrtf((1.0 - cosine * cosine).max(1e-9));
        let (mut turn, mut sum) = ([1.0, 0.0], [0.0; 2]);
        for n in 1..=steps {
            let push = (n * n) as f32;
            sum = [sum[0] + push * turn[0], sum[1] + push * turn[1]];
            turn = [
                turn[0] * cosine - turn[1] * sine,
                turn[1] * cosine + turn[0] * sine,
            ];
        }
        let sum = libm::sqrtf(sum[0] * sum[0] + sum[1] * sum[1]).max(0.1);
        Self {
            start: 0,
            steps: steps as u8,
            push: (place * sine / (spring.gauge() * sum)) as i32,
            // Coupled masses are half as heavy at the lightest.
            energy: 2.0 * spring.k * place * place,
        }
    }
}
