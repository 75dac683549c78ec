//! How a slider moves along a parameter's curve, and how its value is written.

use freshet::param::{Curve, Kind, Param};

/// How far a key or a wheel turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// A tenth of a usual step.
    Fine,
    /// Some hundred of them go over the whole range.
    Usual,
    /// Ten usual ones.
    Coarse,
}

/// Usual steps a decade of a logarithmic slider.
const PER_DECADE: f32 = 40.0;

/// Where `value` is between the ends of the slider, from 0 to 1.
pub fn position(param: &Param, value: f32) -> f32 {
    let x = match param.curve {
        Curve::Linear => (value - param.min) / (param.max - param.min),
        Curve::Log(least) => {
            let log = |v: f32| v.max(least).ln();
            (log(value) - log(param.min)) / (log(param.max) - log(param.min))
        }
    };
    if x.is_finite() {
        x.clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// The value at `x` of the way, as round as a slider may be read.
pub fn value_at(param: &Param, x: f32) -> f32 {
    let value = param.between(param.min, param.max, x);
    let value = match (param.kind, param.curve) {
        (Kind::Whole | Kind::Choice(_), _) => value,
        (Kind::Real, Curve::Linear) => to_multiple(value, unit_step(param) / 2.0),
        (Kind::Real, Curve::Log(_)) => to_digits(value, 3),
    };
    value.clamp(param.min, param.max)
}

/// `value` turned by so many steps up or down.
pub fn turned(param: &Param, value: f32, step: Step, count: i32) -> f32 {
    let turned = match (param.kind, param.curve) {
        (Kind::Choice(_), _) => value + count as f32,
        (Kind::Whole, _) => value + (count * if step == Step::Coarse { 10 } else { 1 }) as f32,
        (Kind::Real, Curve::Linear) => {
            let size = unit_step(param) * factor(step);
            to_multiple(value + size * count as f32, size.min(unit_step(param)))
        }
        (Kind::Real, Curve::Log(least)) => {
            let decades = factor(step) * count as f32 / PER_DECADE;
            match (value < least, count > 0) {
                (true, true) => least,
                (true, false) => param.min,
                (false, _) => {
                    let turned = value * 10_f32.powf(decades);
                    if turned < least * 0.999 && value > least * 1.001 {
                        least
                    } else if turned < least * 0.999 {
                        param.min
                    } else {
                        let digits = if step == Step::Fine { 4 } else { 3 };
                        to_digits(turned, digits)
                    }
                }
            }
        }
    };
    turned.clamp(param.min, param.max)
}

fn factor(step: Step) -> f32 {
    match step {
        Step::Fine => 0.1,
        Step::Usual => 1.0,
        Step::Coarse => 10.0,
    }
}

/// A round hundredth of a linear slider's range, or a bit more.
fn unit_step(param: &Param) -> f32 {
    let hundredth = (param.max - param.min) / 100.0 * 0.99;
    let decade = 10_f32.powf(hundredth.log10().floor());
    let of = [1.0, 2.0, 5.0, 10.0].into_iter();
    let mut steps = of.map(|m| m * decade);
    let fits = steps.find(|step| *step >= hundredth * 0.75);
    fits.unwrap_or(hundredth)
}

fn to_multiple(value: f32, of: f32) -> f32 {
    let (value, of) = (f64::from(value), f64::from(of));
    let count = (value / of).round();
    // Divided where that is exact: steps are 1, 2 or 5, halves of them, and decimals.
    if of < 1.0 {
        (count / (1.0 / of).round()) as f32
    } else {
        (count * (of * 2.0).round() / 2.0) as f32
    }
}

fn to_digits(value: f32, digits: i32) -> f32 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let value = f64::from(value);
    let unit = 10_f64.powi(value.abs().log10().floor() as i32 + 1 - digits);
    // Divided, not multiplied, where the unit is below 1: the decimal nearest to it.
    if unit < 1.0 {
        let per = (1.0 / unit).round();
        ((value * per).round() / per) as f32
    } else {
        ((value / unit).round() * unit) as f32
    }
}

/// The value as people read it, without its unit: a choice by its name, a number in four digits.
pub fn shown(param: &Param, value: f32) -> String {
    if let Kind::Choice(names) = param.kind {
        return names.get(value as usize).unwrap_or(&"?").to_string();
    }
    number(value)
}

/// A number in four digits.
pub fn number(value: f32) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 {
            "0".to_owned()
        } else {
            value.to_string()
        };
    }
    let whole = f64::from(value).abs().log10().floor() as i32 + 1;
    let decimals = (4 - whole).clamp(0, 7) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// The same with the unit.
pub fn shown_with_unit(param: &Param, value: f32) -> String {
    let text = shown(param, value);
    if param.unit.is_empty() {
        text
    } else {
        format!("{text} {}", param.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use freshet::param::{self, TABLE};

    #[test]
    fn a_slider_goes_where_it_is_put_and_says_where_it_is() {
        for param in &TABLE {
            for n in 0..=40 {
                let x = n as f32 / 40.0;
                let value = value_at(param, x);
                assert!(param.accepts(value), "{} {value}", param.path);
                let slack = match param.kind {
                    Kind::Real => 0.011,
                    Kind::Whole | Kind::Choice(_) => 0.51 / (param.max - param.min) + 0.001,
                };
                let back = position(param, value);
                assert!((back - x).abs() <= slack, "{} {x} {back}", param.path);
            }
            assert_eq!(value_at(param, 0.0), param.min);
            assert_eq!(value_at(param, 1.0), param.max);
        }
    }

    #[test]
    fn turning_moves_every_parameter_over_its_whole_range_and_stops_at_the_ends() {
        for param in &TABLE {
            for step in [Step::Fine, Step::Usual, Step::Coarse] {
                for sign in [1, -1] {
                    let (mut value, end) = match sign {
                        1 => (param.min, param.max),
                        _ => (param.max, param.min),
                    };
                    let mut turns = 0;
                    while value != end {
                        let next = turned(param, value, step, sign);
                        assert!(param.accepts(next), "{} {next}", param.path);
                        assert!(next != value, "{} stuck at {value} {step:?}", param.path);
                        value = next;
                        turns += 1;
                        assert!(turns < 4000, "{}", param.path);
                    }
                }
            }
        }
    }

    #[test]
    fn steps_are_round() {
        let level = &TABLE[param::LEVEL];
        assert_eq!(turned(level, 0.0, Step::Usual, 1), 1.0);
        assert_eq!(turned(level, 0.0, Step::Fine, -1), -0.1);
        assert_eq!(turned(level, -6.0, Step::Coarse, 1), 4.0);
        let rate = &TABLE[param::RATE];
        assert_eq!(turned(rate, 1000.0, Step::Usual, 1), 1060.0);
        assert_eq!(turned(rate, 0.0, Step::Usual, 1), 0.1);
        assert_eq!(turned(rate, 0.1, Step::Usual, -1), 0.0);
        let law = &TABLE[param::LAW];
        assert_eq!(turned(law, 1.0, Step::Usual, 1), 2.0);
        assert_eq!(turned(law, 2.0, Step::Coarse, 1), 2.0);
    }

    #[test]
    fn values_are_written_short_and_with_their_unit() {
        assert_eq!(
            shown_with_unit(&TABLE[param::RATE], 12_345.678),
            "12346 1/s"
        );
        assert_eq!(shown_with_unit(&TABLE[param::PRESSURE], 0.05), "0.05 Pa");
        assert_eq!(
            shown_with_unit(&TABLE[param::PRESSURE], 0.000_123_4),
            "0.0001234 Pa"
        );
        assert_eq!(shown(&TABLE[param::LAW], 2.0), "custom");
        assert_eq!(number(-6.5), "-6.5");
        assert_eq!(number(0.999_99), "1");
    }
}
