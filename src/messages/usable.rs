//! What a reader may take from an estimate: one rule, by index or by name.

use super::Estimate;
use crate::model::MAX_PARAMS;

/// A value that may be used, with its standard deviation, in the model's units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Usable {
    /// θ̂ of the parameter.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

impl Estimate {
    /// True if parameter `index`, counted from 0, may be used: `use_ok` is 1 and its bit in `usable` is set. This is the one rule for controllers.
    ///
    /// | | says | needs |
    /// |---|---|---|
    /// | `use_ok` | the model with θ̂ describes the machine | the last blocks were predicted; this one fits; the signals are explained; the data have informed on more than half of the directions since the start; no bound is at odds with the data; no change in this block, few samples lost |
    /// | bit i of `usable` | parameter i is known | three standard deviations below 5 % of it, by the data since the last change; no change of its group of equations in this block or the one before, and both fit; no bound of the group is at odds with the data; it is not fixed |
    ///
    /// A parameter that is fixed is not usable in this sense: its value is the operator's, see `fixed`. False for an index that the model does not have.
    pub fn is_usable(&self, index: usize) -> bool {
        index < (self.params as usize).min(MAX_PARAMS) && self.use_ok == 1 && self.usable >> index & 1 == 1
    }

    /// Parameter `index` with its standard deviation, if it [may be used](Self::is_usable).
    pub fn usable_at(&self, index: usize) -> Option<Usable> {
        self.is_usable(index).then(|| Usable {
            value: self.theta[index],
            std: self.theta_std[index],
        })
    }

    /// The parameter of this name with its standard deviation, if it [may be used](Self::is_usable). `None` for a name that is not among `names`, too:
    /// ask [`ParameterNames::index`] once at the start to tell a misspelt name.
    pub fn usable(&self, names: &ParameterNames, name: &str) -> Option<Usable> {
        self.usable_at(names.index(name)?)
    }
}

/// The names of a model's parameters in the order of θ, which estimates do not carry.
///
/// ```
/// use thetabus::messages::{Estimate, ParameterNames};
/// use thetabus::model::Manipulator;
/// let names = ParameterNames::of(&Manipulator::default());
/// assert_eq!(names.index("theta_7"), Some(6));
/// // of an estimate that says nothing, nothing may be used
/// assert_eq!(Estimate::EMPTY.usable(&names, "theta_7"), None);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ParameterNames(Vec<String>);

impl ParameterNames {
    /// These names, in the order of θ: of `thetabus ctl describe`, or of a recording.
    pub fn new(names: impl IntoIterator<Item = impl Into<String>>) -> Self {
        Self(names.into_iter().map(Into::into).collect())
    }

    /// The names of a plant.
    pub fn of(plant: &impl crate::model::Plant) -> Self {
        Self::new(plant.parameters().iter().map(|p| p.name))
    }

    /// Index of a parameter, from 0.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.0.iter().position(|own| own == name)
    }

    /// All of them.
    pub fn as_slice(&self) -> &[String] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_parameter_is_usable_only_with_use_ok_its_bit_and_its_place() {
        let names = ParameterNames::new(["mass", "friction"]);
        let mut estimate = Estimate {
            params: 2,
            use_ok: 1,
            usable: 0b110,
            ..Estimate::EMPTY
        };
        (estimate.theta[1], estimate.theta_std[1]) = (3.0, 0.01);
        assert_eq!(
            estimate.usable(&names, "friction"),
            Some(Usable { value: 3.0, std: 0.01 })
        );
        assert_eq!(estimate.usable(&names, "mass"), None);
        assert_eq!(estimate.usable(&names, "Friction"), None);
        // a bit beyond the parameters, and an index beyond the mask
        assert!(!estimate.is_usable(2) && !estimate.is_usable(MAX_PARAMS + 1) && !estimate.is_usable(usize::MAX));
        estimate.use_ok = 0;
        assert!(!estimate.is_usable(1));
    }
}
