//! Topic `description`: names, units, meanings and bounds, so that no reader needs a configuration
//! file to label a number.

use super::table::message;
use super::{MAX_DERIVED, NAME, UNIT, put_text, text_of};
use crate::model::{MAX_JOINTS, MAX_PARAMS, MIXED_UNIT};
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;

/// Bytes of a meaning.
pub const MEANING: usize = 128;

message! {
    /// A parameter in a [`Description`].
    pub struct ParameterInfo = "ThetabusParameterInfoV3" {
        name: [u8; NAME], Text, "", "Short name, as in files and tables";
        unit: [u8; UNIT], Text, "", "SI unit, 1 if there is none";
        meaning: [u8; MEANING], Text, "", "What it is, in a few words";
        start: f64, One, "{parameter}", "Value that the identifier starts from";
        lower: f64, One, "{parameter}", "Lower bound, -inf for none";
        upper: f64, One, "{parameter}", "Upper bound, inf for none";
    }
}

message! {
    /// A derived value in a [`Description`].
    pub struct DerivedInfo = "ThetabusDerivedInfoV3" {
        name: [u8; NAME], Text, "", "Short name, as in files and tables";
        unit: [u8; UNIT], Text, "", "SI unit, 1 if there is none";
        meaning: [u8; MEANING], Text, "", "What it is, in a few words";
    }
}

message! {
    /// A joint in a [`Description`].
    pub struct JointInfo = "ThetabusJointInfoV3" {
        name: [u8; NAME], Text, "", "Name";
        position_unit: [u8; UNIT], Text, "", "Unit of the position: rad or m";
        input_unit: [u8; UNIT], Text, "", "Unit of the input: V, A, N m or N";
    }
}

message! {
    /// Topic `description`: what an identifier identifies. Sent at its start and kept for late
    /// joiners.
    pub struct Description = "ThetabusDescriptionV3" {
        model: [u8; NAME], Text, "", "Name of the model";
        input_kind: [u8; UNIT], Text, "", "Kind of the input: voltage, current, torque or force";
        model_hash: u64, One, "", "Identifies the model: name, parameters, equations";
        config_hash: u64, One, "", "Identifies the configuration that determines estimates, as the identifier was started with it";
        block_len: u64, One, "", "Samples in a block, N, as the identifier was started with it";
        sample_period_ns: u64, One, "ns", "Time from one sample to the next";
        joints: u32, One, "", "Number of joints, 1 to 8";
        equations: u32, One, "", "Number of equations, at most 8";
        params: u32, One, "", "Number of parameters, at most 128";
        derived_len: u32, One, "", "Number of derived values, at most 32";
        joint: [JointInfo; MAX_JOINTS], Joint, "", "Joints";
        parameter: [ParameterInfo; MAX_PARAMS], Parameter, "", "Parameters, in the order of theta";
        derived: [DerivedInfo; MAX_DERIVED], Derived, "", "Derived values, in the order of the estimate";
    }
}

impl ParameterInfo {
    /// A parameter with its start value and bounds.
    pub fn new(name: &str, unit: &str, meaning: &str, start: f64, (lower, upper): (f64, f64)) -> Self {
        let mut info = Self {
            start,
            lower,
            upper,
            ..Self::default()
        };
        put_text(&mut info.name, name);
        put_text(&mut info.unit, unit);
        put_text(&mut info.meaning, meaning);
        info
    }

    /// The name.
    pub fn name(&self) -> &str {
        text_of(&self.name)
    }

    /// The unit.
    pub fn unit(&self) -> &str {
        text_of(&self.unit)
    }

    /// The meaning.
    pub fn meaning(&self) -> &str {
        text_of(&self.meaning)
    }
}

impl DerivedInfo {
    /// A derived value.
    pub fn new(name: &str, unit: &str, meaning: &str) -> Self {
        let mut info = Self::default();
        put_text(&mut info.name, name);
        put_text(&mut info.unit, unit);
        put_text(&mut info.meaning, meaning);
        info
    }

    /// The name.
    pub fn name(&self) -> &str {
        text_of(&self.name)
    }

    /// The unit.
    pub fn unit(&self) -> &str {
        text_of(&self.unit)
    }

    /// The meaning.
    pub fn meaning(&self) -> &str {
        text_of(&self.meaning)
    }
}

impl JointInfo {
    /// A joint.
    pub fn new(name: &str, position_unit: &str, input_unit: &str) -> Self {
        let mut info = Self::default();
        put_text(&mut info.name, name);
        put_text(&mut info.position_unit, position_unit);
        put_text(&mut info.input_unit, input_unit);
        info
    }

    /// The name.
    pub fn name(&self) -> &str {
        text_of(&self.name)
    }

    /// Unit of the position.
    pub fn position_unit(&self) -> &str {
        text_of(&self.position_unit)
    }

    /// Unit of the input.
    pub fn input_unit(&self) -> &str {
        text_of(&self.input_unit)
    }
}

impl Description {
    /// Name of the model.
    pub fn model(&self) -> &str {
        text_of(&self.model)
    }

    /// Kind of the input, from its unit.
    pub fn input_kind(&self) -> &str {
        text_of(&self.input_kind)
    }

    /// The unit of the positions, [`MIXED_UNIT`] if joints differ.
    pub fn position_unit(&self) -> &str {
        let units = || self.joints().iter().map(JointInfo::position_unit);
        let first = units().next().unwrap_or("");
        if units().all(|unit| unit == first) {
            first
        } else {
            MIXED_UNIT
        }
    }

    /// The joints.
    pub fn joints(&self) -> &[JointInfo] {
        &self.joint[..(self.joints as usize).min(MAX_JOINTS)]
    }

    /// The parameters, in the order of θ.
    pub fn parameters(&self) -> &[ParameterInfo] {
        &self.parameter[..(self.params as usize).min(MAX_PARAMS)]
    }

    /// The derived values, in the order of the estimate.
    pub fn derived(&self) -> &[DerivedInfo] {
        &self.derived[..(self.derived_len as usize).min(MAX_DERIVED)]
    }

    /// Sets joints, parameters and derived values, as many as there is room for.
    #[must_use]
    pub fn with(
        mut self,
        joints: impl IntoIterator<Item = JointInfo>,
        parameters: impl IntoIterator<Item = ParameterInfo>,
        derived: impl IntoIterator<Item = DerivedInfo>,
    ) -> Self {
        self.joints = fill(&mut self.joint, joints);
        self.params = fill(&mut self.parameter, parameters);
        self.derived_len = fill(&mut self.derived, derived);
        self
    }

    /// Sets the model's name and hash, and the kind of input that follows from the joints' input
    /// unit.
    #[must_use]
    pub fn of_model(mut self, model: &str, model_hash: u64, input_unit: &str) -> Self {
        put_text(&mut self.model, model);
        put_text(&mut self.input_kind, input_kind_of(input_unit));
        self.model_hash = model_hash;
        self
    }
}

/// Fills a list from its head; returns how many values fitted.
fn fill<T>(target: &mut [T], values: impl IntoIterator<Item = T>) -> u32 {
    let mut count = 0;
    for (slot, value) in target.iter_mut().zip(values) {
        *slot = value;
        count += 1;
    }
    count
}

/// The kind of input with this unit: voltage \[V\], current \[A\], torque \[N m\], force \[N\];
/// `input` for any other unit.
pub fn input_kind_of(unit: &str) -> &'static str {
    match unit {
        "V" => "voltage",
        "A" => "current",
        "N m" | "Nm" => "torque",
        "N" => "force",
        _ => "input",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_description_gives_back_what_was_put_in_and_no_more_than_it_has_room_for() {
        let many = (0..MAX_PARAMS + 5).map(|i| {
            let bounds = (0.0, f64::INFINITY);
            ParameterInfo::new(&format!("theta_{}", i + 1), "kg", "a mass", i as f64, bounds)
        });
        let joints = [JointInfo::new("shoulder", "rad", "V")];
        let mut description = Description::default().of_model("arm", 7, "V").with(
            joints,
            many,
            [DerivedInfo::new("mass_2", "kg", "of link 2")],
        );
        assert_eq!((description.model(), description.input_kind()), ("arm", "voltage"));
        assert_eq!(description.joints()[0].name(), "shoulder");
        assert_eq!(
            (
                description.joints()[0].position_unit(),
                description.joints()[0].input_unit()
            ),
            ("rad", "V")
        );
        assert_eq!(description.parameters().len(), MAX_PARAMS);
        let last = description.parameters()[MAX_PARAMS - 1];
        assert_eq!(
            (last.name(), last.unit(), last.meaning(), last.start),
            ("theta_128", "kg", "a mass", 127.0)
        );
        let derived = description.derived()[0];
        assert_eq!(
            (derived.name(), derived.unit(), derived.meaning()),
            ("mass_2", "kg", "of link 2")
        );
        // counts from another process are not trusted
        (description.joints, description.params, description.derived_len) = (u32::MAX, u32::MAX, u32::MAX);
        assert_eq!(description.joints().len(), MAX_JOINTS);
        assert_eq!(description.parameters().len(), MAX_PARAMS);
        assert_eq!(description.derived().len(), MAX_DERIVED);
    }
}
