//! What the flange carries.
//!
//! The payload is among the parameters even while nothing is carried; its columns count in the rows
//! only while it is.

use super::information::Information;
use super::payload::Payload;
use super::sums::JointSums;
use crate::estimator::persist::Visit;

/// The payload, if one is estimated, and whether it is there.
#[derive(Debug, Clone)]
pub(super) struct Flange {
    payload: Option<Payload>,
    parameters: Vec<usize>,
    is_loaded: bool,
}

impl Flange {
    /// An empty flange; `payload` is `None` if none is ever estimated.
    pub fn new(payload: Option<Payload>) -> Self {
        Self {
            parameters: payload.iter().flat_map(Payload::indices).collect(),
            payload,
            is_loaded: false,
        }
    }

    /// True if a payload is among the parameters.
    pub fn has_payload(&self) -> bool {
        self.payload.is_some()
    }

    /// The payload among the parameters, carried or not.
    pub fn payload(&self) -> Option<&Payload> {
        self.payload.as_ref()
    }

    /// The payload while it is carried.
    pub fn carried(&self) -> Option<&Payload> {
        self.payload_if(self.is_loaded)
    }

    /// The payload among the parameters, if `is_loaded`.
    pub fn payload_if(&self, is_loaded: bool) -> Option<&Payload> {
        self.payload.as_ref().filter(|_| is_loaded)
    }

    /// Indices of its parameters; none if there are none.
    pub fn parameters(&self) -> &[usize] {
        &self.parameters
    }

    /// True if a parameter is the payload's.
    pub fn owns(&self, parameter: usize) -> bool {
        self.payload.as_ref().is_some_and(|payload| parameter >= payload.first)
    }

    /// True while a payload is carried.
    pub fn is_loaded(&self) -> bool {
        self.is_loaded
    }

    /// A payload is carried from now on.
    pub fn load(&mut self) {
        self.is_loaded = self.has_payload();
    }

    /// Nothing is carried from now on.
    pub fn unload(&mut self) {
        self.is_loaded = false;
    }

    /// Sets the prior of a payload that may be any.
    pub fn allow_any(&self, into: &mut Information) {
        let Some(payload) = &self.payload else { return };
        for (i, std) in payload.indices().zip(payload.prior) {
            into.set_prior(i, 0.0, std);
        }
    }

    /// Swaps whether a payload is carried.
    pub fn swap(&mut self, is_loaded: &mut bool) {
        std::mem::swap(&mut self.is_loaded, is_loaded);
    }

    /// Adds weight · (A, b) of a joint's rows, (1) of [`identify`](super::identify).
    pub fn learn(&mut self, sums: &JointSums, weight: f64, into: &mut Information) {
        self.learn_if(self.is_loaded, sums, weight, into);
    }

    /// The same with or without the payload.
    pub fn learn_if(&mut self, is_loaded: bool, sums: &JointSums, weight: f64, into: &mut Information) {
        sums.scatter(weight, into); // (1)
        if let Some(payload) = self.payload.as_mut().filter(|_| is_loaded) {
            payload.scatter(sums, weight, into);
        }
    }

    /// The parameters of an arm that is equivalent to arm and payload together, without slopes of
    /// the offsets.
    pub fn effective(&self, theta: &[f64], out: &mut [f64]) {
        self.effective_if(self.is_loaded, theta, out);
    }

    /// The same with or without the payload.
    pub fn effective_if(&self, is_loaded: bool, theta: &[f64], out: &mut [f64]) {
        out[theta.len()..].fill(0.0);
        match self.payload_if(is_loaded) {
            Some(payload) => payload.effective(theta, out),
            None => out[..theta.len()].copy_from_slice(theta),
        }
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.flag(&mut self.is_loaded);
    }
}
