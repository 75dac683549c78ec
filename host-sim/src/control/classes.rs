//! The radius classes as a histogram: what each stands for, and how its bar is drawn.

use freshet::bubble::Bubble;
use freshet::param::{self, COUNT};

/// The value of `water.law` under which the weights count.
pub const CUSTOM: f32 = 2.0;
const POWER: f32 = 1.0;

/// How many classes there are.
pub fn count(values: &[f32; COUNT]) -> usize {
    (values[param::CLASSES] as usize).clamp(1, 64)
}

/// Radius of a class from 0 on, mm.
pub fn radius(values: &[f32; COUNT], class: usize) -> f32 {
    let (a, b) = (values[param::RADIUS_MIN], values[param::RADIUS_MAX]);
    let (least, most) = (a.min(b), a.max(b));
    let last = count(values) - 1;
    if last == 0 {
        return least;
    }
    least * (most / least).powf(class as f32 / last as f32)
}

/// Pitch of a class's bubbles, Hz.
pub fn pitch(values: &[f32; COUNT], class: usize) -> f32 {
    let bubble = Bubble::new(f64::from(radius(values, class)) * 1e-3);
    bubble.pitch() as f32
}

/// Births of a class next to those of others, from 0 to 1, under the law that holds.
pub fn weight(values: &[f32; COUNT], class: usize) -> f32 {
    match values[param::LAW] {
        CUSTOM => values[param::WEIGHT + class],
        POWER => (radius(values, class) / radius(values, 0)).powf(-values[param::GAMMA]),
        _ => 1.0,
    }
}

/// Height of a bar, from 0 to 1: the cube root, for a power law spans three decades.
pub fn height(weight: f32) -> f32 {
    weight.clamp(0.0, 1.0).cbrt()
}

/// The weight of a bar so high.
pub fn weight_at(height: f32) -> f32 {
    let weight = height.clamp(0.0, 1.0).powi(3);
    (weight * 1e4).round() / 1e4
}

/// The bars under a stroke from one point to another, each `(class, height)`.
pub fn stroke(from: (usize, f32), to: (usize, f32)) -> impl Iterator<Item = (usize, f32)> {
    let (a, b) = if from.0 <= to.0 {
        (from, to)
    } else {
        (to, from)
    };
    let span = (b.0 - a.0) as f32;
    // A stroke that stays in a bar ends where it ends.
    let at = move |class: usize| {
        if span == 0.0 {
            to.1
        } else {
            a.1 + (b.1 - a.1) * (class - a.0) as f32 / span
        }
    };
    (a.0..=b.0).map(move |class| (class, at(class)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use freshet::param::TABLE;

    #[test]
    fn classes_go_from_the_smallest_radius_to_the_largest() {
        let values = TABLE.each_ref().map(|param| param.default);
        assert_eq!(count(&values), 50);
        assert_eq!(radius(&values, 0), 0.3);
        assert!((radius(&values, 49) - 10.0).abs() < 1e-3);
        assert!((pitch(&values, 49) - 326.0).abs() < 10.0);
        assert_eq!(weight(&values, 0), 1.0);
        assert!((weight(&values, 49) - 0.0009).abs() < 1e-4);
    }

    #[test]
    fn a_quick_stroke_leaves_no_gap() {
        let bars: Vec<_> = stroke((5, 1.0), (1, 0.0)).collect();
        assert_eq!(bars, [(1, 0.0), (2, 0.25), (3, 0.5), (4, 0.75), (5, 1.0)]);
        assert_eq!(stroke((3, 0.1), (3, 0.7)).next(), Some((3, 0.7)));
    }

    #[test]
    fn a_bar_is_as_high_as_it_was_drawn() {
        for n in 0..=20 {
            let height = n as f32 / 20.0;
            assert!((super::height(weight_at(height)) - height).abs() < 0.03);
        }
    }
}
