//! Evidence for an error from sums of neighbouring rows.
//!
//! ```text
//! (φ, d, f)_g = Σ of five neighbouring rows, divided by √5                                     (a)
//! i = dᵀMd,  u = dᵀMf,  c = fᵀMf,   M = I − φ(φᵀφ)⁻¹φᵀ over the sums g of a block              (b)
//! s² = (c − u²/i)/(G − p − 1),   score u/s², information i/s²   G sums, p parameters           (c)
//! ```
//!
//! The column of a resonance is the first term of a series in (s/ω)², so it describes what a
//! coupling does to the motion, well below ω, and not how it rings at ω after each reversal. If the
//! residuals are no more than sensor noise, the ringing is below it. If they are more, whitening
//! still weights the rows by the sensors' noise, which is largest at low frequencies, and the
//! ringing hides the resonance: on a servo axis with a belt at 30 Hz, whitened rows show a third of
//! its amplitude. A sum over about the length of a window passes the motion, and little of what
//! rings within a window.
//!
//! Only equations whose noise is learnt are looked at. All parameters of a block are free in (b),
//! so the result does not depend on the estimate before.

use super::linalg::{Cholesky, dot};

/// Rows in a sum: windows overlap their fifth neighbour no longer.
const SUMMED: usize = 5;
/// Least degrees of freedom of (c).
const LEAST_FREEDOM: usize = 8;
/// Share of Σ d² below which what the parameters leave of it is rounding.
const RESOLVED: f64 = 1e-9;

/// Evidence of a block for one error, in units of its own scatter (c).
#[derive(Debug, Clone, Copy, Default)]
pub struct SummedScore {
    pub score: f64,
    /// 0 if there is no evidence.
    pub information: f64,
    /// χ² of the sums that the parameters leave.
    pub misfit: f64,
}

/// Sums of the rows of a group's equations, one equation after the other.
#[derive(Debug, Clone)]
pub struct SummedRows {
    /// Errors whose columns hold only for slow motion.
    slow: Vec<bool>,
    /// Evidence for each error.
    pub scores: Vec<SummedScore>,
    params: usize,
    /// The error with a column in this equation.
    suspect: Option<usize>,
    /// φ, d and f of the present sum, and its number of rows.
    sum: Vec<f64>,
    rows: usize,
    /// G and Σ over the sums of (φ, d, f)(φ, d, f)ᵀ, with rows of `sum.len()`.
    count: usize,
    gram: Vec<f64>,
    // scratch
    matrix: Vec<f64>,
    factor: Cholesky,
    solved: Vec<f64>,
}

impl SummedRows {
    /// Workspace for equations of up to n parameters and `errors` errors.
    pub fn new(n: usize, errors: usize) -> Self {
        Self {
            slow: vec![false; errors],
            scores: vec![SummedScore::default(); errors],
            params: 0,
            suspect: None,
            sum: vec![0.0; n + 2],
            rows: 0,
            count: 0,
            gram: vec![0.0; (n + 2) * (n + 2)],
            matrix: vec![0.0; n * n],
            factor: Cholesky::new(n),
            solved: vec![0.0; n],
        }
    }

    /// Adopts the errors of the rows.
    pub fn adopt(&mut self, is_slow: impl Fn(usize) -> bool) {
        for (s, slow) in self.slow.iter_mut().enumerate() {
            *slow = is_slow(s);
        }
        self.clear();
    }

    /// Forgets the evidence.
    pub fn clear(&mut self) {
        self.scores.fill(SummedScore::default());
    }

    /// Begins an equation of `params` parameters.
    pub fn begin(&mut self, params: usize) {
        (self.params, self.suspect, self.rows, self.count) = (params, None, 0, 0);
        self.sum.fill(0.0);
        self.gram.fill(0.0);
    }

    /// Adds the next row: φ, f and the columns of the errors.
    pub fn add(&mut self, phi: &[f64], f: f64, columns: &[f64]) {
        let suspect = (0..columns.len()).find(|&s| self.slow[s] && columns[s] != 0.0);
        let Some(suspect) = suspect else { return };
        self.suspect = Some(suspect);
        let (regressor, rest) = self.sum.split_at_mut(self.params);
        regressor.iter_mut().zip(phi).for_each(|(sum, phi)| *sum += phi); // (a)
        rest[0] += columns[suspect];
        rest[1] += f;
        self.rows += 1;
        if self.rows == SUMMED {
            let width = self.params + 2;
            for a in 0..width {
                for b in 0..=a {
                    self.gram[a * width + b] += self.sum[a] * self.sum[b] / SUMMED as f64;
                }
            }
            self.count += 1;
            self.rows = 0;
            self.sum.fill(0.0);
        }
    }

    /// Ends the equation.
    pub fn end(&mut self) {
        let (p, width) = (self.params, self.params + 2);
        let Some(suspect) = self.suspect else { return };
        if self.count < p + 1 + LEAST_FREEDOM {
            return;
        }
        for a in 0..p {
            for b in 0..=a {
                self.matrix[a * p + b] = self.gram[a * width + b];
                self.matrix[b * p + a] = self.gram[a * width + b];
            }
        }
        if !self.factor.factor(p, &self.matrix[..p * p]) {
            return;
        }
        let (d, f) = (p * width, (p + 1) * width);
        let left =
            |solved: &[f64], row: usize, column: usize| self.gram[row + column] - dot(solved, &self.gram[row..row + p]);
        let solved = &mut self.solved[..p];
        solved.copy_from_slice(&self.gram[d..d + p]);
        self.factor.solve(solved);
        let (information, score) = (left(solved, d, p), left(solved, f, p)); // (b)
        solved.copy_from_slice(&self.gram[f..f + p]);
        self.factor.solve(solved);
        let misfit = left(solved, f, p + 1);
        if !(information > RESOLVED * self.gram[d + p]) {
            return;
        }
        let freedom = (self.count - p - 1) as f64;
        let variance = (misfit - score * score / information) / freedom; // (c)
        if variance > 0.0 && variance.is_finite() {
            self.scores[suspect] = SummedScore {
                score: score / variance,
                information: information / variance,
                misfit: misfit / variance,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slow column of amplitude 0.5, and an error that alternates from row to row and is ten
    /// times as large: in the sums it is a fifth.
    #[test]
    fn val_the_amplitude_is_found_beside_residuals_that_ring() {
        let mut rows = SummedRows::new(1, 2);
        rows.adopt(|s| s == 1);
        rows.begin(1);
        for k in 0..200 {
            let (t, sign) = (f64::from(k) * 0.1, if k % 2 == 0 { 1.0 } else { -1.0 });
            let d = t.sin();
            rows.add(&[1.0], 3.0 + 0.5 * d + 5.0 * sign * (0.03 * t).cos(), &[9.0, d]);
        }
        rows.end();
        let found = rows.scores[1];
        let amplitude = found.score / found.information;
        assert!((amplitude - 0.5).abs() < 3.0 / found.information.sqrt(), "{found:?}");
        assert!(found.information > 1.0 && rows.scores[0].information == 0.0);
    }

    #[test]
    fn prop_too_few_sums_are_no_evidence() {
        let mut rows = SummedRows::new(1, 1);
        rows.adopt(|_| true);
        rows.begin(1);
        for k in 0..40 {
            rows.add(&[1.0], f64::from(k).sin(), &[f64::from(k).cos()]);
        }
        rows.end();
        assert_eq!(rows.scores[0].information, 0.0);
    }
}
