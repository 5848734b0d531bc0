//! Orders on their way: waiting for their border, and given back with what became of them.

use super::bound::KEPT;
use super::command::{Change, Fate, MAX_ORDERS, Order, RESERVED_ORDERS};
use std::collections::VecDeque;

/// Orders that wait, and orders that are done; in the order in which they came. Allocates nothing
/// after construction.
pub(super) struct CommandQueue {
    waiting: VecDeque<Order>,
    done: VecDeque<Order>,
}

impl CommandQueue {
    /// An empty queue with room for all that it may hold.
    pub fn new() -> Self {
        Self {
            waiting: VecDeque::with_capacity(MAX_ORDERS + RESERVED_ORDERS),
            done: VecDeque::with_capacity(MAX_ORDERS + RESERVED_ORDERS + KEPT),
        }
    }

    /// True if nothing waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// True if there is room for one more; some is reserved for orders that need nothing but the
    /// next border.
    pub fn has_room_for(&self, order: &Order) -> bool {
        let waits = order.from_seq != 0 || order.tag != 0;
        let room = if waits {
            MAX_ORDERS
        } else {
            MAX_ORDERS + RESERVED_ORDERS
        };
        self.waiting.len() + self.done.len() < room
    }

    /// True if an order that waits will make N this long.
    pub fn will_resize_to(&self, len: u64) -> bool {
        self.waiting.iter().any(|order| match order.change {
            Change::Tune {
                block_len,
                rows: Some(_),
                ..
            } => block_len == len,
            _ => false,
        })
    }

    /// Lets an order wait.
    pub fn push(&mut self, order: Order) {
        self.waiting.push_back(order);
    }

    /// The first order that is due.
    pub fn take_due(&mut self, is_due: impl Fn(&Order) -> bool) -> Option<Order> {
        let at = self.waiting.iter().position(is_due)?;
        self.waiting.remove(at)
    }

    /// Gives back undone the orders that `gone` picks.
    pub fn drop_all(&mut self, gone: impl Fn(&Order) -> bool) {
        while let Some(order) = self.take_due(&gone) {
            self.give_back(order, Fate::Dropped);
        }
    }

    /// Gives an order back with what became of it.
    pub fn give_back(&mut self, order: Order, fate: Fate) {
        self.done.push_back(order.with_fate(fate));
    }

    /// The next order that was given back.
    pub fn take_done(&mut self) -> Option<Order> {
        self.done.pop_front()
    }
}
