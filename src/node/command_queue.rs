//! Queue of orders: waiting for their border, or done and ready to be returned.

use super::bound::KEPT;
use super::command::{Change, Fate, MAX_ORDERS, Order, RESERVED_ORDERS};
use std::collections::VecDeque;

/// Waiting orders and finished ones, each in order of arrival. Allocates nothing after
/// construction.
pub(super) struct CommandQueue {
    waiting: VecDeque<Order>,
    done: VecDeque<Order>,
}

impl CommandQueue {
    /// An empty queue with its full capacity.
    pub fn new() -> Self {
        Self {
            waiting: VecDeque::with_capacity(MAX_ORDERS + RESERVED_ORDERS),
            done: VecDeque::with_capacity(MAX_ORDERS + RESERVED_ORDERS + KEPT),
        }
    }

    /// True if no order waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// True if there is room for this order; some is reserved for orders that need only the next
    /// border.
    pub fn has_room_for(&self, order: &Order) -> bool {
        let waits = order.from_seq != 0 || order.tag != 0;
        let room = if waits {
            MAX_ORDERS
        } else {
            MAX_ORDERS + RESERVED_ORDERS
        };
        self.waiting.len() + self.done.len() < room
    }

    /// True if a waiting order will change N to this length.
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

    /// Adds a waiting order.
    pub fn push(&mut self, order: Order) {
        self.waiting.push_back(order);
    }

    /// The first order that is due.
    pub fn take_due(&mut self, is_due: impl Fn(&Order) -> bool) -> Option<Order> {
        let at = self.waiting.iter().position(is_due)?;
        self.waiting.remove(at)
    }

    /// Returns the waiting orders for which `gone` is true, dropped.
    pub fn drop_all(&mut self, gone: impl Fn(&Order) -> bool) {
        while let Some(order) = self.take_due(&gone) {
            self.give_back(order, Fate::Dropped);
        }
    }

    /// Returns an order with its outcome.
    pub fn give_back(&mut self, order: Order, fate: Fate) {
        self.done.push_back(order.with_fate(fate));
    }

    /// The next returned order.
    pub fn take_done(&mut self) -> Option<Order> {
        self.done.pop_front()
    }
}
