//! Seeded random states and parameters at which a plant's terms are evaluated when it is set up.

use crate::model::{AnyPlant, MAX_JOINTS};
use crate::random::Random;

/// Number of points that decide the form of a plant's terms.
const PROBES: usize = 24;

/// A random number of either sign, with magnitudes over three decades.
pub(super) fn signed(random: &mut Random, largest: f64) -> f64 {
    let magnitude = largest * 10f64.powf(-3.0 * random.uniform());
    if random.uniform() < 0.5 { -magnitude } else { magnitude }
}

/// A state of the joints and parameters at which to evaluate the terms.
pub(super) struct Probe {
    pub q: [f64; MAX_JOINTS],
    pub dq: [f64; MAX_JOINTS],
    pub theta: Vec<f64>,
}

/// The points.
pub(super) fn probes(plant: &dyn AnyPlant) -> Vec<Probe> {
    let mut random = Random(0x7468_6574_6162_7573);
    (0..PROBES)
        .map(|_| {
            let mut probe = Probe {
                q: [0.0; MAX_JOINTS],
                dq: [0.0; MAX_JOINTS],
                theta: Vec::new(),
            };
            for joint in 0..plant.joints() {
                probe.q[joint] = signed(&mut random, 3.0);
                probe.dq[joint] = signed(&mut random, 10.0);
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
