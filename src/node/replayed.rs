//! Keeps the state of the identifier during a replay.
//!
//! The samples of a replay come from the past: from another payload, other tuning, perhaps another
//! machine. Estimates from them must not reach the controller of the next machine, however the
//! replay ends. So the state of the estimator is saved at the first sample of a replay
//! ([`sample_flags::REPLAY`](crate::messages::sample_flags::REPLAY)) and restored at the first
//! sample of the next stream: a machine continues from the state before the replay, and a second
//! replay gives the same estimates as the first. Meanwhile checkpoints contain the saved state.
//!
//! Commands are treated differently, see `bound.rs`: those of the replay are undone, those of an
//! operator stay. So a parameter that an operator fixes or frees during the replay stays so, and a
//! reset during the replay also resets the saved state.

use super::command::{NodeState, Order};
use super::learner::Learner;
use crate::estimator::StateError;
use crate::messages::Status;

/// The state from before a replay.
#[derive(Debug)]
pub(super) struct BeforeReplay {
    state: NodeState,
    is_kept: bool,
}

impl BeforeReplay {
    /// Allocates space for the state without saving one; later calls allocate nothing.
    pub(super) fn new(learner: &mut (impl Learner + ?Sized)) -> Self {
        let mut state = NodeState::default();
        learner.save(&mut state.estimator);
        Self { state, is_kept: false }
    }

    /// The saved state, while a replay is open or was the last stream.
    pub(super) fn kept(&self) -> Option<&NodeState> {
        self.is_kept.then_some(&self.state)
    }

    /// Saves the state.
    pub(super) fn keep(&mut self, learner: &mut (impl Learner + ?Sized), status: &Status) {
        self.is_kept = true;
        copy_out(learner, status, &mut self.state);
    }

    /// Keeps the state that was just [restored](Self::give_back), because another replay follows.
    pub(super) fn keep_on(&mut self) {
        self.is_kept = true;
    }

    /// Call this after an order was carried out: a reset by an operator is permanent.
    pub(super) fn follow(&mut self, order: &Order, learner: &mut (impl Learner + ?Sized), status: &Status) {
        if self.is_kept && order.tag == 0 && order.change.replaces() {
            self.keep(learner, status);
        }
    }

    /// Restores the saved state, if there is one; parameters stay fixed or free as they are now.
    ///
    /// # Errors
    /// If the state is invalid; the learner is then at its start.
    pub(super) fn give_back(&mut self, learner: &mut (impl Learner + ?Sized)) -> Result<bool, StateError> {
        if !std::mem::take(&mut self.is_kept) {
            return Ok(false);
        }
        learner.load_kept(&self.state.estimator).map(|()| true)
    }
}

/// Saves the state that another process needs to continue; allocates only if `into` is too small.
pub(super) fn copy_out(learner: &mut (impl Learner + ?Sized), status: &Status, into: &mut NodeState) {
    into.blocks = learner.save(&mut into.estimator);
    into.stream_id = status.stream_id;
    into.block = status.last_block;
    into.t_ns = status.last_t_ns;
}

#[cfg(test)]
mod tests {
    use super::super::block_learner::BlockLearner;
    use super::super::command::{Change, Order};
    use super::super::identifier::IdentifierNode;
    use super::super::tests::{Spring, node, sample};
    use super::*;
    use crate::estimator::StateMachine;
    use crate::messages::{Estimate, sample_flags, status_flags};

    const N: u64 = 10;

    /// Feeds blocks of a stream whose spring has this stiffness.
    fn feed(
        node: &mut IdentifierNode<BlockLearner<Spring>>,
        stream_id: u64,
        stiffness: f64,
        blocks: u64,
        flags: u32,
    ) -> Vec<Estimate> {
        let mut estimates = Vec::new();
        for seq in 0..blocks * N + 3 {
            let mut sample = sample(stream_id, seq);
            sample.input[0] = stiffness * sample.q[0];
            sample.flags |= flags & sample_flags::REPLAY;
            if seq == blocks * N + 2 {
                sample.flags |= flags & sample_flags::END;
            }
            node.on_sample(&sample, &mut |e| estimates.push(*e));
        }
        estimates
    }

    fn state(node: &mut IdentifierNode<BlockLearner<Spring>>) -> NodeState {
        let mut state = NodeState::default();
        node.save(&mut state);
        state
    }

    #[test]
    fn fault_a_replay_teaches_the_next_stream_nothing_however_it_ends() {
        for end in [0, sample_flags::END] {
            for replays in 1..4 {
                let (mut with, mut without) = (node(N), node(N));
                let machine = [&mut with, &mut without].map(|node| feed(node, 1, 3.0, 5, 0));
                assert_eq!(machine[0], machine[1]);
                let known = state(&mut with);
                let mut first: Option<Vec<Estimate>> = None;
                for n in 0..replays {
                    let replayed = feed(&mut with, 10 + n, 8.0, 4, sample_flags::REPLAY | end);
                    assert!(replayed[3].theta[0] > 3.2, "it is followed: {:?}", replayed[3].theta[0]);
                    assert_ne!(with.status().flags & status_flags::REPLAY, 0);
                    let known_now = state(&mut with);
                    assert_eq!(known_now, known, "a checkpoint holds what is known of the machine");
                    // Each replay begins with the same state.
                    let thetas = |estimates: &[Estimate]| estimates.iter().map(|e| e.theta).collect::<Vec<_>>();
                    let first = first.get_or_insert_with(|| replayed.clone());
                    assert_eq!(thetas(first), thetas(&replayed));
                }
                let after = [&mut with, &mut without].map(|node| feed(node, 2, 3.0, 5, 0));
                assert_eq!(after[0], after[1], "{replays} replays, END {end}");
                assert_eq!(with.status().flags & status_flags::REPLAY, 0);
                assert_eq!(state(&mut with), state(&mut without));
            }
        }
    }

    #[test]
    fn prop_what_an_operator_fixes_or_resets_during_a_replay_stays() {
        let mut node = node(N);
        feed(&mut node, 1, 3.0, 5, 0);
        feed(&mut node, 2, 8.0, 2, sample_flags::REPLAY);
        let fix = Change::Fix {
            index: 0,
            value: Some(5.0),
        };
        assert!(node.offer(Order::new(1, 0, fix)).is_ok());
        feed(&mut node, 2, 8.0, 4, sample_flags::REPLAY | sample_flags::END);
        let held = feed(&mut node, 3, 3.0, 2, 0)[1];
        assert_eq!((held.theta[0], held.fixed.bits()), (5.0, 1));
        assert!(node.offer(Order::new(2, 0, Change::Free { index: 0 })).is_ok());
        let free = feed(&mut node, 4, 3.0, 5, 0)[4];
        assert!((free.theta[0] - 3.0).abs() < 0.1 && free.fixed.is_empty(), "{free:?}");

        feed(&mut node, 5, 8.0, 2, sample_flags::REPLAY | sample_flags::END);
        let fresh = super::super::tests::node(N);
        let estimator = Box::new(fresh.learner().estimator().clone());
        let judge = Box::new(StateMachine::new(estimator.theta()));
        let reset = Change::Replace {
            estimator,
            judge,
            warm: false,
        };
        assert!(node.offer(Order::new(3, 0, reset)).is_ok());
        assert_eq!(state(&mut node).blocks, 0, "nothing is known after a reset");
        let mut cold = super::super::tests::node(N);
        let after = [&mut node, &mut cold].map(|node| feed(node, 6, 3.0, 3, 0)[2].theta);
        assert_eq!(after[0], after[1]);
    }
}
