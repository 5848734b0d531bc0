//! Errors of the sensors that rows of several equations show, counted once.
//!
//! The rows of an equation are whitened by themselves. But if two equations depend on the same
//! positions, as those of coupled masses do, their rows have errors in common, and what the
//! residuals of all of them say of an error is not the sum of what those of each equation say:
//!
//! ```text
//! R_ee = L_e L_eᵀ        R_ee' = C_e C_e'ᵀ + (the noise of a common input)        y_e = L_e⁻¹ f_e
//! (1)  (I + K) z = y     K_ee' = L_e⁻¹ R_ee' L_e'⁻ᵀ for e ≠ e', K_ee = 0
//! (2)  n̂ = −Σ_q Σ_e C_eᵀ L_e⁻ᵀ z_e
//! ```
//!
//! With y in place of z, n − n̂ would be correlated with the residuals by as much as K, and the
//! regressors with it. (1) is solved by conjugate gradients from z = y, which takes a few steps; a
//! singular I + K needs no care, because y has next to nothing in the directions that vanish.

use super::covariance::RowCovariance;
use super::measured::MeasuredBlock;
use crate::estimator::linalg::dot;
use crate::rows::whitening::{Direction, Whitening};

/// Σ_j K_ij² of the mean row below which z is y: the share of the noise's bias that then remains.
const INDEPENDENT: f64 = 0.01;
/// Limit of the residual of (1), relative to y.
const ACCURATE: f64 = 1e-3;
/// Most steps.
const STEPS: usize = 40;

/// Equations that share errors, and room to solve (1).
#[derive(Debug, Clone)]
pub(super) struct SharedErrors {
    is_needed: bool,
    /// Errors of positions and inputs in standard deviations \[joint\]\[sample\].
    q: Vec<Vec<f64>>,
    u: Vec<Vec<f64>>,
    /// Residual of (1), the direction of a step, and (I + K) times it \[equation\]\[row\].
    residual: Vec<Vec<f64>>,
    direction: Vec<Vec<f64>>,
    product: Vec<Vec<f64>>,
    column: Vec<f64>,
}

impl SharedErrors {
    /// Workspace for a block and `rows` rows of each equation.
    pub fn new(block: &MeasuredBlock, rows: usize) -> Self {
        // a single equation shares nothing
        let equations = Some(block.form.equations()).filter(|n| *n > 1).unwrap_or(0);
        let joints = if equations > 0 { block.form.plant.joints() } else { 0 };
        let (samples, columns) = (
            vec![vec![0.0; block.samples.capacity()]; joints],
            vec![vec![0.0; rows]; equations],
        );
        Self {
            is_needed: false,
            q: samples.clone(),
            u: samples,
            residual: columns.clone(),
            direction: columns.clone(),
            product: columns,
            column: vec![0.0; rows],
        }
    }

    /// Finds out whether the equations of a block share errors; R must have been made.
    pub fn compare(&mut self, block: &MeasuredBlock, covariance: &RowCovariance, whitening: &[Whitening]) {
        let (rows, bandwidth) = (block.samples.windows.len(), covariance.bandwidth());
        // some rows that do not overlap
        let some = (0..rows).step_by(2 * (bandwidth + 1));
        let pairs = (0..self.residual.len()).flat_map(|e| (0..e).map(move |other| (e, other)));
        let squares: f64 = pairs
            .flat_map(|pair| some.clone().map(move |i| (pair, i)))
            .map(|((e, other), i)| {
                let beside = i.saturating_sub(bandwidth)..(i + bandwidth + 1).min(rows);
                let square = |j: usize| {
                    let both = whitening[e].variance(i) * whitening[other].variance(j);
                    covariance.shared(block, (e, i), (other, j)).powi(2) / both
                };
                // 0/0 of a row without noise
                beside.map(square).filter(|v| v.is_finite()).sum::<f64>()
            })
            .sum();
        self.is_needed = squares > INDEPENDENT * some.len() as f64;
    }

    /// Replaces y by z (1), after [`compare`](Self::compare).
    pub fn solve(
        &mut self,
        block: &MeasuredBlock,
        covariance: &RowCovariance,
        whitening: &[Whitening],
        y: &mut [Vec<f64>],
    ) {
        if !self.is_needed {
            return;
        }
        let rows = block.samples.windows.len();
        let copy = |from: &[Vec<f64>], to: &mut [Vec<f64>]| {
            to.iter_mut()
                .zip(from)
                .for_each(|(to, from)| to[..rows].copy_from_slice(&from[..rows]));
        };
        let add = |to: &mut [Vec<f64>], factor: f64, from: &[Vec<f64>]| {
            for (to, from) in to.iter_mut().zip(from) {
                let both = to[..rows].iter_mut().zip(&from[..rows]);
                both.for_each(|(to, from)| *to += factor * from);
            }
        };
        let product =
            |a: &[Vec<f64>], b: &[Vec<f64>]| -> f64 { a.iter().zip(b).map(|(a, b)| dot(&a[..rows], &b[..rows])).sum() };
        let limit = ACCURATE * ACCURATE * product(y, y);
        copy(y, &mut self.direction);
        self.multiply(block, covariance, whitening);
        copy(y, &mut self.residual);
        add(&mut self.residual, -1.0, &self.product);
        copy(&self.residual, &mut self.direction);
        let mut square = product(&self.residual, &self.residual);
        for _ in 0..STEPS {
            if !(square > limit) {
                return;
            }
            self.multiply(block, covariance, whitening);
            let curvature = product(&self.direction, &self.product);
            if !(curvature > 0.0) {
                return;
            }
            let step = square / curvature;
            add(y, step, &self.direction);
            add(&mut self.residual, -step, &self.product);
            let before = std::mem::replace(&mut square, product(&self.residual, &self.residual));
            for (direction, residual) in self.direction.iter_mut().zip(&self.residual) {
                let both = direction[..rows].iter_mut().zip(&residual[..rows]);
                both.for_each(|(direction, residual)| *direction = residual + square / before * *direction);
            }
        }
    }

    /// `product` = (I + K) `direction`.
    fn multiply(&mut self, block: &MeasuredBlock, covariance: &RowCovariance, whitening: &[Whitening]) {
        let (rows, len) = (block.samples.windows.len(), block.samples.len);
        let errors = self.q.iter_mut().chain(&mut self.u);
        errors.for_each(|errors| errors[..len].fill(0.0));
        for (e, whitening) in whitening.iter().enumerate() {
            let weighted = &mut self.product[e][..rows];
            weighted.copy_from_slice(&self.direction[e][..rows]);
            whitening.apply_transposed(weighted);
            covariance.add_errors(block, e, weighted, 1.0, &mut self.q);
            covariance.add_input_errors(block, e, weighted, 1.0, &mut self.u);
        }
        let column = &mut self.column[..rows];
        for (e, whitening) in whitening.iter().enumerate() {
            let weighted = &mut self.product[e][..rows];
            // the errors that the other equations show
            covariance.add_errors(block, e, weighted, -1.0, &mut self.q);
            covariance.add_input_errors(block, e, weighted, -1.0, &mut self.u);
            for (row, value) in column.iter_mut().enumerate() {
                *value =
                    covariance.residual(block, e, row, &self.q) + covariance.input_residual(block, e, row, &self.u);
            }
            covariance.add_errors(block, e, weighted, 1.0, &mut self.q);
            covariance.add_input_errors(block, e, weighted, 1.0, &mut self.u);
            whitening.apply(Direction::Forward, column);
            let both = self.direction[e][..rows].iter().zip(&*column);
            weighted
                .iter_mut()
                .zip(both)
                .for_each(|(product, (own, others))| *product = own + others);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::options::ProjectedOptions;
    use super::super::projection::Projection;
    use super::super::sensor_noise::SensorNoise;
    use super::*;
    use crate::estimator::Residuals;
    use crate::model::{Equation, JointSample, Parameter, Plant, Scalar};
    use crate::random::Random;
    use std::sync::Arc;

    const BLOCK: usize = 1000;
    const PERIOD_S: f64 = 1e-3;
    const THETA: [f64; 3] = [2.0, 1.2, 1.0];
    const STD: f64 = 1e-4;

    /// Two masses whose inertias are coupled: u₁ = θ₁ q̈₁ + θ₂ q̈₂, u₂ = θ₂ q̈₁ + θ₃ q̈₂.
    struct Coupled([Parameter; 3], [Equation; 2]);

    impl Plant for Coupled {
        fn name(&self) -> &str {
            "coupled"
        }

        fn joints(&self) -> usize {
            2
        }

        fn input_unit(&self) -> &str {
            "N"
        }

        fn parameters(&self) -> &[Parameter] {
            &self.0
        }

        fn equations(&self) -> &[Equation] {
            &self.1
        }

        fn terms<D: Scalar>(&self, e: usize, _: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
            g[1] = theta[e] * dq[0] + theta[e + 1] * dq[1];
        }
    }

    /// Score Σ φ R⁻¹ f of each parameter at the true θ, in standard deviations, over many blocks in
    /// which the regressors are noise to a good part.
    fn score(count: usize) -> [f64; 3] {
        let parameters = ["m_11", "m_12", "m_22"].map(|name| Parameter::new(name, "kg", "an inertia", 1.0));
        let equations = [
            Equation::new("first", 0, 1.0, 1, 0..2),
            Equation::new("second", 1, 1.0, 1, 1..3),
        ];
        let mut noise = SensorNoise::NONE;
        (noise.position_noise, noise.input_noise) = ([STD; 8], [1e-3; 8]);
        let options = ProjectedOptions {
            noise,
            ..ProjectedOptions::recommended()
        };
        let block = MeasuredBlock::new(Arc::new(Coupled(parameters, equations)), options, BLOCK).unwrap();
        let mut rows = Projection::new(block);
        let mut random = Random(7);
        // amplitude, angular frequency and phase of each joint
        let motion = [[3e-4, 23.0, 0.0], [3e-4, 17.0, 1.0]];
        let (mut sums, mut variances) = ([0.0; 3], [0.0; 3]);
        for k in 0..count * BLOCK {
            let t = k as f64 * PERIOD_S;
            let velocity = |[size, w, phase]: [f64; 3], t: f64| size * w * (w * t + phase).cos();
            // means over the cell, because the input is held
            let ddq = motion.map(|m| (velocity(m, t + PERIOD_S) - velocity(m, t)) / PERIOD_S);
            let mut gauss = |std: f64| std * ((0..12).map(|_| random.uniform()).sum::<f64>() - 6.0);
            let mut sample = JointSample::default();
            for (j, [size, w, phase]) in motion.into_iter().enumerate() {
                sample.q[j] = size * (w * t + phase).sin() + gauss(STD);
                sample.input[j] = THETA[j] * ddq[0] + THETA[j + 1] * ddq[1] + gauss(1e-3);
            }
            assert!(rows.block.push(k as u64 * 1_000_000, &sample));
            if (k + 1) % BLOCK != 0 {
                continue;
            }
            rows.project();
            rows.weigh(&THETA);
            rows.smooth(&THETA);
            for (e, row) in (0..2).flat_map(|e| (0..rows.len()).map(move |row| (e, row))) {
                let mut phi = [0.0; 2];
                let f = rows.row(e, row, &THETA, &mut phi);
                for (i, phi) in phi.into_iter().enumerate() {
                    sums[e + i] += phi * f;
                    variances[e + i] += phi * phi;
                }
            }
            rows.clear();
        }
        std::array::from_fn(|i| sums[i] / variances[i].sqrt())
    }

    #[test]
    fn prop_noise_that_two_equations_share_does_not_bias_their_score() {
        // the variance of the score is up to twice the sum of that of both equations
        let score = score(60);
        assert!(score.iter().all(|score| score.abs() < 4.0 * 2f64.sqrt()), "{score:?}");
    }
}
