//! Regressors freed of their noise: the best linear prediction of the true ones.
//!
//! ```text
//! (1)  E[z | ẑ] = A ẑ      A = (S − N) S⁻¹      S = Ẑᵀ Ẑ = J + N
//! (2)  S½ (I − A) S⁻½ = V diag(ν) Vᵀ            ν the share of noise of each direction
//! ```
//!
//! Ẑ are the whitened columns of an equation, one row per window, and N is what noise contributes
//! to their sums of products (`regressor_noise.rs`). If noise is counted as information, the
//! estimator takes it for knowledge. The sums of A ẑ, A S Aᵀ, are those of the information J, and
//! the score keeps its mean, J Δθ. A direction that is mostly noise is set to 0.
//!
//! This is regression calibration: R. J. Carroll, D. Ruppert, L. A. Stefanski, C. M. Crainiceanu,
//! Measurement Error in Nonlinear Models, 2nd ed., Chapman & Hall 2006, chapter 4.

use crate::estimator::linalg::{Cholesky, Eigen, dot, mul};

/// Largest sum of the shares of noise, tr S⁻¹N, that regressors may keep.
const NEGLIGIBLE: f64 = 0.01;
/// Share of noise above which a direction becomes 0. N comes from two draws, so a direction of pure
/// noise may seem to contain only half as much; with limits of 0.2 to 0.5 the trials differ little.
const MOSTLY_NOISE: f64 = 0.3;
/// Factor by which the noise of a block may exceed what an earlier draw lets expect; calibration
/// then still sets in at a tenth of what would be dangerous.
const MARGIN: f64 = 4.0;
/// Eigenvalues of the scaled S below this are rounding.
const ROUNDING: f64 = 1e-12;

/// A of one equation, for columns that are scaled to length 1.
#[derive(Debug, Clone)]
pub(super) struct Calibration {
    /// Draws of the noise so far.
    draws: u32,
    /// True if a draw was not negligible.
    matters: bool,
    /// Inverse lengths of the columns; 0 for a column of zeros.
    scale: Vec<f64>,
    /// S, and N as the mean over the draws, n × n; then I − A in place of N.
    seen: Vec<f64>,
    noise: Vec<f64>,
    /// N and scale of the last block with a draw.
    drawn: Vec<f64>,
    drawn_scale: Vec<f64>,
    /// S⁻¹, unless S is singular.
    is_singular: bool,
    inverse: Vec<f64>,
    /// S½ and S⁻½.
    root: Vec<f64>,
    inverse_root: Vec<f64>,
    product: Vec<f64>,
    cholesky: Cholesky,
    eigen: Eigen,
    /// Scratch: a scaled row.
    row: Vec<f64>,
}

impl Calibration {
    /// Workspace for n columns.
    pub fn new(n: usize) -> Self {
        let matrix = vec![0.0; n * n];
        Self {
            draws: 0,
            matters: false,
            is_singular: false,
            scale: vec![0.0; n],
            seen: matrix.clone(),
            noise: matrix.clone(),
            drawn: matrix.clone(),
            drawn_scale: vec![0.0; n],
            inverse: matrix.clone(),
            root: matrix.clone(),
            inverse_root: matrix.clone(),
            product: matrix,
            cholesky: Cholesky::new(n),
            eigen: Eigen::new(n),
            row: vec![0.0; n],
        }
    }

    /// Begins a block, whose columns have `rows` rows.
    pub fn begin(&mut self, columns: &[Vec<f64>], rows: usize) {
        (self.draws, self.matters) = (0, false);
        for (scale, column) in self.scale.iter_mut().zip(columns) {
            let length = dot(&column[..rows], &column[..rows]).sqrt();
            *scale = if length > 0.0 { 1.0 / length } else { 0.0 };
        }
        products(columns, rows, &self.scale, |at, v| self.seen[at] = v);
        let n = self.scale.len();
        for (i, scale) in self.scale.iter().enumerate() {
            self.seen[i * n + i] = if *scale > 0.0 { 1.0 + ROUNDING } else { 1.0 };
        }
        self.is_singular = !self.cholesky.factor(n, &self.seen);
        if !self.is_singular {
            self.cholesky.inverse(&mut self.inverse);
        }
        self.noise.fill(0.0);
    }

    /// Adds a draw of the columns' noise; true if it is not negligible.
    pub fn add(&mut self, noise: &[Vec<f64>], rows: usize) -> bool {
        self.draws += 1;
        let gain = 1.0 / f64::from(self.draws);
        products(noise, rows, &self.scale, |at, v| {
            self.noise[at] += gain * (v - self.noise[at]);
        });
        self.matters = self.is_singular || dot(&self.inverse, &self.noise) >= NEGLIGIBLE;
        self.matters
    }

    /// Keeps the N of this block for [`expects_little`](Self::expects_little) in later ones.
    pub fn keep(&mut self) {
        self.drawn.copy_from_slice(&self.noise);
        self.drawn_scale.copy_from_slice(&self.scale);
    }

    /// True if the kept N, times `growth`, is far from mattering in this block. The noise of a
    /// column is taken to be as large as in the drawn block, or as large relative to the column if
    /// that has grown.
    pub fn expects_little(&self, growth: f64) -> bool {
        let n = self.scale.len();
        let shrunk = |i: usize| (self.scale[i] / self.drawn_scale[i]).max(1.0);
        let row = |i: usize| (0..n).map(move |j| (i, j));
        let shares = (0..n)
            .flat_map(row)
            .map(|(i, j)| self.inverse[i * n + j] * self.drawn[i * n + j] * shrunk(i) * shrunk(j));
        // false for NaN, of a column that was zero in the drawn block
        !self.is_singular && MARGIN * growth * shares.sum::<f64>() < NEGLIGIBLE
    }

    /// Computes A; false if the columns can stay as they are.
    pub fn solve(&mut self) -> bool {
        let n = self.scale.len();
        if !self.matters || self.noise.iter().any(|v| !v.is_finite()) {
            return false;
        }
        let Self {
            seen,
            noise,
            root,
            inverse_root,
            product,
            eigen,
            ..
        } = self;
        eigen.decompose(n, seen);
        eigen.rebuild(n, root, |v| v.max(0.0).sqrt());
        eigen.rebuild(n, inverse_root, |v| if v > ROUNDING { 1.0 / v.sqrt() } else { 0.0 });
        mul(n, inverse_root, noise, product);
        mul(n, product, inverse_root, noise);
        eigen.decompose(n, noise);
        // (2)
        eigen.rebuild(
            n,
            noise,
            |share| if share < MOSTLY_NOISE { share.max(0.0) } else { 1.0 },
        );
        mul(n, root, noise, product);
        mul(n, product, inverse_root, noise);
        true
    }

    /// ẑ ← A ẑ in every row, after [`solve`](Self::solve).
    pub fn apply(&mut self, columns: &mut [Vec<f64>], rows: usize) {
        let n = self.scale.len();
        for row in 0..rows {
            for (own, (scale, column)) in self.row.iter_mut().zip(self.scale.iter().zip(&*columns)) {
                *own = scale * column[row];
            }
            for (i, column) in columns.iter_mut().enumerate() {
                if self.scale[i] > 0.0 {
                    column[row] -= dot(&self.noise[i * n..(i + 1) * n], &self.row) / self.scale[i]; // (1)
                }
            }
        }
    }
}

/// Sums of products of scaled columns; `put` gets each entry of the symmetric matrix.
fn products(columns: &[Vec<f64>], rows: usize, scale: &[f64], mut put: impl FnMut(usize, f64)) {
    let n = columns.len();
    for i in 0..n {
        for j in 0..=i {
            let v = scale[i] * scale[j] * dot(&columns[i][..rows], &columns[j][..rows]);
            put(i * n + j, v);
            if i != j {
                put(j * n + i, v);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const ROWS: usize = 4000;

    fn noise(random: &mut Random) -> f64 {
        // uniform numbers of variance 1
        12f64.sqrt() * (random.uniform() - 0.5)
    }

    /// Columns of very different size with noise of these shares, and a draw of the same noise.
    fn columns(shares: &[f64], seed: u64) -> [Vec<Vec<f64>>; 3] {
        let mut random = Random(seed);
        let [mut truth, mut seen, mut draw] = <[Vec<Vec<f64>>; 3]>::default();
        for (k, share) in shares.iter().enumerate() {
            let size = 10f64.powi(4 * k as i32);
            let mut column = |std: f64| -> Vec<f64> { (0..ROWS).map(|_| size * std * noise(&mut random)).collect() };
            truth.push(column((1.0 - share).sqrt()));
            seen.push(column(share.sqrt()));
            draw.push(column(share.sqrt()));
        }
        // both directions share a part of the truth
        let first = truth[0].clone();
        for (k, column) in truth.iter_mut().enumerate().skip(1) {
            let size = 0.5 * 10f64.powi(4 * k as i32);
            column.iter_mut().zip(&first).for_each(|(v, first)| *v += size * first);
        }
        for (seen, truth) in seen.iter_mut().zip(&truth) {
            seen.iter_mut().zip(truth).for_each(|(v, truth)| *v += truth);
        }
        [truth, seen, draw]
    }

    fn calibrated(seen: &[Vec<f64>], draw: &[Vec<f64>]) -> (bool, Vec<Vec<f64>>) {
        let mut calibration = Calibration::new(seen.len());
        calibration.begin(seen, ROWS);
        calibration.add(draw, ROWS);
        let mut columns = seen.to_vec();
        let matters = calibration.solve();
        if matters {
            calibration.apply(&mut columns, ROWS);
        }
        (matters, columns)
    }

    #[test]
    fn prop_least_squares_with_calibrated_columns_is_not_attenuated() {
        let shares = [0.05, 0.2, 0.0];
        let [truth, seen, draw] = columns(&shares, 1);
        let theta = [2.0, -3e-4, 0.5e-8];
        let y: Vec<f64> = (0..ROWS)
            .map(|row| theta.iter().zip(&truth).map(|(t, z)| t * z[row]).sum())
            .collect();
        let fit = |columns: &[Vec<f64>]| {
            let n = columns.len();
            let design = nalgebra::DMatrix::from_fn(ROWS, n, |row, column| columns[column][row]);
            let right = design.transpose() * nalgebra::DVector::from_column_slice(&y);
            (design.transpose() * &design).cholesky().unwrap().solve(&right)
        };
        let (matters, columns) = calibrated(&seen, &draw);
        assert!(matters);
        let (raw, found) = (fit(&seen), fit(&columns));
        // noise of 20 % shortens θ_2 by 20 %
        assert!(raw[1] / theta[1] < 0.9, "{raw}");
        for (found, theta) in found.iter().zip(theta) {
            // 4000 rows: N is known to 3 %, and the noise in y − θᵀẑ of 0.6 leaves 1 %; four
            // standard deviations of both
            assert!((found / theta - 1.0).abs() < 0.06, "{found} {theta}");
        }
    }

    #[test]
    fn prop_columns_of_noise_become_zero_and_exact_ones_stay() {
        let [_, seen, draw] = columns(&[0.0, 1.0], 2);
        let alone = [vec![0.0; ROWS], draw[1].clone()];
        let (matters, columns) = calibrated(&[seen[0].clone(), draw[1].clone()], &alone);
        assert!(matters);
        let length = |column: &[f64]| dot(column, column).sqrt();
        // chance correlates the noise with the other column: four standard deviations
        assert!(length(&columns[1]) < 4.0 / (ROWS as f64).sqrt() * length(&draw[1]));
        let (matters, columns) = calibrated(&seen, &[vec![0.0; ROWS], vec![0.0; ROWS]]);
        assert!(!matters);
        assert_eq!(columns, seen);
    }

    #[test]
    fn fault_columns_of_zeros_equal_columns_and_nan_do_no_harm() {
        let [_, seen, draw] = columns(&[0.1], 3);
        let twice = [seen[0].clone(), seen[0].clone(), vec![0.0; ROWS]];
        let (_, columns) = calibrated(&twice, &[draw[0].clone(), draw[0].clone(), vec![0.0; ROWS]]);
        assert!(columns.iter().flatten().all(|v| v.is_finite()));
        let (matters, _) = calibrated(&seen, &[vec![f64::NAN; ROWS]]);
        assert!(!matters);
    }

    #[test]
    fn prop_an_earlier_draw_lets_expect_little_only_of_columns_as_large_and_noise_as_small() {
        let [_, seen, draw] = columns(&[1e-4, 1e-4], 5);
        let mut calibration = Calibration::new(2);
        calibration.begin(&seen, ROWS);
        assert!(!calibration.add(&draw, ROWS));
        calibration.keep();
        assert!(calibration.expects_little(1.0));
        // 4 · 2e-4 · 30 > 0.01
        assert!(!calibration.expects_little(30.0));
        assert!(!calibration.expects_little(f64::NAN));
        let times = |factors: [f64; 2]| -> Vec<Vec<f64>> {
            let pairs = seen.iter().zip(factors);
            pairs
                .map(|(column, factor)| column.iter().map(|v| factor * v).collect())
                .collect()
        };
        for (factors, little) in [([0.1, 1.0], false), ([1.0, 0.1], false), ([10.0, 10.0], true)] {
            calibration.begin(&times(factors), ROWS);
            assert_eq!(calibration.expects_little(1.0), little, "{factors:?}");
        }
        // of a column that was zero, no noise is known
        calibration.begin(&times([1.0, 0.0]), ROWS);
        calibration.add(&draw, ROWS);
        calibration.keep();
        assert!(calibration.expects_little(1.0));
        calibration.begin(&seen, ROWS);
        assert!(!calibration.expects_little(1.0));
    }
}
