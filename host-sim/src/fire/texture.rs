//! Writing a texture, read in place by [`freshet::texture`].

use anyhow::{Context, Result};
use freshet::bank;
use freshet::texture::{ENTRY, HEADER, MAGIC, Texture, VERSION};

/// One row: the sound of one speed.
#[derive(Clone, Debug, PartialEq)]
pub struct Loops {
    /// m/s.
    pub speed: f64,
    /// A loop for each receiver, Pa at 1 m, all of one length.
    pub sounds: Vec<Vec<f64>>,
}

/// The bytes of a texture whose loops last `seconds`. A row's largest sample is the largest number of `bits`.
///
/// # Errors
/// Rows that make no texture.
pub fn write(rows: &[Loops], seconds: f64, bits: u8) -> Result<Vec<u8>> {
    let variants = rows.first().map_or(0, |row| row.sounds.len());
    let mut table = Vec::new();
    let mut bodies = Vec::new();
    let start = HEADER + rows.len() * ENTRY;
    for row in rows {
        let samples = row.sounds.first().map_or(0, Vec::len);
        let scale = scale(row, bits);
        table.extend((row.speed as f32).to_le_bytes());
        table.extend(scale.to_le_bytes());
        table.extend(u32::try_from(samples)?.to_le_bytes());
        table.extend(u32::try_from(start + bodies.len())?.to_le_bytes());
        for x in row.sounds.iter().flatten() {
            // `as` keeps to the ends.
            let step = (x / f64::from(scale)).round();
            match bits {
                8 => bodies.push(step as i8 as u8),
                _ => bodies.extend((step as i16).to_le_bytes()),
            }
        }
        // The next one begins at a word.
        bodies.resize(bodies.len().next_multiple_of(4), 0);
    }
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend([bits / 8, u8::try_from(variants)?]);
    bytes.extend(u32::try_from(rows.len())?.to_le_bytes());
    bytes.extend((seconds as f32).to_le_bytes());
    bytes.extend(u32::try_from(start + bodies.len())?.to_le_bytes());
    let body = [table, bodies].concat();
    bytes.extend(bank::checksum(&bytes, &body).to_le_bytes());
    bytes.extend(body);
    Texture::open(&bytes).context("the texture cannot be read back")?;
    Ok(bytes)
}

/// Pascal a step of a sample.
fn scale(row: &Loops, bits: u8) -> f32 {
    let sounds = row.sounds.iter().flatten();
    let peak = sounds.fold(0.0_f64, |peak, x| peak.max(x.abs()));
    let steps = f64::from((1_i32 << (bits - 1)) - 1);
    // Silence has a scale, too.
    ((peak / steps) as f32).max(f32::MIN_POSITIVE)
}

/// Noise of the quantisation against the sound, dB, in the worst row.
pub fn quantisation_db(rows: &[Loops], bytes: &[u8]) -> Result<f64> {
    let texture = Texture::open(bytes)?;
    let mut worst = f64::NEG_INFINITY;
    for (i, row) in rows.iter().enumerate() {
        let kept = texture.row(i).context("a row is missing")?;
        let (mut noise, mut power) = (0.0, 0.0);
        for (variant, sound) in row.sounds.iter().enumerate() {
            let samples = kept.variant(variant).context("a variant is missing")?;
            for (at, x) in sound.iter().enumerate() {
                let step = samples.get(at).context("a sample is missing")?;
                noise += (f64::from(step) * f64::from(kept.scale) - x).powi(2);
                power += x * x;
            }
        }
        if power > 0.0 {
            worst = worst.max(10.0 * (noise / power).log10());
        }
    }
    Ok(worst)
}
