//! Identification in a few lines inside your own program: describe the plant and its sensors, push
//! samples, get estimates.
//!
//! ```
//! use thetabus::identify::Identifier;
//! use thetabus::model::{JointSample, Manipulator};
//!
//! // position and voltage of each joint, encoders of 16 bits, 0.05 V of noise, 1 kHz
//! let mut identifier = Identifier::builder(Manipulator::default())
//!     .encoder(16, 0.05)
//!     .block_len(1900)
//!     .build()?;
//! let names = identifier.names().clone();
//! # let mut read_the_drive = || JointSample::default();
//! for _ in 0..3800 {
//!     let sample = read_the_drive();
//!     if let Some(estimate) = identifier.push(&sample) {
//!         if let Some(theta_7) = estimate.usable(&names, "theta_7") {
//!             println!("theta_7 = {} ± {}", theta_7.value, theta_7.std);
//!         }
//!     }
//! }
//! # Ok::<(), thetabus::identify::BuildError>(())
//! ```
//!
//! Settings that you leave out have the values of `config/own_plant.toml`: rows over windows of the
//! positions, noise and window learnt from the signals, an estimator that forgets only what new
//! data determine, bounds from physics, and change detection. The service builds its identifier
//! in the same way from its configuration: both call
//! [`Model::identifier`](crate::node::model::Model::identifier).
//!
//! # What the input is
//! By default the input is the output of a sampled controller, which the drive holds from a sample
//! to the next. A measured current, torque or voltage runs on between samples: state it by
//! [`timing`](IdentifierBuilder::timing), or it counts as half a sample late and little is usable.
//!
//! ```
//! use thetabus::identify::{Identifier, InputTiming};
//! use thetabus::model::{DriveInput, Motion, ServoAxis};
//!
//! // an axis at 2 kHz; its drive measures the current, and the bus delivers it 1 ms late
//! # let axis = || ServoAxis::new(Motion::Rotary, DriveInput::Current, 0.8).unwrap();
//! let identifier = Identifier::builder(axis())
//!     .sample_period_s(5e-4)
//!     .timing(InputTiming::Continuous)
//!     .input_delay_s(-1e-3)
//!     .input_limit(&[20.0])
//!     .build()?;
//! # Ok::<(), thetabus::identify::BuildError>(())
//! ```

mod builder;

pub use crate::estimator::{ChangeDetection, ParameterPrior};
pub use crate::rows::{Considered, InputTiming, SensorNoise};
pub use builder::{BuildError, IdentifierBuilder};

use crate::messages::{Estimate, ParameterNames, Sample};
use crate::model::{JointSample, Plant};
use crate::node::identifier::Identifier as Node;
use crate::node::model::SharedModel;

/// An identifier inside a program: samples in, estimates out, no bus.
///
/// After [`build`](IdentifierBuilder::build) it allocates nothing and locks nothing; the same
/// samples give the same bits.
pub struct Identifier {
    node: Box<dyn Node>,
    model: SharedModel,
    names: ParameterNames,
    joints: usize,
    signals: u32,
    period_ns: u64,
    seq: u64,
}

impl std::fmt::Debug for Identifier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Identifier")
            .field("model", &self.model)
            .field("samples", &self.seq)
            .finish_non_exhaustive()
    }
}

/// Stream id of a stream without a publisher.
const STREAM: u64 = 1;

impl Identifier {
    /// A builder for this plant, with the start values and bounds that the plant defines.
    pub fn builder(plant: impl Plant + Clone + Send + Sync + 'static) -> IdentifierBuilder {
        IdentifierBuilder::new(plant)
    }

    /// Takes the next sample, one period after the previous one. Returns an estimate if the sample
    /// completes a block.
    pub fn push(&mut self, sample: &JointSample) -> Option<Estimate> {
        self.push_at(self.seq.saturating_mul(self.period_ns), sample)
    }

    /// Takes the next sample, with its own stream time \[ns\].
    ///
    /// A sample that cannot be used, because a signal is not finite or its time goes back, is left
    /// out and counted in [`status`](Self::status).
    pub fn push_at(&mut self, t_ns: u64, sample: &JointSample) -> Option<Estimate> {
        let message = Sample::new(STREAM, self.seq, t_ns, self.joints, self.signals, sample);
        self.seq = self.seq.saturating_add(1);
        let mut completed = None;
        self.node
            .on_sample(&message, &mut |estimate| completed = Some(*estimate));
        completed
    }

    /// States that `samples` samples were lost.
    pub fn skip(&mut self, samples: u64) {
        self.seq = self.seq.saturating_add(samples);
    }

    /// Names of the parameters, in the order of θ.
    pub fn names(&self) -> &ParameterNames {
        &self.names
    }

    /// Counters, state, and the last error.
    pub fn status(&self) -> crate::messages::Status {
        self.node.status()
    }
}
