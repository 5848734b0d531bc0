//! Errors of bags of ROS 2.

use std::error::Error;
use std::io;
use std::path::PathBuf;

/// Name of the schema of joints' states in MCAP files of ROS 2.
pub(super) const SCHEMA: &str = "sensor_msgs/msg/JointState";
/// Largest file \[bytes\].
pub(super) const LARGEST: u64 = 4 << 30;

/// Why a bag gives no states of joints.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BagError {
    /// A file or directory cannot be read.
    #[error("{}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file is too large to be read at once.
    #[error("{}: expected at most {LARGEST} bytes, got {got}; cut the bag", file.display())]
    Large {
        /// The file.
        file: PathBuf,
        /// Its size \[bytes\].
        got: u64,
    },
    /// A directory has no files of a bag.
    #[error("{}: expected a bag with files *.mcap, got none", dir.display())]
    NoFiles {
        /// The directory.
        dir: PathBuf,
    },
    /// A file is not MCAP, or is damaged.
    #[error("{}: {source}; expected an MCAP file, as `ros2 bag record` writes it", file.display())]
    Mcap {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        source: Box<dyn Error + Send + Sync>,
    },
    /// A chunk is damaged, too large, or compressed in another way.
    #[error(
        "{}: expected chunks without compression or with lz4 or zstd, of at most 64 MiB, got a damaged one or \"{compression}\"",
        file.display()
    )]
    Chunk {
        /// The file.
        file: PathBuf,
        /// The compression that it names.
        compression: String,
    },
    /// A message is not what its schema says.
    #[error(
        "{}: {topic}: expected a {SCHEMA} in little-endian CDR, got {bytes} bytes of something else",
        file.display()
    )]
    Message {
        /// The file.
        file: PathBuf,
        /// Topic of the message.
        topic: String,
        /// Length of the message \[bytes\].
        bytes: usize,
    },
    /// No message has all joints.
    #[error(
        "{}: expected messages {SCHEMA} with positions of {}, got {}",
        path.display(),
        joints.join(", "),
        match seen.is_empty() {
            true => "none of that type".to_owned(),
            false => format!("the joints {}", seen.join(", ")),
        }
    )]
    NoStates {
        /// The bag.
        path: PathBuf,
        /// The joints that were asked for.
        joints: Vec<String>,
        /// The joints in the messages.
        seen: Vec<String>,
    },
}
