//! What is to be sent: only what changed, and no more of it than a line can carry.

use std::collections::VecDeque;

use freshet::param::TABLE;
use freshet::protocol::{PAIRS, Pair, Slot};

/// One thing that the instrument is asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Move parameters, in so many seconds or in the time the table gives.
    Set(Vec<Pair>, Option<f32>),
    /// Play a scene.
    Scene(String),
    /// Sound a bubble.
    Trigger,
    /// Silence, and back.
    Mute(bool),
    /// Keep the settings.
    Store(Slot, String),
    /// Go back to what was kept.
    Recall(Slot),
    /// Forget what was kept.
    Erase(Slot),
}

/// Orders on their way, in order.
#[derive(Clone, Debug, Default)]
pub struct Outbox {
    orders: VecDeque<Order>,
}

impl Outbox {
    /// Moves one parameter; what was to become of it before is not sent any more.
    pub fn set(&mut self, index: usize, value: f32, ramp: Option<f32>) {
        let id = TABLE[index].id;
        if let Some(Order::Set(pairs, same)) = self.orders.back_mut()
            && *same == ramp
        {
            pairs.retain(|pair| pair.0 != id);
            pairs.push((id, value));
        } else {
            (self.orders).push_back(Order::Set(vec![(id, value)], ramp));
        }
    }

    /// Anything else. A scene or a preset takes the place of all parameters that still wait.
    pub fn push(&mut self, order: Order) {
        if matches!(order, Order::Scene(_) | Order::Recall(_)) {
            (self.orders).retain(|order| !matches!(order, Order::Set(..) | Order::Scene(_)));
        }
        self.orders.push_back(order);
    }

    /// The next one, with at most as many parameters as go into a message.
    pub fn take(&mut self) -> Option<Order> {
        let order = self.orders.pop_front()?;
        match order {
            Order::Set(mut pairs, ramp) if pairs.len() > PAIRS => {
                let rest = pairs.split_off(PAIRS);
                self.orders.push_front(Order::Set(rest, ramp));
                Some(Order::Set(pairs, ramp))
            }
            order => Some(order),
        }
    }

    /// Whether nothing waits.
    pub fn is_empty(&self) -> bool {
        self.orders.is_empty()
    }

    /// Nobody is there to take it.
    pub fn clear(&mut self) {
        self.orders.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use freshet::param;

    #[test]
    fn only_the_last_value_is_sent_and_24_at_a_time() {
        let mut outbox = Outbox::default();
        for n in 0..100 {
            outbox.set(param::RATE, n as f32, None);
        }
        for k in 0..50 {
            outbox.set(param::WEIGHT + k, 0.5, None);
        }
        let mut sent = Vec::new();
        while let Some(Order::Set(pairs, None)) = outbox.take() {
            assert!(pairs.len() <= PAIRS);
            sent.extend(pairs);
        }
        assert_eq!(sent.len(), 51);
        assert_eq!(sent[0], (101, 99.0));
        assert!(outbox.is_empty());
    }

    #[test]
    fn the_order_of_what_depends_on_it_is_kept() {
        let mut outbox = Outbox::default();
        outbox.set(param::RATE, 1.0, None);
        outbox.push(Order::Mute(true));
        outbox.push(Order::Scene("surf".to_owned()));
        outbox.set(param::INTENSITY, 0.3, Some(0.0));
        outbox.set(param::RATE, 2.0, Some(0.0));
        outbox.set(param::INTENSITY, 0.4, Some(0.0));
        assert_eq!(outbox.take(), Some(Order::Mute(true)));
        assert_eq!(outbox.take(), Some(Order::Scene("surf".to_owned())));
        let set = Order::Set(vec![(101, 2.0), (1, 0.4)], Some(0.0));
        assert_eq!(outbox.take(), Some(set));
        assert_eq!(outbox.take(), None);
    }
}
