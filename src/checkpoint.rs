//! Checkpoints: the state of an identifier in a file that is either complete or absent.
//!
//! ```text
//! magic 8 | version u32 | CRC-32 of what follows u32 | length u64 | bincode: identity, block, state
//! ```
//!
//! Written to a temporary file, synced, renamed, and the directory synced, so that a crash or a
//! full disk leaves the previous checkpoint. Used only if magic, version, length and CRC are right,
//! model and configuration are the same, and the state is valid for this estimator. bincode 2 is no
//! longer maintained; no other module uses it.

use crate::estimator::EstimatorState;
use crate::files;
use crate::node::command::NodeState;
use bincode::{Decode, Encode};
use nix::fcntl::OFlag;
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

const MAGIC: [u8; 8] = *b"THETABUS";
/// Version of the file; changes with the layout of the state.
pub const CHECKPOINT_VERSION: u32 = 14;
/// Magic, version, CRC, length.
const HEAD: usize = 24;
/// Largest file \[bytes\], far above any state: 128 matrices of
/// [`MAX_PARAMS`](crate::model::MAX_PARAMS) parameters.
const LIMIT: usize = 16 << 20;

/// The owner of a state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Robot name.
    pub robot: String,
    /// Hash of the model.
    pub model_hash: u64,
    /// Hash of the identifier's initial configuration.
    pub config_hash: u64,
}

#[derive(Encode, Decode)]
struct Body {
    robot: String,
    model_hash: u64,
    config_hash: u64,
    stream_id: u64,
    block: u64,
    t_ns: u64,
    blocks: u64,
    reals: Vec<f64>,
    counts: Vec<u64>,
}

/// Why a checkpoint is not used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file system refuses.
    #[error("checkpoint {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Not a checkpoint, or an incomplete one.
    #[error("it is damaged: expected {expected}, got {got}")]
    Damaged {
        /// What was expected.
        expected: String,
        /// What was found.
        got: String,
    },
    /// Of another version of this program.
    #[error(
        "it has version {got}, expected {CHECKPOINT_VERSION}: start cold once, or use the version of the program that wrote it"
    )]
    Version {
        /// Its version.
        got: u32,
    },
    /// Of another robot, model or configuration.
    #[error("it belongs to another {what}: expected {expected}, got {got}")]
    Foreign {
        /// `robot`, `model` or `configuration`.
        what: &'static str,
        /// Ours.
        expected: String,
        /// Its.
        got: String,
    },
    /// More than a checkpoint can hold.
    #[error("a state of {0} bytes is too large")]
    TooLarge(usize),
}

fn configuration() -> impl bincode::config::Config {
    bincode::config::standard()
        .with_fixed_int_encoding()
        .with_limit::<LIMIT>()
}

/// Encodes a state as the bytes of a file.
///
/// # Errors
/// If the state is larger than any estimator's.
pub fn encode(identity: &Identity, state: &NodeState) -> Result<Vec<u8>, CheckpointError> {
    let body = Body {
        robot: identity.robot.clone(),
        model_hash: identity.model_hash,
        config_hash: identity.config_hash,
        stream_id: state.stream_id,
        block: state.block,
        t_ns: state.t_ns,
        blocks: state.blocks,
        reals: state.estimator.reals.clone(),
        counts: state.estimator.counts.clone(),
    };
    let size = 8 * (state.estimator.reals.len() + state.estimator.counts.len());
    let body = bincode::encode_to_vec(body, configuration()).map_err(|_| CheckpointError::TooLarge(size))?;
    let length = (body.len() as u64).to_le_bytes();
    let mut crc = crc32fast::Hasher::new();
    crc.update(&length);
    crc.update(&body);
    let mut bytes = Vec::with_capacity(HEAD + body.len());
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&CHECKPOINT_VERSION.to_le_bytes());
    bytes.extend_from_slice(&crc.finalize().to_le_bytes());
    bytes.extend_from_slice(&length);
    bytes.extend_from_slice(&body);
    Ok(bytes)
}

/// Decodes the state from the bytes of a file.
///
/// # Errors
/// If the bytes are not a valid checkpoint of this identity and version.
pub fn decode(bytes: &[u8], identity: &Identity) -> Result<NodeState, CheckpointError> {
    let damaged = |expected: &str, got: String| CheckpointError::Damaged {
        expected: expected.to_owned(),
        got,
    };
    let Some((head, body)) = bytes.split_at_checked(HEAD) else {
        return Err(damaged("24 bytes and more", format!("{} bytes", bytes.len())));
    };
    let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    if head[..8] != MAGIC {
        return Err(damaged(
            "the mark of a checkpoint at its beginning",
            "something else".to_owned(),
        ));
    }
    let version = u32_at(8);
    if version != CHECKPOINT_VERSION {
        return Err(CheckpointError::Version { got: version });
    }
    let length = u64::from_le_bytes(std::array::from_fn(|i| head[16 + i]));
    if length != body.len() as u64 {
        return Err(damaged(&format!("{length} bytes of state"), body.len().to_string()));
    }
    let mut crc = crc32fast::Hasher::new();
    crc.update(&head[16..]);
    crc.update(body);
    let (stated, found) = (u32_at(12), crc.finalize());
    if stated != found {
        return Err(damaged(&format!("CRC {stated:08x}"), format!("{found:08x}")));
    }
    let (body, read): (Body, usize) =
        bincode::decode_from_slice(body, configuration()).map_err(|e| damaged("a state", e.to_string()))?;
    if read as u64 != length {
        return Err(damaged(
            "nothing behind the state",
            format!("{} bytes", length - read as u64),
        ));
    }
    let foreign = |what, expected: String, got: String| CheckpointError::Foreign { what, expected, got };
    if body.robot != identity.robot {
        return Err(foreign("robot", identity.robot.clone(), body.robot));
    }
    let hash = |hash: u64| format!("hash {hash:016x}");
    if body.model_hash != identity.model_hash {
        return Err(foreign("model", hash(identity.model_hash), hash(body.model_hash)));
    }
    if body.config_hash != identity.config_hash {
        let (ours, its) = (hash(identity.config_hash), hash(body.config_hash));
        return Err(foreign("configuration", ours, its));
    }
    Ok(NodeState {
        estimator: EstimatorState {
            reals: body.reals,
            counts: body.counts,
        },
        stream_id: body.stream_id,
        block: body.block,
        t_ns: body.t_ns,
        blocks: body.blocks,
    })
}

/// The checkpoint of a robot in a directory.
pub fn path(dir: &Path, robot: &str) -> PathBuf {
    dir.join(format!("{robot}.checkpoint"))
}

/// Writes a checkpoint completely or not at all.
///
/// # Errors
/// If the directory cannot be written to or the disk is full; the previous checkpoint then stays.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), CheckpointError> {
    files::write_synced(path, bytes).map_err(|source| CheckpointError::Io {
        path: path.to_path_buf(),
        source,
    })
}

/// The bytes of a checkpoint; `None` if there is none.
///
/// # Errors
/// If the file cannot be read, or is larger than any checkpoint.
pub fn read(path: &Path) -> Result<Option<Vec<u8>>, CheckpointError> {
    let failed = |source| CheckpointError::Io {
        path: path.to_path_buf(),
        source,
    };
    // Opening a pipe would wait for a writer.
    let opened = File::options()
        .read(true)
        .custom_flags(OFlag::O_NONBLOCK.bits())
        .open(path);
    let file = match opened {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        file => file.map_err(failed)?,
    };
    if !file.metadata().map_err(failed)?.is_file() {
        return Err(failed(io::Error::other(
            "expected a file, got a directory, pipe or device",
        )));
    }
    let mut bytes = Vec::new();
    file.take(LIMIT as u64 + 1).read_to_end(&mut bytes).map_err(failed)?;
    match bytes.len() {
        len if len > LIMIT => Err(CheckpointError::TooLarge(len)),
        _ => Ok(Some(bytes)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};
    use std::fs;

    fn identity() -> Identity {
        Identity {
            robot: "arm".into(),
            model_hash: 1,
            config_hash: 2,
        }
    }

    fn state() -> NodeState {
        NodeState {
            estimator: EstimatorState {
                reals: (0..100).map(|i| f64::from(i) * 0.3).collect(),
                counts: (0..20).collect(),
            },
            stream_id: 3,
            block: 4,
            t_ns: 5,
            blocks: 6,
        }
    }

    #[test]
    fn prop_a_state_comes_back_to_the_bit() {
        let dir = tempfile::tempdir().unwrap();
        let file = path(dir.path(), "arm");
        assert!(read(&file).unwrap().is_none());
        for block in [4, 5] {
            let state = NodeState { block, ..state() };
            write(&file, &encode(&identity(), &state).unwrap()).unwrap();
            let bytes = read(&file).unwrap().expect("a checkpoint");
            assert_eq!(decode(&bytes, &identity()).unwrap(), state);
        }
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file stays");
    }

    #[test]
    fn fault_a_hundred_seeded_corrupt_checkpoints_are_all_refused() {
        let whole = encode(&identity(), &state()).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(11);
        for case in 0..100 {
            let mut bytes = whole.clone();
            let below = |random: &mut ChaCha8Rng, n: usize| (random.next_u64() % n as u64) as usize;
            match case % 4 {
                // a bit flipped
                0 => {
                    let at = below(&mut random, bytes.len());
                    bytes[at] ^= 1 << below(&mut random, 8);
                }
                // cut
                1 => bytes.truncate(below(&mut random, whole.len())),
                // 64 bytes of something else
                2 => {
                    let at = below(&mut random, bytes.len() - 64);
                    random.fill_bytes(&mut bytes[at..at + 64]);
                }
                // something appended
                _ => bytes.extend((0..=below(&mut random, 100)).map(|i| i as u8)),
            }
            let error = decode(&bytes, &identity()).expect_err("corrupt");
            assert!(!error.to_string().is_empty());
        }
    }

    #[test]
    fn fault_another_robot_model_configuration_or_version_is_refused_by_name() {
        let cases: [(&str, fn(&mut Identity)); 3] = [
            ("another robot: expected leg, got arm", |i| i.robot = "leg".into()),
            ("another model", |i| i.model_hash = 9),
            ("another configuration", |i| i.config_hash = 9),
        ];
        let bytes = encode(&identity(), &state()).unwrap();
        for (words, change) in cases {
            let mut other = identity();
            change(&mut other);
            let error = decode(&bytes, &other).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
        let mut older = bytes;
        older[8] = 0;
        let error = decode(&older, &identity()).expect_err("version").to_string();
        let expected = format!("version 0, expected {CHECKPOINT_VERSION}");
        assert!(error.contains(&expected), "{error}");
    }

    #[test]
    fn fault_a_directory_that_is_gone_and_a_file_in_its_place_are_told_with_the_path() {
        let dir = tempfile::tempdir().unwrap();
        let gone = dir.path().join("gone").join("arm.checkpoint");
        let error = write(&gone, b"x").expect_err("no directory").to_string();
        assert!(error.contains("gone"), "{error}");
        let file = path(dir.path(), "arm");
        fs::create_dir(&file).unwrap();
        assert!(write(&file, b"x").is_err());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file stays");
    }

    #[test]
    fn fault_a_pipe_a_device_and_a_directory_in_the_place_of_a_checkpoint_are_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let file = path(dir.path(), "arm");
        let make: [&dyn Fn(); 3] = [
            &|| nix::unistd::mkfifo(&file, nix::sys::stat::Mode::S_IRWXU).unwrap(),
            &|| std::os::unix::fs::symlink("/dev/zero", &file).unwrap(),
            &|| fs::create_dir(&file).unwrap(),
        ];
        for make in make {
            make();
            let error = read(&file).expect_err("no file").to_string();
            assert!(error.contains("arm.checkpoint: expected a file, got"), "{error}");
            let _ = fs::remove_file(&file);
        }
    }
}
