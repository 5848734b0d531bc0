//! Reads and writes runs as files.
//!
//! A recording is an MCAP file with `cdr` messages and `ros2msg` schemas: PlotJuggler, Foxglove,
//! rerun and the Python packages `mcap` and `mcap-ros2-support` open it with the plant's own
//! parameter names. It contains everything needed to identify again to the same bits: every sample,
//! the configuration, and the commands to the identifier.

mod bag;
mod bag_error;
mod cdr;
mod clock;
mod encoder;
mod estimates_csv;
mod info;
mod joint_state;
mod joint_state_out;
mod journal;
mod layout;
mod loss;
mod names;
mod reader;
mod record_file;
mod samples_csv;
mod series;
#[cfg(test)]
mod tests;
mod unmeasured;
mod wire;
mod writer;

pub use bag_error::BagError;
pub use encoder::Encoder;
pub use estimates_csv::EstimatesCsv;
pub use info::{InfoError, RunInfo};
pub use joint_state::{JointState, read_joint_states};
pub use layout::{Channel, NameCollision, RecorderStatus};
pub use loss::{Loss, ReadError};
pub use reader::{Entry, RecordingReader, Span, read_journal};
#[cfg(feature = "service")]
pub(crate) use samples_csv::is_beyond_repair;
pub use samples_csv::{CsvSampleError, SamplesCsv, SamplesCsvReader, is_samples_csv, separators_of_a_spreadsheet};
pub use series::oldest_file;
pub use wire::{Dimensions, NotOnWire, OnWire, described, from_cdr, to_cdr};
pub use writer::{RecordError, Recorder, RecordingLimits};
