//! What is known before any data: of a parameter, and of the noise of an equation.

/// What is known of one parameter before any data.
///
/// Errors name its fields as the lists of the configuration files: `theta_start`, `start_std`,
/// `lower`, `upper`, `random_walk`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ParameterPrior {
    /// Start value θ̂₀, in the parameter's unit; finite and within the bounds.
    pub start: f64,
    /// Standard deviation of the start value, in the parameter's unit; finite, ≥ 0. It is the
    /// deviation reported until data come, not the weight of the start value, which is
    /// [`information_floor`](super::EstimatorOptions::information_floor).
    pub std: f64,
    /// Lower bound, in the parameter's unit; `-inf` for none.
    pub lower: f64,
    /// Upper bound, in the parameter's unit; `inf` for none.
    pub upper: f64,
    /// The start value holds: it is not estimated.
    pub fixed: bool,
    /// Standard deviation of its random walk per block, as a share of the parameter; finite, ≥ 0.
    /// For drifting plants; 0 for a constant.
    pub random_walk: f64,
}

impl ParameterPrior {
    /// A start as uncertain as it is large, without bounds.
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

    /// Held at its start.
    #[must_use]
    pub fn fixed(mut self) -> Self {
        self.fixed = true;
        self
    }

    /// Walking at random by this share of the parameter per block, a standard deviation.
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

/// What is known of the noise of an equation's rows before any data.
///
/// Errors name its fields as the lists of the configuration files: `noise_std`, `noise_floor`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EquationNoise {
    /// Standard deviation by which the rows are divided, in the equation's unit, so that equations
    /// that share parameters weigh what they are worth; finite, > 0. 1 leaves the rows as they are.
    pub std: f64,
    /// Smallest standard deviation of the divided rows that is believed; finite, ≥ 0. Noise-free
    /// data would otherwise alarm on rounding.
    pub floor: f64,
}

impl EquationNoise {
    /// Nothing is known: rows as they are, their noise learnt from the residuals.
    pub const LEARNT: Self = Self { std: 1.0, floor: 0.0 };
    /// Rows that are divided by their noise already, as those over windows are: less than it is
    /// luck, much more a misfit.
    pub const WHITENED: Self = Self { std: 1.0, floor: 1.0 };
}
