//! Estimators. They see rows, never a model or the simulator, so they work for any plant and cannot
//! see the truth.
//!
//! ```text
//! f_n(θ)                residual of a scalar equation at sample n, (5); f = s·u − Σ_d (d/dt)^d g_d
//! φ_n(θ) = −∂f_n/∂θ     regressor, (7)
//! v_n = f_n(θ̂) + φ_nᵀ θ̂      the signal of the linear form (1)
//! ```
//!
//! | module | estimator | equations |
//! |---|---|---|
//! | [`Wrls`] | sample by sample, linear in θ, exponential forgetting | (2)–(4) |
//! | [`batch_least_squares`] | a whole record at once, linear or nonlinear, with its rank | the least squares of section 1 |
//! | [`cedro`] | the paper's block recursion on one page, for readers and as an oracle | (5)–(11) |
//! | [`BlockEstimator`] | block by block, nonlinear in θ, every forgetting rule | (6)–(11) and beyond |

mod block;
mod block_prior;
mod bound;
mod cause_search;
pub mod cedro;
mod change;
mod change_search;
mod clusters;
mod conditioning;
mod confirmation;
mod considered;
mod considered_covariance;
mod constrained;
mod curvature;
mod curved_group;
mod drift;
mod drift_watch;
mod drifting_group;
mod equation;
mod equations;
mod error_covariance;
mod evidence;
mod explained;
mod fit;
mod fit_statistic;
mod forgetting;
mod group;
mod groups;
mod index_set;
mod information;
mod inquiry;
mod inquiry_step;
mod limits;
pub(crate) mod linalg;
mod line;
mod long_run;
mod offline;
mod options;
mod pass;
pub(crate) mod persist;
mod presets;
mod prior;
mod relation;
mod report;
mod robust;
mod score_sums;
mod score_test;
mod sizes;
mod state;
pub(crate) mod stats;
mod summed_evidence;
mod summed_rows;
mod suspect_rows;
mod suspicion;
mod tally;
mod widened;
mod workspace;
mod wrls;

pub use block::BlockEstimator;
pub use bound::{CovarianceBound, Factor, Polynomial, Rational};
pub use cause_search::Cause;
pub use considered::PER_EQUATION as ERRORS_PER_EQUATION;
pub use explained::LEAST_EXPLAINED;
pub use fit_statistic::MISFIT;
pub use index_set::IndexSet;
pub use offline::{BatchReport, batch_least_squares};
pub use options::{Bound, ChangeDetection, EstimatorError, EstimatorOptions, Forgetting, Outliers, forgetting_factor};
pub use persist::{EstimatorState, StateError};
pub use presets::{
    CEDRO2022_BLOCK_LEN, CEDRO2022_START, cedro2022_best_estimator, cedro2022_best_start, cedro2022_estimator,
};
pub(crate) use prior::starts;
pub use prior::{EquationNoise, ParameterPrior};
pub use report::{Change, ChangeKind, Held, Report};
pub use state::{Phase, StateMachine, Verdict};
pub use suspect_rows::SuspectRows;
pub use suspicion::Suspicion;
pub use wrls::{Wrls, WrlsError};

use std::ops::Range;
use suspect_rows::NoSuspects;

/// Largest number of parameters of an estimator.
pub const MAX_PARAMS: usize = 128;

/// Which parameters each equation depends on; the estimator's whole knowledge of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Number of parameters P.
    pub params: usize,
    /// For each equation the indices of its parameters. Equations may share parameters.
    pub equations: Vec<Range<usize>>,
}

/// Parameters that are estimated together, because some equation links them: a connected component
/// of the graph of equations and parameters, and a least squares problem of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// The parameters: overlapping ranges merge into one.
    pub parameters: Range<usize>,
    /// The equations that depend on them.
    pub equations: Vec<usize>,
}

impl Structure {
    /// The independent groups, ordered by their first parameter. A parameter of no equation is in
    /// no group.
    pub fn groups(&self) -> Vec<Group> {
        let mut order: Vec<usize> = (0..self.equations.len())
            .filter(|&e| !self.equations[e].is_empty())
            .collect();
        order.sort_by_key(|&e| (self.equations[e].start, self.equations[e].end));
        let mut groups: Vec<Group> = Vec::new();
        for e in order {
            let range = self.equations[e].clone();
            match groups.last_mut() {
                Some(group) if range.start < group.parameters.end => {
                    group.parameters.end = group.parameters.end.max(range.end);
                    group.equations.push(e);
                }
                _ => groups.push(Group {
                    parameters: range,
                    equations: vec![e],
                }),
            }
        }
        for group in &mut groups {
            group.equations.sort_unstable();
        }
        groups
    }
}

/// A block of samples as residuals of scalar equations, to be evaluated at any θ.
///
/// Row `index` of `0..len()` exists for each equation. Rows are ordered in time.
pub trait Residuals {
    /// Number of rows per equation in the block: the sample instants of the pointwise form, the
    /// windows of the projected one.
    fn len(&self) -> usize;
    /// True if the block has no rows.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Residual f_n(θ); writes the regressor φ_n = −∂f_n/∂θ over the equation's own parameters.
    ///
    /// `theta` holds all parameters of the plant, `regressor` has the length of the equation's
    /// range in [`Structure`].
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64;
    /// First and last instant that the row depends on, in the unit in which a located change is
    /// reported (stream time in ns). Both are the sample's own time in the pointwise form. The
    /// default counts rows.
    fn span(&self, index: usize) -> (u64, u64) {
        (index as u64, index as u64)
    }
    /// A better starting point than the configured one, for an estimator without data: all
    /// parameters of the plant. `None`, the default, if the rows have no better one.
    fn start(&self) -> Option<&[f64]> {
        None
    }
    /// False for a row at which its equation does not hold, such as for a joint that friction holds
    /// at rest. Such a row has residual 0 and regressor 0, and counts neither as a row nor as a
    /// degree of freedom. By default all rows are used.
    fn is_used(&self, _equation: usize, _index: usize) -> bool {
        true
    }
    /// The row whitened forwards in time, for sums over the start of a block.
    ///
    /// Overlapping rows are whitened: row `index` of [`row`](Self::row) depends only on the windows
    /// `index..len()`, so a sum from any row to the end is the cost of these windows alone, with
    /// nothing from before a change. Here row `index` depends only on the windows `0..=index`, so a
    /// sum from the start to any row is the cost of these windows alone. Sums over the whole block
    /// are equal. The same as `row` if rows do not overlap.
    fn row_forward(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.row(equation, index, theta, regressor)
    }
    /// Residual at θ of a window that ends with the block, in its standard deviations if the model
    /// and θ are right; `k` counts from 0. `None`, the default, if there is no such window. A plant
    /// that changes just before the block ends shows here first.
    fn tail(&self, _equation: usize, _k: usize, _theta: &[f64]) -> Option<f64> {
        None
    }
    /// Variance that the noise of the sensors alone gives a row of an equation. `None`, the
    /// default, if it is not known.
    fn sensor_variance(&self, _equation: usize) -> Option<f64> {
        None
    }
    /// Pairs (b, a): parameter b occurs only in products, one of them with parameter a, which also
    /// occurs alone. The rows may show such a product far better than its factors (`curvature.rs`).
    /// No pairs by default.
    fn products(&self) -> &[(usize, usize)] {
        &[]
    }
    /// The errors of the model for which the rows have a column. None by default.
    fn suspect_rows(&self) -> &dyn SuspectRows {
        &NoSuspects
    }
}

/// The rows of a block in their forward form.
struct Forward<'a>(&'a dyn Residuals);

impl Residuals for Forward<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.0.row_forward(equation, index, theta, regressor)
    }
    fn span(&self, index: usize) -> (u64, u64) {
        self.0.span(index)
    }
    fn is_used(&self, equation: usize, index: usize) -> bool {
        self.0.is_used(equation, index)
    }
}
