//! The Cramér–Rao bound: the least standard deviations of θ that any unbiased estimator can reach
//! from the encoders and voltages of a run.
//!
//! The plant (26) as six states, x = (q₁, p₁, a₁, q₂, p₂, a₂), so that nothing but the voltages is
//! differentiated less often than the positions:
//!
//! ```text
//! p₁ = (θ₁ + 3θ₂ cos²q₂) q̇₁        a₁ = ṗ₁ + (θ₃ + 3θ₄ cos²q₂) q̇₁            ȧ₁ = 12u₁ − 12θ₅q̇₁
//! p₂ = 4θ₆θ₉ q̇₂                    a₂ = ṗ₂ + 4θ₇θ₉ q̇₂ + θ₆(1.5θ₉ sin 2q₂ q̇₁² + 6g cos q₂)
//!                                  ȧ₂ = 12u₂ − 12θ₈q̇₂ − 1.5θ₇θ₉ sin 2q₂ q̇₁² − 6gθ₇ cos q₂
//! ```
//!
//! The voltages are held between samples and known with white noise, which acts as process noise;
//! the positions have the noise of their rounding, LSB/√12. The covariance recursion of the Kalman
//! filter for (x, θ), with Jacobians along the true trajectory, gives the bound: with Gaussian
//! noise it is the inverse of the posterior information (Tichavský, Muravchik, Nehorai, IEEE Trans.
//! Signal Processing 46, 1998). The prior is flat, 50 % of each parameter. The state at the start
//! is known, or not. The nine parameters are free: θ₁/θ₃ = θ₂/θ₄ is not used, so an estimator that
//! uses it may do better in these four.

use crate::model::MANIPULATOR_PARAMS;

/// States of the plant.
const X: usize = 6;
/// States and parameters.
const N: usize = X + MANIPULATOR_PARAMS;
/// Columns of sensitivities: states, parameters, voltages.
const COLUMNS: usize = N + 2;
/// Runge-Kutta steps per millisecond.
const STEPS_PER_S: f64 = 2000.0;

type Rows = [[f64; COLUMNS]; X];

/// The recursion at work: one [`advance`](Self::advance) per sample, in order, while θ is constant.
#[derive(Debug, Clone)]
pub struct CramerRaoBound {
    theta: [f64; MANIPULATOR_PARAMS],
    gravity_m_s2: f64,
    proportional_gain: [f64; 2],
    derivative_gain: [f64; 2],
    sample_period_s: f64,
    position_variance: f64,
    input_variance: f64,
    state: [f64; X],
    covariance: Box<[[f64; N]; N]>,
}

impl CramerRaoBound {
    /// For an arm at rest at `initial_q_rad` under a sampled PD controller.
    ///
    /// Noise: standard deviations of each measured position \[rad\], > 0, and of each voltage
    /// \[V\], ≥ 0.
    pub fn new(sim: &crate::sim::SimOptions, position_noise_rad: f64, input_noise_v: f64) -> Self {
        let theta = sim.true_theta(0.0);
        let gravity = sim.arm.gravity_m_s2;
        let [q1, q2] = sim.initial_q_rad;
        let mut covariance = Box::new([[0.0; N]; N]);
        for i in 0..X {
            covariance[i][i] = 1e-20;
        }
        for i in 0..MANIPULATOR_PARAMS {
            covariance[X + i][X + i] = (0.5 * theta[i]).powi(2);
        }
        Self {
            theta,
            gravity_m_s2: gravity,
            proportional_gain: sim.controller.proportional_gain_v_per_rad,
            derivative_gain: sim.controller.derivative_gain_v_s_per_rad,
            sample_period_s: sim.sample_period_s,
            position_variance: position_noise_rad * position_noise_rad,
            input_variance: input_noise_v * input_noise_v,
            state: [q1, 0.0, 0.0, q2, 0.0, 6.0 * gravity * theta[5] * q2.cos()],
            covariance,
        }
    }

    /// The same for an estimator that may have been switched on at any time, and does not know that
    /// the arm is at rest in the beginning. To know the state then is to know θ₆, too: a₂ holds the
    /// weight.
    #[must_use]
    pub fn with_unknown_start(mut self) -> Self {
        let [th1, th2, th3, th4, _, th6, th7, _, th9] = self.theta;
        let (inertia, damping) = ([th1 + 3.0 * th2, 4.0 * th6 * th9], [th3 + 3.0 * th4, 4.0 * th7 * th9]);
        let weight = 6.0 * self.gravity_m_s2 * th6;
        // 1 rad, 1 rad/s, 1 rad/s² and the weight: what the arm may do
        let unknown = [
            1.0,
            inertia[0],
            inertia[0] + damping[0],
            1.0,
            inertia[1],
            inertia[1] + damping[1] + weight,
        ];
        for (i, std) in unknown.into_iter().enumerate() {
            self.covariance[i][i] = std * std;
        }
        self
    }

    /// Takes in the positions of a sample and carries on to the next one with the voltages that the
    /// setpoint gives.
    pub fn advance(&mut self, setpoint: [f64; 2]) {
        for position in [0, 3] {
            self.measure(position);
        }
        let [q1, p1, _, q2, p2, _] = self.state;
        let (dq1, dq2) = self.velocities(q2, p1, p2);
        let [kp, kd] = [self.proportional_gain, self.derivative_gain];
        let input = [
            kp[0] * (setpoint[0] - q1) - kd[0] * dq1,
            kp[1] * (setpoint[1] - q2) - kd[1] * dq2,
        ];
        self.propagate(input);
    }

    /// Positions q₁, q₂ at the next sample to be taken in \[rad\].
    pub fn positions(&self) -> [f64; 2] {
        [self.state[0], self.state[3]]
    }

    /// Least standard deviation of each parameter from the samples so far, in the parameter's unit.
    pub fn std(&self) -> [f64; MANIPULATOR_PARAMS] {
        std::array::from_fn(|i| self.covariance[X + i][X + i].max(0.0).sqrt())
    }

    fn velocities(&self, q2: f64, p1: f64, p2: f64) -> (f64, f64) {
        let th = &self.theta;
        let c = q2.cos();
        (p1 / (th[0] + 3.0 * th[1] * c * c), p2 / (4.0 * th[5] * th[8]))
    }

    /// P ← P − P h hᵀ P/(hᵀ P h + r), h the unit vector of a position, in Joseph's form.
    fn measure(&mut self, position: usize) {
        let p = &mut *self.covariance;
        let r = self.position_variance;
        let column: [f64; N] = std::array::from_fn(|i| p[i][position]);
        let s = column[position] + r;
        let gain = column.map(|c| c / s);
        // (I − k hᵀ) P (I − h kᵀ) + r k kᵀ, written out
        for i in 0..N {
            for j in 0..N {
                p[i][j] += -gain[i] * column[j] - column[i] * gain[j] + gain[i] * gain[j] * s;
            }
        }
    }

    /// x and P one sample period further on.
    fn propagate(&mut self, input: [f64; 2]) {
        let steps = (self.sample_period_s * STEPS_PER_S).ceil().max(1.0);
        let h = self.sample_period_s / steps;
        let mut x = self.state;
        let mut rows: Rows = [[0.0; COLUMNS]; X];
        for i in 0..X {
            rows[i][i] = 1.0;
        }
        let shifted = |x: &[f64; X], rows: &Rows, k: &([f64; X], Rows), h: f64| -> ([f64; X], Rows) {
            let mut out = (*x, *rows);
            for i in 0..X {
                out.0[i] += h * k.0[i];
                for j in 0..COLUMNS {
                    out.1[i][j] += h * k.1[i][j];
                }
            }
            out
        };
        for _ in 0..steps as usize {
            let k1 = self.rate(&x, &rows, input);
            let (x2, r2) = shifted(&x, &rows, &k1, 0.5 * h);
            let k2 = self.rate(&x2, &r2, input);
            let (x3, r3) = shifted(&x, &rows, &k2, 0.5 * h);
            let k3 = self.rate(&x3, &r3, input);
            let (x4, r4) = shifted(&x, &rows, &k3, h);
            let k4 = self.rate(&x4, &r4, input);
            for i in 0..X {
                x[i] += h / 6.0 * (k1.0[i] + 2.0 * k2.0[i] + 2.0 * k3.0[i] + k4.0[i]);
                for j in 0..COLUMNS {
                    rows[i][j] += h / 6.0 * (k1.1[i][j] + 2.0 * k2.1[i][j] + 2.0 * k3.1[i][j] + k4.1[i][j]);
                }
            }
        }
        self.state = x;
        // P ← F P Fᵀ + s_u² G Gᵀ with F = [rows; 0 I]
        let p = &mut *self.covariance;
        let mut product = [[0.0; N]; X];
        for i in 0..X {
            for k in 0..N {
                let factor = rows[i][k];
                if factor != 0.0 {
                    for j in 0..N {
                        product[i][j] += factor * p[k][j];
                    }
                }
            }
        }
        for i in 0..X {
            for j in X..N {
                p[i][j] = product[i][j];
                p[j][i] = product[i][j];
            }
            for j in 0..=i {
                let mut sum = self.input_variance * (rows[i][N] * rows[j][N] + rows[i][N + 1] * rows[j][N + 1]);
                for k in 0..N {
                    sum += product[i][k] * rows[j][k];
                }
                p[i][j] = sum;
                p[j][i] = sum;
            }
        }
    }

    /// ẋ and the rate of its sensitivities to the first state, θ and u.
    fn rate(&self, x: &[f64; X], s: &Rows, input: [f64; 2]) -> ([f64; X], Rows) {
        let [_, p1, a1, q2, p2, a2] = *x;
        let th = &self.theta;
        let g = self.gravity_m_s2;
        let (sin, c) = q2.sin_cos();
        let (s2, c2) = (2.0 * sin * c, c * c - sin * sin);
        let m1 = th[0] + 3.0 * th[1] * c * c;
        let k1 = th[2] + 3.0 * th[3] * c * c;
        let i2 = 1.0 / (4.0 * th[5] * th[8]);
        let (d1, d2) = (p1 / m1, p2 * i2);
        let centrifugal = 1.5 * s2 * d1 * d1;
        let rate = [
            d1,
            a1 - k1 * d1,
            12.0 * (input[0] - th[4] * d1),
            d2,
            a2 - 4.0 * th[6] * th[8] * d2 - th[5] * (th[8] * centrifugal + 6.0 * g * c),
            12.0 * (input[1] - th[7] * d2) - th[6] * (th[8] * centrifugal + 6.0 * g * c),
        ];
        // through the states, then what θ and u do directly
        let mut out: Rows = [[0.0; COLUMNS]; X];
        let mut v1 = [0.0; COLUMNS];
        let mut v2 = [0.0; COLUMNS];
        for j in 0..COLUMNS {
            v1[j] = (s[1][j] + 3.0 * th[1] * s2 * d1 * s[3][j]) / m1;
            v2[j] = s[4][j] * i2;
        }
        v1[X] -= d1 / m1;
        v1[X + 1] -= 3.0 * c * c * d1 / m1;
        v2[X + 5] -= d2 / th[5];
        v2[X + 8] -= d2 / th[8];
        // ∂/∂q₂ and ∂/∂q̇₁ of centrifugal force and weight, without θ₆ or θ₇
        let by_q2 = th[8] * 3.0 * c2 * d1 * d1 - 6.0 * g * sin;
        let by_d1 = th[8] * 3.0 * s2 * d1;
        for j in 0..COLUMNS {
            let turned = by_q2 * s[3][j] + by_d1 * v1[j];
            out[0][j] = v1[j];
            out[1][j] = s[2][j] - k1 * v1[j] + 3.0 * th[3] * s2 * d1 * s[3][j];
            out[2][j] = -12.0 * th[4] * v1[j];
            out[3][j] = v2[j];
            out[4][j] = s[5][j] - 4.0 * th[6] * th[8] * v2[j] - th[5] * turned;
            out[5][j] = -12.0 * th[7] * v2[j] - th[6] * turned;
        }
        out[1][X + 2] -= d1;
        out[1][X + 3] -= 3.0 * c * c * d1;
        out[2][X + 4] -= 12.0 * d1;
        out[2][N] += 12.0;
        out[4][X + 5] -= th[8] * centrifugal + 6.0 * g * c;
        out[4][X + 6] -= 4.0 * th[8] * d2;
        out[4][X + 8] -= 4.0 * th[6] * d2 + th[5] * centrifugal;
        out[5][X + 6] -= th[8] * centrifugal + 6.0 * g * c;
        out[5][X + 7] -= 12.0 * d2;
        out[5][X + 8] -= th[6] * centrifugal;
        out[5][N + 1] += 12.0;
        (rate, out)
    }
}
