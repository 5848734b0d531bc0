//! The Cramér–Rao bound of a robot of N joints, along the true motion of a run.
//!
//! ```text
//! M(q) q̈ = u + w − Y(q, q̇, q̈) θ + M q̈,   dz/dt = (q̇ − |q̇| z)/δ,   y = q + e                    (1)
//! S ← F S + F_θ,   P ← F P Fᵀ + G R_w Gᵀ                     from sample to sample                (2)
//! C = P_qq + R_e,   Λ += S_qᵀ C⁻¹ S_q                        information of the innovations       (3)
//! K = P_xq C⁻¹,     S ← S − K S_q,   P ← P − K P_qx                                               (4)
//! Λ' += Σ_j y_j y_jᵀ/σ_j²                                    with exact positions                 (5)
//! ```
//!
//! The state is x = (q, q̇, z), z the engagement of friction, unknown at the start. The recorded
//! torque is the true one plus white noise w of variance R_w, which acts as process noise;
//! positions have the noise e of their rounding. S = ∂(x − x̂)/∂θ, x̂ the Kalman filter's
//! prediction: for a linear system with Gaussian noise Λ is the Fisher information of all
//! positions. F, G and F_θ are those of (1) along the true motion: with p = M⁻¹, ∂q̈/∂q = −p ∂ID/∂q
//! and likewise for q̇, ∂q̈/∂θ = −p Y, ID the inverse dynamics.
//!
//! The friction parameters are those of the simulated machine, f_c and ln δ; the model's f_r is f_c
//! (δ/δ_m − 1) with the configured δ_m, into which the last step converts them.
//!
//! Sources: R. Mehra, IEEE Trans. Automatic Control 15 (1970) for the innovations; H. Olsson et
//! al., European J. of Control 4 (1998) for z.

use crate::model::MAX_JOINTS;
use crate::robot::{
    BodyParameters, EnergyRegressors, Engagement, FrictionTerm, JointFriction, RobotModel, SimulatedDrive,
    inverse_dynamics,
};
use nalgebra::{DMatrix, SMatrix, SVector};

/// Steps of the sensitivities per sample, as in the simulator.
const SUBSTEPS: usize = 4;
/// Samples for which one linearisation of the rigid bodies is used.
const HELD: usize = 4;
/// Number of rows gathered before their squares are summed.
const GATHERED: usize = 384;
/// Standard deviations at the start of q \[rad\], q̇ \[rad/s\] and z.
const UNKNOWN: [f64; 3] = [1e-2, 0.1, 1.0];

/// The machine and its sensors.
#[derive(Debug, Clone)]
pub struct RobotTruth {
    /// The true bodies.
    pub bodies: Vec<BodyParameters>,
    /// The true drives.
    pub drives: Vec<SimulatedDrive>,
    /// True δ \[rad or m\].
    pub presliding: f64,
    /// Time from sample to sample \[s\].
    pub sample_period_s: f64,
    /// Standard deviation of the recorded torque of each joint \[N m or N\], > 0.
    pub torque_std: Vec<f64>,
    /// Standard deviation of the recorded position of each joint \[rad or m\], > 0.
    pub position_std: Vec<f64>,
}

/// A column of F, S, P or G.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Column<const N: usize> {
    q: SVector<f64, N>,
    v: SVector<f64, N>,
    z: SVector<f64, N>,
}

impl<const N: usize> Column<N> {
    fn zeros() -> Self {
        let zeros = SVector::zeros();
        Self {
            q: zeros,
            v: zeros,
            z: zeros,
        }
    }

    fn entry(&mut self, i: usize) -> &mut f64 {
        match i / N {
            0 => &mut self.q[i % N],
            1 => &mut self.v[i % N],
            _ => &mut self.z[i % N],
        }
    }
}

/// ∂q̈ of the rigid bodies with their viscous friction.
#[derive(Debug, Clone, Copy)]
struct Linearised<const N: usize> {
    by_q: SMatrix<f64, N, N>,
    by_v: SMatrix<f64, N, N>,
    /// p = M⁻¹ = ∂q̈/∂τ.
    by_torque: SMatrix<f64, N, N>,
}

/// ∂z after a step, with respect to z before it, the distance, and f_c ln δ.
#[derive(Debug, Clone, Copy)]
struct Reversal<const N: usize> {
    kept: SVector<f64, N>,
    by_way: SVector<f64, N>,
    by_presliding: SVector<f64, N>,
}

/// Squares of rows, summed many at a time.
#[derive(Debug, Clone)]
struct Squares {
    rows: DMatrix<f64>,
    used: usize,
    sum: DMatrix<f64>,
}

impl Squares {
    fn new(columns: usize) -> Self {
        Self {
            rows: DMatrix::zeros(GATHERED, columns),
            used: 0,
            sum: DMatrix::zeros(columns, columns),
        }
    }

    fn add(&mut self, row: impl Iterator<Item = f64>) {
        for (i, value) in row.enumerate() {
            self.rows[(self.used, i)] = value;
        }
        self.used += 1;
        if self.used == GATHERED {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let rows = self.rows.rows(0, self.used);
        self.sum += rows.tr_mul(&rows);
        self.used = 0;
    }
}

/// A true state, with the rows of the model there.
#[derive(Debug, Clone)]
struct At {
    q: [f64; MAX_JOINTS],
    dq: [f64; MAX_JOINTS],
    engagement: [Engagement; MAX_JOINTS],
    /// d and c of the model's rows.
    differentiated: Vec<f64>,
    direct: Vec<f64>,
}

/// The recursion, which processes the true states of a run in order.
#[derive(Debug, Clone)]
pub struct RobotBound<'a, const N: usize> {
    model: &'a RobotModel,
    truth: RobotTruth,
    friction: JointFriction,
    regressors: EnergyRegressors,
    last: Option<At>,
    samples: usize,
    linearised: Linearised<N>,
    covariance: Vec<Column<N>>,
    sensitivity: Vec<Column<N>>,
    information: Squares,
    exact: Squares,
}

impl<'a, const N: usize> RobotBound<'a, N> {
    /// For a model of N joints; `None` if it has another number.
    pub fn new(model: &'a RobotModel, truth: RobotTruth) -> Option<Self> {
        let lengths = [
            model.robot().len(),
            truth.bodies.len(),
            truth.drives.len(),
            truth.torque_std.len(),
            truth.position_std.len(),
        ];
        if lengths != [N; 5] {
            return None;
        }
        let count = model.parameters().len();
        let covariance = (0..3 * N).map(|i| {
            let mut column = Column::zeros();
            *column.entry(i) = UNKNOWN[i / N].powi(2);
            column
        });
        let [by_q, by_v, by_torque] = [SMatrix::zeros(); 3];
        Some(Self {
            friction: JointFriction {
                presliding: truth.presliding,
                ..JointFriction::default()
            },
            regressors: EnergyRegressors::new(N),
            last: None,
            samples: 0,
            linearised: Linearised { by_q, by_v, by_torque },
            covariance: covariance.collect(),
            sensitivity: vec![Column::zeros(); count],
            information: Squares::new(count),
            exact: Squares::new(count),
            model,
            truth,
        })
    }

    /// Takes the true positions and velocities at the next sample.
    pub fn advance(&mut self, q: &[f64; MAX_JOINTS], dq: &[f64; MAX_JOINTS]) {
        let mut engagement = [Engagement::default(); MAX_JOINTS];
        if let Some(last) = &self.last {
            for i in 0..N {
                engagement[i] = self.friction.engagement(q[i] - last.q[i], last.engagement[i]);
            }
        }
        let entries = self.model.row_entries();
        let mut now = At {
            q: *q,
            dq: *dq,
            engagement,
            differentiated: vec![0.0; entries],
            direct: vec![0.0; entries],
        };
        let (d, c) = (&mut now.differentiated, &mut now.direct);
        self.model
            .rows(&mut self.regressors, &q[..N], &dq[..N], &engagement[..N], d, c);
        if let Some(last) = self.last.take() {
            self.propagate(&last, &now);
        }
        self.measure();
        self.last = Some(now);
    }

    /// (2) and (5) from one sample to the next.
    fn propagate(&mut self, last: &At, now: &At) {
        let h = self.truth.sample_period_s;
        if self.samples.is_multiple_of(HELD) {
            self.linearise(last, now);
        }
        self.samples += 1;
        let p = self.linearised.by_torque;
        let mut rows = vec![SVector::<f64, N>::zeros(); self.sensitivity.len()];
        let mut at = 0;
        for joint in 0..N {
            for &column in self.model.columns(joint) {
                let rate = (now.differentiated[at] - last.differentiated[at]) / h;
                rows[column][joint] = rate + 0.5 * (last.direct[at] + now.direct[at]);
                at += 1;
            }
            let std = self.truth.torque_std[joint];
            self.exact.add(rows.iter().map(|row| row[joint] / std)); // (5)
        }
        // f_r acts through z, not at once
        let mut reversals = vec![None; rows.len()];
        for joint in 0..N {
            if let Some(index) = self.model.friction_term(joint, FrictionTerm::Reversal) {
                rows[index].fill(0.0);
                reversals[index] = Some(joint);
            }
        }
        let parts = self.parts(last, now);
        let mut input = [Column::<N>::zeros(); N];
        for part in &parts {
            for ((column, row), joint) in self.sensitivity.iter_mut().zip(&rows).zip(&reversals) {
                self.linearised.step(&self.truth, part, &-(p * row), column); // (2)
                if let Some(joint) = *joint {
                    column.z[joint] += part.by_presliding[joint];
                }
            }
            for (joint, column) in input.iter_mut().enumerate() {
                self.linearised.step(&self.truth, part, &p.column(joint).into(), column);
            }
        }
        // F P, and then its transpose P Fᵀ in the same way
        for _ in 0..2 {
            for column in &mut self.covariance {
                for part in &parts {
                    self.linearised.step(&self.truth, part, &SVector::zeros(), column);
                }
            }
            self.transpose();
        }
        for (joint, g) in input.iter_mut().enumerate() {
            let variance = self.truth.torque_std[joint].powi(2);
            for (i, column) in self.covariance.iter_mut().enumerate() {
                let factor = variance * *g.entry(i);
                column.q += g.q * factor; // (2)
                column.v += g.v * factor;
                column.z += g.z * factor;
            }
        }
    }

    fn transpose(&mut self) {
        for i in 0..3 * N {
            for j in 0..i {
                let lower = *self.covariance[j].entry(i);
                *self.covariance[j].entry(i) = *self.covariance[i].entry(j);
                *self.covariance[i].entry(j) = lower;
            }
        }
    }

    /// Keeps P symmetric: rounding errors would not decay.
    fn symmetrise(&mut self) {
        for i in 0..3 * N {
            for j in 0..i {
                let mean = 0.5 * (*self.covariance[j].entry(i) + *self.covariance[i].entry(j));
                *self.covariance[j].entry(i) = mean;
                *self.covariance[i].entry(j) = mean;
            }
        }
    }

    /// ∂z for the parts of the step from one sample to the next.
    fn parts(&self, last: &At, now: &At) -> [Reversal<N>; SUBSTEPS] {
        let mut engagement = last.engagement;
        std::array::from_fn(|_| {
            let mut part = Reversal {
                kept: SVector::zeros(),
                by_way: SVector::zeros(),
                by_presliding: SVector::zeros(),
            };
            for i in 0..N {
                let step = (now.q[i] - last.q[i]) / SUBSTEPS as f64;
                let (way, z) = (step.abs() / self.truth.presliding, engagement[i].z);
                let kept = (-way).exp();
                part.kept[i] = kept;
                // a joint at rest is pushed to either side
                let left = if step == 0.0 { 1.0 } else { 1.0 - step.signum() * z };
                part.by_way[i] = left * kept / self.truth.presliding;
                let coulomb = self.truth.drives[i].coulomb;
                if step != 0.0 && coulomb > 0.0 {
                    part.by_presliding[i] = (z - step.signum()) * way * kept / coulomb;
                }
                engagement[i] = self.friction.engagement(step, engagement[i]);
            }
            part
        })
    }

    /// ∂q̈ by central differences of the inverse dynamics, which is quadratic in q̇.
    fn linearise(&mut self, last: &At, now: &At) {
        const STEP: f64 = 1e-5;
        let h = self.truth.sample_period_s;
        let (robot, bodies) = (self.model.robot(), &self.truth.bodies);
        let ddq: SVector<f64, N> = SVector::from_fn(|i, _| (now.dq[i] - last.dq[i]) / h);
        let (q, dq) = (
            SVector::<f64, N>::from_fn(|i, _| 0.5 * (last.q[i] + now.q[i])),
            SVector::<f64, N>::from_fn(|i, _| 0.5 * (last.dq[i] + now.dq[i])),
        );
        let torques = |q: &SVector<f64, N>, dq: &SVector<f64, N>, ddq: &SVector<f64, N>| -> SVector<f64, N> {
            let mut tau = SVector::<f64, N>::zeros();
            inverse_dynamics(
                robot,
                bodies,
                q.as_slice(),
                dq.as_slice(),
                ddq.as_slice(),
                tau.as_mut_slice(),
            );
            tau
        };
        let here = torques(&q, &dq, &ddq);
        let nothing = SMatrix::<f64, N, N>::zeros();
        let (mut mass, mut by_q, mut by_v) = (nothing, nothing, nothing);
        for i in 0..N {
            let mut unit = SVector::zeros();
            unit[i] = 1.0;
            mass.set_column(i, &(torques(&q, &dq, &(ddq + unit)) - here));
            let near = unit * STEP;
            let slope = |ahead: SVector<f64, N>, behind: SVector<f64, N>| (ahead - behind) / (2.0 * STEP);
            by_q.set_column(
                i,
                &slope(torques(&(q + near), &dq, &ddq), torques(&(q - near), &dq, &ddq)),
            );
            by_v.set_column(
                i,
                &slope(torques(&q, &(dq + near), &ddq), torques(&q, &(dq - near), &ddq)),
            );
            mass[(i, i)] += self.truth.drives[i].rotor_inertia;
            by_v[(i, i)] += self.truth.drives[i].viscous;
        }
        let mass = (mass + mass.transpose()) * 0.5;
        let p = inverse(&mass);
        self.linearised = Linearised {
            by_q: -(p * by_q),
            by_v: -(p * by_v),
            by_torque: p,
        };
    }

    /// (3), (4).
    fn measure(&mut self) {
        let mut c = SMatrix::<f64, N, N>::from_fn(|i, j| self.covariance[j].q[i]);
        c = (c + c.transpose()) * 0.5;
        for i in 0..N {
            c[(i, i)] += self.truth.position_std[i].powi(2);
        }
        let weights = inverse(&c);
        // C⁻¹ = W ᵀW with W the upper factor: rows W S_q have squares as in (3)
        let whiten = upper_factor(&weights);
        let whitened: Vec<SVector<f64, N>> = self.sensitivity.iter().map(|column| whiten * column.q).collect();
        for i in 0..N {
            self.information.add(whitened.iter().map(|row| row[i])); // (3)
        }
        let rows: Vec<SVector<f64, N>> = self.covariance.iter().map(|column| column.q).collect();
        let gain = rows.iter().map(|row| weights * row).collect::<Vec<_>>(); // K, row by row
        let less = |column: &mut Column<N>| {
            let seen = column.q;
            for (i, gain) in gain.iter().enumerate() {
                *column.entry(i) -= gain.dot(&seen); // (4)
            }
        };
        self.sensitivity.iter_mut().for_each(less);
        self.covariance.iter_mut().for_each(less);
        self.symmetrise();
    }

    /// Smallest standard deviations of the model's parameters by (3), and by (5), including prior
    /// information; `None` if the run does not determine them.
    pub fn std(mut self) -> Option<[Vec<f64>; 2]> {
        self.information.flush();
        self.exact.flush();
        let (recursion, exact) = (self.of(&self.information.sum)?, self.of(&self.exact.sum)?);
        Some([recursion, exact])
    }

    fn of(&self, information: &DMatrix<f64>) -> Option<Vec<f64>> {
        let count = information.nrows();
        // scaled so that the prior information is the unit matrix
        let scale = |i: usize| self.model.parameters()[i].scale;
        let scaled = DMatrix::from_fn(count, count, |i, j| {
            information[(i, j)] * scale(i) * scale(j) + if i == j { 1.0 } else { 0.0 }
        });
        let inverse = scaled.cholesky()?.inverse();
        let covariance = |i: usize, j: usize| inverse[(i, j)] * scale(i) * scale(j);
        let mut std: Vec<f64> = (0..count).map(|i| covariance(i, i).max(0.0).sqrt()).collect();
        for joint in 0..N {
            let place = |term| self.model.friction_term(joint, term);
            if let (Some(reversal), Some(coulomb)) = (place(FrictionTerm::Reversal), place(FrictionTerm::Coulomb)) {
                let part = self.truth.presliding / self.model.friction()[joint].presliding;
                // df_r = (δ/δ_m − 1) df_c + (δ/δ_m) f_c dln δ
                let variance = (part - 1.0).powi(2) * covariance(coulomb, coulomb)
                    + 2.0 * (part - 1.0) * part * covariance(coulomb, reversal)
                    + part * part * covariance(reversal, reversal);
                std[reversal] = variance.max(0.0).sqrt();
            }
        }
        Some(std)
    }
}

impl<const N: usize> Linearised<N> {
    /// A part of (2) for a column, with additional accelerations. Friction uses z from before the
    /// step, and z then follows the new speed, which keeps the spring of a joint at rest stable.
    fn step(&self, truth: &RobotTruth, reversal: &Reversal<N>, more: &SVector<f64, N>, column: &mut Column<N>) {
        let h = truth.sample_period_s / SUBSTEPS as f64;
        let friction = SVector::<f64, N>::from_fn(|i, _| truth.drives[i].coulomb * column.z[i]);
        let acceleration = self.by_q * column.q + self.by_v * column.v - self.by_torque * friction + more;
        let before = column.v;
        column.v += acceleration * h;
        column.q += (before + column.v) * (0.5 * h);
        column.z = reversal.kept.component_mul(&column.z) + reversal.by_way.component_mul(&column.v) * h;
    }
}

/// Inverse of a small symmetric positive definite matrix: Gauss-Jordan without pivoting.
fn inverse<const N: usize>(matrix: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let (mut left, mut right) = (*matrix, SMatrix::<f64, N, N>::identity());
    for k in 0..N {
        let pivot = left[(k, k)].recip();
        let (own_left, own_right) = (left.row(k) * pivot, right.row(k) * pivot);
        for i in (0..N).filter(|&i| i != k) {
            let factor = left[(i, k)];
            let (row_left, row_right) = (left.row(i) - own_left * factor, right.row(i) - own_right * factor);
            left.set_row(i, &row_left);
            right.set_row(i, &row_right);
        }
        left.set_row(k, &own_left);
        right.set_row(k, &own_right);
    }
    (right + right.transpose()) * 0.5
}

/// W, upper triangular, with WᵀW the given positive definite matrix.
fn upper_factor<const N: usize>(matrix: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let mut factor = SMatrix::<f64, N, N>::zeros();
    for i in 0..N {
        for j in i..N {
            let known: f64 = (0..i).map(|k| factor[(k, i)] * factor[(k, j)]).sum();
            let left = matrix[(i, j)] - known;
            factor[(i, j)] = match i == j {
                true => left.max(0.0).sqrt(),
                false if factor[(i, i)] > 0.0 => left / factor[(i, i)],
                false => 0.0,
            };
        }
    }
    factor
}
