//! The quantities shown: names, units, meanings.

/// A parameter or a derived value.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Short name: `theta_1`, `mass_2`.
    pub name: String,
    /// SI unit, `"1"` if there is none.
    pub unit: String,
    /// What it is, in a few words; may be empty.
    pub meaning: String,
    /// Lower bound, `-inf` for none.
    pub lower: f64,
    /// Upper bound, `inf` for none.
    pub upper: f64,
}

impl Quantity {
    /// A value without bounds.
    pub fn new(name: &str, unit: &str, meaning: &str) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            meaning: meaning.to_owned(),
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
        }
    }

    /// Sets the bounds, infinite for none.
    #[must_use]
    pub fn within(mut self, lower: f64, upper: f64) -> Self {
        (self.lower, self.upper) = (lower, upper);
        self
    }
}

/// The machine and model of an identification.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct About {
    /// Name of the machine.
    pub robot: String,
    /// Domain of the bus.
    pub domain: String,
    /// Name of the model.
    pub model: String,
    /// Number of joints, at most [`MAX_JOINTS`](crate::model::MAX_JOINTS).
    pub joints: usize,
    /// Unit of the positions: rad or m.
    pub position_unit: String,
    /// Unit of the inputs: V, A, N m or N.
    pub input_unit: String,
}
