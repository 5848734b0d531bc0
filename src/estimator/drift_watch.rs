//! Decides how long a drift is followed: from the block that shows it until its line no longer
//! explains a block or no longer moves.

use super::group::GroupState;
use super::index_set::IndexSet;
use super::options::EstimatorOptions;
use super::pass::Summable;
use super::persist::Visit;

/// Share of its size by which a drifting parameter may always move per block.
const DRIFT_RATE: f64 = 0.01;
/// Blocks in a row without movement after which a drift has ended.
const STILL_BLOCKS: u32 = 4;

/// The drift that is followed, in all groups or none.
#[derive(Debug, Clone, Copy, Default)]
pub struct DriftWatch {
    /// Consecutive blocks in which the followed line did not move significantly.
    still: u32,
}

impl DriftWatch {
    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        v.small(&mut self.still);
    }

    /// Continues the lines of a drift while they explain the block and any of them moves. Returns
    /// the groups that continue, all or none, and whether a line ended because it does not explain
    /// the block.
    pub fn follow(
        &mut self,
        rows: &dyn Summable,
        groups: &mut [GroupState],
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) -> (IndexSet, bool) {
        let lines = drifting(groups);
        if lines.is_empty() {
            return (lines, false);
        }
        // the speed of a drift may change by a third from block to block
        let change = 0.3 * groups.iter().map(|g| g.slope_rate(theta)).fold(DRIFT_RATE, f64::max);
        let (mut explained, mut moves, mut bends) = (true, false, false);
        for group in groups.iter_mut().filter(|g| g.drift.active) {
            group.equations.limit_by_known_noise(options);
            explained &= group.follow_line(rows, theta, change);
            moves |= group.drift.moves();
            bends |= group.line_bends(theta);
        }
        self.still = if moves { 0 } else { self.still.saturating_add(1) };
        for group in groups.iter_mut().filter(|g| g.drift.active) {
            group.drift.active = explained && self.still < STILL_BLOCKS && group.end_line(theta);
            if !group.drift.active {
                // the fit of the line has left its own prior
                group.prior_from_information();
            }
        }
        let lines = drifting(groups);
        (lines, !explained && bends)
    }

    /// Begins to follow a drift in every group, because a constant fitted to a drifting group would
    /// have errors in its poorly excited parameters. Returns the groups that could.
    pub fn start(
        &mut self,
        rows: &dyn Summable,
        groups: &mut [GroupState],
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) -> IndexSet {
        let (mut rate, mut off) = (DRIFT_RATE, DRIFT_RATE);
        for group in groups.iter_mut() {
            group.equations.limit_by_known_noise(options);
            group.line_cost(rows, theta);
            let (own_rate, own_off) = group.line_rates(theta);
            (rate, off) = (rate.max(own_rate), off.max(own_off));
        }
        self.still = 0;
        let all = groups.iter_mut().enumerate();
        let started = all.filter_map(|(k, group)| group.start_line(rows, theta, rate, off).then_some(k));
        started.collect()
    }
}

/// The groups that follow a line.
fn drifting(groups: &[GroupState]) -> IndexSet {
    (0..groups.len()).filter(|&k| groups[k].drift.active).collect()
}
