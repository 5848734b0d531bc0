//! Projected rows, the weak form (modulating functions, Shinbrot 1957): only positions and inputs
//! are measured.
//!
//! ```text
//! f_i(θ) = s ∫ ψ_i u dt − Σ_d (−1)^d ∫ ψ_i^(d) g_d(q, q̇; θ) dt  one row per equation and window i
//! ```
//!
//! with ψ a smooth bump on a window of length T (`kernel.rs`). Integration by parts has moved every
//! time derivative from the signals to ψ, which is known exactly. Terms that are a constant times a
//! velocity are integrated by parts once more and need only the position; the velocity inside
//! nonlinear terms comes from a zero-phase filter (`velocity_filter.rs`). ∫ψ = 1, so a residual is
//! a weighted mean over the window, in the equation's unit, before it is whitened.
//!
//! | step | type |
//! |---|---|
//! | samples on a grid, spikes and losses repaired | `Samples`, with `intake.rs`, `repair.rs` |
//! | noise of each sample; jumps of the inputs | `SampleNoise`, `InputJumps`; these three form a `MeasuredBlock` |
//! | rows over a standstill, left out of equations that do not hold there | `Standstill` |
//! | covariance R of the rows, and the rows whitened by it | `RowCovariance`, `WhitenedRows` |
//! | positions freed of the errors that the residuals show, of all equations together | `SmoothedSignals`, `SharedErrors` |
//! | regressors freed of the noise left in them | `RegressorNoise`, `Calibration` |
//! | windows that end with the block | `Tail` |
//! | all of these, in this order | `Projection` |
//! | a first θ for R | `FirstFit` |
//!
//! Windows lie on a grid of sample numbers and extend back over the border of a block. Windows over
//! a hole that is too long to repair are dropped.
//!
//! # Noise
//! Row i depends on position k by c_i(k) = −∂f_i/∂q_k and on input k by s w_i(k), so the noise of
//! rows i and j has the covariance
//!
//! ```text
//! R_ij = Σ_k c_i(k) c_j(k) σ_q²(k) + s² σ_u² Σ_k w_i(k) w_j(k) + jumps
//! σ_q²(k) = σ² + LSB²/12 · v_k
//! ```
//!
//! v_k ≥ 1 accounts for rounding that is not white (`rounding.rs`): it is white while the joint
//! crosses counts, and almost constant from sample to sample while it creeps; its errors then add
//! up over many windows. c follows from automatic differentiation at θ̂ before the block, and at
//! reversals of friction from how their instants depend on the positions (`reversal_errors.rs`).
//! The rows are whitened by R, so their residuals have variance 1 and the standard deviations of θ̂
//! need no further factor.
//!
//! # Errors in variables
//! Regressors and residuals contain the same noisy positions, so the two are correlated and least
//! squares is biased: by 10 % in θ₆ for smooth motion and 16 bits. The errors as estimated from the
//! residuals are therefore subtracted from the positions before the regressors are computed:
//!
//! ```text
//! n̂ = E[n | f] = −Σ_q Cᵀ R⁻¹ f(θ̄)        q̂ = q − n̂        φ = −∂f/∂θ at q̂
//! f(θ) ← f_q(θ̄) + f_q̂(θ) − f_q̂(θ̄)       the measured residual at θ̄, and consistent with φ around it
//! ```
//!
//! C holds the c_i, θ̄ is θ̂ before the block. By the projection theorem n − n̂ is uncorrelated
//! with f, and so is φ at the true θ: these are the normal equations of maximum likelihood with the
//! errors as unknowns (the Gauss-Helmert model; structured total least squares). Sources: F. R.
//! Helmert, Die Ausgleichungsrechnung nach der Methode der kleinsten Quadrate, 2nd ed., 1907; P.
//! Lemmerling, B. De Moor, Misfit versus latency, Automatica 37 (2001). A block that θ̄ does not
//! explain is first fitted alone; if that also leaves more than noise, its positions stay as
//! measured.
//!
//! What is left of n in q̂ does not bias, but lengthens φ: the information seems larger than it is,
//! and if a joint hardly moves it is all noise. A draw of the noise through the same rows shows
//! how much (`regressor_noise.rs`), and φ is freed of it (`calibration.rs`).

mod block;
mod calibration;
mod column_noise;
mod covariance;
mod errors_in_variables;
mod evaluation;
mod first_fit;
mod input_jumps;
mod measured;
mod options;
mod projection;
mod regressor_noise;
mod reversal_errors;
mod reversals;
mod sample_noise;
mod samples;
mod sensor_noise;
mod setpoint_steps;
mod shared_errors;
mod tail;
mod velocity_filter;
mod weak_form;
mod whitened_rows;
mod windows;

pub use block::ProjectedBlock;
pub use options::{ProjectedError, ProjectedOptions};
pub use sensor_noise::SensorNoise;
