//! Errors that a machine may have and its model leaves out: one column of the rows per error.
//!
//! ```text
//! f_i(θ*) = noise + Σ_s a_s d_is      d_is = ∂f_i/∂a_s, the machine has error s with amplitude a_s
//! ```
//!
//! | error | column, before it is whitened as the rows are | amplitude a |
//! |---|---|---|
//! | the recorded input acts later than specified | −s ∫ψ′ u, the first power of the delay (`kernel.rs`) | s |
//! | the drive gives more than specified | −s ∫ψ u | share |
//! | Coulomb friction that the model lacks | s ∫ψ sat(q̇/v₀) u_r | share of the input's size u_r |
//! | an encoder off its centre, q + a sin q or a cos q is read | Σ_k ∂f_i/∂q_k sin q_k, or cos q_k | rad |
//! | a resonance between motor and load | s ∫ψ″ u | s² |
//! | an encoder's zero, or gravity's direction: q + a is read | Σ_k ∂f_i/∂q_k | rad |
//!
//! u_r is the largest root mean square of a block's input so far, so that one default fits drives
//! of any voltage. sat is sign with a straight piece of three standard deviations of the velocity's
//! noise: at rest friction may have either sign, and noise has both. A flexible joint gives u (1 +
//! s²/ω_a²) = (1 + s²/ω_r²)·(the rigid terms), so to first order in 1/ω² its rigid model is off by
//! (1/ω_r² − 1/ω_a²) s² u: the second derivative of the input, whatever the equation is.
//!
//! The estimator widens its published covariance by what the data leave open of the errors that
//! have a prior standard deviation ([`Considered`]), and tests for all of them
//! (`estimator/considered.rs`, `estimator/score_test.rs`). Neither estimates them.

use super::kernel::{Kernels, dot};
use super::trajectory::Trajectory;
use super::whitening::{Direction, Whitening};
use crate::estimator::ERRORS_PER_EQUATION;
use crate::model::{MAX_JOINTS, Plant};
use std::f64::consts::TAU;
use std::fmt;

/// Standard deviations of errors that are not estimated but widen the estimate's by what they could
/// do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Considered {
    /// Further delay of the recorded input \[s\], ≥ 0.
    pub input_delay_s: f64,
    /// Gain of each drive, relative, ≥ 0.
    pub gain: f64,
    /// Coulomb friction at each joint whose model has none, as a share of the largest root mean
    /// square of its input so far, ≥ 0.
    pub coulomb: f64,
    /// Natural frequency of the flexibility between each motor and its load \[Hz\], one standard
    /// deviation of 1/(2π f)²; 0 for rigid joints.
    pub resonance_hz: f64,
    /// Rate at which each parameter may change \[1/s\], relative to the parameter, ≥ 0; it has no
    /// column, the estimator makes one.
    pub drift_per_s: f64,
    /// Zero of each encoder \[rad\], ≥ 0: an error of the angle against gravity and the links,
    /// which a tilted base causes, too.
    pub zero_rad: f64,
    /// Eccentricity of each encoder \[rad\], ≥ 0: the amplitude of an error of one period per turn.
    /// `None` if joints move along lines.
    pub eccentricity_rad: Option<f64>,
}

impl Considered {
    /// Nothing is considered; errors are tested for all the same.
    pub const NONE: Self = Self {
        input_delay_s: 0.0,
        gain: 0.0,
        coulomb: 0.0,
        resonance_hz: 0.0,
        drift_per_s: 0.0,
        zero_rad: 0.0,
        eccentricity_rad: Some(0.0),
    };

    /// The same for joints that move along lines, whose sensors have no turn.
    #[must_use]
    pub fn without_turns(self) -> Self {
        Self {
            zero_rad: 0.0,
            eccentricity_rad: None,
            ..self
        }
    }
}

impl Default for Considered {
    /// What a good installation leaves. Delay: 40 µs, a fraction of a sample at 1 kHz. Gain: 0,
    /// since parameters are in units of the drive as it reports itself. Coulomb friction: 1 % of
    /// the input. Resonance: 70 Hz. Drift: 0.6 % in a minute. Zero: 1 mrad, 0.06°. Eccentricity:
    /// 0.05 mrad, 10″. Motion that shows an error brings σ back to what it is without; motion that
    /// does not show it leaves σ at what the error may do.
    fn default() -> Self {
        Self {
            input_delay_s: 4e-5,
            gain: 0.0,
            coulomb: 1e-2,
            resonance_hz: 70.0,
            drift_per_s: 1e-4,
            zero_rad: 1e-3,
            eccentricity_rad: Some(5e-5),
        }
    }
}

/// Kinds of errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SuspectKind {
    /// The recorded input acts later, or earlier, than specified.
    InputDelay,
    /// A drive gives more, or less, than specified.
    Gain,
    /// Coulomb friction that the model lacks.
    Coulomb,
    /// An encoder off its centre.
    Eccentricity,
    /// A resonance that the model lacks.
    Resonance,
    /// The zero of an encoder, or the direction of gravity.
    Zero,
    /// A parameter that moves.
    Drift,
}

/// An error that the rows have a column for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suspect<'a> {
    /// What it is.
    pub kind: SuspectKind,
    /// The parameter that moves, if one does.
    pub parameter: Option<&'a str>,
    /// Joint, counted from 0; `None` for the whole machine.
    pub joint: Option<usize>,
    /// The estimator's amplitude times this is in `unit`.
    pub scale: f64,
    /// Unit of the amplitude.
    pub unit: &'a str,
}

impl Suspect<'_> {
    /// True if a machine can have the error with this amplitude of the estimator. A base that is
    /// tilted by 1e10 rad would explain whatever no other column does.
    pub fn is_possible(&self, amplitude: f64) -> bool {
        let most = match self.kind {
            SuspectKind::InputDelay => 0.1,   // s
            SuspectKind::Eccentricity => 0.1, // rad
            SuspectKind::Zero => 0.5,         // rad
            SuspectKind::Gain | SuspectKind::Coulomb => 1.0,
            SuspectKind::Resonance | SuspectKind::Drift => f64::INFINITY,
        };
        amplitude.abs() <= most
    }
}

impl fmt::Display for Suspect<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = match self.kind {
            SuspectKind::InputDelay => "an input delay",
            SuspectKind::Gain => "another drive gain",
            SuspectKind::Coulomb => "Coulomb friction",
            SuspectKind::Eccentricity => "an encoder off its centre",
            SuspectKind::Resonance => "a resonance",
            SuspectKind::Zero => "a tilted base or encoder zero",
            SuspectKind::Drift => "a drift",
        };
        f.write_str(words)?;
        if let Some(parameter) = self.parameter {
            write!(f, " of {parameter}")?;
        }
        match self.joint {
            Some(joint) => write!(f, " at joint {}", joint + 1),
            None => Ok(()),
        }
    }
}

/// Errors of each equation: gain, Coulomb friction, eccentricity in sine and cosine, resonance,
/// zero.
const PER_EQUATION: usize = ERRORS_PER_EQUATION;
/// Velocity noise, in standard deviations, within which a joint may stand still.
const STANDING: f64 = 3.0;

/// The columns of a block.
#[derive(Debug, Clone)]
pub(super) struct SuspectColumns {
    considered: Considered,
    /// The joint of each equation's input.
    inputs: Vec<usize>,
    /// Names of the parameters.
    parameters: Vec<String>,
    /// [equation][suspect][row], and whitened; empty if the suspect does not touch the equation.
    columns: Vec<Vec<Vec<f64>>>,
    white: Vec<Vec<Vec<f64>>>,
    /// Largest root mean square of each joint's input so far.
    sizes: [f64; MAX_JOINTS],
    /// sat(q̇/v₀), sin q and cos q per joint and sample; empty if no column needs them.
    signs: Vec<Vec<f64>>,
    turns: Vec<[Vec<f64>; 2]>,
    /// Root of the sum of squares of the velocity filter's weights.
    velocity_gain: f64,
}

impl SuspectColumns {
    /// Room for `rows` rows of samples in buffers of `capacity`.
    pub fn new(
        plant: &impl Plant,
        considered: Considered,
        velocity_weights: &[f64],
        moves: impl Fn(usize, usize) -> bool,
        rows: usize,
        capacity: usize,
    ) -> Self {
        let equations = plant.equations();
        let inputs: Vec<usize> = equations.iter().map(|e| e.input).collect();
        let count = 1 + PER_EQUATION * equations.len();
        let rubs: Vec<bool> = (0..equations.len()).map(|e| !has_jump(plant, e, inputs[e])).collect();
        let turns = considered.eccentricity_rad.is_some();
        let touches = |e: usize, suspect: usize| {
            if suspect == 0 {
                return plant.input_delay().is_none();
            }
            let of = (suspect - 1) / PER_EQUATION;
            match (suspect - 1) % PER_EQUATION {
                0 => of == e && considered.gain > 0.0,
                1 => of == e && rubs[e],
                // one encoder per joint, whatever its number of equations
                2 | 3 | 5 => turns && moves(e, inputs[of]) && !inputs[..of].contains(&inputs[of]),
                _ => of == e,
            }
        };
        let columns: Vec<Vec<Vec<f64>>> = (0..equations.len())
            .map(|e| {
                (0..count)
                    .map(|s| if touches(e, s) { vec![0.0; rows] } else { Vec::new() })
                    .collect()
            })
            .collect();
        let joints = plant.joints();
        Self {
            considered,
            parameters: plant.parameters().iter().map(|p| p.name.to_string()).collect(),
            white: columns.clone(),
            columns,
            sizes: [0.0; MAX_JOINTS],
            signs: (0..joints)
                .map(|j| match (0..inputs.len()).any(|e| inputs[e] == j && rubs[e]) {
                    true => vec![0.0; capacity],
                    false => Vec::new(),
                })
                .collect(),
            turns: (0..joints)
                .map(|j| match turns && inputs.contains(&j) {
                    true => [vec![0.0; capacity], vec![0.0; capacity]],
                    false => [Vec::new(), Vec::new()],
                })
                .collect(),
            velocity_gain: dot(velocity_weights, velocity_weights).sqrt(),
            inputs,
        }
    }

    /// Forgets the stream.
    pub fn reset(&mut self) {
        self.sizes = [0.0; MAX_JOINTS];
    }

    /// Number of errors, with those that no column shows.
    pub fn count(&self) -> usize {
        1 + PER_EQUATION * self.inputs.len()
    }

    /// Standard deviation of an error's amplitude, 0 if it is tested only.
    pub fn std(&self, suspect: usize) -> f64 {
        match self.kind(suspect) {
            SuspectKind::InputDelay => self.considered.input_delay_s,
            SuspectKind::Gain => self.considered.gain,
            SuspectKind::Coulomb => self.considered.coulomb,
            SuspectKind::Eccentricity => self.considered.eccentricity_rad.unwrap_or(0.0),
            SuspectKind::Resonance => match self.considered.resonance_hz {
                rigid if !(rigid > 0.0) => 0.0,
                hertz => (TAU * hertz).powi(-2),
            },
            SuspectKind::Zero => self.considered.zero_rad,
            SuspectKind::Drift => self.considered.drift_per_s,
        }
    }

    fn kind(&self, suspect: usize) -> SuspectKind {
        match suspect.checked_sub(1).map(|s| s % PER_EQUATION) {
            None => SuspectKind::InputDelay,
            Some(0) => SuspectKind::Gain,
            Some(1) => SuspectKind::Coulomb,
            Some(2 | 3) => SuspectKind::Eccentricity,
            Some(4) => SuspectKind::Resonance,
            Some(_) => SuspectKind::Zero,
        }
    }

    /// What an error is; beyond the last one, the drifts of the parameters.
    pub fn describe<'a>(&'a self, suspect: usize, input_unit: &'a str) -> Option<Suspect<'a>> {
        if let Some(drifting) = suspect.checked_sub(self.count()) {
            return self.parameters.get(drifting).map(|name| Suspect {
                kind: SuspectKind::Drift,
                parameter: Some(name),
                joint: None,
                scale: 1.0,
                unit: "1/s",
            });
        }
        let kind = self.kind(suspect);
        let joint = suspect.checked_sub(1).map(|s| self.inputs[s / PER_EQUATION]);
        let (scale, unit) = match (kind, joint) {
            (SuspectKind::Coulomb, Some(joint)) => (self.sizes[joint], input_unit),
            (SuspectKind::InputDelay, _) => (1.0, "s"),
            (SuspectKind::Eccentricity | SuspectKind::Zero, _) => (1.0, "rad"),
            (SuspectKind::Resonance, _) => (1.0, "s^2"),
            _ => (1.0, "1"),
        };
        Some(Suspect {
            kind,
            parameter: None,
            joint,
            scale,
            unit,
        })
    }

    /// Writes d of a whitened row over all errors.
    #[inline]
    pub fn row(&self, equation: usize, row: usize, out: &mut [f64]) {
        for (d, column) in out.iter_mut().zip(&self.white[equation]) {
            *d = column.get(row).copied().unwrap_or(0.0);
        }
    }

    /// Prepares the first `len` samples of a block; `q_std` are the standard deviations of the
    /// positions.
    pub fn sense(&mut self, len: usize, signals: &Trajectory, q_std: &[Vec<f64>]) {
        for joint in 0..self.signs.len() {
            let u = &signals.u[joint][..len];
            let size = (dot(u, u) / len.max(1) as f64).sqrt();
            self.sizes[joint] = self.sizes[joint].max(size);
            if !self.signs[joint].is_empty() {
                let velocity = signals.dq[joint].iter().zip(&q_std[joint]);
                for (sign, (dq, q_std)) in self.signs[joint][..len].iter_mut().zip(velocity) {
                    let standing = STANDING * self.velocity_gain * q_std;
                    *sign = (dq / standing.max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0);
                }
            }
            let [sines, cosines] = &mut self.turns[joint];
            let mut turned = Turned::default();
            for ((sine, cosine), q) in sines.iter_mut().zip(cosines).zip(&signals.q[joint][..len]) {
                (*sine, *cosine) = turned.to(*q);
            }
        }
    }

    /// Projects what depends on the input and on the sign of the velocity: one row. `moments` are
    /// ∫ψ^(r) u with the input's scale.
    pub fn project(&mut self, e: usize, row: usize, centre: usize, scale: f64, kernels: &Kernels, moments: [f64; 3]) {
        let own = 1 + PER_EQUATION * e;
        let columns = &mut self.columns[e];
        let mut put = |suspect: usize, value: f64| {
            if let Some(entry) = columns[suspect].get_mut(row) {
                *entry = value;
            }
        };
        put(0, -moments[1]);
        put(own, -moments[0]);
        put(own + 4, moments[2]);
        let joint = self.inputs[e];
        if let Some(signs) = self.signs[joint].get(centre - kernels.half..=centre + kernels.half) {
            put(own + 1, scale * self.sizes[joint] * dot(&kernels.position[0], signs));
        }
    }

    /// What eccentricities and zeros do to a row: `c` holds −∂f/∂q of `support` positions per joint
    /// from buffer position `first` on.
    pub fn turn(&mut self, e: usize, row: usize, c: &[f64], support: usize, first: usize) {
        for of in 0..self.inputs.len() {
            let joint = self.inputs[of];
            let own = &c[joint * support..(joint + 1) * support];
            let turns = self.turns[joint]
                .each_ref()
                .map(|turn| turn.get(first..first + support));
            let [Some(sines), Some(cosines)] = turns else {
                continue;
            };
            let sums = along(own, sines, cosines);
            let columns = &mut self.columns[e][1 + PER_EQUATION * of..];
            for (at, sum) in [2, 3, 5].into_iter().zip(sums) {
                if let Some(entry) = columns[at].get_mut(row) {
                    *entry = -sum;
                }
            }
        }
    }

    /// Whitens the columns of an equation.
    pub fn whiten(&mut self, e: usize, rows: usize, whitening: &Whitening) {
        for (white, raw) in self.white[e].iter_mut().zip(&self.columns[e]) {
            if !raw.is_empty() {
                white[..rows].copy_from_slice(&raw[..rows]);
                whitening.apply(Direction::Backward, &mut white[..rows]);
            }
        }
    }
}

/// Σ c sin q, Σ c cos q and Σ c in one pass.
fn along(c: &[f64], sines: &[f64], cosines: &[f64]) -> [f64; 3] {
    const LANES: usize = 4;
    let mut sums = [[0.0; LANES]; 3];
    let mut add = |lane: usize, c: f64, sine: f64, cosine: f64| {
        sums[0][lane] += c * sine;
        sums[1][lane] += c * cosine;
        sums[2][lane] += c;
    };
    let chunks = c
        .chunks_exact(LANES)
        .zip(sines.chunks_exact(LANES))
        .zip(cosines.chunks_exact(LANES));
    for ((c, sines), cosines) in chunks {
        (0..LANES).for_each(|lane| add(lane, c[lane], sines[lane], cosines[lane]));
    }
    for k in c.len() - c.len() % LANES..c.len() {
        add(0, c[k], sines[k], cosines[k]);
    }
    sums.map(|lanes| lanes.iter().sum())
}

/// Sine and cosine of an angle that changes little from sample to sample.
///
/// ```text
/// sin(q + δ) = sin q cos δ + cos q sin δ        cos(q + δ) = cos q cos δ − sin q sin δ
/// ```
///
/// with the series of sin δ and cos δ up to δ⁵: from the library's functions, they took a tenth of
/// a block.
#[derive(Debug, Default)]
struct Turned {
    q: f64,
    sine: f64,
    cosine: f64,
    steps: usize,
}

impl Turned {
    /// Steps after which rounding is cut off by the library's functions.
    const STEPS: usize = 64;
    /// Largest step \[rad\]: δ⁶/6! is 2e-11 there.
    const LARGEST: f64 = 0.05;

    #[inline]
    fn to(&mut self, q: f64) -> (f64, f64) {
        let step = q - self.q;
        self.q = q;
        if self.steps == 0 || !(step.abs() <= Self::LARGEST) {
            (self.sine, self.cosine) = q.sin_cos();
            self.steps = Self::STEPS;
        } else {
            let square = step * step;
            let sine = step * (1.0 - square / 6.0 * (1.0 - square / 20.0));
            let cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0);
            (self.sine, self.cosine) = (
                self.sine * cosine + self.cosine * sine,
                self.cosine * cosine - self.sine * sine,
            );
            self.steps -= 1;
        }
        (self.sine, self.cosine)
    }
}

/// True if an equation jumps as a joint begins to move: the model has Coulomb friction, or
/// something like it.
fn has_jump(plant: &impl Plant, equation: usize, joint: usize) -> bool {
    let theta: Vec<f64> = plant
        .parameters()
        .iter()
        .map(|p| if p.start != 0.0 { p.start } else { 1.0 })
        .collect();
    let order = plant.equations()[equation].order;
    let step = |speed: f64| {
        let side = |speed: f64| {
            let (q, mut dq) = ([0.3; MAX_JOINTS], [0.0; MAX_JOINTS]);
            dq[joint] = speed;
            let mut g = [0.0; 8];
            let joints = plant.joints();
            plant.terms::<f64>(equation, &q[..joints], &dq[..joints], &theta, &mut g[..=order]);
            g[0]
        };
        (side(speed) - side(-speed)).abs()
    };
    // what is continuous shrinks with the speed
    step(1e-9) > 1e-3 * step(1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_base_that_is_turned_round_and_round_is_no_cause() {
        let tilted = Suspect {
            kind: SuspectKind::Zero,
            parameter: None,
            joint: Some(0),
            scale: 1.0,
            unit: "rad",
        };
        assert!(tilted.is_possible(-0.02));
        assert!(!tilted.is_possible(1.1e10) && !tilted.is_possible(f64::NAN));
    }

    #[test]
    fn val_an_angle_that_turns_has_the_sine_of_the_library() {
        let mut turned = Turned::default();
        // slow, fast, jumps and a wide swing; not a number stays one and spoils nothing after it
        for k in 0..4000 {
            let t = f64::from(k);
            let q = 3.0 * (2e-3 * t).sin() + 0.04 * t + if k > 1000 { 2.0 } else { 0.0 };
            let q = if k == 2000 { f64::NAN } else { q };
            let (sine, cosine) = turned.to(q);
            // 64 steps of δ⁶/6! at δ = 0.046
            let limit = 64.0 * 0.046_f64.powi(6) / 720.0;
            let off = (sine - q.sin()).abs().max((cosine - q.cos()).abs());
            assert!(off <= limit || q.is_nan(), "{k}: {off}");
        }
    }
}
