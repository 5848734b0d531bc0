//! A plant behind a table of functions: what is written for it is compiled once for all plants.
//!
//! [`Plant::terms`] is generic, so a [`Plant`] cannot be an object. Rows need its terms in three
//! kinds of numbers only: values, values with one derivative, and values with two.

use super::{Equation, Parameter, Plant, Scalar};
use num_dual::{Dual64, HyperDual64};
use std::fmt;
use std::sync::Arc;

/// Any [`Plant`], as an object. Implemented for all of them; nobody needs to implement it.
pub trait AnyPlant {
    /// [`Plant::joints`].
    fn joints(&self) -> usize;
    /// [`Plant::turns`].
    fn turns(&self, joint: usize) -> bool;
    /// [`Plant::input_unit`].
    fn input_unit(&self) -> &str;
    /// [`Plant::parameters`].
    fn parameters(&self) -> &[Parameter];
    /// [`Plant::equations`].
    fn equations(&self) -> &[Equation];
    /// [`Plant::input_delay`].
    fn input_delay(&self) -> Option<usize>;
    /// [`Plant::terms`] of real numbers.
    fn real_terms(&self, equation: usize, q: &[f64], dq: &[f64], theta: &[f64], g: &mut [f64]);
    /// [`Plant::terms`] of dual numbers.
    fn dual_terms(&self, equation: usize, q: &[Dual64], dq: &[Dual64], theta: &[Dual64], g: &mut [Dual64]);
    /// [`Plant::terms`] of hyper-dual numbers.
    fn hyper_dual_terms(
        &self,
        equation: usize,
        q: &[HyperDual64],
        dq: &[HyperDual64],
        theta: &[HyperDual64],
        g: &mut [HyperDual64],
    );
}

impl<P: Plant> AnyPlant for P {
    fn joints(&self) -> usize {
        Plant::joints(self)
    }

    fn turns(&self, joint: usize) -> bool {
        Plant::turns(self, joint)
    }

    fn input_unit(&self) -> &str {
        Plant::input_unit(self)
    }

    fn parameters(&self) -> &[Parameter] {
        Plant::parameters(self)
    }

    fn equations(&self) -> &[Equation] {
        Plant::equations(self)
    }

    fn input_delay(&self) -> Option<usize> {
        Plant::input_delay(self)
    }

    fn real_terms(&self, equation: usize, q: &[f64], dq: &[f64], theta: &[f64], g: &mut [f64]) {
        self.terms(equation, q, dq, theta, g);
    }

    fn dual_terms(&self, equation: usize, q: &[Dual64], dq: &[Dual64], theta: &[Dual64], g: &mut [Dual64]) {
        self.terms(equation, q, dq, theta, g);
    }

    fn hyper_dual_terms(
        &self,
        equation: usize,
        q: &[HyperDual64],
        dq: &[HyperDual64],
        theta: &[HyperDual64],
        g: &mut [HyperDual64],
    ) {
        self.terms(equation, q, dq, theta, g);
    }
}

/// A plant that several rows share.
pub type SharedPlant = Arc<dyn AnyPlant + Send + Sync>;

impl fmt::Debug for dyn AnyPlant + Send + Sync {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = self.parameters().iter().map(|p| &*p.name).collect();
        f.debug_struct("AnyPlant")
            .field("parameters", &names)
            .finish_non_exhaustive()
    }
}

/// A kind of numbers in which any plant's terms can be evaluated.
pub trait Number: Scalar {
    /// [`Plant::terms`].
    fn terms(plant: &dyn AnyPlant, equation: usize, q: &[Self], dq: &[Self], theta: &[Self], g: &mut [Self]);
}

impl Number for f64 {
    #[inline]
    fn terms(plant: &dyn AnyPlant, equation: usize, q: &[Self], dq: &[Self], theta: &[Self], g: &mut [Self]) {
        plant.real_terms(equation, q, dq, theta, g);
    }
}

impl Number for Dual64 {
    #[inline]
    fn terms(plant: &dyn AnyPlant, equation: usize, q: &[Self], dq: &[Self], theta: &[Self], g: &mut [Self]) {
        plant.dual_terms(equation, q, dq, theta, g);
    }
}

impl Number for HyperDual64 {
    #[inline]
    fn terms(plant: &dyn AnyPlant, equation: usize, q: &[Self], dq: &[Self], theta: &[Self], g: &mut [Self]) {
        plant.hyper_dual_terms(equation, q, dq, theta, g);
    }
}
