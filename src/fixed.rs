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

/// Sine of `phase` (2^32 to the turn), Q31, within 5e-6 of full scale.
#[inline(always)]
pub fn sine(phase: u32) -> i32 {
    let [value, growth] = SINE[(phase >> 22) as usize];
    value + mul_high_down(growth, ((phase << 9) & 0x7fff_ffff) as i32)
}

/// Sine and cosine of `phase`, Q31, within 5e-6 of full scale: the nearest entry, turned by the small rest.
#[inline(always)]
pub fn sine_cosine(phase: u32) -> (i32, i32) {
    let near = phase.wrapping_add(1 << 21);
    let i = (near >> 22) as usize;
    let (s, c) = (SINE[i][0], SINE[(i + 256) & 1023][0]);
    // The rest in radians, Q32.
    let rest = phase.wrapping_sub(near & !0x003f_ffff) as i32;
    let angle = mul_high(rest << 4, TWO_PI);
    (s + mul_high(angle, c), c - mul_high(angle, s))
}

/// 2π, Q28.
const TWO_PI: i32 = 1_686_629_713;

/// Cosine of so many turns, from 0 to 1, for the control path; within 5e-6.
pub fn cosine(turns: f32) -> f32 {
    const TURN: f32 = (1u64 << 32) as f32;
    let (_, cosine) = sine_cosine((turns * TURN) as u32);
    cosine as f32 / (1u32 << 31) as f32
}

/// `-log2(n / 2^32)`, Q26, within 3e-6; 0 is taken as 1.
#[inline(always)]
pub fn neg_log2(n: u32) -> u32 {
    let n = n | 1;
    let zeros = n.leading_zeros();
    let mantissa = n << zeros;
    let i = (mantissa >> 23 & 0xff) as usize;
    let t = mantissa & 0x7f_ffff;
    let low = LOG2[i];
    let log = low + (((LOG2[i + 1] - low) as u64 * t as u64) >> 23) as u32;
    ((zeros + 1) << 26) - log
}

/// `2^-x` for `x` in Q20, as Q31, within 1e-6 relative.
#[inline(always)]
pub fn exp2_neg(x: u32) -> u32 {
    let whole = (x >> 20).min(31);
    let i = (x >> 12 & 0xff) as usize;
    let high = EXP2[i];
    let drop = (u64::from(high - EXP2[i + 1]) * u64::from(x & 0xfff)) >> 12;
    (high - drop as u32) >> whole
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
