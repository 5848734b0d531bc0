//! Considered errors: what the model does not say and σ must allow for (S. F. Schmidt, 1966: consider covariance).
//!
//! ```text
//! f(θ*)  = n + Σ_s a_s d_s                        the machine has errors a_s of which only a standard deviation σ_s is known
//! e_m    = A e_{m−1} + K Σ φ (n + Σ_s a_s d_s)    the error of θ̂, see the head of group.rs
//! T_s    ← A T_s + K Σ φ d_s                      so this is what it owes to an error of amplitude 1
//! P_pub  = P + Σ_s σ_s² T_s T_sᵀ
//! ```
//!
//! The errors are constant, so T_s adds up over the blocks instead of averaging out: no number of blocks takes σ below what they do. That is
//! the point: a delay of 150 µs and smooth motion shift θ₉ by 5 % and leave a residual that nothing is wrong with.
//!
//! **No change of the plant.** The estimate moves with the motion where there is such an error, and a change is looked for against it: the test of
//! `change.rs` counts d_s − φᵀT_s, what the innovation owes to the error, as noise of standard deviation σ_s. **No noise.** What an error leaves in the
//! residuals is counted as noise where that is learnt, which widens σ further and never narrows it.
//!
//! # Tests
//! Under the error a the innovation is ν = n + (d − Φ T) a with T of before the block, of covariance V = I + Φ Λ⁻¹ Φᵀ in units of σ². With h = d − Φ T
//!
//! ```text
//! u = hᵀ V⁻¹ ν,  i = hᵀ V⁻¹ h,   V⁻¹ = I − Φ K Φᵀ
//! ```
//!
//! are the score of the error and its variance, which `score_test.rs` adds up over the blocks.

use super::Residuals;
use super::group::EquationState;
use super::linalg::{Cholesky, dot};
use super::line::LineFit;
use super::pass::Sums;
use super::persist::Visit;
use std::ops::Range;

/// Errors that there is room for: one of the whole machine and five of each equation.
pub const fn room_for(equations: usize) -> usize {
    1 + 5 * equations
}

/// Share of Σ d² below which what the parameters leave of a column is rounding.
const RESOLVED: f64 = 1e-9;

/// Sensitivities of a group's estimate, and the sums of a block over its error columns.
#[derive(Debug, Clone)]
pub struct Considered {
    n: usize,
    /// Errors that the rows of the last block had columns for.
    count: usize,
    std: Vec<f64>,
    /// Amplitudes that the score tests found.
    pub found: Vec<f64>,
    /// T_s at s n.
    sensitivity: Vec<f64>,
    /// Σ w φ d_s at s n, Σ w d_s², Σ w d_s f.
    cross: Vec<f64>,
    square: Vec<f64>,
    score: Vec<f64>,
    /// (u, i) of the last block per error.
    pub scores: Vec<(f64, f64)>,
    // scratch
    columns: Vec<f64>,
    regressor: Vec<f64>,
    doubled: Vec<f64>,
    vector: Vec<f64>,
    images: Vec<f64>,
    matrix: Vec<f64>,
    factor: Cholesky,
    right: Vec<f64>,
}

impl Considered {
    /// Room for a group of n parameters in a plant of `equations` equations.
    pub fn new(n: usize, equations: usize) -> Self {
        let room = room_for(equations);
        Self {
            n,
            count: 0,
            std: vec![0.0; room],
            found: vec![0.0; room],
            sensitivity: vec![0.0; room * n],
            cross: vec![0.0; room * n],
            square: vec![0.0; room],
            score: vec![0.0; room],
            scores: vec![(0.0, 0.0); room],
            columns: vec![0.0; room],
            regressor: vec![0.0; n],
            doubled: vec![0.0; 2 * n],
            vector: vec![0.0; n],
            images: vec![0.0; room * n],
            matrix: vec![0.0; room * room],
            factor: Cholesky::new(room),
            right: vec![0.0; room],
        }
    }

    /// What goes from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.sensitivity);
        v.reals(&mut self.std);
        v.reals(&mut self.found);
    }

    /// Parameter i owes nothing to any error: it is back to what it was told.
    pub fn forget_parameter(&mut self, i: usize) {
        self.sensitivity
            .iter_mut()
            .skip(i)
            .step_by(self.n)
            .for_each(|t| *t = 0.0);
    }

    /// Takes over what the rows know of errors.
    pub fn begin<R: Residuals>(&mut self, rows: &R) {
        self.count = rows.suspects().min(self.std.len());
        for (s, std) in self.std[..self.count].iter_mut().enumerate() {
            *std = rows.suspect_std(s);
        }
        self.scores.fill((0.0, 0.0));
    }

    /// Sums over the rows of `range` at θ, weighed as the fit weighs them.
    pub fn accumulate<R: Residuals>(
        &mut self,
        rows: &R,
        range: Range<usize>,
        theta: &[f64],
        equations: &[EquationState],
    ) {
        let (n, count) = (self.n, self.count);
        self.cross[..count * n].fill(0.0);
        self.square.fill(0.0);
        self.score.fill(0.0);
        if count == 0 {
            return;
        }
        for e in equations {
            let p = e.own.len();
            let inverse = 1.0 / e.divisor;
            for index in range.clone() {
                let phi = &mut self.regressor[..p];
                let f = rows.row(e.index, index, theta, phi) * inverse;
                let weight = e.loss.at(f).1 * inverse;
                rows.suspect_row(e.index, index, &mut self.columns[..count]);
                for (s, &d) in self.columns[..count].iter().enumerate().filter(|(_, d)| **d != 0.0) {
                    let weighted = weight * d;
                    self.square[s] += weighted * inverse * d;
                    self.score[s] += weighted * f;
                    let cross = &mut self.cross[s * n + e.offset..s * n + e.offset + p];
                    cross
                        .iter_mut()
                        .zip(phi.iter())
                        .for_each(|(c, x)| *c += weighted * inverse * x);
                }
            }
        }
    }

    /// Goes on to the estimate after the block: scores, then T. `gain` is K, `transition` A, `total` Σ S_e, `sums` those at the θ that was
    /// accumulated at, `moved` its distance from θ̄.
    #[allow(clippy::too_many_arguments)]
    pub fn step(
        &mut self,
        gain: &[f64],
        transition: &[f64],
        total: &[f64],
        equations: &[EquationState],
        sums: &[Sums],
        moved: &[f64],
    ) {
        let n = self.n;
        // Φᵀν = Σ φ f + S (θ − θ̄)
        for (i, g) in self.regressor.iter_mut().enumerate() {
            *g = dot(&total[i * n..(i + 1) * n], moved);
        }
        for (e, sums) in equations.iter().zip(sums) {
            for (g, s) in self.regressor[e.offset..].iter_mut().zip(&sums.score) {
                *g += s;
            }
        }
        for s in 0..self.count {
            if self.square[s] == 0.0 && self.sensitivity[s * n..(s + 1) * n].iter().all(|t| *t == 0.0) {
                continue;
            }
            let cross = &self.cross[s * n..(s + 1) * n];
            let t = &mut self.sensitivity[s * n..(s + 1) * n];
            // Φᵀh = Σ φ d − S T
            for i in 0..n {
                self.vector[i] = cross[i] - dot(&total[i * n..(i + 1) * n], t);
            }
            let h = &self.vector;
            let h_nu = self.score[s] + dot(cross, moved) - dot(t, &self.regressor);
            let hh = self.square[s] - dot(cross, t) - dot(h, t);
            let (mut taken, mut pull) = (0.0, 0.0);
            for i in 0..n {
                let image = dot(&gain[i * n..(i + 1) * n], h);
                taken += h[i] * image;
                pull += self.regressor[i] * image;
            }
            let information = hh - taken;
            self.scores[s] = if information > RESOLVED * self.square[s] {
                (h_nu - pull, information)
            } else {
                (0.0, 0.0)
            };
            for i in 0..n {
                self.vector[i] = dot(&transition[i * n..(i + 1) * n], t) + dot(&gain[i * n..(i + 1) * n], cross);
            }
            t.copy_from_slice(&self.vector);
        }
    }

    /// The same for a line through the block, whose end is the estimate: with C⁻¹ the information of its start and W its weights
    ///
    /// ```text
    /// T ← (I, ½ I) Cov(c, v) (Σ w (φ, sφ) d + (I, −½ I) C⁻¹ T)
    /// ```
    #[allow(clippy::too_many_arguments)]
    pub fn step_line<R: Residuals>(
        &mut self,
        rows: &R,
        equations: &[EquationState],
        line: &LineFit,
        start_information: &[f64],
        fixed: &[bool],
        theta: &mut [f64],
        first: usize,
    ) {
        let (n, m) = (self.n, 2 * self.n);
        let length = rows.len().max(2) as f64 - 1.0;
        self.scores.fill((0.0, 0.0));
        for s in 0..self.count {
            let t = &mut self.sensitivity[s * n..(s + 1) * n];
            for i in 0..n {
                let pull = dot(&start_information[i * n..(i + 1) * n], t);
                (self.doubled[i], self.doubled[n + i]) = (pull, -0.5 * pull);
            }
            for e in equations {
                let weight = 1.0 / (e.divisor * e.divisor * e.variance.max(super::group::TINY));
                for index in 0..rows.len() {
                    rows.suspect_row(e.index, index, &mut self.columns[..self.count]);
                    let d = self.columns[s];
                    if d == 0.0 {
                        continue;
                    }
                    let place = index as f64 / length - 0.5;
                    for (i, own) in e.own.clone().enumerate() {
                        let k = e.offset + i;
                        theta[own] = line.middle[k] + place * line.slope[k];
                    }
                    let phi = &mut self.regressor[..e.own.len()];
                    rows.row(e.index, index, theta, phi);
                    for (i, x) in phi.iter().enumerate() {
                        self.doubled[e.offset + i] += weight * d * x;
                        self.doubled[n + e.offset + i] += place * weight * d * x;
                    }
                }
            }
            for i in 0..n {
                let (middle, slope) = (&line.covariance[i * m..(i + 1) * m], &line.covariance[(n + i) * m..]);
                let end = dot(middle, &self.doubled) + 0.5 * dot(&slope[..m], &self.doubled);
                self.vector[i] = if fixed[i] || !end.is_finite() { 0.0 } else { end };
            }
            t.copy_from_slice(&self.vector);
        }
        // θ itself is the line's end
        for i in 0..n {
            theta[first + i] = line.middle[i] + 0.5 * line.slope[i];
        }
    }

    /// Adds Σ (σ_s² + â_s²) T_s T_sᵀ, â_s what the score tests found.
    pub fn widen(&self, covariance: &mut [f64]) {
        let n = self.n;
        for ((t, std), found) in self.sensitivity.chunks_exact(n).zip(&self.std).zip(&self.found) {
            let variance = std * std + found * found;
            if variance == 0.0 {
                continue;
            }
            for i in 0..n {
                for j in 0..n {
                    covariance[i * n + j] += variance * t[i] * t[j];
                }
            }
        }
    }

    /// What the errors explain of Σ c_k², where c = `values` are uncorrelated, of variance 1 and made from A (θ_block − θ̄): c = `image`(w) for
    /// w = (Σ φ d − S T)/σ², the part of the innovation's score that an error brings. Woodbury's formula.
    pub fn explained(
        &mut self,
        values: &[f64],
        variance: f64,
        total: &[f64],
        mut image: impl FnMut(&[f64], &mut [f64]),
    ) -> f64 {
        let n = self.n;
        let mut active = 0;
        for s in 0..self.count {
            if self.std[s] == 0.0 {
                continue;
            }
            let (t, cross) = (&self.sensitivity[s * n..(s + 1) * n], &self.cross[s * n..(s + 1) * n]);
            for i in 0..n {
                // `total` is in units of the noise already
                self.vector[i] = self.std[s] * (cross[i] / variance - dot(&total[i * n..(i + 1) * n], t));
            }
            image(&self.vector, &mut self.images[active * n..(active + 1) * n]);
            active += 1;
        }
        if active == 0 {
            return 0.0;
        }
        let rank = values.len();
        for a in 0..active {
            let own = &self.images[a * n..a * n + rank];
            self.right[a] = dot(own, values);
            for b in 0..active {
                let unit = if a == b { 1.0 } else { 0.0 };
                self.matrix[a * active + b] = unit + dot(own, &self.images[b * n..b * n + rank]);
            }
        }
        if !self.factor.factor(active, &self.matrix[..active * active]) {
            return 0.0;
        }
        for (value, right) in self.columns[..active].iter_mut().zip(&self.right) {
            *value = *right;
        }
        self.factor.solve(&mut self.columns[..active]);
        dot(&self.columns[..active], &self.right[..active])
    }
}
