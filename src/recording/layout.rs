//! The fields of each recorded message, named per plant: one definition, from which schema, writer and reader follow.
//!
//! `cdr` with a `ros2msg` schema is what PlotJuggler, Foxglove and rerun all read, and named scalars (`theta_1`, `theta_1_std`) give
//! their legends a meaning that the elements of one array do not have. ROS 2 wants field names
//! `^(?!.*__)(?!.*_$)[a-z][a-z0-9_]*$`, so names are brought into that form, and two names that meet there are refused.

use super::info::RunInfo;
use crate::messages::{Estimate, Sample, Status};
use crate::model::JointSample;
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// A field of an array: its name in the schema and a comment, the unit first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) comment: String,
}

/// Two names of a plant that are the same one in a recording.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("two fields of {message} would have the name `{field}` in a recording; rename one of the parameters")]
pub struct NameCollision {
    /// The message.
    pub message: &'static str,
    /// The field.
    pub field: String,
}

/// The fields that depend on the plant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Layout {
    q: Vec<Column>,
    dq: Vec<Column>,
    ddq: Vec<Column>,
    dddq: Vec<Column>,
    setpoint: Vec<Column>,
    input: Vec<Column>,
    innovation_rms: Vec<Column>,
    residual_rms: Vec<Column>,
    fit: Vec<Column>,
    explained: Vec<Column>,
    theta: Vec<Column>,
    theta_std: Vec<Column>,
    derived: Vec<Column>,
    derived_std: Vec<Column>,
}

/// What a recorder says of itself, about once a second.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Samples written since the recording began, over all its files.
    pub samples: u64,
    /// Estimates written.
    pub estimates: u64,
    /// Status messages written.
    pub statuses: u64,
    /// Samples that never reached the recorder: gaps in `seq`.
    pub samples_missing: u64,
    /// Bytes of this file before this message.
    pub file_bytes: u64,
}

/// Visits the fields of a message in their order.
pub(super) trait Visit {
    type Error;
    fn u32(&mut self, name: &str, comment: &str, value: &mut u32) -> Result<(), Self::Error>;
    fn u64(&mut self, name: &str, comment: &str, value: &mut u64) -> Result<(), Self::Error>;
    fn f64(&mut self, name: &str, comment: &str, value: &mut f64) -> Result<(), Self::Error>;
    /// A text of fixed size.
    fn text(&mut self, name: &str, comment: &str, value: &mut [u8]) -> Result<(), Self::Error>;
    /// One scalar per column; `values` is at least as long.
    fn f64s(&mut self, columns: &[Column], values: &mut [f64]) -> Result<(), Self::Error> {
        for (column, value) in columns.iter().zip(values) {
            self.f64(&column.name, &column.comment, value)?;
        }
        Ok(())
    }
}

impl Layout {
    pub(super) fn new(info: &RunInfo) -> Result<Self, NameCollision> {
        let unit = &info.position_unit;
        let joints = |name: &str, unit: &str| -> Vec<Column> {
            (1..=info.joints)
                .map(|j| column(&format!("{name}_{j}"), unit.to_string()))
                .collect()
        };
        let equations = |name: &str, what: &str| -> Vec<Column> {
            info.equations
                .iter()
                .map(|e| column(&format!("{name}_{e}"), what.to_string()))
                .collect()
        };
        let labels = |labels: &[crate::node::monitor::Label], suffix: &str| -> Vec<Column> {
            labels
                .iter()
                .map(|l| column(&format!("{}{suffix}", l.name), format!("[{}]", l.unit)))
                .collect()
        };
        let layout = Self {
            q: joints("q", &format!("position [{unit}]")),
            dq: joints("dq", &format!("velocity [{unit}/s]")),
            ddq: joints("ddq", &format!("acceleration [{unit}/s^2]")),
            dddq: joints("dddq", &format!("jerk [{unit}/s^3]")),
            setpoint: joints("setpoint", &format!("commanded position [{unit}]")),
            input: joints("input", &format!("drive's input [{}]", info.input_unit)),
            innovation_rms: equations("innovation_rms", "before the update"),
            residual_rms: equations("residual_rms", "after the update"),
            fit: equations("fit", "chi^2/n of the whitened residuals"),
            explained: equations("explained", "share of the signal's power"),
            theta: labels(&info.parameters, ""),
            theta_std: labels(&info.parameters, "_std"),
            derived: labels(&info.derived, ""),
            derived_std: labels(&info.derived, "_std"),
        };
        for (message, schema) in [
            ("Estimate", layout.estimate_schema()),
            ("Sample", layout.sample_schema()),
        ] {
            let mut names = BTreeSet::new();
            for name in schema.lines().filter_map(|line| line.split_whitespace().nth(1)) {
                if !names.insert(name) {
                    return Err(NameCollision {
                        message,
                        field: name.to_string(),
                    });
                }
            }
        }
        Ok(layout)
    }

    pub(super) fn sample<V: Visit>(&self, v: &mut V, m: &mut Sample) -> Result<(), V::Error> {
        v.u64(
            "boot_id",
            "random number of this start of the publisher",
            &mut m.boot_id,
        )?;
        v.u64("seq", "counts from 0, one per sample period", &mut m.seq)?;
        v.u64("t_ns", "stream time [ns]", &mut m.t_ns)?;
        v.u32("flags", "bit 0: last sample of the stream", &mut m.flags)?;
        v.u32("joints", "number of joints", &mut m.joints)?;
        v.u32(
            "signals",
            "valid: bits 0 to 5 are q, dq, ddq, dddq, setpoint, input",
            &mut m.signals,
        )?;
        v.f64s(&self.q, &mut m.q)?;
        v.f64s(&self.dq, &mut m.dq)?;
        v.f64s(&self.ddq, &mut m.ddq)?;
        v.f64s(&self.dddq, &mut m.dddq)?;
        v.f64s(&self.setpoint, &mut m.setpoint)?;
        v.f64s(&self.input, &mut m.input)
    }

    pub(super) fn estimate<V: Visit>(&self, v: &mut V, m: &mut Estimate) -> Result<(), V::Error> {
        v.u64("boot_id", "of the sample stream", &mut m.boot_id)?;
        v.u64("block", "seq div N + 1", &mut m.block)?;
        v.u64("t_first_ns", "first sample of the block [ns]", &mut m.t_first_ns)?;
        v.u64("t_last_ns", "last sample of the block [ns]", &mut m.t_last_ns)?;
        v.u64("model_hash", "", &mut m.model_hash)?;
        v.u64("config_hash", "", &mut m.config_hash)?;
        v.u64("accepted", "samples used since the start", &mut m.accepted)?;
        v.u64("missing", "samples lost since the start", &mut m.missing)?;
        v.u64("rejected", "samples refused since the start", &mut m.rejected)?;
        v.u64("excited", "bit i: the block informed on parameter i", &mut m.excited)?;
        v.u64(
            "usable",
            "bit i: parameter i is known from data; use it if use_ok is 1, too",
            &mut m.usable,
        )?;
        v.u64("fixed", "bit i: parameter i is held", &mut m.fixed)?;
        v.u64(
            "t_change_ns",
            "located time of the last change, 0 for none [ns]",
            &mut m.t_change_ns,
        )?;
        v.u32(
            "state",
            "0 collecting, 1 converging, 2 converged, 3 paused, 4 poorly excited, 5 changing, 6 degraded, 7 invalid, 9 misfit",
            &mut m.state,
        )?;
        v.u32(
            "use_ok",
            "1 if controllers may use what is marked in usable",
            &mut m.use_ok,
        )?;
        v.u32("flags", "bits: changed, incomplete, held, warm", &mut m.flags)?;
        v.u32("params", "number of parameters", &mut m.params)?;
        v.u32("equations", "number of equations", &mut m.equations)?;
        v.u32("derived_len", "number of derived values", &mut m.derived_len)?;
        v.u32("iterations", "Gauss-Newton iterations", &mut m.iterations)?;
        v.u32(
            "outliers",
            "rows treated as outliers and samples replaced as spikes",
            &mut m.outliers,
        )?;
        v.f64("condition", "of the column-scaled information", &mut m.condition)?;
        v.f64s(&self.innovation_rms, &mut m.innovation_rms)?;
        v.f64s(&self.residual_rms, &mut m.residual_rms)?;
        v.f64s(&self.fit, &mut m.fit)?;
        v.f64s(&self.explained, &mut m.explained)?;
        v.f64("fit_probability", "below 1e-4: misfit", &mut m.fit_probability)?;
        v.f64s(&self.theta, &mut m.theta)?;
        v.f64s(&self.theta_std, &mut m.theta_std)?;
        v.f64s(&self.derived, &mut m.derived)?;
        v.f64s(&self.derived_std, &mut m.derived_std)
    }

    pub(super) fn status<V: Visit>(&self, v: &mut V, m: &mut Status) -> Result<(), V::Error> {
        v.u64("boot_id", "of the sample stream", &mut m.boot_id)?;
        v.u64("accepted", "samples used", &mut m.accepted)?;
        v.u64("missing", "samples lost", &mut m.missing)?;
        v.u64("rejected", "samples refused", &mut m.rejected)?;
        v.u64("last_seq", "", &mut m.last_seq)?;
        v.u64("last_t_ns", "stream time of that sample [ns]", &mut m.last_t_ns)?;
        v.u64("estimates", "published since the start", &mut m.estimates)?;
        v.u64("last_block", "of the last estimate", &mut m.last_block)?;
        v.u64("streams", "seen since this process started", &mut m.streams)?;
        v.u32("state", "as in Estimate; 8 ended", &mut m.state)?;
        v.u32("pid", "of the identifier", &mut m.pid)?;
        v.u32(
            "flags",
            "bits: warm, paused, silent, commanded, checkpoints",
            &mut m.flags,
        )?;
        let faults = &mut m.faults;
        v.u64("gaps", "holes in seq", &mut faults.gaps)?;
        v.u64("duplicates", "samples that came twice", &mut faults.duplicates)?;
        v.u64(
            "reordered",
            "samples that came after their successor",
            &mut faults.reordered,
        )?;
        v.u64(
            "clock_jumps",
            "samples whose time does not follow",
            &mut faults.clock_jumps,
        )?;
        v.u64("wrong_joints", "samples", &mut faults.wrong_joints)?;
        v.u64("wrong_signals", "samples", &mut faults.wrong_signals)?;
        v.u64("not_finite", "samples", &mut faults.not_finite)?;
        v.u64("saturated", "samples", &mut faults.saturated)?;
        v.u64("frozen", "samples", &mut faults.frozen)?;
        v.u64(
            "blocks_held",
            "left out for saturated or frozen signals",
            &mut faults.blocks_held,
        )?;
        for (name, timing) in [("step", &mut m.step), ("block", &mut m.block)] {
            v.u64(&format!("{name}_count"), "since the process began", &mut timing.count)?;
            v.u64(&format!("{name}_mean_ns"), "computing time", &mut timing.mean_ns)?;
            v.u64(&format!("{name}_p99_ns"), "", &mut timing.p99_ns)?;
            v.u64(&format!("{name}_max_ns"), "", &mut timing.max_ns)?;
        }
        let process = &mut m.process;
        v.u64("started_ns", "CLOCK_MONOTONIC", &mut process.started_ns)?;
        v.u64(
            "first_sample_ns",
            "CLOCK_MONOTONIC, 0 before",
            &mut process.first_sample_ns,
        )?;
        v.u64("resident_bytes", "memory in use", &mut process.resident_bytes)?;
        v.u64(
            "silent_ns",
            "since the last sample of an open stream",
            &mut process.silent_ns,
        )?;
        v.u64("pauses", "silences of a second or more", &mut process.pauses)?;
        v.u64("commands", "that took effect", &mut process.commands)?;
        v.u64("refused", "requests", &mut process.refused)?;
        v.u64("checkpoints", "written", &mut process.checkpoints)?;
        v.u64(
            "checkpoints_failed",
            "not written or not usable",
            &mut process.checkpoints_failed,
        )?;
        v.u64(
            "recorder_missing",
            "samples that a recorder lost",
            &mut process.recorder_missing,
        )?;
        let realtime = &mut m.realtime;
        v.u32("rt_policy", "0 other, 1 fifo, 2 rr", &mut realtime.policy)?;
        v.u32("rt_priority", "", &mut realtime.priority)?;
        v.u64("rt_affinity", "bit i: CPU i; 0 for any", &mut realtime.affinity)?;
        v.u32("rt_memory_locked", "1 where it is", &mut realtime.memory_locked)?;
        v.u32("rt_refused", "bits: priority, affinity, memory", &mut realtime.refused)?;
        v.f64("fit", "largest chi^2/n of any equation in the last block", &mut m.fit)?;
        v.f64("fit_probability", "below 1e-4: misfit", &mut m.fit_probability)?;
        v.f64("condition", "of the column-scaled information", &mut m.condition)?;
        v.f64("information_ln", "sum of ln of its diagonal", &mut m.information_ln)?;
        v.f64("asymmetry", "of the information", &mut m.asymmetry)?;
        v.u32("error_code", "what went wrong last, 0 nothing", &mut m.error.code)?;
        v.u64("error_seq", "", &mut m.error.seq)?;
        v.text("error", "", &mut m.error.text)
    }

    pub(super) fn recorder<V: Visit>(v: &mut V, m: &mut RecorderStatus) -> Result<(), V::Error> {
        v.u64("samples", "written since the recording began", &mut m.samples)?;
        v.u64("estimates", "written", &mut m.estimates)?;
        v.u64("statuses", "written", &mut m.statuses)?;
        v.u64("samples_missing", "never reached the recorder", &mut m.samples_missing)?;
        v.u64("file_bytes", "of this file before this message", &mut m.file_bytes)
    }

    pub(super) fn sample_schema(&self) -> String {
        schema(|s| self.sample(s, &mut no_sample()))
    }

    pub(super) fn estimate_schema(&self) -> String {
        schema(|s| self.estimate(s, &mut no_estimate()))
    }

    pub(super) fn status_schema(&self) -> String {
        schema(|s| self.status(s, &mut Status::default()))
    }

    pub(super) fn recorder_schema() -> String {
        schema(|s| Self::recorder(s, &mut RecorderStatus::default()))
    }
}

/// A sample of zeros, to be filled.
pub(super) fn no_sample() -> Sample {
    Sample::new(0, 0, 0, 0, 0, &JointSample::default())
}

/// An estimate of zeros, to be filled.
pub(super) fn no_estimate() -> Estimate {
    Estimate::EMPTY
}

fn column(name: &str, comment: String) -> Column {
    Column {
        name: field_name(name),
        comment,
    }
}

/// A name in the form that ROS 2 wants of a field.
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
struct SchemaText(String);

impl SchemaText {
    fn line(&mut self, kind: &str, name: &str, comment: &str) {
        let _ = match comment {
            "" => writeln!(self.0, "{kind} {name}"),
            comment => writeln!(self.0, "{kind} {name}  # {comment}"),
        };
    }
}

impl Visit for SchemaText {
    type Error = std::convert::Infallible;
    fn u32(&mut self, name: &str, comment: &str, _: &mut u32) -> Result<(), Self::Error> {
        self.line("uint32", name, comment);
        Ok(())
    }
    fn u64(&mut self, name: &str, comment: &str, _: &mut u64) -> Result<(), Self::Error> {
        self.line("uint64", name, comment);
        Ok(())
    }
    fn f64(&mut self, name: &str, comment: &str, _: &mut f64) -> Result<(), Self::Error> {
        self.line("float64", name, comment);
        Ok(())
    }
    fn text(&mut self, name: &str, comment: &str, _: &mut [u8]) -> Result<(), Self::Error> {
        self.line("string", name, comment);
        Ok(())
    }
}

fn schema(visit: impl FnOnce(&mut SchemaText) -> Result<(), std::convert::Infallible>) -> String {
    let mut text = SchemaText(String::new());
    let Ok(()) = visit(&mut text);
    text.0
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
        let layout = Layout::new(&arm()).unwrap();
        let schema = layout.estimate_schema();
        assert!(schema.contains("float64 theta_9  # [V s/rad]\n"), "{schema}");
        assert!(schema.contains("float64 mass_2_std  # [kg]\n"), "{schema}");
        assert!(
            layout
                .sample_schema()
                .ends_with("float64 input_2  # drive's input [V]\n")
        );
    }

    #[test]
    fn fault_names_that_meet_are_refused() {
        let mut info = arm();
        info.parameters[0].name = "Theta 9".into();
        assert_eq!(
            Layout::new(&info),
            Err(NameCollision {
                message: "Estimate",
                field: "theta_9".into()
            })
        );
        // A parameter cannot take the name of a field that every estimate has, nor of another's deviation.
        for name in ["block", "theta_2_std"] {
            let mut info = arm();
            info.parameters[0].name = name.into();
            assert!(Layout::new(&info).is_err(), "{name}");
        }
    }
}
