//! What a change was, by all rows since: is the plant another one, or what it is measured with?
//!
//! ```text
//! J(δ, a) = Σ (f − φᵀδ − a d)²/σ²     rows since the change, at θ₀ of before it                  (a)
//! J_θ = min J(δ, 0) + δᵀD⁻¹δ          other parameters: D = diag(size²)                          (b)
//! J_0 = min J(δ, 0) + δᵀV⁻¹δ          nothing: V = P₀ + (ρ²r² + ε²) diag(θ₀²)                     (c)
//! J_s = min J(δ, a) + δᵀV⁻¹δ          error s, with the parameters as they were                  (d)
//!
//! δ_θ: the shift of (b);  r² = δ_θᵀ Σφφᵀ δ_θ/θ₀ᵀ Σφφᵀ θ₀
//! ```
//!
//! A drive that gives 5 % less from some time on moves every parameter of its equation by 5 %, and
//! leaves no residual: the estimate follows, exactly and wrongly. A plant that changes moves some
//! parameters and leaves others, such as the back EMF of a motor. So after a change each
//! hypothesis (d) of an error that may come up while a machine runs is held against (b) and (c).
//! If (c) does not explain the rows and some (d) does as well as (b), nothing of the group may be
//! used: until the rows refute every (d), which most motion does within a block or two, or for as
//! long as they do not. A change back is seen the same way, because θ₀ stays that of before the
//! first of them. If the rows of one group refute every (d), the plant has changed, and no group
//! asks further. An error is named as soon as the rows inform on more than half of the parameters'
//! directions: a machine that rests shows one, which every cause explains. Once it is named, or
//! has explained the change for some blocks of motion, a further change leaves nothing to compare
//! with, and only (c) clears it up.
//!
//! P₀ is the covariance that was published before the change, so what was not known then tells
//! nothing now. Rows are linearised at θ₀, where (d) holds, however far the estimate has gone
//! since; ρ allows for an error that is so large that its column is curved. σ² is larger than the
//! noise if the rows leave more than noise behind.

use super::equation::{EquationState, TINY};
use super::linalg::{Cholesky, Eigen, dot, gather, mul_vec};
use super::pass::{Summable, Sums};
use super::persist::Visit;
use super::score_test::Suspicion;

/// ρ: share of the change that columns are off by because they are not linear.
const CURVED: f64 = 0.05;
/// ε: change of a parameter that nobody minds.
const NOTABLE: f64 = 1e-3;
/// A hypothesis is refuted if it leaves so much more χ² than (b), beside one per parameter.
const REFUTED: f64 = 30.0;
/// Share by which parameters would have to change for the rows to tell: these know more than half
/// of the directions.
const KNOWN: f64 = 0.5;
/// Blocks of such rows after which an error that still explains the change is taken for likely.
const LONG: u32 = 4;
/// Standard deviations by which the rows must tell a change of the amplitude in question from none,
/// in more than half of the directions, to name its cause.
const TOLD: f64 = 5.0;

/// A change with all that has come since, of one group.
#[derive(Debug, Clone)]
pub struct Inquiry {
    n: usize,
    open: bool,
    withheld: bool,
    /// An error explained the change for some time, and the plant has changed since.
    lost: bool,
    /// Blocks for which an error has explained the change, and whether one is named.
    blocks: u32,
    named: bool,
    /// θ₀ and P₀.
    reference: Vec<f64>,
    known: Vec<f64>,
    /// Σ φφᵀ, Σ φ f, Σ f² and the number of rows since, in units of σ².
    information: Vec<f64>,
    vector: Vec<f64>,
    cost: f64,
    rows: f64,
    /// Σ φ d_s at s n, Σ d_s² and Σ d_s f.
    cross: Vec<f64>,
    gram: Vec<f64>,
    score: Vec<f64>,
    cause: Option<Suspicion>,
    // scratch
    matrix: Vec<f64>,
    packed: Vec<f64>,
    inverse: Vec<f64>,
    factor: Cholesky,
    eigen: Eigen,
    shift: Vec<f64>,
    image: Vec<f64>,
}

/// What a block adds: its sums, and those over the columns of errors, both taken at θ₀.
pub struct BlockSums<'a> {
    /// The group's equations.
    pub equations: &'a [EquationState],
    /// Their sums.
    pub sums: &'a [Sums],
    /// Σ φ d_s at s n, Σ d_s d_t at s room + t, Σ d_s f.
    pub columns: (&'a [f64], &'a [f64], &'a [f64]),
    /// Variance of the noise, in units of the sums.
    pub variance: f64,
}

impl Inquiry {
    /// Room for a group of n parameters and so many errors.
    pub fn new(n: usize, errors: usize) -> Self {
        let (matrix, vector) = (vec![0.0; n * n], vec![0.0; n]);
        Self {
            n,
            open: false,
            withheld: false,
            lost: false,
            blocks: 0,
            named: false,
            reference: vector.clone(),
            known: matrix.clone(),
            information: matrix.clone(),
            vector: vector.clone(),
            cost: 0.0,
            rows: 0.0,
            cross: vec![0.0; errors * n],
            gram: vec![0.0; errors],
            score: vec![0.0; errors],
            cause: None,
            matrix: matrix.clone(),
            packed: matrix.clone(),
            inverse: matrix,
            factor: Cholesky::new(n),
            eigen: Eigen::new(n),
            shift: vector.clone(),
            image: vector,
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.flag(&mut self.open);
        v.flag(&mut self.withheld);
        v.flag(&mut self.lost);
        v.small(&mut self.blocks);
        v.flag(&mut self.named);
        v.reals(&mut self.reference);
        v.reals(&mut self.known);
        self.sums_mut().into_iter().for_each(|sums| v.reals(sums));
        v.real(&mut self.cost);
        v.real(&mut self.rows);
    }

    /// Ends it, whatever came out.
    pub fn close(&mut self) {
        (self.open, self.withheld, self.lost) = (false, false, false);
        (self.blocks, self.named, self.cause) = (0, false, None);
    }

    /// The plant has changed: two causes at once are unlikely.
    pub fn clear(&mut self) {
        if !self.lost {
            self.close();
        }
    }

    /// θ₀.
    pub fn reference(&self) -> &[f64] {
        &self.reference
    }

    /// True while it goes on.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// True if nothing of the group may be used: an error may be what has changed.
    pub fn withholds(&self) -> bool {
        self.withheld
    }

    /// The error that explains the change.
    pub fn cause(&self) -> Option<Suspicion> {
        self.cause
    }

    /// A change: what was known before it was θ₀ with the covariance P₀. One that is not cleared up
    /// yet keeps its own.
    pub fn begin(&mut self, theta: &[f64], covariance: &[f64]) {
        if !self.open {
            self.reference.copy_from_slice(theta);
            self.known.copy_from_slice(covariance);
        }
        self.open = true;
        self.lost |= self.named || self.blocks >= LONG;
        self.blocks = 0;
        (self.cost, self.rows) = (0.0, 0.0);
        self.sums_mut().into_iter().for_each(|sums| sums.fill(0.0));
    }

    /// Adds a block, after the rows so far were forgotten by `forgetting_factor`.
    pub fn take(&mut self, rows: &dyn Summable, block: &BlockSums<'_>, forgetting_factor: f64) {
        let n = self.n;
        self.forget(forgetting_factor);
        let weight = 1.0 / block.variance.max(TINY);
        for (e, sums) in block.equations.iter().zip(block.sums) {
            let p = sums.params;
            let own = e.offset..e.offset + p;
            self.cost += weight * sums.cost;
            self.rows += sums.rows as f64;
            for i in 0..p {
                let gram = &sums.gram[i * p..(i + 1) * p];
                let information = &mut self.information[(e.offset + i) * n..][own.clone()];
                information.iter_mut().zip(gram).for_each(|(sum, v)| *sum += weight * v);
                self.vector[own.start + i] += weight * sums.score[i];
            }
        }
        let (cross, gram, score) = block.columns;
        let room = score.len();
        for s in (0..rows.suspects().min(self.gram.len())).filter(|&s| rows.is_sudden(s)) {
            let cross = &cross[s * n..(s + 1) * n];
            let sums = &mut self.cross[s * n..(s + 1) * n];
            sums.iter_mut().zip(cross).for_each(|(sum, v)| *sum += weight * v);
            self.gram[s] += weight * gram[s * room + s];
            self.score[s] += weight * score[s];
        }
    }

    /// The sums over the rows since.
    fn sums_mut(&mut self) -> [&mut Vec<f64>; 5] {
        [
            &mut self.information,
            &mut self.vector,
            &mut self.cross,
            &mut self.gram,
            &mut self.score,
        ]
    }

    fn forget(&mut self, forgetting_factor: f64) {
        let sums = self.sums_mut().into_iter().flatten();
        sums.for_each(|sum| *sum *= forgetting_factor);
        self.cost *= forgetting_factor;
        self.rows *= forgetting_factor;
    }

    /// Holds (b) to (d) against each other. `size` is that of each parameter, 0 for a fixed one;
    /// `settled` if the rows since confirm all of them. True if nothing but (b) explains them.
    pub fn judge(&mut self, size: &[f64], fixed: &[bool], settled: bool) -> bool {
        let Some(found) = self.compare(size, fixed) else {
            return false;
        };
        let other = matches!(found, Found::Other);
        match found {
            Found::Nothing if settled || self.lost && self.tells(1.0, fixed) => self.close(),
            _ if self.lost => (),
            Found::Nothing => (self.withheld, self.named, self.cause) = (false, false, None),
            Found::Other => self.clear(),
            Found::Error(error) => {
                self.withheld = true;
                self.named = self.tells(error.amplitude, fixed);
                self.cause = self.named.then_some(error);
                self.blocks = match self.tells(KNOWN, fixed) {
                    true => self.blocks.saturating_add(1),
                    false => 0,
                };
            }
        }
        other
    }

    /// r: how much of what the equations balance has changed.
    fn share_changed(&mut self) -> f64 {
        let n = self.n;
        mul_vec(n, &self.information, &self.shift, &mut self.image);
        let changed = dot(&self.shift, &self.image);
        mul_vec(n, &self.information, &self.reference, &mut self.image);
        (changed / dot(&self.reference, &self.image).max(TINY)).max(0.0).sqrt()
    }

    /// True if the rows tell a change of all parameters by this share from none, in more than half
    /// of the directions.
    fn tells(&mut self, share: f64, fixed: &[bool]) -> bool {
        let n = self.n;
        for i in 0..n {
            for j in 0..n {
                self.matrix[i * n + j] = self.information[i * n + j] * self.reference[i] * self.reference[j];
            }
        }
        let count = gather(n, &self.matrix, fixed, &mut self.packed);
        self.eigen.decompose(count, &self.packed[..count * count]);
        let least = (TOLD / share).powi(2);
        let told = self.eigen.values[..count].iter().filter(|&&value| value > least);
        2 * told.count() > count
    }

    /// What explains the rows; `None` if they cannot be compared.
    fn compare(&mut self, size: &[f64], fixed: &[bool]) -> Option<Found> {
        let n = self.n;
        // (b), and what it leaves beyond the noise
        self.matrix.copy_from_slice(&self.information);
        for i in 0..n {
            self.matrix[i * n + i] += if size[i] > 0.0 { size[i].powi(-2) } else { 0.0 };
        }
        let count = gather(n, &self.matrix, fixed, &mut self.packed);
        if count == 0 || !self.factor.factor(count, &self.packed[..count * count]) {
            return None;
        }
        let other = -self.solve(fixed, Side::Rows);
        let excess = ((self.cost + other) / self.rows.max(1.0)).max(1.0);
        // V of (c)
        self.matrix.copy_from_slice(&self.known);
        let share = self.share_changed();
        for i in 0..n {
            let slack = (CURVED * share).hypot(NOTABLE) * self.reference[i];
            self.matrix[i * n + i] += slack * slack + f64::MIN_POSITIVE;
        }
        let count = gather(n, &self.matrix, fixed, &mut self.packed);
        if !self.factor.factor(count, &self.packed[..count * count]) {
            return None;
        }
        self.factor.inverse(&mut self.inverse[..count * count]);
        gather(n, &self.information, fixed, &mut self.packed);
        for (a, v) in self.packed[..count * count].iter_mut().zip(&self.inverse) {
            *a += excess * v;
        }
        if !self.factor.factor(count, &self.packed[..count * count]) {
            return None;
        }
        let limit = other + excess * (REFUTED + count as f64);
        let nothing = -self.solve(fixed, Side::Rows); // (c)
        if nothing <= limit {
            return Some(Found::Nothing);
        }
        let mut best: Option<(f64, Suspicion)> = None;
        for s in 0..self.gram.len() {
            if !(self.gram[s] > 0.0) {
                continue;
            }
            // (d): what δ leaves of the column, and of its score
            let cross = s * n..(s + 1) * n;
            self.solve(fixed, Side::Error(s));
            let left = self.gram[s] - dot(&self.cross[cross], &self.shift);
            let score = self.score[s] - dot(&self.vector, &self.shift);
            if !(left > 0.0) {
                continue;
            }
            let leaves = nothing - score * score / left;
            if leaves <= limit && best.is_none_or(|(least, _)| leaves < least) {
                let suspicion = Suspicion {
                    suspect: s,
                    drifting: None,
                    amplitude: score / left,
                    deviations: score.abs() / (excess * left).sqrt(),
                    share: 1.0,
                };
                best = Some((leaves, suspicion));
            }
        }
        Some(best.map_or(Found::Other, |(_, error)| Found::Error(error)))
    }

    /// `shift` ← A⁻¹ of one side over the free parameters, 0 for the others; returns the product of
    /// both.
    fn solve(&mut self, fixed: &[bool], side: Side) -> f64 {
        let n = self.n;
        let right = match side {
            Side::Rows => &self.vector,
            Side::Error(s) => &self.cross[s * n..(s + 1) * n],
        };
        let free = (0..n).filter(|&i| !fixed[i]);
        let mut count = 0;
        for i in free.clone() {
            self.image[count] = right[i];
            count += 1;
        }
        self.factor.solve(&mut self.image[..count]);
        self.shift.fill(0.0);
        for (k, i) in free.enumerate() {
            self.shift[i] = self.image[k];
        }
        dot(right, &self.shift)
    }
}

/// Right sides: Σ φ f, or Σ φ d_s.
enum Side {
    Rows,
    Error(usize),
}

/// Which hypothesis explains the rows since a change.
enum Found {
    /// (c).
    Nothing,
    /// (b), and no (d).
    Other,
    /// (d).
    Error(Suspicion),
}
