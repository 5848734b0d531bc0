//! The paper's two-joint arm with DC motors, equations (24) to (27).
//!
//! Both equations of (26), multiplied by 12 and written as terms differentiated in time:
//!
//! ```text
//! joint 1   12 u₁ = 12 θ₅ q̇₁ + d/dt [(θ₃ + 3 θ₄ cos²q₂) q̇₁] + d²/dt² [(θ₁ + 3 θ₂ cos²q₂) q̇₁]
//! joint 2   12 u₂ = 12 θ₈ q̇₂ + 3/2 θ₇ θ₉ sin 2q₂ q̇₁² + 6 g θ₇ cos q₂
//!              + d/dt [4 θ₇ θ₉ q̇₂ + θ₆ (3/2 θ₉ sin 2q₂ q̇₁² + 6 g cos q₂)] + d²/dt² [4 θ₆ θ₉ q̇₂]
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | q₁, q₂ | rotation about the vertical; elevation of link 2, 0 is horizontal | rad |
//! | u₁, u₂ | motor voltages (12) | V |
//! | g | gravity | m/s² |
//! | θ₁…θ₉ | (25), see [`PARAMETERS`] | |
//!
//! Differentiating gives (26) term by term. θ₁…θ₅ belong to joint 1 and enter linearly, θ₆…θ₉ to
//! joint 2 with the products θ₆θ₉ and θ₇θ₉. The nine numbers have eight degrees of freedom: θ₁/θ₃
//! and θ₂/θ₄ are both L₁/R₁.

use super::{Equation, JointSample, Parameter, Plant, PointwiseModel, Scalar};

/// Number of parameters of the arm.
pub const MANIPULATOR_PARAMS: usize = 9;

/// θ₁…θ₉ of (25). All are positive for every physical arm; the start values are orders of
/// magnitude, with a round number for the length.
pub static PARAMETERS: [Parameter; MANIPULATOR_PARAMS] = [
    Parameter::positive(
        "theta_1",
        "V s^3/rad",
        "l1^2 L1 m1 / km1: inductance times inertia of link 1",
        0.01,
    ),
    Parameter::positive(
        "theta_2",
        "V s^3/rad",
        "l2^2 L1 m2 / km1: inductance 1 times inertia of link 2",
        0.01,
    ),
    Parameter::positive(
        "theta_3",
        "V s^2/rad",
        "l1^2 m1 R1 / km1: resistance times inertia of link 1",
        0.1,
    ),
    Parameter::positive(
        "theta_4",
        "V s^2/rad",
        "l2^2 m2 R1 / km1: resistance 1 times inertia of link 2",
        0.1,
    ),
    Parameter::positive("theta_5", "V s/rad", "ke1: back-EMF constant of motor 1", 10.0),
    Parameter::positive(
        "theta_6",
        "V s^3/(rad m)",
        "l2 L2 m2 / km2: inductance 2 times static moment of link 2",
        0.01,
    ),
    Parameter::positive(
        "theta_7",
        "V s^2/(rad m)",
        "l2 m2 R2 / km2: resistance 2 times static moment of link 2",
        0.1,
    ),
    Parameter::positive("theta_8", "V s/rad", "ke2: back-EMF constant of motor 2", 10.0),
    Parameter::positive("theta_9", "m", "l2: length of link 2", 1.0),
];

static EQUATIONS: [Equation; 2] = [
    Equation::new("joint_1", 0, 12.0, 2, 0..5),
    Equation::new("joint_2", 1, 12.0, 2, 5..9),
];

/// θ₁/θ₃ = θ₂/θ₄ = L₁/R₁.
static RELATIONS: [[usize; 4]; 1] = [[0, 2, 1, 3]];

/// The paper's two-joint arm; only gravity is taken as known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Manipulator {
    gravity_m_s2: f64,
}

impl Manipulator {
    /// An arm under gravity `gravity_m_s2` \[m/s²\]; must be finite and ≥ 0, otherwise `None`.
    pub fn new(gravity_m_s2: f64) -> Option<Self> {
        (gravity_m_s2.is_finite() && gravity_m_s2 >= 0.0).then_some(Self { gravity_m_s2 })
    }

    /// g \[m/s²\].
    pub fn gravity_m_s2(&self) -> f64 {
        self.gravity_m_s2
    }
}

impl Default for Manipulator {
    /// g = 9.81 m/s², as in the paper.
    fn default() -> Self {
        Self { gravity_m_s2: 9.81 }
    }
}

impl Plant for Manipulator {
    fn name(&self) -> &str {
        "manipulator"
    }

    fn joints(&self) -> usize {
        2
    }

    fn input_unit(&self) -> &str {
        "V"
    }

    fn parameters(&self) -> &[Parameter] {
        &PARAMETERS
    }

    fn equations(&self) -> &[Equation] {
        &EQUATIONS
    }

    fn relations(&self) -> &[[usize; 4]] {
        &RELATIONS
    }

    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        // (26) as Σ_d (d/dt)^d g_d
        let gravity = self.gravity_m_s2;
        if equation == 0 {
            let cos = q[1].cos();
            let cos2 = cos * cos;
            g[0] = theta[4] * dq[0] * 12.0;
            g[1] = (theta[2] + theta[3] * cos2 * 3.0) * dq[0];
            g[2] = (theta[0] + theta[1] * cos2 * 3.0) * dq[0];
        } else {
            let (theta_6, theta_7, theta_9) = (theta[5], theta[6], theta[8]);
            let (sin, cos) = q[1].sin_cos();
            // sin 2q₂ = 2 sin q₂ cos q₂
            let centrifugal = theta_9 * sin * cos * dq[0] * dq[0] * 3.0;
            let weight = cos * (6.0 * gravity);
            g[0] = theta[7] * dq[1] * 12.0 + theta_7 * (centrifugal + weight);
            g[1] = theta_7 * theta_9 * dq[1] * 4.0 + theta_6 * (centrifugal + weight);
            g[2] = theta_6 * theta_9 * dq[1] * 4.0;
        }
    }
}

/// The part of (27) that depends on one sample; the rest is θ.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ManipulatorFeatures {
    /// Regressor φ₁ of (27), over θ₁…θ₅.
    phi_1: [f64; 5],
    /// 12 u₁.
    v_1: f64,
    /// Factors of θ₆ and θ₆θ₉.
    b_6: f64,
    a_6: f64,
    /// Factors of θ₇ and θ₇θ₉.
    b_7: f64,
    a_7: f64,
    /// Factor of θ₈.
    b_8: f64,
    /// 12 u₂.
    v_2: f64,
}

impl ManipulatorFeatures {
    /// The row in the form (1), v = φᵀβ, for estimators that are linear in their parameters: (φ,
    /// v).
    ///
    /// Equation 0: β = θ₁…θ₅. Equation 1 is linear in five numbers made of θ₆…θ₉ and their
    /// products: β = θ₆, θ₇, θ₈, θ₆θ₉, θ₇θ₉.
    pub fn linear_row(&self, equation: usize) -> ([f64; 5], f64) {
        if equation == 0 {
            (self.phi_1, self.v_1)
        } else {
            ([self.b_6, self.b_7, self.b_8, self.a_6, self.a_7], self.v_2)
        }
    }
}

impl PointwiseModel for Manipulator {
    type Features = ManipulatorFeatures;

    fn features(&self, sample: &JointSample) -> ManipulatorFeatures {
        let [_, q2, ..] = sample.q;
        let [dq1, dq2, ..] = sample.dq;
        let [ddq1, ddq2, ..] = sample.ddq;
        let [dddq1, dddq2, ..] = sample.dddq;
        let gravity = self.gravity_m_s2;
        let (sin, cos) = q2.sin_cos();
        let (sin_2q2, cos_2q2, cos2) = (2.0 * sin * cos, cos * cos - sin * sin, cos * cos);
        ManipulatorFeatures {
            // (27), first equation
            phi_1: [
                dddq1,
                -6.0 * cos_2q2 * dq1 * dq2 * dq2 - 6.0 * sin_2q2 * dq2 * ddq1 - 3.0 * sin_2q2 * dq1 * ddq2
                    + 3.0 * cos2 * dddq1,
                ddq1,
                -3.0 * sin_2q2 * dq1 * dq2 + 3.0 * cos2 * ddq1,
                12.0 * dq1,
            ],
            v_1: 12.0 * sample.input[0],
            // (27), second equation: φ₆ = b₆ + θ₉ a₆, φ₇ = b₇ + θ₉ a₇, φ₈ = b₈, φ₉ = θ₆ a₆ + θ₇ a₇
            b_6: -6.0 * gravity * sin * dq2,
            a_6: 3.0 * cos_2q2 * dq1 * dq1 * dq2 + 3.0 * sin_2q2 * dq1 * ddq1 + 4.0 * dddq2,
            b_7: 6.0 * gravity * cos,
            a_7: 1.5 * sin_2q2 * dq1 * dq1 + 4.0 * ddq2,
            b_8: 12.0 * dq2,
            v_2: 12.0 * sample.input[1],
        }
    }

    #[inline]
    fn row(&self, equation: usize, features: &ManipulatorFeatures, theta: &[f64], regressor: &mut [f64]) -> f64 {
        if equation == 0 {
            let phi = &features.phi_1;
            regressor[..5].copy_from_slice(phi);
            // (5) of (26), first equation: f = 12 u₁ − φ₁ᵀ θ₁..₅
            features.v_1
                - (phi[0] * theta[0] + phi[1] * theta[1] + phi[2] * theta[2] + phi[3] * theta[3] + phi[4] * theta[4])
        } else {
            let &ManipulatorFeatures {
                b_6,
                a_6,
                b_7,
                a_7,
                b_8,
                v_2,
                ..
            } = features;
            let (theta_6, theta_7, theta_8, theta_9) = (theta[5], theta[6], theta[7], theta[8]);
            let (phi_6, phi_7) = (b_6 + theta_9 * a_6, b_7 + theta_9 * a_7);
            regressor[..4].copy_from_slice(&[phi_6, phi_7, b_8, theta_6 * a_6 + theta_7 * a_7]);
            // (5) of (26), second equation; φ₆ and φ₇ already contain θ₉
            v_2 - (theta_6 * phi_6 + theta_7 * phi_7 + theta_8 * b_8)
        }
    }
}
