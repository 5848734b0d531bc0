//! A first θ for the weights of the rows, until the estimator has one.
//!
//! ```text
//! θ → R(θ), q̂(θ) → rows → θ = argmin Σ f²          repeated for each of the first blocks
//! ```
//!
//! R and the smoothed positions q̂ depend on θ, which is not known well enough at first. The first
//! blocks are therefore fitted alone, each several times with the R and q̂ of the fit before, until
//! every parameter is known to within 50 %. Both must use the same θ: positions smoothed with a θ
//! that does not minimise the block's residuals agree with that θ afterwards, and the estimator
//! would confidently adopt it. With encoders of 13 bits and smooth motion with rests, 3 % of the
//! blocks were then called misfits or changes, and the error of θ₅ was 18 times the Cramér–Rao
//! bound; docs/efficiency.md has the present errors.
//!
//! A block that does not inform on some parameter is fitted together with those before, and R uses
//! the start value of each parameter that is not known to within 50 %: the arbitrary inertia of a
//! joint that has not moved would spoil the weights.
//!
//! Later the same fit is used for a block that θ̂ before it does not explain: the block is fitted
//! alone, and its positions are smoothed with that fit.

use super::projection::Projection;
use crate::estimator::{
    BlockEstimator, EstimatorError, EstimatorOptions, EstimatorState, ParameterPrior, Structure, starts,
};
use crate::model::AnyPlant;
use crate::rows::pointwise::priors;
use crate::rows::start::StartFinder;
use crate::rows::theta_polynomial::Polynomial;

/// Largest number of blocks that are fitted for their weights.
const FIRST_BLOCKS: u32 = 10;
/// Number of fits of a first block, each with the weights of the fit before.
const ROUNDS: usize = 3;
/// Relative standard deviation below which a parameter is known well enough for weights.
const KNOWN: f64 = 0.5;
/// Standard deviation, relative to that of the start, above which a fit does not inform on a
/// parameter.
const NOTHING: f64 = 100.0;
/// Mean square of whitened residuals above which they contain more than noise.
const FAR: f64 = 2.0;

/// The fit of the first blocks.
#[derive(Debug, Clone)]
pub(super) struct FirstFit {
    estimator: BlockEstimator,
    /// Blocks that may still be fitted.
    left: u32,
    /// Finds an alternative to the configured start, if there can be more than one minimum.
    finder: Option<StartFinder>,
    /// True if the block was the first one, so its θ̂ is a better start for the estimator.
    begins: bool,
    /// θ of the weights.
    settled: Vec<f64>,
    /// The fit of the blocks before together with this one.
    together: EstimatorState,
}

impl FirstFit {
    /// A fit with the plant's start values and bounds.
    ///
    /// # Errors
    /// If start values, bounds and structure do not fit together.
    pub fn new(plant: &dyn AnyPlant, structure: Structure) -> Result<Self, EstimatorError> {
        let mut options = EstimatorOptions::recommended(priors(plant), plant.equations().len());
        options.change_detection = None;
        let mut estimator = BlockEstimator::new(structure, options)?;
        let mut together = EstimatorState::default();
        estimator.remember(&mut together);
        Ok(Self {
            together,
            left: FIRST_BLOCKS,
            finder: None,
            begins: false,
            settled: estimator.theta().to_vec(),
            estimator,
        })
    }

    /// The same with a second start, from the rows of these equations.
    #[must_use]
    pub fn with_finder(mut self, equations: &[Option<Polynomial>]) -> Self {
        self.finder = StartFinder::new(equations, self.settled.len());
        self
    }

    /// The same from other start values.
    ///
    /// # Errors
    /// If there is not exactly one finite value within its bounds per parameter.
    pub fn starting_at(mut self, structure: Structure, theta: &[f64]) -> Result<Self, EstimatorError> {
        let mut options = self.estimator.options().clone();
        // validating the options refuses too few or too many
        options.parameters.resize(theta.len(), ParameterPrior::new(0.0));
        for (prior, &start) in options.parameters.iter_mut().zip(theta) {
            (prior.start, prior.std) = (start, start.abs());
        }
        self.estimator = BlockEstimator::new(structure, options)?;
        self.settled.copy_from_slice(theta);
        Ok(self)
    }

    /// A better start for the estimator; `None` after the first block.
    pub fn start(&self) -> Option<&[f64]> {
        self.begins.then(|| self.estimator.theta())
    }

    /// Stops fitting blocks for their weights: the estimator knows θ.
    pub fn end(&mut self) {
        (self.left, self.begins) = (0, false);
    }

    /// Begins again: θ is unknown, so the next blocks are fitted for their weights like the first
    /// ones.
    pub fn restart(&mut self) {
        self.estimator.reset();
        self.settled.copy_from_slice(self.estimator.theta());
        (self.left, self.begins) = (FIRST_BLOCKS, false);
    }

    /// Weights and smooths the rows of a block: with its own fit for the first blocks, and with θ̂
    /// before the block from then on.
    pub fn weigh(&mut self, rows: &mut Projection, theta: &[f64]) {
        if self.left > 0 {
            self.fit(rows);
        } else {
            self.begins = false;
            rows.weigh(theta);
            self.smooth_near(rows, theta);
        }
    }

    /// Fits one of the first blocks for the weights of its rows.
    fn fit(&mut self, rows: &mut Projection) {
        self.begins = self.left == FIRST_BLOCKS;
        self.left -= 1;
        // what an earlier θ lets expect of the noise may be far off
        rows.draw_anew();
        rows.weigh(&self.settled);
        if self.begins {
            self.estimator.update(rows);
            self.try_other_start(rows);
            // once more with the regressors of the smoothed positions
            rows.weigh(&self.settled);
        }
        self.smooth(rows);
        self.estimator.update(rows);
        if (0..self.settled.len()).all(|i| self.knows(i)) {
            self.left = 0;
        }
        self.estimator.remember(&mut self.together);
        for _ in 0..ROUNDS {
            self.weigh_and_smooth(rows);
            self.estimator.restart(&self.settled);
            self.estimator.update(rows);
            if !self.informs_on_all() {
                self.estimator.go_back(&self.together);
                self.keep_known_or(None);
                rows.weigh(&self.settled);
                self.smooth(rows);
                return;
            }
        }
        self.weigh_and_smooth(rows);
    }

    /// True if the fit informs on every parameter.
    fn informs_on_all(&self) -> bool {
        let (report, options) = (self.estimator.report(), self.estimator.options());
        let mut pairs = report.theta_std.iter().zip(&options.parameters);
        pairs.all(|(std, prior)| *std < NOTHING * prior.std)
    }

    /// True if the fit determines a parameter well enough for weights.
    fn knows(&self, i: usize) -> bool {
        let report = self.estimator.report();
        report.theta_std[i] < KNOWN * report.theta[i].abs()
    }

    /// Adopts the parameters that the fit determines well enough, and `otherwise`, or the start
    /// values, for the rest.
    fn keep_known_or(&mut self, otherwise: Option<&[f64]>) {
        for i in 0..self.settled.len() {
            self.settled[i] = if self.knows(i) {
                self.estimator.theta()[i]
            } else {
                otherwise.map_or(self.estimator.options().parameters[i].start, |theta| theta[i])
            };
        }
    }

    /// Computes R and the smoothed positions at the fit.
    fn weigh_and_smooth(&mut self, rows: &mut Projection) {
        self.settled.copy_from_slice(self.estimator.theta());
        rows.weigh(&self.settled);
        self.smooth(rows);
    }

    /// Also fits the first block from the start that its rows give, and continues with the better
    /// of the two.
    fn try_other_start(&mut self, rows: &Projection) {
        let Some(finder) = &mut self.finder else { return };
        let estimator = &mut self.estimator;
        let configured = rows.mean_square(estimator.theta());
        let row = |e: usize, row: usize, factors: &mut [f64]| rows.linear_row(e, row, factors);
        let count = rows.block.samples.windows.len();
        let theta = finder.find(count, row, &estimator.options().parameters);
        self.settled.copy_from_slice(estimator.theta());
        estimator.restart(theta);
        estimator.update(rows);
        if rows.mean_square(estimator.theta()) > configured {
            estimator.restart(&self.settled);
            estimator.update(rows);
        }
        starts(&estimator.options().parameters, &mut self.settled);
    }

    /// Smooths with the residuals at the fit; keeps the measured positions if these contain more
    /// than noise.
    fn smooth(&self, rows: &mut Projection) {
        let theta = self.estimator.theta();
        if rows.mean_square(theta) < FAR {
            rows.smooth(theta);
        } else {
            rows.keep_measured(theta);
        }
    }

    /// Smooths with the residuals at θ̂ before the block, or at a fit of this block alone if the
    /// plant has changed since. Keeps the measured positions if the residuals still contain more
    /// than noise.
    ///
    /// A parameter that the block does not determine to within 50 % keeps its value: with hardly
    /// any motion its fitted value is arbitrary, and positions smoothed to agree would confirm it.
    fn smooth_near(&mut self, rows: &mut Projection, theta: &[f64]) {
        if rows.mean_square(theta) < FAR {
            rows.smooth(theta);
            return;
        }
        self.estimator.restart(theta);
        self.estimator.update(rows);
        self.keep_known_or(Some(theta));
        if rows.mean_square(&self.settled) < FAR {
            rows.smooth(&self.settled);
        } else {
            rows.keep_measured(&self.settled);
        }
    }
}
