//! placeholder (H2)
/// The paper's two-joint arm.
#[derive(Debug, Clone)]
pub struct Manipulator {}
