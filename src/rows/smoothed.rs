//! The simple fallback: smooth the signals, evaluate the residual sample by sample, and average
//! residual and regressor over windows.
//!
//! ```text
//! x̂, x̂′, x̂″, x̂‴     of q at every sample, from a polynomial of order 5 fitted to its neighbours
//! f_i(θ) = Σ_k ψ_i(k) f(x̂_k, u_k; θ)      φ_i(θ) = Σ_k ψ_i(k) φ(x̂_k; θ)        ψ the bump of the projected form, d = 0
//! ```
//!
//! It accepts any [`PointwiseModel`], including residuals that are not a sum of time derivatives of
//! terms without acceleration, as the projected form requires. It differentiates the measured
//! positions up to three times, so it needs finer encoders for the same result. Averaging removes
//! the noise above the window's bandwidth from regressors and residuals; without it the bias of
//! least squares is too large for use. Rows are not whitened: the noise of windows that overlap by
//! half is nearly independent, but with more overlap the standard deviations are too small.
//!
//! The obvious first attempts, smoothing with one-sided neighbourhoods and rows without averaging,
//! are included ([`Smoothing`], `window_s = 0`) for comparison; docs/encoder-results.md has the
//! figures.

use super::SampleBlock;
use super::kernel::{InputTiming, Kernels};
use super::projected::ProjectedError;
use super::smoothing::{one_sided, savitzky_golay};
use crate::estimator::Residuals;
use crate::model::{JointSample, MAX_PARAMS, PointwiseModel};

/// The neighbours from which a derivative is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Smoothing {
    /// Equally many on either side: no delay relative to the input.
    ZeroPhase,
    /// Past samples only, as in a control loop.
    Causal,
}

/// How samples become smoothed rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothedOptions {
    /// h \[s\], > 0.
    pub sample_period_s: f64,
    /// Samples on either side that the smoothing uses, 3 to 100; twice as many past ones if it
    /// is causal.
    pub half_width: usize,
    /// Zero-phase or causal.
    pub smoothing: Smoothing,
    /// T of the averaging window \[s\], 8 to 2000 sample periods; 0 for one row per sample.
    pub window_s: f64,
    /// Time from one window to the next \[s\], one sample period to T.
    pub stride_s: f64,
    /// Behaviour of the input between samples; a held one acts half a sample late and is averaged
    /// with the sample before.
    pub timing: InputTiming,
}

impl SmoothedOptions {
    /// Windows of 100 ms every 50 ms at 1 kHz, derivatives from 21 samples.
    pub fn recommended() -> Self {
        Self {
            sample_period_s: 1e-3,
            half_width: 10,
            smoothing: Smoothing::ZeroPhase,
            window_s: 0.1,
            stride_s: 0.05,
            timing: InputTiming::Held,
        }
    }

    fn validate(&self) -> Result<(), ProjectedError> {
        let check = |field, expected, got: f64, good: bool| {
            if good {
                Ok(())
            } else {
                Err(ProjectedError::Value { field, expected, got })
            }
        };
        let (h, t) = (self.sample_period_s, self.window_s);
        check("sample_period_s", "1e-6 to 1", h, (1e-6..=1.0).contains(&h))?;
        let half_width = self.half_width;
        check(
            "half_width",
            "3 to 100",
            half_width as f64,
            (3..=100).contains(&half_width),
        )?;
        if t != 0.0 {
            check(
                "window_s",
                "0, or 8 to 2000 sample periods",
                t,
                (7.999..=2000.001).contains(&(t / h)),
            )?;
            let stride = self.stride_s;
            let good = (0.999..=t / h + 0.001).contains(&(stride / h));
            check("stride_s", "one sample period to window_s", stride, good)?;
        }
        Ok(())
    }
}

/// A window of the open block: position of its centre among the samples kept, and its first and
/// last instant.
#[derive(Debug, Clone, Copy)]
struct Window {
    centre: usize,
    start_ns: u64,
    end_ns: u64,
}

/// A block of samples as smoothed rows, see the head of this file.
#[derive(Debug, Clone)]
pub struct SmoothedBlock<M: PointwiseModel> {
    model: M,
    options: SmoothedOptions,
    joints: usize,
    /// Weights of the derivatives 0 to 3 on the neighbours.
    weights: [Vec<f64>; 4],
    /// Neighbours before and after a sample.
    before: usize,
    after: usize,
    bump: Vec<f64>,
    stride: i64,
    history: usize,
    samples: Vec<JointSample>,
    t_ns: Vec<u64>,
    features: Vec<M::Features>,
    len: usize,
    segment: usize,
    /// Grid number of position 0, for positions from `segment` on.
    offset: i64,
    windows: Vec<Window>,
}

impl<M: PointwiseModel> SmoothedBlock<M> {
    /// An empty block for up to `block_len` samples of `joints` joints. Only this call allocates.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(model: M, joints: usize, options: SmoothedOptions, block_len: usize) -> Result<Self, ProjectedError> {
        options.validate()?;
        let h = options.sample_period_s;
        let half = options.half_width;
        let (before, after) = match options.smoothing {
            Smoothing::ZeroPhase => (half, half),
            Smoothing::Causal => (2 * half, 0),
        };
        let weights = [0usize, 1, 2, 3].map(|derivative| {
            let weights = match options.smoothing {
                Smoothing::ZeroPhase => savitzky_golay(half, 5, derivative),
                Smoothing::Causal => one_sided(2 * half, 5, derivative),
            };
            // at least six neighbours determine a polynomial of order 5
            let scale = h.powi(derivative as i32);
            weights.unwrap_or_default().iter().map(|w| w / scale).collect()
        });
        let window_half = (0.5 * options.window_s / h).round() as usize;
        let (bump, stride) = if window_half == 0 {
            (vec![1.0], 1)
        } else {
            let kernels = Kernels::new(window_half, h, 1, InputTiming::Held, 0.0);
            (kernels.position[0].clone(), (options.stride_s / h).round() as usize)
        };
        let history = bump.len() + before + after + 1;
        let capacity = history + block_len;
        Ok(Self {
            samples: vec![JointSample::default(); capacity],
            t_ns: vec![0; capacity],
            features: vec![M::Features::default(); capacity],
            windows: Vec::with_capacity(capacity / stride + 2),
            model,
            options,
            joints,
            weights,
            before,
            after,
            bump,
            stride: stride as i64,
            history,
            len: 0,
            segment: 0,
            offset: 0,
        })
    }

    /// Derivatives and features of the sample at `at`, whose neighbours are known.
    fn smooth(&mut self, at: usize) {
        let mut smoothed = self.samples[at];
        let neighbours = &self.samples[at - self.before..=at + self.after];
        for joint in 0..self.joints {
            let derivative = |d: usize| -> f64 {
                let weights = self.weights[d].iter();
                weights.zip(neighbours).map(|(w, sample)| w * sample.q[joint]).sum()
            };
            (smoothed.q[joint], smoothed.dq[joint]) = (derivative(0), derivative(1));
            (smoothed.ddq[joint], smoothed.dddq[joint]) = (derivative(2), derivative(3));
            if self.options.timing == InputTiming::Held {
                smoothed.input[joint] = 0.5 * (self.samples[at - 1].input[joint] + smoothed.input[joint]);
            }
        }
        self.features[at] = self.model.features(&smoothed);
    }
}

impl<M: PointwiseModel> Residuals for SmoothedBlock<M> {
    fn len(&self) -> usize {
        self.windows.len()
    }

    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        let half = self.bump.len() / 2;
        let first = self.windows[index].centre - half;
        regressor.fill(0.0);
        let mut buffer = [0.0; MAX_PARAMS];
        let own = &mut buffer[..regressor.len()];
        let mut sum = 0.0;
        for (weight, features) in self.bump.iter().zip(&self.features[first..]) {
            sum += weight * self.model.row(equation, features, theta, own);
            for (total, phi) in regressor.iter_mut().zip(own.iter()) {
                *total += weight * phi;
            }
        }
        sum
    }

    fn span(&self, index: usize) -> (u64, u64) {
        (self.windows[index].start_ns, self.windows[index].end_ns)
    }
}

impl<M: PointwiseModel> SampleBlock for SmoothedBlock<M> {
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        if self.len == self.samples.len() {
            return false;
        }
        let period_ns = self.options.sample_period_s * 1e9;
        let at = self.len;
        if at == 0 {
            self.offset = (t_ns as f64 / period_ns).round() as i64;
            self.segment = 0;
        } else {
            let periods = (t_ns as f64 - self.t_ns[at - 1] as f64) / period_ns;
            if !(0.5..1.5).contains(&periods) {
                // a hole, or a clock that went back
                self.segment = at;
                self.offset += (periods.round() as i64 - 1).max(0);
            }
        }
        self.samples[at] = *sample;
        self.t_ns[at] = t_ns;
        self.len += 1;
        let known = at - self.segment;
        // a held input needs the sample before, which is within the smoothing of at least three
        if known >= self.before + self.after {
            self.smooth(at - self.after);
        }
        let half = self.bump.len() / 2;
        if known + 1 >= self.before + self.after + self.bump.len() {
            let centre = at - self.after - half;
            let on_grid = (self.offset + centre as i64).rem_euclid(self.stride) == 0;
            if on_grid && self.windows.len() < self.windows.capacity() {
                self.windows.push(Window {
                    centre,
                    start_ns: self.t_ns[centre - half],
                    end_ns: self.t_ns[centre + half],
                });
            }
        }
        true
    }

    fn clear(&mut self) {
        let kept = (self.len - self.segment).min(self.history);
        let from = self.len - kept;
        self.samples.copy_within(from..from + kept, 0);
        self.t_ns.copy_within(from..from + kept, 0);
        self.features.copy_within(from..from + kept, 0);
        self.offset += from as i64;
        (self.segment, self.len) = (0, kept);
        self.windows.clear();
    }

    fn reset(&mut self) {
        (self.segment, self.len) = (0, 0);
        self.windows.clear();
    }
}
