//! The Cramér–Rao bound of the arm: the smallest standard deviations of θ that any unbiased
//! estimator can reach with the encoders and voltages of a run.
//!
//! The plant (26) as the six states of [`ArmStates`]. The voltages are held between samples and
//! known with white noise, which acts as process noise; the positions have the noise of their
//! rounding, LSB/√12. The covariance recursion of the Kalman filter for (x, θ), with Jacobians
//! along the true trajectory, gives the bound: with Gaussian noise it is the inverse of the
//! posterior information (Tichavský, Muravchik, Nehorai, IEEE Trans. Signal Processing 46, 1998).
//! The prior is flat, 50 % of each parameter. The state at the start is known, or not. The nine
//! parameters are free: θ₁/θ₃ = θ₂/θ₄ is not used, so an estimator that uses it may do better in
//! these four.

use crate::model::MANIPULATOR_PARAMS;
use crate::studies::states::{ARM_STATES, ArmStates, JointCovariance, SensorVariance, StateSpace};
use nalgebra::SVector;

/// Standard deviation of the prior, relative.
const PRIOR: f64 = 0.5;
/// Standard deviation of each state at the start if it is known.
const KNOWN: f64 = 1e-10;

/// The recursion: one [`advance`](Self::advance) per sample, in order, while θ is constant.
#[derive(Debug, Clone)]
pub struct CramerRaoBound {
    machine: ArmStates,
    theta: SVector<f64, MANIPULATOR_PARAMS>,
    proportional_gain: [f64; 2],
    derivative_gain: [f64; 2],
    variance: SensorVariance,
    state: SVector<f64, ARM_STATES>,
    covariance: JointCovariance<ARM_STATES, MANIPULATOR_PARAMS>,
}

impl CramerRaoBound {
    /// For an arm at rest at `initial_q_rad` with a sampled PD controller.
    ///
    /// Noise: standard deviations of each measured position \[rad\], > 0, and of each voltage
    /// \[V\], ≥ 0.
    pub fn new(sim: &crate::sim::SimOptions, position_noise_rad: f64, input_noise_v: f64) -> Self {
        let theta = SVector::from(sim.true_theta(0.0));
        let machine = ArmStates {
            gravity_m_s2: sim.arm.gravity_m_s2,
            sample_period_s: sim.sample_period_s,
        };
        Self {
            machine,
            theta,
            proportional_gain: sim.controller.proportional_gain_v_per_rad,
            derivative_gain: sim.controller.derivative_gain_v_s_per_rad,
            variance: SensorVariance {
                position: position_noise_rad * position_noise_rad,
                input: input_noise_v * input_noise_v,
            },
            state: machine.at_rest(sim.initial_q_rad, &theta),
            covariance: JointCovariance::independent(&SVector::repeat(KNOWN), &(theta * PRIOR)),
        }
    }

    /// The same for an estimator that may start at any time and does not know that the arm is
    /// initially at rest. Knowing the initial state would mean knowing θ₆ too, because a₂ contains
    /// the weight.
    #[must_use]
    pub fn with_unknown_start(mut self) -> Self {
        self.covariance = JointCovariance::independent(&self.machine.reach(&self.theta), &(self.theta * PRIOR));
        self
    }

    /// Takes the positions of a sample and advances to the next one with the voltages from the
    /// setpoint.
    pub fn advance(&mut self, setpoint: [f64; 2]) {
        for place in ArmStates::POSITIONS {
            self.covariance.measure(place, self.variance.position);
        }
        let [q1, q2] = self.positions();
        let [dq1, dq2] = ArmStates::velocities(&self.state, &self.theta);
        let [kp, kd] = [self.proportional_gain, self.derivative_gain];
        let input = SVector::from([
            kp[0] * (setpoint[0] - q1) - kd[0] * dq1,
            kp[1] * (setpoint[1] - q2) - kd[1] * dq2,
        ]);
        let (state, jacobian) = self.machine.advance(&self.state, &self.theta, &input);
        self.state = state;
        self.covariance.propagate(&jacobian, self.variance.input);
    }

    /// Positions q₁, q₂ at the next sample \[rad\].
    pub fn positions(&self) -> [f64; 2] {
        ArmStates::POSITIONS.map(|place| self.state[place])
    }

    /// Smallest standard deviation of each parameter from the samples so far, in the parameter's
    /// unit.
    pub fn std(&self) -> [f64; MANIPULATOR_PARAMS] {
        self.covariance.theta_std().into()
    }
}
