//! Bags of ROS 2 with `sensor_msgs/msg/JointState`: what a driver publishes of an arm, whoever recorded it.
//!
//! ```text
//! JointState = stamp (int32 s, uint32 ns), frame_id string, name string[], position float64[], velocity float64[], effort float64[]
//! ```
//!
//! in CDR, little-endian, each scalar aligned to its size behind the four bytes of encapsulation. A driver may publish arm and gripper in turn on one topic: messages that do not
//! hold all joints are passed over.

use std::path::{Path, PathBuf};

/// Name of the schema in MCAP files of ROS 2.
const SCHEMA: &str = "sensor_msgs/msg/JointState";
/// Largest file that is read \[bytes\].
const LARGEST: u64 = 4 << 30;
/// Longest list of a message that is believed.
const LONGEST: usize = 1 << 16;

/// The joints of one message, in the order that was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct JointState {
    /// Stamp of the header; time of logging if the driver leaves the stamp empty \[ns\].
    pub t_ns: u64,
    /// Positions \[rad or m\].
    pub position: Vec<f64>,
    /// Velocities \[rad/s or m/s\]; empty if the driver publishes none.
    pub velocity: Vec<f64>,
    /// Torques, forces or currents; empty if the driver publishes none.
    pub effort: Vec<f64>,
}

/// The states of these joints in a bag: an MCAP file, or a directory of ROS 2 with such files. Of several topics the first one with all joints is taken.
///
/// # Errors
/// A file that cannot be read, or without a message that holds all joints, in words with the file's name.
pub fn read_joint_states(path: &Path, joints: &[&str]) -> Result<Vec<JointState>, String> {
    let mut states: Vec<JointState> = Vec::new();
    let mut topic: Option<String> = None;
    let mut seen: Vec<String> = Vec::new();
    for file in files(path)? {
        let problem = |e: &dyn std::fmt::Display| format!("{}: {e}", file.display());
        crate::pipe::refuse_named_pipe(&file).map_err(|e| problem(&e))?;
        let size = std::fs::metadata(&file).map_err(|e| problem(&e))?.len();
        if size > LARGEST {
            return Err(problem(&format!(
                "expected at most {LARGEST} bytes, got {size}; cut the bag"
            )));
        }
        let bytes = std::fs::read(&file).map_err(|e| problem(&e))?;
        let messages = mcap::MessageStream::new(&bytes).map_err(|e| problem(&e))?;
        for message in messages {
            let message = message.map_err(|e| {
                problem(&format!(
                    "{e}; expected an MCAP file without compression or with lz4, as `ros2 bag convert` writes it"
                ))
            })?;
            let is_state = message
                .channel
                .schema
                .as_ref()
                .is_some_and(|schema| schema.name == SCHEMA);
            let is_other = topic.as_ref().is_some_and(|topic| *topic != message.channel.topic);
            if !is_state || is_other {
                continue;
            }
            let all = All::parse(&message.data).ok_or_else(|| {
                problem(&format!(
                    "{}: expected a {SCHEMA} in little-endian CDR, got {} bytes of something else",
                    message.channel.topic,
                    message.data.len()
                ))
            })?;
            for name in &all.names {
                if !seen.contains(name) && seen.len() < LONGEST {
                    seen.push(name.clone());
                }
            }
            if let Some(mut state) = all.of(joints) {
                if state.t_ns == 0 {
                    state.t_ns = message.log_time;
                }
                topic.get_or_insert_with(|| message.channel.topic.clone());
                states.push(state);
            }
        }
    }
    match states.is_empty() {
        false => Ok(states),
        true => Err(format!(
            "{}: expected messages {SCHEMA} with positions of {}, got {}",
            path.display(),
            joints.join(", "),
            match seen.is_empty() {
                true => "none of that type".to_owned(),
                false => format!("the joints {}", seen.join(", ")),
            }
        )),
    }
}

/// The MCAP files of a bag, in the order of their names.
fn files(path: &Path) -> Result<Vec<PathBuf>, String> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let problem = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let entries = std::fs::read_dir(path).map_err(|e| problem(&e))?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|file| file.extension().is_some_and(|name| name.eq_ignore_ascii_case("mcap")))
        .collect();
    // bag_9.mcap comes before bag_10.mcap.
    files.sort_by_key(|file| (file.as_os_str().len(), file.clone()));
    match files.is_empty() {
        false => Ok(files),
        true => Err(problem(&"expected a bag with files *.mcap, got none")),
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

    /// These joints; `None` if one of them is not there, or without its position.
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

    /// The length counts the closing zero.
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

    /// CDR by hand: two joints, a frame name that shifts the alignment.
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
        let mut writer = mcap::Writer::new(std::io::BufWriter::new(std::fs::File::create(path).unwrap())).unwrap();
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
        let error = read_joint_states(&path, &["hip"]).unwrap_err();
        assert!(
            error.contains("hip") && error.contains("the joints elbow, wrist, finger"),
            "{error}"
        );
    }

    #[test]
    fn fault_what_is_no_bag_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert!(
            read_joint_states(dir.path(), &["a"])
                .unwrap_err()
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
