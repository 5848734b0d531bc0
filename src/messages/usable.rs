//! Which values of an estimate may be used: one rule, by index or by name.

use super::{Description, Estimate};
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
    /// True if parameter `index`, counted from 0, may be used: `use_ok` is 1 and its bit in
    /// `usable` is set. Use this rule for values used one at a time. A feed-forward, in which all
    /// parameters act together above a loop of its own, has a weaker one:
    /// [`AdaptiveFeedForward`](crate::control::AdaptiveFeedForward).
    ///
    /// | | says | needs |
    /// |---|---|---|
    /// | `use_ok` | the model with θ̂ describes the machine | the last blocks were predicted; this one fits; the signals are explained; the data since the start have informed on more than half of the directions of some group of equations; no bound is at odds with the data; a parameter is usable; no change in this block, few samples lost |
    /// | bit i of `usable` | parameter i is known | three standard deviations below 5 % of it, by the data since the last change; the data since the start have informed on more than half of the directions of its group of equations; no change of this group in this block or the one before, and both fit; no bound of the group is at odds with the data; it is not fixed |
    ///
    /// A fixed parameter is never usable in this sense: its value is the operator's, see `fixed`.
    /// False for an index that the model does not have.
    pub fn is_usable(&self, index: usize) -> bool {
        index < (self.params as usize).min(MAX_PARAMS) && self.use_ok == 1 && self.usable.contains(index)
    }

    /// Parameter `index` with its standard deviation, if it [may be used](Self::is_usable).
    pub fn usable_at(&self, index: usize) -> Option<Usable> {
        self.is_usable(index).then(|| Usable {
            value: self.theta[index],
            std: self.theta_std[index],
        })
    }

    /// The parameter of this name with its standard deviation, if it [may be
    /// used](Self::is_usable). `None` for a name that is not among `names`, and for an estimate of
    /// another model. To detect a misspelt name, call [`ParameterNames::index`] once at the start;
    /// to detect another model, call [`ParameterNames::fit`].
    pub fn usable(&self, names: &ParameterNames, name: &str) -> Option<Usable> {
        names.fit(self).then(|| self.usable_at(names.index(name)?))?
    }
}

/// The names of a model's parameters in the order of θ, which estimates do not carry.
///
/// ```
/// use thetabus::messages::{Estimate, ParameterNames};
/// use thetabus::model::Manipulator;
/// let names = ParameterNames::of(&Manipulator::default());
/// assert_eq!(names.index("theta_7"), Some(6));
/// // an empty estimate has no usable parameter
/// assert_eq!(Estimate::EMPTY.usable(&names, "theta_7"), None);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ParameterNames {
    names: Vec<String>,
    /// 0 if it is not known.
    model_hash: u64,
}

impl ParameterNames {
    /// These names, in the order of θ: those of a recording, for example. Their model is unknown,
    /// so they [fit](Self::fit) every estimate.
    pub fn new(names: impl IntoIterator<Item = impl Into<String>>) -> Self {
        Self {
            names: names.into_iter().map(Into::into).collect(),
            model_hash: 0,
        }
    }

    /// The names that an identifier has published; they fit only its estimates.
    pub fn described(description: &Description) -> Self {
        Self {
            model_hash: description.model_hash,
            ..Self::new(description.parameters().iter().map(super::ParameterInfo::name))
        }
    }

    /// The names of a plant; they fit only estimates of that plant.
    pub fn of(plant: &impl crate::model::Plant) -> Self {
        Self {
            model_hash: crate::model::PlantDefinition::of(plant).hash(),
            ..Self::new(plant.parameters().iter().map(|p| &*p.name))
        }
    }

    /// False if the estimate is of another model, whose θ has other names. An estimate without a
    /// `model_hash` (0) fits every model.
    pub fn fit(&self, estimate: &Estimate) -> bool {
        self.model_hash == 0 || estimate.model_hash == 0 || self.model_hash == estimate.model_hash
    }

    /// Index of a parameter, from 0.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|own| own == name)
    }

    /// All of them.
    pub fn as_slice(&self) -> &[String] {
        &self.names
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
            usable: [1, 2].into_iter().collect(),
            ..Estimate::EMPTY
        };
        (estimate.theta[1], estimate.theta_std[1]) = (3.0, 0.01);
        assert_eq!(
            estimate.usable(&names, "friction"),
            Some(Usable { value: 3.0, std: 0.01 })
        );
        assert_eq!(estimate.usable(&names, "mass"), None);
        assert_eq!(estimate.usable(&names, "Friction"), None);
        // a bit beyond the parameters; an index beyond the mask
        assert!(!estimate.is_usable(2) && !estimate.is_usable(MAX_PARAMS + 1) && !estimate.is_usable(usize::MAX));
        estimate.use_ok = 0;
        assert!(!estimate.is_usable(1));
    }

    #[test]
    fn fault_names_of_one_model_give_nothing_from_estimates_of_another() {
        use crate::model::{DriveInput, Manipulator, Motion, Plant, PlantDefinition, ServoAxis};
        let axis = ServoAxis::new(Motion::Linear, DriveInput::Force, 1.0).expect("a gain");
        let [own, foreign] = [
            PlantDefinition::of(&axis).hash(),
            PlantDefinition::of(&Manipulator::default()).hash(),
        ];
        assert_ne!(own, foreign);
        let names = ParameterNames::of(&axis);
        let mut estimate = Estimate {
            params: axis.parameters().len() as u32,
            use_ok: 1,
            usable: [0].into_iter().collect(),
            model_hash: own,
            ..Estimate::EMPTY
        };
        assert!(names.fit(&estimate) && estimate.usable(&names, "mass").is_some());
        estimate.model_hash = foreign;
        assert!(!names.fit(&estimate));
        assert_eq!(estimate.usable(&names, "mass"), None);
        // an identifier in the same process need not say which model it has
        estimate.model_hash = 0;
        assert!(estimate.usable(&names, "mass").is_some());
    }
}
