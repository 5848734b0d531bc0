//! The steps from a block of samples to its rows: measure, project, whiten, smooth.

use super::column_noise::ColumnNoise;
use super::covariance::RowCovariance;
use super::errors_in_variables::SmoothedSignals;
use super::evaluation::Source;
use super::measured::MeasuredBlock;
use super::regressor_noise::{RegressorNoise, Rows};
use super::reversals;
use super::shared_errors::SharedErrors;
use super::tail::Tail;
use super::whitened_rows::WhitenedRows;
use crate::estimator::Residuals;
use crate::model::MAX_PARAMS;
use crate::rows::standstill::Standstill;
use crate::rows::suspect::Considered;
use crate::rows::suspect_columns::SuspectColumns;
use crate::rows::whitening::Direction;

/// Rows of a block at any θ, with weights computed at one θ.
#[derive(Debug, Clone)]
pub(super) struct Projection {
    pub block: MeasuredBlock,
    pub suspects: SuspectColumns,
    standstill: Standstill,
    covariance: RowCovariance,
    rows: WhitenedRows,
    smoothed: SmoothedSignals,
    shared: SharedErrors,
    regressor_noise: RegressorNoise,
    tail: Tail,
    column_noise: Vec<ColumnNoise>,
    /// θ of the rows' weights.
    theta: Vec<f64>,
}

impl Projection {
    /// Rows for a block.
    pub fn new(block: MeasuredBlock) -> Self {
        let (form, capacity) = (&block.form, block.samples.capacity());
        let considered = form.options.considered;
        let input_delay_s = considered.input_delay_std_s(form.options.sample_period_s);
        let rows = block.samples.windows.capacity();
        let covariance = RowCovariance::new(&block, rows);
        Self {
            suspects: SuspectColumns::new(
                &*form.plant,
                Considered {
                    input_delay_s: Some(input_delay_s),
                    ..considered
                },
                &form.velocity.weights,
                |equation, joint| form.moves(equation, joint),
                |equation, joint| form.depends_on_place(equation, joint),
                rows,
                capacity,
            )
            .with_period(form.options.sample_period_s),
            standstill: Standstill::new(&*form.plant, &form.kernels.position[0], capacity, rows),
            rows: WhitenedRows::new(&block, rows, covariance.bandwidth()),
            smoothed: SmoothedSignals::new(&block, rows),
            shared: SharedErrors::new(&block, rows),
            regressor_noise: RegressorNoise::new(&block, rows),
            tail: Tail::new(&block),
            column_noise: vec![ColumnNoise::new(&block, rows); form.equations()],
            theta: vec![0.0; form.plant.parameters().len()],
            covariance,
            block,
        }
    }

    /// Repairs and projects a complete block.
    pub fn project(&mut self) {
        self.smoothed.forget();
        self.block.sense();
        self.find_rests();
        self.find_reversals();
        self.block.find_jumps();
        let (block, u) = (&self.block, &self.block.samples.signals.u);
        for e in 0..block.form.equations() {
            for (row, window) in block.samples.windows.all().iter().enumerate() {
                match block.form.delay {
                    None => self.rows.set_input(e, row, block.moments::<1>(e, window.centre, u)),
                    Some(_) => self.rows.set_input(e, row, block.moments::<3>(e, window.centre, u)),
                }
            }
            self.rows.project(block, e);
        }
    }

    /// Finds the rows that do not hold because a joint is at rest.
    fn find_rests(&mut self) {
        let (samples, sensors) = (&self.block.samples, &self.block.noise.sensors);
        for (joint, q) in samples.signals.q.iter().enumerate() {
            if !self.standstill.concerns(joint) {
                continue;
            }
            let noise = (sensors.position_resolution[joint], sensors.position_noise[joint]);
            let velocity = self.block.form.velocity.gain * sensors.deviations(joint)[0];
            self.standstill.begin(joint);
            for stretch in samples.repair.stretches(samples.len) {
                self.standstill.find(joint, q, stretch, noise, velocity);
            }
        }
        self.standstill
            .judge(samples.windows.all().iter().map(|window| window.centre));
    }

    /// Splits the samples at which a joint reverses between both directions.
    fn find_reversals(&mut self) {
        let MeasuredBlock {
            form,
            samples,
            noise,
            reversals: errors,
            ..
        } = &mut self.block;
        let std = |joint: usize| noise.sensors.deviations(joint)[0];
        let half = form.velocity.half;
        errors.clear();
        samples.signals.turns.clear();
        for stretch in samples.repair.stretches(samples.len) {
            let known = stretch.start + half..stretch.end.saturating_sub(half);
            reversals::correct(form, &self.standstill, &mut samples.signals, std, known, |reversal| {
                errors.note(form, reversal, std(reversal.joint));
            });
        }
    }

    /// Computes R at θ and whitens the measured rows by it.
    pub fn weigh(&mut self, theta: &[f64]) {
        self.smoothed.forget();
        self.theta.copy_from_slice(theta);
        let rows = self.len();
        for e in 0..self.block.form.equations() {
            let whitening = &mut self.rows.whitening[e];
            self.covariance.make(&self.block, e, theta, whitening);
            self.standstill.exclude(e, rows, whitening);
            whitening.factor();
            self.rows.whiten(e, rows);
        }
        self.rows.forget();
        // the windows at the end use only the configured delay
        if self.block.form.delay.is_none() {
            self.tail.project(&self.block, &self.standstill, theta);
        }
    }

    /// Computes the regressors from smoothed positions. The rows must have been
    /// [weighted](Self::weigh), and their residuals at `theta` must be noise.
    pub fn smooth(&mut self, theta: &[f64]) {
        let block = &self.block;
        let measured = Source {
            block,
            signals: &block.samples.signals,
        };
        self.rows.keep_residuals(&measured, theta);
        self.smoothed
            .estimate(block, &self.covariance, &self.rows.whitening, &mut self.shared, |e| {
                self.rows.measured(e)
            });
        self.smoothed.finish(block, &self.standstill);
        let signals = self.smoothed.or(&block.samples.signals);
        self.rows.replace_regressors(&Source { block, signals });
        self.calibrate(theta);
    }

    /// Keeps the measured positions, because residuals at `theta` are more than noise. The rows
    /// must have been [weighted](Self::weigh).
    pub fn keep_measured(&mut self, theta: &[f64]) {
        self.smoothed.forget();
        let block = &self.block;
        let signals = &block.samples.signals;
        self.rows.keep_residuals(&Source { block, signals }, theta);
        self.calibrate(theta);
    }

    /// Frees the regressors of the noise left in them; the residuals at `theta` stay the kept ones.
    fn calibrate(&mut self, theta: &[f64]) {
        let block = &self.block;
        let signals = self.smoothed.or(&block.samples.signals);
        let mut rows = Rows {
            block,
            covariance: &self.covariance,
            shared: &mut self.shared,
            standstill: &self.standstill,
            signals,
            smoothed: self.smoothed.exist(),
        };
        self.regressor_noise.remove(&mut rows, &mut self.rows);
        self.rows.keep_at(&Source { block, signals }, theta);
    }

    /// Draws the noise in the regressors of the next block in any case.
    pub fn draw_anew(&mut self) {
        self.regressor_noise.forget();
    }

    /// Computes the columns of considered errors, from smoothed signals if they exist. Otherwise
    /// residual and column would share the noise: the sine of a joint that hardly moves would
    /// explain all noise by an eccentricity of 1 rad. `column_noise.rs` removes what smoothing
    /// leaves in the column of a resonance.
    pub fn project_suspects(&mut self) {
        let (block, rows, kernels) = (&self.block, self.block.samples.windows.len(), &self.block.form.kernels);
        let signals = self.smoothed.or(&block.samples.signals);
        let noise = |joint: usize| block.noise.sensors.deviations(joint)[1];
        self.suspects
            .sense(block.samples.len, signals, &block.noise.q_std, noise);
        self.suspects
            .sense_drives(block.samples.len, signals, &*block.form.plant, &self.theta);
        for e in 0..block.form.equations() {
            let scale = block.form.input(e).1;
            for (row, window) in block.samples.windows.all().iter().enumerate() {
                let moments = block.moments(e, window.centre, &signals.u);
                self.suspects.project(e, row, window.centre, scale, kernels, moments);
                self.suspects
                    .project_through_drive(e, row, signals, window.centre, scale, kernels);
                let c = |joint: usize| self.covariance.sensitivity(block, e, row, joint);
                self.suspects.turn(e, row, c);
            }
            if self.smoothed.exist() {
                let noise = &mut self.column_noise[e];
                noise.compare(block, e, &signals.u);
                noise.weigh(block, e, &self.covariance, self.rows.measured_and_whitening(e));
                noise.remove(self.suspects.resonance(e));
            }
            self.suspects.whiten(e, rows, &mut self.rows.whitening[e]);
        }
    }

    /// A whitened row with a coefficient for each monomial: writes the factors of those other than
    /// 1, returns the rest.
    pub fn linear_row(&self, e: usize, row: usize, factors: &mut [f64]) -> f64 {
        self.rows.linear_row(&self.block.form.separation, e, row, factors)
    }

    /// Mean square of the whitened residuals at θ: 1 if they contain only sensor noise.
    pub fn mean_square(&self, theta: &[f64]) -> f64 {
        let mut regressor = [0.0; MAX_PARAMS];
        let (mut sum, mut count) = (0.0, 0usize);
        for e in 0..self.block.form.equations() {
            let regressor = &mut regressor[..self.block.form.own(e)];
            for row in (0..self.len()).filter(|&row| self.is_used(e, row)) {
                let f = self.row_forward(e, row, theta, regressor);
                sum += f * f;
                count += 1;
            }
        }
        sum / count.max(1) as f64
    }

    /// The data of the rows.
    #[inline]
    fn source(&self) -> Source<'_> {
        Source {
            block: &self.block,
            signals: self.smoothed.or(&self.block.samples.signals),
        }
    }

    /// Keeps the samples that the next block's windows need.
    pub fn clear(&mut self) {
        self.block.clear();
        self.rows.forget();
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        self.block.reset();
        self.suspects.reset();
        self.column_noise.iter_mut().for_each(ColumnNoise::reset);
        self.draw_anew();
    }
}

/// The rows without considered errors, which a first fit does not use.
impl Residuals for Projection {
    fn len(&self) -> usize {
        self.block.samples.windows.len()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let backward = Direction::Backward;
        self.rows
            .row(&self.source(), backward, equation, index, theta, regressor)
    }

    fn span(&self, index: usize) -> (u64, u64) {
        let window = &self.block.samples.windows.all()[index];
        (window.start_ns, window.end_ns)
    }

    fn is_used(&self, equation: usize, index: usize) -> bool {
        !self.standstill.is_spoilt(equation, index)
    }

    fn products(&self) -> &[(usize, usize)] {
        &self.block.form.separation.products
    }

    fn tail(&self, equation: usize, k: usize, theta: &[f64]) -> Option<f64> {
        self.tail.residual(&self.block.form.separation, equation, k, theta)
    }

    fn row_forward(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let forward = Direction::Forward;
        self.rows
            .row(&self.source(), forward, equation, index, theta, regressor)
    }
}

#[cfg(test)]
mod tests {
    use super::super::options::ProjectedOptions;
    use super::*;
    use crate::model::{Equation, JointSample, Parameter, Plant, Scalar};
    use std::sync::Arc;

    const BLOCK: usize = 1000;
    const THETA: [f64; 2] = [2.0, 3.0];

    static PARAMETERS: [Parameter; 2] = [
        Parameter::positive("inertia", "kg m^2", "of all that turns", 2.0),
        Parameter::positive("viscous_friction", "N m s/rad", "grows with speed", 3.0),
    ];

    /// J q̈ + F q̇ = u.
    struct Wheel([Equation; 1]);

    impl Plant for Wheel {
        fn name(&self) -> &str {
            "wheel"
        }

        fn joints(&self) -> usize {
            1
        }

        fn input_unit(&self) -> &str {
            "N m"
        }

        fn parameters(&self) -> &[Parameter] {
            &PARAMETERS
        }

        fn equations(&self) -> &[Equation] {
            &self.0
        }

        fn terms<D: Scalar>(&self, _: usize, _: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
            g[0] = theta[1] * dq[0];
            g[1] = theta[0] * dq[0];
        }
    }

    fn wheel() -> Projection {
        let plant = Wheel([Equation::new("wheel", 0, 1.0, 1, 0..2)]);
        let options = ProjectedOptions::recommended();
        Projection::new(MeasuredBlock::new(Arc::new(plant), options, BLOCK).unwrap())
    }

    /// The wheel swings through this many rad, seen through 16 bits; true if nothing was drawn for
    /// the block from `first` on.
    fn skips(wheel: &mut Projection, first: usize, rad: impl Fn(f64) -> f64) -> bool {
        let count = wheel.block.noise.sensors.position_resolution[0];
        for k in first..first + BLOCK {
            let q = |t: f64| rad(t) * ((5.0 * t).sin() + 0.3 * (17.0 * t).sin());
            let (t, h) = (k as f64 * 1e-3, 1e-4);
            let (before, here, after) = (q(t - h), q(t), q(t + h));
            let (dq, ddq) = ((after - before) / (2.0 * h), (after - 2.0 * here + before) / (h * h));
            let mut sample = JointSample::default();
            sample.q[0] = (here / count).round() * count;
            sample.input[0] = THETA[0] * ddq + THETA[1] * dq;
            assert!(wheel.block.push(k as u64 * 1_000_000, &sample));
        }
        wheel.project();
        wheel.weigh(&THETA);
        wheel.smooth(&THETA);
        let skipped = wheel.regressor_noise.was_skipped(&wheel.block);
        wheel.clear();
        skipped
    }

    #[test]
    fn prop_noise_in_the_regressors_of_ordinary_motion_is_drawn_once_in_some_blocks() {
        let mut wheel = wheel();
        let mut drawn = (0..40).map(|block| !skips(&mut wheel, block * BLOCK, |_| 1.0));
        assert_eq!(drawn.next(), Some(true));
        // every twelfth block or so: the windows of the first begin later in it
        assert_eq!(drawn.filter(|drawn| *drawn).count(), 3);
    }

    #[test]
    fn prop_noise_in_the_regressors_of_hardly_any_motion_is_drawn_in_every_block() {
        let mut wheel = wheel();
        // a swing of two counts from the fifth second on, after a second in which it fades
        let rad = |t: f64| 2e-4 + (1.0 - 2e-4) * (0.5 * (1.0 + (std::f64::consts::PI * (t - 4.0)).cos()));
        let rad = |t: f64| rad(t.clamp(4.0, 5.0));
        let skipped: Vec<bool> = (0..9).map(|block| skips(&mut wheel, block * BLOCK, rad)).collect();
        assert_eq!(skipped[..4], [false, true, true, true]);
        assert!(skipped[6..].iter().all(|skipped| !skipped), "{skipped:?}");
    }

    #[test]
    fn prop_noise_in_the_regressors_is_drawn_after_a_gap_and_after_a_reset() {
        let mut wheel = wheel();
        let skips_from = |wheel: &mut Projection, first: usize| skips(wheel, first, |_| 1.0);
        assert!(!skips_from(&mut wheel, 0) && skips_from(&mut wheel, BLOCK));
        assert!(!skips_from(&mut wheel, 20 * BLOCK) && skips_from(&mut wheel, 21 * BLOCK));
        wheel.reset();
        assert!(!skips_from(&mut wheel, 22 * BLOCK));
    }
}
