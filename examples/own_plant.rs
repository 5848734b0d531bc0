//! A plant of one's own, and the whole identification service for it: write the equations down,
//! call one function.
//!
//! A driven pendulum, J q̈ + d q̇ + w sin q = τ, the torque τ measured and the angle read from an
//! encoder.
//!
//! ```text
//! cargo run --release --example own_plant -- run              # its equations simulated, identified, reported
//!
//! cargo run --release --example own_plant -- identifier       # the service for a machine
//! cargo run --release --example own_plant -- monitor          # in a second terminal: its estimates
//! cargo run --release --example own_machine                   # in a third one: a pendulum to identify
//! ```

use std::process::ExitCode;
use thetabus::config::Catalog;
use thetabus::model::{Equation, Parameter, Plant, Scalar};

#[derive(Clone, Copy)]
struct Pendulum;

impl Plant for Pendulum {
    fn name(&self) -> &str {
        "pendulum"
    }
    fn joints(&self) -> usize {
        1
    }
    fn input_unit(&self) -> &str {
        "N m"
    }
    fn parameters(&self) -> &[Parameter] {
        const PARAMETERS: &[Parameter] = &[
            Parameter::positive("inertia", "kg m^2", "about the axis", 1.0),
            Parameter::positive("damping", "N m s/rad", "friction that grows with speed", 1.0),
            Parameter::positive("weight", "N m", "torque that holds it level", 1.0),
        ];
        PARAMETERS
    }
    fn equations(&self) -> &[Equation] {
        const EQUATIONS: &[Equation] = &[Equation::new("axis", 0, 1.0, 1, 0..3)];
        EQUATIONS
    }
    /// τ = g₀ + d/dt g₁
    fn terms<D: Scalar>(&self, _equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        g[0] = theta[1] * dq[0] + theta[2] * q[0].sin();
        g[1] = theta[0] * dq[0];
    }
}

fn main() -> ExitCode {
    thetabus::service::app(Catalog::default().with(Pendulum))
}
