//! A drive's gain, or viscous friction, that differs by direction, and friction that grows with the
//! load: the integrands of their columns.
//!
//! ```text
//! u → u + a |u|:      d = −s ∫ψ |u|          f_v q̇ + a |q̇|:      d = s ∫ψ |q̇|
//! a |u| sign q̇:       d = s ∫ψ |u| sat(q̇/v₀)
//! ```
//!
//! Half the difference of Coulomb friction between the directions has no column: it is exactly a
//! constant force.

/// Share of the sum of squares that either sign needs for a block to have both directions.
const BOTH: f64 = 0.05;

/// −|u|, |q̇| and |u| sat(q̇/v₀) of the samples of a block.
#[derive(Debug, Clone)]
pub(super) struct ByDirection {
    pub inputs: Vec<f64>,
    pub speeds: Vec<f64>,
    pub loads: Vec<f64>,
}

impl ByDirection {
    /// For blocks of up to `capacity` samples; empty for 0.
    pub fn new(capacity: usize) -> Self {
        Self {
            inputs: vec![0.0; capacity],
            speeds: vec![0.0; capacity],
            loads: vec![0.0; capacity],
        }
    }

    /// Takes the inputs and velocities of a block; v₀ is `standing` times the standard deviation of
    /// the position.
    pub fn sense(&mut self, u: &[f64], dq: &[f64], (q_std, standing): (&[f64], f64)) {
        fill(&mut self.inputs, u, -1.0);
        fill(&mut self.speeds, dq, 1.0);
        let motion = u.iter().zip(dq.iter().zip(q_std));
        for (load, (u, (dq, q_std))) in self.loads.iter_mut().zip(motion) {
            *load = u.abs() * (dq / (standing * q_std)).clamp(-1.0, 1.0);
        }
    }
}

/// Writes `sign` |x|, or 0 if x does not have both signs. At a joint that bears a weight, |u| is u
/// or −u almost always: what the estimated parameters cannot imitate of it is then only noise,
/// which the residuals share.
fn fill(out: &mut [f64], x: &[f64], sign: f64) {
    let square = |sum: f64, x: &f64| sum + x * x;
    let all = x.iter().fold(0.0, square);
    let positive = x.iter().filter(|x| **x > 0.0).fold(0.0, square);
    let has_both = positive.min(all - positive) > BOTH * all;
    for (out, x) in out.iter_mut().zip(x) {
        *out = if has_both { sign * x.abs() } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_motion_in_one_direction_says_nothing_on_the_difference() {
        let mut both = ByDirection::new(3);
        both.sense(&[2.0, -1.0, 0.5], &[-1.0, -2.0, -3.0], (&[0.5, 4.0, 0.5], 1.0));
        assert_eq!(both.inputs, [-2.0, -1.0, -0.5]);
        assert_eq!(both.speeds, [0.0, 0.0, 0.0]);
        assert_eq!(both.loads, [-2.0, -0.5, -0.5]);
    }
}
