//! The block recursion (6)–(11): one estimate with its evidence per block of samples.
//!
//! Each independent [`Group`](super::Group) of parameters is a least squares problem of its own, see `group.rs` for its equations.

use super::group::GroupState;
use super::options::{EstimatorError, EstimatorOptions};
use super::{Residuals, Structure};

/// Why a block gave no new estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Held {
    /// The block holds no rows.
    Empty,
    /// A residual or regressor is not finite at the present estimate.
    NotFinite,
}

/// The answer to a block with its evidence. Parameters in the plant's units and order, equations in the structure's order.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// θ̂.
    pub theta: Vec<f64>,
    /// Standard deviation of θ̂; 0 for a fixed parameter.
    pub theta_std: Vec<f64>,
    /// Root mean square of f(θ̂ before the update) per equation, in the equation's unit.
    pub innovation_rms: Vec<f64>,
    /// Root mean square of f(θ̂ after the update) per equation, in the equation's unit.
    pub residual_rms: Vec<f64>,
    /// Estimated noise standard deviation per equation, in the equation's unit.
    pub noise_std: Vec<f64>,
    /// Per parameter how much of it the block informed on, 0 to 1.
    pub excitation: Vec<f64>,
    /// Bit i: the block informed on parameter i.
    pub excited: u64,
    /// Bit i: parameter i is known well enough to be used.
    pub usable: u64,
    /// Bit i: parameter i is fixed.
    pub fixed: u64,
    /// Blocks taken so far, this one included.
    pub blocks: u64,
    /// Rows per equation in this block.
    pub rows: usize,
    /// Number of independent directions that the block informed on, at most the number of parameters.
    pub rank: usize,
    /// Gauss–Newton iterations, the largest number of any group.
    pub iterations: u32,
    /// False where the iterations ran out.
    pub converged: bool,
    /// Rows treated as outliers.
    pub outliers: u32,
    /// Condition number of the column-scaled information, the largest of any group, `inf` where singular.
    pub condition: f64,
    /// Why there is no new estimate.
    pub held: Option<Held>,
}

/// On-line identification block by block. The update neither allocates nor locks; equal input gives bit-identical output.
#[derive(Debug, Clone)]
pub struct BlockEstimator {
    structure: Structure,
    options: EstimatorOptions,
    groups: Vec<GroupState>,
    theta: Vec<f64>,
    report: Report,
}

impl BlockEstimator {
    /// Relative standard deviation below which a parameter counts as usable, times three.
    const USABLE: f64 = 0.05;

    /// An estimator at its start values.
    ///
    /// # Errors
    /// Where the options do not fit the structure or are out of range.
    pub fn new(structure: Structure, options: EstimatorOptions) -> Result<Self, EstimatorError> {
        options.validate(&structure)?;
        let groups: Vec<GroupState> = structure
            .groups()
            .iter()
            .map(|group| GroupState::new(group, &structure, &options))
            .collect();
        let (params, equations) = (structure.params, structure.equations.len());
        let report = Report {
            theta: options.theta_start.clone(),
            theta_std: options.start_std.clone(),
            innovation_rms: vec![0.0; equations],
            residual_rms: vec![0.0; equations],
            noise_std: vec![0.0; equations],
            excitation: vec![0.0; params],
            excited: 0,
            usable: 0,
            fixed: 0,
            blocks: 0,
            rows: 0,
            rank: 0,
            iterations: 0,
            converged: true,
            outliers: 0,
            condition: 1.0,
            held: None,
        };
        let mut estimator = Self {
            theta: options.theta_start.clone(),
            structure,
            options,
            groups,
            report,
        };
        estimator.describe();
        Ok(estimator)
    }

    /// The structure that the estimator was made for.
    pub fn structure(&self) -> &Structure {
        &self.structure
    }

    /// The options in force.
    pub fn options(&self) -> &EstimatorOptions {
        &self.options
    }

    /// θ̂.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// The evidence of the last block.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Back to the start values and to knowing nothing.
    pub fn reset(&mut self) {
        // allocates: not a part of the step
        for (state, group) in self.groups.iter_mut().zip(self.structure.groups()) {
            *state = GroupState::new(&group, &self.structure, &self.options);
        }
        self.theta.copy_from_slice(&self.options.theta_start);
        self.report.blocks = 0;
        self.describe();
    }

    /// Information Γ⁻¹ of the group that holds `parameter`, in (parameters, row-major matrix); `None` where no equation has it.
    pub fn information(&self, parameter: usize) -> Option<(std::ops::Range<usize>, &[f64])> {
        let group = self.groups.iter().find(|g| g.parameters.contains(&parameter))?;
        Some((group.parameters.clone(), &group.information))
    }

    /// Covariance of two parameters' errors; 0 between independent groups.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        self.groups
            .iter()
            .find(|g| g.parameters.contains(&i) && g.parameters.contains(&j))
            .map_or(0.0, |g| {
                let start = g.parameters.start;
                g.covariance[(i - start) * g.n + j - start]
            })
    }

    /// Writes the correlation matrix, P × P and row-major; 1 on the diagonal, 0 for what has no deviation.
    pub fn correlation(&self, out: &mut [f64]) {
        let params = self.structure.params;
        for i in 0..params {
            for j in 0..params {
                let scale = (self.covariance(i, i) * self.covariance(j, j)).sqrt();
                let value = if scale > 0.0 {
                    self.covariance(i, j) / scale
                } else {
                    0.0
                };
                out[i * params + j] = if i == j { 1.0 } else { value.clamp(-1.0, 1.0) };
            }
        }
    }

    /// Takes a block and returns the estimate with its evidence.
    ///
    /// An empty block, and one whose rows are not finite, leaves everything as it is and says so in [`Report::held`].
    pub fn update<R: Residuals>(&mut self, rows: &R) -> &Report {
        let report = &mut self.report;
        report.rows = rows.len();
        report.blocks += 1;
        report.held = None;
        (report.iterations, report.converged, report.outliers) = (0, true, 0);
        if rows.is_empty() {
            report.held = Some(Held::Empty);
            report.excited = 0;
            report.rank = 0;
            report.excitation.fill(0.0);
            return &self.report;
        }
        report.innovation_rms.fill(0.0);
        report.residual_rms.fill(0.0);
        for group in &mut self.groups {
            match group.update(rows, &mut self.theta, &self.options) {
                Some(fit) => {
                    report.iterations = report.iterations.max(fit.iterations);
                    report.converged &= fit.converged;
                }
                None => report.held = Some(Held::NotFinite),
            }
        }
        self.describe();
        &self.report
    }

    fn describe(&mut self) {
        let report = &mut self.report;
        report.theta.copy_from_slice(&self.theta);
        (
            report.excited,
            report.usable,
            report.fixed,
            report.rank,
            report.condition,
        ) = (0, 0, 0, 0, 1.0);
        for (i, fixed) in self.options.fixed.iter().enumerate() {
            report.fixed |= u64::from(*fixed) << i;
        }
        for group in &self.groups {
            let start = group.parameters.start;
            for i in 0..group.n {
                let std = group.covariance[i * group.n + i].max(0.0).sqrt();
                report.theta_std[start + i] = std;
                let share = group.excitation.share(i);
                report.excitation[start + i] = share;
                report.excited |= u64::from(share > 0.5) << (start + i);
                let usable = 3.0 * std < Self::USABLE * self.theta[start + i].abs();
                report.usable |= u64::from(usable) << (start + i);
            }
            report.rank += group.excitation.rank;
            report.condition = report.condition.max(group.condition);
            for (e, sums) in group.equations.iter().zip(&group.at) {
                let divisor = self.options.noise_std[e.index];
                let rms = |cost: f64| {
                    if sums.rows > 0 {
                        (cost / sums.rows as f64).sqrt() * divisor
                    } else {
                        0.0
                    }
                };
                report.residual_rms[e.index] = rms(sums.cost);
                report.innovation_rms[e.index] = rms(e.innovation_cost);
                report.noise_std[e.index] = e.variance.sqrt() * divisor;
            }
        }
    }
}
