//! The state that another process needs to continue a robot's identification.
//!
//! Saving commits the pending rows and condenses the sums, so a continued identification keeps the
//! weights of past data. The information is on the present offsets of the torques; θ̂ has those
//! that were reported, until the next block. While an inquiry is open, or if a drive or an encoder
//! has changed, the state is that before the change, so a process that continues from it finds the
//! change again.

use super::identify::RobotIdentifier;
use super::offset_drift::Origin;
use super::watch::LEARNT;
use crate::estimator::persist::{Load, Save, Visit};
use crate::estimator::{EstimatorState, StateError};

impl RobotIdentifier {
    /// Saves the state; allocates only if the lists are too small. The first numbers are θ̂.
    pub fn save(&mut self, into: &mut EstimatorState) {
        into.reals.clear();
        into.counts.clear();
        self.learner.assemble(self.learner.now());
        let is_before = self.swap_with_before();
        let mut save = Save(into);
        self.learner.estimate.visit_theta(&mut save);
        self.learner.system.visit(&mut save);
        self.visit_rest(&mut save);
        if is_before {
            self.swap_with_before();
        }
    }

    fn swap_with_before(&mut self) -> bool {
        let learner = &mut self.learner;
        self.watch.as_mut().is_some_and(|watch| watch.swap_with_before(learner))
    }

    /// Continues from a state.
    ///
    /// # Errors
    /// If the state is of another model or is invalid; the identification is then reset.
    pub fn load_state(&mut self, state: &EstimatorState) -> Result<(), StateError> {
        self.reset();
        let checked = self.take_in(state);
        if checked.is_err() {
            self.reset();
        }
        checked
    }

    fn take_in(&mut self, state: &EstimatorState) -> Result<(), StateError> {
        if let Some(index) = state.reals.iter().position(|x| !x.is_finite()) {
            return Err(StateError::NotFinite { index });
        }
        let mut load = Load::new(state);
        self.learner.estimate.visit_theta(&mut load);
        self.learner.past.load(&mut load);
        self.visit_rest(&mut load);
        load.finish(state)?;
        self.go_on()
    }

    /// Completes loading a state.
    fn go_on(&mut self) -> Result<(), StateError> {
        let learner = &mut self.learner;
        learner.pending.set_seen(LEARNT);
        learner.levels.forget_kept();
        learner.forget_recent();
        self.allowances.carry_over();
        learner.assemble(Origin::Mean);
        learner.estimate.refresh_effective(&learner.flange, &learner.past);
        let solver = &mut learner.solver;
        if !learner.levels.is_sound() || !learner.estimate.try_covariance(solver, &learner.system) {
            return Err(StateError::NotPositive);
        }
        Ok(())
    }

    fn visit_rest(&mut self, v: &mut impl Visit) {
        let learner = &mut self.learner;
        learner.levels.visit(v);
        self.allowances.visit(v);
        learner.past.visit(v);
        v.reals(&mut self.figures.explained);
        self.signals.visit(v);
        for recent in &mut self.figures.recent {
            recent.visit(v);
        }
        self.checks.visit(v);
        learner.estimate.visit_fixed(v);
        learner.flange.visit(v);
        let mut blocks = learner.blocks as u64;
        v.count(&mut blocks);
        learner.blocks = blocks as usize;
    }
}
