//! Runs code with the widest vectors this machine has.
//!
//! A closure would not do: the shim by which it is called is compiled for the narrowest. So what is to run wide is a type
//! with a [`Wide::run`] that is always inlined. Where multiply-adds are fused depends on the machine: two machines may differ
//! in the last bits.

pub use pulp::Simd;
use pulp::{Arch, WithSimd};

/// Something to run wide.
pub trait Wide {
    /// What comes of it.
    type Output;
    /// Runs it; has to be `#[inline(always)]`, as all that it calls in its loops.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

struct Op<W>(W);

impl<W: Wide> WithSimd for Op<W> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> W::Output {
        self.0.run(simd)
    }
}

/// Runs `work` wide.
pub fn wide<W: Wide>(work: W) -> W::Output {
    Arch::new().dispatch(Op(work))
}

/// A symmetric block times a vector; N divides by 16.
#[inline(always)]
pub fn block_times<S: Simd, const N: usize>(
    simd: S,
    block: &[[f32; N]; N],
    x: &[f32; N],
    out: &mut [f32; N],
) {
    let (columns, _) = S::as_simd_f32s(block.as_flattened());
    let (sums, _) = S::as_mut_simd_f32s(out);
    let width = sums.len();
    for (i, sum) in sums.iter_mut().enumerate() {
        // Four sums that do not wait for each other, by name: an array of them would lie in memory.
        let zero = simd.splat_f32s(0.0);
        let (mut a, mut b, mut c, mut d) = (zero, zero, zero, zero);
        for j in 0..N / 4 {
            let at = 4 * j * width + i;
            a = simd.mul_add_e_f32s(columns[at], simd.splat_f32s(x[4 * j]), a);
            b = simd.mul_add_e_f32s(columns[at + width], simd.splat_f32s(x[4 * j + 1]), b);
            c = simd.mul_add_e_f32s(columns[at + 2 * width], simd.splat_f32s(x[4 * j + 2]), c);
            d = simd.mul_add_e_f32s(columns[at + 3 * width], simd.splat_f32s(x[4 * j + 3]), d);
        }
        *sum = simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d));
    }
}

/// Sum of the products of two rows.
#[inline(always)]
pub fn dot<S: Simd, const N: usize>(simd: S, a: &[f32; N], b: &[f32; N]) -> f32 {
    let (a, _) = S::as_simd_f32s(a);
    let (b, _) = S::as_simd_f32s(b);
    let mut sum = simd.splat_f32s(0.0);
    for (a, b) in a.iter().zip(b) {
        sum = simd.mul_add_e_f32s(*a, *b, sum);
    }
    simd.reduce_sum_f32s(sum)
}

/// Begins where a cache line does: a vector that lies in two takes twice as long to load.
#[derive(Clone)]
#[repr(C, align(64))]
pub struct Aligned<T>(pub T);

/// Columns of 64 rows, each times its factor, summed.
#[inline(always)]
pub fn tile_times<S: Simd>(
    simd: S,
    columns: &[Aligned<[f32; 64]>],
    factors: &[f32],
    out: &mut [f32; 64],
) {
    let (out, _) = S::as_mut_simd_f32s(out);
    for (group, out) in out.as_chunks_mut::<4>().0.iter_mut().enumerate() {
        let zero = simd.splat_f32s(0.0);
        let (mut a, mut b, mut c, mut d) = (zero, zero, zero, zero);
        for (column, factor) in columns.iter().zip(factors) {
            let (rows, _) = S::as_simd_f32s(&column.0);
            let rows = &rows[4 * group..4 * group + 4];
            let factor = simd.splat_f32s(*factor);
            a = simd.mul_add_e_f32s(rows[0], factor, a);
            b = simd.mul_add_e_f32s(rows[1], factor, b);
            c = simd.mul_add_e_f32s(rows[2], factor, c);
            d = simd.mul_add_e_f32s(rows[3], factor, d);
        }
        *out = [a, b, c, d];
    }
}
