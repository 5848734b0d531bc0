//! Short windows at the end of a block: what the last regular windows cannot see yet.
//!
//! ```text
//! f_k(θ) = s ∫ψ_k u − Σ_d (−1)^d ∫ψ_k^(d) g_d(q, q̇; θ)        ψ_k: W/2, W/4, W/8 to either side instead of W
//! var f_k = Σ c_k² σ_q² + s² σ_u² Σ w_k² + what jumps and repaired inputs add
//! ```
//!
//! A window weights its middle, so a plant that changes some 80 ms before a block ends shows in none of them. Short windows are too noisy to estimate
//! from, but a residual of many of their standard deviations tells that the block's estimate no longer holds at its end. They end at the last
//! sample that has a velocity and serve the fit statistic only (`estimator/fit_statistic.rs`).

use super::error_weights::ErrorWeights;
use super::kernel::{InputTiming, Kernels, dot};
use super::separation::{MAX_ORDER, Separation, partials};
use crate::model::{MAX_JOINTS, Plant};

/// Windows per equation.
pub(super) const COUNT: usize = 3;
/// The shortest half width in samples.
const SHORTEST: usize = 8;

/// The short windows of a block.
#[derive(Debug, Clone)]
pub(super) struct Tail {
    kernels: Vec<Kernels>,
    /// Y₀ times the input's scale and the factors of the monomials \[equation\]\[window\].
    input: Vec<[f64; COUNT]>,
    factors: Vec<Vec<[f64; COUNT]>>,
    /// Variance of each residual; 0 if the window says nothing.
    variance: Vec<[f64; COUNT]>,
    // scratch
    weights: Vec<f64>,
    slopes: Vec<[f64; MAX_ORDER + 1]>,
}

/// The block that windows end, borrowed.
pub(super) struct Ending<'a, P> {
    pub plant: &'a P,
    pub separation: &'a Separation,
    pub velocity_weights: &'a [f64],
    pub q: &'a [Vec<f64>],
    pub dq: &'a [Vec<f64>],
    pub q_std: &'a [Vec<f64>],
    pub u: &'a [Vec<f64>],
    pub features: &'a [Vec<f64>],
    pub jumps: &'a [Vec<(usize, f64)>],
    pub surplus: &'a [Vec<(usize, f64)>],
    /// Buffer positions that follow the last hole.
    pub samples: std::ops::Range<usize>,
    /// Standard deviation of each input.
    pub input_std: [f64; MAX_JOINTS],
}

impl Tail {
    /// Windows beside regular ones of `half` samples to either side.
    pub fn new(
        separation: &Separation,
        (half, velocity_half, joints): (usize, usize, usize),
        (period_s, timing, delay_s): (f64, InputTiming, f64),
        order: usize,
    ) -> Self {
        let kernels: Vec<Kernels> = [2, 4, 8]
            .map(|part| Kernels::new((half / part).max(SHORTEST), period_s, order, timing, delay_s))
            .into();
        let equations = separation.equations.len();
        let widest = kernels[0].half + velocity_half;
        Self {
            input: vec![[0.0; COUNT]; equations],
            factors: (0..equations)
                .map(|e| vec![[0.0; COUNT]; separation.equations[e].as_ref().map_or(0, |p| p.monomials.len())])
                .collect(),
            variance: vec![[0.0; COUNT]; equations],
            weights: vec![0.0; (2 * widest + 1) * joints],
            slopes: vec![[0.0; MAX_ORDER + 1]; (2 * kernels[0].half + 1) * 2 * joints],
            kernels,
        }
    }

    /// Nothing is known of the end.
    pub fn clear(&mut self) {
        self.variance.fill([0.0; COUNT]);
    }

    /// Projects the end of a block; θ is that of the weights.
    pub fn project<P: Plant>(&mut self, end: &Ending<'_, P>, theta: &[f64]) {
        self.clear();
        let Self {
            kernels,
            input: moments,
            factors,
            variance: variances,
            weights,
            slopes,
        } = self;
        let velocity_half = end.velocity_weights.len() / 2;
        for e in 0..moments.len() {
            let form = &end.plant.equations()[e];
            let Some(polynomial) = &end.separation.equations[e] else {
                continue;
            };
            let (input, scale) = (form.input, form.input_scale);
            for k in 0..COUNT {
                let kernels = &kernels[k];
                let reach = kernels.half + velocity_half;
                let span = 2 * reach.max(kernels.input_half) + 1;
                if end.samples.len() <= span + 5 {
                    continue;
                }
                let centre = end.samples.end - 1 - reach.max(kernels.input_half);
                let from = centre - kernels.input_half;
                let u = &end.u[input][from..=centre + kernels.input_half];
                let within = |jumps: &[(usize, f64)], weights: &[f64], add: &mut dyn FnMut(f64, f64)| {
                    for &(at, value) in jumps {
                        if let Some(weight) = at.checked_sub(from).and_then(|i| weights.get(i)) {
                            add(*weight, value);
                        }
                    }
                };
                let mut moment = dot(&kernels.input[0], u);
                let mut variance = end.input_std[input].powi(2) * dot(&kernels.input[0], &kernels.input[0]);
                within(&end.jumps[input], &kernels.jump[0], &mut |weight, size| {
                    moment += weight * size;
                    variance += weight * weight * (5.0 * end.input_std[input].powi(2) + 1e-6 * size * size);
                });
                within(&end.surplus[input], &kernels.input[0], &mut |weight, more| {
                    variance += weight * weight * more;
                });
                moments[e][k] = scale * moment;
                let samples = centre - kernels.half..centre + kernels.half + 1;
                for factor in &mut factors[e] {
                    factor[k] = 0.0;
                }
                for term in &polynomial.velocity {
                    let weights = &kernels.position[term.derivative + 1];
                    let q = &end.q[term.joint][samples.clone()];
                    factors[e][term.monomial][k] += term.coefficient * dot(weights, q);
                }
                for term in &polynomial.features {
                    let feature = &end.features[term.feature][samples.clone()];
                    factors[e][term.monomial][k] += dot(&kernels.position[term.derivative], feature);
                }
                let positions = position_variance(end, e, kernels, centre, theta, (weights, slopes));
                variances[e][k] = scale * scale * variance + positions;
            }
        }
    }

    /// Residual of window k at θ in its standard deviations; `None` if the window says nothing.
    pub fn residual(&self, separation: &Separation, e: usize, k: usize, theta: &[f64]) -> Option<f64> {
        let variance = *self.variance.get(e)?.get(k)?;
        let polynomial = separation.equations[e].as_ref()?;
        if !(variance > 0.0 && variance.is_finite()) {
            return None;
        }
        let explained: f64 = polynomial
            .monomials
            .iter()
            .zip(&self.factors[e])
            .map(|(monomial, factor)| monomial.value(theta) * factor[k])
            .sum();
        Some((self.input[e][k] - explained) / variance.sqrt())
    }
}

/// Σ c² σ_q² of one window.
fn position_variance<P: Plant>(
    end: &Ending<'_, P>,
    e: usize,
    kernels: &Kernels,
    centre: usize,
    theta: &[f64],
    (room, slopes): (&mut [f64], &mut [[f64; MAX_ORDER + 1]]),
) -> f64 {
    let (joints, length) = (end.q.len(), 2 * kernels.half + 1);
    let sensitivity = &end.separation.sensitivities[e];
    let polynomial = end.separation.equations[e].as_ref();
    let weights = ErrorWeights {
        kernels,
        velocity_weights: end.velocity_weights,
        polynomial,
        sensitivity,
        order: end.plant.equations()[e].order,
    };
    let first = centre - kernels.half;
    for (joint, velocity) in sensitivity.kinds() {
        let linear = weights.linear_in_velocity(joint, velocity, theta);
        for i in 0..length {
            let mut q = [0.0; MAX_JOINTS];
            let mut dq = [0.0; MAX_JOINTS];
            for j in 0..joints {
                (q[j], dq[j]) = (end.q[j][first + i], end.dq[j][first + i]);
            }
            let all = partials(end.plant, e, &q, &dq, theta, joint, velocity);
            slopes[(2 * joint + usize::from(velocity)) * length + i] = ErrorWeights::nonlinear(all, &linear);
        }
    }
    let support = weights.support();
    let c = &mut room[..support * joints];
    weights.write(
        theta,
        |joint, velocity, i| slopes[(2 * joint + usize::from(velocity)) * length + i],
        c,
    );
    let start = first - end.velocity_weights.len() / 2;
    let mut variance = 0.0;
    for (joint, c) in c.chunks_exact(support).enumerate() {
        let std = &end.q_std[joint][start..start + support];
        variance += c.iter().zip(std).map(|(c, s)| (c * s).powi(2)).sum::<f64>();
    }
    variance
}
