//! Errors of the definition of a plant.

use super::{MAX_JOINTS, MAX_PARAMS};
use std::ops::Range;

/// The rule that the definition of a plant breaks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DefinitionError {
    /// The number of joints.
    #[error("expected 1 to {MAX_JOINTS} joints, got {0}")]
    Joints(usize),
    /// The number of parameters.
    #[error("expected 1 to {MAX_PARAMS} parameters, got {0}")]
    Parameters(usize),
    /// The number of equations.
    #[error("expected 1 to {MAX_JOINTS} equations, got {0}")]
    Equations(usize),
    /// Two parameters have the same name.
    #[error("two parameters are called {0}")]
    SameName(String),
    /// A parameter starts outside its bounds.
    #[error("expected a start of {parameter} from {lower} to {upper}, got {got}")]
    Start {
        /// Name of the parameter.
        parameter: String,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
        /// The start that was given.
        got: f64,
    },
    /// A relation names a parameter that does not exist.
    #[error("a relation names parameter {index} of {params}, counted from 0")]
    Relation {
        /// The index in the relation.
        index: usize,
        /// Number of parameters.
        params: usize,
    },
    /// An equation needs the motion of a joint that does not exist.
    #[error("equation {equation}: expected joints below {joints} to need motion, got the mask {mask:#b}")]
    Motion {
        /// Name of the equation.
        equation: String,
        /// Number of joints.
        joints: usize,
        /// One bit per joint.
        mask: u32,
    },
    /// The input of an equation does not exist.
    #[error("equation {equation}: expected an input below {joints}, got {got}")]
    Input {
        /// Name of the equation.
        equation: String,
        /// Number of joints, each with an input.
        joints: usize,
        /// The input that was given.
        got: usize,
    },
    /// The scale of an equation's input is 0 or not finite.
    #[error("equation {equation}: expected an input scale that is finite and not 0, got {got}")]
    InputScale {
        /// Name of the equation.
        equation: String,
        /// The scale that was given.
        got: f64,
    },
    /// An equation has terms of too high an order.
    #[error("equation {equation}: expected terms up to order 2, got {got}")]
    Order {
        /// Name of the equation.
        equation: String,
        /// The order that was given.
        got: usize,
    },
    /// The parameters of an equation are none, or some that do not exist.
    #[error("equation {equation}: expected parameters within 0..{params}, got {got:?}")]
    ParametersOf {
        /// Name of the equation.
        equation: String,
        /// Number of parameters.
        params: usize,
        /// The parameters that were given.
        got: Range<usize>,
    },
}
