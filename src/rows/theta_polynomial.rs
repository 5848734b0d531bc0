//! An equation whose terms are polynomials in θ of degree 2 at most.
//!
//! ```text
//! g_d(q, q̇; θ) = Σ_m μ_m(θ) [Σ_j a_{d,m,j} q̇_j + b_{d,m}(q, q̇)]        μ_m ∈ {1, θ_i, θ_i θ_j}
//! ```

use std::ops::Range;

/// One more than the highest derivative d of a term: linear terms are integrated by parts once
/// more.
pub(super) const MAX_ORDER: usize = 3;

/// μ: 1, θ_i or θ_i θ_j, indices among all parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Monomial {
    One,
    Linear(usize),
    Product(usize, usize),
}

impl Monomial {
    /// Those of degree 2 at most in these parameters.
    pub fn all(parameters: Range<usize>) -> impl Iterator<Item = Self> {
        let end = parameters.end;
        let products = parameters
            .clone()
            .flat_map(move |i| (i..end).map(move |j| Self::Product(i, j)));
        std::iter::once(Self::One)
            .chain(parameters.map(Self::Linear))
            .chain(products)
    }

    #[inline]
    pub fn value(self, theta: &[f64]) -> f64 {
        match self {
            Self::One => 1.0,
            Self::Linear(i) => theta[i],
            Self::Product(i, j) => theta[i] * theta[j],
        }
    }
}

/// a: this much q̇ of a joint, in the d-th derivative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct VelocityTerm {
    pub monomial: usize,
    pub derivative: usize,
    pub joint: usize,
    pub coefficient: f64,
}

/// b: a function of the signals, kept per sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FeatureTerm {
    pub monomial: usize,
    pub derivative: usize,
    /// Index among the features of the whole plant.
    pub feature: usize,
}

/// An equation whose terms are polynomials in θ.
#[derive(Debug, Clone, Default)]
pub(super) struct Polynomial {
    pub monomials: Vec<Monomial>,
    pub velocity: Vec<VelocityTerm>,
    pub features: Vec<FeatureTerm>,
}

impl Polynomial {
    /// Index of a monomial, which is added if it is new.
    pub fn index_of(&mut self, monomial: Monomial) -> usize {
        let known = self.monomials.iter().position(|m| *m == monomial);
        known.unwrap_or_else(|| {
            self.monomials.push(monomial);
            self.monomials.len() - 1
        })
    }
}
