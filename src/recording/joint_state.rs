//! ROS 2 bags with `sensor_msgs/msg/JointState`: an arm's signals as published by a driver.
//!
//! ```text
//! JointState = stamp (int32 s, uint32 ns), frame_id string, name string[],
//!              position float64[], velocity float64[], effort float64[]
//! ```
//!
//! in CDR, little-endian, each scalar aligned to its size after the four bytes of encapsulation. A
//! driver may publish arm and gripper alternately on one topic: messages without all joints are
//! skipped.

use super::bag::messages_of;
use super::bag_error::{BagError, LARGEST, SCHEMA};
use std::path::{Path, PathBuf};

/// Longest accepted list of a message.
const LONGEST: usize = 1 << 16;

/// The joints of one message, in the requested order.
#[derive(Debug, Clone, PartialEq)]
pub struct JointState {
    /// Stamp of the header; time of logging if the stamp is empty \[ns\].
    pub t_ns: u64,
    /// Positions \[rad or m\].
    pub position: Vec<f64>,
    /// Velocities \[rad/s or m/s\]; empty if the driver publishes none.
    pub velocity: Vec<f64>,
    /// Torques, forces or currents; empty if the driver publishes none.
    pub effort: Vec<f64>,
}

/// The states of these joints in a bag: an MCAP file, or a directory of such files. Of several
/// topics the first one with all joints is used.
///
/// # Errors
/// If a file cannot be read or no message has all joints; with the file's name.
pub fn read_joint_states(path: &Path, joints: &[&str]) -> Result<Vec<JointState>, BagError> {
    let mut states: Vec<JointState> = Vec::new();
    let mut topic: Option<String> = None;
    let mut seen: Vec<String> = Vec::new();
    for file in files(path)? {
        let failed = |source| BagError::Read {
            file: file.clone(),
            source,
        };
        crate::pipe::refuse_named_pipe(&file).map_err(failed)?;
        let size = std::fs::metadata(&file).map_err(failed)?.len();
        if size > LARGEST {
            return Err(BagError::Large { file, got: size });
        }
        let bytes = std::fs::read(&file).map_err(failed)?;
        messages_of(&file, &bytes, SCHEMA, &mut |of, header, data| {
            if topic.as_ref().is_some_and(|topic| topic != of) {
                return Ok(());
            }
            let all = All::parse(data).ok_or_else(|| BagError::Message {
                file: file.clone(),
                topic: of.to_owned(),
                bytes: data.len(),
            })?;
            for name in &all.names {
                if !seen.contains(name) && seen.len() < LONGEST {
                    seen.push(name.clone());
                }
            }
            if let Some(mut state) = all.of(joints) {
                if state.t_ns == 0 {
                    state.t_ns = header.log_time;
                }
                topic.get_or_insert_with(|| of.to_owned());
                states.push(state);
            }
            Ok(())
        })?;
    }
    match states.is_empty() {
        false => Ok(states),
        true => Err(BagError::NoStates {
            path: path.to_owned(),
            joints: joints.iter().map(|joint| (*joint).to_owned()).collect(),
            seen,
        }),
    }
}

/// The MCAP files of a bag, in the order of their names.
fn files(path: &Path) -> Result<Vec<PathBuf>, BagError> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).map_err(|source| BagError::Read {
        file: path.to_owned(),
        source,
    })?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|file| file.extension().is_some_and(|name| name.eq_ignore_ascii_case("mcap")))
        .collect();
    // bag_9.mcap comes before bag_10.mcap.
    files.sort_by_key(|file| (file.as_os_str().len(), file.clone()));
    match files.is_empty() {
        false => Ok(files),
        true => Err(BagError::NoFiles { dir: path.to_owned() }),
    }
}

/// All joints of one message.
struct All {
    t_ns: u64,
    names: Vec<String>,
    values: [Vec<f64>; 3],
}

impl All {
    fn parse(message: &[u8]) -> Option<Self> {
        let mut reader = match message.split_first_chunk::<4>() {
            Some((&[0, 1, _, _], body)) => Reader { body, position: 0 },
            _ => return None,
        };
        let seconds = i32::from_le_bytes(reader.take()?);
        let nanoseconds = u32::from_le_bytes(reader.take()?);
        reader.text()?;
        let names = (0..reader.count()?).map(|_| reader.text()).collect::<Option<_>>()?;
        let mut list = || -> Option<Vec<f64>> {
            (0..reader.count()?)
                .map(|_| Some(f64::from_le_bytes(reader.take()?)))
                .collect()
        };
        Some(Self {
            t_ns: u64::try_from(seconds).ok()? * 1_000_000_000 + u64::from(nanoseconds),
            names,
            values: [list()?, list()?, list()?],
        })
    }

    /// These joints; `None` if one of them is missing or has no position.
    fn of(&self, joints: &[&str]) -> Option<JointState> {
        let places: Vec<usize> = joints
            .iter()
            .map(|joint| self.names.iter().position(|name| name == joint))
            .collect::<Option<_>>()?;
        let pick = |values: &[f64]| -> Option<Vec<f64>> { places.iter().map(|at| values.get(*at).copied()).collect() };
        let [position, velocity, effort] = &self.values;
        Some(JointState {
            t_ns: self.t_ns,
            position: pick(position)?,
            velocity: pick(velocity).unwrap_or_default(),
            effort: pick(effort).unwrap_or_default(),
        })
    }
}

struct Reader<'a> {
    body: &'a [u8],
    position: usize,
}

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let start = self.position.next_multiple_of(N);
        let bytes = self.body.get(start..)?.first_chunk::<N>()?;
        self.position = start + N;
        Some(*bytes)
    }

    fn count(&mut self) -> Option<usize> {
        let count = u32::from_le_bytes(self.take()?) as usize;
        (count <= LONGEST).then_some(count)
    }

    /// The length includes the final zero.
    fn text(&mut self) -> Option<String> {
        let len = self.count()?;
        let bytes = self.body.get(self.position..self.position + len)?;
        self.position += len;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Some(String::from_utf8_lossy(text).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Hand-written CDR: two joints, and a frame name that shifts the alignment.
    fn message(second: i32, names: &[&str], lists: [&[f64]; 3]) -> Vec<u8> {
        let mut body: Vec<u8> = Vec::new();
        body.extend(second.to_le_bytes());
        body.extend(500_000_000_u32.to_le_bytes());
        let text = |body: &mut Vec<u8>, text: &str| {
            body.resize(body.len().next_multiple_of(4), 0);
            body.extend((text.len() as u32 + 1).to_le_bytes());
            body.extend(text.as_bytes());
            body.push(0);
        };
        text(&mut body, "base");
        body.resize(body.len().next_multiple_of(4), 0);
        body.extend((names.len() as u32).to_le_bytes());
        names.iter().for_each(|name| text(&mut body, name));
        for list in lists {
            body.resize(body.len().next_multiple_of(4), 0);
            body.extend((list.len() as u32).to_le_bytes());
            for x in list {
                body.resize(body.len().next_multiple_of(8), 0);
                body.extend(x.to_le_bytes());
            }
        }
        [&[0, 1, 0, 0][..], &body].concat()
    }

    fn bag(path: &Path, messages: &[Vec<u8>]) {
        compressed_bag(path, messages, None);
    }

    fn compressed_bag(path: &Path, messages: &[Vec<u8>], compression: Option<mcap::Compression>) {
        let file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
        let options = mcap::WriteOptions::new().compression(compression);
        let mut writer = options.create(file).unwrap();
        let schema = writer.add_schema(SCHEMA, "ros2msg", b"").unwrap();
        let channel = writer
            .add_channel(schema, "/joint_states", "cdr", &BTreeMap::new())
            .unwrap();
        for (i, data) in messages.iter().enumerate() {
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: i as u32,
                log_time: 7,
                publish_time: 7,
            };
            writer.write_to_known_channel(&header, data).unwrap();
        }
        writer.finish().unwrap();
    }

    #[test]
    fn prop_joints_come_by_name_in_the_order_that_is_asked_for() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bag_0.mcap");
        let arm = message(3, &["elbow", "wrist"], [&[0.1, 0.2], &[], &[5.0, 6.0]]);
        bag(&path, &[arm, message(4, &["finger"], [&[1.0], &[], &[]])]);
        // The file, and the directory of the bag.
        for place in [path.as_path(), dir.path()] {
            let states = read_joint_states(place, &["wrist", "elbow"]).unwrap();
            let expected = JointState {
                t_ns: 3_500_000_000,
                position: vec![0.2, 0.1],
                velocity: vec![],
                effort: vec![6.0, 5.0],
            };
            assert_eq!(states, [expected]);
        }
        let error = read_joint_states(&path, &["hip"]).unwrap_err().to_string();
        assert!(
            error.contains("hip") && error.contains("the joints elbow, wrist, finger"),
            "{error}"
        );
    }

    /// The file with each chunk compressed by zstd, which the `mcap` crate supports only with the C
    /// library. Indexes stay unchanged, because they are not read here.
    fn with_zstd(bytes: &[u8]) -> Vec<u8> {
        let mut out = mcap::MAGIC.to_vec();
        let mut at = out.len();
        while bytes.len() - at > mcap::MAGIC.len() {
            let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
            let (head, mut body) = (bytes[at], bytes[at + 9..at + 9 + len].to_vec());
            if head == mcap::records::op::CHUNK {
                // Times, size and checksum; the name of the compression, empty; the size of what
                // follows.
                let data = body.split_off(28 + 4 + 8);
                body.truncate(28);
                let level = ruzstd::encoding::CompressionLevel::Fastest;
                let packed = ruzstd::encoding::compress_to_vec(&data[..], level);
                body.extend(4_u32.to_le_bytes());
                body.extend(b"zstd");
                body.extend((packed.len() as u64).to_le_bytes());
                body.extend(packed);
            }
            out.push(head);
            out.extend((body.len() as u64).to_le_bytes());
            out.extend(body);
            at += 9 + len;
        }
        out.extend(mcap::MAGIC);
        out
    }

    #[test]
    fn prop_bags_of_every_compression_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bag.mcap");
        let messages: Vec<Vec<u8>> = (1..2000)
            .map(|k| message(k, &["a", "b"], [&[0.1, f64::from(k)], &[], &[5.0, 6.0]]))
            .collect();
        compressed_bag(&path, &messages, None);
        let plain = read_joint_states(&path, &["a", "b"]).unwrap();
        assert_eq!(plain.len(), 1999);
        let bytes = std::fs::read(&path).unwrap();
        compressed_bag(&path, &messages, Some(mcap::Compression::Lz4));
        assert!(std::fs::metadata(&path).unwrap().len() < bytes.len() as u64 / 2);
        assert_eq!(read_joint_states(&path, &["a", "b"]).unwrap(), plain);
        let zstd = with_zstd(&bytes);
        assert!(zstd.len() < bytes.len());
        std::fs::write(&path, &zstd).unwrap();
        assert_eq!(read_joint_states(&path, &["a", "b"]).unwrap(), plain);
        // Chunks with a wrong zstd label, and an unknown compression.
        let magic = [0x28, 0xb5, 0x2f, 0xfd];
        for (wanted, other) in [(&magic[..], &[0_u8; 4][..]), (b"zstd", b"what")] {
            let at = zstd.windows(4).position(|four| four == wanted).unwrap();
            let mut damaged = zstd.clone();
            damaged[at..at + 4].copy_from_slice(other);
            std::fs::write(&path, damaged).unwrap();
            let error = read_joint_states(&path, &["a"]).unwrap_err().to_string();
            assert!(error.contains("lz4 or zstd"), "{error}");
        }
    }

    #[test]
    fn fault_what_is_no_bag_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert!(
            read_joint_states(dir.path(), &["a"])
                .unwrap_err()
                .to_string()
                .contains("files *.mcap")
        );
        let path = dir.path().join("bag.mcap");
        let whole = message(3, &["a"], [&[0.1], &[0.1], &[0.1]]);
        for len in 0..whole.len() {
            bag(&path, &[whole[..len].to_vec()]);
            assert!(read_joint_states(&path, &["a"]).is_err(), "{len}");
        }
        std::fs::write(&path, b"no bag").unwrap();
        assert!(read_joint_states(&path, &["a"]).is_err());
    }
}
