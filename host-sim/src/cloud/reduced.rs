//! The coupled step past dense N²: exact inside clusters, by a few moments between them.
//!
//! The cloud is cut into clusters of at most [`SIZE`] neighbours. Inside a cluster M̃ is kept as it is. Between two
//! clusters p and q it becomes `S_p·G_pq·S_qᵀ`, where S holds the moments √r·(1, x, y, z) of each bubble about its
//! cluster's middle: what a cluster is to others far away. G is the projection `Y_pᵀ·M_pq·Y_q` with `Y = M_pp⁻¹S`, S
//! being made orthonormal in M_pp⁻¹ first: the Galerkin approximation in the energy of each cluster, for which the whole
//! is positive definite whenever M̃ is, with at least half its least eigenvalue ([`HELD`]).
//!
//! The inverse is Woodbury's: `B⁻¹ − V·W·Vᵀ` with block inverses B⁻¹, `V = B⁻¹S̄`, and `W = I − (I + G̃)⁻¹` of K = 4k
//! rows, k the number of clusters. A solve costs `N·SIZE + 8N + K²` multiply-adds.
#![expect(
    clippy::needless_range_loop,
    reason = "rows of a fixed length, side by side: by index they read as the formulas do"
)]

use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};

use super::coupling::{Coupling, Kernel, Place};
use super::wide::{self, Aligned, Simd, Wide, block_times, tile_times, wide};

/// Most bubbles in a cluster, and the width of a block.
pub const SIZE: usize = 32;
/// Moments of a cluster.
pub const MOMENTS: usize = 4;
/// What is left of M̃'s least eigenvalue for certain.
pub const HELD: f64 = 0.5;
/// Rows of the core that are worked on together.
const TILE: usize = 64;
/// Clouds up to this many have their clusters mended by swaps, whose cost grows as N².
const REFINE: usize = 1024;
/// Rounds of swaps.
const SWEEPS: usize = 4;
/// Places left empty in a new cluster, on average.
const ROOM: usize = 4;

type Row = [f64; SIZE];
type Square = [Row; SIZE];
/// The same as it is solved with.
type Short = [f32; SIZE];
/// One row a moment.
type Moments = [Row; MOMENTS];

/// The bubbles of one cluster, side by side; empty places have no radius.
#[derive(Clone, Copy)]
struct Members {
    at: [Row; 3],
    radius: Row,
    depth: Row,
    extra: Row,
}

/// An approximate inverse of `M̃ + E`.
#[derive(Clone)]
pub struct Reduced {
    /// Which bubble stands at each place, [`SIZE`] places a cluster; `usize::MAX` where none does.
    order: Vec<usize>,
    /// B⁻¹ of each cluster, symmetric. In f32, as all below: speed is memory here, and rounding stays some 130 dB below
    /// what sounds, far nearer than the approximation.
    inverse: Vec<Aligned<[Short; SIZE]>>,
    /// V of each cluster.
    reach: Vec<[Short; MOMENTS]>,
    /// W in tiles of rows: for each tile, column after column.
    core: Vec<Aligned<[f32; TILE]>>,
    /// Columns of W.
    rows: usize,
    /// B⁻¹x.
    near: Vec<Short>,
    sums: Vec<f32>,
    answer: Vec<f32>,
}

/// The approximation before it is inverted.
struct Factors {
    order: Vec<usize>,
    members: Vec<Members>,
    /// B without E.
    mass: Vec<Square>,
    /// S, orthonormal in M_pp⁻¹.
    field: Vec<Moments>,
    /// G, K × K, its diagonal blocks empty.
    between: Mat<f64>,
}

impl Reduced {
    /// For bubbles at `places` with `extra` on the diagonal. `homes` says in which cluster each was before
    /// (`usize::MAX`: in none), or is empty.
    ///
    /// None if it is not positive definite, which only CB's kernel and the dipole can bring about.
    pub fn new(
        coupling: &Coupling,
        places: &[Place],
        extra: &[f64],
        homes: &[usize],
    ) -> Option<Self> {
        let groups = rehomed(coupling, places, homes).unwrap_or_else(|| clusters(coupling, places));
        let factors = wide(Build {
            coupling,
            places,
            extra,
            groups: &groups,
        })?;
        wide(Invert { factors })
    }

    /// The matrix this would be the inverse of, without E, in the order of `places`.
    pub fn matrix(coupling: &Coupling, places: &[Place]) -> Option<Mat<f64>> {
        let groups = clusters(coupling, places);
        let extra = vec![0.0; places.len()];
        let factors = wide(Build {
            coupling,
            places,
            extra: &extra,
            groups: &groups,
        })?;
        Some(factors.assembled(places.len()))
    }

    /// Which bubble stands at each place; `usize::MAX` where none does.
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    #[inline(always)]
    fn invert(factors: Factors) -> Option<Self> {
        let clusters = factors.members.len();
        let mut inverse = Vec::with_capacity(clusters);
        let mut reach = Vec::with_capacity(clusters);
        // L of SᵀB⁻¹S, lower, for each cluster.
        let mut scale = Vec::with_capacity(clusters);
        for p in 0..clusters {
            let mut block = factors.mass[p];
            for i in 0..SIZE {
                block[i][i] += factors.members[p].extra[i];
            }
            invert_block(&mut block)?;
            let field = &factors.field[p];
            // V = B⁻¹·S·L⁻ᵀ.
            let mut v = times(&block, field);
            let lower = triangle(field, &v);
            substitute(&lower, &mut v);
            inverse.push(Aligned(block.map(short)));
            reach.push(v.map(short));
            scale.push(lower);
        }
        let rows = clusters * MOMENTS;
        let padded = rows.next_multiple_of(TILE);
        let mut core = vec![Aligned([0.0f32; TILE]); padded / TILE * rows];
        if clusters > 1 {
            let mut inner = Mat::<f64>::identity(rows, rows);
            for q in 0..clusters {
                for p in q + 1..clusters {
                    // Lᵀ·G·L.
                    for a in 0..MOMENTS {
                        for b in 0..MOMENTS {
                            let mut sum = 0.0;
                            for m in a..MOMENTS {
                                for n in b..MOMENTS {
                                    sum += scale[p][m][a]
                                        * factors.between[(p * MOMENTS + m, q * MOMENTS + n)]
                                        * scale[q][n][b];
                                }
                            }
                            inner[(p * MOMENTS + a, q * MOMENTS + b)] = sum;
                        }
                    }
                }
            }
            let inverted = inner.llt(Side::Lower).ok()?.inverse();
            for tile in 0..padded / TILE {
                for j in 0..rows {
                    for i in 0..TILE.min(rows - tile * TILE) {
                        let row = tile * TILE + i;
                        let one = if row == j { 1.0 } else { 0.0 };
                        core[tile * rows + j].0[i] = (one - inverted[(row, j)]) as f32;
                    }
                }
            }
        }
        Some(Self {
            order: factors.order,
            inverse,
            reach,
            core,
            rows,
            near: vec![[0.0; SIZE]; clusters],
            sums: vec![0.0; padded],
            answer: vec![0.0; padded],
        })
    }

    /// `out = (M̃ + E)⁻¹·x`, both in the order of [`Self::order`]; `x` is 0 where no bubble stands.
    pub fn solve(&mut self, x: &[f64], out: &mut [f64]) {
        wide(Solve { of: self, x, out });
    }
}

struct Build<'a> {
    coupling: &'a Coupling,
    places: &'a [Place],
    extra: &'a [f64],
    groups: &'a [Vec<usize>],
}

impl Wide for Build<'_> {
    type Output = Option<Factors>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Option<Factors> {
        Factors::new(simd, self.coupling, self.places, self.extra, self.groups)
    }
}

struct Invert {
    factors: Factors,
}

impl Wide for Invert {
    type Output = Option<Reduced>;

    #[inline(always)]
    fn run<S: Simd>(self, _simd: S) -> Option<Reduced> {
        Reduced::invert(self.factors)
    }
}

struct Solve<'a> {
    of: &'a mut Reduced,
    x: &'a [f64],
    out: &'a mut [f64],
}

impl Wide for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Reduced {
            inverse,
            reach,
            core,
            rows,
            near,
            sums,
            answer,
            ..
        } = self.of;
        let (x, _) = self.x.as_chunks::<SIZE>();
        let (out, _) = self.out.as_chunks_mut::<SIZE>();
        for (p, ((x, near), block)) in x.iter().zip(&mut *near).zip(&*inverse).enumerate() {
            let x = short(*x);
            block_times(simd, &block.0, &x, near);
            for m in 0..MOMENTS {
                sums[p * MOMENTS + m] = wide::dot(simd, &reach[p][m], &x);
            }
        }
        if reach.len() > 1 {
            for (tile, answer) in answer.as_chunks_mut::<TILE>().0.iter_mut().enumerate() {
                let columns = &core[tile * *rows..(tile + 1) * *rows];
                tile_times(simd, columns, sums, answer);
            }
        }
        for (((out, near), reach), far) in out
            .iter_mut()
            .zip(near)
            .zip(reach)
            .zip(answer.as_chunks::<MOMENTS>().0)
        {
            for i in 0..SIZE {
                let mut sum = near[i];
                for m in 0..MOMENTS {
                    sum -= reach[m][i] * far[m];
                }
                out[i] = f64::from(sum);
            }
        }
    }
}

#[inline(always)]
fn short(row: Row) -> Short {
    let mut short = [0.0; SIZE];
    for i in 0..SIZE {
        short[i] = row[i] as f32;
    }
    short
}

impl Factors {
    #[inline(always)]
    fn new<S: Simd>(
        simd: S,
        coupling: &Coupling,
        places: &[Place],
        extra: &[f64],
        groups: &[Vec<usize>],
    ) -> Option<Self> {
        let mut order = vec![usize::MAX; groups.len() * SIZE];
        let mut all = Vec::with_capacity(groups.len());
        let mut mass = Vec::with_capacity(groups.len());
        let mut field = Vec::with_capacity(groups.len());
        let mut answer = Vec::with_capacity(groups.len());
        for (p, group) in groups.iter().enumerate() {
            order[p * SIZE..p * SIZE + group.len()].copy_from_slice(group);
            let members = Members::new(places, extra, group);
            let mut block = [[0.0; SIZE]; SIZE];
            for j in 0..group.len() {
                block[j] = column(coupling, &members, &members, j);
            }
            for (j, column) in block.iter_mut().enumerate() {
                column[j] = 1.0;
            }
            let mut inverse = block;
            invert_block(&mut inverse)?;
            // S orthonormal in M_pp⁻¹, and Y.
            let mut moments = moments(&members, group.len());
            let mut response = times(&inverse, &moments);
            let lower = triangle(&moments, &response);
            substitute(&lower, &mut moments);
            substitute(&lower, &mut response);
            answer.push(response);
            all.push(members);
            mass.push(block);
            field.push(moments);
        }
        let rows = groups.len() * MOMENTS;
        let mut between = Mat::zeros(rows, rows);
        let far = Far::new(coupling, places);
        let sources: Vec<Source> = all
            .iter()
            .zip(&answer)
            .map(|(members, answer)| far.source(members, answer))
            .collect();
        for q in 0..groups.len() {
            for p in q + 1..groups.len() {
                let felt = far.felt(simd, &sources[p], &sources[q], groups[q].len());
                for m in 0..MOMENTS {
                    for n in 0..MOMENTS {
                        let g = dot(&answer[p][m], &felt[n]);
                        between[(p * MOMENTS + m, q * MOMENTS + n)] = g;
                        between[(q * MOMENTS + n, p * MOMENTS + m)] = g;
                    }
                }
            }
        }
        Some(Self {
            order,
            members: all,
            mass,
            field,
            between,
        })
    }

    /// The matrix that is inverted, without E.
    fn assembled(&self, n: usize) -> Mat<f64> {
        let mut whole = Mat::zeros(n, n);
        for (at, &i) in self.order.iter().enumerate() {
            for (bt, &j) in self.order.iter().enumerate() {
                if i == usize::MAX || j == usize::MAX {
                    continue;
                }
                let (p, a, q, b) = (at / SIZE, at % SIZE, bt / SIZE, bt % SIZE);
                whole[(i, j)] = if p == q {
                    self.mass[p][b][a]
                } else {
                    let mut sum = 0.0;
                    for m in 0..MOMENTS {
                        for n in 0..MOMENTS {
                            sum += self.field[p][m][a]
                                * self.between[(p * MOMENTS + m, q * MOMENTS + n)]
                                * self.field[q][n][b];
                        }
                    }
                    sum
                };
            }
        }
        whole
    }
}

impl Members {
    fn new(places: &[Place], extra: &[f64], group: &[usize]) -> Self {
        let mut members = Self {
            at: [[0.0; SIZE]; 3],
            radius: [0.0; SIZE],
            depth: [0.0; SIZE],
            extra: [0.0; SIZE],
        };
        for (to, &from) in group.iter().enumerate() {
            let place = &places[from];
            for axis in 0..3 {
                members.at[axis][to] = place.at[axis];
            }
            members.radius[to] = place.radius;
            members.depth[to] = place.depth;
            members.extra[to] = extra[from];
        }
        members
    }
}

/// M̃ between the bubbles of `to` and number `j` of `from`; of a bubble with itself it means nothing.
#[inline(always)]
fn column(coupling: &Coupling, to: &Members, from: &Members, j: usize) -> Row {
    let at = [from.at[0][j], from.at[1][j], from.at[2][j]];
    let (radius, depth) = (from.radius[j], from.depth[j].max(0.0));
    let softness = coupling.epsilon * coupling.epsilon;
    let mut near = [0.0; SIZE];
    let mut product = [0.0; SIZE];
    let mut row = [0.0; SIZE];
    for i in 0..SIZE {
        let (x, y, z) = (
            to.at[0][i] - at[0],
            to.at[1][i] - at[1],
            to.at[2][i] - at[2],
        );
        product[i] = to.radius[i] * radius;
        near[i] = x * x + y * y + z * z;
    }
    match coupling.kernel {
        Kernel::Definite => {
            for i in 0..SIZE {
                near[i] += 0.5 * softness * (to.radius[i] * to.radius[i] + radius * radius);
            }
        }
        Kernel::Cb => {
            for i in 0..SIZE {
                // Empty places have no radius: without this they would divide by nothing.
                near[i] += softness * product[i] + f64::MIN_POSITIVE;
            }
        }
    }
    for i in 0..SIZE {
        row[i] = (product[i] / near[i]).sqrt();
    }
    if coupling.dipole {
        for i in 0..SIZE {
            row[i] -= (product[i] / (near[i] + 4.0 * to.depth[i].max(0.0) * depth)).sqrt();
        }
    }
    row
}

/// M̃ between clusters, in f32: plenty there, and far faster.
struct Far {
    /// Places are told from here, m.
    middle: [f64; 3],
    /// ε²
    softness: f32,
    by_product: bool,
    dipole: bool,
}

/// A cluster as others feel it.
struct Source {
    at: [[f32; SIZE]; 3],
    radius: [f32; SIZE],
    depth: [f32; SIZE],
    /// How much of each moment each bubble is.
    answer: [[f32; SIZE]; MOMENTS],
}

impl Far {
    fn new(coupling: &Coupling, places: &[Place]) -> Self {
        let count = places.len() as f64;
        Self {
            middle: [0, 1, 2]
                .map(|axis| places.iter().map(|place| place.at[axis]).sum::<f64>() / count),
            softness: (coupling.epsilon * coupling.epsilon) as f32,
            by_product: coupling.kernel == Kernel::Cb,
            dipole: coupling.dipole,
        }
    }

    fn source(&self, members: &Members, answer: &Moments) -> Source {
        let mut source = Source {
            at: [[0.0; SIZE]; 3],
            radius: [0.0; SIZE],
            depth: [0.0; SIZE],
            answer: [[0.0; SIZE]; MOMENTS],
        };
        for i in 0..SIZE {
            for axis in 0..3 {
                source.at[axis][i] = (members.at[axis][i] - self.middle[axis]) as f32;
            }
            source.radius[i] = members.radius[i] as f32;
            source.depth[i] = members.depth[i].max(0.0) as f32;
            for m in 0..MOMENTS {
                source.answer[m][i] = answer[m][i] as f32;
            }
        }
        source
    }

    /// What each bubble of `to` feels of each moment of the `count` bubbles of `from`.
    #[inline(always)]
    fn felt<S: Simd>(&self, simd: S, to: &Source, from: &Source, count: usize) -> [Row; MOMENTS] {
        let mut felt = [[0.0f32; SIZE]; MOMENTS];
        let [x, y, z] = [0, 1, 2].map(
            #[inline(always)]
            |axis| S::as_simd_f32s(&to.at[axis]).0,
        );
        let radius = S::as_simd_f32s(&to.radius).0;
        let depth = S::as_simd_f32s(&to.depth).0;
        let least = simd.splat_f32s(f32::MIN_POSITIVE);
        let half = simd.splat_f32s(0.5 * self.softness);
        let whole = simd.splat_f32s(self.softness);
        for i in 0..x.len() {
            let mut sums = [simd.splat_f32s(0.0); MOMENTS];
            for j in 0..count {
                let dx = simd.sub_f32s(x[i], simd.splat_f32s(from.at[0][j]));
                let dy = simd.sub_f32s(y[i], simd.splat_f32s(from.at[1][j]));
                let dz = simd.sub_f32s(z[i], simd.splat_f32s(from.at[2][j]));
                let other = simd.splat_f32s(from.radius[j]);
                let product = simd.mul_f32s(radius[i], other);
                let mut near = simd.mul_add_e_f32s(dx, dx, least);
                near = simd.mul_add_e_f32s(dy, dy, near);
                near = simd.mul_add_e_f32s(dz, dz, near);
                near = if self.by_product {
                    simd.mul_add_e_f32s(whole, product, near)
                } else {
                    let squares =
                        simd.mul_add_e_f32s(radius[i], radius[i], simd.mul_f32s(other, other));
                    simd.mul_add_e_f32s(half, squares, near)
                };
                let mut mass = simd.sqrt_f32s(simd.div_f32s(product, near));
                if self.dipole {
                    let depths = simd.mul_f32s(depth[i], simd.splat_f32s(4.0 * from.depth[j]));
                    let image = simd.div_f32s(product, simd.add_f32s(near, depths));
                    mass = simd.sub_f32s(mass, simd.sqrt_f32s(image));
                }
                for m in 0..MOMENTS {
                    let part = simd.splat_f32s(from.answer[m][j]);
                    sums[m] = simd.mul_add_e_f32s(mass, part, sums[m]);
                }
            }
            for m in 0..MOMENTS {
                S::as_mut_simd_f32s(&mut felt[m]).0[i] = sums[m];
            }
        }
        let mut wide = [[0.0; SIZE]; MOMENTS];
        for m in 0..MOMENTS {
            for i in 0..SIZE {
                wide[m][i] = f64::from(felt[m][i]);
            }
        }
        wide
    }
}

/// √r·(1, x, y, z) about the middle.
fn moments(members: &Members, count: usize) -> Moments {
    let mut moments = [[0.0; SIZE]; MOMENTS];
    let total: f64 = members.radius.iter().sum();
    for axis in 0..MOMENTS - 1 {
        let at = &members.at[axis];
        let middle = dot(at, &members.radius) / total;
        for i in 0..count {
            moments[axis + 1][i] = members.radius[i].sqrt() * (at[i] - middle);
        }
    }
    for i in 0..count {
        moments[0][i] = members.radius[i].sqrt();
    }
    moments
}

/// L of `SᵀA` = LLᵀ, lower; a moment that adds nothing to those before gets no row.
#[inline(always)]
fn triangle(moments: &Moments, answer: &Moments) -> [[f64; MOMENTS]; MOMENTS] {
    let mut lower = [[0.0; MOMENTS]; MOMENTS];
    for m in 0..MOMENTS {
        let whole = dot(&moments[m], &answer[m]);
        for n in 0..=m {
            let mut left = if n == m {
                whole
            } else {
                dot(&moments[m], &answer[n])
            };
            for k in 0..n {
                left -= lower[m][k] * lower[n][k];
            }
            if n < m {
                if lower[n][n] > 0.0 {
                    lower[m][n] = left / lower[n][n];
                }
            } else if left > 1e-8 * whole {
                lower[m][m] = left.sqrt();
            } else {
                lower[m] = [0.0; MOMENTS];
            }
        }
    }
    lower
}

/// `L⁻¹` times the rows; a row that L lacks becomes 0.
#[inline(always)]
fn substitute(lower: &[[f64; MOMENTS]; MOMENTS], rows: &mut Moments) {
    for m in 0..MOMENTS {
        let (done, rest) = rows.split_at_mut(m);
        for (n, done) in done.iter().enumerate() {
            for i in 0..SIZE {
                rest[0][i] -= lower[m][n] * done[i];
            }
        }
        let scale = if lower[m][m] > 0.0 {
            lower[m][m].recip()
        } else {
            0.0
        };
        for i in 0..SIZE {
            rest[0][i] *= scale;
        }
    }
}

#[inline(always)]
fn dot(a: &Row, b: &Row) -> f64 {
    let mut lanes = [0.0; 8];
    for i in 0..SIZE {
        lanes[i % 8] += a[i] * b[i];
    }
    ((lanes[0] + lanes[4]) + (lanes[1] + lanes[5]))
        + ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7]))
}

/// A symmetric block times a vector.
#[inline(always)]
fn apply(block: &Square, x: &Row) -> Row {
    let mut sum = [0.0; SIZE];
    for (column, x) in block.iter().zip(x) {
        for i in 0..SIZE {
            sum[i] += column[i] * x;
        }
    }
    sum
}

#[inline(always)]
fn times(block: &Square, moments: &Moments) -> Moments {
    let mut out = [[0.0; SIZE]; MOMENTS];
    for m in 0..MOMENTS {
        out[m] = apply(block, &moments[m]);
    }
    out
}

/// Inverts a symmetric block in place by Gauss and Jordan; none where it is not positive definite.
#[inline(always)]
fn invert_block(block: &mut Square) -> Option<()> {
    for p in 0..SIZE {
        let pivot = block[p][p];
        if pivot.is_nan() || pivot <= 1e-12 {
            return None;
        }
        let recip = pivot.recip();
        let row = block[p];
        for j in 0..SIZE {
            if j == p {
                continue;
            }
            let factor = block[j][p] * recip;
            for i in 0..SIZE {
                block[j][i] -= factor * row[i];
            }
            block[j][p] = -factor;
        }
        for i in 0..SIZE {
            block[p][i] = row[i] * recip;
        }
        block[p][p] = recip;
    }
    Some(())
}

/// The clusters of before, with those gone left out and each newcomer where it couples most and there is room; none
/// where a new cut is due.
fn rehomed(coupling: &Coupling, places: &[Place], homes: &[usize]) -> Option<Vec<Vec<usize>>> {
    let count = homes.iter().filter(|&&home| home != usize::MAX).count();
    let clusters = homes.iter().filter(|&&home| home != usize::MAX).max()? + 1;
    if 4 * count < 3 * places.len() || clusters * SIZE > places.len() * 3 / 2 + SIZE {
        return None;
    }
    let mut groups = vec![Vec::with_capacity(SIZE); clusters];
    for (i, &home) in homes.iter().enumerate() {
        if home != usize::MAX {
            groups[home].push(i);
        }
    }
    let mut pulls = vec![0.0; clusters];
    for (i, _) in homes
        .iter()
        .enumerate()
        .filter(|home| *home.1 == usize::MAX)
    {
        for (pull, group) in pulls.iter_mut().zip(&groups) {
            *pull = if group.len() < SIZE {
                let pull = |&j: &usize| coupling.between(&places[i], &places[j]).powi(2);
                group.iter().map(pull).sum()
            } else {
                -1.0
            };
        }
        let best = (0..clusters).max_by(|&a, &b| pulls[a].total_cmp(&pulls[b]))?;
        if groups[best].len() == SIZE {
            return None;
        }
        groups[best].push(i);
    }
    groups.retain(|group| !group.is_empty());
    Some(groups)
}

/// Clusters of neighbours, as even as can be: cut in two along the widest side until each fits, then mended by swaps.
fn clusters(coupling: &Coupling, places: &[Place]) -> Vec<Vec<usize>> {
    let mut groups = Vec::new();
    let mut all: Vec<usize> = (0..places.len()).collect();
    // With some room for those to come.
    let parts = if places.len() <= SIZE {
        1
    } else {
        places.len().div_ceil(SIZE - ROOM)
    };
    cut(places, &mut all, parts, &mut groups);
    if groups.len() > 1 && places.len() <= REFINE {
        refine(coupling, places, &mut groups);
    }
    groups
}

fn cut(places: &[Place], members: &mut [usize], parts: usize, groups: &mut Vec<Vec<usize>>) {
    if parts <= 1 {
        groups.push(members.to_vec());
        return;
    }
    let width = |axis: usize| {
        let along = || members.iter().map(|&i| places[i].at[axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let axis = (0..3)
        .max_by(|&a, &b| width(a).total_cmp(&width(b)))
        .unwrap_or(0);
    let left = parts / 2;
    let middle = (members.len() * left).div_ceil(parts);
    members.select_nth_unstable_by(middle.min(members.len() - 1), |&a, &b| {
        places[a].at[axis]
            .total_cmp(&places[b].at[axis])
            .then(a.cmp(&b))
    });
    let (near, far) = members.split_at_mut(middle);
    cut(places, near, left, groups);
    cut(places, far, parts - left, groups);
}

/// Swaps bubbles between clusters while that brings strong couplings inside.
fn refine(coupling: &Coupling, places: &[Place], groups: &mut [Vec<usize>]) {
    let n = places.len();
    let mut home = vec![0; n];
    for (p, group) in groups.iter().enumerate() {
        group.iter().for_each(|&i| home[i] = p);
    }
    // How strongly a bubble is drawn to each cluster: its couplings squared.
    let pull = |i: usize, j: usize| coupling.between(&places[i], &places[j]).powi(2);
    let k = groups.len();
    let mut drawn = vec![0.0; n * k];
    for i in 0..n {
        for j in 0..i {
            let w = pull(i, j);
            drawn[i * k + home[j]] += w;
            drawn[j * k + home[i]] += w;
        }
    }
    for _ in 0..SWEEPS {
        let mut changed = false;
        for i in 0..n {
            let p = home[i];
            let mut best = (1e-9, usize::MAX);
            for j in 0..n {
                let q = home[j];
                if q == p {
                    continue;
                }
                let gain =
                    drawn[i * k + q] - drawn[i * k + p] + drawn[j * k + p] - drawn[j * k + q];
                // The pair itself would stay apart; reckoned only where it may matter.
                if gain > best.0 {
                    let gain = gain - 2.0 * pull(i, j);
                    if gain > best.0 {
                        best = (gain, j);
                    }
                }
            }
            let j = best.1;
            if j == usize::MAX {
                continue;
            }
            let q = home[j];
            home.swap(i, j);
            for l in 0..n {
                let change =
                    if l == j { 0.0 } else { pull(l, j) } - if l == i { 0.0 } else { pull(l, i) };
                drawn[l * k + p] += change;
                drawn[l * k + q] -= change;
            }
            changed = true;
        }
        if !changed {
            break;
        }
    }
    groups.iter_mut().for_each(Vec::clear);
    for (i, &p) in home.iter().enumerate() {
        groups[p].push(i);
    }
}

#[cfg(test)]
mod tests {
    use faer::linalg::solvers::Solve as _;

    use super::super::synthetic::{Random, ball};
    use super::*;

    /// What is inverted is what the matrix says.
    fn check(count: usize) {
        let coupling = Coupling::default();
        let places = ball(count, 0.04, 0.5e-3, 3e-3, 7);
        let mut random = Random::new(1);
        let extra: Vec<f64> = places.iter().map(|_| random.between(-0.2, 1.0)).collect();
        let x: Vec<f64> = places.iter().map(|_| random.between(-1.0, 1.0)).collect();
        let mut whole = Reduced::matrix(&coupling, &places).unwrap();
        for (i, extra) in extra.iter().enumerate() {
            whole[(i, i)] += extra;
        }
        let right = Mat::from_fn(count, 1, |i, _| x[i]);
        let wanted = whole.llt(Side::Lower).unwrap().solve(right);
        let mut solver = Reduced::new(&coupling, &places, &extra, &[]).unwrap();
        let order = solver.order().to_vec();
        let spread: Vec<f64> = order
            .iter()
            .map(|&i| x.get(i).copied().unwrap_or(0.0))
            .collect();
        let mut out = vec![0.0; order.len()];
        solver.solve(&spread, &mut out);
        for (place, &i) in order.iter().enumerate() {
            if i != usize::MAX {
                let off = (out[place] - wanted[(i, 0)]).abs();
                assert!(off < 1e-5, "{count} bubbles: {off:.1e}");
            }
        }
    }

    #[test]
    fn it_inverts_the_matrix_it_stands_for() {
        for count in [1, 5, 16, 17, 64, 200] {
            check(count);
        }
    }

    #[test]
    fn newcomers_find_a_cluster_until_there_is_no_room() {
        let coupling = Coupling::default();
        let places = ball(60, 0.04, 0.5e-3, 3e-3, 7);
        let mut homes: Vec<usize> = (0..60).map(|i| i / 24).collect();
        homes[7] = usize::MAX;
        let groups = rehomed(&coupling, &places, &homes).unwrap();
        assert_eq!(groups.iter().map(Vec::len).sum::<usize>(), 60);
        homes[30..].fill(usize::MAX);
        assert!(rehomed(&coupling, &places, &homes).is_none());
    }
}
