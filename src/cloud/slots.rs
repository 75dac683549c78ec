//! Who is in which cluster, and what is between clusters. Control path.
//!
//! Bubbles that hear each other most belong together: a newborn takes the best free place, and then one bubble may change
//! places with another. What is between two clusters is a sum of whole numbers, so that it stays exact as bubbles come and
//! go for ever.

use super::birth::Body;
use super::matrix::{Members, nearness};
use crate::kernel::cloud::MEMBERS;

/// Bits of the sums between clusters, m.
const NEAR_BITS: u32 = 30;
/// What two bubbles have to gain by changing places, sum of M_ij².
const WORTHWHILE: f32 = 0.005;

/// A place: cluster, and which of its members.
pub type Place = (usize, usize);

/// Who is where.
#[derive(Clone, Debug)]
pub struct Slots<const K: usize> {
    /// The members of each cluster.
    pub clusters: [Members; K],
    /// `Σ r_i·r_j·nearness` over the members of two clusters.
    near: [[i32; K]; K],
}

/// What a bubble is to each cluster: to its sums, and how much it belongs there (sum of M_ij²).
#[derive(Clone, Debug)]
pub struct Look<const K: usize> {
    near: [i32; K],
    belongs: [f32; K],
}

/// What two bubbles add to the sums.
#[inline(always)]
fn pair(a: &Body, b: &Body) -> (i32, f32) {
    let near = nearness(a, b);
    let radii = a.radius * b.radius;
    (
        (radii * near * (1u64 << NEAR_BITS) as f32) as i32,
        radii * near * near,
    )
}

/// The same, once.
#[inline(never)]
fn one_pair(a: &Body, b: &Body) -> (i32, f32) {
    pair(a, b)
}

impl<const K: usize> Slots<K> {
    /// Nobody.
    pub const NONE: Self = Self {
        clusters: [[None; MEMBERS]; K],
        near: [[0; K]; K],
    };

    /// All that are there.
    pub fn bodies(&self) -> impl Iterator<Item = (Place, &Body)> {
        let clusters = self.clusters.iter().enumerate();
        clusters.flat_map(|(cluster, members)| {
            let members = members.iter().enumerate();
            members.filter_map(move |(i, body)| Some(((cluster, i), body.as_ref()?)))
        })
    }

    /// Calls `f` with all that are there. The control path's loops are plain ones: chains of iterators take a board's
    /// flash, kilobytes each.
    fn each(&self, mut f: impl FnMut(Place, &Body)) {
        for (cluster, members) in self.clusters.iter().enumerate() {
            for (i, member) in members.iter().enumerate() {
                if let Some(body) = member {
                    f((cluster, i), body);
                }
            }
        }
    }

    /// How many are there.
    #[inline(never)]
    pub fn count(&self) -> usize {
        let mut count = 0;
        self.each(|_, _| count += 1);
        count
    }

    /// Clusters in use, but for empty ones after the others.
    #[inline(never)]
    pub fn used(&self) -> usize {
        let mut used = 0;
        self.each(|(cluster, _), _| used = cluster + 1);
        used
    }

    /// The one at `place`.
    pub fn get(&self, (cluster, member): Place) -> Option<&Body> {
        self.clusters.get(cluster)?.get(member)?.as_ref()
    }

    /// Who came first; of those that are not in the first `clusters`, if there are any.
    #[inline(never)]
    pub fn oldest(&self, clusters: usize, now: u32) -> Option<Place> {
        let mut oldest = None;
        let mut most = (false, 0);
        self.each(|place, body| {
            let age = (place.0 >= clusters, now.wrapping_sub(body.born));
            if oldest.is_none() || age > most {
                (oldest, most) = (Some(place), age);
            }
        });
        oldest
    }

    /// What is between two clusters, 1/m, over the product of their members' radii.
    pub fn between(&self, p: usize, q: usize) -> f32 {
        self.near[p][q] as f32 / (1u64 << NEAR_BITS) as f32
    }

    /// Whether `body` would stand inside another.
    #[inline(never)]
    pub fn overlaps(&self, body: &Body) -> bool {
        let mut overlaps = false;
        self.each(|_, other| {
            let [x, y, z] = [0, 1, 2].map(|i| body.place[i] - other.place[i]);
            let touch = body.radius + other.radius;
            overlaps |= x * x + y * y + z * z < touch * touch;
        });
        overlaps
    }

    #[inline(never)]
    fn look(&self, body: &Body) -> Look<K> {
        let mut look = Look {
            near: [0; K],
            belongs: [0.0; K],
        };
        let totals = look.near.iter_mut().zip(&mut look.belongs);
        for ((near, belongs), members) in totals.zip(&self.clusters) {
            for other in members.iter().flatten() {
                let (more, closer) = pair(body, other);
                *near += more;
                *belongs += closer;
            }
        }
        look
    }

    /// What the bubble at `place` hears of the others.
    pub fn look_around(&mut self, place: Place) -> Option<Look<K>> {
        let body = self.clusters[place.0][place.1].take()?;
        let look = self.look(&body);
        self.clusters[place.0][place.1] = Some(body);
        Some(look)
    }

    #[inline(never)]
    fn count_in(&mut self, cluster: usize, look: &Look<K>, sign: i32) {
        for (other, near) in look.near.iter().enumerate() {
            self.near[cluster][other] += sign * near;
            if other != cluster {
                self.near[other][cluster] += sign * near;
            }
        }
    }

    /// Takes out whoever is at `place`.
    #[inline(never)]
    pub fn take(&mut self, place: Place) -> Option<Body> {
        let body = self.clusters[place.0][place.1].take()?;
        let look = self.look(&body);
        self.count_in(place.0, &look, -1);
        Some(body)
    }

    /// Puts `body` into the free `place`.
    #[inline(never)]
    pub fn put(&mut self, place: Place, body: Body) -> Look<K> {
        let look = self.look(&body);
        self.put_looked(place, body, &look);
        look
    }

    #[inline(never)]
    fn put_looked(&mut self, place: Place, body: Body, look: &Look<K>) {
        self.count_in(place.0, look, 1);
        self.clusters[place.0][place.1] = Some(body);
    }

    /// Puts `body` where it belongs most, of the first `clusters` those with room. None if all are full.
    #[inline(never)]
    pub fn settle(&mut self, body: Body, clusters: usize) -> Option<(Place, Look<K>)> {
        let look = self.look(&body);
        let free = |cluster: usize| {
            let member = self.clusters[cluster].iter().position(Option::is_none)?;
            Some((cluster, member))
        };
        let best = (0..clusters.min(K)).filter_map(free);
        let place = best.reduce(|a, b| {
            if look.belongs[b.0] > look.belongs[a.0] {
                b
            } else {
                a
            }
        })?;
        self.put_looked(place, body, &look);
        Some((place, look))
    }

    /// Lets the bubble at `place`, which has had a `look` at the others, change places with one of the cluster that it
    /// belongs to, where both together belong there more. Returns where it is then.
    #[inline(never)]
    pub fn improve(&mut self, place: Place, look: &Look<K>, clusters: usize) -> Option<Place> {
        let home = place.0;
        let better = |a: usize, b: usize| {
            if look.belongs[b] > look.belongs[a] {
                b
            } else {
                a
            }
        };
        let to = (0..clusters.min(K)).reduce(better)?;
        let own = look.belongs[to] - look.belongs[home];
        if own < WORTHWHILE {
            return None;
        }
        let body = *self.get(place)?;
        let mut best: Option<(f32, usize)> = None;
        for (i, other) in self.clusters[to].iter().enumerate() {
            let gain = own
                + other
                    .as_ref()
                    .map_or(0.0, |other| self.gain(other, (to, i), place, &body));
            if gain > best.map_or(WORTHWHILE, |(gain, _)| gain) {
                best = Some((gain, i));
            }
        }
        let there = (to, best?.1);
        // Both out, then both in; of each other they have heard elsewhere.
        self.clusters[home][place.1] = None;
        self.count_in(home, look, -1);
        let mut look = look.clone();
        if let Some(other) = self.clusters[to][there.1].take() {
            let mut looked = self.look(&other);
            self.count_in(to, &looked, -1);
            let near = one_pair(&body, &other).0;
            look.near[to] -= near;
            self.put_looked(there, body, &look);
            looked.near[to] += near;
            self.put_looked(place, other, &looked);
        } else {
            self.put_looked(there, body, &look);
        }
        Some(there)
    }

    /// What it gains if `other` goes from its place to that of `body`, who goes to its.
    #[inline(never)]
    fn gain(&self, other: &Body, from: Place, to: Place, body: &Body) -> f32 {
        // What the two are to each other is counted with `body`, whom `other` leaves behind.
        self.belongs(other, to) - self.belongs(other, from) - one_pair(other, body).1
    }

    /// How much `body` belongs to a cluster without the member at `but`.
    #[inline(never)]
    fn belongs(&self, body: &Body, but: Place) -> f32 {
        let mut belongs = 0.0;
        for (i, member) in self.clusters[but.0].iter().enumerate() {
            if let Some(member) = member
                && i != but.1
            {
                belongs += one_pair(body, member).1;
            }
        }
        belongs
    }
}
