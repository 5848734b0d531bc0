//! Coordinates in which what is known of a product of parameters stays valid while θ̂ moves.
//!
//! ```text
//! θ_b occurs only in products, with θ_a and θ_c. The terms of θ_a are larger. r = θ_a/θ̄_a.
//!
//! d_b(θ) = r (θ_b − θ̄_b)                so θ̄_a d_b + θ̄_b d_a = θ_a θ_b − θ̄_a θ̄_b
//! d_c(θ) = θ_c/r − θ̄_c + θ̄_c (r − 1)    so d_c/θ̄_a − θ̄_c d_a/θ̄_a² = θ_c/θ_a − θ̄_c/θ̄_a
//! d_i(θ) = θ_i − θ̄_i                    all others                                            (a)
//! T = ∂d/∂θ, which is I at θ̄:  T_bb = r,    T_ba = (θ_b − θ̄_b)/θ̄_a
//!                              T_cc = 1/r,  T_ca = (θ̄_c − θ_c/r²)/θ̄_a                          (b)
//! J = Σ w f² + dᵀ Λ d                   the cost of a fit, with the prior in d                 (c)
//! Λ ← Tᵀ Λ T,  P ← T⁻¹ P T⁻ᵀ,  T_s ← T⁻¹ T_s      from θ̄ to θ; T_s: sensitivities of considered.rs (d)
//! ```
//!
//! The arm's rows show θ₇θ₉ far better than θ₇ alone. They leave a curve open: θ₇θ₉ = const and
//! θ₆/θ₇ = const. If θ̂ moves along this curve by a share δ, its tangent turns by δ. If each block
//! added its information in θ itself, the tangents would differ from block to block, and the sum
//! would seem to determine the place on the curve: the standard deviation of θ₉ would fall to that
//! of the product divided by δ, without any evidence. EKF-SLAM has the same fault (S. J. Julier and
//! J. K. Uhlmann, A counter example to the theory of simultaneous localization and map building,
//! ICRA 2001). In d the curve is a straight line. θ_a keeps its own coordinate, because the terms
//! without θ_b are linear in it.
//!
//! Noise may send a fit along the whole curve, to θ_a = 0 and θ_b = ∞, and no later block brings it
//! back. If θ_a is not yet known to within half its size, the fit therefore holds it within a
//! factor of ten of its start value. Inside this range nothing attracts it:
//!
//! ```text
//! J ← J + σ² (l/ln 2)²,  l = the part of ln(θ_a/s_a) beyond ± ln 10,  s_a: size of the start value (e)
//! ```
//!
//! Nothing is turned if θ_a changes its sign, or changes by more than a factor of 10⁴. If a block
//! takes a single step, as in the paper, T = I.

use super::Residuals;
use std::f64::consts::{LN_2, LN_10};

/// Largest factor by which θ_a may differ from θ̄_a.
const FAR: f64 = 1e4;

/// What a curved coordinate is: b or c of (a).
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Product,
    Ratio,
}

/// A curved coordinate.
#[derive(Debug, Clone, Copy)]
struct Curved {
    kind: Kind,
    /// Its index, b or c, and that of its partner a.
    index: usize,
    partner: usize,
    /// Its row of T at the last [`turn`](Curvature::turn): on the diagonal, and at the partner.
    scale: f64,
    lean: f64,
}

impl Curved {
    fn new(kind: Kind, index: usize, partner: usize) -> Self {
        Self {
            kind,
            index,
            partner,
            scale: 1.0,
            lean: 0.0,
        }
    }

    /// r, if it is one to turn by.
    fn ratio(&self, theta: &[f64], centre: &[f64]) -> Option<f64> {
        let ratio = theta[self.partner] / centre[self.partner];
        (1.0 / FAR..FAR).contains(&ratio).then_some(ratio)
    }
}

/// A parameter that (e) holds around its start value.
#[derive(Debug, Clone, Copy)]
struct Held {
    index: usize,
    size: f64,
    /// σ²/(ln 2)².
    weight: f64,
}

impl Held {
    /// l of (e).
    fn beyond(&self, theta: &[f64]) -> Option<f64> {
        let ratio = theta[self.index] / self.size;
        let log = if ratio > 0.0 { ratio.ln() } else { return None };
        let beyond = log - log.clamp(-LN_10, LN_10);
        (beyond != 0.0).then_some(beyond)
    }
}

/// The curved coordinates of a group, and T.
#[derive(Debug, Clone)]
pub struct Curvature {
    curved: Vec<Curved>,
    held: Vec<Held>,
    size: usize,
}

impl Curvature {
    /// None of n parameters.
    pub fn new(n: usize) -> Self {
        Self {
            curved: Vec::with_capacity(n),
            held: Vec::with_capacity(n),
            size: n,
        }
    }

    /// Forgets all products: T = I.
    pub fn clear(&mut self) {
        self.curved.clear();
        self.held.clear();
    }

    /// Adopts the products of the rows among the parameters from `first` on. `weight`(i) is the sum
    /// of the squares of a parameter's terms, and 0 if it is fixed. The partner of a factor is the
    /// parameter with the largest weight.
    pub fn adopt(&mut self, rows: &dyn Residuals, first: usize, weight: impl Fn(usize) -> f64) {
        self.clear();
        let size = self.size;
        let inside = |i: usize| i.checked_sub(first).filter(|&i| i < size && weight(i) > 0.0);
        let pairs = || {
            rows.products()
                .iter()
                .filter_map(|&(b, a)| Some((inside(b)?, inside(a)?)))
        };
        for (index, partner) in pairs() {
            match self.curved.iter_mut().find(|curved| curved.index == index) {
                Some(known) if weight(partner) > weight(known.partner) => known.partner = partner,
                Some(_) => {}
                None => self.curved.push(Curved::new(Kind::Product, index, partner)),
            }
        }
        for (factor, index) in pairs() {
            let is = |i: usize, curved: &Curved| curved.index == i || curved.partner == i;
            let Some(main) = self.curved.iter().find(|curved| curved.index == factor) else {
                continue;
            };
            if !self.curved.iter().any(|curved| is(index, curved)) {
                self.curved.push(Curved::new(Kind::Ratio, index, main.partner));
            }
        }
    }

    /// Holds each partner for which `open`(i) gives the size s_a; `variance` is σ².
    pub fn hold(&mut self, variance: f64, open: impl Fn(usize) -> Option<f64>) {
        for curved in &self.curved {
            let index = curved.partner;
            if self.held.iter().all(|held| held.index != index) {
                let weight = variance / (LN_2 * LN_2);
                self.held.extend(open(index).map(|size| Held { index, size, weight }));
            }
        }
    }

    /// The added cost of (e) at `theta`, of this group's parameters.
    pub fn holding_cost(&self, theta: &[f64]) -> f64 {
        let cost = |held: &Held| held.beyond(theta).map_or(0.0, |beyond| held.weight * beyond * beyond);
        self.held.iter().map(cost).sum()
    }

    /// Adds −½ of its slope, and ½ of its curvature to first order, n × n.
    pub fn add_holding(&self, theta: &[f64], information: &mut [f64], slope: &mut [f64]) {
        for held in &self.held {
            if let Some(beyond) = held.beyond(theta) {
                let value = theta[held.index];
                slope[held.index] -= held.weight * beyond / value;
                information[held.index * (self.size + 1)] += held.weight / (value * value);
            }
        }
    }

    /// True if T is always I.
    pub fn is_flat(&self) -> bool {
        self.curved.is_empty()
    }

    /// True if parameter i is b of a product.
    pub fn is_factor(&self, i: usize) -> bool {
        self.curved
            .iter()
            .any(|curved| curved.index == i && curved.kind == Kind::Product)
    }

    /// Computes T at `theta` (b).
    pub fn turn(&mut self, theta: &[f64], centre: &[f64]) {
        for curved in &mut self.curved {
            let (index, base) = (curved.index, centre[curved.partner]);
            (curved.scale, curved.lean) = match (curved.ratio(theta, centre), curved.kind) {
                (None, _) => (1.0, 0.0),
                (Some(r), Kind::Product) => (r, (theta[index] - centre[index]) / base),
                (Some(r), Kind::Ratio) => (1.0 / r, (centre[index] - theta[index] / (r * r)) / base),
            };
        }
    }

    /// d_i of (a).
    pub fn displacement(&self, i: usize, theta: &[f64], centre: &[f64]) -> f64 {
        let curved = self.curved.iter().find(|curved| curved.index == i);
        match curved.and_then(|curved| Some((curved.ratio(theta, centre)?, curved.kind))) {
            None => theta[i] - centre[i],
            Some((r, Kind::Product)) => r * (theta[i] - centre[i]),
            Some((r, Kind::Ratio)) => theta[i] / r + centre[i] * (r - 2.0),
        }
    }

    /// How far `theta` is from `centre`, in the coordinates around `theta`; after
    /// [`turn`](Self::turn).
    pub fn moved(&self, theta: &[f64], centre: &[f64], moved: &mut [f64]) {
        for (i, moved) in moved.iter_mut().enumerate() {
            *moved = self.displacement(i, theta, centre);
        }
        self.turn_change(moved);
    }

    /// Moves `theta` by a step in the coordinates around `from`, within its bounds.
    pub fn step(
        &self,
        from: &[f64],
        step: impl Fn(usize) -> f64,
        clamp: impl Fn(usize, f64) -> f64,
        theta: &mut [f64],
    ) {
        for (i, theta) in theta.iter_mut().enumerate() {
            *theta = clamp(i, from[i] + step(i));
        }
        for curved in &self.curved {
            let index = curved.index;
            let moved = match (curved.ratio(theta, from), curved.kind) {
                (None, _) => continue,
                (Some(r), Kind::Product) => from[index] + step(index) / r,
                (Some(r), Kind::Ratio) => r * (step(index) - from[index] * (r - 2.0)),
            };
            theta[index] = clamp(index, moved);
        }
    }

    /// Λ ← Tᵀ Λ T.
    pub fn turn_information(&self, information: &mut [f64]) {
        for curved in &self.curved {
            self.combine(information, curved, curved.lean, curved.scale);
        }
    }

    /// A at θ, referred to θ̄: A ← T⁻ᵀ A T⁻¹.
    pub fn turn_information_back(&self, information: &mut [f64]) {
        for curved in &self.curved {
            self.combine(information, curved, -curved.lean / curved.scale, 1.0 / curved.scale);
        }
    }

    /// The slope of a function of d as one of θ: g ← Tᵀ g.
    pub fn turn_slope(&self, slope: &mut [f64]) {
        for curved in &self.curved {
            slope[curved.partner] += curved.lean * slope[curved.index];
            slope[curved.index] *= curved.scale;
        }
    }

    /// The reverse: g ← T⁻ᵀ g.
    pub fn turn_slope_back(&self, slope: &mut [f64]) {
        for curved in &self.curved {
            slope[curved.index] /= curved.scale;
            slope[curved.partner] -= curved.lean * slope[curved.index];
        }
    }

    /// A small change of d as one of θ: x ← T⁻¹ x.
    pub fn turn_change(&self, change: &mut [f64]) {
        for curved in &self.curved {
            change[curved.index] = (change[curved.index] - curved.lean * change[curved.partner]) / curved.scale;
        }
    }

    /// P ← T⁻¹ P T⁻ᵀ.
    pub fn turn_covariance(&self, covariance: &mut [f64]) {
        let n = self.size;
        for curved in &self.curved {
            let (a, b) = (curved.partner, curved.index);
            for k in 0..n {
                covariance[k * n + b] = (covariance[k * n + b] - curved.lean * covariance[k * n + a]) / curved.scale;
            }
            let variance = covariance[b * n + b] - curved.lean * covariance[a * n + b];
            covariance[b * n + b] = variance / curved.scale;
            self.mirror(covariance, b);
        }
    }

    /// Tᵀ M T for a T with `lean` and `scale` in row b.
    fn combine(&self, matrix: &mut [f64], curved: &Curved, lean: f64, scale: f64) {
        let (n, a, b) = (self.size, curved.partner, curved.index);
        for k in 0..n {
            matrix[k * n + a] += lean * matrix[k * n + b];
            matrix[k * n + b] *= scale;
        }
        matrix[a * n + a] += lean * matrix[b * n + a];
        matrix[a * n + b] += lean * matrix[b * n + b];
        matrix[b * n + b] *= scale;
        self.mirror(matrix, b);
        self.mirror(matrix, a);
    }

    /// Makes row i equal to column i, so that the matrix is symmetric to the last bit.
    fn mirror(&self, matrix: &mut [f64], i: usize) {
        let n = self.size;
        (0..n).for_each(|k| matrix[i * n + k] = matrix[k * n + i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// θ₀ alone and times θ₂, θ₁ alone and times θ₂; θ₃ alone.
    struct Rows;

    impl Residuals for Rows {
        fn len(&self) -> usize {
            0
        }
        fn row(&self, _: usize, _: usize, _: &[f64], _: &mut [f64]) -> f64 {
            0.0
        }
        fn products(&self) -> &[(usize, usize)] {
            &[(2, 0), (2, 1)]
        }
    }

    const CENTRE: [f64; 4] = [0.1, 0.5, 2.0, -1.0];
    const THETA: [f64; 4] = [0.3, -0.4, 0.5, 3.0];

    fn curvature() -> Curvature {
        let mut curvature = Curvature::new(4);
        // θ₀ has the larger terms, so θ₂ goes with it
        curvature.adopt(&Rows, 0, |i| if i == 0 { 2.0 } else { 1.0 });
        curvature.turn(&THETA, &CENTRE);
        curvature
    }

    #[test]
    fn prop_products_and_ratios_are_linear_in_the_coordinates() {
        let curvature = curvature();
        let d: Vec<f64> = (0..4).map(|i| curvature.displacement(i, &THETA, &CENTRE)).collect();
        let product = CENTRE[0] * d[2] + CENTRE[2] * d[0];
        // all values have a size of 1 to 10: a few rounding units
        assert!((product - (THETA[0] * THETA[2] - CENTRE[0] * CENTRE[2])).abs() < 1e-15);
        let ratio = (d[1] - CENTRE[1] / CENTRE[0] * d[0]) / CENTRE[0];
        assert!((ratio - (THETA[1] / THETA[0] - CENTRE[1] / CENTRE[0])).abs() < 1e-14);
        assert_eq!((d[0], d[3]), (THETA[0] - CENTRE[0], 4.0));
        // a step by d leads there, and from there the way back is as long
        let mut reached = CENTRE;
        curvature.step(&CENTRE, |i| d[i], |_, value| value, &mut reached);
        assert!(
            reached.iter().zip(THETA).all(|(a, b)| (a - b).abs() < 1e-14),
            "{reached:?}"
        );
        let mut moved = [0.0; 4];
        curvature.moved(&THETA, &CENTRE, &mut moved);
        for (i, moved) in moved.iter().enumerate() {
            assert!(
                (moved + curvature.displacement(i, &CENTRE, &THETA)).abs() < 1e-14,
                "{i}"
            );
        }
    }

    #[test]
    fn val_information_covariance_and_slope_turn_by_the_derivative_of_the_coordinates() {
        let curvature = curvature();
        // T by differences: the coordinates are rational functions of size 1
        let t = |i: usize, j: usize| {
            let at = |by: f64| {
                let mut theta = THETA;
                theta[j] += by;
                curvature.displacement(i, &theta, &CENTRE)
            };
            (at(1e-6) - at(-1e-6)) / 2e-6
        };
        let information = [
            4.0, 1.0, 0.5, 0.2, 1.0, 3.0, -0.3, 0.1, 0.5, -0.3, 2.0, 0.4, 0.2, 0.1, 0.4, 1.0,
        ];
        let mut turned = information;
        curvature.turn_information(&mut turned);
        let mut covariance = information;
        curvature.turn_covariance(&mut covariance);
        for i in 0..4 {
            for j in 0..4 {
                let forth = |m: &[f64; 16]| {
                    let pairs = (0..4).flat_map(|k| (0..4).map(move |l| (k, l)));
                    pairs.map(|(k, l)| t(k, i) * m[k * 4 + l] * t(l, j)).sum::<f64>()
                };
                let back = |m: &[f64; 16]| {
                    let pairs = (0..4).flat_map(|k| (0..4).map(move |l| (k, l)));
                    pairs.map(|(k, l)| t(i, k) * m[k * 4 + l] * t(j, l)).sum::<f64>()
                };
                // differences over 2e-6 lose ten of sixteen digits, and the entries of T reach 15
                assert!((turned[i * 4 + j] - forth(&information)).abs() < 1e-7, "{i} {j}");
                assert!((back(&covariance) - information[i * 4 + j]).abs() < 1e-7, "{i} {j}");
                assert_eq!(turned[i * 4 + j], turned[j * 4 + i]);
                assert_eq!(covariance[i * 4 + j], covariance[j * 4 + i]);
            }
        }
        curvature.turn_information_back(&mut turned);
        assert!(turned.iter().zip(information).all(|(a, b)| (a - b).abs() < 1e-12));
        let mut slope = [1.0, -2.0, 3.0, 0.5];
        curvature.turn_slope(&mut slope);
        curvature.turn_slope_back(&mut slope);
        assert!(
            slope
                .iter()
                .zip([1.0, -2.0, 3.0, 0.5])
                .all(|(a, b)| (a - b).abs() < 1e-12)
        );
    }

    #[test]
    fn fault_a_change_of_sign_turns_nothing() {
        let mut curvature = curvature();
        let across = [-0.3, 0.4, 0.5, 3.0];
        curvature.turn(&across, &CENTRE);
        let mut information = [1.0; 16];
        curvature.turn_information(&mut information);
        assert_eq!(information, [1.0; 16]);
        assert_eq!(curvature.displacement(2, &across, &CENTRE), -1.5);
    }

    #[test]
    fn prop_a_parameter_is_held_outside_a_factor_of_ten_only() {
        let mut curvature = curvature();
        curvature.hold(1.0, |i| (i == 0).then_some(0.1));
        for (theta, held) in [(0.011, false), (0.9, false), (0.009, true), (1.1, true), (-0.1, false)] {
            let mut at = THETA;
            at[0] = theta;
            let (mut information, mut slope) = ([0.0; 16], [0.0; 4]);
            curvature.add_holding(&at, &mut information, &mut slope);
            assert_eq!(curvature.holding_cost(&at) > 0.0, held, "{theta}");
            assert_eq!(slope[0] != 0.0 && information[0] > 0.0, held, "{theta}");
        }
    }
}
