//! Considered errors: what the model leaves out and σ must allow for (S. F. Schmidt, 1966: consider
//! covariance).
//!
//! ```text
//! f(θ*)  = n + Σ_s a_s d_s                        the machine has errors a_s, a priori N(0, σ_s²)            (a)
//! e_m    = A e_{m−1} + K Σ φ (n + Σ_s a_s d_s)    the error of θ̂, see error_covariance.rs                    (b)
//! T_s    ← A T_s + K Σ φ d_s                      so this is the error of θ̂ per unit of a_s                  (c)
//! P_pub  = P + T M Tᵀ,  M = E[a aᵀ | data]        second moments, from score_test.rs; considered_covariance.rs (d)
//! ```
//!
//! The errors are constant, so T_s accumulates over the blocks instead of averaging out. If the
//! data do not inform on an error, M stays at its prior σ_s², and no number of blocks reduces σ
//! below the effect of the error: with smooth motion, a delay of 150 µs shifts θ₉ by 5 % and leaves
//! a perfect residual. If the motion does show the error, M shrinks to the remaining uncertainty,
//! and σ to what it would be without the error. (d) is exact for linear rows: the part of e that
//! noise causes is uncorrelated with the innovations, and a is learnt only from these.
//!
//! **No change of the plant.** Such an error makes the estimate vary with the motion, so the test
//! of `change.rs` counts d_s − φᵀT_s, the share of the innovation that the error causes, as noise
//! of covariance M. **No noise.** If the noise level is learnt, the residuals that an error causes
//! count as noise, which widens σ further and never narrows it.
//!
//! # Drift
//! Parameters may move while they are averaged: θ(t) = θ(t_end) + ρ (t − t_end) leaves f = n + φᵀρ
//! (t − t_end). The rates are constant errors like the others, with unit size_i (1/s), and T is how
//! far θ̂ lags behind the parameters at the end of the block:
//!
//! ```text
//! d_i = φ_i size_i (t − t_end),   T_i ← T_i − size_i Δt e_i at the start of each block    (f)
//! ```
//!
//! A moving parameter is a change of the plant, so the test for changes does not allow for it.
//!
//! # Scores
//! With the errors a the innovation is ν = n + (D − Φ T) a, T as before the block, of covariance V
//! = I + Φ Λ⁻¹ Φᵀ in units of σ². With H = D − Φ T
//!
//! ```text
//! u = Hᵀ V⁻¹ ν,  I = Hᵀ V⁻¹ H,   V⁻¹ = I − Φ K Φᵀ                                              (e)
//! ```
//!
//! are the score of the errors and their information matrix, which `score_test.rs` adds up over the
//! blocks.

use super::curvature::Curvature;
use super::equation::{EquationState, TINY};
use super::linalg::{Cholesky, dot};
use super::line::LineFit;
use super::pass::{Summable, Sums};
use super::persist::{Visit, visit_symmetric};
use super::summed_rows::{SummedRows, SummedScore};
use std::ops::Range;

/// Largest number of errors per equation.
pub const PER_EQUATION: usize = 17;

/// Largest number of errors of the rows: one of the whole machine and those of each equation. The
/// drifts of the parameters, one each, follow.
pub const fn room_for(equations: usize) -> usize {
    1 + PER_EQUATION * equations
}

/// Longest time \[s\] between the ends of two blocks over which a rate is assumed constant.
const LONGEST: f64 = 60.0;

/// Share of Σ d² below which the part of a column that the parameters do not explain is rounding.
const RESOLVED: f64 = 1e-9;

/// Added to the diagonal of a correlation matrix that may be singular.
const ROUNDING: f64 = 1e-9;

/// Sensitivities of a group's estimate, and the sums of a block over its error columns.
#[derive(Debug, Clone)]
pub struct Considered {
    pub(super) n: usize,
    /// Number of errors of the last block: those with columns, and the size of all lists, drifts
    /// included.
    pub(super) count: usize,
    pub(super) known: usize,
    /// Indices of the drifts of this group's parameters; empty if none is considered.
    drifts: Range<usize>,
    /// Change of each parameter by a drift of 1/s; 0 for a fixed one.
    sizes: Vec<f64>,
    /// End of the block before, in ns; 0 before the first.
    end_ns: u64,
    /// M of (d), room × room; 0 in rows and columns of errors that have no prior and of which no
    /// evidence was found.
    pub moments: Vec<f64>,
    /// T_s at s n.
    pub(super) sensitivity: Vec<f64>,
    /// Σ w φ d_s at s n, Σ w d_s d_t at s room + t for t ≤ s, Σ w d_s f.
    cross: Vec<f64>,
    gram: Vec<f64>,
    score: Vec<f64>,
    /// u of the last block.
    scores: Vec<f64>,
    /// I of the last block, room × room.
    information: Vec<f64>,
    /// Errors that the parameters imitate: they count only in the sums after a change.
    imitated: Vec<bool>,
    /// Errors that make the parameters contradict a relation.
    pub(super) contradicting: Vec<bool>,
    /// Variance of each parameter due to errors that no rows tell from it.
    pub(super) inseparable: Vec<f64>,
    summed: SummedRows,
    // scratch
    columns: Vec<f64>,
    active: Vec<usize>,
    regressor: Vec<f64>,
    doubled: Vec<f64>,
    pub(super) vector: Vec<f64>,
    seen: Vec<f64>,
    images: Vec<f64>,
    matrix: Vec<f64>,
    factor: Cholesky,
    right: Vec<f64>,
}

/// The update of a group's estimate by a block.
#[derive(Clone, Copy)]
pub struct Update<'a> {
    /// K, n × n.
    pub gain: &'a [f64],
    /// A = I − K S, n × n.
    pub transition: &'a [f64],
    /// Σ S_e, n × n.
    pub total: &'a [f64],
    /// The group's equations, and their sums at the θ of [`Considered::accumulate`].
    pub equations: &'a [EquationState],
    pub sums: &'a [Sums],
    /// Distance of that θ from θ̄.
    pub moved: &'a [f64],
}

/// The update of a group's estimate by a line through a block.
#[derive(Clone, Copy)]
pub struct LineUpdate<'a> {
    /// The group's equations.
    pub equations: &'a [EquationState],
    /// The line.
    pub line: &'a LineFit,
    /// C⁻¹ of its start, n × n.
    pub start_information: &'a [f64],
    /// Fixed parameters of the group.
    pub fixed: &'a [bool],
    /// The group's first parameter among all.
    pub first: usize,
}

impl Considered {
    /// Workspace for a group with `parameters` of the `params` parameters of a plant of `equations`
    /// equations; with `drift`, also for the drift of each.
    pub fn new(parameters: &Range<usize>, params: usize, equations: usize, drift: bool) -> Self {
        let (n, first) = (parameters.len(), room_for(equations));
        let (room, drifts) = match drift {
            true => (first + params, first + parameters.start..first + parameters.end),
            false => (first, first..first),
        };
        Self {
            n,
            count: 0,
            known: 0,
            drifts,
            sizes: vec![0.0; n],
            end_ns: 0,
            moments: vec![0.0; room * room],
            sensitivity: vec![0.0; room * n],
            cross: vec![0.0; room * n],
            gram: vec![0.0; room * room],
            score: vec![0.0; room],
            scores: vec![0.0; room],
            information: vec![0.0; room * room],
            imitated: vec![false; room],
            contradicting: vec![false; room],
            inseparable: vec![0.0; n],
            summed: SummedRows::new(n, first),
            columns: vec![0.0; room],
            active: vec![0; room],
            regressor: vec![0.0; n],
            doubled: vec![0.0; 2 * n],
            vector: vec![0.0; n],
            seen: vec![0.0; room * n],
            images: vec![0.0; room * n],
            matrix: vec![0.0; room * room],
            factor: Cholesky::new(room),
            right: vec![0.0; room],
        }
    }

    /// What goes from block to block.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.sensitivity);
        let room = self.room();
        visit_symmetric(v, &mut self.moments, room);
        v.reals(&mut self.inseparable);
        v.count(&mut self.end_ns);
    }

    /// Resets to a state without data.
    pub fn forget(&mut self) {
        self.end_ns = 0;
        self.sensitivity.fill(0.0);
        self.moments.fill(0.0);
        self.inseparable.fill(0.0);
    }

    /// Refers T to the θ that `curvature` was turned to.
    pub fn turn(&mut self, curvature: &Curvature) {
        for t in self.sensitivity.chunks_exact_mut(self.n) {
            curvature.turn_change(t);
        }
    }

    /// Clears the sensitivities of parameter i, which is back at its start value.
    pub fn forget_parameter(&mut self, i: usize) {
        let of_parameter = self.sensitivity.iter_mut().skip(i).step_by(self.n);
        of_parameter.for_each(|t| *t = 0.0);
    }

    /// Adopts the errors of the rows, for these parameters among all and those that are `fixed`.
    pub fn begin(&mut self, rows: &dyn Summable, parameters: Range<usize>, fixed: &[bool]) {
        let suspects = rows.suspect_rows();
        for ((i, fixed), variance) in parameters.zip(fixed).zip(&mut self.inseparable) {
            // Rows that have not seen their joint move yet, after a start or in a new stream, know
            // none.
            let known = Some(suspects.inseparable_std(i).powi(2)).filter(|known| *known > 0.0);
            *variance = if *fixed { 0.0 } else { known.unwrap_or(*variance) };
        }
        self.known = suspects.count().min(self.drifts.start).min(self.scores.len());
        self.count = if self.drifts.is_empty() {
            self.known
        } else {
            self.scores.len()
        };
        for (s, imitated) in self.imitated[..self.known].iter_mut().enumerate() {
            *imitated = suspects.is_imitated(s);
            self.contradicting[s] = suspects.contradicts_relations(s);
        }
        self.summed
            .adopt(|s| s < suspects.count() && suspects.lags_as(s).is_some());
        self.clear_scores();
    }

    /// Sets the change of each parameter by a drift of 1/s; 0 for a fixed one.
    pub fn set_sizes(&mut self, sizes: &[f64]) {
        self.sizes.copy_from_slice(sizes);
    }

    /// Second half of (f). Not needed for a line through the block, which refers to its start.
    fn refer_to_end(&mut self, end_ns: u64) {
        let before = std::mem::replace(&mut self.end_ns, end_ns);
        if before == 0 {
            return;
        }
        let seconds = (end_ns.saturating_sub(before) as f64 * 1e-9).min(LONGEST);
        for (i, s) in self.drifts.clone().enumerate() {
            self.sensitivity[s * self.n + i] -= seconds * self.sizes[i];
        }
    }

    fn clear_scores(&mut self) {
        self.scores.fill(0.0);
        self.information.fill(0.0);
    }

    /// Sums over the rows of `range` at θ, weighted as in the fit. `changed`: also of errors that
    /// the parameters imitate.
    pub fn accumulate(
        &mut self,
        rows: &dyn Summable,
        range: Range<usize>,
        theta: &[f64],
        equations: &[EquationState],
        changed: bool,
    ) {
        let (n, count, room) = (self.n, self.count, self.scores.len());
        self.cross[..count * n].fill(0.0);
        self.gram.fill(0.0);
        self.score.fill(0.0);
        self.summed.clear();
        if count == 0 || rows.is_empty() {
            return;
        }
        let (suspects, end_ns) = (rows.suspect_rows(), rows.span(rows.len() - 1).1);
        for e in equations {
            let p = e.parameters.len();
            let inverse = 1.0 / e.divisor;
            self.summed.begin(p);
            for index in range.clone() {
                let phi = &mut self.regressor[..p];
                let f = rows.row(e.index, index, theta, phi) * inverse;
                let weight = e.loss.at(f).1 * inverse;
                suspects.row(e.index, index, &mut self.columns[..self.known]);
                if e.floor == 0.0 {
                    self.summed.add(phi, f * e.divisor, &self.columns[..self.known]);
                }
                let mut active = 0;
                let counts = |s: &usize| self.columns[*s] != 0.0 && (changed || !self.imitated[*s]);
                for s in (0..self.known).filter(counts) {
                    self.active[active] = s;
                    active += 1;
                }
                if !self.drifts.is_empty() {
                    // from the middle of the row to the end of the block
                    let (first, last) = rows.span(index);
                    let ahead = end_ns.saturating_sub(first / 2 + last / 2) as f64 * 1e-9;
                    for (i, x) in phi.iter().enumerate() {
                        let s = self.drifts.start + e.offset + i;
                        self.columns[s] = -ahead * self.sizes[e.offset + i] * x;
                        self.active[active] = s;
                        active += 1;
                    }
                }
                for (place, &s) in self.active[..active].iter().enumerate() {
                    let weighted = weight * self.columns[s];
                    self.score[s] += weighted * f;
                    for &other in &self.active[..=place] {
                        self.gram[s * room + other] += weighted * inverse * self.columns[other];
                    }
                    let cross = &mut self.cross[s * n + e.offset..s * n + e.offset + p];
                    cross
                        .iter_mut()
                        .zip(phi.iter())
                        .for_each(|(c, x)| *c += weighted * inverse * x);
                }
            }
            self.summed.end();
        }
    }

    /// Updates scores, then T, to the estimate after the block, which ends at `end_ns`.
    pub fn step(&mut self, end_ns: u64, update: &Update<'_>) {
        let Update {
            gain,
            transition,
            total,
            equations,
            sums,
            moved,
        } = *update;
        let n = self.n;
        self.refer_to_end(end_ns);
        // Φᵀν = Σ φ f + S (θ − θ̄)
        for (i, g) in self.regressor.iter_mut().enumerate() {
            *g = dot(&total[i * n..(i + 1) * n], moved);
        }
        for (e, sums) in equations.iter().zip(sums) {
            for (g, s) in self.regressor[e.offset..].iter_mut().zip(&sums.score) {
                *g += s;
            }
        }
        let room = self.scores.len();
        for s in 0..self.count {
            let (cross, t) = (&self.cross[s * n..(s + 1) * n], &self.sensitivity[s * n..(s + 1) * n]);
            // Φᵀh = Σ φ d − S T, and K Φᵀh
            for i in 0..n {
                self.seen[s * n + i] = cross[i] - dot(&total[i * n..(i + 1) * n], t);
            }
            for i in 0..n {
                self.images[s * n + i] = dot(&gain[i * n..(i + 1) * n], &self.seen[s * n..(s + 1) * n]);
            }
            // u of (e)
            let h_nu = self.score[s] + dot(cross, moved) - dot(t, &self.regressor);
            self.scores[s] = h_nu - dot(&self.regressor, &self.images[s * n..(s + 1) * n]);
        }
        for s in 0..self.count {
            for r in 0..=s {
                // I of (e): hᵀh − (Φᵀh)ᵀ K Φᵀh
                let (seen, t) = (&self.seen[r * n..(r + 1) * n], &self.sensitivity[s * n..(s + 1) * n]);
                let t_r = &self.sensitivity[r * n..(r + 1) * n];
                let hh = self.gram[s * room + r] - dot(&self.cross[s * n..(s + 1) * n], t_r) - dot(seen, t);
                let information = hh - dot(seen, &self.images[s * n..(s + 1) * n]);
                self.information[s * room + r] = information;
                self.information[r * room + s] = information;
            }
        }
        for s in 0..self.count {
            // the part of the column that the parameters do not explain is rounding
            if self.imitated[s] || self.information[s * room + s] <= RESOLVED * self.gram[s * room + s] {
                self.scores[s] = 0.0;
                for r in 0..self.count {
                    self.information[s * room + r] = 0.0;
                    self.information[r * room + s] = 0.0;
                }
            }
            // (c)
            let cross = &self.cross[s * n..(s + 1) * n];
            let t = &mut self.sensitivity[s * n..(s + 1) * n];
            for i in 0..n {
                self.vector[i] = dot(&transition[i * n..(i + 1) * n], t) + dot(&gain[i * n..(i + 1) * n], cross);
            }
            t.copy_from_slice(&self.vector);
        }
    }

    /// The same for a line through the block, whose end is the estimate: with C⁻¹ the information
    /// of its start and W its weights
    ///
    /// ```text
    /// T ← (I, ½ I) Cov(c, v) (Σ w (φ, sφ) d + (I, −½ I) C⁻¹ T)
    /// ```
    ///
    /// `theta` is workspace for all parameters; afterwards those of the group are at the line's
    /// end.
    pub fn step_line(&mut self, rows: &dyn Summable, update: &LineUpdate<'_>, theta: &mut [f64]) {
        let LineUpdate {
            equations,
            line,
            start_information,
            fixed,
            first,
        } = *update;
        let (n, m) = (self.n, 2 * self.n);
        self.end_ns = rows.span(rows.len().saturating_sub(1)).1;
        self.summed.clear();
        let (suspects, length) = (rows.suspect_rows(), rows.len().max(2) as f64 - 1.0);
        self.clear_scores();
        for s in 0..self.count {
            let t = &mut self.sensitivity[s * n..(s + 1) * n];
            for i in 0..n {
                let pull = dot(&start_information[i * n..(i + 1) * n], t);
                (self.doubled[i], self.doubled[n + i]) = (pull, -0.5 * pull);
            }
            // the slopes of a line contain the drifts
            for e in equations.iter().filter(|_| s < self.known) {
                let weight = 1.0 / (e.divisor * e.divisor * e.variance.max(TINY));
                for index in 0..rows.len() {
                    suspects.row(e.index, index, &mut self.columns[..self.known]);
                    let d = self.columns[s];
                    if d == 0.0 {
                        continue;
                    }
                    let place = index as f64 / length - 0.5;
                    for (i, own) in e.parameters.clone().enumerate() {
                        let k = e.offset + i;
                        theta[own] = line.middle[k] + place * line.slope[k];
                    }
                    let phi = &mut self.regressor[..e.parameters.len()];
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

    /// Largest number of errors.
    pub fn room(&self) -> usize {
        self.scores.len()
    }

    /// Σ w φ d_s at s n, Σ w d_s d_t at s room + t for t ≤ s, and Σ w d_s f of the block.
    pub fn sums(&self) -> (&[f64], &[f64], &[f64]) {
        (&self.cross, &self.gram, &self.score)
    }

    /// u and I of the last block, and the evidence of sums of its rows.
    pub fn evidence(&self) -> (&[f64], &[f64], &[SummedScore]) {
        (&self.scores, &self.information, &self.summed.scores)
    }

    /// The part of Σ c_k² that the errors explain. c = `values` are uncorrelated, of variance 1,
    /// and made from A (θ_block − θ̄); `image`(w) is the c of w = Σ φ d/σ² − A T, the score that an
    /// error contributes. `noise` is σ² for each parameter, as in A = `total`. Woodbury's formula.
    pub fn explained(
        &mut self,
        values: &[f64],
        noise: &[f64],
        total: &[f64],
        curvature: &Curvature,
        mut image: impl FnMut(&[f64], &mut [f64]),
    ) -> f64 {
        let (n, count, room) = (self.n, self.known, self.scores.len());
        let rank = values.len();
        for s in 0..count {
            let (at, t) = (s * n, &self.sensitivity[s * n..(s + 1) * n]);
            (0..n).for_each(|i| self.vector[i] = self.cross[at + i] / noise[i]);
            curvature.turn_slope_back(&mut self.vector);
            (0..n).for_each(|i| self.vector[i] -= dot(&total[i * n..(i + 1) * n], t));
            image(&self.vector, &mut self.seen[s * n..(s + 1) * n]);
        }
        // an error of amplitude √M_ss: Woodbury's formula for unit columns, with their correlations
        let size = |s: usize| self.moments[s * room + s].max(0.0).sqrt();
        let active = |s: &usize| size(*s) > 0.0;
        let rows = (0..count).filter(active).count();
        if rows == 0 {
            return 0.0;
        }
        for (row, s) in (0..count).filter(active).enumerate() {
            for (column, r) in (0..count).filter(active).enumerate() {
                self.matrix[row * rows + column] = self.moments[s * room + r] / (size(s) * size(r));
            }
            self.matrix[row * rows + row] += ROUNDING;
        }
        if !self.factor.factor(rows, &self.matrix[..rows * rows]) {
            return 0.0;
        }
        // (C⁻¹ + AᵀA)⁻¹ with C the correlations, A the images
        self.factor.inverse(&mut self.matrix[..rows * rows]);
        for (row, s) in (0..count).filter(active).enumerate() {
            let image = &self.seen[s * n..s * n + rank];
            self.right[row] = size(s) * dot(image, values);
            for (column, r) in (0..count).filter(active).enumerate() {
                self.matrix[row * rows + column] += size(s) * size(r) * dot(image, &self.seen[r * n..r * n + rank]);
            }
        }
        if !self.factor.factor(rows, &self.matrix[..rows * rows]) {
            return 0.0;
        }
        self.columns[..rows].copy_from_slice(&self.right[..rows]);
        self.factor.solve(&mut self.columns[..rows]);
        dot(&self.columns[..rows], &self.right[..rows])
    }
}
