//! What there is to measure of loops.

use realfft::RealFftPlanner;

/// Root of the mean square of all of them.
pub fn rms(sounds: &[Vec<f64>]) -> f64 {
    let count = sounds.iter().map(Vec::len).sum::<usize>().max(1);
    (sounds.iter().flatten().map(|x| x * x).sum::<f64>() / count as f64).sqrt()
}

/// Mean frequency by power of loops at `rate` Hz, Hz; 0 for silence.
pub fn centroid(sounds: &[Vec<f64>], rate: f64) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for sound in sounds.iter().filter(|sound| !sound.is_empty()) {
        let fft = RealFftPlanner::new().plan_fft_forward(sound.len());
        let mut spectrum = fft.make_output_vec();
        // PANIC: the lengths are the plan's own.
        fft.process(&mut sound.clone(), &mut spectrum)
            .expect("lengths of the plan");
        for (bin, x) in spectrum.iter().enumerate() {
            let power: f64 = x.norm_sqr();
            sum += power * bin as f64 * rate / sound.len() as f64;
            weight += power;
        }
    }
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// Correlation of two sounds of one length, at most 1.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let size = (product(a, a) * product(b, b)).sqrt();
    if size > 0.0 {
        product(a, b) / size
    } else {
        0.0
    }
}
