//! Lengthens windows if errors of the velocities require it.
//!
//! With errors in the regressors, the relative bias of least squares is about the error share of
//! the acceleration. That share falls with the fifth power of the length T of a window:
//!
//! ```text
//! share_k = Σ var(a_k)/Σ (a² − var(a_k)) over the windows,    T ← T (share/SHARE)^(1/5)            (1)
//! ```
//!
//! White noise of measured velocities falls with the third power only: more steps are taken then.
//!
//! Short windows are kept while errors of the velocities hardly affect any joint's torque, because
//! they blur reversals least. If the windows of the first blocks were much too short, these blocks
//! are dropped, because later data do not outweigh them: encoders of 13 bits at 2 ms left inertial
//! parameters 10 to 20 % off for a minute.

use super::learning::{Learner, TRIED};
use super::rows::Motion;
use super::windows::WindowOptions;

/// Share of an acceleration that may be error; encoders of 17 bits have half of it.
const SHARE: f64 = 0.002;
/// Share of the variance of a joint's rows above which errors of the positions are relevant.
const SHOWS: f64 = 0.01;
/// Longest window \[s\].
const LONGEST_S: f64 = 0.3;
/// Smallest step in length, because each step drops the open windows.
const STEP: f64 = 1.1;
/// Step in length above which the first blocks are dropped: a share four times [`SHARE`].
const MUCH: f64 = 1.3;
/// Forgetting factor of the sums (1) per block.
const KEPT: f64 = 0.9;

/// Longer windows.
pub(super) struct Longer {
    pub windows: WindowOptions,
    /// True if the first blocks are to be dropped.
    pub drops_blocks: bool,
}

/// (1) after a block; `None` if the windows are long enough.
pub(super) fn review_windows(motion: &mut Motion, learner: &Learner) -> Option<Longer> {
    let now = &learner.options.windows;
    let block = learner.open.sums();
    let shows = block.iter().zip(learner.levels.std()).any(|(sums, std)| {
        let rows = sums.rows.max(1) as f64;
        sums.noise > SHOWS * rows * std * std
    });
    let share = |k: usize| motion.noise[k] / (motion.square[k] - motion.noise[k]).max(SHARE * motion.square[k]);
    let shares = (0..block.len()).map(share);
    let largest = shares.filter(|x| x.is_finite()).fold(0.0, f64::max);
    let wanted = (now.length_s * (largest / SHARE).powf(0.2)).min(LONGEST_S); // (1)
    motion.fade(KEPT);
    let is_early = learner.blocks <= TRIED && !learner.past.is_condensed();
    (shows && wanted > STEP * now.length_s).then(|| Longer {
        windows: WindowOptions {
            max_gap_s: now.max_gap_s,
            ..WindowOptions::of_length(wanted)
        },
        drops_blocks: wanted > MUCH * now.length_s && is_early,
    })
}
