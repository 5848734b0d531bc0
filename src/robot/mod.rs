//! Robots of up to 8 joints from their URDF.

mod base_parameters;
mod dynamics;
mod error;
mod regressor;
mod spatial;
mod tree;
mod urdf;
mod xml;

pub use base_parameters::{BaseParameter, BaseParameters, Standard};
pub use dynamics::{forward_dynamics, inverse_dynamics};
pub use error::UrdfError;
pub use regressor::EnergyRegressors;
pub use spatial::{BODY_PARAMETERS, BodyParameters, Motion, Placement};
pub use tree::{Robot, RobotJoint, Selection};
pub use urdf::{Joint, JointKind, Limits, Link, Urdf};
