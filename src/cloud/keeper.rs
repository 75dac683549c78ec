//! The cloud's control path: one batch of changes after another, each cut into ticks, in force at a fixed frame.
//!
//! A batch is decided in one tick, its first cluster worked out in the next, its second one, where two change, in the one
//! after, then the core; the commit goes out with the last rows of the core. That makes three or four ticks a batch, so 94
//! batches a second at least; births that come faster wait, and those that do not fit into the queue are none.

use super::STEPS_PER_TICK;
use super::birth::{Births, Body, Home, LOOKS, Push, Settings};
use super::coupling::{Core, Peer, loudness};
use super::matrix::{Solved, fixed, solve, sqrt};
use super::slice::{
    CHANGED, Changed, Commit, FORCES, Force, Message, NOBODY, RINGING_OUT, ROWS, Retired, Slice,
};
use super::slots::{Place, Slots};
use crate::fixed::cosine;
use crate::kernel::cloud::{GROUP, MEMBERS};
use crate::random::{Random, Stream};

/// Births that may wait.
const WAITING: u32 = 8;
/// Ticks from one look at where bubbles have drifted to the next.
const TIDY: u32 = 12;
/// The coupling changes by this at a time, and then all clusters hear of it: a cluster's pitches are not to jump.
const GENTLY: f32 = 0.125;
/// Ticks without births and pushes after which bubbles go: all has rung out.
const FORGOTTEN: u32 = 400;

/// What a profile's control path keeps of a cloud.
pub trait Keep {
    /// Starts at a sample rate of `sample_rate` Hz.
    fn start(&mut self, seed: u64, sample_rate: u32);
    /// One tick on.
    fn tick(&mut self, settings: &Settings, message: &mut Message);
}

/// What a batch is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Nothing is going on.
    Rest,
    /// This cluster of those that change is next.
    Cluster(usize),
    /// The core is next.
    Core,
    /// Rows of the core from this one on are next.
    Rows(usize),
}

/// The clusters that change.
type Batch = heapless::Vec<u8, CHANGED>;

/// The control path's state, of at most `K` clusters.
#[derive(Clone, Debug)]
pub struct Keeper<const K: usize> {
    births: Births,
    slots: Slots<K>,
    peers: [Peer; K],
    core: Core<K>,
    /// What a word of the core is to an ear.
    loudness: f32,
    now: u32,
    stage: Stage,
    commit: Commit,
    /// Clusters in use once the batch is in force, and those that may be.
    groups: usize,
    /// Births that wait.
    waiting: u32,
    /// Newborns to push when they are there.
    newborn: heapless::Vec<Place, CHANGED>,
    /// Where the next bubble goes that rings out.
    ring_out: u8,
    /// Ticks since bubbles were looked at for drift, and which cluster is next.
    untidy: u32,
    next: usize,
    /// Bubbles in a row that are where they belong.
    content: usize,
    /// Ticks without births and pushes.
    idle: u32,
    /// What clusters are worked out with: coupling and stage width; and how many have not heard of it yet.
    coupling: f32,
    width: f32,
    stale: usize,
    /// Whether a stale cluster comes before a birth.
    stale_first: bool,
    /// The depth that bubbles know, and how many looks it takes until all do.
    depth: f32,
    deaf: usize,
}

impl<const K: usize> Keeper<K> {
    /// As it is before it starts.
    pub const OFF: Self = Self {
        births: Births::OFF,
        slots: Slots::NONE,
        peers: [Peer::NONE; K],
        core: Core::NONE,
        loudness: 0.0,
        now: 0,
        stage: Stage::Rest,
        commit: Commit {
            groups: 0,
            changed: heapless::Vec::new(),
            retired: heapless::Vec::new(),
        },
        groups: 0,
        waiting: 0,
        newborn: heapless::Vec::new(),
        ring_out: 0,
        untidy: 0,
        next: 0,
        content: 0,
        idle: 0,
        coupling: 0.0,
        width: 0.0,
        stale: 0,
        stale_first: false,
        depth: 0.0,
        deaf: 0,
    };

    /// Who is in which cluster. Between batches that is what the audio path plays once the last message is applied.
    pub fn bodies(&self) -> impl Iterator<Item = (Place, &Body)> {
        self.slots.bodies()
    }

    /// Whether no batch is under way.
    pub fn is_at_rest(&self) -> bool {
        self.stage == Stage::Rest
    }

    /// Places a bubble by hand, before the first tick or between batches. Returns where, once [`Keeper::work_out`] has.
    pub fn place(&mut self, body: Body) -> Option<Place> {
        Some(self.slots.settle(body, K)?.0)
    }

    /// Works out cluster `cluster` next, whatever the births do.
    pub fn work_out(&mut self, clusters: &[u8]) {
        self.newborn.clear();
        self.begin(clusters.iter().copied().take(CHANGED).collect(), K);
    }

    /// Clusters in use for so many bubbles.
    fn allowed(settings: &Settings) -> usize {
        settings.bubbles.div_ceil(MEMBERS).min(K)
    }

    /// Decides what the next batch is, if there is one.
    #[inline(never)]
    fn decide(&mut self, settings: &Settings) {
        let allowed = Self::allowed(settings);
        let count = self.slots.count();
        self.newborn.clear();
        self.commit.retired.clear();
        if count > settings.bubbles.min(K * MEMBERS) {
            self.retire_oldest(allowed, Batch::new());
        } else if self.stale > 0 && (self.stale_first || self.waiting == 0) {
            self.refresh(allowed);
        } else if self.waiting > 0 && allowed > 0 {
            self.stale_first = true;
            self.waiting -= 1;
            self.bear(settings, allowed, count);
        } else if count > 0 && (self.content < count || self.deaf > 0 || settings.drift > 0.0) {
            self.tidy(settings, allowed);
        }
    }

    /// The next stale cluster is worked out again.
    #[inline(never)]
    fn refresh(&mut self, allowed: usize) {
        self.stale_first = false;
        while self.stale > 0 {
            self.stale -= 1;
            if self.slots.clusters[self.stale].iter().any(Option::is_some) {
                let mut batch = Batch::new();
                add(&mut batch, self.stale);
                return self.begin(batch, allowed);
            }
        }
    }

    /// One bubble more, or one in the place of the oldest.
    #[inline(never)]
    fn bear(&mut self, settings: &Settings, allowed: usize, count: usize) {
        let mut batch = Batch::new();
        let parent = (count > 0 && self.births.happens(settings.split))
            .then(|| self.anybody())
            .flatten();
        let children = parent.and_then(|place| {
            let parent = self.slots.get(place)?;
            self.births.split(parent, settings, self.now)
        });
        if let (Some(place), Some([one, other])) = (parent, children) {
            return self.part(place, one, other, settings, allowed, count);
        }
        let mut body = self.births.body(settings, self.now);
        for _ in 1..LOOKS {
            if !self.slots.overlaps(&body) {
                break;
            }
            self.births.elsewhere(&mut body, settings);
        }
        let full = count >= settings.bubbles.min(allowed * MEMBERS);
        if full && let Some(oldest) = self.slots.oldest(allowed, self.now) {
            self.retire(oldest);
            add(&mut batch, oldest.0);
            if oldest.0 >= allowed {
                // There is no room for a third cluster.
                return self.begin(batch, allowed);
            }
        }
        // A newborn goes where it belongs; if that is one cluster only, it may change places for a better one.
        if let Some((place, look)) = self.slots.settle(body, allowed) {
            add(&mut batch, place.0);
            let better = (batch.len() < CHANGED)
                .then(|| self.slots.improve(place, &look, allowed))
                .flatten();
            if let Some(better) = better {
                add(&mut batch, better.0);
            }
            add_place(&mut self.newborn, better.unwrap_or(place));
        }
        self.begin(batch, allowed);
    }

    /// Two bubbles in the place of one. They hear each other most of all, so that they stay in one cluster; where that is
    /// full, or all are, its oldest makes room.
    #[inline(never)]
    fn part(
        &mut self,
        place: Place,
        one: Body,
        other: Body,
        settings: &Settings,
        allowed: usize,
        count: usize,
    ) {
        let mut batch = Batch::new();
        add(&mut batch, place.0);
        self.retire(place);
        self.slots.put(place, one);
        add_place(&mut self.newborn, place);
        let members = &self.slots.clusters[place.0];
        let free = members.iter().position(Option::is_none);
        let full = count >= settings.bubbles.min(allowed * MEMBERS);
        let room = free.filter(|_| !full).or_else(|| {
            let age = |(i, body): (usize, &Option<Body>)| {
                let age = self.now.wrapping_sub(body.as_ref()?.born);
                (i != place.1).then_some((age, i))
            };
            members
                .iter()
                .enumerate()
                .filter_map(age)
                .max()
                .map(|(_, i)| i)
        });
        if let Some(i) = room.or(free) {
            self.retire((place.0, i));
            self.slots.put((place.0, i), other);
            add_place(&mut self.newborn, (place.0, i));
        }
        self.begin(batch, allowed);
    }

    /// One bubble less.
    #[inline(never)]
    fn retire_oldest(&mut self, allowed: usize, mut batch: Batch) {
        if let Some(oldest) = self.slots.oldest(allowed, self.now) {
            self.retire(oldest);
            add(&mut batch, oldest.0);
        }
        self.begin(batch, allowed);
    }

    /// The bubble whose turn it is changes places, if that is better; now and then it first goes where it has drifted.
    #[inline(never)]
    fn tidy(&mut self, settings: &Settings, allowed: usize) {
        let all = K * MEMBERS;
        let at = |n: usize| ((n / MEMBERS) % K, n % MEMBERS);
        let turns = (0..all).map(|n| (self.next + n) % all);
        let Some(turn) = turns.into_iter().find(|n| self.slots.get(at(*n)).is_some()) else {
            return;
        };
        self.next = (turn + 1) % all;
        self.content += 1;
        let place = at(turn);
        let mut batch = Batch::new();
        let look = if self.untidy >= TIDY && (settings.drift > 0.0 || self.deaf > 0) {
            self.untidy = 0;
            self.deaf = self.deaf.saturating_sub(1);
            add(&mut batch, place.0);
            let Some(mut body) = self.slots.take(place) else {
                return;
            };
            let extent = settings.extent();
            body.drift_on(self.now, self.births.tick, extent, settings.depth);
            self.slots.put(place, body)
        } else {
            let Some(look) = self.slots.look_around(place) else {
                return;
            };
            look
        };
        if let Some(better) = self.slots.improve(place, &look, allowed) {
            add(&mut batch, place.0);
            add(&mut batch, better.0);
        }
        self.begin(batch, allowed);
    }

    /// Some bubble.
    fn anybody(&mut self) -> Option<Place> {
        let used = self.groups * GROUP;
        (0..4).find_map(|_| {
            let n = self.births.below(used * MEMBERS);
            let place = (n / MEMBERS, n % MEMBERS);
            self.slots.get(place).map(|_| place)
        })
    }

    /// Lets the bubble at `place` ring out, if the audio path knows it.
    #[inline(never)]
    fn retire(&mut self, place: Place) {
        let Some(body) = self.slots.take(place) else {
            return;
        };
        if let Some((cluster, member)) = body.home.place() {
            let spring = body.spring(self.births.step);
            let share = sqrt(body.radius) / sqrt(spring.mass);
            // Which of the changed clusters that is, is known when the batch begins.
            let retired = Retired {
                from: cluster as u8,
                to: self.ring_out | (member << 4) as u8,
                mode: spring.mode(share),
                inverse: fixed(1.0 / spring.gauge(), 23),
            };
            let _ = self.commit.retired.push(retired);
            self.ring_out = (self.ring_out + 1) % RINGING_OUT as u8;
        }
    }

    /// Fixes who comes from where, and what is next.
    #[inline(never)]
    fn begin(&mut self, batch: Batch, allowed: usize) {
        if batch.is_empty() {
            return;
        }
        self.content = 0;
        self.commit.changed.clear();
        for cluster in &batch {
            let mut changed = Changed {
                cluster: *cluster,
                from: [NOBODY; MEMBERS],
            };
            let members = &mut self.slots.clusters[usize::from(*cluster)];
            for (i, member) in members.iter_mut().enumerate() {
                if let Some(body) = member {
                    changed.from[i] = origin(&batch, body.home);
                    body.home = Home::new(usize::from(*cluster), i);
                }
            }
            let _ = self.commit.changed.push(changed);
        }
        for retired in &mut self.commit.retired {
            let (to, member) = (retired.to & 15, retired.to >> 4);
            let home = Home::new(usize::from(retired.from), usize::from(member));
            retired.from = origin(&batch, home);
            retired.to = to;
        }
        let used = self.slots.used().max(allowed).clamp(1, K);
        self.groups = used.div_ceil(GROUP);
        self.commit.groups = self.groups;
        self.stage = Stage::Cluster(0);
    }

    /// Works out one of the clusters that change.
    #[inline(never)]
    fn cluster(&mut self, n: usize, settings: &Settings) -> Slice {
        let cluster = usize::from(self.commit.changed[n].cluster);
        let members = &self.slots.clusters[cluster];
        let solved = if members.iter().all(Option::is_none) {
            Solved::empty()
        } else {
            solve(members, self.coupling, self.births.step)
        };
        let there = members.iter().flatten();
        let (radii, moment) = there.fold((0.0, 0.0), |(radii, moment), body| {
            (radii + body.radius, moment + body.radius * body.place[0])
        });
        let middle = if radii > 0.0 { moment / radii } else { 0.0 };
        let place = (0.5 + 0.5 * self.width * middle / settings.extent()).clamp(0.0, 1.0);
        self.peers[cluster] = Peer {
            yields: solved.yields,
            yields_most: solved.yields_most,
            radii,
            pan: [place, 1.0 - place].map(|place| cosine(0.25 * place)),
        };
        Slice::Cluster(n, solved.cluster)
    }

    /// Works out the core.
    #[inline(never)]
    fn core(&mut self) {
        let k = self.groups * GROUP;
        for p in 0..k {
            for q in 0..k {
                let radii = self.peers[p].radii * self.peers[q].radii;
                let near = self.coupling * self.slots.between(p, q);
                let here = p != q && radii > 0.0;
                self.core.between[p][q] = if here { near / radii } else { 0.0 };
            }
        }
        self.core.solve(&self.peers, k);
    }

    /// The next rows of the core; with the last ones the commit.
    fn rows(&mut self, first: usize, message: &mut Message) {
        let rows = self.groups * (self.groups * GROUP + 2);
        let end = rows.min(first + ROWS);
        let row = |n| self.core.row(&self.peers, self.groups, self.loudness, n);
        message.slice = Some(Slice::Core(first, (first..end).map(row).collect()));
        self.stage = Stage::Rows(end);
        if end == rows {
            message.commit = Some(self.commit.clone());
            self.stage = Stage::Rest;
        }
    }

    /// Pushes newborns that are there now, and others as the water does.
    #[inline(never)]
    fn push(&mut self, settings: &Settings, message: &mut Message) {
        if message.commit.is_some() {
            for place in core::mem::take(&mut self.newborn) {
                self.push_one(place, settings, message);
            }
        }
        for _ in 0..self.births.pushes(settings) {
            if message.forces.is_full() {
                break;
            }
            let Some(place) = self.anybody() else { break };
            // While a cluster changes, the audio path still has the old one.
            let changes =
                (self.commit.changed.iter()).any(|changed| usize::from(changed.cluster) == place.0);
            if !changes || self.stage == Stage::Rest {
                self.push_one(place, settings, message);
            }
        }
    }

    fn push_one(&mut self, place: Place, settings: &Settings, message: &mut Message) {
        let Some(body) = self.slots.get(place) else {
            return;
        };
        let push = self.births.push(body, settings, STEPS_PER_TICK);
        // There is room: who asks has looked, or comes first.
        let _ = message.forces.push(force(place, &push));
    }
}

/// A push on the bubble at `place`.
pub fn force(place: Place, push: &Push) -> Force {
    Force {
        cluster: place.0 as u8,
        member: place.1 as u8,
        start: push.start,
        steps: push.steps,
        push: push.push,
        energy: push.energy,
    }
}

/// Where a bubble comes from, among those of the clusters that change.
#[inline(never)]
fn origin(batch: &Batch, home: Home) -> u8 {
    let place = home.place().and_then(|(cluster, member)| {
        let changed = (batch.iter()).position(|changed| usize::from(*changed) == cluster)?;
        Some((changed * MEMBERS + member) as u8)
    });
    place.unwrap_or(NOBODY)
}

const _: () = assert!(CHANGED <= FORCES);

fn add(batch: &mut Batch, cluster: usize) {
    if !batch.contains(&(cluster as u8)) {
        // There is room: callers change two at most.
        let _ = batch.push(cluster as u8);
    }
}

fn add_place(places: &mut heapless::Vec<Place, CHANGED>, place: Place) {
    let _ = places.push(place);
}

impl<const K: usize> Keep for Keeper<K> {
    fn start(&mut self, seed: u64, sample_rate: u32) {
        let sample_rate = f64::from(sample_rate);
        self.births = Births::new(Random::new(seed, Stream::Cloud), sample_rate);
        self.loudness = loudness(sample_rate);
        (self.coupling, self.width) = (1.0, 1.0);
    }

    fn tick(&mut self, settings: &Settings, message: &mut Message) {
        message.slice = None;
        message.commit = None;
        message.forces.clear();
        self.now = self.now.wrapping_add(1);
        self.untidy = self.untidy.saturating_add(1);
        let quiet = settings.rate == 0.0 && settings.pushes == 0.0;
        self.idle = if quiet {
            self.idle.saturating_add(1)
        } else {
            0
        };
        let forgotten = Settings {
            bubbles: 0,
            ..*settings
        };
        let settings = if self.idle > FORGOTTEN {
            &forgotten
        } else {
            settings
        };
        let due = self.births.due(settings);
        self.waiting = (self.waiting + due).min(WAITING);
        if settings.depth != self.depth {
            self.deaf = K * MEMBERS;
            self.depth = settings.depth;
        }
        if self.stale == 0 && [settings.coupling, settings.width] != [self.coupling, self.width] {
            self.stale = K;
            self.coupling += (settings.coupling - self.coupling).clamp(-GENTLY, GENTLY);
            self.width = settings.width;
        }
        let decides = self.stage == Stage::Rest;
        if decides {
            self.decide(settings);
        }
        match self.stage {
            Stage::Rest => {}
            // To decide is enough for a tick.
            _ if decides => {}
            Stage::Cluster(n) => {
                message.slice = Some(self.cluster(n, settings));
                let last = n + 1 == self.commit.changed.len();
                self.stage = if last {
                    Stage::Core
                } else {
                    Stage::Cluster(n + 1)
                };
            }
            Stage::Core => {
                self.core();
                self.rows(0, message);
            }
            Stage::Rows(first) => self.rows(first, message),
        }
        self.push(settings, message);
    }
}
