//! A controller that uses θ̂.
//!
//! ```text
//! estimates ─▶ gate (use_ok, σ) ─▶ bumpless θ ─▶ u_ff ─▶ machine, on top of its PD loop
//!
//! u_ff: the input that the equations ask for along the trajectory
//! ```

mod adaptive;
#[cfg(feature = "sim")]
mod trajectory;

pub use adaptive::{AdaptiveError, AdaptiveFeedForward, AdaptiveOptions, Knowledge};
#[cfg(feature = "sim")]
pub use trajectory::{CATCH_UP, Trajectory, TrajectoryError};
