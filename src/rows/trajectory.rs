//! The signals of a block's samples, measured or smoothed.

/// Signals, with one value per sample each.
#[derive(Debug, Clone)]
pub(super) struct Trajectory {
    /// Positions \[joint\]\[sample\].
    pub q: Vec<Vec<f64>>,
    /// Velocities \[joint\]\[sample\].
    pub dq: Vec<Vec<f64>>,
    /// Inputs \[joint\]\[sample\].
    pub u: Vec<Vec<f64>>,
    /// Features of the plant's nonlinear terms (`separation.rs`) \[feature\]\[sample\].
    pub features: Vec<Vec<f64>>,
    /// Samples at which a joint reverses at which terms jump.
    pub turns: Vec<Turn>,
}

/// A sample during whose period a joint reverses.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    pub at: usize,
    pub joint: usize,
    /// Share of the period and mean velocity before and after the reversal.
    pub parts: [(f64, f64); 2],
}

impl Trajectory {
    /// Buffers for `capacity` samples.
    pub fn new(joints: usize, features: usize, capacity: usize) -> Self {
        let buffers = |count: usize| vec![vec![0.0; capacity]; count];
        Self {
            q: buffers(joints),
            dq: buffers(joints),
            u: buffers(joints),
            features: buffers(features),
            turns: Vec::with_capacity(capacity),
        }
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.q.len()
    }

    /// Makes `kept` samples from `from` on the first ones.
    pub fn keep(&mut self, from: usize, kept: usize) {
        for buffer in [&mut self.q, &mut self.dq, &mut self.u, &mut self.features] {
            for values in buffer {
                values.copy_within(from..from + kept, 0);
            }
        }
    }
}
