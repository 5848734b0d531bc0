//! Prior knowledge of a parameter, and of the noise of an equation.

/// Prior knowledge of one parameter.
///
/// Errors name its fields like the lists in the configuration files: `theta_start`, `start_std`,
/// `lower`, `upper`, `random_walk`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ParameterPrior {
    /// Start value θ̂₀, in the parameter's unit; finite and within the bounds.
    pub start: f64,
    /// Standard deviation of the start value, in the parameter's unit; finite, ≥ 0. It is reported
    /// until data arrive, and is not the weight of the start value, which is
    /// [`information_floor`](super::EstimatorOptions::information_floor).
    pub std: f64,
    /// Lower bound, in the parameter's unit; `-inf` for none.
    pub lower: f64,
    /// Upper bound, in the parameter's unit; `inf` for none.
    pub upper: f64,
    /// The parameter is not estimated and keeps its start value.
    pub fixed: bool,
    /// Standard deviation of its random walk per block, relative to the parameter; finite, ≥ 0; 0
    /// for a constant parameter.
    pub random_walk: f64,
}

impl ParameterPrior {
    /// A start value with a standard deviation of 100 %, without bounds.
    pub fn new(start: f64) -> Self {
        Self {
            start,
            std: start.abs(),
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            fixed: false,
            random_walk: 0.0,
        }
    }

    /// The same for a parameter that is never negative.
    pub fn positive(start: f64) -> Self {
        Self::new(start).within(0.0, f64::INFINITY)
    }

    /// With this standard deviation.
    #[must_use]
    pub fn std(mut self, std: f64) -> Self {
        self.std = std;
        self
    }

    /// Within these bounds.
    #[must_use]
    pub fn within(mut self, lower: f64, upper: f64) -> Self {
        (self.lower, self.upper) = (lower, upper);
        self
    }

    /// Fixed at its start value.
    #[must_use]
    pub fn fixed(mut self) -> Self {
        self.fixed = true;
        self
    }

    /// With a random walk of this relative standard deviation per block.
    #[must_use]
    pub fn walking(mut self, share_per_block: f64) -> Self {
        self.random_walk = share_per_block;
        self
    }

    /// The nearest value within the bounds.
    pub(crate) fn clamp(&self, value: f64) -> f64 {
        value.clamp(self.lower, self.upper)
    }

    /// True for a value within the bounds.
    pub(crate) fn allows(&self, value: f64) -> bool {
        (self.lower..=self.upper).contains(&value)
    }
}

/// Writes the start values.
pub(crate) fn starts(priors: &[ParameterPrior], theta: &mut [f64]) {
    for (theta, prior) in theta.iter_mut().zip(priors) {
        *theta = prior.start;
    }
}

impl From<f64> for ParameterPrior {
    fn from(start: f64) -> Self {
        Self::new(start)
    }
}

/// Prior knowledge of the noise of an equation's rows.
///
/// Errors name its fields like the lists in the configuration files: `noise_std`, `noise_floor`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EquationNoise {
    /// Standard deviation by which the rows are divided, in the equation's unit, so that equations
    /// that share parameters have the right relative weights; finite, > 0. 1 leaves the rows
    /// unchanged.
    pub std: f64,
    /// Lower limit of the noise standard deviation of the divided rows; finite, ≥ 0. Prevents
    /// rounding errors in noise-free data from raising alarms.
    pub floor: f64,
}

impl EquationNoise {
    /// Unknown noise: the rows are unchanged, and their noise is learnt from the residuals.
    pub const LEARNT: Self = Self { std: 1.0, floor: 0.0 };
    /// Rows that are already divided by their noise, such as those over windows: residuals below 1
    /// are chance, residuals far above it are a misfit.
    pub const WHITENED: Self = Self { std: 1.0, floor: 1.0 };
}
