//! Forgetting rules: the information that remains when a block begins, and the bound that is
//! applied when it ends.
//!
//! ```text
//! exponential         Λ = λ Γ⁻¹                                        Γ_m⁻¹ = Λ + S                 (9)
//! bounded-as-printed  Λ = λ Γ⁻¹          Π⁻¹ = Λ + S                   Γ_m = ε⁻¹ G(ε Π)              (10), (11)
//! bounded             Λ = Γ⁻¹            Π⁻¹ = Λ + S                   Γ_m = ε⁻¹ G(ε Π)              (10), no λ
//! floor               Λ = λ Γ⁻¹ + (1 − λ) ε I                          Γ_m⁻¹ = Λ + S
//! directional         Λ = Γ⁻¹ − (1 − λ) Γ⁻¹U (UᵀΓ⁻¹U)⁻¹ UᵀΓ⁻¹          Γ_m⁻¹ = Λ + S                 arXiv 2404.10844
//! ```
//!
//! U spans the directions that the block excites strongly, in units of the parameters themselves.
//! With all directions excited `directional` is `exponential`; with none it forgets nothing.
//! Replacing knowledge good to 0.1 % by a block estimate good to 100 % is a loss. So a direction is
//! forgotten only if the block alone finds it to within 10 %; it counts as excited at 100 %.

use super::bound::{CovarianceBound, Factor, Polynomial, Rational};
use super::linalg::{Eigen, dot};
use super::options::{Bound, EstimatorOptions, Forgetting};

/// The directions of parameter space that a block informs on.
///
/// Parameters are measured in units of their own size, so that directions mean the same whatever
/// the units. With e_k the eigenvalues of the scaled information over the noise variance, a block
/// alone would find direction k to within 1/√e_k of the parameters' size; it is excited if
/// e_k > 1.
#[derive(Debug, Clone)]
pub struct Excitation {
    eigen: Eigen,
    scaled: Vec<f64>,
    scale: Vec<f64>,
    n: usize,
    /// Number of excited directions.
    pub rank: usize,
    /// Number of strongly excited directions, which come first: the block replaces what was known
    /// of them.
    strong: usize,
    directions: Vec<f64>,
    shares: Vec<f64>,
}

impl Excitation {
    /// Eigenvalues of the scaled information below this share of the largest are rounding.
    const ROUNDING: f64 = 1e-12;
    /// Eigenvalue from which a direction is strongly excited: the block alone finds it to within 10
    /// %.
    const STRONG: f64 = 100.0;

    /// Resets to no excited direction.
    pub fn clear(&mut self) {
        (self.rank, self.strong) = (0, 0);
        self.shares.fill(0.0);
    }

    /// Room for n parameters.
    pub fn new(n: usize) -> Self {
        Self {
            eigen: Eigen::new(n),
            scaled: vec![0.0; n * n],
            scale: vec![1.0; n],
            n,
            rank: 0,
            strong: 0,
            directions: vec![0.0; n * n],
            shares: vec![0.0; n],
        }
    }

    /// Finds the directions of `information`, Σ φφᵀ/σ², for parameters of the sizes `scale`.
    pub fn analyse(&mut self, information: &[f64], scale: &[f64], free: &[bool]) {
        let n = self.n;
        for i in 0..n {
            self.scale[i] = if free[i] { scale[i] } else { 0.0 };
        }
        for i in 0..n {
            for j in 0..n {
                self.scaled[i * n + j] = information[i * n + j] * self.scale[i] * self.scale[j];
            }
        }
        self.eigen.decompose(n, &self.scaled);
        let largest = self.eigen.values[..n].iter().fold(0.0, |a: f64, &b| a.max(b));
        let threshold = Self::ROUNDING * largest;
        self.rank = 0;
        self.shares.fill(0.0);
        for k in 0..n {
            let value = self.eigen.values[k];
            if value <= threshold {
                continue;
            }
            for i in 0..n {
                self.shares[i] += self.eigen.vectors[i * n + k].powi(2) * value / (1.0 + value);
            }
        }
        self.add_directions(Self::STRONG.max(threshold), f64::INFINITY);
        self.strong = self.rank;
        self.add_directions(threshold.max(1.0), Self::STRONG);
    }

    /// Adds the directions with an eigenvalue above `above` and up to `up_to`.
    fn add_directions(&mut self, above: f64, up_to: f64) {
        let n = self.n;
        for k in 0..n {
            let value = self.eigen.values[k];
            if value > above && value <= up_to {
                for i in 0..n {
                    self.directions[i * n + self.rank] = self.eigen.vectors[i * n + k];
                }
                self.rank += 1;
            }
        }
    }

    /// Share of the variance of parameter i, known to within its own size, that this block alone
    /// would remove: 0 to 1.
    pub fn share(&self, i: usize) -> f64 {
        self.shares[i]
    }

    /// True if parameter i has a component of at least a tenth in an excited direction.
    pub fn touches(&self, i: usize) -> bool {
        self.directions[i * self.n..i * self.n + self.rank]
            .iter()
            .any(|d| d.abs() > 0.1)
    }

    /// Direction k < rank in units of the parameters, entry i.
    pub fn direction(&self, i: usize, k: usize) -> f64 {
        self.directions[i * self.n + k] * self.scale[i]
    }
}

/// A forgetting rule with its numbers and its workspace.
#[derive(Debug, Clone)]
pub struct Rule {
    forgetting: Forgetting,
    bound: Bound,
    lambda: f64,
    floor: f64,
    factor: Factor,
    work: Vec<f64>,
    basis: Vec<f64>,
}

impl Rule {
    /// The rule of validated options, for groups of n parameters.
    pub fn new(options: &EstimatorOptions, n: usize) -> Self {
        Self {
            forgetting: options.forgetting,
            bound: options.bound,
            lambda: options.forgetting_factor,
            floor: options.information_floor,
            factor: Factor::new(n),
            work: vec![0.0; n * n],
            basis: vec![0.0; n * n],
        }
    }

    /// Adopts λ and ε.
    pub fn retune(&mut self, options: &EstimatorOptions) {
        (self.lambda, self.floor) = (options.forgetting_factor, options.information_floor);
    }

    /// Λ from Γ⁻¹ in `information`, n × n.
    pub fn prior(&mut self, n: usize, information: &[f64], excitation: &Excitation, prior: &mut [f64]) {
        let (lambda, floor) = (self.lambda, self.floor);
        prior.copy_from_slice(information);
        match self.forgetting {
            Forgetting::Bounded => {} // (10) without its λ
            Forgetting::Exponential | Forgetting::BoundedAsPrinted => {
                prior.iter_mut().for_each(|v| *v *= lambda); // (9), (10): λ Γ_{m−1}⁻¹
            }
            Forgetting::Floor => {
                prior.iter_mut().for_each(|v| *v *= lambda);
                (0..n).for_each(|i| prior[i * n + i] += (1.0 - lambda) * floor);
            }
            Forgetting::Directional => {
                if excitation.strong == n {
                    prior.iter_mut().for_each(|v| *v *= lambda);
                } else if excitation.strong > 0 {
                    self.forget_directions(n, excitation, prior);
                }
            }
        }
    }

    /// With Γ⁻¹ = L Lᵀ and Q the projector on the range of LᵀU the rule reads Λ = λ Γ⁻¹ + (1 − λ) L
    /// (I − Q) Lᵀ: a sum of two positive semidefinite matrices instead of a difference.
    fn forget_directions(&mut self, n: usize, excitation: &Excitation, prior: &mut [f64]) {
        let lambda = self.lambda;
        let lower = &mut self.work[..n * n];
        if !plain_cholesky(n, prior, lower) {
            // cannot happen, because the information is kept positive definite; forgetting all
            // directions is the safe choice
            prior.iter_mut().for_each(|v| *v *= lambda);
            return;
        }
        // rows of `basis`: an orthonormal basis of range(LᵀU) by Gram–Schmidt, twice for
        // orthogonality to rounding
        let mut kept = 0;
        for k in 0..excitation.strong {
            let (done, rest) = self.basis.split_at_mut(kept * n);
            let column = &mut rest[..n];
            for i in 0..n {
                column[i] = (i..n).map(|r| lower[r * n + i] * excitation.direction(r, k)).sum();
            }
            let before = dot(column, column);
            remove(done, column);
            remove(done, column);
            let after = dot(column, column);
            if after > 1e-26 * before {
                let norm = after.sqrt();
                column.iter_mut().for_each(|v| *v /= norm);
                kept += 1;
            }
        }
        // the rows of L (I − Q)
        for row in lower.chunks_exact_mut(n) {
            remove(&self.basis[..kept * n], row);
        }
        for i in 0..n {
            for j in 0..=i {
                let retained = dot(&lower[i * n..(i + 1) * n], &lower[j * n..(j + 1) * n]);
                let v = lambda * prior[i * n + j] + (1.0 - lambda) * retained;
                prior[i * n + j] = v;
                prior[j * n + i] = v;
            }
        }
    }

    /// Γ_m⁻¹ from Λ + S, in place. Returns false and changes nothing if Π⁻¹ is singular to
    /// rounding.
    pub fn posterior(&mut self, n: usize, matrix: &mut [f64]) -> bool {
        if !self.forgetting.is_bounded() {
            return true;
        }
        let forgetting_factor = self.lambda;
        match self.bound {
            Bound::Polynomial => {
                let g = Polynomial { forgetting_factor };
                // (10) with (11)
                g.information(n, self.floor, matrix, &mut self.factor, &mut self.work[..n * n])
            }
            Bound::Rational => {
                let g = Rational { forgetting_factor };
                g.information(n, self.floor, matrix, &mut self.factor, &mut self.work[..n * n])
            }
        }
    }
}

/// x ← x − Σ (qᵀx) q over the orthonormal rows of `basis`.
fn remove(basis: &[f64], x: &mut [f64]) {
    for q in basis.chunks_exact(x.len()) {
        let c = dot(q, x);
        x.iter_mut().zip(q).for_each(|(v, q)| *v -= c * q);
    }
}

/// Lower Cholesky factor of a positive definite matrix, zero above the diagonal; without the column
/// scaling of `linalg.rs`.
fn plain_cholesky(n: usize, a: &[f64], lower: &mut [f64]) -> bool {
    lower.fill(0.0);
    for i in 0..n {
        for j in 0..=i {
            let v = a[i * n + j] - dot(&lower[i * n..i * n + j], &lower[j * n..j * n + j]);
            if i == j {
                if !(v > 0.0) {
                    return false;
                }
                lower[i * n + i] = v.sqrt();
            } else {
                lower[i * n + j] = v / lower[j * n + j];
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::super::linalg::mul;
    use super::*;

    fn rule(forgetting: Forgetting, lambda: f64, floor: f64) -> Rule {
        let mut options = EstimatorOptions::paper(vec![1.0; 3], 1);
        (options.forgetting, options.forgetting_factor, options.information_floor) = (forgetting, lambda, floor);
        Rule::new(&options, 3)
    }

    const INFORMATION: [f64; 9] = [5.0, 1.0, -0.5, 1.0, 3.0, 0.25, -0.5, 0.25, 2.0];

    #[test]
    fn val_directional_is_the_published_formula() {
        // the rule does not depend on the length of x, as long as the direction is strongly excited
        let x = [10.0, -20.0, 5.0];
        let gram: Vec<f64> = (0..9).map(|k| x[k / 3] * x[k % 3]).collect();
        let mut excitation = Excitation::new(3);
        excitation.analyse(&gram, &[1.0; 3], &[true; 3]);
        assert_eq!(excitation.rank, 1);
        let mut prior = [0.0; 9];
        rule(Forgetting::Directional, 0.8, 1e-6).prior(3, &INFORMATION, &excitation, &mut prior);
        // R − (1 − λ) R x (xᵀ R x)⁻¹ xᵀ R for a single regressor x
        let rx: Vec<f64> = (0..3)
            .map(|i| (0..3).map(|j| INFORMATION[i * 3 + j] * x[j]).sum())
            .collect();
        let xrx = dot(&x, &rx);
        for i in 0..3 {
            for j in 0..3 {
                let want = INFORMATION[i * 3 + j] - 0.2 * rx[i] * rx[j] / xrx;
                assert!((prior[i * 3 + j] - want).abs() < 1e-13, "{i} {j}");
            }
        }
    }

    #[test]
    fn val_directional_with_full_excitation_is_exponential_and_with_none_forgets_nothing() {
        let mut excitation = Excitation::new(3);
        let mut prior = [0.0; 9];
        // the smallest eigenvalue is above 1, so all directions are excited; a hundred times the
        // information excites all strongly
        excitation.analyse(&INFORMATION, &[1.0; 3], &[true; 3]);
        assert_eq!((excitation.rank, excitation.strong), (3, 0));
        rule(Forgetting::Directional, 0.8, 1e-6).prior(3, &INFORMATION, &excitation, &mut prior);
        assert_eq!(prior, INFORMATION);
        excitation.analyse(&INFORMATION.map(|v| 100.0 * v), &[1.0; 3], &[true; 3]);
        assert_eq!((excitation.rank, excitation.strong), (3, 3));
        rule(Forgetting::Directional, 0.8, 1e-6).prior(3, &INFORMATION, &excitation, &mut prior);
        assert_eq!(prior.to_vec(), INFORMATION.iter().map(|v| v * 0.8).collect::<Vec<_>>());
        excitation.analyse(&[0.0; 9], &[1.0; 3], &[true; 3]);
        rule(Forgetting::Directional, 0.8, 1e-6).prior(3, &INFORMATION, &excitation, &mut prior);
        assert_eq!(prior, INFORMATION);
    }

    #[test]
    fn val_as_printed_falls_to_lambda_times_one_plus_lambda() {
        // without data the eigenvalue x of εΓ obeys x ← G(x/λ); its fixed point is λ(1 + λ): 1.71,
        // 1.8525, 1.9701
        for lambda in [0.9, 0.95, 0.99] {
            let mut rule = rule(Forgetting::BoundedAsPrinted, lambda, 0.5);
            let excitation = Excitation::new(3);
            let (mut information, mut prior) = (INFORMATION, [0.0; 9]);
            for _ in 0..5000 {
                rule.prior(3, &information, &excitation, &mut prior);
                information = prior;
                assert!(rule.posterior(3, &mut information));
            }
            let mut product = [0.0; 9];
            let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            mul(3, &information, &unit, &mut product);
            for i in 0..3 {
                assert!(
                    (0.5 / product[i * 4] - lambda * (1.0 + lambda)).abs() < 1e-9,
                    "λ {lambda}: {}",
                    0.5 / product[i * 4]
                );
            }
        }
    }

    #[test]
    fn val_bounded_keeps_its_floor_through_a_hundred_thousand_blocks_without_data() {
        for bound in Bound::ALL {
            let mut options = EstimatorOptions::paper(vec![1.0; 3], 1);
            (options.forgetting, options.bound, options.information_floor) = (Forgetting::Bounded, bound, 0.5);
            let mut rule = Rule::new(&options, 3);
            let excitation = Excitation::new(3);
            let mut eigen = Eigen::new(3);
            let (mut information, mut prior) = (INFORMATION, [0.0; 9]);
            for block in 0..100_000 {
                rule.prior(3, &information, &excitation, &mut prior);
                information = prior;
                assert!(rule.posterior(3, &mut information));
                if block % 1000 == 0 || block > 99_990 {
                    eigen.decompose(3, &information);
                    // some ten roundings of numbers near ½
                    assert!(
                        eigen.values.iter().all(|&v| v >= 0.5 * (1.0 - 1e-14)),
                        "block {block}: {:?}",
                        eigen.values
                    );
                }
            }
        }
    }
}
