//! The bus payloads: fixed size, `repr(C)`, explicit padding, one schema version.
//!
//! This is the only place that translates between messages and core types. The derive of `ZeroCopySend` is the one mention of
//! iceoryx2 outside `bus/`: a trait can be derived only where its type is declared.
//!
//! Bit-identity of two runs covers every field except `boot_id`.

mod control;
mod passage;
mod status;
mod text;
mod usable;

pub use control::{
    Command, DATA, Item, Journal, MAX_ITEMS, MAX_PARTS, NAME, Parts, RESPONSE_TEXT, Request, Response, UNIT, item_kind,
    request_flags, response_code, stream_tag,
};

pub use passage::Passage;
pub use status::{
    ERROR_TEXT, ErrorCode, LastError, ProcessStatus, RealtimeStatus, Status, StreamFaults, Timing, status_flags,
};
pub use text::{put_text, text_of};
pub use usable::{ParameterNames, Usable};

use crate::model::{JointSample, MAX_JOINTS, MAX_PARAMS};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;
use std::mem::{offset_of, size_of};

/// Version of all payloads below; part of each type name and of the user header.
pub const SCHEMA_VERSION: u32 = 2;
/// The most derived values that an estimate can carry.
pub const MAX_DERIVED: usize = 8;

/// Flags of a [`Header`].
pub mod header_flags {
    /// The message was sent before, and may have reached this reader then: drop it if it did.
    pub const RESENT: u32 = 1 << 0;
}

/// Flags of a [`Sample`].
pub mod sample_flags {
    /// The last sample of a stream.
    pub const END: u32 = 1 << 0;
    /// A sample of a replay: what it teaches goes when its stream is over.
    pub const REPLAY: u32 = 1 << 1;
}

/// Bits of [`Sample::signals`]: which of its arrays hold data.
pub mod signals {
    /// q is valid.
    pub const Q: u32 = 1 << 0;
    /// q̇ is valid.
    pub const DQ: u32 = 1 << 1;
    /// q̈ is valid.
    pub const DDQ: u32 = 1 << 2;
    /// q⃛ is valid.
    pub const DDDQ: u32 = 1 << 3;
    /// The setpoint is valid.
    pub const SETPOINT: u32 = 1 << 4;
    /// The input is valid.
    pub const INPUT: u32 = 1 << 5;
    /// All of them.
    pub const ALL: u32 = (1 << 6) - 1;
}

/// Flags of an [`Estimate`].
pub mod estimate_flags {
    /// A change of the parameters was found in this block; `t_change_ns` tells when.
    pub const CHANGED: u32 = 1 << 0;
    /// Samples of this block are missing or were rejected.
    pub const INCOMPLETE: u32 = 1 << 1;
    /// The update could not be made; θ̂ is the previous one.
    pub const HELD: u32 = 1 << 2;
    /// The estimator continued from a checkpoint.
    pub const WARM: u32 = 1 << 3;
    /// The first estimate since a command took effect.
    pub const COMMANDED: u32 = 1 << 4;
    /// A signal of this block was saturated or frozen; it was left out, and θ̂ is the previous one.
    pub const SENSOR: u32 = 1 << 5;
}

/// User header of every message.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusHeaderV2"))]
pub struct Header {
    /// [`SCHEMA_VERSION`] of the sender.
    pub schema: u32,
    /// [`header_flags`].
    pub flags: u32,
    /// CLOCK_MONOTONIC at sending \[ns\]; latency is measured from it.
    pub sent_ns: u64,
}

/// Topic `sample`: joints, setpoint and input of one instant.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusSampleV2"))]
pub struct Sample {
    /// Random number drawn at each start of the publisher.
    pub boot_id: u64,
    /// Counts from 0, one per sample period.
    pub seq: u64,
    /// Stream time \[ns\]: simulated time, or CLOCK_MONOTONIC on a machine.
    pub t_ns: u64,
    /// [`sample_flags`].
    pub flags: u32,
    /// Number of joints, 1 to [`MAX_JOINTS`].
    pub joints: u32,
    /// [`signals`].
    pub signals: u32,
    /// Zero.
    pub pad: u32,
    /// Position \[rad or m\].
    pub q: [f64; MAX_JOINTS],
    /// Velocity \[rad/s or m/s\].
    pub dq: [f64; MAX_JOINTS],
    /// Acceleration \[rad/s² or m/s²\].
    pub ddq: [f64; MAX_JOINTS],
    /// Jerk \[rad/s³ or m/s³\].
    pub dddq: [f64; MAX_JOINTS],
    /// Commanded position \[rad or m\].
    pub setpoint: [f64; MAX_JOINTS],
    /// Voltage, current, torque or force, as the model says.
    pub input: [f64; MAX_JOINTS],
}

impl Sample {
    /// The joints' signals as the core types have them.
    pub fn joint_sample(&self) -> JointSample {
        JointSample {
            q: self.q,
            dq: self.dq,
            ddq: self.ddq,
            dddq: self.dddq,
            setpoint: self.setpoint,
            input: self.input,
        }
    }

    /// A message from the core type.
    pub fn new(boot_id: u64, seq: u64, t_ns: u64, joints: usize, signals: u32, sample: &JointSample) -> Self {
        Self {
            boot_id,
            seq,
            t_ns,
            flags: 0,
            joints: joints as u32,
            signals,
            pad: 0,
            q: sample.q,
            dq: sample.dq,
            ddq: sample.ddq,
            dddq: sample.dddq,
            setpoint: sample.setpoint,
            input: sample.input,
        }
    }

    /// True for the last sample of a stream.
    pub fn is_end(&self) -> bool {
        self.flags & sample_flags::END != 0
    }
}

/// What the identifier is doing; `state` of [`Estimate`] and [`Status`].
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum State {
    /// Fewer data than one block.
    #[default]
    Collecting = 0,
    /// Estimates exist and still move.
    Converging = 1,
    /// Estimates have settled within their deviations.
    Converged = 2,
    /// Stopped by a command.
    Paused = 3,
    /// The data carry too little information.
    PoorlyExcited = 4,
    /// A change of the plant is being tracked.
    Changing = 5,
    /// Samples are missing or rejected.
    Degraded = 6,
    /// The estimate must not be used.
    Invalid = 7,
    /// The stream ended and everything received has been processed (status only).
    Ended = 8,
    /// The model does not fit the block: residuals beyond the noise, signals that it does not explain, or a bound that the data push against.
    Misfit = 9,
}

impl State {
    const ALL: [(Self, &'static str); 10] = [
        (Self::Collecting, "collecting"),
        (Self::Converging, "converging"),
        (Self::Converged, "converged"),
        (Self::Paused, "paused"),
        (Self::PoorlyExcited, "poorly_excited"),
        (Self::Changing, "changing"),
        (Self::Degraded, "degraded"),
        (Self::Invalid, "invalid"),
        (Self::Ended, "ended"),
        (Self::Misfit, "misfit"),
    ];

    /// The name as in files and tables.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// The state with this wire value; `None` for a value that this schema does not have.
    pub fn from_wire(value: u32) -> Option<Self> {
        Self::ALL.get(value as usize).map(|&(state, _)| state)
    }
}

/// Topic `estimate`: θ̂ with its evidence, once per block.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "bus", derive(ZeroCopySend), type_name("ThetabusEstimateV2"))]
pub struct Estimate {
    /// `boot_id` of the sample stream.
    pub boot_id: u64,
    /// The paper's m: block = seq div N + 1.
    pub block: u64,
    /// Stream time of the first sample of the block \[ns\].
    pub t_first_ns: u64,
    /// Stream time of the last sample of the block \[ns\].
    pub t_last_ns: u64,
    /// Identifies the model: name, parameters, equations.
    pub model_hash: u64,
    /// Identifies the configuration that determines estimates.
    pub config_hash: u64,
    /// Samples used since the start of the stream.
    pub accepted: u64,
    /// Samples lost since the start of the stream, gaps in `seq`.
    pub missing: u64,
    /// Samples refused since the start of the stream: not finite, out of range, out of order.
    pub rejected: u64,
    /// Bit i: the block's data informed on parameter i.
    pub excited: u64,
    /// Bit i: parameter i is known from data and well enough to be used, if `use_ok` is 1, too. What both mean stands at [`Self::is_usable`].
    pub usable: u64,
    /// Bit i: parameter i is held by configuration or command.
    pub fixed: u64,
    /// Located time of the last change \[ns of stream time\], 0 where none was found.
    pub t_change_ns: u64,
    /// [`State`].
    pub state: u32,
    /// 1 if controllers may use what is marked in `usable`, else 0; see [`Self::is_usable`].
    pub use_ok: u32,
    /// [`estimate_flags`].
    pub flags: u32,
    /// Number of parameters, at most [`MAX_PARAMS`].
    pub params: u32,
    /// Number of equations, at most [`MAX_JOINTS`].
    pub equations: u32,
    /// Number of derived values, at most [`MAX_DERIVED`].
    pub derived_len: u32,
    /// Gauss-Newton iterations of this block.
    pub iterations: u32,
    /// Rows of this block treated as outliers, and samples replaced because they were spikes.
    pub outliers: u32,
    /// Condition number of the column-scaled information, `inf` where singular.
    pub condition: f64,
    /// Root mean square of the innovation f(θ̂ before the update), per equation.
    pub innovation_rms: [f64; MAX_JOINTS],
    /// Root mean square of the residual f(θ̂ after the update), per equation.
    pub residual_rms: [f64; MAX_JOINTS],
    /// χ² of the whitened residuals over their number, per equation: 1 on average if the block fits.
    pub fit: [f64; MAX_JOINTS],
    /// Share of the signal's power that the model explains, per equation, in the last block in which the signal stood out of the noise.
    pub explained: [f64; MAX_JOINTS],
    /// Probability of residuals as large as these, in the block or in its last part, if the model is right: below 1e-4 it is a misfit.
    pub fit_probability: f64,
    /// θ̂, in the units of the model.
    pub theta: [f64; MAX_PARAMS],
    /// Standard deviation of θ̂; `NaN` where the estimator gives none.
    pub theta_std: [f64; MAX_PARAMS],
    /// Physical values computed from θ̂ where the configuration knows the motor constants.
    pub derived: [f64; MAX_DERIVED],
    /// Their standard deviations.
    pub derived_std: [f64; MAX_DERIVED],
}

impl Estimate {
    /// An estimate of nothing: zeros, to be filled.
    pub const EMPTY: Self = Self {
        boot_id: 0,
        block: 0,
        t_first_ns: 0,
        t_last_ns: 0,
        model_hash: 0,
        config_hash: 0,
        accepted: 0,
        missing: 0,
        rejected: 0,
        excited: 0,
        usable: 0,
        fixed: 0,
        t_change_ns: 0,
        state: 0,
        use_ok: 0,
        flags: 0,
        params: 0,
        equations: 0,
        derived_len: 0,
        iterations: 0,
        outliers: 0,
        condition: 0.0,
        innovation_rms: [0.0; MAX_JOINTS],
        residual_rms: [0.0; MAX_JOINTS],
        fit: [0.0; MAX_JOINTS],
        explained: [0.0; MAX_JOINTS],
        fit_probability: 0.0,
        theta: [0.0; MAX_PARAMS],
        theta_std: [0.0; MAX_PARAMS],
        derived: [0.0; MAX_DERIVED],
        derived_std: [0.0; MAX_DERIVED],
    };
}

// The layout is a contract with readers in other languages: a change here is a new schema version.
const _: () = {
    assert!(size_of::<Header>() == 16);
    assert!(size_of::<Sample>() == 40 + 6 * 8 * MAX_JOINTS);
    assert!(offset_of!(Sample, q) == 40);
    assert!(
        size_of::<Estimate>() == 13 * 8 + 8 * 4 + 2 * 8 + 4 * 8 * MAX_JOINTS + 2 * 8 * MAX_PARAMS + 2 * 8 * MAX_DERIVED
    );
    assert!(offset_of!(Estimate, state) == 104);
    assert!(offset_of!(Estimate, condition) == 136);
    assert!(offset_of!(Estimate, fit) == 144 + 2 * 8 * MAX_JOINTS);
    assert!(offset_of!(Estimate, theta) == 152 + 4 * 8 * MAX_JOINTS);
};
