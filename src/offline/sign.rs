//! Determines from the samples alone whether a positive input accelerates the machine forwards.
//!
//! ```text
//! u_j = a q̈_j + Σ_{k≠j} c_k q̈_k + b q̇_j + f sign q̇_j + d + g sin q_j + h cos q_j + rest
//! r = cov(u_j, q̈_j | the others) / √(var(u_j | others) · var(q̈_j | others))
//! ```
//!
//! For every drive a > 0, because it is an inertia. So the partial correlation r gives the sign of
//! the input without a model of the machine, if inertia is visible: if friction or noise dominates,
//! r is near 0 and inconclusive. Positions are averaged over neighbouring samples before they are
//! differenced. Noise in q̈ reduces r but does not change its sign, so of several averaging lengths
//! the one with the largest |r| is used. The same averages tell whether the input is one at all,
//! see [`InputEcho`].

use super::echo::{EchoSums, InputEcho};
use crate::messages::Sample;
use crate::model::MAX_JOINTS;
use nalgebra::{DMatrix, DVector};

/// Samples in an average.
const LENGTHS: [usize; 4] = [3, 10, 30, 100];
/// Smallest number of triples of averages.
const ENOUGH: u64 = 50;
/// Regressors that do not belong to other joints: q̇, sign q̇, 1, sin q, cos q.
const OWN: usize = 5;

/// Accumulates the statistics for the sign of each joint's input.
pub struct InputSign {
    joints: usize,
    scales: Vec<Scale>,
    /// `seq` that continues the present stretch without a gap.
    next_seq: Option<u64>,
}

impl InputSign {
    /// For samples of `joints` joints, at most [`MAX_JOINTS`].
    pub fn new(joints: usize) -> Self {
        let joints = joints.min(MAX_JOINTS);
        Self {
            joints,
            scales: LENGTHS.map(|length| Scale::new(length, joints)).into(),
            next_seq: None,
        }
    }

    /// Takes the next sample.
    pub fn take(&mut self, sample: &Sample) {
        if self.next_seq != Some(sample.seq) {
            self.scales.iter_mut().for_each(Scale::begin);
        }
        self.next_seq = sample.seq.checked_add(1);
        for scale in &mut self.scales {
            let t_s = sample.t_ns as f64 * 1e-9;
            scale.take(t_s, &sample.q[..self.joints], &sample.input[..self.joints]);
        }
    }

    /// r of a joint's input, counted from 0; `None` if the samples are inconclusive.
    pub fn correlation(&self, joint: usize) -> Option<f64> {
        let of = |scale: &Scale| scale.correlation(joint);
        let all = self.scales.iter().filter_map(of);
        all.max_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// What a joint's input, whose unit is `input_unit` \[SI units\], repeats.
    pub fn echo(&self, joint: usize, input_unit: f64) -> Option<InputEcho> {
        let enough = self.scales.iter().filter(|scale| scale.count >= ENOUGH);
        let mut sums = enough.filter_map(|scale| scale.echo.get(joint));
        sums.find_map(|sums| sums.of(input_unit))
    }
}

/// Moments of averages of one length.
struct Scale {
    length: usize,
    filled: usize,
    sum: Mean,
    /// The last averages, the newest last.
    means: [Mean; 3],
    complete: usize,
    moments: Vec<DMatrix<f64>>,
    echo: Vec<EchoSums>,
    count: u64,
}

#[derive(Clone, Copy, Default)]
struct Mean {
    t_s: f64,
    q: [f64; MAX_JOINTS],
    u: [f64; MAX_JOINTS],
}

impl Scale {
    fn new(length: usize, joints: usize) -> Self {
        // u_j and q̈_j first, then the others' q̈, then the joint's own.
        let size = 1 + joints + OWN;
        Self {
            length,
            filled: 0,
            sum: Mean::default(),
            means: Default::default(),
            complete: 0,
            moments: vec![DMatrix::zeros(size, size); joints],
            echo: vec![EchoSums::default(); joints],
            count: 0,
        }
    }

    fn begin(&mut self) {
        (self.filled, self.complete, self.sum) = (0, 0, Mean::default());
    }

    fn take(&mut self, t_s: f64, q: &[f64], u: &[f64]) {
        self.sum.t_s += t_s / self.length as f64;
        for (sum, value) in self.sum.q.iter_mut().zip(q).chain(self.sum.u.iter_mut().zip(u)) {
            *sum += value / self.length as f64;
        }
        self.filled += 1;
        if self.filled < self.length {
            return;
        }
        self.means = [self.means[1], self.means[2], self.sum];
        (self.filled, self.sum) = (0, Mean::default());
        self.complete += 1;
        if self.complete >= 3 {
            self.add();
        }
    }

    fn add(&mut self) {
        let [a, b, c] = &self.means;
        let joints = self.moments.len();
        let ddq = |j: usize| c.q[j] - 2.0 * b.q[j] + a.q[j];
        let mut row = DVector::zeros(1 + joints + OWN);
        for joint in 0..joints {
            let dq = c.q[joint] - a.q[joint];
            let middle =
                |of: fn(&Mean) -> &[f64; MAX_JOINTS]| 0.25 * of(a)[joint] + 0.5 * of(b)[joint] + 0.25 * of(c)[joint];
            row[0] = middle(|mean| &mean.u);
            self.echo[joint].add([middle(|mean| &mean.q), dq / (c.t_s - a.t_s)], row[0]);
            row[1] = ddq(joint);
            for (at, other) in (0..joints).filter(|k| *k != joint).enumerate() {
                row[2 + at] = ddq(other);
            }
            let sign = if dq == 0.0 { 0.0 } else { dq.signum() };
            let (sin, cos) = b.q[joint].sin_cos();
            let own = [dq, sign, 1.0, sin, cos];
            row.rows_mut(1 + joints, OWN).copy_from_slice(&own);
            self.moments[joint].ger(1.0, &row, &row, 1.0);
        }
        self.count += 1;
    }

    fn correlation(&self, joint: usize) -> Option<f64> {
        let moments = self.moments.get(joint).filter(|_| self.count >= ENOUGH)?;
        let scale: Vec<f64> = moments.diagonal().iter().map(|m| m.sqrt()).collect();
        if !moments.iter().all(|m| m.is_finite()) || scale[0] == 0.0 || scale[1] == 0.0 {
            return None;
        }
        let unit = DMatrix::from_fn(scale.len(), scale.len(), |i, k| match scale[i] * scale[k] {
            0.0 => 0.0,
            product => moments[(i, k)] / product,
        });
        let others = scale.len() - 2;
        let inverse = unit
            .view((2, 2), (others, others))
            .into_owned()
            .pseudo_inverse(1e-9)
            .ok()?;
        let cross = unit.view((0, 2), (2, others));
        let partial = unit.view((0, 0), (2, 2)) - cross * inverse * cross.transpose();
        // If the others explain all but a millionth, only rounding remains.
        let known = partial[(0, 0)] > 1e-6 && partial[(1, 1)] > 1e-6;
        let r = partial[(0, 1)] / (partial[(0, 0)] * partial[(1, 1)]).sqrt();
        (known && r.is_finite()).then_some(r)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::sim::MachineSimulator;

    /// r of each joint over 15 s of a simulated machine, with the original and the reversed input.
    fn correlations(name: &str, sets: &[&str]) -> [Vec<Option<f64>>; 2] {
        let source = Config::embedded(name).expect("built in");
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        let config = Config::load(&[source], &sets).expect("valid");
        let joints = config.model.definition().joints;
        [1.0, -1.0].map(|sign| {
            let mut found = InputSign::new(joints);
            let simulator = MachineSimulator::new(&config.plant.sim).expect("valid");
            for (k, s) in simulator.take(15_000).enumerate() {
                let mut sample = Sample::new(1, k as u64, k as u64 * 1_000_000, joints, 0, &s);
                sample.input.iter_mut().for_each(|u| *u *= sign);
                found.take(&sample);
            }
            (0..joints).map(|joint| found.correlation(joint)).collect()
        })
    }

    #[test]
    fn val_the_sign_of_every_simulated_machines_input_is_told_or_left_open() {
        let random: &[&str] = &["plant.setpoint.kind=random"];
        let noisy: &[&str] = &["plant.sensors.encoder_bits=13", "plant.sensors.input_noise_v=0.5"];
        // (configuration, settings, joints whose sign must be found)
        let cases: [(&str, &[&str], usize); 6] = [
            ("servo_axis", &[], 1),
            ("servo_axis", &["plant.sensors.input_noise_v=0.5"], 1),
            ("cedro2022", &[], 0),
            ("encoder_only", &[], 0),
            ("encoder_only", noisy, 0),
            ("encoder_only", random, 0),
        ];
        for (name, sets, told) in cases {
            let [right, wrong] = correlations(name, sets);
            for (joint, (right, wrong)) in right.iter().zip(&wrong).enumerate() {
                let (right, wrong) = (right.unwrap_or(0.0), wrong.unwrap_or(0.0));
                // The limit of a suspicion: a correct machine must never raise one.
                assert!(right > -0.5, "{name} {sets:?}, joint {joint}: {right}");
                assert!((right + wrong).abs() < 1e-6, "{name}: {right} and {wrong}");
                assert!(joint >= told || right > 0.5, "{name} {sets:?}, joint {joint}: {right}");
            }
        }
    }

    #[test]
    fn fault_a_machine_that_rests_or_gives_garbage_tells_nothing() {
        let mut sign = InputSign::new(2);
        for seq in 0..10_000 {
            let mut sample = Sample::new(1, seq, seq, 2, 0, &crate::model::JointSample::default());
            sample.q[1] = if seq == 5000 { f64::MAX } else { 0.3 };
            sign.take(&sample);
        }
        assert_eq!([0, 1, 2].map(|joint| sign.correlation(joint)), [None; 3]);
    }
}
