//! Orders for one stream only: a replay repeats the commands of its recording, and their effects
//! must not remain for the next machine.
//!
//! An order with a tag waits for the stream with this tag. The state before the first such order of
//! the stream is remembered, and restored when the stream is over: at its END, or when another
//! stream begins without one. Pause, fixed parameters and tunables are restored here; estimates,
//! and an exchanged estimator, by `replayed.rs`. A command without a tag makes the setting that it
//! changes permanent.

use super::command::{Change, Fate, Order};
use super::learner::Learner;
use crate::messages::status_flags;
use crate::model::MAX_PARAMS;

/// Largest number of orders that [`BoundEffects`] returns when a stream is over.
pub(super) const KEPT: usize = 2;

/// Whether a parameter was fixed before.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Previous {
    Untouched,
    Free,
    HeldAt(f64),
}

/// The previous state of everything that the orders of a stream have changed.
#[derive(Debug)]
pub(super) struct BoundEffects {
    /// The stream; 0 if nothing was changed.
    tag: u32,
    paused: Option<bool>,
    /// [`status_flags::COMMANDED`], if it was set.
    commanded: Option<u32>,
    held: [Previous; MAX_PARAMS],
    /// The first change of tunables, which contains the previous ones.
    tuned: Option<Order>,
    /// The first change of N, if different, which contains the previous rows.
    resized: Option<Order>,
}

/// The state to restore.
#[derive(Debug)]
pub(super) struct Before {
    pub(super) paused: Option<bool>,
    pub(super) commanded: u32,
    held: [Previous; MAX_PARAMS],
    pub(super) tuned: Option<Order>,
    pub(super) resized: Option<Order>,
}

impl BoundEffects {
    pub(super) fn new() -> Self {
        Self {
            tag: 0,
            paused: None,
            commanded: None,
            held: [Previous::Untouched; MAX_PARAMS],
            tuned: None,
            resized: None,
        }
    }

    /// True if effects of another stream than this one remain; 0 for a stream that is over.
    pub(super) fn are_foreign_to(&self, tag: u32) -> bool {
        self.tag != 0 && self.tag != tag
    }

    /// Call this before an order is carried out.
    pub(super) fn note(&mut self, order: &Order, paused: bool, flags: u32, learner: &(impl Learner + ?Sized)) {
        let bound = order.tag != 0;
        if bound {
            self.tag = order.tag;
            self.commanded.get_or_insert(flags & status_flags::COMMANDED);
        } else if matches!(
            order.change,
            Change::Tune { .. } | Change::Fix { .. } | Change::Free { .. }
        ) {
            self.commanded = Some(status_flags::COMMANDED);
        }
        match &order.change {
            Change::Pause | Change::Resume if bound => _ = self.paused.get_or_insert(paused),
            Change::Pause | Change::Resume => self.paused = None,
            Change::Fix { index, .. } | Change::Free { index } => {
                let Some(was) = self.held.get_mut(*index) else { return };
                *was = match *was {
                    Previous::Untouched if bound => learner.held_at(*index).map_or(Previous::Free, Previous::HeldAt),
                    was if bound => was,
                    _ => Previous::Untouched,
                };
            }
            _ => {}
        }
    }

    /// Call this after an order was carried out: keeps its contents if they are needed later.
    /// Returns orders that a command without a tag makes superfluous.
    pub(super) fn keep(&mut self, order: &mut Order) -> [Option<Order>; KEPT] {
        let Change::Tune { rows, .. } = &order.change else {
            return [None, None];
        };
        if order.tag == 0 {
            return [self.tuned.take(), self.resized.take()];
        }
        let resizes = rows.is_some();
        let place = match (&self.tuned, &self.resized) {
            (None, _) => &mut self.tuned,
            (Some(tuned), None) if resizes && !resizes_rows(tuned) => &mut self.resized,
            _ => return [None, None],
        };
        let change = std::mem::replace(&mut order.change, Change::Kept);
        *place = Some(Order {
            change,
            border: order.border,
            ..Order::new(order.id, order.from_seq, Change::Kept).for_stream(order.tag)
        });
        [None, None]
    }

    /// Everything to restore; afterwards nothing is remembered.
    pub(super) fn take(&mut self) -> Before {
        let BoundEffects {
            paused,
            commanded,
            held,
            tuned,
            resized,
            ..
        } = std::mem::replace(self, Self::new());
        Before {
            paused,
            commanded: commanded.unwrap_or(0),
            held,
            tuned,
            resized,
        }
    }
}

impl Before {
    /// Restores which parameters are fixed and free.
    pub(super) fn hold(&self, learner: &mut (impl Learner + ?Sized)) {
        for (index, was) in self.held.iter().enumerate() {
            match was {
                Previous::Untouched => {}
                Previous::Free => learner.free(index),
                Previous::HeldAt(value) => learner.fix(index, Some(*value)),
            }
        }
    }
}

fn resizes_rows(order: &Order) -> bool {
    matches!(order.change, Change::Tune { rows: Some(_), .. })
}

impl Order {
    /// The same with its fate.
    pub(super) fn with_fate(mut self, fate: Fate) -> Self {
        self.fate = fate;
        self
    }
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use super::*;
    use crate::estimator::EstimatorOptions;
    use crate::messages::{Estimate, Status, estimate_flags, sample_flags, stream_tag};
    use crate::node::block_learner::BlockLearner;
    use crate::node::identifier::IdentifierNode;
    use crate::node::tests::{Spring, node, sample};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    const N: u64 = 10;

    fn tune(
        node: &IdentifierNode<BlockLearner<Spring>>,
        forgetting_factor: f64,
        len: u64,
        resized: bool,
        hash: u64,
    ) -> Change {
        Change::Tune {
            options: Box::new(EstimatorOptions {
                forgetting_factor,
                ..node.learner().estimator().options().clone()
            }),
            config_hash: hash,
            block_len: len,
            rows: resized.then(|| Box::new(Spring::default()) as Box<dyn std::any::Any + Send>),
        }
    }

    /// Feeds a stream and returns its estimates.
    fn feed(
        node: &mut IdentifierNode<BlockLearner<Spring>>,
        stream_id: u64,
        seqs: std::ops::Range<u64>,
        end: bool,
    ) -> Vec<Estimate> {
        let mut estimates = Vec::new();
        let last = seqs.end - 1;
        for seq in seqs {
            let mut sample = sample(stream_id, seq);
            if end && seq == last {
                sample.flags |= sample_flags::END;
            }
            node.on_sample(&sample, &mut |e| estimates.push(*e));
        }
        estimates
    }

    /// Everything that commands can change: flags, λ, fixed parameters, and, through the estimates,
    /// N, configuration and pause.
    fn shape(
        status: &Status,
        node: &IdentifierNode<BlockLearner<Spring>>,
        estimate: &Estimate,
    ) -> (u32, f64, Vec<bool>, u64, u64, u32, u128) {
        let options = node.learner().estimator().options();
        let length = (estimate.t_last_ns - estimate.t_first_ns) / 1_000_000 + 1;
        let flags = estimate.flags & (estimate_flags::HELD | estimate_flags::COMMANDED);
        (
            status.flags,
            options.forgetting_factor,
            options.parameters.iter().map(|p| p.fixed).collect(),
            length,
            estimate.config_hash,
            flags,
            estimate.fixed.bits(),
        )
    }

    #[test]
    fn prop_whatever_a_stream_was_told_the_next_one_is_as_before_it() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut below = |n: u64| random.next_u64() % n;
        for case in 0..300 {
            let mut node = node(N);
            // In some cases an operator has already sent a command, which must stay.
            if below(3) == 0 {
                assert!(
                    node.offer(Order::new(
                        1_000,
                        0,
                        Change::Fix {
                            index: 0,
                            value: Some(2.0)
                        }
                    ))
                    .is_ok()
                );
            }
            if below(4) == 0 {
                assert!(node.offer(Order::new(1_001, 0, Change::Pause)).is_ok());
            }
            feed(&mut node, 1, 0..5 * N, true);
            while node.take_done().is_some() {}
            let estimate = feed(&mut node, 2, 0..3 * N, true)[2];
            let before = shape(&node.status(), &node, &estimate);

            // A replay sends its commands in advance, and ends anywhere, or completely, or before
            // its first sample.
            let tag = stream_tag(3);
            let (mut offered, mut returned) = (0, 0);
            let mut len = N;
            for id in 0..below(40) {
                let change = match below(6) {
                    0 => Change::Pause,
                    1 => Change::Resume,
                    2 => Change::Fix {
                        index: 0,
                        value: (below(2) == 0).then_some(7.0),
                    },
                    3 => Change::Free { index: 0 },
                    4 => tune(&node, 0.5 + 0.01 * below(40) as f64, len, false, 70 + id),
                    _ => {
                        len = 2 + below(9);
                        tune(&node, 0.9, len, true, 90 + id)
                    }
                };
                let from_seq = if below(4) == 0 { u64::MAX - below(2) } else { below(100) };
                match node.offer(Order::new(id, from_seq, change).for_stream(tag)) {
                    Ok(border) => {
                        assert_eq!(border.stream_id, 0, "its stream has not begun");
                        offered += 1;
                    }
                    Err(order) => panic!("case {case}: {order:?}"),
                }
            }
            let (sent, end) = (below(100), below(2) == 0);
            if sent > 0 {
                feed(&mut node, 3, 0..sent, end);
            }
            while let Some(order) = node.take_done() {
                assert_ne!(order.fate, Fate::Waits);
                returned += u32::from(order.fate != Fate::Undone);
            }

            let live = feed(&mut node, 4, 0..4 * N, false);
            assert_eq!(live.len() as u64, 4, "case {case}: blocks of N again");
            if before.6 != 0 {
                assert_eq!(live[3].theta[0], 2.0, "case {case}: held where the operator wanted it");
            }
            for estimate in &live {
                assert_eq!(shape(&node.status(), &node, estimate), before, "case {case}");
            }
            while let Some(order) = node.take_done() {
                returned += u32::from(order.fate != Fate::Undone);
            }
            assert_eq!(returned, offered, "case {case}: every order comes back once");
        }
    }

    #[test]
    fn prop_what_an_operator_says_during_a_replay_stays() {
        let mut node = node(N);
        let tag = stream_tag(3);
        for (id, from_seq, change) in [
            (1, 5, Change::Pause),
            (
                2,
                5,
                Change::Fix {
                    index: 0,
                    value: Some(7.0),
                },
            ),
            (3, 5, tune(&node, 0.5, N, false, 70)),
        ] {
            assert!(node.offer(Order::new(id, from_seq, change).for_stream(tag)).is_ok());
        }
        feed(&mut node, 3, 0..15, false);
        for (id, change) in [
            (4, Change::Resume),
            (
                5,
                Change::Fix {
                    index: 0,
                    value: Some(3.0),
                },
            ),
            (6, tune(&node, 0.6, N, false, 80)),
        ] {
            assert!(node.offer(Order::new(id, 0, change)).is_ok());
        }
        feed(&mut node, 3, 15..25, false);
        let live = feed(&mut node, 4, 0..N, false)[0];
        assert_eq!((live.fixed.bits(), live.theta[0], live.config_hash), (1, 3.0, 80));
        assert_eq!(live.flags & estimate_flags::HELD, 0);
        assert_eq!(node.learner().estimator().options().forgetting_factor, 0.6);
    }

    #[test]
    fn fault_orders_for_samples_that_never_come_leave_room_for_an_operator_and_go_with_their_stream() {
        use crate::node::command::{MAX_ORDERS, RESERVED_ORDERS};
        let mut node = node(N);
        feed(&mut node, 1, 0..5, false);
        let far = |id| Order::new(id, u64::MAX, Change::Resume);
        for id in 0..MAX_ORDERS as u64 {
            assert!(node.offer(far(id)).is_ok());
        }
        assert!(node.offer(far(99)).is_err());
        for id in 0..RESERVED_ORDERS as u64 {
            assert!(node.offer(Order::new(100 + id, 0, Change::Pause)).is_ok());
        }
        assert!(node.offer(Order::new(200, 0, Change::Pause)).is_err());
        feed(&mut node, 1, 5..15, false);
        let done: Vec<u64> = std::iter::from_fn(|| node.take_done()).map(|order| order.id).collect();
        assert_eq!(done, (100..100 + RESERVED_ORDERS as u64).collect::<Vec<_>>());
        feed(&mut node, 2, 0..1, false);
        let dropped = std::iter::from_fn(|| node.take_done()).filter(|order| order.fate == Fate::Dropped);
        assert_eq!(dropped.count(), MAX_ORDERS);
    }

    #[test]
    fn fault_the_last_numbers_there_are_do_not_overflow() {
        let mut random = ChaCha8Rng::seed_from_u64(6);
        for len in [1, 2, N] {
            let mut node = node(len);
            for _ in 0..2_000 {
                let number = |random: &mut ChaCha8Rng| match random.next_u64() % 4 {
                    0 => u64::MAX - random.next_u64() % 3,
                    1 => random.next_u64(),
                    2 => 1 << (random.next_u64() % 64),
                    _ => random.next_u64() % 30,
                };
                let mut sample = sample(random.next_u64() % 2, 0);
                (sample.seq, sample.t_ns) = (number(&mut random), number(&mut random));
                if random.next_u64() % 20 == 0 {
                    sample.flags |= sample_flags::END;
                }
                let _ = node.offer(Order::new(1, number(&mut random), Change::Resume));
                node.on_sample(&sample, &mut |e| assert!(e.theta[0].is_finite()));
                while node.take_done().is_some() {}
            }
        }
    }
}
