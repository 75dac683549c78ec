//! The pitches of a cloud and who pulsates in each: `K y = ω² M̃ y` (CB §4.2.3).

use anyhow::{Result, bail};
use faer::linalg::solvers::SelfAdjointEigen;
use faer::{Mat, Side};

use super::coupling::{Coupling, Kernel, Place};
use super::step::Tone;

/// One mode of a cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Pitch of its ringing, Hz: `√(ω² − b²)/2π`.
    pub hertz: f64,
    /// Decay rate b, 1/s, to first order in the damping.
    pub decay: f64,
    /// Volume pulsation of each bubble, the largest 1; the sign is the phase.
    pub pulsation: Vec<f64>,
}

/// The modes of a cloud with mass matrix `mass`, from low to high pitch.
///
/// # Errors
/// A mass matrix that is not positive definite: some motion would have no or negative mass and run away.
pub fn modes(mass: &Mat<f64>, radii: &[f64], tones: &[Tone]) -> Result<Vec<Mode>> {
    let eigen = compliance(mass, tones)?;
    let n = tones.len();
    let mut modes = Vec::with_capacity(n);
    // The largest 1/ω² is the lowest mode.
    for column in (0..n).rev() {
        let inverse = eigen.S()[column];
        let omega = inverse.recip().sqrt();
        // z = K^½·y with zᵀz = 1; yᵀM̃y is then 1/ω².
        let mut damping = 0.0;
        let mut pulsation = vec![0.0; n];
        for i in 0..n {
            let y = eigen.U()[(i, column)] / tones[i].omega0;
            damping += tones[i].beta * y * y;
            pulsation[i] = y * radii[i].sqrt();
        }
        let decay = damping / inverse;
        let largest = pulsation
            .iter()
            .copied()
            .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        pulsation.iter_mut().for_each(|v| *v /= largest);
        modes.push(Mode {
            hertz: (omega * omega - decay * decay).max(0.0).sqrt() / std::f64::consts::TAU,
            decay,
            pulsation,
        });
    }
    Ok(modes)
}

/// Only the pitches without damping, Hz, from low to high.
///
/// # Errors
/// As [`modes`].
pub fn frequencies(mass: &Mat<f64>, tones: &[Tone]) -> Result<Vec<f64>> {
    let values = scaled(mass, tones)
        .self_adjoint_eigenvalues(Side::Lower)
        .map_err(|_| anyhow::anyhow!("the eigenvalues of the cloud did not converge"))?;
    check(values.iter().copied())?;
    Ok(values
        .iter()
        .rev()
        .map(|inverse| inverse.recip().sqrt() / std::f64::consts::TAU)
        .collect())
}

/// Least eigenvalue of a mass matrix.
pub fn least_eigenvalue(mass: &Mat<f64>) -> f64 {
    let values = mass.self_adjoint_eigenvalues(Side::Lower);
    values
        .ok()
        .and_then(|values| values.first().copied())
        .unwrap_or(f64::NAN)
}

/// The mass matrix of a cloud, checked.
///
/// # Errors
/// One that is not positive definite, with what to do about it.
pub fn checked_matrix(coupling: &Coupling, places: &[Place]) -> Result<Mat<f64>> {
    let mass = coupling.matrix(places);
    if mass.llt(Side::Lower).is_err() {
        let least = format!(" (least eigenvalue {:.4})", least_eigenvalue(&mass));
        bail!("{}", refusal(coupling, &least));
    }
    Ok(mass)
}

/// Why a cloud is refused; `how` says more about its matrix, or nothing.
pub fn refusal(coupling: &Coupling, how: &str) -> String {
    let advice = match coupling.kernel {
        Kernel::Cb => {
            "CB's kernel holds only for similar radii or bubbles well apart: use --kernel definite, or a larger --epsilon"
        }
        Kernel::Definite => {
            "the depths are not those under one plane: correct depth_m, use a larger --epsilon, or leave out --dipole"
        }
    };
    format!(
        "the mass matrix is not positive definite{how}: some motion of the cloud would have \
         negative mass and grow without end. {advice}"
    )
}

/// `K^−½·M̃·K^−½`, whose eigenvalues are 1/ω².
fn scaled(mass: &Mat<f64>, tones: &[Tone]) -> Mat<f64> {
    let n = tones.len();
    Mat::from_fn(n, n, |i, j| {
        mass[(i, j)] / (tones[i].omega0 * tones[j].omega0)
    })
}

fn compliance(mass: &Mat<f64>, tones: &[Tone]) -> Result<SelfAdjointEigen<f64>> {
    let eigen = scaled(mass, tones)
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| anyhow::anyhow!("the eigenvalues of the cloud did not converge"))?;
    check((0..tones.len()).map(|i| eigen.S()[i]))?;
    Ok(eigen)
}

fn check(mut inverses: impl Iterator<Item = f64>) -> Result<()> {
    if !inverses.all(|inverse| inverse > 0.0) {
        bail!(
            "the mass matrix is not positive definite: some mode has no pitch (see `freshet modes`)"
        );
    }
    Ok(())
}
