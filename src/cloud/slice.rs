//! What the control path hands to the cloud: a little in every tick, in force at once where a commit comes with it.

use heapless::Vec;

use crate::kernel::cloud::{Cluster, MEMBERS, Mode, Row};

/// Clusters that change together.
pub const CHANGED: usize = 2;
/// Rows of the core in a tick: all of 16 clusters.
pub const ROWS: usize = 36;
/// Bubbles that a tick pushes.
pub const FORCES: usize = 8;
/// Bubbles that ring out.
pub const RINGING_OUT: usize = MEMBERS;
/// As a source: a bubble at rest.
pub const NOBODY: u8 = u8::MAX;

/// A tick's news.
#[derive(Clone, Debug, Default)]
pub struct Message {
    /// Something to keep until the commit.
    pub slice: Option<Slice>,
    /// From here on it counts.
    pub commit: Option<Commit>,
    /// Bubbles to push.
    pub forces: Vec<Force, FORCES>,
}

/// Part of what comes.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there are two of them, for good")]
pub enum Slice {
    /// One of the clusters that change, at rest.
    Cluster(usize, Cluster),
    /// Rows of the core, from this one on.
    Core(usize, Vec<Row, ROWS>),
}

/// What changes at once.
#[derive(Clone, Debug, Default)]
pub struct Commit {
    /// Groups of clusters in use.
    pub groups: usize,
    /// Which clusters.
    pub changed: Vec<Changed, CHANGED>,
    /// What rings out from here on, on its own.
    pub retired: Vec<Retired, 2>,
}

/// Where a cluster's bubbles were.
#[derive(Clone, Copy, Debug)]
pub struct Changed {
    /// Which cluster.
    pub cluster: u8,
    /// For each bubble, its place among those of all that change, or 255: a bubble at rest.
    pub from: [u8; MEMBERS],
}

/// A bubble that nobody hears any more.
#[derive(Clone, Copy, Debug)]
pub struct Retired {
    /// Its place among those of all that change.
    pub from: u8,
    /// Its place among those that ring out.
    pub to: u8,
    /// How it rings, alone.
    pub mode: Mode,
    /// Its inverse gauge, Q23: see the kernel's `Shape`.
    pub inverse: i32,
}

/// A force that grows with the square of time (CB, after Czerski and Deane), and then ends.
#[derive(Clone, Copy, Debug)]
pub struct Force {
    /// On a bubble of this cluster,
    pub cluster: u8,
    /// in this place,
    pub member: u8,
    /// from this step of the tick on,
    pub start: u8,
    /// for so many steps.
    pub steps: u8,
    /// In the first of them, units of v.
    pub push: i32,
    /// The energy it brings at most, units of [`Cloud`](super::Cloud)'s.
    pub energy: f32,
}

impl Message {
    /// Nothing.
    pub const NONE: Self = Self {
        slice: None,
        commit: None,
        forces: Vec::new(),
    };

    /// Nothing any more.
    pub fn clear(&mut self) {
        self.slice = None;
        self.commit = None;
        self.forces.clear();
    }
}
