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
        self.assemble(self.now());
        let is_before = self.swap_with_before();
        let mut save = Save(into);
        save.reals(&mut self.theta);
        save.reals(&mut self.system.matrix);
        save.reals(&mut self.system.vector);
        save.reals(&mut self.system.bias);
        self.visit_rest(&mut save);
        if is_before {
            self.swap_with_before();
        }
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
        load.reals(&mut self.theta);
        load.reals(&mut self.committed.matrix);
        load.reals(&mut self.committed.vector);
        load.reals(&mut self.committed.bias);
        self.visit_rest(&mut load);
        load.finish(state)?;
        self.go_on()
    }

    /// Completes loading a state.
    fn go_on(&mut self) -> Result<(), StateError> {
        self.condensed = true;
        self.slices = LEARNT;
        self.levels.clear();
        self.forget_recent();
        self.assemble(Origin::Mean);
        self.refresh_effective();
        let positive = |x: &f64| *x >= 0.0;
        if !self.torque_std.iter().chain(&self.inflation).all(positive)
            || !self.solver.covariance(&self.system, &self.fixed, &mut self.covariance)
        {
            return Err(StateError::NotPositive);
        }
        Ok(())
    }

    fn visit_rest(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.torque_std);
        v.reals(&mut self.inflation);
        self.block_scatter.iter_mut().for_each(|scatter| scatter.visit(v));
        self.offset_drift.visit(v);
        v.reals(&mut self.figures.explained);
        self.velocity_ratios.0.iter_mut().for_each(|ratio| ratio.visit(v));
        for recent in &mut self.figures.recent {
            recent.visit(v);
        }
        self.gains.iter_mut().for_each(|gains| gains.visit(v));
        self.fixed.iter_mut().for_each(|fixed| v.flag(fixed));
        v.flag(&mut self.is_loaded);
        let mut blocks = self.blocks as u64;
        v.count(&mut blocks);
        self.blocks = blocks as usize;
    }
}
