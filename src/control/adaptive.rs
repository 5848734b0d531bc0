//! Feed-forward from estimated parameters.
//!
//! ```text
//! u_ff = h(q_d, q̇_d, q̈_d, q⃛_d; θ_c) + K_d q̇_d        h: the input at which f_e(…, u; θ) = 0    (1)
//! θ_c ← θ_c + clamp(θ_t − θ_c, ± s Δ/T_b)             s the larger of |θ_t| and |θ_c|          (2)
//! θ_t,i = θ̂_i   if use_ok = 1, and σ_i ≤ ρ |θ̂_i|      otherwise θ_t,i stays                    (3)
//! |u_ff| ≤ u_max                                                                               (4)
//! ```
//!
//! The machine's own loop is u = K_p (q_d − q) − K_d q̇ + u_ff, so that K_d q̇_d turns its damping
//! into damping of the error. T_b is the time in which (2) moves a parameter by its own size, so a
//! new estimate never steps the input. If the identifier falls silent, nothing changes: the last
//! θ_t that passed (3) is still the best available, and the machine's own loop works without
//! feed-forward.
//!
//! (3) is weaker than [`Estimate::is_usable`], which is meant for values used one at a time. Here
//! the parameters act together, the machine's own loop corrects their remaining errors, and a
//! parameter known to 20 % is better than its start value. A parameter that an operator has fixed
//! (σ_i = 0) is accepted as it is.

use crate::messages::Estimate;
use crate::model::{JointSample, MAX_JOINTS};
use crate::node::model::SharedModel;

/// How estimates become feed-forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdaptiveOptions {
    /// ρ: largest relative standard deviation of a parameter that is accepted, above 0.
    pub max_std: f64,
    /// T_b \[s\], above 0: time in which a parameter may move by its own size.
    pub blend_s: f64,
    /// K_d of each joint's own loop, in the input's unit per rad/s or m/s.
    pub derivative_gain: [f64; MAX_JOINTS],
    /// u_max of each joint, in the input's unit, above 0; `inf` for none.
    pub input_limit: [f64; MAX_JOINTS],
    /// Time without an estimate after which the identifier is [silent](Knowledge::Silent) \[s\],
    /// above 0.
    pub silence_s: f64,
}

impl Default for AdaptiveOptions {
    /// 20 % standard deviation, 0.2 s, no damping to compensate, no limit, 10 s.
    fn default() -> Self {
        Self {
            max_std: 0.2,
            blend_s: 0.2,
            derivative_gain: [0.0; MAX_JOINTS],
            input_limit: [f64::INFINITY; MAX_JOINTS],
            silence_s: 10.0,
        }
    }
}

/// Values or options that give no feed-forward.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AdaptiveError {
    /// Parameters that are not finite, or not as many as those of the model.
    #[error("expected {expected} finite parameters, got {got:?}")]
    Parameters {
        /// Number of the model's parameters.
        expected: usize,
        /// What was given.
        got: Vec<f64>,
    },
    /// An option that is not above 0.
    #[error("{name}: expected a number above 0, got {got}")]
    Option {
        /// Which one.
        name: &'static str,
        /// What was given.
        got: f64,
    },
    /// Limits of the inputs that are not above 0.
    #[error("input_limit: expected numbers above 0, got {0:?}")]
    InputLimit([f64; MAX_JOINTS]),
}

/// What the feed-forward is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Knowledge {
    /// The start values: no estimate has passed yet.
    Initial,
    /// Estimates that passed.
    Estimated,
    /// The last estimates that passed; the newest have `use_ok` 0.
    Held,
    /// The last estimates that passed; none has arrived for `silence_s`.
    Silent,
}

/// Computes feed-forward from the newest estimates that pass (3). Allocates only in `new`.
#[derive(Debug, Clone)]
pub struct AdaptiveFeedForward {
    model: SharedModel,
    options: AdaptiveOptions,
    /// θ_c and θ_t.
    theta: Vec<f64>,
    target: Vec<f64>,
    knowledge: Knowledge,
    silent_for_s: f64,
    model_hash: u64,
}

impl AdaptiveFeedForward {
    /// Feed-forward for a model; `theta` is used until estimates arrive.
    ///
    /// # Errors
    /// If the number of values is not that of the model's parameters, or an option is out of range.
    pub fn new(model: SharedModel, theta: &[f64], options: AdaptiveOptions) -> Result<Self, AdaptiveError> {
        let params = model.parameters().len();
        if theta.len() != params || theta.iter().any(|x| !x.is_finite()) {
            return Err(AdaptiveError::Parameters {
                expected: params,
                got: theta.to_vec(),
            });
        }
        for (name, got) in [
            ("max_std", options.max_std),
            ("blend_s", options.blend_s),
            ("silence_s", options.silence_s),
        ] {
            if !(got > 0.0) {
                return Err(AdaptiveError::Option { name, got });
            }
        }
        if options.input_limit.iter().any(|limit| !(*limit > 0.0)) {
            return Err(AdaptiveError::InputLimit(options.input_limit));
        }
        Ok(Self {
            model_hash: model.definition().hash(),
            model,
            options,
            theta: theta.to_vec(),
            target: theta.to_vec(),
            knowledge: Knowledge::Initial,
            silent_for_s: 0.0,
        })
    }

    /// Takes an estimate if it passes (3). Returns false, and ignores it, if it is of another
    /// model.
    pub fn on_estimate(&mut self, estimate: &Estimate) -> bool {
        if estimate.model_hash != self.model_hash || estimate.params as usize != self.target.len() {
            return false;
        }
        self.silent_for_s = 0.0;
        if estimate.use_ok != 1 {
            self.knowledge = match self.knowledge {
                Knowledge::Initial => Knowledge::Initial,
                _ => Knowledge::Held,
            };
            return true;
        }
        self.knowledge = Knowledge::Estimated;
        for (i, target) in self.target.iter_mut().enumerate() {
            let (theta, std) = (estimate.theta[i], estimate.theta_std[i]);
            // (3); a standard deviation that is not a number passes nothing
            if theta.is_finite() && std <= self.options.max_std * theta.abs() {
                *target = theta;
            }
        }
        true
    }

    /// Feed-forward along a trajectory: `motion` has the desired q, q̇, q̈ and q⃛, `dt_s` is the
    /// time since the last call \[s\].
    ///
    /// A time that is negative or not a number counts as 0.
    ///
    /// In the input's unit, one value per joint; 0 for a joint whose value is not finite, so only
    /// its own loop acts on it.
    pub fn next(&mut self, motion: &JointSample, dt_s: f64) -> [f64; MAX_JOINTS] {
        let dt_s = if dt_s.is_finite() { dt_s.max(0.0) } else { 0.0 };
        self.silent_for_s += dt_s;
        if self.silent_for_s > self.options.silence_s && self.knowledge != Knowledge::Initial {
            self.knowledge = Knowledge::Silent;
        }
        for (theta, target) in self.theta.iter_mut().zip(&self.target) {
            let step = theta.abs().max(target.abs()) * dt_s / self.options.blend_s;
            *theta += (target - *theta).clamp(-step, step); // (2)
        }
        let mut input = [0.0; MAX_JOINTS];
        self.model.input_for(motion, &self.theta, &mut input);
        for joint in 0..MAX_JOINTS {
            let limit = self.options.input_limit[joint];
            let wanted = input[joint] + self.options.derivative_gain[joint] * motion.dq[joint]; // (1)
            input[joint] = if wanted.is_finite() {
                wanted.clamp(-limit, limit)
            } else {
                0.0
            }; // (4)
        }
        input
    }

    /// What the feed-forward is made from.
    pub fn knowledge(&self) -> Knowledge {
        self.knowledge
    }

    /// θ_c, the parameters in use now.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Manipulator;
    use crate::node::model::PlantModel;

    /// The parameters do not move in an invalid time step.
    #[test]
    fn fault_a_time_that_is_negative_or_no_number_changes_nothing() {
        let model = SharedModel::new(PlantModel::new(Manipulator::default()));
        let theta = vec![1.0; model.parameters().len()];
        let mut control = AdaptiveFeedForward::new(model, &theta, AdaptiveOptions::default()).unwrap();
        let motion = JointSample::default();
        let own = control.next(&motion, 0.0);
        control.target.fill(2.0);
        for dt_s in [-1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(control.next(&motion, dt_s), own);
            assert_eq!((control.theta(), control.silent_for_s), (&theta[..], 0.0));
        }
    }
}
