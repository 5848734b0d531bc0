//! Noise in the regressors, as a draw of the sensors' noise shows it.
//!
//! ```text
//! (1)  n = σ_q s,  s_k = ±1 at random        δ = n for measured positions
//! (2)  f_n = C n + (noise of the inputs)     δ = n − Σ_q Cᵀ R⁻¹ f_n for smoothed ones, of all equations
//! (3)  δZ = Z(q̂ + δ) − Z(q̂)                  N = δZᵀ R⁻¹ δZ
//! (4)  N ≈ N₀ max_j w_j/w_j₀                   w_j = Σ_i σ_j²(k_i)/R_ii        N₀, w₀ of the last draw
//! ```
//!
//! Smoothed positions (`errors_in_variables.rs`) still have the error δ that the residuals do not
//! show. It is independent of them, so it does not bias the score, but it lengthens the regressors.
//! If a joint hardly moves, most of Σ φ R⁻¹ φᵀ may be noise. `calibration.rs` uses N (3).
//!
//! In most blocks N does not matter, and a draw costs a fifth of the end of a block. If the last
//! draw was far from mattering, and (4) is so beside what this block shows of the motion, nothing
//! is drawn. w accounts for other noise levels, weights and numbers of rows: k_i is the centre of
//! row i. The margin covers what (4) neglects, such as the place of the arm.

use super::calibration::Calibration;
use super::covariance::RowCovariance;
use super::measured::MeasuredBlock;
use super::reversals;
use super::shared_errors::SharedErrors;
use super::whitened_rows::WhitenedRows;
use super::windows::Window;
use crate::random::{GOLDEN, mix};
use crate::rows::standstill::Standstill;
use crate::rows::trajectory::Trajectory;
use crate::rows::whitening::{Direction, Whitening};

/// Draws of a block if the first is not negligible.
const DRAWS: u64 = 2;

/// Blocks from one draw to the next at most.
const BLOCKS: i64 = 12;

/// The rows of a block, and the signals that their regressors are computed from.
pub(super) struct Rows<'a> {
    pub block: &'a MeasuredBlock,
    pub covariance: &'a RowCovariance,
    pub shared: &'a mut SharedErrors,
    pub standstill: &'a Standstill,
    pub signals: &'a Trajectory,
    /// False if these are the measured signals.
    pub smoothed: bool,
}

/// Draws of the noise, and what they do to the regressors.
#[derive(Debug, Clone)]
pub(super) struct RegressorNoise {
    /// First errors in place of the signals, in standard deviations: s, and then δ for positions.
    /// At last the positions with δ, and what follows from them.
    noisy: Trajectory,
    /// R⁻¹ f_n \[equation\]\[row\].
    weighted: Vec<Vec<f64>>,
    /// δZ of an equation \[column\]\[row\].
    columns: Vec<Vec<f64>>,
    calibrations: Vec<Calibration>,
    /// Number of the first window's centre in the last block with a draw, if that was far from
    /// mattering; w of that block, and of this one \[equation × joints + joint\].
    drawn_at: Option<i64>,
    drawn_weights: Vec<f64>,
    weights: Vec<f64>,
}

impl RegressorNoise {
    /// Workspace for a block and `rows` rows of each equation.
    pub fn new(block: &MeasuredBlock, rows: usize) -> Self {
        let separation = &block.form.separation;
        let count = |e: usize| separation.equations[e].as_ref().map_or(0, |p| p.monomials.len());
        let counts = (0..block.form.equations()).map(count);
        let (joints, capacity) = (block.form.plant.joints(), block.samples.capacity());
        let weights = vec![0.0; block.form.equations() * joints];
        Self {
            noisy: Trajectory::new(joints, separation.features, capacity),
            weighted: vec![vec![0.0; rows]; block.form.equations()],
            columns: vec![vec![0.0; rows]; counts.clone().max().unwrap_or(0)],
            calibrations: counts.map(Calibration::new).collect(),
            drawn_at: None,
            drawn_weights: weights.clone(),
            weights,
        }
    }

    /// Draws in the next block in any case.
    pub fn forget(&mut self) {
        self.drawn_at = None;
    }

    /// True if this block needed no draw.
    #[cfg(test)]
    pub fn was_skipped(&self, block: &MeasuredBlock) -> bool {
        let first = block.samples.windows.all().first();
        self.drawn_at.is_some() && self.drawn_at != first.map(|window| window.number)
    }

    /// Frees the columns of every equation of noise.
    pub fn remove(&mut self, rows: &mut Rows<'_>, whitened: &mut WhitenedRows) {
        let windows = rows.block.samples.windows.all();
        for (e, calibration) in self.calibrations.iter_mut().enumerate() {
            let ([forward, _], _) = whitened.factors(e);
            calibration.begin(forward, windows.len());
        }
        self.weigh(rows.block, &whitened.whitening);
        if self.is_negligible(rows) {
            return;
        }
        self.forget();
        for draw in 0..DRAWS {
            self.draw(rows, &whitened.whitening, draw);
            let mut matters = false;
            for e in 0..self.calibrations.len() {
                let ([forward, _], whitening) = whitened.factors(e);
                self.project(rows.block, e, whitening, forward);
                matters |= self.calibrations[e].add(&self.columns[..forward.len()], windows.len());
            }
            if !matters {
                self.keep(rows);
                return;
            }
        }
        for (e, calibration) in self.calibrations.iter_mut().enumerate() {
            if calibration.solve() {
                for columns in whitened.factors(e).0 {
                    calibration.apply(columns, windows.len());
                }
            }
        }
    }

    /// w of each equation and joint (4).
    fn weigh(&mut self, block: &MeasuredBlock, whitening: &[Whitening]) {
        let windows = block.samples.windows.all();
        for (weights, whitening) in self.weights.chunks_exact_mut(self.noisy.q.len()).zip(whitening) {
            for (weight, std) in weights.iter_mut().zip(&block.noise.q_std) {
                let share = |(i, window): (usize, &Window)| std[window.centre].powi(2) / whitening.variance(i);
                *weight = windows.iter().enumerate().map(share).sum();
            }
        }
    }

    /// True if the last draw shows that the noise is far from mattering in this block, too (4).
    fn is_negligible(&self, rows: &Rows<'_>) -> bool {
        let samples = &rows.block.samples;
        let (Some(drawn_at), Some(first)) = (self.drawn_at, samples.windows.all().first()) else {
            return false;
        };
        // 0 if the same block is weighted again
        let since = first.number - drawn_at;
        rows.smoothed && since > 0 && since < BLOCKS * samples.block_len() as i64 && self.expects_little()
    }

    /// True if N (4) is far from mattering in every equation; not if a number is not finite.
    fn expects_little(&self) -> bool {
        let ratios = self.weights.iter().zip(&self.drawn_weights);
        let mut growths = ratios.map(|(own, drawn)| own / drawn);
        let joints = self.noisy.q.len();
        let mut calibrations = self.calibrations.iter();
        calibrations.all(|calibration| {
            growths
                .by_ref()
                .take(joints)
                .all(|growth| calibration.expects_little(growth))
        })
    }

    /// Keeps N and w of a block whose noise did not matter, for the blocks to come.
    fn keep(&mut self, rows: &Rows<'_>) {
        self.calibrations.iter_mut().for_each(Calibration::keep);
        self.drawn_weights.copy_from_slice(&self.weights);
        if rows.smoothed && self.expects_little() {
            let first = rows.block.samples.windows.all().first();
            self.drawn_at = first.map(|window| window.number);
        }
    }

    /// Draws the noise, (1) and (2), and computes the signals with it.
    fn draw(&mut self, rows: &mut Rows<'_>, whitening: &[Whitening], draw: u64) {
        let (block, len) = (rows.block, rows.block.samples.len);
        let windows = block.samples.windows.all();
        let Some(first) = windows.first() else { return };
        let oldest = first.number - first.centre as i64;
        let fill = |sensor: usize, errors: &mut [f64]| {
            let errors = errors[..len].iter_mut().zip(oldest..);
            errors.for_each(|(error, number)| *error = sign(draw, sensor, number));
        };
        let joints = self.noisy.joints();
        for (joint, errors) in self.noisy.q.iter_mut().enumerate() {
            fill(joint, errors);
        }
        if rows.smoothed {
            for (input, errors) in self.noisy.u.iter_mut().enumerate() {
                fill(joints + input, errors);
            }
            self.subtract_estimates(rows, whitening);
        }
        for (joint, q) in self.noisy.q.iter_mut().enumerate() {
            let signals = rows.signals.q[joint].iter().zip(&block.noise.q_std[joint]);
            for (q, (signal, std)) in q[..len].iter_mut().zip(signals) {
                *q = signal + std * *q;
            }
        }
        let covered = block.samples.windows.covered();
        block.form.differentiate(&mut self.noisy, covered.clone());
        self.noisy.turns.clear();
        let std = |joint: usize| block.noise.sensors.deviations(joint)[0];
        reversals::correct(&block.form, rows.standstill, &mut self.noisy, std, covered, |_| {});
    }

    /// Subtracts from the errors what the residuals show of them, (2).
    fn subtract_estimates(&mut self, rows: &mut Rows<'_>, whitening: &[Whitening]) {
        let (block, covariance) = (rows.block, rows.covariance);
        let count = block.samples.windows.len();
        for (e, weighted) in self.weighted.iter_mut().enumerate() {
            let weighted = &mut weighted[..count];
            for (i, weighted) in weighted.iter_mut().enumerate() {
                *weighted = covariance.residual(block, e, i, &self.noisy.q)
                    + covariance.input_residual(block, e, i, &self.noisy.u);
            }
            whitening[e].apply(Direction::Forward, weighted);
        }
        rows.shared.solve(block, covariance, whitening, &mut self.weighted);
        for (e, weighted) in self.weighted.iter_mut().enumerate() {
            let weighted = &mut weighted[..count];
            whitening[e].apply_transposed(weighted);
            covariance.add_errors(block, e, weighted, -1.0, &mut self.noisy.q);
        }
    }

    /// δZ of an equation, whitened (3); `clean` are the whitened columns without the noise.
    fn project(&mut self, block: &MeasuredBlock, e: usize, whitening: &mut Whitening, clean: &[Vec<f64>]) {
        let windows = block.samples.windows.all();
        let columns = &mut self.columns[..clean.len()];
        block.form.project(e, windows, &self.noisy, columns);
        let own = columns.iter_mut().map(|column| &mut column[..windows.len()]);
        whitening.apply_all(Direction::Forward, own);
        for (noisy, clean) in columns.iter_mut().zip(clean) {
            noisy.iter_mut().zip(clean).for_each(|(noisy, clean)| *noisy -= clean);
        }
    }
}

/// 1 or −1 for a sample of a sensor, at random. The same samples get the same noise, so that a
/// replay gives the same estimates.
fn sign(draw: u64, sensor: usize, number: i64) -> f64 {
    let stream = (sensor as u64 + 1) << 56 | (draw + 1) << 52;
    let bits = mix((number as u64 ^ stream).wrapping_mul(GOLDEN));
    if bits & 1 == 0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::sign;

    #[test]
    fn prop_signs_of_sensors_draws_and_neighbours_are_independent() {
        let count = 10_000i64;
        let series = |draw: u64, sensor: usize, lag: i64| (0..count).map(move |k| sign(draw, sensor, k + lag));
        for (draw, sensor, lag) in [(0, 0, 1), (0, 0, 2), (0, 1, 0), (1, 0, 0), (1, 1, 0), (0, 0, 19)] {
            let other = series(draw, sensor, lag);
            let sum: f64 = series(0, 0, 0).zip(other).map(|(a, b)| a * b).sum();
            // a random walk of as many steps: four standard deviations
            assert!(sum.abs() < 4.0 * (count as f64).sqrt(), "{draw} {sensor} {lag}: {sum}");
        }
    }
}
