//! Runs code with the widest vectors this machine has.
//!
//! A closure would not do: the shim by which it is called is compiled for the narrowest. So what is to run wide is a type
//! with a [`Wide::run`] that is always inlined. No sum is reordered and no multiply-add fused: every width gives the same
//! bits.

use pulp::{Arch, Simd, WithSimd};

/// Something to run wide.
pub trait Wide {
    /// What comes of it.
    type Output;
    /// Runs it; has to be `#[inline(always)]`, as all that it calls in its loops.
    fn run(self) -> Self::Output;
}

struct Op<W>(W);

impl<W: Wide> WithSimd for Op<W> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> W::Output {
        self.0.run()
    }
}

/// Runs `work` wide.
pub fn wide<W: Wide>(work: W) -> W::Output {
    Arch::new().dispatch(Op(work))
}
