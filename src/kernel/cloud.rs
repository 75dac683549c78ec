//! The inner loop of a cloud: all modes of all clusters go on, and what clusters do to each other.
//!
//! Twice the same, sample for sample: `portable` in plain Rust, and in assembly (`cloud.s`) where the processor has the
//! multiplications of a Cortex-M4.

/// Bubbles, and so modes, of a cluster.
pub const MEMBERS: usize = 8;
/// Clusters that the core takes at a time.
pub const GROUP: usize = 8;
/// Bits that a cluster's sum has more than its modes' accelerations.
pub const SUM_BITS: u32 = 11;

/// A mode of a cluster. The assembly knows where its words are.
///
/// One step: `v −= k·y + c·v − g·u`, `y += v`, with `u` what the other clusters press on this one with.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Mode {
    /// −k, Q29.
    pub spring: i32,
    /// −c, Q32.
    pub loss: i32,
    /// g, how it takes part in the cluster's sum, Q32.
    pub share: i32,
    /// y.
    pub place: i32,
    /// v, its lower word and its upper one, which is an eighth of a unit of y.
    pub speed: [u32; 2],
}

/// From modes to bubbles and back.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Shape {
    /// Orthogonal: bubble by mode, Q31.
    pub turn: [[i32; MEMBERS]; MEMBERS],
    /// What a mode's y is to the bubbles, Q31, and the inverse, Q23.
    pub gauge: [i32; MEMBERS],
    /// See `gauge`.
    pub inverse: [i32; MEMBERS],
}

/// Eight bubbles that hear each other at once. The assembly knows how long it is.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Cluster {
    /// How they swing.
    pub modes: [Mode; MEMBERS],
    /// Who swings in which.
    pub shape: Shape,
}

impl Cluster {
    /// Nobody, at rest.
    pub const REST: Self = Self {
        modes: [Mode {
            spring: 0,
            loss: 0,
            share: 0,
            place: 0,
            speed: [0; 2],
        }; MEMBERS],
        shape: Shape {
            turn: [[0; MEMBERS]; MEMBERS],
            gauge: [0; MEMBERS],
            inverse: [0; MEMBERS],
        },
    };
}

impl Mode {
    /// v, exactly.
    #[inline(always)]
    pub fn wide_speed(&self) -> i64 {
        (u64::from(self.speed[1]) << 32 | u64::from(self.speed[0])) as i64
    }

    /// Sets v.
    #[inline(always)]
    pub fn set_speed(&mut self, speed: i64) {
        self.speed = [speed as u32, (speed >> 32) as u32];
    }

    /// Its acceleration but for the other clusters, an eighth of a unit of y.
    #[inline(always)]
    pub fn pull(&self) -> i32 {
        let spring = mul_high(self.spring, self.place);
        spring.wrapping_add(mul_high(self.loss, self.speed[1] as i32))
    }
}

use crate::fixed::mul_high;

/// What a cluster's modes come to.
#[inline(always)]
pub fn sum(modes: &[Mode; MEMBERS]) -> i32 {
    let wide = modes.iter().fold(0i64, |sum, mode| {
        sum.wrapping_add(i64::from(mode.share) * i64::from(mode.pull()))
    });
    (wide >> (32 - SUM_BITS)) as i32
}

/// A row of the core: its words for one group of clusters.
pub type Row = [i32; GROUP];

/// What the kernel works on.
#[derive(Debug)]
pub struct Run<'a> {
    /// `GROUP` clusters for each of `groups`, then the one of bubbles that ring out.
    pub clusters: &'a mut [Cluster],
    /// Group by group, a row for each ear and for each cluster, Q32.
    pub core: &'a [Row],
    /// The sum of each cluster.
    pub sums: &'a mut [i32],
    /// What comes to each ear; what each cluster is pressed with.
    pub drive: &'a mut [i32],
    /// How loud bubbles that ring out are, as in the core.
    pub ring_out: i32,
    /// How many.
    pub groups: usize,
}

/// One sample of each ear for each of `out`, at the cloud's rate.
pub fn run(run: &mut Run, out: &mut [[i32; 2]]) {
    let clusters = run.groups * GROUP;
    assert!(run.clusters.len() > clusters && run.sums.len() > clusters);
    assert!(run.core.len() >= run.groups * (clusters + 2) && run.drive.len() > clusters + 2);
    if run.groups == 0 || out.is_empty() {
        return;
    }
    #[cfg(dsp)]
    assembly::run(run, out);
    #[cfg(not(dsp))]
    portable::run(run, out);
}

#[cfg(not(dsp))]
mod portable {
    use super::{GROUP, MEMBERS, Mode, Run, mul_high, sum};

    pub fn run(run: &mut Run, out: &mut [[i32; 2]]) {
        let rows = run.groups * GROUP + 2;
        for out in out {
            for group in 0..run.groups {
                let sums = &run.sums[group * GROUP..][..GROUP];
                let core = &run.core[group * rows..][..rows];
                for (drive, row) in run.drive.iter_mut().zip(core) {
                    let before = if group == 0 { 0 } else { *drive };
                    *drive = (sums.iter().zip(row)).fold(before, |drive, (sum, word)| {
                        drive.wrapping_add(mul_high(*sum, *word))
                    });
                }
            }
            let rest = mul_high(run.sums[rows - 2], run.ring_out);
            *out = [0, 1].map(|ear| run.drive[ear].wrapping_add(rest));
            let clusters = run.clusters.iter_mut().zip(&mut *run.sums);
            for ((cluster, total), drive) in clusters.zip(&run.drive[2..]).take(rows - 1) {
                for mode in &mut cluster.modes {
                    step(mode, *drive);
                }
                const { assert!(MEMBERS == 8) };
                *total = sum(&cluster.modes);
            }
        }
    }

    #[inline(always)]
    fn step(mode: &mut Mode, drive: i32) {
        let wide = |a: i32, b: i32| i64::from(a) * i64::from(b);
        let speed = mode.wide_speed();
        let speed = speed
            .wrapping_add(wide(mode.spring, mode.place))
            .wrapping_add(wide(mode.loss, (speed >> 32) as i32))
            .wrapping_add(wide(mode.share, drive));
        mode.set_speed(speed);
        mode.place = mode.place.wrapping_add((speed >> 32 << 3) as i32);
    }
}

#[cfg(dsp)]
#[allow(unsafe_code)]
mod assembly {
    use super::{Cluster, GROUP, MEMBERS, Mode, Row, Run};

    core::arch::global_asm!(include_str!("cloud.s"));

    // What the assembly takes for granted.
    const _: () = {
        assert!(MEMBERS == 8 && GROUP == 8);
        assert!(size_of::<Mode>() == 24 && size_of::<Cluster>() == 512);
    };

    unsafe extern "C" {
        fn freshet_cloud(
            clusters: *mut Cluster,
            core: *const Row,
            sums: *mut i32,
            drive: *mut i32,
            out: *mut [i32; 2],
            steps: usize,
            clusters_in_groups: usize,
            ring_out: i32,
        );
    }

    pub fn run(run: &mut Run, out: &mut [[i32; 2]]) {
        let clusters = run.groups * GROUP;
        // SAFETY: the assembly keeps to the procedure call standard and keeps nothing. It reads `groups` times
        // `clusters + 2` rows, reads and writes `clusters + 1` clusters and sums and `clusters + 3` words of `drive`:
        // `super::run` has looked whether there are as many, that there is at least one group, and one sample of `out`.
        unsafe {
            freshet_cloud(
                run.clusters.as_mut_ptr(),
                run.core.as_ptr(),
                run.sums.as_mut_ptr(),
                run.drive.as_mut_ptr(),
                out.as_mut_ptr(),
                out.len(),
                clusters,
                run.ring_out,
            );
        }
    }
}
