//! How samples become rows.

use super::projected::ProjectedOptions;

/// How samples become rows.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one per identifier")]
pub enum RowForm {
    /// One row per sample and equation.
    Pointwise,
    /// One row per window and equation, from positions and inputs.
    Projected(ProjectedOptions),
}
