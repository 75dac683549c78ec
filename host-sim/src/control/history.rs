//! What can be undone: whole settings, one for each gesture.

use freshet::param::COUNT;

/// Most gestures that are kept.
const DEPTH: usize = 500;
/// A gesture goes on while it pauses no longer, s.
const PAUSE: f64 = 1.0;

/// Where everything stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The scene.
    pub scene: String,
    /// Every parameter, in the table's order.
    pub values: [f32; COUNT],
}

/// What a person does in one go: holding a key on one slider is one gesture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gesture {
    /// Turning or dragging one parameter.
    Turn(usize),
    /// Drawing in the histogram.
    Draw,
    /// Anything that stands for itself.
    Single,
}

/// Settings before each gesture, and those that were undone.
#[derive(Clone, Debug, Default)]
pub struct History {
    past: Vec<Settings>,
    future: Vec<Settings>,
    /// The gesture under way and when it last moved, s.
    under_way: Option<(Gesture, f64)>,
}

impl History {
    /// Notes that `before` is about to be changed by `gesture` at `now` seconds.
    pub fn note(&mut self, before: &Settings, gesture: Gesture, now: f64) {
        let goes_on = gesture != Gesture::Single
            && (self.under_way).is_some_and(|(last, at)| last == gesture && now - at < PAUSE);
        self.under_way = Some((gesture, now));
        if goes_on {
            return;
        }
        self.future.clear();
        if self.past.last() != Some(before) {
            self.past.push(before.clone());
            if self.past.len() > DEPTH {
                self.past.remove(0);
            }
        }
    }

    /// The next gesture begins, even if it is like the last.
    pub fn pause(&mut self) {
        self.under_way = None;
    }

    /// The settings before the last gesture, if there was one.
    pub fn undo(&mut self, now: &Settings) -> Option<Settings> {
        self.pause();
        let before = loop {
            // A gesture that came back to where it began is none.
            let before = self.past.pop()?;
            if before != *now {
                break before;
            }
        };
        self.future.push(now.clone());
        Some(before)
    }

    /// The settings before the last [`undo`](Self::undo).
    pub fn redo(&mut self, now: &Settings) -> Option<Settings> {
        self.pause();
        let after = self.future.pop()?;
        self.past.push(now.clone());
        Some(after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(value: f32) -> Settings {
        Settings {
            scene: "brook".to_owned(),
            values: [value; COUNT],
        }
    }

    #[test]
    fn a_held_key_is_one_gesture_and_a_pause_makes_two() {
        let mut history = History::default();
        for n in 0..10 {
            history.note(&settings(n as f32), Gesture::Turn(3), 0.05 * f64::from(n));
        }
        history.note(&settings(10.0), Gesture::Turn(3), 5.0);
        history.note(&settings(11.0), Gesture::Turn(4), 5.1);
        let now = settings(12.0);
        let before = history.undo(&now).unwrap();
        assert_eq!(before, settings(11.0));
        let earlier = history.undo(&before).unwrap();
        assert_eq!(earlier, settings(10.0));
        let first = history.undo(&earlier).unwrap();
        assert_eq!(first, settings(0.0));
        assert_eq!(history.undo(&first), None);
        assert_eq!(history.redo(&first), Some(settings(10.0)));
        assert_eq!(history.redo(&earlier), Some(settings(11.0)));
        assert_eq!(history.redo(&before), Some(now.clone()));
        assert_eq!(history.redo(&now), None);
    }

    #[test]
    fn what_is_new_ends_what_could_be_redone_and_old_gestures_are_let_go() {
        let mut history = History::default();
        history.note(&settings(0.0), Gesture::Single, 0.0);
        assert!(history.undo(&settings(1.0)).is_some());
        history.note(&settings(0.0), Gesture::Single, 0.1);
        assert_eq!(history.redo(&settings(2.0)), None);
        for n in 0..2 * DEPTH {
            history.note(&settings(n as f32), Gesture::Single, 1.0);
        }
        assert_eq!(history.past.len(), DEPTH);
    }
}
