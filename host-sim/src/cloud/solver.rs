//! Whichever way the coupled step is solved.

use clap::ValueEnum;

use super::coupling::{Coupling, Place};
use super::dense::Cholesky;
use super::reduced::{self, Reduced};
use super::step::{Step, Tone};

/// How the coupled step is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Choice {
    /// Exactly, N² a sample
    Dense,
    /// Exact inside clusters, by moments between them
    Reduced,
}

/// Up to so many bubbles the coupling is solved exactly, in f64; from here on the other way is twice as fast.
pub const DENSE_UP_TO: usize = 32;

/// Where a matrix may be indefinite, it is tried whole up to so many bubbles; beyond, only as the reduced solver sees it.
const CHECKED_UP_TO: usize = 1024;

/// What a solver is made for.
#[derive(Clone, Copy, Debug)]
pub struct Method {
    /// Who hears whom.
    pub coupling: Coupling,
    /// None: by size.
    pub choice: Option<Choice>,
    /// Hz.
    pub rate: f64,
}

impl Method {
    /// A bubble's coefficients, such that every cloud this method solves is stable.
    pub fn step(&self, tone: &Tone) -> Step {
        Step::new(tone, self.rate, self.least())
    }

    /// What any of its matrices has as least eigenvalue, for certain or by check.
    fn least(&self) -> f64 {
        reduced::HELD * self.coupling.least_eigenvalue()
    }

    fn is_dense(&self, count: usize) -> bool {
        match self.choice {
            Some(Choice::Dense) => true,
            Some(Choice::Reduced) => false,
            None => count <= DENSE_UP_TO,
        }
    }
}

/// A bubble as a solver sees it.
#[derive(Clone, Copy, Debug)]
pub struct Member {
    /// Tells bubbles apart from one solver to the next.
    pub key: usize,
    /// Whatever the owner knows it by now.
    pub index: usize,
    /// Its place in the solver before; `usize::MAX` if it had none.
    pub was: usize,
    /// Where and how large.
    pub place: Place,
    /// Its coefficients.
    pub step: Step,
}

/// The same bubble, unchanged.
impl PartialEq for Member {
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key && self.place == other.place && self.step == other.step
    }
}

/// An inverse of `M̃ + E` for some members.
#[derive(Clone)]
pub struct Solver {
    /// Index of the member at each place; `usize::MAX` where none stands.
    order: Vec<usize>,
    members: Vec<Member>,
    kind: Kind,
}

#[derive(Clone)]
enum Kind {
    Dense(Cholesky),
    Reduced(Box<Reduced>),
}

/// The matrix of a cloud was not positive definite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Indefinite;

impl Solver {
    /// Of no bubble.
    pub fn empty() -> Self {
        Self {
            order: Vec::new(),
            members: Vec::new(),
            kind: Kind::Dense(Cholesky::empty()),
        }
    }

    /// For `members`, taking over from the solver before what it can.
    ///
    /// # Errors
    /// A matrix that is not positive definite, or for which the step would not be stable; never with the definite kernel
    /// and no dipole.
    pub fn after(before: &Self, method: &Method, members: Vec<Member>) -> Result<Self, Indefinite> {
        let coupling = &method.coupling;
        if !coupling.is_always_definite() && members.len() <= CHECKED_UP_TO {
            let bare = |i: usize, j: usize| {
                let (a, b) = (&members[i], &members[j]);
                if i == j {
                    1.0 + a.step.slack().min(0.0)
                } else {
                    coupling.between(&a.place, &b.place)
                }
            };
            Cholesky::new(members.len(), bare).ok_or(Indefinite)?;
        }
        if method.is_dense(members.len()) {
            return Self::dense(before, coupling, members).ok_or(Indefinite);
        }
        let places: Vec<Place> = members.iter().map(|member| member.place).collect();
        if !coupling.is_always_definite() {
            let slack: Vec<f64> = members.iter().map(|m| m.step.slack().min(0.0)).collect();
            Reduced::new(coupling, &places, &slack, &[]).ok_or(Indefinite)?;
        }
        let extra: Vec<f64> = members.iter().map(|member| member.step.extra).collect();
        let homes: Vec<usize> = match before.kind {
            Kind::Dense(_) => Vec::new(),
            Kind::Reduced(_) => members
                .iter()
                .map(|member| match member.was {
                    usize::MAX => usize::MAX,
                    was => was / reduced::SIZE,
                })
                .collect(),
        };
        let solver = Reduced::new(coupling, &places, &extra, &homes).ok_or(Indefinite)?;
        Ok(Self {
            order: solver.order().to_vec(),
            members,
            kind: Kind::Reduced(Box::new(solver)),
        })
    }

    fn dense(before: &Self, coupling: &Coupling, members: Vec<Member>) -> Option<Self> {
        let entry = |a: &Member, b: &Member| {
            if a.key == b.key {
                1.0 + a.step.extra
            } else {
                coupling.between(&a.place, &b.place)
            }
        };
        let (factor, members) = match before.updated(&members, entry) {
            Some(updated) => updated,
            None => {
                let factor = Cholesky::new(members.len(), |i, j| entry(&members[i], &members[j]))?;
                (factor, members)
            }
        };
        Some(Self {
            order: (0..members.len()).collect(),
            members,
            kind: Kind::Dense(factor),
        })
    }

    /// The factor brought up to date by rank one, and the members in its order; none where factoring anew is cheaper.
    fn updated(
        &self,
        members: &[Member],
        entry: impl Fn(&Member, &Member) -> f64,
    ) -> Option<(Cholesky, Vec<Member>)> {
        let Kind::Dense(factor) = &self.kind else {
            return None;
        };
        let wanted: std::collections::HashMap<usize, &Member> =
            members.iter().map(|member| (member.key, member)).collect();
        let stays = |member: &&Member| wanted.contains_key(&member.key);
        let kept = self.members.iter().filter(stays).count();
        let moved = self
            .members
            .iter()
            .filter(|member| wanted.get(&member.key).is_some_and(|now| **member != **now))
            .count();
        // A row costs about 3N² multiply-adds, all of them N³/6.
        let changes = members.len() - kept + self.members.len() - kept + 2 * moved;
        if changes * 12 > members.len() {
            return None;
        }
        let mut factor = factor.clone();
        let mut rows = self.members.clone();
        for at in (0..rows.len()).rev() {
            match wanted.get(&rows[at].key) {
                None => {
                    factor.remove(at);
                    rows.remove(at);
                }
                Some(now) if rows[at] != **now => {
                    rows[at] = **now;
                    let row: Vec<f64> = rows.iter().map(|other| entry(&rows[at], other)).collect();
                    factor.replace(at, &row)?;
                }
                Some(now) => rows[at] = **now,
            }
        }
        let known: std::collections::HashSet<usize> = rows.iter().map(|row| row.key).collect();
        for new in members.iter().filter(|member| !known.contains(&member.key)) {
            rows.push(*new);
            let row: Vec<f64> = rows.iter().map(|other| entry(new, other)).collect();
            factor.append(&row)?;
        }
        Some((factor, rows))
    }

    /// Whether it was made for just these.
    pub fn is_for(&self, members: &[Member]) -> bool {
        self.members == members
    }

    /// Takes over what their owner calls them now.
    pub fn renumber(&mut self, members: Vec<Member>) {
        self.members = members;
    }

    /// The member at each place, in the order that [`Self::solve`] takes; `None` where nobody stands.
    pub fn places(&self) -> impl ExactSizeIterator<Item = Option<&Member>> {
        self.order.iter().map(|&member| self.members.get(member))
    }

    /// Everyone it was made for.
    pub fn members(&self) -> &[Member] {
        &self.members
    }

    /// `out = (M̃ + E)⁻¹·x`, by places; x is 0 where nobody stands.
    pub fn solve(&mut self, x: &[f64], out: &mut [f64]) {
        match &mut self.kind {
            Kind::Dense(factor) => {
                out.copy_from_slice(x);
                factor.solve(out);
            }
            Kind::Reduced(reduced) => reduced.solve(x, out),
        }
    }
}
