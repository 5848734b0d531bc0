//! Finds position and size of jumps in inputs that are otherwise continuous.
//!
//! ```text
//! e_k = d_k − (d_{k−1} + d_{k+1})/2        d_k = u_k − u_{k−1}
//! j_k = (e_k − (e_{k−1} + e_{k+1})/2)/1.5
//! ```
//!
//! Around k, a jump Δ at t_k gives e = (−Δ/2, Δ, −Δ/2). White noise gives a variance of 5 σ_u², and
//! a smooth input almost nothing. j separates them best.

use super::setpoint_steps::SetpointSteps;
use crate::rows::kernel::{Kernels, dot};

/// The jumps of each joint's input in a block: buffer position and size.
#[derive(Debug, Clone)]
pub(super) struct InputJumps {
    found: Vec<Vec<(usize, f64)>>,
    /// Scratch: e and |j|.
    bends: Vec<f64>,
    statistic: Vec<f64>,
}

impl InputJumps {
    /// Workspace for `capacity` samples.
    pub fn new(joints: usize, capacity: usize) -> Self {
        Self {
            // a cloned vector has no spare capacity
            found: (0..joints).map(|_| Vec::with_capacity(capacity)).collect(),
            bends: vec![0.0; capacity],
            statistic: Vec::with_capacity(capacity),
        }
    }

    /// Finds the jumps of a joint's input `u`, which has noise of standard deviation `noise`. A
    /// jump that no step of the setpoint explains may have happened at any time since the sample
    /// before, such as when a drive leaves its limit: it is added to `surplus` as a variance
    /// instead.
    pub fn find(
        &mut self,
        joint: usize,
        u: &[f64],
        noise: f64,
        steps: &SetpointSteps,
        surplus: &mut Vec<(usize, f64)>,
    ) {
        let jumps = &mut self.found[joint];
        jumps.clear();
        let len = u.len();
        if len < 9 {
            return;
        }
        let e = &mut self.bends[..len];
        // e_k of the samples with neighbours on both sides
        let (before, here, behind) = (&u[1..], &u[2..], &u[3..]);
        let neighbours = before.iter().zip(here).zip(behind).zip(u);
        for (e, (((before, here), behind), second)) in e[2..len - 1].iter_mut().zip(neighbours) {
            *e = 1.5 * (here - before) - 0.5 * (behind - second);
        }
        let candidates = 5..len - 2;
        let contrast = |before: f64, here: f64, behind: f64| (here - 0.5 * (before + behind)) / 1.5;
        let around = e[4..].iter().zip(&e[5..len - 2]).zip(&e[6..]);
        self.statistic.clear();
        self.statistic
            .extend(around.map(|((&before, &here), &behind)| contrast(before, here, behind).abs()));
        let middle = self.statistic.len() / 2;
        let (_, median, _) = self.statistic.select_nth_unstable_by(middle, f64::total_cmp);
        // the variance of j is 7 σ_u², and its median magnitude 0.67 standard deviations
        let threshold = (8.0 * 7f64.sqrt() * noise).max(12.0 * *median).max(f64::MIN_POSITIVE);
        for k in candidates {
            let (before, here, behind) = (e[k - 1], e[k], e[k + 1]);
            if contrast(before, here, behind).abs() <= threshold {
                continue;
            }
            let shape = (before + 0.5 * here).abs() + (behind + 0.5 * here).abs();
            if shape < 0.5 * here.abs() {
                // without noise the left limit is extrapolated, which is exact for polynomials of
                // degree 4
                let left = 5.0 * (u[k - 1] - u[k - 4]) - 10.0 * (u[k - 2] - u[k - 3]) + u[k - 5];
                let size = if noise > 0.0 { here } else { u[k] - left };
                if steps.explain(joint, k) {
                    jumps.push((k, size));
                } else {
                    let place = surplus.partition_point(|entry| entry.0 < k);
                    surplus.insert(place, (k, size * size / 12.0));
                }
            }
        }
    }

    /// All jumps \[joint\].
    pub fn all(&self) -> &[Vec<(usize, f64)>] {
        &self.found
    }

    /// Jumps of a joint's input at buffer positions `from..from + len`.
    pub fn within(&self, joint: usize, from: usize, len: usize) -> &[(usize, f64)] {
        within(&self.found[joint], from, len)
    }

    /// ∫ψ^(r) u of the window around a centre for r < N ≤ 3; `u` is all of a joint's input.
    pub fn moments<const N: usize>(&self, kernels: &Kernels, centre: usize, joint: usize, u: &[f64]) -> [f64; N] {
        let from = centre - kernels.input_half;
        let u = &u[from..=centre + kernels.input_half];
        let jumps = self.within(joint, from, u.len());
        std::array::from_fn(|r| {
            let weights = jumps.iter().map(|&(at, size)| kernels.jump[r][at - from] * size);
            weights.fold(dot(&kernels.input[r], u), |sum, jump| sum + jump)
        })
    }
}

/// The entries of a list ordered by buffer position at `from..from + len`.
pub(super) fn within(entries: &[(usize, f64)], from: usize, len: usize) -> &[(usize, f64)] {
    let start = entries.partition_point(|entry| entry.0 < from);
    let end = entries.partition_point(|entry| entry.0 < from + len);
    &entries[start..end]
}
