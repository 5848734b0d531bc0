//! What a block gives: the estimate with its evidence.

use super::score_test::Suspicion;

/// Why a block gave no new estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Held {
    /// The block holds no rows.
    Empty,
    /// A residual or regressor is not finite at the present estimate.
    NotFinite,
}

/// What an alarm turned out to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChangeKind {
    /// Nothing changed inside the block, but the plant is another one than before it.
    Between,
    /// The plant changed at [`Change::row`]; only rows from there on were used.
    Within,
    /// The parameters move slowly; the estimate is the mean over the block.
    Drift,
}

/// A change of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Change {
    /// What kind of change.
    pub kind: ChangeKind,
    /// First row of the block that belongs to the plant as it is now.
    pub row: usize,
    /// First instant of that row, in the unit of [`span`](super::Residuals::span).
    pub time: u64,
}

/// The answer to a block with its evidence. Parameters in the plant's units and order, equations in the structure's order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// θ̂, with [`EstimatorOptions::relations`](super::EstimatorOptions::relations) imposed.
    pub theta: Vec<f64>,
    /// Standard deviation of θ̂; 0 for a fixed parameter.
    pub theta_std: Vec<f64>,
    /// Root mean square of f(θ̂ before the update) per equation, in the equation's unit.
    pub innovation_rms: Vec<f64>,
    /// Root mean square of f(θ̂ after the update) over the rows used, per equation, in the equation's unit.
    pub residual_rms: Vec<f64>,
    /// Estimated noise standard deviation per equation, in the equation's unit.
    pub noise_std: Vec<f64>,
    /// Root mean square of √Σ(φ_i θ_i)² per equation, in the equation's unit: the size of what the equation balances.
    pub signal_rms: Vec<f64>,
    /// Per parameter the share of the variance of a parameter known to within 100 % that this block alone would remove, 0 to 1.
    pub excitation: Vec<f64>,
    /// Bit i: the block informed on parameter i, to a third of its size at least.
    pub excited: u128,
    /// Bit i: parameter i is known from data. Three standard deviations of it are below 5 %, by what the data since the last change say; its group of
    /// equations showed no change in this block or the one before, and both fit in each of its equations; no parameter of its group is
    /// held by a bound against the data. A fixed parameter is nobody's finding and never usable.
    pub usable: u128,
    /// χ² of the whitened residuals over their number, per equation, see `fit_statistic.rs`: 1 on average if the block fits. Relative to the noise
    /// that was told, otherwise to the level that was learnt before the block.
    pub fit: Vec<f64>,
    /// Probability of residuals as large as these, in the block or in its last part, if the model is right; below 1e-4 the block does not fit.
    pub fit_probability: f64,
    /// Bit e: the block does not fit in equation e.
    pub misfit: u64,
    /// Share of the power of the equation's signal that the model explains, of the last block in which it stood out of the noise; 0 before.
    pub explained: Vec<f64>,
    /// Bit i: parameter i sits on a bound and the data push it outwards, or another one of its group does.
    pub pressed: u128,
    /// True once the data have informed on more than half of the directions of the free parameters, in every group of equations.
    pub informed: bool,
    /// Bit i: parameter i is fixed.
    pub fixed: u128,
    /// Blocks taken so far, this one included.
    pub blocks: u64,
    /// Rows per equation in this block.
    pub rows: usize,
    /// Number of independent directions that the block informed on, at most the number of parameters.
    pub rank: usize,
    /// Gauss–Newton iterations of the estimate, the largest number of any group.
    pub iterations: u32,
    /// False where the iterations ran out.
    pub converged: bool,
    /// Rows treated as outliers, over all equations.
    pub outliers: u32,
    /// Condition number of the column-scaled information, the largest of any group, `inf` where singular.
    pub condition: f64,
    /// Probability of a block as different from the past as this one, were the plant unchanged; the smallest of any group.
    pub change_probability: f64,
    /// The change found in this block.
    pub change: Option<Change>,
    /// The likeliest term that the model lacks, where the residuals speak for one.
    pub suspicion: Option<Suspicion>,
    /// Why there is no new estimate.
    pub held: Option<Held>,
}
