//! Fixed point: the few operations and tables the audio path is made of.

include!(concat!(env!("OUT_DIR"), "/tables.rs"));

/// Bus units in a pascal at 1 m: the bus is Q26 and holds ±32 Pa.
pub const PASCAL: i32 = 1 << 26;
/// Pressure at 1 m that is digital full scale, Pa.
pub const FULL_SCALE_PA: i32 = 1;
/// Digital full scale in bus units.
pub const FULL_SCALE: i32 = FULL_SCALE_PA * PASCAL;
/// Largest pressure a single bubble may have, Pa.
pub const BUBBLE_MAX_PA: i32 = 8;
/// The part of all 4096 that [`ATTACK`] begins with.
pub const ATTACK_FIRST: usize = 4096 - ATTACK.len();

/// High word of the product, rounded to nearest (SMMULR).
#[inline(always)]
pub fn mul_high(a: i32, b: i32) -> i32 {
    ((i64::from(a) * i64::from(b) + (1 << 31)) >> 32) as i32
}

/// High word of the product, rounded down (SMMUL).
#[inline(always)]
pub fn mul_high_down(a: i32, b: i32) -> i32 {
    ((i64::from(a) * i64::from(b)) >> 32) as i32
}

/// High word of the unsigned product (UMULL).
#[inline(always)]
pub fn high(a: u32, b: u32) -> u32 {
    ((u64::from(a) * u64::from(b)) >> 32) as u32
}

/// Sine of `phase` (2^32 to the turn), Q28, within 5e-6 of full scale. No bit of the phase is masked off: the table's
/// lines are as they are at phase 0.
#[inline(always)]
pub fn sine(phase: u32) -> i32 {
    let [begin, growth] = SINE[(phase >> 22) as usize];
    begin + mul_high_down(growth, phase as i32)
}

/// An envelope (Q31, from 0.82 to 1) under the soft attack HF (39), Q26, within 1e-5.
#[inline(always)]
pub fn soft_attack(envelope: i32) -> i32 {
    let [begin, growth] = ATTACK[(envelope >> 19) as usize - ATTACK_FIRST];
    begin + mul_high_down(growth, envelope)
}

/// Sine and cosine of `phase`, Q30, within 5e-6 of full scale: the nearest entry, turned by the small rest.
#[inline(always)]
pub fn sine_cosine(phase: u32) -> (i32, i32) {
    /// 2π, Q22.
    const TWO_PI: i32 = 26_353_589;
    let [s, c] = SINE_COSINE[(phase.wrapping_add(1 << 21) >> 22) as usize];
    // The rest, that is the lower 22 bits with their sign, in radians, Q32.
    let angle = mul_high((phase << 10) as i32, TWO_PI);
    (s + mul_high(angle, c), c + mul_high(-angle, s))
}

/// Gains of both ears, Q31, from 8 random bits, the width (256: full) and where its left edge is, Q8.
#[inline(always)]
pub fn pan(draw: u32, width: i32, edge: i32) -> [u32; 2] {
    PAN[(((draw & 0xff) as i32 * width + edge) >> 8) as usize & 0xff]
}

/// Cosine of so many turns, from 0 to 1, for the control path; within 5e-6.
pub fn cosine(turns: f32) -> f32 {
    const TURN: f32 = (1u64 << 32) as f32;
    let (_, cosine) = sine_cosine((turns * TURN) as u32);
    cosine as f32 / (1u32 << 30) as f32
}

/// `-log2(n / 2^32)`, Q26, within 3e-6; 31.6 for 0.
#[inline(always)]
pub fn neg_log2(n: u32) -> u32 {
    let zeros = n.leading_zeros();
    let mantissa = (u64::from(n) << zeros) as u32;
    let [begin, growth] = NEG_LOG2[(mantissa >> 23 & 0xff) as usize];
    // The mantissa's highest bit is taken as a sign.
    let log = begin + mul_high_down(growth, mantissa as i32);
    (zeros << 26).wrapping_add_signed(log)
}

/// `2^-x` for `x` in Q20 and below 32, as Q31, within 1e-6 relative.
#[inline(always)]
pub fn exp2_neg(x: u32) -> u32 {
    let fraction = x << 12;
    let [begin, fall] = EXP2_NEG[(fraction >> 24) as usize];
    (begin - high(fall, fraction)) >> (x >> 20 & 31)
}

/// `(2^63 − 1) / divisor` for a divisor from 2^31 up, by two divisions of 32 bits: many times as fast as one of 64.
pub fn reciprocal(divisor: u32) -> u32 {
    let mut quotient = 0;
    let mut rest = i64::MAX as u64;
    for shift in [16, 0] {
        let divisor = u64::from(divisor) << shift;
        // At most three too small.
        let mut digit = (rest >> (16 + shift)) as u32 / ((divisor >> (16 + shift)) as u32 + 1);
        rest -= divisor * u64::from(digit);
        while rest >= divisor {
            rest -= divisor;
            digit += 1;
        }
        quotient = quotient << 16 | digit;
    }
    quotient
}

/// A number in `[-limit, limit]`, rounded and scaled by 2^`bits`, in an i32. NaN becomes 0.
pub fn to_fixed(value: f64, bits: i32) -> i32 {
    libm::round(libm::scalbn(value, bits)) as i32
}

/// A number from 0, rounded and scaled by 2^`bits`, in a u64. NaN and negatives become 0.
pub fn to_fixed_u64(value: f64, bits: i32) -> u64 {
    libm::round(libm::scalbn(value, bits)) as u64
}
