//! One pass over a robot's samples: rows, blocks, and estimates with standard deviations.
//!
//! With A_j, b_j the sums of joint j's rows, Λ₀ and θ₀ the prior, per block of time:
//!
//! ```text
//! Λ = Λ₀ + Σ_j A_j / (f_j σ_j)²,      Λ θ̂ = Λ₀ θ₀ + Σ_j b_j / (f_j σ_j)²                        (1)
//! σ_j² = Σ (τ − x·θ̂)² / rows                                                                    (2)
//! e = F ᵀ(τ − X θ̂) over one block,    f_j² = mean of eᵀ (F ᵀF)⁻¹ e / (k σ_j²) over blocks        (3)
//! P ← P + Q per block                                                                           (4)
//! ```
//!
//! On arms the misfit of friction dominates the noise and is correlated over seconds, so rows count for less than their number says. F are the k friction
//! columns of a joint: with uncorrelated rows e has the covariance σ² FᵀF and f_j is 1; a misfit that keeps its sign through a block raises it. That is the
//! block-wise sandwich estimator, reduced to one factor per joint so that a few blocks suffice; overlap of the windows is in it, too. It enters the
//! weights, so that the covariance P = Λ⁻¹ needs no correction afterwards.
//!
//! While the recording is short (1)–(3) are iterated over everything so far, since the A_j are kept per joint. After `settle_blocks` they are condensed into Λ
//! and, with a friction walk, (4) lets friction follow its temperature: Q is (`friction_walk` · size)² per second, on friction only.
//! Sources: H. White, Econometrica 48 (1980); K.-Y. Liang, S. Zeger, Biometrika 73 (1986), with time blocks as clusters.

use super::model::RobotModel;
use super::rows::{SampleFault, WeakRows, WindowOptions};
use super::state::RobotSample;
use super::sums::JointSums;
use crate::estimator::linalg::Cholesky;

/// Blocks that (3) is taken over.
const RECENT: usize = 32;
/// f_j² that is assumed before there are blocks, and the number of blocks that it counts for.
const ASSUMED_INFLATION: (f64, f64) = (9.0, 2.0);
/// Times that (1) and (2) are repeated per block while settling.
const ITERATIONS: usize = 4;
/// σ_j² is followed over this many blocks after settling.
const FOLLOWED_BLOCKS: f64 = 20.0;
/// Smallest σ_j beside the joint's mean torque: a perfect simulation has no residual at all.
const SMALLEST_STD: f64 = 1e-9;

/// How a robot is identified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentifyOptions {
    /// Windows of the weak form.
    pub windows: WindowOptions,
    /// Length of a block \[s\].
    pub block_s: f64,
    /// Blocks after which the weights of what is past are kept.
    pub settle_blocks: usize,
    /// Random walk of the friction parameters after settling, as a part of their size per √s; 0 for friction that stays.
    pub friction_walk: f64,
    /// Standard deviation by which [`widen_friction`](RobotIdentifier::widen_friction) widens the friction parameters, as a part of their size.
    pub friction_change: f64,
}

impl Default for IdentifyOptions {
    /// Blocks of 1 s; friction that walks by 5 % per √s after a minute, and may change by half its size in a pause.
    fn default() -> Self {
        Self {
            windows: WindowOptions::default(),
            block_s: 1.0,
            settle_blocks: 60,
            friction_walk: 0.05,
            friction_change: 0.5,
        }
    }
}

impl IdentifyOptions {
    fn validate(&self) -> Result<(), String> {
        self.windows.validate()?;
        if !(self.block_s > 0.0 && self.block_s.is_finite()) {
            return Err(format!(
                "block length: expected a time above 0 [s], got {}",
                self.block_s
            ));
        }
        for (name, value) in [
            ("friction walk", self.friction_walk),
            ("friction change", self.friction_change),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(format!("{name}: expected a number of at least 0, got {value}"));
            }
        }
        Ok(())
    }
}

/// Identifies a robot on line; memory is taken at the start only.
#[derive(Debug, Clone)]
pub struct RobotIdentifier {
    model: RobotModel,
    options: IdentifyOptions,
    rows: WeakRows,
    block: Vec<JointSums>,
    total: Vec<JointSums>,
    recent: Vec<Vec<JointSums>>,
    blocks: usize,
    block_end: Option<f64>,
    /// True after the sums have been condensed into the information.
    condensed: bool,
    prior: Vec<f64>,
    theta: Vec<f64>,
    information: Vec<f64>,
    vector: Vec<f64>,
    covariance: Vec<f64>,
    factor: Cholesky,
    work: Vec<f64>,
    torque_std: Vec<f64>,
    inflation: Vec<f64>,
}

impl RobotIdentifier {
    /// For a model; it starts from the URDF's own values.
    ///
    /// # Errors
    /// Options that are not valid, in words.
    pub fn new(model: RobotModel, options: IdentifyOptions) -> Result<Self, String> {
        options.validate()?;
        let (n, joints) = (model.parameters().len(), model.robot().len());
        let empty: Vec<JointSums> = (0..joints).map(|i| JointSums::new(model.columns(i))).collect();
        let theta: Vec<f64> = model.parameters().iter().map(|p| p.nominal).collect();
        let prior: Vec<f64> = model.parameters().iter().map(|p| p.scale.powi(-2)).collect();
        let mut covariance = vec![0.0; n * n];
        for (i, parameter) in model.parameters().iter().enumerate() {
            covariance[i * n + i] = parameter.scale.powi(2);
        }
        Ok(Self {
            rows: WeakRows::new(&model, options.windows)?,
            total: empty.clone(),
            recent: vec![empty.clone(); RECENT],
            block: empty,
            blocks: 0,
            block_end: None,
            condensed: false,
            prior,
            information: vec![0.0; n * n],
            vector: vec![0.0; n],
            covariance,
            factor: Cholesky::new(n),
            work: vec![0.0; n],
            torque_std: vec![0.0; joints],
            inflation: vec![ASSUMED_INFLATION.0.sqrt(); joints],
            theta,
            model,
            options,
        })
    }

    /// The model.
    pub fn model(&self) -> &RobotModel {
        &self.model
    }

    /// Estimates θ̂ in the order of the model's parameters.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }

    /// Standard deviation of one estimate; the prior's before the first block.
    pub fn theta_std(&self, parameter: usize) -> f64 {
        self.covariance(parameter, parameter).max(0.0).sqrt()
    }

    /// Covariance of two estimates.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        self.covariance[i * self.theta.len() + j]
    }

    /// σ_j: standard deviation of a joint's rows from what is predicted \[N m or N\].
    pub fn torque_std(&self, joint: usize) -> f64 {
        self.torque_std[joint]
    }

    /// f_j: how much larger a joint's misfit is over a block than uncorrelated rows of σ_j would make it.
    pub fn inflation(&self, joint: usize) -> f64 {
        self.inflation[joint]
    }

    /// Blocks so far.
    pub fn blocks(&self) -> usize {
        self.blocks
    }

    /// Takes a sample; true if a block was completed and the estimates are new.
    ///
    /// # Errors
    /// The sample cannot be used and was left out.
    pub fn push(&mut self, sample: &RobotSample) -> Result<bool, SampleFault> {
        let block = &mut self.block;
        self.rows.push(&self.model, sample, &mut |row| {
            block[row.joint].add_row(row.regressor, row.torque);
        })?;
        let end = *self.block_end.get_or_insert(sample.t_s + self.options.block_s);
        if sample.t_s < end {
            return Ok(false);
        }
        // A long pause is no reason to count empty blocks.
        let next = end + self.options.block_s;
        self.block_end = Some(if next > sample.t_s {
            next
        } else {
            sample.t_s + self.options.block_s
        });
        Ok(self.close_block())
    }

    /// Ends a recording: learns what its last, shorter block holds. The next sample begins a new recording.
    pub fn end_of_recording(&mut self) -> bool {
        self.rows.restart();
        self.block_end = None;
        self.close_block()
    }

    /// Makes friction uncertain again, as after a pause in which drives and oil change their temperature; inertial parameters stay.
    pub fn widen_friction(&mut self) {
        self.condensed = true;
        let n = self.theta.len();
        for joint in 0..self.model.robot().len() {
            for i in self.model.friction_of(joint) {
                let size = self.theta[i].abs().max(3.0 * self.theta_std(i));
                self.covariance[i * n + i] += (self.options.friction_change * size).powi(2);
            }
        }
        self.information_from_covariance();
    }

    /// Learns the block; false if it has no rows.
    fn close_block(&mut self) -> bool {
        if self.block.iter().all(|sums| sums.rows == 0) {
            return false;
        }
        self.blocks += 1;
        for (joint, sums) in self.block.iter_mut().enumerate() {
            sums.mirror();
            self.recent[self.blocks % RECENT][joint].copy_from(sums);
        }
        if !self.condensed {
            for (total, block) in self.total.iter_mut().zip(&self.block) {
                total.add(block);
            }
            for _ in 0..ITERATIONS {
                self.weigh_all();
                self.solve_all();
            }
            self.refresh_covariance();
            if self.blocks >= self.options.settle_blocks {
                self.condensed = true;
            }
        } else {
            self.walk();
            self.follow();
        }
        self.block.iter_mut().for_each(JointSums::clear);
        true
    }

    /// (2) and (3) over everything so far.
    fn weigh_all(&mut self) {
        for (joint, sums) in self.total.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let rows = sums.rows as f64;
            let own = self.model.friction_of(joint).len().max(1) as f64;
            let variance = sums.residual_square(&self.theta) / (rows - own).max(1.0); // (2)
            let floor = (sums.square / rows).sqrt() * SMALLEST_STD;
            self.torque_std[joint] = variance.sqrt().max(floor).max(f64::MIN_POSITIVE.sqrt());
        }
        self.inflate();
    }

    /// (3) over the recent blocks.
    fn inflate(&mut self) {
        let (assumed, weight) = ASSUMED_INFLATION;
        for joint in 0..self.model.robot().len() {
            let friction = self.model.friction_of(joint).len();
            let (mut sum, mut count) = (assumed * weight, weight);
            for block in self.recent.iter().take(self.blocks.min(RECENT) + 1) {
                let sums = &block[joint];
                if sums.rows == 0 || friction == 0 {
                    continue;
                }
                if let Some((square, directions)) = friction_misfit(sums, friction, &self.theta) {
                    sum += square / (directions * self.torque_std[joint].powi(2)); // (3)
                    count += 1.0;
                }
            }
            self.inflation[joint] = (sum / count).sqrt().max(1.0);
        }
    }

    fn weight(&self, joint: usize) -> f64 {
        (self.inflation[joint] * self.torque_std[joint]).powi(-2)
    }

    /// (1) over everything so far.
    fn solve_all(&mut self) {
        let n = self.theta.len();
        self.information.fill(0.0);
        for (i, parameter) in self.model.parameters().iter().enumerate() {
            self.information[i * n + i] = self.prior[i];
            self.vector[i] = self.prior[i] * parameter.nominal;
        }
        for joint in 0..self.total.len() {
            if self.total[joint].rows > 0 {
                let weight = self.weight(joint);
                self.total[joint].scatter(weight, n, &mut self.information, &mut self.vector); // (1)
            }
        }
        self.solve();
    }

    /// θ̂ from the information; it stays as it is if rounding has spoilt this.
    fn solve(&mut self) {
        if self.factor.factor(self.theta.len(), &self.information) {
            self.theta.copy_from_slice(&self.vector);
            self.factor.solve(&mut self.theta); // (1)
        }
    }

    /// P = Λ⁻¹, which costs more than all else and is needed once per block.
    fn refresh_covariance(&mut self) {
        if self.factor.factor(self.theta.len(), &self.information) {
            self.factor.inverse(&mut self.covariance, &mut self.work);
        }
    }

    /// Λ = P⁻¹ and Λ θ̂, after P has been changed.
    fn information_from_covariance(&mut self) {
        let n = self.theta.len();
        if self.factor.factor(n, &self.covariance) {
            self.factor.inverse(&mut self.information, &mut self.work);
            for i in 0..n {
                let row = &self.information[i * n..(i + 1) * n];
                self.vector[i] = row.iter().zip(&self.theta).map(|(a, x)| a * x).sum();
            }
        }
    }

    /// (4).
    fn walk(&mut self) {
        if self.options.friction_walk == 0.0 {
            return;
        }
        let n = self.theta.len();
        for joint in 0..self.model.robot().len() {
            for i in self.model.friction_of(joint) {
                let size = self.theta[i].abs().max(self.theta_std(i));
                self.covariance[i * n + i] += (self.options.friction_walk * size).powi(2) * self.options.block_s; // (4)
            }
        }
        self.information_from_covariance();
    }

    /// (1) for one more block, with σ_j followed.
    fn follow(&mut self) {
        let n = self.theta.len();
        for joint in 0..self.block.len() {
            if self.block[joint].rows > 0 {
                let weight = self.weight(joint);
                self.block[joint].scatter(weight, n, &mut self.information, &mut self.vector); // (1)
            }
        }
        self.solve();
        self.refresh_covariance();
        for (joint, sums) in self.block.iter().enumerate().filter(|(_, sums)| sums.rows > 0) {
            let variance = sums.residual_square(&self.theta) / sums.rows as f64;
            let kept = self.torque_std[joint].powi(2);
            let floor = (sums.square / sums.rows as f64).sqrt() * SMALLEST_STD;
            self.torque_std[joint] = (kept + (variance - kept) / FOLLOWED_BLOCKS).sqrt().max(floor);
        }
        self.inflate();
    }
}

/// eᵀ (FᵀF)⁻¹ e over the friction columns of one block, and the number of directions that it has.
fn friction_misfit(sums: &JointSums, friction: usize, theta: &[f64]) -> Option<(f64, f64)> {
    const MOST: usize = 8;
    const DEPENDENT: f64 = 1e-6;
    let m = sums.columns().len();
    let first = m - friction;
    // Cholesky without square roots; a column that depends on those before it, as in a block without a reversal, counts no direction.
    let mut l = [[0.0; MOST]; MOST];
    let mut d = [0.0; MOST];
    let mut e = [0.0; MOST];
    let (mut square, mut directions) = (0.0, 0.0);
    for i in 0..friction.min(MOST) {
        let row = &sums.gram[(first + i) * m + first..(first + i + 1) * m];
        e[i] = sums.gradient(first + i, theta);
        let mut pivot = row[i];
        for j in 0..i {
            if d[j] > 0.0 {
                let mut v = row[j];
                for k in 0..j {
                    v -= l[i][k] * l[j][k] * d[k];
                }
                l[i][j] = v / d[j];
                pivot -= l[i][j] * l[i][j] * d[j];
                e[i] -= l[i][j] * e[j];
            }
        }
        if pivot > DEPENDENT * row[i] {
            d[i] = pivot;
            square += e[i] * e[i] / pivot;
            directions += 1.0;
        }
    }
    (directions > 0.0).then_some((square, directions))
}
