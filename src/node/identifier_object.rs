//! An identifier node of any model, as a trait object.

use super::command::{Border, NodeState, Order};
use super::identifier::IdentifierNode;
use super::learner::Learner;
use crate::estimator::StateError;
use crate::messages::{Estimate, Sample, Status};
use std::any::Any;

/// An identifier node of any model.
pub trait Identifier: Send {
    /// See [`IdentifierNode::on_sample`].
    fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate));
    /// See [`IdentifierNode::status`].
    fn status(&self) -> Status;
    /// See [`Learner::window_s`].
    fn window_s(&self) -> Option<f64>;
    /// See [`IdentifierNode::offer`].
    ///
    /// # Errors
    /// The order, if there is no room for it or it is for rows of another type.
    fn offer(&mut self, order: Order) -> Result<Border, Order>;
    /// See [`IdentifierNode::take_done`].
    fn take_done(&mut self) -> Option<Order>;
    /// The rows of a node that is no longer needed, for a command that tunes another node.
    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send>;
    /// See [`IdentifierNode::save`].
    fn save(&mut self, into: &mut NodeState);
    /// See [`IdentifierNode::load`].
    ///
    /// # Errors
    /// If the state does not fit.
    fn load(&mut self, state: &NodeState) -> Result<(), StateError>;
}

impl<L: Learner + ?Sized> Identifier for IdentifierNode<L> {
    fn on_sample(&mut self, sample: &Sample, emit: &mut dyn FnMut(&Estimate)) {
        IdentifierNode::on_sample(self, sample, emit);
    }

    fn status(&self) -> Status {
        IdentifierNode::status(self)
    }

    fn window_s(&self) -> Option<f64> {
        self.learner().window_s()
    }

    fn offer(&mut self, order: Order) -> Result<Border, Order> {
        IdentifierNode::offer(self, order)
    }

    fn take_done(&mut self) -> Option<Order> {
        IdentifierNode::take_done(self)
    }

    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send> {
        self.into_learner().into_rows()
    }

    fn save(&mut self, into: &mut NodeState) {
        IdentifierNode::save(self, into);
    }

    fn load(&mut self, state: &NodeState) -> Result<(), StateError> {
        IdentifierNode::load(self, state)
    }
}
