//! Rows at one θ, for equations whose terms are not polynomials in θ.
//!
//! ```text
//! z₀ = Σ_d ∫K_d g_d(q, q̇; θ)        z_p = ∂z₀/∂θ_p, by automatic differentiation        whitened like the rows
//! ```
//!
//! Rows of other equations are products of θ and columns computed once per block (`separation.rs`);
//! these are computed again at each θ.

use super::measured::MeasuredBlock;
use crate::model::{MAX_JOINTS, MAX_PARAMS, Number};
use crate::rows::kernel::dot;
use crate::rows::theta_polynomial::MAX_ORDER;
use crate::rows::trajectory::Trajectory;
use crate::rows::whitening::{Direction, Whitening};
use num_dual::Dual64;

/// The data of the rows.
pub(super) struct Source<'a> {
    pub block: &'a MeasuredBlock,
    /// The block's signals, measured or smoothed.
    pub signals: &'a Trajectory,
}

/// The values at the last θ.
#[derive(Debug, Clone)]
pub(super) struct Evaluation {
    theta: Vec<f64>,
    valid: bool,
    /// \[direction\]\[equation\]\[column\]\[row\]; z₀ first, then z_p.
    columns: [Vec<Vec<Vec<f64>>>; 2],
    /// Scratch: a term and its derivatives in θ over the samples.
    samples: Vec<Vec<f64>>,
}

impl Evaluation {
    /// Workspace for `rows` rows of each equation that is not a polynomial.
    pub fn new(block: &MeasuredBlock, rows: usize) -> Self {
        let form = &block.form;
        let columns_of = |e: usize| match form.separation.equations[e] {
            None => form.own(e) + 1,
            Some(_) => 0,
        };
        let widest = (0..form.equations()).map(columns_of).max().unwrap_or(0);
        let columns: Vec<Vec<Vec<f64>>> = (0..form.equations())
            .map(|e| vec![vec![0.0; rows]; columns_of(e)])
            .collect();
        Self {
            theta: vec![0.0; form.plant.parameters().len()],
            valid: false,
            columns: [columns.clone(), columns],
            samples: vec![vec![0.0; block.samples.capacity()]; widest * (MAX_ORDER + 1)],
        }
    }

    /// Call this if the signals or their weights have changed.
    pub fn forget(&mut self) {
        self.valid = false;
    }

    /// Column of an equation at θ \[row\], of z₀ and the z_p in turn.
    pub fn columns(
        &mut self,
        source: &Source<'_>,
        whitening: &[Whitening],
        direction: Direction,
        equation: usize,
        theta: &[f64],
    ) -> &[Vec<f64>] {
        if !self.valid || self.theta != theta {
            self.theta.copy_from_slice(theta);
            self.valid = true;
            for e in 0..whitening.len() {
                if source.block.form.separation.equations[e].is_none() {
                    self.evaluate(source, e);
                    self.project(source, e, &whitening[e]);
                }
            }
        }
        &self.columns[direction as usize][equation]
    }

    /// Terms of an equation and their derivatives in θ at every sample of a window; if a joint
    /// reverses there, the mean of both directions as in `reversals.rs`.
    fn evaluate(&mut self, source: &Source<'_>, e: usize) {
        let covered = source.block.samples.windows.covered();
        let values = (source.block.form.own(e) + 1) * (source.block.form.plant.equations()[e].order + 1);
        for at in covered.clone() {
            self.samples[..values].iter_mut().for_each(|samples| samples[at] = 0.0);
            self.add(source, e, at, 1.0, None);
        }
        for turn in source.signals.turns.iter().filter(|turn| covered.contains(&turn.at)) {
            self.samples[..values]
                .iter_mut()
                .for_each(|samples| samples[turn.at] = 0.0);
            for (share, velocity) in turn.parts {
                self.add(source, e, turn.at, share, Some((turn.joint, velocity)));
            }
        }
    }

    /// Adds a share of the terms at a sample, with another velocity of one joint if there is one.
    fn add(&mut self, source: &Source<'_>, e: usize, at: usize, share: f64, other: Option<(usize, f64)>) {
        let (plant, signals) = (&*source.block.form.plant, source.signals);
        let form = &plant.equations()[e];
        let (terms, joints) = (form.order + 1, signals.joints());
        let params = self.theta.len();
        let mut theta = [Dual64::from_re(0.0); MAX_PARAMS];
        for (dual, &value) in theta.iter_mut().zip(&self.theta) {
            dual.re = value;
        }
        let mut q = [Dual64::from_re(0.0); MAX_JOINTS];
        let mut dq = [Dual64::from_re(0.0); MAX_JOINTS];
        for j in 0..joints {
            (q[j].re, dq[j].re) = (signals.q[j][at], signals.dq[j][at]);
        }
        if let Some((joint, velocity)) = other {
            dq[joint].re = velocity;
        }
        for (slot, parameter) in form.parameters.clone().enumerate() {
            theta[parameter].eps = 1.0;
            let mut g = [Dual64::from_re(0.0); MAX_ORDER + 1];
            Dual64::terms(plant, e, &q[..joints], &dq[..joints], &theta[..params], &mut g[..terms]);
            theta[parameter].eps = 0.0;
            for d in 0..terms {
                // the value is the same for every parameter
                if slot == 0 {
                    self.samples[d][at] += share * g[d].re;
                }
                self.samples[(slot + 1) * terms + d][at] += share * g[d].eps;
            }
        }
    }

    /// Projects and whitens the evaluated terms.
    fn project(&mut self, source: &Source<'_>, e: usize, whitening: &Whitening) {
        let (form, windows) = (&source.block.form, source.block.samples.windows.all());
        let (kernels, terms) = (&form.kernels, form.plant.equations()[e].order + 1);
        for column in 0..=form.own(e) {
            for (row, window) in windows.iter().enumerate() {
                let span = window.centre - kernels.half..window.centre + kernels.half + 1;
                let samples = &self.samples[column * terms..];
                let sum: f64 = (0..terms)
                    .map(|d| dot(&kernels.position[d], &samples[d][span.clone()]))
                    .sum();
                self.columns.iter_mut().for_each(|c| c[e][column][row] = sum);
            }
            for direction in Direction::BOTH {
                let own = &mut self.columns[direction as usize][e][column];
                whitening.apply(direction, &mut own[..windows.len()]);
            }
        }
    }
}
