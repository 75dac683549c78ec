//! Where wishes wait for the board. However fast they come, no more wait than there are parameters and [`COMMANDS`].

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use freshet::protocol::{PAIRS, Pair};

use super::wish::{Command, Move, Origin, Wish};

/// Most commands that wait; further ones are refused.
pub const COMMANDS: usize = 64;

/// Parameters to be moved; of each the last value only.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moves(BTreeMap<u16, Waiting>);

#[derive(Clone, Copy, Debug, PartialEq)]
struct Waiting {
    last: Move,
    /// What came together goes together.
    group: u64,
    origin: Origin,
}

/// One request: parameters that move at the same frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// At most [`PAIRS`].
    pub values: Vec<Pair>,
    /// See [`Move::ramp`].
    pub ramp: Option<f32>,
    /// Who wanted the last of them.
    pub origin: Origin,
}

impl Moves {
    fn put(&mut self, last: Move, group: u64, origin: Origin) {
        let waiting = Waiting {
            last,
            group,
            origin,
        };
        self.0.insert(last.id, waiting);
    }

    /// Adds later ones, which win.
    pub fn follow(&mut self, later: Self) {
        self.0.extend(later.0);
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// As few requests as may be. What came together is in one, where it fits and has one ramp.
    pub fn batches(&self) -> Vec<Batch> {
        let mut waiting: Vec<&Waiting> = self.0.values().collect();
        let ramp = |waiting: &Waiting| waiting.last.ramp.map(f32::to_bits);
        waiting.sort_by_key(|waiting| (waiting.group, ramp(waiting)));
        let mut batches: Vec<Batch> = Vec::new();
        for together in waiting.chunk_by(|a, b| (a.group, ramp(a)) == (b.group, ramp(b))) {
            let mut values = together
                .iter()
                .map(|waiting| (waiting.last.id, waiting.last.value));
            let (first, origin) = (together[0].last.ramp, together[0].origin);
            let fits = |batch: &&mut Batch| {
                batch.ramp == first && batch.values.len() + together.len() <= PAIRS
            };
            if let Some(batch) = batches.last_mut().filter(fits) {
                batch.values.extend(values);
                batch.origin = origin;
                continue;
            }
            while values.len() > 0 {
                batches.push(Batch {
                    values: values.by_ref().take(PAIRS).collect(),
                    ramp: first,
                    origin,
                });
            }
        }
        batches
    }
}

/// What is done next.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Moves parameters.
    Moves(Moves),
    /// Does one thing.
    Command(Command, Origin),
    /// Nothing for now.
    Wait,
    /// Nothing any more.
    End,
}

#[derive(Default)]
struct Line {
    steps: VecDeque<Step>,
    commands: usize,
    groups: u64,
    closed: bool,
}

/// The waiting line.
#[derive(Default)]
pub struct Queue {
    line: Mutex<Line>,
    bell: Condvar,
}

impl Queue {
    fn line(&self) -> MutexGuard<'_, Line> {
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds what came together, in order; returns how many commands found no room.
    pub fn push(&self, wishes: impl IntoIterator<Item = Wish>, origin: Origin) -> usize {
        let mut line = self.line();
        let mut refused = 0;
        line.groups += 1;
        for wish in wishes {
            match wish {
                Wish::Move(last) => {
                    let group = line.groups;
                    if let Some(Step::Moves(moves)) = line.steps.back_mut() {
                        moves.put(last, group, origin);
                        continue;
                    }
                    // Between any two commands at most once.
                    let mut moves = Moves::default();
                    moves.put(last, group, origin);
                    line.steps.push_back(Step::Moves(moves));
                }
                Wish::Command(_) if line.commands == COMMANDS => refused += 1,
                Wish::Command(command) => {
                    line.commands += 1;
                    line.steps.push_back(Step::Command(command, origin));
                }
            }
        }
        drop(line);
        self.bell.notify_one();
        refused
    }

    /// Nothing comes any more.
    pub fn close(&self) {
        self.line().closed = true;
        self.bell.notify_one();
    }

    /// What is first in the line, within `timeout`; no moves before `moves_from`.
    pub fn next(&self, timeout: Duration, moves_from: Instant) -> Step {
        let until = Instant::now() + timeout;
        let mut line = self.line();
        loop {
            let now = Instant::now();
            let end = match line.steps.front() {
                Some(Step::Moves(_)) if now < moves_from => until.min(moves_from),
                Some(_) => {
                    let step = line.steps.pop_front().unwrap_or(Step::Wait);
                    line.commands -= usize::from(matches!(step, Step::Command(..)));
                    return step;
                }
                None if line.closed => return Step::End,
                None => until,
            };
            if now >= until {
                return Step::Wait;
            }
            let waited = self
                .bell
                .wait_timeout(line, end.saturating_duration_since(now));
            line = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wish(id: u16, value: f32) -> Wish {
        let ramp = None;
        Wish::Move(Move { id, value, ramp })
    }

    fn now() -> Instant {
        Instant::now()
    }

    #[test]
    fn a_flood_of_moves_is_one_step_with_the_last_values() {
        let queue = Queue::default();
        for i in 0..100_000_u32 {
            assert_eq!(queue.push([wish((i % 3) as u16, i as f32)], None), 0);
        }
        let Step::Moves(moves) = queue.next(Duration::ZERO, now()) else {
            panic!("no moves")
        };
        let batches = moves.batches();
        assert_eq!(batches.len(), 1);
        let mut values = batches[0].values.clone();
        values.sort_by_key(|pair| pair.0);
        assert_eq!(values, [(0, 99_999.0), (1, 99_997.0), (2, 99_998.0)]);
        assert_eq!(queue.next(Duration::ZERO, now()), Step::Wait);
        queue.close();
        assert_eq!(queue.next(Duration::ZERO, now()), Step::End);
    }

    #[test]
    fn commands_keep_their_place_and_are_refused_where_too_many_wait() {
        let queue = Queue::default();
        let mut refused = 0;
        for i in 0..1000 {
            let scene = Wish::Command(Command::Mute(i % 2 == 0));
            refused += queue.push([wish(1, i as f32), scene, wish(1, 0.5 + i as f32)], None);
        }
        assert_eq!(refused, 1000 - COMMANDS);
        let mut steps = Vec::new();
        loop {
            match queue.next(Duration::ZERO, now()) {
                Step::Wait => break,
                step => steps.push(step),
            }
        }
        assert_eq!(steps.len(), 2 * COMMANDS + 1);
        assert!(matches!(
            &steps[1],
            Step::Command(Command::Mute(true), None)
        ));
        let Some(Step::Moves(last)) = steps.last() else {
            panic!("the last is no move")
        };
        assert_eq!(last.batches()[0].values, [(1, 999.5)]);
    }

    #[test]
    fn what_came_together_is_not_torn() {
        let mut moves = Moves::default();
        let put = |moves: &mut Moves, ids: std::ops::Range<u16>, group| {
            for id in ids {
                let (value, ramp) = (0.0, None);
                moves.put(Move { id, value, ramp }, group, None);
            }
        };
        put(&mut moves, 0..20, 1);
        put(&mut moves, 20..40, 2);
        put(&mut moves, 40..44, 3);
        put(&mut moves, 50..100, 4);
        let sizes: Vec<usize> = moves.batches().iter().map(|b| b.values.len()).collect();
        assert_eq!(sizes, [20, 24, 24, 24, 2]);
    }

    #[test]
    fn moves_wait_for_their_time() {
        let queue = Queue::default();
        queue.push([wish(1, 1.0)], None);
        let from = now() + Duration::from_millis(20);
        assert_eq!(queue.next(Duration::from_millis(1), from), Step::Wait);
        assert!(matches!(
            queue.next(Duration::from_secs(5), from),
            Step::Moves(_)
        ));
        assert!(now() >= from);
    }
}
