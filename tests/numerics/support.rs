//! Golden samples and small helpers for several test modules.

#[cfg(feature = "config")]
use proptest::{prelude::*, sample::Index};
use thetabus::model::{JointSample, MAX_JOINTS};

/// A change of a file: its kind, its place, another place, and a byte or a length.
#[cfg(feature = "config")]
pub type Edit = (u8, Index, Index, u8);

/// A few changes of a file.
#[cfg(feature = "config")]
pub fn edits() -> impl Strategy<Value = Vec<Edit>> {
    prop::collection::vec((0..4u8, any::<Index>(), any::<Index>(), any::<u8>()), 1..6)
}

/// A text with bytes flipped, cut out, doubled or moved.
#[cfg(feature = "config")]
pub fn edited(text: &str, edits: &[Edit]) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for (edit, at, to, byte) in edits {
        if bytes.is_empty() {
            break;
        }
        let (at, to) = (at.index(bytes.len()), to.index(bytes.len()));
        let end = (at + usize::from(*byte)).min(bytes.len());
        match edit {
            0 => bytes[at] = *byte,
            1 => _ = bytes.drain(at..end),
            2 => {
                let piece = bytes[at..end].to_vec();
                bytes.splice(to..to, piece);
            }
            _ => bytes.swap(at, to),
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Force on the carriage of the EMPS rig per volt of its drive [N/V]. A. Janot, M. Gautier, M.
/// Brunot, Data Set and Reference Models of EMPS, 2019.
#[cfg(feature = "config")]
pub const EMPS_GAIN: f64 = 35.150_651_88;
/// Its published mass [kg], viscous friction [N s/m], Coulomb friction [N] and offset [N], of the
/// same source.
#[cfg(feature = "config")]
pub const EMPS_PUBLISHED: [f64; 4] = [95.1089, 203.5034, 20.3935, -3.1648];

/// A small generator for test data (splitmix64); the tests state their seeds.
pub struct TestRng(pub u64);

impl TestRng {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1u64 << 53) as f64)
    }

    /// A standard normal number, as the sum of twelve uniform ones.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.between(-0.5, 0.5)).sum()
    }
}

/// A random state of the two-joint arm, with every signal set.
pub fn random_sample(rng: &mut TestRng) -> JointSample {
    let mut sample = JointSample::default();
    for joint in 0..2 {
        sample.q[joint] = rng.between(-3.0, 3.0);
        sample.dq[joint] = rng.between(-4.0, 4.0);
        sample.ddq[joint] = rng.between(-50.0, 50.0);
        sample.dddq[joint] = rng.between(-2000.0, 2000.0);
        sample.setpoint[joint] = rng.between(-1.0, 1.0);
        sample.input[joint] = rng.between(-200.0, 200.0);
    }
    sample
}

/// The golden samples as `[z1, z2, q1, q2, dq1, dq2, ddq1, ddq2, dddq1, dddq2, u1, u2]`, see
/// tests/data/golden/README.md.
pub fn golden_rows() -> Vec<[f64; 12]> {
    include_str!("../data/golden/samples.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let values: Vec<f64> = line.split(',').skip(2).map(|field| field.parse().unwrap()).collect();
            values.try_into().unwrap()
        })
        .collect()
}

/// The golden samples in the core type.
pub fn golden_samples() -> Vec<JointSample> {
    golden_rows().iter().map(joint_sample).collect()
}

fn joint_sample(row: &[f64; 12]) -> JointSample {
    let two = |at: usize| {
        let mut signal = [0.0; MAX_JOINTS];
        signal[..2].copy_from_slice(&row[at..at + 2]);
        signal
    };
    JointSample {
        setpoint: two(0),
        q: two(2),
        dq: two(4),
        ddq: two(6),
        dddq: two(8),
        input: two(10),
    }
}
