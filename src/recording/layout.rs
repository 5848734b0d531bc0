//! Layout of a plant's messages in a recording: the tables of `messages`, with a scalar per joint,
//! equation, parameter and derived value.
//!
//! `cdr` with a `ros2msg` schema can be read by PlotJuggler, Foxglove and rerun, and named scalars
//! (`theta_1`, `theta_1_std`) give meaningful legends, unlike the elements of an array. ROS 2
//! requires field names `^(?!.*__)(?!.*_$)[a-z][a-z0-9_]*$`, so names are converted to that form,
//! and two names that become equal are refused.

use super::info::RunInfo;
use super::names::channel;
use crate::messages::table::message;
use crate::messages::{Estimate, Field, Message, Per, SIGNALS, Sample, State, Status, Visit};
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::fmt::Write as _;

/// Two names of a plant that become equal in a recording.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("two fields of {message} would have the name `{field}` in a recording; rename one of the parameters")]
pub struct NameCollision {
    /// The message.
    pub message: &'static str,
    /// The field.
    pub field: String,
}

message! {
    /// Status of a recorder, about once a second.
    #[derive(Eq)]
    pub struct RecorderStatus {
        samples: u64, One, "", "Samples written since the recording began, over all its files";
        estimates: u64, One, "", "Estimates written";
        statuses: u64, One, "", "Status messages written";
        samples_missing: u64, One, "", "Samples that never reached the recorder: gaps in seq";
        file_bytes: u64, One, "bytes", "Length of this file before this message";
    }
}

/// Numbers of values of the arrays in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counts {
    joints: usize,
    equations: usize,
    parameters: usize,
    derived: usize,
    /// Representation of a set of parameters in a message.
    sets: Sets,
}

/// Representation of a set of parameters in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sets {
    /// Words of 64 parameters: one up to schema 2, two in the first recordings of schema 3.
    Words(usize),
    /// One bool per parameter, in the order of θ.
    Bools,
}

impl Counts {
    /// These numbers, in the schema of this program.
    pub(super) fn new(joints: usize, equations: usize, parameters: usize, derived: usize) -> Self {
        Self {
            joints,
            equations,
            parameters,
            derived,
            sets: Sets::Bools,
        }
    }

    /// For a plant's recording, in the schema of this program.
    pub(super) fn of(info: &RunInfo) -> Self {
        Self {
            joints: info.joints,
            equations: info.equations.len(),
            parameters: info.parameters.len(),
            derived: info.derived.len(),
            sets: match (info.first_form, info.schema) {
                (false, _) => Sets::Bools,
                (true, ..3) => Sets::Words(1),
                (true, _) => Sets::Words(2),
            },
        }
    }

    /// Number of bools that represent a set of parameters; `None` if `field` is not a set, or is
    /// stored as words.
    pub(super) fn bools(&self, field: &Field) -> Option<usize> {
        (field.per == Per::One && field.is_array && self.sets == Sets::Bools).then_some(self.parameters)
    }

    /// Values of `field` that are in the file, out of `len`.
    pub(super) fn values(&self, field: &Field, len: usize) -> usize {
        let count = match field.per {
            Per::Joint => self.joints,
            Per::Equation => self.equations,
            Per::Parameter => self.parameters,
            Per::Derived => self.derived,
            Per::Padding => 0,
            Per::One if field.is_array => match self.sets {
                Sets::Words(words) => words,
                Sets::Bools => len,
            },
            _ => len,
        };
        count.min(len)
    }
}

/// Checks that no two fields of a plant's messages have the same name.
///
/// # Errors
/// If two have.
pub(super) fn check_names(info: &RunInfo) -> Result<(), NameCollision> {
    for (message, schema) in [
        ("Estimate", schema::<Estimate>(info)),
        ("Sample", schema::<Sample>(info)),
    ] {
        let mut names = BTreeSet::new();
        for name in field_names(&schema) {
            if !names.insert(name) {
                return Err(NameCollision {
                    message,
                    field: name.to_owned(),
                });
            }
        }
    }
    Ok(())
}

/// Names of the fields of a `ros2msg` text, without its constants.
fn field_names(schema: &str) -> impl Iterator<Item = &str> {
    let names = schema.lines().filter_map(|line| line.split_whitespace().nth(1));
    names.filter(|name| !name.contains('='))
}

/// The `ros2msg` text of a message.
pub(super) fn schema<M: Message>(info: &RunInfo) -> String {
    let mut text = SchemaText {
        info,
        counts: Counts::of(info),
        prefix: String::new(),
        text: String::new(),
    };
    let Ok(()) = { M::EMPTY }.visit(&mut text);
    text.text
}

/// A topic with its schema, encoded as `cdr` and `ros2msg`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Number in a file.
    pub(super) id: u16,
    /// `/thetabus/ROBOT/estimate`.
    pub topic: String,
    /// `thetabus/msg/Estimate`.
    pub schema_name: String,
    /// Fields with their units, as a ROS 2 message definition.
    pub schema: String,
}

/// The topics of this program's own messages, the recorder's last.
pub(super) fn channels(info: &RunInfo) -> [Channel; 4] {
    [
        (channel::SAMPLE, "sample", "Sample", schema::<Sample>(info)),
        (channel::ESTIMATE, "estimate", "Estimate", schema::<Estimate>(info)),
        (channel::STATUS, "status", "Status", schema::<Status>(info)),
        (
            channel::RECORDER,
            "recorder",
            "Recorder",
            schema::<RecorderStatus>(info),
        ),
    ]
    .map(|(id, topic, message, schema)| Channel {
        id,
        topic: format!("/thetabus/{}/{topic}", field_name(&info.robot)),
        schema_name: format!("thetabus/msg/{message}"),
        schema,
    })
}

/// Names for the values of an enumeration field, in the form of ROS 2 constants.
fn constants(field: &str) -> Vec<(String, u32)> {
    let states = || (0..).map_while(State::from_wire);
    match field {
        "state" => states()
            .map(|state| (format!("STATE_{}", state.name().to_uppercase()), state as u32))
            .collect(),
        "signals" => SIGNALS
            .map(|signal| (format!("SIGNAL_{}", signal.name.to_uppercase()), signal.flag))
            .to_vec(),
        _ => Vec::new(),
    }
}

/// A name in the form of a ROS 2 field or topic part.
pub(super) fn field_name(name: &str) -> String {
    let mut field = String::with_capacity(name.len());
    for c in name.chars() {
        let c = c.to_ascii_lowercase();
        if c.is_ascii_alphanumeric() {
            field.push(c);
        } else if !field.is_empty() && !field.ends_with('_') {
            field.push('_');
        }
    }
    let field = field.trim_end_matches('_');
    if field.starts_with(|c: char| c.is_ascii_lowercase()) {
        field.to_string()
    } else {
        format!("p_{field}").trim_end_matches('_').to_string()
    }
}

/// Writes the `ros2msg` text of a message.
struct SchemaText<'a> {
    info: &'a RunInfo,
    counts: Counts,
    /// Names of the structures that contain the field.
    prefix: String,
    text: String,
}

impl SchemaText<'_> {
    fn line(&mut self, kind: &str, name: &str, comment: &str) {
        let name = format!("{}{name}", self.prefix);
        let _ = writeln!(self.text, "{kind} {name}  # {comment}");
    }

    /// One line, or one per joint, equation, parameter or derived value.
    fn lines(&mut self, kind: &str, field: &Field, len: usize) -> Result<(), Infallible> {
        let info = self.info;
        let comment = |unit: &str| match unit {
            "" => field.meaning.to_owned(),
            unit => format!("{} [{unit}]", field.meaning),
        };
        let fixed = field
            .unit
            .replace("{position}", &info.position_unit)
            .replace("{input}", &info.input_unit);
        for (name, value) in constants(field.name) {
            let _ = writeln!(self.text, "{kind} {name}={value}");
        }
        if let Some(parameters) = self.counts.bools(field) {
            for label in info.parameters.iter().take(parameters) {
                let name = field_name(&format!("{}_{}", label.name, field.name));
                self.line("bool", &name, field.meaning);
            }
            return Ok(());
        }
        // theta_1 and theta_1_std: the part after the name of the array
        let suffix = if field.name.ends_with("_std") { "_std" } else { "" };
        for i in 0..self.counts.values(field, len) {
            match field.per {
                Per::Joint => self.line(kind, &format!("{}_{}", field.name, i + 1), &comment(&fixed)),
                Per::Equation => {
                    let name = field_name(&format!("{}_{}", field.name, info.equations[i]));
                    self.line(kind, &name, &comment(&fixed));
                }
                Per::Parameter | Per::Derived => {
                    let labels = if field.per == Per::Parameter {
                        &info.parameters
                    } else {
                        &info.derived
                    };
                    let name = field_name(&format!("{}{suffix}", labels[i].name));
                    self.line(kind, &name, &comment(&labels[i].unit));
                }
                _ if field.is_array => {
                    self.line(
                        &format!("{kind}[{}]", self.counts.values(field, len)),
                        field.name,
                        &comment(&fixed),
                    );
                    break;
                }
                _ => self.line(kind, field.name, &comment(&fixed)),
            }
        }
        Ok(())
    }
}

impl Visit for SchemaText<'_> {
    type Error = Infallible;
    fn u8s(&mut self, field: &Field, _: &mut [u8]) -> Result<(), Infallible> {
        match field.per {
            Per::Text => {
                self.line("string", field.name, field.meaning);
                Ok(())
            }
            _ => self.lines("uint8", field, field.len),
        }
    }
    fn u32s(&mut self, field: &Field, values: &mut [u32]) -> Result<(), Infallible> {
        self.lines("uint32", field, values.len())
    }
    fn u64s(&mut self, field: &Field, values: &mut [u64]) -> Result<(), Infallible> {
        self.lines("uint64", field, values.len())
    }
    fn f64s(&mut self, field: &Field, values: &mut [f64]) -> Result<(), Infallible> {
        self.lines("float64", field, values.len())
    }
    fn enter(&mut self, field: &Field, _: usize) {
        self.prefix = format!("{}_", field.name);
    }
    fn leave(&mut self) {
        self.prefix.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::super::info::tests::arm;
    use super::*;

    #[test]
    fn prop_field_names_have_the_form_that_ros_2_wants() {
        for (name, field) in [
            ("theta_1", "theta_1"),
            ("I1zz", "i1zz"),
            ("link1__mass", "link1_mass"),
            ("link 1.mass [kg]", "link_1_mass_kg"),
            ("_x_", "x"),
            ("2nd", "p_2nd"),
            ("θ", "p"),
        ] {
            assert_eq!(field_name(name), field);
        }
    }

    #[test]
    fn regress_the_schema_names_every_parameter_with_its_unit() {
        let text = schema::<Estimate>(&arm());
        assert!(text.contains("float64 theta_9  # Estimate [V s/rad]\n"), "{text}");
        assert!(text.contains("float64 residual_rms_joint_2  # Root"), "{text}");
        assert!(text.contains("bool theta_9_usable  # Parameters"), "{text}");
        assert!(text.contains("uint32 STATE_POORLY_EXCITED=4\n"), "{text}");
        let deviation = "float64 mass_2_std  # Its standard deviation, NaN if it is not known [kg]\n";
        assert!(text.contains(deviation), "{text}");
        let text = schema::<Sample>(&arm());
        assert!(text.contains("float64 dq_1  # Velocity [rad/s]\n"), "{text}");
        assert!(text.ends_with("as the description says [V]\n"), "{text}");
        let text = schema::<Status>(&arm());
        assert!(text.contains("uint64 step_p99_ns  # 99 of"), "{text}");
    }

    /// Every field of the table except padding is in the schema, in the table's order.
    #[test]
    fn prop_the_schema_has_every_field_of_the_message_in_its_order() {
        fn expected(info: &RunInfo, prefix: &str, layout: &crate::messages::Layout, names: &mut Vec<String>) {
            for field in layout.fields {
                let own = format!("{prefix}{}", field.name);
                let suffix = if field.name.ends_with("_std") { "_std" } else { "" };
                let labelled = |labels: &[crate::node::monitor::Label]| {
                    labels.iter().map(|l| format!("{}{suffix}", l.name)).collect()
                };
                let list: Vec<String> = match (field.per, field.kind) {
                    (Per::Padding, _) => Vec::new(),
                    (_, crate::messages::Kind::Struct(inner)) => {
                        expected(info, &format!("{own}_"), inner, names);
                        Vec::new()
                    }
                    (Per::Joint, _) => (1..=info.joints).map(|j| format!("{own}_{j}")).collect(),
                    (Per::Equation, _) => info.equations.iter().map(|e| format!("{own}_{e}")).collect(),
                    (Per::Parameter, _) => labelled(&info.parameters),
                    (Per::Derived, _) => labelled(&info.derived),
                    (Per::One, _) if field.is_array => {
                        info.parameters.iter().map(|l| format!("{}_{own}", l.name)).collect()
                    }
                    _ => vec![own],
                };
                names.extend(list);
            }
        }
        fn check<M: Message>() {
            let info = arm();
            let text = schema::<M>(&info);
            let found: Vec<&str> = field_names(&text).collect();
            let mut names = Vec::new();
            expected(&info, "", M::LAYOUT, &mut names);
            assert_eq!(found, names);
        }
        check::<Sample>();
        check::<Estimate>();
        check::<Status>();
        check::<RecorderStatus>();
    }

    #[test]
    fn val_topics_have_names_that_ros_2_takes_whatever_the_robot_is_called() {
        for (robot, part) in [("arm-1", "arm_1"), ("7th", "p_7th"), ("arm", "arm")] {
            let info = RunInfo {
                robot: robot.to_owned(),
                ..arm()
            };
            let own = channels(&info).map(|channel| channel.topic);
            assert!(
                own.iter().all(|topic| topic.starts_with(&format!("/thetabus/{part}/"))),
                "{own:?}"
            );
            let joints = crate::recording::joint_state_out::JointStates::channel(&info).topic;
            assert_eq!(joints, format!("/{part}/joint_states"));
        }
    }

    #[test]
    fn regress_the_layouts_for_plotjuggler_and_foxglove_name_fields_of_recordings() {
        let mut info = arm();
        info.derived.push(crate::node::monitor::Label {
            name: "mass_1".into(),
            unit: "kg".into(),
        });
        let channels = channels(&info);
        for text in [
            include_str!("../../docs/layouts/plotjuggler.xml"),
            include_str!("../../docs/layouts/foxglove.json"),
        ] {
            let mut fields = 0;
            for rest in text.split("\"/thetabus/arm/").skip(1) {
                let path = rest.split('"').next().unwrap_or("");
                let (topic, field) = path.split_once(['/', '.']).unwrap();
                let topic = format!("/thetabus/arm/{topic}");
                let channel = channels.iter().find(|channel| channel.topic == topic);
                let schema = &channel.unwrap_or_else(|| panic!("no topic {topic}")).schema;
                let is_there = schema.lines().any(|line| line.split_whitespace().nth(1) == Some(field));
                assert!(is_there, "{path} is not in\n{schema}");
                fields += 1;
            }
            assert!(fields > 15, "{fields}");
        }
    }

    #[test]
    fn fault_names_that_meet_are_refused() {
        let mut info = arm();
        info.parameters[0].name = "Theta 9".into();
        assert_eq!(
            check_names(&info),
            Err(NameCollision {
                message: "Estimate",
                field: "theta_9_excited".into()
            })
        );
        // A parameter cannot have the name of a field of every estimate, nor of another's standard
        // deviation.
        for name in ["block", "theta_2_std", "theta_2_fixed"] {
            let mut info = arm();
            info.parameters[0].name = name.into();
            assert!(check_names(&info).is_err(), "{name}");
        }
    }
}
