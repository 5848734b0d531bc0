//! Projected rows, the weak form: positions and inputs are measured, nothing else.
//!
//! ```text
//! f_i(θ) = s ∫ ψ_i u dt − Σ_d (−1)^d ∫ ψ_i^(d) g_d(q, q̇; θ) dt        one row per equation and window i
//! ```
//!
//! with ψ a smooth bump on a window of length T (`kernel.rs`). Integration by parts has moved every time derivative from the signals to ψ,
//! which is known exactly. Terms that are a constant times a velocity are integrated by parts once more and need the position only; the velocity
//! inside nonlinear terms comes from a zero-phase Savitzky-Golay filter. ∫ψ = 1, so a residual is a weighted mean over the window, in the
//! equation's unit, before it is whitened.
//!
//! Windows lie on a grid of sample numbers and reach back over the border of a block. Time stamps off that grid are resampled (`intake.rs`), single
//! wrong and a few lost samples made good (`repair.rs`), windows over a longer hole dropped, and rows over a standstill left out of equations that
//! do not hold there (`standstill.rs`).
//!
//! # Noise
//! Row i depends on position k by c_i(k) = ∂f_i/∂q_k and on input k by s w_i(k), so the noise of rows i and j has the covariance
//!
//! ```text
//! R_ij = Σ_k c_i(k) c_j(k) σ_q² v_k + s² σ_u² Σ_k w_i(k) w_j(k) + jumps        σ_q² = σ² + LSB²/12 · v_k
//! ```
//!
//! v_k ≥ 1 says how far the rounding is from white (`rounding.rs`): white while the joint crosses counts, next to constant from sample to sample
//! while it creeps; its errors then add up over many windows, which no weight of a single one can tell. c follows from automatic differentiation at θ̂
//! before the block. The rows are whitened by R (`whitening.rs`), so that their residuals have variance 1 and the deviations of θ̂ follow without a factor.
//!
//! # Errors in variables
//! The regressors are made of the same noisy positions as the residuals, so that the two are correlated and least squares is biased: 10 % in θ₆ for
//! smooth motion through 16 bits. What the residuals show of the errors is therefore taken out of the positions before regressors are made of them:
//!
//! ```text
//! n̂ = E[n | f] = −Σ_q Cᵀ R⁻¹ f(θ̄)        q̂ = q − n̂        φ = −∂f/∂θ at q̂
//! f(θ) ← f_q(θ̄) + f_q̂(θ) − f_q̂(θ̄)       the measured residual at θ̄, and consistent with φ around it
//! ```
//!
//! C holds the c_i, θ̄ is θ̂ before the block. By the projection theorem n − n̂ is not correlated with f, and so φ at the true θ is not either: these
//! are the normal equations of maximum likelihood with the errors as unknowns (the Gauss-Helmert model; structured total least squares). Sources: F. R. Helmert,
//! Die Ausgleichungsrechnung nach der Methode der kleinsten Quadrate, 2nd ed., 1907; P. Lemmerling, B. De Moor, Misfit versus latency, Automatica 37
//! (2001). A block that θ̄ does not explain is fitted alone first; if that leaves more than noise, too, its rows stay as they are measured.
//!
//! Before the first estimate θ is not known well enough for R: the first blocks are fitted once with the R known so far, then R is made anew, until every
//! parameter is known to a half. What is not yet keeps its start value in R: a joint that has not moved may have any inertia, but not any noise.

use super::error_weights::{ErrorWeights, linear_in_velocity, nonlinear};
use super::intake::{BRIDGED, GridSample, Intake};
use super::kernel::{InputTiming, Kernels, dot};
use super::noise::SignalNoise;
use super::repair::{Kind, Repair};
use super::rounding;
use super::separation::{MAX_ORDER, Monomial, Polynomial, Separation, partials};
use super::smoothing::savitzky_golay;
use super::standstill::Standstill;
use super::start::StartFinder;
use super::suspects::{Considered, Signals, Suspect, SuspectColumns};
use super::tail::{Ending, Tail};
use super::whitening::{Direction, Whitening};
use super::{SampleBlock, structure};
use crate::estimator::{BlockEstimator, EstimatorOptions, Residuals};
use crate::model::{JointSample, MAX_JOINTS, MAX_PARAMS, Plant};
use num_dual::Dual64;
use std::cell::RefCell;

/// Blocks that are fitted for their weights at most, and the relative deviation from which on a parameter serves for them.
const FIRST_BLOCKS: u32 = 10;
const KNOWN: f64 = 0.5;
/// Mean square of whitened residuals from which on they hold more than noise.
const FAR: f64 = 2.0;
/// Standard deviations from which on an acceleration is one.
const SURE: f64 = 3.0;
/// Largest error of a position that a residual may show, in its standard deviations.
const LARGEST_ERROR: f64 = 3.0;
/// Samples after a step of the setpoint in which a jump of the input is due to it.
const ANSWER: usize = 5;
/// Share of the input's size that counts as noise of signals that are exact.
const EXACT: f64 = 1e-7;

/// What the sensors do to the signals; the weights of the rows follow from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorNoise {
    /// Size of one count of each joint's encoder \[rad or m\], ≥ 0; 0 where the position is not quantised.
    pub position_resolution: [f64; MAX_JOINTS],
    /// Standard deviation of white noise on each measured position \[rad or m\], ≥ 0.
    pub position_noise: [f64; MAX_JOINTS],
    /// Standard deviation of white noise on each measured input, in the input's unit, ≥ 0.
    pub input_noise: [f64; MAX_JOINTS],
    /// Size of one count of each measured input, in the input's unit, ≥ 0; 0 where the input is not rounded.
    pub input_resolution: [f64; MAX_JOINTS],
}

impl SensorNoise {
    /// Exact signals.
    pub const NONE: Self = Self {
        position_resolution: [0.0; MAX_JOINTS],
        position_noise: [0.0; MAX_JOINTS],
        input_noise: [0.0; MAX_JOINTS],
        input_resolution: [0.0; MAX_JOINTS],
    };

    /// The same encoder of `bits` (2^bits counts per turn) and the same input noise on every joint.
    pub fn encoder(bits: u32, input_noise: f64) -> Self {
        Self {
            position_resolution: [std::f64::consts::TAU / f64::from(bits).exp2(); MAX_JOINTS],
            position_noise: [0.0; MAX_JOINTS],
            input_noise: [input_noise; MAX_JOINTS],
            ..Self::NONE
        }
    }

    /// Standard deviations of a joint's position and input, with their rounding taken for white.
    fn deviations(&self, joint: usize) -> [f64; 2] {
        let with = |noise: f64, count: f64| noise.hypot(count / 12f64.sqrt());
        [
            with(self.position_noise[joint], self.position_resolution[joint]),
            with(self.input_noise[joint], self.input_resolution[joint]),
        ]
    }
}

/// How samples become projected rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectedOptions {
    /// h \[s\], 1e-6 to 1.
    pub sample_period_s: f64,
    /// T \[s\], 8 to 2000 sample periods; rounded to an even number of them. Long windows average more noise, short ones resolve faster motion:
    /// about 1.3 periods of the fastest mode that matters are a good length.
    pub window_s: f64,
    /// Time from a window to the next \[s\], one sample period to T; rounded to whole periods. T/5 loses little, see docs/method.md.
    pub stride_s: f64,
    /// Samples on either side that the velocity filter (order 5) uses, 3 to 100. 10 for encoders of 16 bits, 5 from 20 bits on.
    pub velocity_half_width: usize,
    /// What the input does between samples.
    pub timing: InputTiming,
    /// The recorded input acts on the plant this much later \[s\], at most half of T either way; negative for an input that was recorded late.
    pub input_delay_s: f64,
    /// What the sensors do.
    pub noise: SensorNoise,
    /// Learn the noise levels from the signals instead (`noise.rs`), block by block; `noise` is then not used.
    pub learn_noise: bool,
    /// What the model does not say and σ must allow for.
    pub considered: Considered,
}

impl ProjectedOptions {
    /// Windows of 100 ms every 20 ms at 1 kHz: right for modes up to some 15 Hz, through 16-bit encoders and 0.05 of input noise.
    pub fn recommended() -> Self {
        Self {
            sample_period_s: 1e-3,
            window_s: 0.1,
            stride_s: 0.02,
            velocity_half_width: 10,
            timing: InputTiming::Held,
            input_delay_s: 0.0,
            noise: SensorNoise::encoder(16, 0.05),
            learn_noise: false,
            considered: Considered::default(),
        }
    }

    fn half(&self) -> usize {
        (0.5 * self.window_s / self.sample_period_s).round() as usize
    }

    fn stride(&self) -> usize {
        (self.stride_s / self.sample_period_s).round() as usize
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value outside.
    pub fn validate(&self) -> Result<(), ProjectedError> {
        let check = |field, expected, got: f64, good: bool| {
            if good {
                Ok(())
            } else {
                Err(ProjectedError::Value { field, expected, got })
            }
        };
        let within = |x: f64, low: f64, high: f64| x >= low && x <= high;
        let (h, t) = (self.sample_period_s, self.window_s);
        check("sample_period_s", "1e-6 to 1", h, within(h, 1e-6, 1.0))?;
        check(
            "window_s",
            "8 to 2000 sample periods",
            t,
            within(t / h, 7.999, 2000.001),
        )?;
        check(
            "stride_s",
            "one sample period to window_s",
            self.stride_s,
            within(self.stride_s / h, 0.999, t / h + 0.001),
        )?;
        let half_width = self.velocity_half_width;
        check(
            "velocity_half_width",
            "3 to 100",
            half_width as f64,
            (3..=100).contains(&half_width),
        )?;
        check(
            "input_delay_s",
            "at most half of window_s either way",
            self.input_delay_s,
            within(self.input_delay_s.abs(), 0.0, 0.5 * t),
        )?;
        let all = self
            .noise
            .position_resolution
            .iter()
            .map(|v| ("position_resolution", v))
            .chain(self.noise.position_noise.iter().map(|v| ("position_noise", v)))
            .chain(self.noise.input_noise.iter().map(|v| ("input_noise", v)))
            .chain(self.noise.input_resolution.iter().map(|v| ("input_resolution", v)));
        let considered = self.considered;
        let suspects = [
            ("considered.input_delay_s", considered.input_delay_s),
            ("considered.gain", considered.gain),
            ("considered.coulomb", considered.coulomb),
            ("considered.resonance_hz", considered.resonance_hz),
            ("considered.drift_per_s", considered.drift_per_s),
            ("considered.zero_rad", considered.zero_rad),
            (
                "considered.eccentricity_rad",
                considered.eccentricity_rad.unwrap_or(0.0),
            ),
        ];
        let all = all.chain(suspects.iter().map(|(field, value)| (*field, value)));
        for (field, &value) in all {
            check(
                field,
                "a finite number, not negative",
                value,
                value.is_finite() && value >= 0.0,
            )?;
        }
        Ok(())
    }
}

/// Options or a plant that projected rows cannot work with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProjectedError {
    /// An option is out of its range.
    #[error("{field}: expected {expected}, got {got}")]
    Value {
        /// Name of the option.
        field: &'static str,
        /// What would be right.
        expected: &'static str,
        /// Value given.
        got: f64,
    },
    /// A term is differentiated more often than the window allows.
    #[error("equation {equation}: expected terms differentiated at most {expected} times, got {got}")]
    Order {
        /// Name of the equation.
        equation: String,
        /// Highest order there is.
        expected: usize,
        /// Order of the equation.
        got: usize,
    },
    /// The plant's equations, parameters or start values do not fit together.
    #[error("the plant's parameters and equations do not fit together")]
    Plant,
}

/// One window of the open block.
#[derive(Debug, Clone, Copy)]
struct Window {
    /// Position of the centre in the buffers.
    centre: usize,
    /// Number of the centre sample on the grid.
    number: i64,
    start_ns: u64,
    end_ns: u64,
}

/// The columns of one equation: a value per window each.
#[derive(Debug, Clone)]
struct Columns {
    /// Y₀, Y₁, Y₂ times the input's scale; only Y₀ where the delay is not estimated.
    input: Vec<Vec<f64>>,
    /// The factors of the monomials.
    factors: Vec<Vec<f64>>,
}

/// Values of one equation at one θ, for plants whose terms are no polynomials in θ.
#[derive(Debug, Clone, Default)]
struct Evaluated {
    theta: Vec<f64>,
    valid: bool,
    /// [direction][equation][column][row]; the residual's part without the input first, then the regressors.
    columns: [Vec<Vec<Vec<f64>>>; 2],
    /// Scratch: a term and its derivatives in θ over the samples.
    samples: Vec<Vec<f64>>,
}

/// Everything of a block but the estimator that the first block needs.
#[derive(Debug, Clone)]
struct Core<P> {
    plant: P,
    options: ProjectedOptions,
    separation: Separation,
    kernels: Kernels,
    velocity_weights: Vec<f64>,
    /// Standard deviation of the filtered velocity per sample, for white noise of 1 on the positions.
    velocity_gain: f64,
    stride: i64,
    /// Samples on either side of a centre that a window needs.
    reach: usize,
    /// Samples kept over the border of a block.
    history: usize,
    capacity: usize,
    /// Index of the parameter that is the input's delay.
    delay: Option<usize>,
    // samples of the block, and of the one before as far as windows reach back
    q: Vec<Vec<f64>>,
    dq: Vec<Vec<f64>>,
    /// Standard deviation of each position.
    q_std: Vec<Vec<f64>>,
    u: Vec<Vec<f64>>,
    features: Vec<Vec<f64>>,
    t_ns: Vec<u64>,
    len: usize,
    /// First buffer position that follows the last hole.
    segment: usize,
    /// Grid number of buffer position 0, for positions from `segment` on.
    offset: i64,
    windows: Vec<Window>,
    // rows
    raw: Vec<Columns>,
    white: [Vec<Columns>; 2],
    whitening: Vec<Whitening>,
    evaluated: RefCell<Evaluated>,
    /// Positions less the error that the residuals show, with their velocities and features; the regressors are made of these.
    q_smooth: Vec<Vec<f64>>,
    dq_smooth: Vec<Vec<f64>>,
    features_smooth: Vec<Vec<f64>>,
    /// Inputs less their errors; the columns of considered errors are made of these.
    u_smooth: Vec<Vec<f64>>,
    /// True while the rows are made of them.
    smoothed: bool,
    /// Scratch of the smoothing: residuals \[direction\]\[equation\]\[row\], and R⁻¹ f of one equation.
    residuals: [Vec<Vec<f64>>; 2],
    weighted: Vec<f64>,
    slopes: Vec<f64>,
    intake: Intake,
    repair: Repair,
    /// Commanded positions of the sample before, and whether there ever were any.
    setpoint: [f64; MAX_JOINTS],
    commanded: bool,
    /// Bit j: joint j was commanded elsewhere with this sample.
    stepped: Vec<u32>,
    standstill: Standstill,
    /// Inputs whose variance is not that of the others, and by how much.
    surplus: Vec<Vec<(usize, f64)>>,
    /// Variance of the rounding of an input within each window.
    rounding: Vec<f64>,
    /// What the sensors do, as told or as learnt so far: of each position, of each input.
    noise: SensorNoise,
    position_noise: Vec<SignalNoise>,
    input_noise: Vec<SignalNoise>,
    // scratch of `prepare`
    jumps: Vec<Vec<(usize, f64)>>,
    statistic: Vec<f64>,
    /// [2 joint + (0 position, 1 velocity)][sample]
    partials: Vec<Vec<[f64; MAX_ORDER + 1]>>,
    /// Σ_k w_i(k) w_j(k) for windows a number of strides apart.
    input_overlap: Vec<f64>,
    /// c_i of every row \[equation\]\[row\], times the standard deviation of each position.
    sensitivity: Vec<Vec<Vec<f64>>>,
    /// Strides over which windows overlap.
    bandwidth: usize,
    suspects: SuspectColumns,
    tail: Tail,
}

/// A block of samples as projected rows, see the module's head.
#[derive(Debug, Clone)]
pub struct ProjectedBlock<P: Plant> {
    core: Core<P>,
    /// Fits the first blocks of a stream for their weights, and how many may still be.
    first_fit: BlockEstimator,
    first: u32,
    /// A start for the first fit beside the configured one, if there can be more than one minimum.
    start: Option<StartFinder>,
    /// The first block was fitted, and its θ̂ is where the estimator had better begin.
    begins: bool,
    /// What is known of θ by then: the start value where that is nothing.
    settled: Vec<f64>,
}

impl<P: Plant + Clone> ProjectedBlock<P> {
    /// An empty block for up to `block_len` samples; the only place that allocates.
    ///
    /// # Errors
    /// Options out of range, or a plant with terms differentiated more than twice or without parameters.
    pub fn new(plant: P, options: ProjectedOptions, block_len: usize) -> Result<Self, ProjectedError> {
        options.validate()?;
        let order = plant.equations().iter().map(|e| e.order).max().unwrap_or(0);
        if let Some(equation) = plant.equations().iter().find(|e| e.order >= MAX_ORDER) {
            return Err(ProjectedError::Order {
                equation: equation.name.to_string(),
                expected: MAX_ORDER - 1,
                got: equation.order,
            });
        }
        let structure = structure(&plant);
        let mut start = EstimatorOptions::recommended(
            plant.parameters().iter().map(|p| p.start).collect(),
            plant.equations().len(),
        );
        start.lower = plant.parameters().iter().map(|p| p.lower).collect();
        start.upper = plant.parameters().iter().map(|p| p.upper).collect();
        start.change_detection = None;
        let (lower, upper) = (start.lower.clone(), start.upper.clone());
        let first_fit = BlockEstimator::new(structure, start).map_err(|_| ProjectedError::Plant)?;
        let core = Core::new(plant, options, order, block_len)?;
        Ok(Self {
            start: StartFinder::new(&core.separation.equations, &lower, &upper),
            core,
            settled: first_fit.theta().to_vec(),
            first_fit,
            first: FIRST_BLOCKS,
            begins: false,
        })
    }

    /// The same with other start values than the plant's own for the first block's weights.
    ///
    /// # Errors
    /// Not one finite value within its bounds for each parameter.
    pub fn starting_at(mut self, theta: &[f64]) -> Result<Self, ProjectedError> {
        let options = EstimatorOptions {
            theta_start: theta.to_vec(),
            start_std: theta.iter().map(|t| t.abs()).collect(),
            ..self.first_fit.options().clone()
        };
        self.first_fit =
            BlockEstimator::new(structure(&self.core.plant), options).map_err(|_| ProjectedError::Plant)?;
        self.settled.copy_from_slice(theta);
        Ok(self)
    }

    /// The plant behind the rows.
    pub fn plant(&self) -> &P {
        &self.core.plant
    }

    /// What the sensors do, as told or as learnt up to the last block that was prepared.
    pub fn noise(&self) -> &SensorNoise {
        &self.core.noise
    }

    /// The options in force.
    pub fn options(&self) -> &ProjectedOptions {
        &self.core.options
    }

    /// The longest uninterrupted stretch of a joint's positions in the block that was prepared, and the variance of their noise.
    pub(super) fn positions(&self, joint: usize) -> (&[f64], f64) {
        let stretches = self.core.repair.stretches(self.core.len);
        let longest = stretches.max_by_key(|stretch| stretch.len()).unwrap_or(0..0);
        (
            &self.core.q[joint][longest],
            self.core.noise.deviations(joint)[0].powi(2),
        )
    }

    /// Goes on with what another block of this plant has learnt of the sensors; the estimator knows θ by then.
    pub(super) fn take_over(&mut self, other: &Self) {
        (self.first, self.begins) = (0, false);
        self.core.noise = other.core.noise;
        self.core.position_noise.clone_from_slice(&other.core.position_noise);
        self.core.input_noise.clone_from_slice(&other.core.input_noise);
    }
}

impl<P: Plant> ProjectedBlock<P> {
    /// Takes over what the fit of the first blocks knows to a half; true where that is everything. A parameter that the motion so far says nothing about
    /// may have gone anywhere, to zero for one, and would take its share of the noise along.
    fn settle(&mut self) -> bool {
        take_known(
            &self.first_fit,
            &self.first_fit.options().theta_start,
            &mut self.settled,
        )
    }
}

impl<P: Plant> ProjectedBlock<P> {
    /// Fits one of the first blocks for the weights of its rows.
    fn fit_first(&mut self) {
        let begun = self.first < FIRST_BLOCKS;
        self.first -= 1;
        self.begins = !begun;
        self.core.weigh(&self.settled);
        if begun {
            self.smooth_near_first();
        }
        self.first_fit.update(&self.core);
        if !begun {
            self.try_other_start();
            // once more with regressors that the first fit has freed of noise
            self.core.weigh(&self.settled);
            self.smooth_near_first();
            self.first_fit.update(&self.core);
        }
        if self.settle() {
            self.first = 0;
        }
        self.core.weigh(&self.settled);
        self.smooth_near_first();
    }

    /// Fits the first block from the start that its rows give, too, and goes on from the better of the two.
    fn try_other_start(&mut self) {
        let Some(finder) = &mut self.start else { return };
        let configured = self.core.mean_square(self.first_fit.theta());
        let core = &self.core;
        let row = |e: usize, row: usize, factors: &mut [f64]| core.linear_row(e, row, factors);
        let theta = finder.find(core.windows.len(), row, &self.first_fit.options().theta_start);
        self.settled.copy_from_slice(self.first_fit.theta());
        self.first_fit.restart(theta);
        self.first_fit.update(&self.core);
        if self.core.mean_square(self.first_fit.theta()) > configured {
            self.first_fit.restart(&self.settled);
            self.first_fit.update(&self.core);
        }
        self.settled.copy_from_slice(&self.first_fit.options().theta_start);
    }

    fn smooth_near_first(&mut self) {
        let theta = self.first_fit.theta();
        if self.core.mean_square(theta) < FAR {
            self.core.smooth(theta);
        }
    }

    /// Smooths with the residuals at θ̂ before the block, or at a fit of this block alone if the plant has moved away from that. Leaves
    /// the rows as they are measured if either leaves more in them than noise.
    ///
    /// A parameter that the block does not tell to a half stays what it was: a fit of rows that hold next to no motion puts it anywhere, and
    /// positions made to agree with that would speak for it.
    fn smooth_near(&mut self, theta: &[f64]) {
        if self.core.mean_square(theta) < FAR {
            self.core.smooth(theta);
            return;
        }
        self.first_fit.restart(theta);
        self.first_fit.update(&self.core);
        take_known(&self.first_fit, theta, &mut self.settled);
        if self.core.mean_square(&self.settled) < FAR {
            self.core.smooth(&self.settled);
        }
    }
}

impl<P: Plant> Core<P> {
    fn new(plant: P, options: ProjectedOptions, order: usize, block_len: usize) -> Result<Self, ProjectedError> {
        let separation = Separation::new(&plant);
        let kernels = Kernels::new(
            options.half(),
            options.sample_period_s,
            order + 1,
            options.timing,
            options.input_delay_s,
        );
        let velocity_half = options.velocity_half_width;
        let Some(mut velocity_weights) = savitzky_golay(velocity_half, 5, 1) else {
            return Err(ProjectedError::Value {
                field: "velocity_half_width",
                expected: "3 to 100",
                got: velocity_half as f64,
            });
        };
        let velocity_gain = dot(&velocity_weights, &velocity_weights).sqrt();
        velocity_weights.iter_mut().for_each(|w| *w /= options.sample_period_s);
        let stride = options.stride().max(1);
        // a velocity needs its neighbours, a jump five samples before it
        let reach = (kernels.half + 2 * velocity_half).max(kernels.input_half + 5);
        let history = 2 * reach + stride;
        // a stream may bring a few more grid values than samples
        let capacity = history + block_len + block_len / 16 + 4 * BRIDGED;
        let rows = capacity / stride + 2;
        let joints = plant.joints();
        let delay = plant.input_delay();
        let support = 2 * (kernels.half + velocity_half) + 1;
        let bandwidth = (support.max(2 * kernels.input_half + 1) - 1) / stride;
        let column = vec![0.0; rows];
        let raw: Vec<Columns> = (0..plant.equations().len())
            .map(|e| Columns {
                input: vec![column.clone(); if delay.is_some() { 3 } else { 1 }],
                factors: vec![column.clone(); separation.equations[e].as_ref().map_or(0, |p| p.monomials.len())],
            })
            .collect();
        let general = |e: usize| separation.equations[e].is_none();
        let widest = (0..plant.equations().len())
            .filter(|&e| general(e))
            .map(|e| plant.equations()[e].parameters.len() + 1)
            .max();
        let evaluated_columns: Vec<Vec<Vec<f64>>> = (0..plant.equations().len())
            .map(|e| match general(e) {
                true => vec![column.clone(); plant.equations()[e].parameters.len() + 1],
                false => Vec::new(),
            })
            .collect();
        let evaluated = Evaluated {
            theta: vec![0.0; plant.parameters().len()],
            valid: false,
            columns: [evaluated_columns.clone(), evaluated_columns],
            samples: vec![vec![0.0; capacity]; widest.map_or(0, |columns| columns * (MAX_ORDER + 1))],
        };
        let buffers = |count: usize| vec![vec![0.0; capacity]; count];
        let moves = |e: usize, joint: usize| {
            let (own, polynomial) = (&separation.sensitivities[e], &separation.equations[e]);
            own.position.contains(&joint)
                || own.velocity.contains(&joint)
                || polynomial
                    .as_ref()
                    .is_some_and(|p| p.velocity.iter().any(|term| term.joint == joint))
        };
        let suspects = SuspectColumns::new(&plant, options.considered, &velocity_weights, moves, rows, capacity);
        let tail = Tail::new(
            &separation,
            (options.half(), velocity_half, joints),
            (options.sample_period_s, options.timing, options.input_delay_s),
            order + 1,
        );
        Ok(Self {
            suspects,
            tail,
            q: buffers(joints),
            dq: buffers(joints),
            q_std: buffers(joints),
            u: buffers(joints),
            features: buffers(separation.features),
            t_ns: vec![0; capacity],
            len: 0,
            segment: 0,
            offset: 0,
            windows: Vec::with_capacity(rows),
            white: [raw.clone(), raw.clone()],
            raw,
            whitening: vec![Whitening::new(rows, bandwidth); plant.equations().len()],
            evaluated: RefCell::new(evaluated),
            q_smooth: buffers(joints),
            dq_smooth: buffers(joints),
            features_smooth: buffers(separation.features),
            u_smooth: buffers(joints),
            slopes: vec![0.0; support * joints],
            smoothed: false,
            residuals: std::array::from_fn(|_| vec![column.clone(); plant.equations().len()]),
            weighted: column.clone(),
            setpoint: [0.0; MAX_JOINTS],
            commanded: false,
            stepped: vec![0; capacity],
            intake: Intake::new(options.sample_period_s, options.timing, joints),
            repair: Repair::new(joints, capacity),
            // a vector's clone has no room
            surplus: (0..joints).map(|_| Vec::with_capacity(2 * capacity)).collect(),
            rounding: vec![0.0; rows],
            standstill: Standstill::new(&plant, &kernels.position[0], capacity, rows),
            noise: options.noise,
            position_noise: vec![SignalNoise::default(); joints],
            input_noise: vec![SignalNoise::default(); joints],
            jumps: (0..joints).map(|_| Vec::with_capacity(capacity)).collect(),
            statistic: Vec::with_capacity(capacity),
            partials: vec![vec![[0.0; MAX_ORDER + 1]; capacity]; 2 * joints],
            input_overlap: (0..=bandwidth)
                .map(|lag| {
                    let w = &kernels.input[0];
                    w.get(lag * stride..).map_or(0.0, |shifted| dot(w, shifted))
                })
                .collect(),
            sensitivity: vec![vec![vec![0.0; support * joints]; rows]; plant.equations().len()],
            bandwidth,
            separation,
            kernels,
            velocity_weights,
            velocity_gain,
            stride: stride as i64,
            reach,
            history,
            capacity,
            delay,
            plant,
            options,
        })
    }

    fn reset(&mut self) {
        self.len = 0;
        self.segment = 0;
        self.windows.clear();
        self.intake.reset();
        self.repair.reset();
        (self.setpoint, self.commanded) = ([0.0; MAX_JOINTS], false);
        self.position_noise.iter_mut().for_each(SignalNoise::reset);
        self.input_noise.iter_mut().for_each(SignalNoise::reset);
        self.suspects.reset();
    }

    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        // one sample may complete as many grid values
        if self.len + BRIDGED + 2 > self.capacity {
            return false;
        }
        if let (Some(change), Some(last)) = (self.intake.take(t_ns, sample), self.len.checked_sub(1)) {
            for (u, change) in self.u.iter_mut().zip(&change) {
                u[last] += change;
            }
        }
        let mut stepped = 0;
        for joint in 0..self.q.len() {
            stepped |= u32::from(sample.setpoint[joint] != self.setpoint[joint]) << joint;
        }
        (self.setpoint, self.commanded) = (sample.setpoint, self.commanded || stepped != 0);
        while self.len < self.capacity
            && let Some(grid) = self.intake.next()
        {
            self.stepped[self.len] = stepped;
            self.append(&grid);
        }
        true
    }

    /// Takes a sample on the grid in, which there is room for.
    fn append(&mut self, grid: &GridSample) {
        let at = self.len;
        if grid.first || at == 0 {
            // behind a hole, or a clock that went back
            self.segment = at;
            self.offset = grid.number - at as i64;
        }
        self.repair.note(at, grid.first || at == 0, grid.lost, grid.gain);
        for joint in 0..self.q.len() {
            self.q[joint][at] = grid.q[joint];
            self.u[joint][at] = grid.u[joint];
        }
        self.t_ns[at] = grid.t_ns;
        self.len += 1;

        let velocity_half = self.options.velocity_half_width;
        if self.len > self.segment + 2 * velocity_half {
            self.differentiate(at - velocity_half);
        }
        if self.len > self.segment + 2 * self.reach {
            let centre = at - self.reach;
            let number = self.offset + centre as i64;
            if number.rem_euclid(self.stride) == 0 && self.windows.len() < self.windows.capacity() {
                self.windows.push(Window {
                    centre,
                    number,
                    start_ns: self.t_ns[centre - self.kernels.half],
                    end_ns: self.t_ns[centre + self.kernels.half],
                });
            }
        }
    }

    /// Makes single wrong and lost samples good, and what was computed from them.
    fn mend(&mut self) {
        for joint in 0..self.q.len() {
            let (std, count) = (self.noise.deviations(joint), self.noise.position_resolution[joint]);
            let (q, u) = (&mut self.q[joint][..self.len], &mut self.u[joint][..self.len]);
            self.repair.mend(joint, q, u, std, count);
        }
        self.repair.finish(self.len);
        let half = self.options.velocity_half_width;
        for change in 0..self.repair.changed().len() {
            let (from, to) = self.repair.changed()[change];
            let mut stretches = self.repair.stretches(self.len);
            let Some(stretch) = stretches.find(|stretch| stretch.contains(&from)) else {
                continue;
            };
            drop(stretches);
            let first = from.saturating_sub(half).max(stretch.start + half);
            for at in first..(to + half).min(stretch.end.saturating_sub(half)) {
                self.differentiate(at);
            }
        }
    }

    /// Velocity and features of a sample whose neighbours are known.
    fn differentiate(&mut self, at: usize) {
        let velocity_half = self.options.velocity_half_width;
        let mut q = [0.0; MAX_JOINTS];
        let mut dq = [0.0; MAX_JOINTS];
        for joint in 0..self.q.len() {
            let neighbours = &self.q[joint][at - velocity_half..=at + velocity_half];
            q[joint] = self.q[joint][at];
            dq[joint] = dot(&self.velocity_weights, neighbours);
            self.dq[joint][at] = dq[joint];
        }
        let features = &mut self.features;
        self.separation
            .extract(&self.plant, &q, &dq, |feature, value| features[feature][at] = value);
    }

    /// Keeps what the next block's windows reach back to.
    fn clear(&mut self) {
        let kept = (self.len - self.segment).min(self.history);
        let from = self.len - kept;
        for buffer in [&mut self.q, &mut self.dq, &mut self.u, &mut self.features] {
            for values in buffer {
                values.copy_within(from..from + kept, 0);
            }
        }
        self.t_ns.copy_within(from..from + kept, 0);
        self.stepped.copy_within(from..from + kept, 0);
        self.repair.clear(from, self.len);
        self.offset += from as i64;
        self.segment = 0;
        self.len = kept;
        self.windows.clear();
        self.evaluated.get_mut().valid = false;
    }

    /// Takes the noise levels from the signals where they are to be learnt, and says what each position is worth.
    fn sense(&mut self) {
        // windows lie before a hole as well as behind it
        let span = 0..self.len;
        let longest = self.repair.stretches(self.len).max_by_key(|stretch| stretch.len());
        let longest = longest.unwrap_or(span.clone());
        for joint in 0..self.q.len() {
            if self.options.learn_noise {
                let (position, input) = (&mut self.position_noise[joint], &mut self.input_noise[joint]);
                let made = |kind| {
                    let (repair, first) = (&self.repair, longest.start);
                    move |k: usize| repair.is_made(kind, joint, first + k)
                };
                let q = &self.q[joint][longest.clone()];
                position.learn(q, made(Kind::Position), &mut self.statistic);
                let u = &self.u[joint][longest.clone()];
                input.learn(u, made(Kind::Input), &mut self.statistic);
                self.noise.position_resolution[joint] = position.resolution();
                self.noise.position_noise[joint] = position.deviation();
                let deviation = input.deviation().hypot(input.resolution() / 12f64.sqrt());
                let size = (dot(u, u) / u.len().max(1) as f64).sqrt();
                self.noise.input_noise[joint] = if deviation > EXACT * size { deviation } else { 0.0 };
                self.noise.input_resolution[joint] = 0.0;
            }
            let resolution = self.noise.position_resolution[joint];
            let (white, rounding) = (self.noise.position_noise[joint].powi(2), resolution * resolution / 12.0);
            let (half, velocity_half) = (self.kernels.half, self.options.velocity_half_width);
            // in counts, of the filtered velocity's difference over twice its half width
            let rounded = self.velocity_gain / (24f64.sqrt() * velocity_half as f64);
            let (std, q, dq) = (&mut self.q_std[joint], &self.q[joint], &self.dq[joint]);
            let per_sample = self.options.sample_period_s / resolution;
            for at in span.clone() {
                // a joint that is not quantised has no counts
                let inflation = if resolution > 0.0 {
                    let around =
                        |reach: usize| (at.saturating_sub(reach).max(span.start), (at + reach).min(span.end - 1));
                    let (before, after) = around(velocity_half);
                    let acceleration = (dq[after] - dq[before]) * per_sample / (after - before).max(1) as f64;
                    if acceleration.abs() > SURE * rounded {
                        rounding::inflation(dq[at] * per_sample, acceleration)
                    } else {
                        // slow enough to be measured over a window's length
                        let (before, after) = around(half);
                        let counts = (q[after] - q[before]) / resolution;
                        rounding::inflation(counts / (after - before).max(1) as f64, 0.0)
                    }
                } else {
                    1.0
                };
                std[at] = (white + rounding * inflation).sqrt();
            }
            if self.repair.touched() {
                for (at, deviation) in self.q_std[joint][span.clone()].iter_mut().enumerate() {
                    let own = *deviation * *deviation;
                    *deviation = self.repair.variance(Kind::Position, joint, at, own).sqrt();
                }
            }
            let own = self.noise.deviations(joint)[1].powi(2);
            self.repair
                .surplus(Kind::Input, joint, self.len, own, &mut self.surplus[joint]);
        }
    }

    /// Finds the rows that a joint at rest spoils.
    fn find_rests(&mut self) {
        for joint in 0..self.q.len() {
            if !self.standstill.concerns(joint) {
                continue;
            }
            let noise = &self.noise;
            let (resolution, white) = (noise.position_resolution[joint], noise.position_noise[joint]);
            self.standstill.begin(joint);
            for stretch in self.repair.stretches(self.len) {
                self.standstill.look(joint, &self.q[joint], stretch, resolution, white);
            }
        }
        self.standstill.judge(self.windows.iter().map(|window| window.centre));
    }

    /// Projects the block.
    fn project(&mut self) {
        self.suspects.sense(&Signals {
            len: self.len,
            q: &self.q,
            dq: &self.dq,
            q_std: &self.q_std,
            u: &self.u,
        });
        if self.options.timing == InputTiming::Continuous {
            for joint in 0..self.q.len() {
                self.find_jumps(joint);
            }
        }
        for e in 0..self.raw.len() {
            let form = &self.plant.equations()[e];
            let (input, scale) = (form.input, form.input_scale);
            let polynomial = self.separation.equations[e].as_ref();
            let kernels = &self.kernels;
            let columns = &mut self.raw[e];
            for (row, window) in self.windows.iter().enumerate() {
                let from = window.centre - kernels.input_half;
                let u = &self.u[input][from..=window.centre + kernels.input_half];
                for (r, column) in columns.input.iter_mut().enumerate() {
                    let mut sum = dot(&kernels.input[r], u);
                    for &(at, size) in jumps_within(&self.jumps[input], from, u.len()) {
                        sum += kernels.jump[r][at - from] * size;
                    }
                    column[row] = scale * sum;
                }
                let moment = |r: usize| match columns.input.get(r) {
                    Some(column) => column[row],
                    None => scale * moment(kernels, r, window.centre, &self.u[input], &self.jumps[input]),
                };
                let moments = [moment(0), moment(1), moment(2)];
                self.suspects.project(e, row, window.centre, scale, kernels, moments);
            }
            if let Some(polynomial) = polynomial {
                project_factors(
                    kernels,
                    &self.windows,
                    polynomial,
                    &self.q,
                    &self.features,
                    &mut columns.factors,
                );
            }
        }
    }

    /// Finds the jumps of an input within the block and their sizes.
    ///
    /// With d_k = u_k − u_{k−1} and e_k = d_k − (d_{k−1} + d_{k+1})/2 a jump Δ at t_k gives e = (−Δ/2, Δ, −Δ/2) around k, white noise a variance of
    /// 5 σ_u², and a smooth input next to nothing, of slowly varying sign. j_k = (e_k − (e_{k−1} + e_{k+1})/2)/1.5 tells them apart best.
    fn find_jumps(&mut self, joint: usize) {
        let (u, len) = (&self.u[joint][..self.len], self.len);
        let jumps = &mut self.jumps[joint];
        jumps.clear();
        if len < 9 {
            return;
        }
        let e = |k: usize| 1.5 * (u[k] - u[k - 1]) - 0.5 * (u[k + 1] - u[k - 2]);
        let contrast = |k: usize| (e(k) - 0.5 * (e(k - 1) + e(k + 1))) / 1.5;
        let candidates = 5..len - 2;
        self.statistic.clear();
        self.statistic.extend(candidates.clone().map(|k| contrast(k).abs()));
        let middle = self.statistic.len() / 2;
        let (_, median, _) = self.statistic.select_nth_unstable_by(middle, f64::total_cmp);
        let noise = self.noise.deviations(joint)[1];
        // the variance of j is 7 σ_u², and a median of 0.67 standard deviations
        let threshold = (8.0 * 7f64.sqrt() * noise).max(12.0 * *median).max(f64::MIN_POSITIVE);
        for k in candidates {
            let here = e(k);
            let shape = (e(k - 1) + 0.5 * here).abs() + (e(k + 1) + 0.5 * here).abs();
            if contrast(k).abs() > threshold && shape < 0.5 * here.abs() {
                // without noise the left limit is extrapolated, which is exact for polynomials of degree 4
                let left = 5.0 * (u[k - 1] - u[k - 4]) - 10.0 * (u[k - 2] - u[k - 3]) + u[k - 5];
                let size = if noise > 0.0 { here } else { u[k] - left };
                // a drive may answer to its setpoint a few samples late
                let recent = k.saturating_sub(ANSWER)..=k;
                let commanded = self.stepped[recent].iter().any(|mask| mask >> joint & 1 == 1);
                if self.commanded && !commanded {
                    // not a step of the setpoint, so it may have happened anywhere since the sample before: a drive that left its limit
                    let surplus = &mut self.surplus[joint];
                    let place = surplus.partition_point(|entry| entry.0 < k);
                    surplus.insert(place, (k, size * size / 12.0));
                } else {
                    jumps.push((k, size));
                }
            }
        }
    }

    /// Makes R at θ and whitens the rows by it, as they are measured.
    fn weigh(&mut self, theta: &[f64]) {
        for (smooth, measured) in self.q_smooth.iter_mut().zip(&self.q) {
            smooth[..self.len].copy_from_slice(&measured[..self.len]);
        }
        self.smoothed = false;
        for e in 0..self.raw.len() {
            self.differentiate_terms(e, theta);
            self.covariance(e, theta);
            self.standstill.exclude(e, self.windows.len(), &mut self.whitening[e]);
            self.whitening[e].factor();
            let rows = self.windows.len();
            self.suspects.whiten(e, rows, &self.whitening[e]);
            for (direction, white) in [Direction::Forward, Direction::Backward]
                .into_iter()
                .zip(&mut self.white)
            {
                let (raw, white) = (&self.raw[e], &mut white[e]);
                let columns = white.input.iter_mut().chain(&mut white.factors);
                for (white, raw) in columns.zip(raw.input.iter().chain(&raw.factors)) {
                    white[..rows].copy_from_slice(&raw[..rows]);
                    self.whitening[e].apply(direction, &mut white[..rows]);
                }
            }
        }
        self.evaluated.get_mut().valid = false;
        self.look_at_end(theta);
    }

    /// Projects the windows that end with the block.
    fn look_at_end(&mut self, theta: &[f64]) {
        if self.delay.is_some() {
            return;
        }
        let end = Ending {
            plant: &self.plant,
            separation: &self.separation,
            velocity_weights: &self.velocity_weights,
            q: &self.q,
            dq: &self.dq,
            q_std: &self.q_std,
            u: &self.u,
            features: &self.features,
            jumps: &self.jumps,
            surplus: &self.surplus,
            samples: self.segment..self.len,
            input_std: std::array::from_fn(|joint| self.noise.deviations(joint)[1]),
            mended: self.repair.touched(),
        };
        self.tail.project(&end, theta);
    }

    /// A whitened row with a coefficient for each monomial: writes the factors of those other than 1, returns what is left without them.
    fn linear_row(&self, e: usize, row: usize, factors: &mut [f64]) -> f64 {
        let columns = &self.white[Direction::Forward as usize][e];
        let mut y = columns.input[0][row];
        let mut slots = factors.iter_mut();
        let monomials = self.separation.equations[e].iter().flat_map(|p| &p.monomials);
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

    /// Mean square of the whitened residuals at θ: 1 if they hold sensor noise alone.
    fn mean_square(&self, theta: &[f64]) -> f64 {
        let mut regressor = [0.0; MAX_PARAMS];
        let (mut sum, mut count) = (0.0, 0usize);
        for e in 0..self.raw.len() {
            let own = self.plant.equations()[e].parameters.len();
            for row in (0..self.windows.len()).filter(|&row| self.is_used(e, row)) {
                let f = self.white_row(Direction::Forward, e, row, theta, &mut regressor[..own]);
                sum += f * f;
                count += 1;
            }
        }
        sum / count.max(1) as f64
    }

    /// Makes the regressors of smoothed positions, see "Errors in variables" at the head of the file. The rows must have been
    /// whitened as they are measured; `theta` is to leave no more in them than noise.
    fn smooth(&mut self, theta: &[f64]) {
        let rows = self.windows.len();
        for (smooth, measured) in self.u_smooth.iter_mut().zip(&self.u) {
            smooth[..self.len].copy_from_slice(&measured[..self.len]);
        }
        for e in 0..self.raw.len() {
            self.residuals(e, theta);
            self.subtract_errors(e);
        }
        self.smooth_features();
        self.smooth_suspects();
        self.smoothed = true;
        self.evaluated.get_mut().valid = false;
        for e in 0..self.raw.len() {
            let Some(polynomial) = &self.separation.equations[e] else {
                continue;
            };
            let [forward, backward] = &mut self.white;
            let (forward, backward) = (&mut forward[e].factors, &mut backward[e].factors);
            project_factors(
                &self.kernels,
                &self.windows,
                polynomial,
                &self.q_smooth,
                &self.features_smooth,
                forward,
            );
            for (forward, backward) in forward.iter_mut().zip(backward) {
                backward[..rows].copy_from_slice(&forward[..rows]);
                self.whitening[e].apply(Direction::Forward, &mut forward[..rows]);
                self.whitening[e].apply(Direction::Backward, &mut backward[..rows]);
            }
        }
        // the residuals at θ stay what they are as measured
        for e in 0..self.raw.len() {
            let own = self.plant.equations()[e].parameters.len();
            let mut regressor = [0.0; MAX_PARAMS];
            for direction in [Direction::Forward, Direction::Backward] {
                for row in 0..rows {
                    let smooth = self.white_row(direction, e, row, theta, &mut regressor[..own]);
                    let shift = self.residuals[direction as usize][e][row] - smooth;
                    self.white[direction as usize][e].input[0][row] += shift;
                }
            }
        }
    }

    /// Keeps the residuals of one equation at θ, both ways of whitening.
    fn residuals(&mut self, e: usize, theta: &[f64]) {
        let mut regressor = [0.0; MAX_PARAMS];
        let own = self.plant.equations()[e].parameters.len();
        for direction in [Direction::Forward, Direction::Backward] {
            for row in 0..self.windows.len() {
                self.residuals[direction as usize][e][row] =
                    self.white_row(direction, e, row, theta, &mut regressor[..own]);
            }
        }
    }

    /// q̂ += σ_q² Σ_i c_i (R⁻¹ f)_i for the rows f of one equation, whose residuals have been kept.
    fn subtract_errors(&mut self, e: usize) {
        let rows = self.windows.len();
        self.weighted[..rows].copy_from_slice(&self.residuals[Direction::Forward as usize][e][..rows]);
        self.whitening[e].apply_transposed(&mut self.weighted[..rows]);
        let velocity_half = self.options.velocity_half_width;
        let support = 2 * (self.kernels.half + velocity_half) + 1;
        for (i, window) in self.windows.iter().enumerate() {
            let first = window.centre - self.kernels.half - velocity_half;
            let weighted = self.weighted[i];
            for joint in 0..self.q.len() {
                let c = &self.sensitivity[e][i][joint * support..(joint + 1) * support];
                let std = &self.q_std[joint][first..first + support];
                let q = &mut self.q_smooth[joint][first..first + support];
                for ((q, c), std) in q.iter_mut().zip(c).zip(std) {
                    *q += std * c * weighted;
                }
            }
        }
        let form = &self.plant.equations()[e];
        let (input, scale) = (form.input, form.input_scale);
        let kernel = &self.kernels.input[0];
        for (i, window) in self.windows.iter().enumerate() {
            let variance = self.noise.input_noise[input].powi(2) + self.rounding[i];
            let moved = variance * scale * self.weighted[i];
            let from = window.centre - self.kernels.input_half;
            let u = &mut self.u_smooth[input][from..from + kernel.len()];
            u.iter_mut().zip(kernel).for_each(|(u, weight)| *u -= moved * weight);
        }
    }

    /// Columns of considered errors that are made of smoothed signals. Residual and column would otherwise share the noise: with motion so slow that the
    /// second derivative of the input is less than its noise, the score of a resonance is −σ_u² Σ ψ′², always of one sign, and the sine of a joint that hardly moves
    /// would explain all noise by an eccentricity of 1 rad.
    fn smooth_suspects(&mut self) {
        self.suspects.sense(&Signals {
            len: self.len,
            q: &self.q_smooth,
            dq: &self.dq_smooth,
            q_std: &self.q_std,
            u: &self.u_smooth,
        });
        let kernels = &self.kernels;
        let velocity_half = self.options.velocity_half_width;
        let support = 2 * (kernels.half + velocity_half) + 1;
        for e in 0..self.raw.len() {
            let form = &self.plant.equations()[e];
            let (input, scale) = (form.input, form.input_scale);
            for (row, window) in self.windows.iter().enumerate() {
                let moments = [0, 1, 2]
                    .map(|r| scale * moment(kernels, r, window.centre, &self.u_smooth[input], &self.jumps[input]));
                self.suspects.project(e, row, window.centre, scale, kernels, moments);
                let first = window.centre - kernels.half - velocity_half;
                let mut noisy = true;
                for joint in 0..self.q.len() {
                    let own = joint * support..(joint + 1) * support;
                    let std = &self.q_std[joint][first..first + support];
                    let weighted = self.sensitivity[e][row][own.clone()].iter().zip(std);
                    for (slope, (c, std)) in self.slopes[own].iter_mut().zip(weighted) {
                        *slope = c / std;
                        noisy &= *std > 0.0;
                    }
                }
                // exact positions need no smoothing
                if noisy {
                    self.suspects.turn(e, row, &self.slopes, support, first);
                }
            }
            self.suspects.whiten(e, self.windows.len(), &self.whitening[e]);
        }
    }

    /// Velocities and features of the smoothed positions.
    fn smooth_features(&mut self) {
        let (Some(first), Some(last)) = (self.windows.first(), self.windows.last()) else {
            return;
        };
        let (half, velocity_half) = (self.kernels.half, self.options.velocity_half_width);
        let joints = self.q.len();
        let samples = first.centre - half - velocity_half..last.centre + half + velocity_half + 1;
        for joint in 0..joints {
            for at in samples.clone() {
                let (measured, most) = (self.q[joint][at], LARGEST_ERROR * self.q_std[joint][at]);
                let smooth = &mut self.q_smooth[joint][at];
                *smooth = smooth.clamp(measured - most, measured + most);
            }
        }
        for at in first.centre - half..last.centre + half + 1 {
            let mut q = [0.0; MAX_JOINTS];
            let mut dq = [0.0; MAX_JOINTS];
            for joint in 0..joints {
                let neighbours = &self.q_smooth[joint][at - velocity_half..=at + velocity_half];
                q[joint] = self.q_smooth[joint][at];
                dq[joint] = dot(&self.velocity_weights, neighbours);
                self.dq_smooth[joint][at] = dq[joint];
            }
            let features = &mut self.features_smooth;
            self.separation
                .extract(&self.plant, &q, &dq, |feature, value| features[feature][at] = value);
        }
    }

    /// ∂g/∂q and ∂g/∂q̇ of an equation's nonlinear part at every sample that a window holds.
    fn differentiate_terms(&mut self, e: usize, theta: &[f64]) {
        let (Some(first), Some(last)) = (self.windows.first(), self.windows.last()) else {
            return;
        };
        let span = first.centre - self.kernels.half..last.centre + self.kernels.half + 1;
        let joints = self.q.len();
        let polynomial = self.separation.equations[e].as_ref();
        for (joint, velocity) in self.separation.sensitivities[e].kinds() {
            let linear = linear_in_velocity(polynomial, joint, velocity, theta);
            for at in span.clone() {
                let mut q = [0.0; MAX_JOINTS];
                let mut dq = [0.0; MAX_JOINTS];
                for j in 0..joints {
                    (q[j], dq[j]) = (self.q[j][at], self.dq[j][at]);
                }
                let slopes = partials(&self.plant, e, &q, &dq, theta, joint, velocity);
                self.partials[2 * joint + usize::from(velocity)][at] = nonlinear(slopes, &linear);
            }
        }
    }

    /// R of one equation, lower band.
    fn covariance(&mut self, e: usize, theta: &[f64]) {
        let form = &self.plant.equations()[e];
        let (input, scale) = (form.input, form.input_scale);
        let kernels = &self.kernels;
        let weights = ErrorWeights {
            kernels,
            velocity_weights: &self.velocity_weights,
            polynomial: self.separation.equations[e].as_ref(),
            sensitivity: &self.separation.sensitivities[e],
            order: form.order,
        };
        let velocity_half = self.options.velocity_half_width;
        let support = 2 * (kernels.half + velocity_half) + 1;
        let joints = self.q.len();
        let slots = self.bandwidth + 1;
        let u = &self.u[input][..self.len];
        let mean_square = dot(u, u) / self.len.max(1) as f64;
        // exact signals are exact to rounding and quadrature only
        let input_variance = self.noise.input_noise[input].powi(2) + EXACT * EXACT * mean_square.max(EXACT);
        let whitening = &mut self.whitening[e];
        whitening.begin(self.windows.len());
        for (i, window) in self.windows.iter().enumerate() {
            // c_i, times the deviation of each position
            let c = &mut self.sensitivity[e][i];
            let first = window.centre - kernels.half;
            let partials = &self.partials;
            let slopes =
                |joint: usize, velocity: bool, k: usize| partials[2 * joint + usize::from(velocity)][first + k];
            weights.write(theta, slopes, c);
            self.suspects.turn(e, i, c, support, first - velocity_half);
            for joint in 0..joints {
                let deviations = &self.q_std[joint][first - velocity_half..];
                let own = &mut c[joint * support..(joint + 1) * support];
                own.iter_mut()
                    .zip(deviations)
                    .for_each(|(c, deviation)| *c *= deviation);
            }

            let from = window.centre - kernels.input_half;
            let jumps = jumps_within(&self.jumps[input], from, 2 * kernels.input_half + 1);
            let surplus = jumps_within(&self.surplus[input], from, 2 * kernels.input_half + 1);
            let count = self.noise.input_resolution[input];
            self.rounding[i] = rounding_variance(count, &self.u[input][from..=window.centre + kernels.input_half]);
            for lag in 0..slots.min(i + 1) {
                let earlier = self.windows[i - lag];
                let distance = (window.number - earlier.number) as usize;
                let strides = distance / self.stride as usize;
                // a window's own rounding makes 0 + 0 of inputs without
                let rounding = (self.rounding[i] * self.rounding[i - lag]).sqrt();
                let input_variance = input_variance + rounding;
                let mut sum = self.input_overlap.get(strides).unwrap_or(&0.0) * scale * scale * input_variance;
                if distance < support {
                    let (a, b) = (&self.sensitivity[e][i], &self.sensitivity[e][i - lag]);
                    for joint in 0..joints {
                        let (a, b) = (
                            &a[joint * support..],
                            &b[joint * support + distance..(joint + 1) * support],
                        );
                        sum += dot(&a[..support - distance], b);
                    }
                }
                if strides < slots && !jumps.is_empty() {
                    let earlier_from = earlier.centre - kernels.input_half;
                    for &(at, size) in jumps {
                        let Some(weight) = kernels.jump[0].get(at - earlier_from) else {
                            continue;
                        };
                        let noise = self.noise.deviations(input)[1];
                        let relative = if noise > 0.0 { 1e-3 } else { 1e-5 };
                        let variance = 5.0 * noise * noise + (relative * size) * (relative * size);
                        sum += scale * scale * kernels.jump[0][at - from] * weight * variance;
                    }
                }
                if strides < slots {
                    let earlier_from = earlier.centre - kernels.input_half;
                    for &(at, variance) in surplus {
                        if let Some(weight) = kernels.input[0].get(at - earlier_from) {
                            sum += scale * scale * kernels.input[0][at - from] * weight * variance;
                        }
                    }
                }
                whitening.add(i, lag, sum);
            }
        }
    }

    /// Residual without the input and regressors of every row at θ, for equations whose terms are no polynomials in θ.
    fn evaluate(&self, theta: &[f64], evaluated: &mut Evaluated) {
        evaluated.theta.copy_from_slice(theta);
        evaluated.valid = true;
        let (Some(first), Some(last)) = (self.windows.first(), self.windows.last()) else {
            return;
        };
        let half = self.kernels.half;
        let span = first.centre - half..last.centre + half + 1;
        let joints = self.q.len();
        for e in (0..self.raw.len()).filter(|&e| self.separation.equations[e].is_none()) {
            let form = &self.plant.equations()[e];
            let terms = form.order + 1;
            let mut dual_theta = [Dual64::from_re(0.0); MAX_PARAMS];
            for (dual, &value) in dual_theta.iter_mut().zip(theta) {
                dual.re = value;
            }
            for at in span.clone() {
                let mut q = [Dual64::from_re(0.0); MAX_JOINTS];
                let mut dq = [Dual64::from_re(0.0); MAX_JOINTS];
                let (position, velocity) = match self.smoothed {
                    true => (&self.q_smooth, &self.dq_smooth),
                    false => (&self.q, &self.dq),
                };
                for j in 0..joints {
                    (q[j].re, dq[j].re) = (position[j][at], velocity[j][at]);
                }
                for (slot, parameter) in form.parameters.clone().enumerate() {
                    dual_theta[parameter].eps = 1.0;
                    let mut g = [Dual64::from_re(0.0); MAX_ORDER + 1];
                    self.plant.terms(
                        e,
                        &q[..joints],
                        &dq[..joints],
                        &dual_theta[..theta.len()],
                        &mut g[..terms],
                    );
                    dual_theta[parameter].eps = 0.0;
                    for d in 0..terms {
                        evaluated.samples[d][at] = g[d].re;
                        evaluated.samples[(slot + 1) * terms + d][at] = g[d].eps;
                    }
                }
            }
            for column in 0..=form.parameters.len() {
                for (row, window) in self.windows.iter().enumerate() {
                    let span = window.centre - half..window.centre + half + 1;
                    let sum: f64 = (0..terms)
                        .map(|d| {
                            dot(
                                &self.kernels.position[d],
                                &evaluated.samples[column * terms + d][span.clone()],
                            )
                        })
                        .sum();
                    evaluated.columns.iter_mut().for_each(|c| c[e][column][row] = sum);
                }
                for (direction, columns) in [Direction::Forward, Direction::Backward]
                    .into_iter()
                    .zip(&mut evaluated.columns)
                {
                    self.whitening[e].apply(direction, &mut columns[e][column][..self.windows.len()]);
                }
            }
        }
    }

    /// A whitened row, see [`Residuals::row`].
    fn white_row(&self, direction: Direction, e: usize, row: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let columns = &self.white[direction as usize][e];
        let first = self.plant.equations()[e].parameters.start;
        regressor.fill(0.0);
        let mut f = columns.input[0][row];
        if let (Some(delay), [_, y1, y2]) = (self.delay, columns.input.as_slice()) {
            // Y(ε) = Y₀ + ε Y₁ + ε²/2 Y₂, ε beyond the configured delay; the regressor is −∂f/∂ε
            let more = theta[delay] - self.options.input_delay_s;
            f += more * (y1[row] + 0.5 * more * y2[row]);
            regressor[delay - first] = -(y1[row] + more * y2[row]);
        }
        match &self.separation.equations[e] {
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
                let mut evaluated = self.evaluated.borrow_mut();
                if !evaluated.valid || evaluated.theta != theta {
                    self.evaluate(theta, &mut evaluated);
                }
                let columns = &evaluated.columns[direction as usize][e];
                f -= columns[0][row];
                for (slot, column) in columns[1..].iter().enumerate() {
                    regressor[slot] += column[row];
                }
            }
        }
        f
    }
}

/// Takes over the parameters that a fit knows to a half, and `otherwise` in the place of the others; true if it knows all.
fn take_known(fit: &BlockEstimator, otherwise: &[f64], theta: &mut [f64]) -> bool {
    let report = fit.report();
    let mut all = true;
    for (i, value) in theta.iter_mut().enumerate() {
        let known = report.theta_std[i] < KNOWN * report.theta[i].abs();
        *value = if known { report.theta[i] } else { otherwise[i] };
        all &= known;
    }
    all
}

/// The factors of an equation's monomials, a value per window each.
fn project_factors(
    kernels: &Kernels,
    windows: &[Window],
    polynomial: &Polynomial,
    q: &[Vec<f64>],
    features: &[Vec<f64>],
    factors: &mut [Vec<f64>],
) {
    for (row, window) in windows.iter().enumerate() {
        for column in factors.iter_mut() {
            column[row] = 0.0;
        }
        let span = window.centre - kernels.half..window.centre + kernels.half + 1;
        for term in &polynomial.velocity {
            let weights = &kernels.position[term.derivative + 1];
            factors[term.monomial][row] += term.coefficient * dot(weights, &q[term.joint][span.clone()]);
        }
        for term in &polynomial.features {
            factors[term.monomial][row] += dot(
                &kernels.position[term.derivative],
                &features[term.feature][span.clone()],
            );
        }
    }
}

/// Variance of an input's rounding to counts over a window, 0 without: white where it crosses counts, and correlated where it creeps, as for positions.
fn rounding_variance(count: f64, u: &[f64]) -> f64 {
    if !(count > 0.0) {
        return 0.0;
    }
    let steps: f64 = u.windows(2).map(|pair| (pair[1] - pair[0]).abs().min(count)).sum();
    let rate = steps / (u.len() as f64 * count);
    count * count / 12.0 * (rounding::BEAT / rate).clamp(1.0, rounding::LIMIT)
}

/// ∫ψ^(r) u of a window.
fn moment(kernels: &Kernels, r: usize, centre: usize, u: &[f64], jumps: &[(usize, f64)]) -> f64 {
    let from = centre - kernels.input_half;
    let u = &u[from..=centre + kernels.input_half];
    let jumps = jumps_within(jumps, from, u.len()).iter();
    let sum: f64 = jumps.map(|&(at, size)| kernels.jump[r][at - from] * size).sum();
    sum + dot(&kernels.input[r], u)
}

/// The jumps at buffer positions `from..from + len`.
fn jumps_within(jumps: &[(usize, f64)], from: usize, len: usize) -> &[(usize, f64)] {
    let start = jumps.partition_point(|jump| jump.0 < from);
    let end = jumps.partition_point(|jump| jump.0 < from + len);
    &jumps[start..end]
}

impl<P: Plant> Residuals for Core<P> {
    fn len(&self) -> usize {
        self.windows.len()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.white_row(Direction::Backward, equation, index, theta, regressor)
    }

    fn span(&self, index: usize) -> (u64, u64) {
        (self.windows[index].start_ns, self.windows[index].end_ns)
    }

    fn is_used(&self, equation: usize, index: usize) -> bool {
        !self.standstill.is_spoilt(equation, index)
    }

    fn tail(&self, equation: usize, k: usize, theta: &[f64]) -> Option<f64> {
        let rests = self
            .windows
            .len()
            .checked_sub(1)
            .is_none_or(|last| self.standstill.is_spoilt(equation, last));
        if rests {
            None
        } else {
            self.tail.residual(&self.separation, equation, k, theta)
        }
    }

    fn row_forward(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.white_row(Direction::Forward, equation, index, theta, regressor)
    }
}

impl<P: Plant> Residuals for ProjectedBlock<P> {
    fn len(&self) -> usize {
        self.core.len()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.core.row(equation, index, theta, regressor)
    }

    fn span(&self, index: usize) -> (u64, u64) {
        self.core.span(index)
    }

    fn is_used(&self, equation: usize, index: usize) -> bool {
        self.core.is_used(equation, index)
    }

    fn tail(&self, equation: usize, k: usize, theta: &[f64]) -> Option<f64> {
        self.core.tail(equation, k, theta)
    }

    fn suspects(&self) -> usize {
        self.core.suspects.count()
    }

    fn suspect_std(&self, suspect: usize) -> f64 {
        self.core.suspects.std(suspect)
    }

    fn suspect_row(&self, equation: usize, index: usize, columns: &mut [f64]) {
        self.core.suspects.row(equation, index, columns);
    }

    fn row_forward(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.core.row_forward(equation, index, theta, regressor)
    }

    fn start(&self) -> Option<&[f64]> {
        self.begins.then(|| self.first_fit.theta())
    }
}

impl<P: Plant> SampleBlock for ProjectedBlock<P> {
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        self.core.push(t_ns, sample)
    }

    fn prepare(&mut self, theta: &[f64]) {
        self.core.mend();
        self.core.sense();
        self.core.find_rests();
        self.core.project();
        if self.core.windows.is_empty() {
            return;
        }
        if self.first > 0 {
            self.fit_first();
        } else {
            self.begins = false;
            self.core.weigh(theta);
            self.smooth_near(theta);
        }
    }

    fn replaced(&self) -> u32 {
        self.core.repair.replaced()
    }

    fn suspect(&self, index: usize) -> Option<Suspect<'_>> {
        self.core.suspects.describe(index, self.core.plant.input_unit())
    }

    fn clear(&mut self) {
        self.core.clear();
    }

    fn reset(&mut self) {
        self.core.reset();
    }
}
