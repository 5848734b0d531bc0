//! The rows of a block: columns linear in the coefficients of θ are computed once, and a row at any
//! θ takes a few products.
//!
//! ```text
//! f_i(θ) = Y_i − Σ_m μ_m(θ) z_im        μ_m ∈ {1, θ_j, θ_j θ_k}
//! Y(ε) = Y₀ + ε Y₁ + ε²/2 Y₂            ε of an input delay that is a parameter, beyond the configured one
//! ```
//!
//! The columns Y and z are whitened in both directions (`whitening.rs`). Equations that are not
//! polynomials in θ are evaluated instead (`evaluation.rs`).

use super::evaluation::{Evaluation, Source};
use super::measured::MeasuredBlock;
use crate::rows::separation::Separation;
use crate::rows::theta_polynomial::{Monomial, Polynomial};
use crate::rows::whitening::{Direction, Whitening};
use std::cell::RefCell;

/// The columns of one equation, each with one value per window.
#[derive(Debug, Clone)]
struct Columns {
    /// Y₀, Y₁, Y₂ times the input's scale; only Y₀ if the delay is not estimated.
    input: Vec<Vec<f64>>,
    /// z: the factors of the monomials.
    factors: Vec<Vec<f64>>,
}

/// The rows.
#[derive(Debug, Clone)]
pub(super) struct WhitenedRows {
    /// As projected \[equation\].
    raw: Vec<Columns>,
    /// As whitened \[direction\]\[equation\].
    white: [Vec<Columns>; 2],
    /// R of each equation, and its factors.
    pub whitening: Vec<Whitening>,
    evaluation: RefCell<Evaluation>,
    /// Measured residuals at the θ of the smoothing \[direction\]\[equation\]\[row\].
    measured: [Vec<Vec<f64>>; 2],
}

impl WhitenedRows {
    /// Workspace for `rows` rows of each equation that correlate over `bandwidth` neighbours.
    pub fn new(block: &MeasuredBlock, rows: usize, bandwidth: usize) -> Self {
        let form = &block.form;
        let column = vec![0.0; rows];
        let raw: Vec<Columns> = (0..form.equations())
            .map(|e| Columns {
                input: vec![column.clone(); if form.delay.is_some() { 3 } else { 1 }],
                factors: vec![column.clone(); form.separation.equations[e].as_ref().map_or(0, |p| p.monomials.len())],
            })
            .collect();
        Self {
            white: [raw.clone(), raw.clone()],
            raw,
            whitening: vec![Whitening::new(rows, bandwidth); form.equations()],
            evaluation: RefCell::new(Evaluation::new(block, rows)),
            measured: std::array::from_fn(|_| vec![column.clone(); form.equations()]),
        }
    }

    /// Sets the input's part of a row as projected: s ∫ψ^(r) u for each r.
    pub fn set_input<const N: usize>(&mut self, e: usize, row: usize, moments: [f64; N]) {
        for (column, moment) in self.raw[e].input.iter_mut().zip(moments) {
            column[row] = moment;
        }
    }

    /// Projects the factors of an equation's monomials from the measured signals.
    pub fn project(&mut self, block: &MeasuredBlock, e: usize) {
        let (windows, signals) = (block.samples.windows.all(), &block.samples.signals);
        block.form.project(e, windows, signals, &mut self.raw[e].factors);
    }

    /// Whitens the projected rows of an equation by its R.
    pub fn whiten(&mut self, e: usize, rows: usize) {
        let raw = &self.raw[e];
        for (direction, white) in Direction::BOTH.into_iter().zip(&mut self.white) {
            let white = &mut white[e];
            let columns = white.input.iter_mut().chain(&mut white.factors);
            let columns = columns.zip(raw.input.iter().chain(&raw.factors)).map(|(white, raw)| {
                white[..rows].copy_from_slice(&raw[..rows]);
                &mut white[..rows]
            });
            self.whitening[e].apply_all(direction, columns);
        }
    }

    /// Drops evaluated values; call this if the signals or their weights have changed.
    pub fn forget(&mut self) {
        self.evaluation.get_mut().forget();
    }

    /// Keeps the measured residuals at θ for [`measured`](Self::measured).
    pub fn keep_residuals(&mut self, source: &Source<'_>, theta: &[f64]) {
        let rows = source.block.samples.windows.len();
        for e in 0..self.raw.len() {
            for direction in Direction::BOTH {
                let mut residuals = std::mem::take(&mut self.measured[direction as usize][e]);
                residuals[..rows].copy_from_slice(&self.white[direction as usize][e].input[0][..rows]);
                self.add_model(source, direction, e, theta, -1.0, &mut residuals[..rows]);
                self.measured[direction as usize][e] = residuals;
            }
        }
    }

    /// The kept residuals of an equation, whitened forwards.
    pub fn measured(&self, e: usize) -> &[f64] {
        &self.measured[Direction::Forward as usize][e]
    }

    /// The same, with the equation's whitening.
    pub fn measured_and_whitening(&mut self, e: usize) -> (&[f64], &mut Whitening) {
        (&self.measured[Direction::Forward as usize][e], &mut self.whitening[e])
    }

    /// Computes the regressors from other signals; [`keep_at`](Self::keep_at) must follow.
    pub fn replace_regressors(&mut self, source: &Source<'_>) {
        self.forget();
        let windows = source.block.samples.windows.all();
        let rows = windows.len();
        for e in 0..self.raw.len() {
            let [forward, backward] = &mut self.white;
            let (forward, backward) = (&mut forward[e].factors, &mut backward[e].factors);
            source.block.form.project(e, windows, source.signals, forward);
            for (forward, backward) in forward.iter().zip(backward.iter_mut()) {
                backward[..rows].copy_from_slice(&forward[..rows]);
            }
            let whitening = &mut self.whitening[e];
            whitening.apply_all(Direction::Forward, forward.iter_mut().map(|column| &mut column[..rows]));
            whitening.apply_all(
                Direction::Backward,
                backward.iter_mut().map(|column| &mut column[..rows]),
            );
        }
    }

    /// The columns of an equation, whitened forwards and backwards, and their whitening.
    pub fn factors(&mut self, e: usize) -> ([&mut [Vec<f64>]; 2], &mut Whitening) {
        let [forward, backward] = &mut self.white;
        (
            [&mut forward[e].factors, &mut backward[e].factors],
            &mut self.whitening[e],
        )
    }

    /// Sets Y so that the residuals at θ are the [kept](Self::keep_residuals) ones.
    pub fn keep_at(&mut self, source: &Source<'_>, theta: &[f64]) {
        let rows = source.block.samples.windows.len();
        for e in 0..self.raw.len() {
            for direction in Direction::BOTH {
                // Y = measured f + the model's part at θ
                let mut input = std::mem::take(&mut self.white[direction as usize][e].input[0]);
                input[..rows].copy_from_slice(&self.measured[direction as usize][e][..rows]);
                self.add_model(source, direction, e, theta, 1.0, &mut input[..rows]);
                self.white[direction as usize][e].input[0] = input;
            }
        }
    }

    /// Adds the model's part of the rows of an equation at θ, times `sign`: Σ μ z minus the
    /// contribution of a further delay to Y₀.
    fn add_model(
        &self,
        source: &Source<'_>,
        direction: Direction,
        e: usize,
        theta: &[f64],
        sign: f64,
        sums: &mut [f64],
    ) {
        let columns = &self.white[direction as usize][e];
        let form = &source.block.form;
        let mut add = |factor: f64, column: &[f64]| {
            for (sum, value) in sums.iter_mut().zip(column) {
                *sum += sign * factor * value;
            }
        };
        if let (Some(delay), [_, y1, y2]) = (form.delay, columns.input.as_slice()) {
            let more = theta[delay] - form.options.input_delay_s;
            add(-more, y1);
            add(-0.5 * more * more, y2);
        }
        match &form.separation.equations[e] {
            Some(Polynomial { monomials, .. }) => {
                for (monomial, factors) in monomials.iter().zip(&columns.factors) {
                    add(monomial.value(theta), factors);
                }
            }
            None => {
                let mut evaluation = self.evaluation.borrow_mut();
                let columns = evaluation.columns(source, &self.whitening, direction, e, theta);
                add(1.0, &columns[0]);
            }
        }
    }

    /// Residual of a row at θ; writes the regressor −∂f/∂θ over the equation's own parameters.
    #[inline]
    pub fn row(
        &self,
        source: &Source<'_>,
        direction: Direction,
        e: usize,
        row: usize,
        theta: &[f64],
        regressor: &mut [f64],
    ) -> f64 {
        let columns = &self.white[direction as usize][e];
        let form = &source.block.form;
        let first = form.plant.equations()[e].parameters.start;
        regressor.fill(0.0);
        let mut f = columns.input[0][row];
        if let (Some(delay), [_, y1, y2]) = (form.delay, columns.input.as_slice()) {
            let more = theta[delay] - form.options.input_delay_s;
            f += more * (y1[row] + 0.5 * more * y2[row]);
            regressor[delay - first] = -(y1[row] + more * y2[row]);
        }
        match &form.separation.equations[e] {
            Some(Polynomial { monomials, .. }) => {
                for (monomial, factors) in monomials.iter().zip(&columns.factors) {
                    let z = factors[row];
                    match *monomial {
                        Monomial::One => f -= z,
                        Monomial::Linear(i) => {
                            f -= z * theta[i];
                            regressor[i - first] += z;
                        }
                        Monomial::Product(i, j) => {
                            f -= z * theta[i] * theta[j];
                            regressor[i - first] += z * theta[j];
                            regressor[j - first] += z * theta[i];
                        }
                    }
                }
            }
            None => {
                let mut evaluation = self.evaluation.borrow_mut();
                let columns = evaluation.columns(source, &self.whitening, direction, e, theta);
                f -= columns[0][row];
                for (slot, column) in columns[1..].iter().enumerate() {
                    regressor[slot] += column[row];
                }
            }
        }
        f
    }

    /// A row with a coefficient for each monomial: writes the factors of those other than 1,
    /// returns the rest.
    pub fn linear_row(&self, separation: &Separation, e: usize, row: usize, factors: &mut [f64]) -> f64 {
        let columns = &self.white[Direction::Forward as usize][e];
        let mut y = columns.input[0][row];
        let mut slots = factors.iter_mut();
        let monomials = separation.equations[e].iter().flat_map(|p| &p.monomials);
        for (monomial, column) in monomials.zip(&columns.factors) {
            match monomial {
                Monomial::One => y -= column[row],
                _ => {
                    if let Some(slot) = slots.next() {
                        *slot = column[row];
                    }
                }
            }
        }
        y
    }
}
