//! Decides whether and when the plant changed in this block, and which prior information is still
//! valid.
//!
//! **Test.** With d = θ_block − θ̄ the difference between the block's own estimate and the one
//! before it,
//!
//! ```text
//! T = dᵀ (P + A⁻¹)⁻¹ d,    A = Σ_e S_e/σ_e²,    T/r ~ F(r, ν) if nothing changed
//! ```
//!
//! P is the true error covariance of θ̄ (not the inverse information, which forgetting makes too
//! large by the factor 1 + λ), r the number of directions that the block informs on, ν the degrees
//! of freedom of σ². A⁻¹ does not exist if the block leaves a direction open, so T is formed from A
//! d = A (θ_m − θ̄) + g(θ_m), g the score, which needs no block fit: with P = L Lᵀ and (b_k, q_k)
//! the eigenpairs of LᵀAL,
//!
//! ```text
//! T = Σ_k (q_kᵀ Lᵀ A d)² / (b_k (1 + b_k))
//! ```
//!
//! less the part that considered errors explain (`considered.rs`). This is a sum of squares without
//! cancellation, to which a direction without excitation (b_k = 0) does not contribute. Correlated
//! residuals raise σ_e² to their long-run variance (`long_run.rs`). The start value is only a
//! guess, so its variance enters P multiplied by 100: a wrong guess is not a change of the plant.
//!
//! **Kind.** On an alarm the block is fitted alone. If that fit leaves only noise, nothing changed
//! inside the block: all rows are used, and the prior is widened by the difference found. Otherwise
//! the block is cut at the row τ that minimises
//!
//! ```text
//! J(τ) = min_θ [prior + Σ_{rows ending before τ} f²/σ²]
//!      + min_θ [Σ_{rows starting at τ or later} f²/σ²] + number of rows across τ
//! ```
//!
//! over all groups together, and only the rows after τ are used, with the prior of the parameters
//! that they inform on widened to 100 %. Two common alternatives fail: scaling Λ by a factor, and
//! widening only the excited combinations. Both keep a wrong, overconfident prior in the other
//! directions (measured: θ₁ off by 10 standard deviations after a payload jump, because an open
//! combination of θ₁ and θ₂ kept its old value). Each side is linearised at its own estimate, the
//! later one again until τ settles. If a straight line θ(t) through the block costs less than the
//! cut, the plant drifts: the whole block is used, and the next blocks are expected to continue the
//! line.
//!
//! The alarm is withdrawn if the rows that begin after the cut, and share no samples with those
//! before it, do not show a change by themselves (T, 1 %). After a change they do so more than the
//! whole block, but not after a few rows that do not fit, such as those over a spike. Those are
//! then left out, and the block is a misfit.

use super::Forward;
use super::equation::{EquationState, TINY};
use super::fit::Fit;
use super::group::GroupState;
use super::index_set::IndexSet;
use super::linalg::{Cholesky, dot, gather};
use super::long_run::long_run_variance;
use super::options::{EstimatorOptions, Outliers};
use super::pass::{Loss, Summable, Sums, used};
use super::stats::f_tail;
use std::ops::Range;

/// Factor on the variance of the start value.
const GUESS: f64 = 100.0;
/// If the residuals of a block fit are less probable than this, they contain more than noise.
pub const CONSISTENT: f64 = 1e-4;
/// Degrees of freedom of a known variance.
pub const MANY: f64 = 1e6;
/// A group whose probability is below this joins one with an alarm. So only then does it matter
/// that residuals may be correlated, and the probability is computed again.
pub const JOINS: f64 = 1e-2;
/// Share of gated rows above which they are not outliers but a changed plant.
pub const GATED: f64 = 0.1;
/// Relative increase of the diagonal of singular sums, so that they can be inverted: far above
/// rounding, and far below the share of a direction that a block informs on.
const SINGULAR: f64 = 1e-9;
/// Boundaries per level of the search for τ.
const GRID: usize = 64;

/// What a block is compared with.
#[derive(Debug, Clone, Copy)]
enum Known {
    /// P of the recursion.
    Recursion,
    /// The same, widened by what the data since the last change have not confirmed.
    Confirmed,
}

impl GroupState {
    /// Probability of T at least this large if the plant is unchanged; 1 if there is nothing to
    /// compare with. The sums are those of all rows at `theta`.
    pub fn change_probability(&mut self, rows: &dyn Summable, theta: &[f64]) -> f64 {
        let probability = self.probability_of_the_block(theta, None, Known::Recursion);
        if probability < JOINS {
            probability.max(self.probability_of_the_block(theta, Some(rows), Known::Recursion))
        } else {
            probability
        }
    }

    /// True if what the data since the last change have not confirmed explains the difference: the
    /// same change shows at another joint later, as soon as it moves. For the same sums.
    pub fn expects_the_block(&mut self, rows: &dyn Summable, theta: &[f64]) -> bool {
        !self.confirmation.is_settled() && self.probability_of_the_block(theta, Some(rows), Known::Confirmed) >= JOINS
    }

    /// The probability, compared with what is `known`; with the `rows`, correlated residuals count
    /// as more noise.
    fn probability_of_the_block(&mut self, theta: &[f64], rows: Option<&dyn Summable>, known: Known) -> f64 {
        let freedom = self.equations.freedom();
        if self.tally.is_empty() || freedom < 1.0 {
            return 1.0;
        }
        self.weigh_the_block(theta, rows);
        self.root_of_the_prior(known);
        self.turn_to_directions();
        let (t, rank) = self.squares();
        let (t, directions) = (t.max(0.0), rank as f64);
        if rank == 0 {
            1.0
        } else {
            f_tail(t / directions, directions, freedom.min(MANY))
        }
    }

    /// Writes A to `total`, A d to `gradient`, and to `noise` the σ_e² of each parameter's rows.
    fn weigh_the_block(&mut self, theta: &[f64], rows: Option<&dyn Summable>) {
        let n = self.n;
        let room = &mut self.room;
        room.total.fill(0.0);
        room.gradient.fill(0.0);
        room.noise.fill(TINY);
        for (e, sums) in self.equations.pairs() {
            let p = sums.params;
            // the noise of this block, if it is consistent with the level known so far
            let mut of_block = own_variance(sums, &mut room.cholesky, &mut room.a, &mut room.scale);
            // larger residuals are those of a change within the block
            if let (Some(rows), Loss::Square, true) = (rows, e.loss, of_block <= e.variance) {
                let (step, regressor) = (&room.scale[..p], &mut room.regressor[..p]);
                let freedom = (sums.rows as f64 - p as f64).max(1.0);
                of_block = of_block.max(long_run_variance(rows, e, (theta, step), regressor, freedom));
            }
            let variance = e.variance.max(of_block.min(4.0 * e.variance)).max(TINY);
            for i in 0..p {
                // the largest of equations that share a parameter
                room.noise[e.offset + i] = variance.max(room.noise[e.offset + i]);
                room.gradient[e.offset + i] += sums.score[i] / variance;
                for j in 0..p {
                    room.total[(e.offset + i) * n + e.offset + j] += sums.gram[i * p + j] / variance;
                }
            }
        }
        // P is the one at θ̄
        self.prior.refer_back(&theta[self.parameters.clone()], room);
    }

    /// Writes L to `a`: P = L Lᵀ from the eigenvectors of the correlation matrix; zero for fixed
    /// parameters. `known` chooses P.
    fn root_of_the_prior(&mut self, known: Known) {
        let n = self.n;
        let room = &mut self.room;
        match known {
            Known::Recursion => (0..n * n).for_each(|k| room.b[k] = self.errors.doubting_guess(k, GUESS)),
            Known::Confirmed => {
                let published = &self.confirmation.covariance;
                self.widened.unconfirmed(self.errors.total(), published, &mut room.b);
            }
        }
        for i in 0..n {
            let v = room.b[i * n + i];
            room.scale[i] = if v > 0.0 && self.limits.is_free(i) {
                v.sqrt()
            } else {
                0.0
            };
        }
        for k in 0..n * n {
            let (si, sj) = (room.scale[k / n], room.scale[k % n]);
            room.a[k] = if si > 0.0 && sj > 0.0 {
                room.b[k] / (si * sj)
            } else {
                0.0
            };
        }
        room.eigen.decompose(n, &room.a);
        for i in 0..n {
            for k in 0..n {
                room.a[i * n + k] =
                    room.scale[i] * room.eigen.vectors[i * n + k] * room.eigen.values[k].max(0.0).sqrt();
            }
        }
    }

    /// Writes the eigenpairs of B = LᵀAL to `eigen` and Lᵀ A d to `offset`.
    fn turn_to_directions(&mut self) {
        let n = self.n;
        let room = &mut self.room;
        for i in 0..n {
            for k in 0..n {
                room.b[i * n + k] = (0..n).map(|j| room.total[i * n + j] * room.a[j * n + k]).sum();
            }
        }
        for k in 0..n {
            for l in 0..=k {
                let v: f64 = (0..n).map(|i| room.a[i * n + k] * room.b[i * n + l]).sum();
                room.transition[k * n + l] = v;
                room.transition[l * n + k] = v;
            }
            room.offset[k] = (0..n).map(|i| room.a[i * n + k] * room.gradient[i]).sum();
        }
        room.eigen.decompose(n, &room.transition);
    }

    /// T, and the number of directions that the block informs on. A considered error makes the
    /// estimate vary with the motion, which is no change, so its share is subtracted from T.
    fn squares(&mut self) -> (f64, usize) {
        let n = self.n;
        let room = &mut self.room;
        let (eigen, clusters, root) = (&room.eigen, &mut self.clusters, &room.a);
        let curvature = &self.prior.curvature;
        let largest = eigen.values[..n].iter().fold(0.0, |a: f64, &b| a.max(b));
        let informs = |b: f64| b > 1e-6 && b > 1e-12 * largest;
        let (mut t, mut rank) = (0.0, 0);
        clusters.begin();
        room.gradient.fill(0.0);
        for k in (0..n).filter(|&k| informs(eigen.values[k])) {
            let b = eigen.values[k];
            let c: f64 = (0..n).map(|i| eigen.vectors[i * n + k] * room.offset[i]).sum();
            clusters.add(b, c, |i| {
                (0..n).map(|j| root[i * n + j] * eigen.vectors[j * n + k]).sum()
            });
            let unit = c / (b * (1.0 + b)).sqrt();
            t += unit * unit;
            room.gradient[rank] = unit;
            rank += 1;
        }
        // q_kᵀ Lᵀ w
        let along = |k: usize, w: &[f64]| -> f64 {
            let rooted = |j: usize| (0..n).map(|i| root[i * n + j] * w[i]).sum::<f64>();
            (0..n).map(|j| eigen.vectors[j * n + k] * rooted(j)).sum()
        };
        t -= self.considered.explained(
            &room.gradient[..rank],
            &room.noise,
            &room.total,
            curvature,
            |w, image| {
                let informing = (0..n).filter(|&k| informs(eigen.values[k]));
                for (image, k) in image.iter_mut().zip(informing) {
                    let b = eigen.values[k];
                    *image = along(k, w) / (b * (1.0 + b)).sqrt();
                }
            },
        );
        (t, rank)
    }

    /// True if a gate dropped more rows than outliers can explain.
    pub fn is_another_plant(&self, options: &EstimatorOptions) -> bool {
        let gated = |s: &Sums| s.outliers as f64 > GATED * s.rows as f64;
        matches!(options.outliers, Outliers::Gate(_)) && !self.tally.is_empty() && self.equations.at().iter().any(gated)
    }

    /// Sets a weak prior, for a fit to the rows alone: centred at θ̄, 100 % of each parameter.
    pub fn prior_weak(&mut self) {
        let variance = self.equations.variance().max(TINY);
        self.prior.weaken(variance);
    }

    /// Fits the rows alone, from the present θ.
    pub fn fit_alone(
        &mut self,
        rows: &dyn Summable,
        range: Range<usize>,
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) -> Fit {
        self.prior_weak();
        self.equations.evaluate(rows, range.clone(), theta);
        self.fit(rows, range, theta, options)
    }

    /// True if the residuals at θ are no larger than the noise known so far.
    pub fn is_consistent(&self, options: &EstimatorOptions) -> bool {
        self.equations.pairs().all(|(e, sums)| {
            let mut freedom = (sums.rows - sums.outliers) as f64 - sums.params as f64;
            if freedom < 1.0 {
                return true;
            }
            let mut variance = sums.cost / freedom;
            if e.loss != Loss::Square {
                // the median's efficiency is 0.37
                (variance, freedom) = (e.scale * e.scale, 0.37 * freedom);
            }
            let ratio = variance / e.variance.max(TINY);
            f_tail(ratio, freedom, e.freedom.max(1.0)) > CONSISTENT
        }) && !self.is_another_plant(options)
    }

    /// Largest ratio, over the equations, of the residual variance at θ to the noise variance
    /// known so far.
    pub fn excess(&self) -> f64 {
        let of = |(e, sums): (&EquationState, &Sums)| {
            let freedom = (sums.rows - sums.outliers) as f64 - sums.params as f64;
            sums.cost / (freedom.max(1.0) * e.variance.max(TINY))
        };
        self.equations.pairs().map(of).fold(0.0, f64::max)
    }

    /// Widens the covariance of the parameters that the rows inform on, alone or in combination:
    /// parameter i by `sizes`[i], or by its whole size.
    ///
    /// If a combination remains open, all its members are widened alike, because what was known of
    /// it was known of the old plant.
    pub fn widen(&mut self, theta: &[f64], sizes: Option<&[f64]>) {
        let n = self.n;
        self.excite(theta);
        let free = self.limits.free().count();
        let full = self.excitation.rank == free;
        let share = sizes.map_or(1.0, |sizes| {
            (0..n)
                .map(|i| sizes[i].abs() / self.size(theta, i))
                .fold(0.0, f64::max)
                .min(1.0)
        });
        for i in self.limits.free() {
            let size = self.size(theta, i);
            let by = match sizes {
                Some(sizes) if full => sizes[i].abs().min(size),
                _ if self.excitation.touches(i) => share * size,
                _ => 0.0,
            };
            self.errors.add_change(i, by * by);
        }
        self.total_covariance();
    }

    /// Adds to `costs`[k] the least cost, in units of the noise, of the rows before boundary k or
    /// from it on, with the present prior and linearised at `theta`. The sums grow from boundary to
    /// boundary.
    fn segment_costs(
        &mut self,
        rows: &dyn Summable,
        whole: Range<usize>,
        theta: &[f64],
        boundaries: &[Boundary],
        segment: Segment,
        costs: &mut [f64],
    ) {
        let n = self.n;
        let variance = self.equations.variance().max(TINY);
        let own = &theta[self.parameters.clone()];
        self.prior.expand(own, &mut self.room);
        let mut total = self.prior.cost(own);
        let after = segment == Segment::After;
        let forward = Forward(rows);
        let side: &dyn Summable = if after { rows } else { &forward };
        let mut reached = if after { whole.end } else { whole.start };
        for step in 0..boundaries.len() {
            let k = if after { boundaries.len() - 1 - step } else { step };
            let part = if after {
                boundaries[k].after.min(reached)..reached
            } else {
                reached..boundaries[k].before.max(reached)
            };
            reached = if after { part.start } else { part.end };
            if !part.is_empty() {
                total = self
                    .equations
                    .add_rows(side, part, theta, variance, total, &mut self.room);
            }
            // least = total − gᵀ A⁻¹ g; `offset` becomes A⁻¹ g and `scale` holds g
            let mut least = total;
            let room = &mut self.room;
            let count = gather(n, &room.total, self.limits.fixed(), &mut room.a);
            for (a, i) in self.limits.free().enumerate() {
                room.offset[a] = room.gradient[i];
                room.scale[a] = room.gradient[i];
            }
            if room.cholesky.factor(count, &room.a[..count * count]) {
                room.cholesky.solve(&mut room.offset[..count]);
                least -= dot(&room.offset[..count], &room.scale[..count]);
            }
            costs[k] += least / variance;
        }
    }
}

/// The rows on one side of a cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Segment {
    Before,
    After,
}

/// A place where a block may be cut.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Boundary {
    /// The row whose first instant is the cut.
    row: usize,
    /// Rows before this one end before the cut.
    before: usize,
    /// Rows from this one on start at the cut or after it.
    after: usize,
}

impl Boundary {
    /// The cut at the first instant of `row`, which lies in `whole`.
    pub fn at(rows: &dyn Summable, whole: &Range<usize>, row: usize) -> Self {
        let cut = rows.span(row).0;
        let mut before = row;
        while before > whole.start && rows.span(before - 1).1 >= cut {
            before -= 1;
        }
        Self {
            row,
            before,
            after: row,
        }
    }
}

/// Residual variance of one equation if it were fitted alone: cost over degrees of freedom. If the
/// block does not inform on every direction, its sums are singular, and the others are fitted.
/// Leaves the step to that fit in `vector`.
fn own_variance(sums: &Sums, factor: &mut Cholesky, matrix: &mut [f64], vector: &mut [f64]) -> f64 {
    let p = sums.params;
    let freedom = sums.rows as f64 - p as f64;
    let (matrix, x) = (&mut matrix[..p * p], &mut vector[..p]);
    x.fill(0.0);
    if freedom < 1.0 {
        return 0.0;
    }
    let mut cost = sums.cost;
    matrix.copy_from_slice(&sums.gram);
    for i in 0..p {
        let diagonal = &mut matrix[i * p + i];
        *diagonal = if *diagonal > 0.0 {
            *diagonal * (1.0 + SINGULAR)
        } else {
            1.0
        };
    }
    if factor.factor(p, matrix) {
        x.copy_from_slice(&sums.score);
        factor.solve(x);
        cost -= dot(x, &sums.score);
    }
    cost.max(0.0) / freedom
}

/// Finds the cut of `whole` that costs least, for the groups in `joined` together; returns it with
/// its cost.
///
/// `before` and `later` are the points of linearisation of either side. The earlier side uses the
/// prior of the block, unless it is `free` because an earlier cut separates them.
pub fn locate(
    groups: &mut [GroupState],
    joined: IndexSet,
    rows: &dyn Summable,
    whole: Range<usize>,
    before: &[f64],
    later: &[f64],
    free: bool,
) -> (usize, f64) {
    let (mut low, mut high) = (whole.start, whole.end - 1);
    let mut boundaries = [Boundary::default(); GRID + 1];
    loop {
        let stride = (high - low).div_ceil(GRID).max(1);
        let mut count = 0;
        let mut row = low;
        while row <= high && count <= GRID {
            boundaries[count] = Boundary::at(rows, &whole, row);
            count += 1;
            row += stride;
        }
        let boundaries = &boundaries[..count];
        let mut costs = [0.0; GRID + 1];
        let costs = &mut costs[..count];
        for (k, group) in groups.iter_mut().enumerate() {
            if !joined.contains(k) {
                continue;
            }
            if free {
                group.prior_weak();
            } else {
                group.prior_from_covariance();
            }
            group.segment_costs(rows, whole.clone(), before, boundaries, Segment::Before, costs);
            group.prior_weak();
            group.segment_costs(rows, whole.clone(), later, boundaries, Segment::After, costs);
            for (cost, boundary) in costs.iter_mut().zip(boundaries) {
                let straddling = boundary.before..boundary.after;
                let count = |e: &EquationState| used(rows, e.index, straddling.clone());
                *cost += group.equations.states().iter().map(count).sum::<usize>() as f64;
            }
        }
        let mut best = 0;
        for k in 1..count {
            if costs[k] < costs[best] {
                best = k;
            }
        }
        let row = boundaries[best].row;
        if stride == 1 {
            return (row, costs[best]);
        }
        low = row.saturating_sub(stride - 1).max(whole.start);
        high = (row + stride - 1).min(whole.end - 1);
    }
}
