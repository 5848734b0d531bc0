//! Estimators. They see rows, never a model or the simulator.

/// Which parameters each equation depends on; the estimator's whole knowledge of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Number of parameters P.
    pub params: usize,
    /// For each equation the indices of its parameters.
    pub equations: Vec<std::ops::Range<usize>>,
}

/// A block of samples as residuals of scalar equations, to be evaluated at any θ.
///
/// Sample `index` of `0..len()` gives one row for each equation.
pub trait Residuals {
    /// Number of sample instants in the block.
    fn len(&self) -> usize;
    /// True where the block holds nothing.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Residual f_n(θ); writes the regressor φ_n = −∂f_n/∂θ over the equation's own parameters.
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64;
}
