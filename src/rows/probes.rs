//! Seeded random states and parameters at which a plant's terms are evaluated when it is set up.

use crate::model::{AnyPlant, MAX_JOINTS};

/// Number of points that decide the form of a plant's terms.
const PROBES: usize = 24;

/// 2⁶⁴ over the golden ratio: the increment of SplitMix64.
pub(super) const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The mixing function of SplitMix64.
pub(super) fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Random numbers for the probes: SplitMix64.
pub(super) struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniformly distributed from 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        (mix(self.0) >> 11) as f64 * (-53f64).exp2()
    }

    /// Of either sign, with magnitudes over three decades.
    pub fn signed(&mut self, largest: f64) -> f64 {
        let magnitude = largest * 10f64.powf(-3.0 * self.uniform());
        if self.uniform() < 0.5 { -magnitude } else { magnitude }
    }
}

/// A state of the joints and parameters at which to evaluate the terms.
pub(super) struct Probe {
    pub q: [f64; MAX_JOINTS],
    pub dq: [f64; MAX_JOINTS],
    pub theta: Vec<f64>,
}

/// The points.
pub(super) fn probes(plant: &dyn AnyPlant) -> Vec<Probe> {
    let mut random = Random::new(0x7468_6574_6162_7573);
    (0..PROBES)
        .map(|_| {
            let mut probe = Probe {
                q: [0.0; MAX_JOINTS],
                dq: [0.0; MAX_JOINTS],
                theta: Vec::new(),
            };
            for joint in 0..plant.joints() {
                probe.q[joint] = random.signed(3.0);
                probe.dq[joint] = random.signed(10.0);
            }
            probe.theta = plant
                .parameters()
                .iter()
                .map(|p| {
                    let size = if p.start != 0.0 { p.start.abs() } else { 1.0 };
                    let sign = if p.lower >= 0.0 {
                        1.0
                    } else {
                        2.0 * random.uniform() - 1.0
                    };
                    (sign * size * 10f64.powf(2.0 * random.uniform() - 1.0)).clamp(p.lower, p.upper)
                })
                .collect();
            probe
        })
        .collect()
}
