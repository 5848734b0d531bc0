//! Finds the cause of a change from all rows since: the plant, or a drive or sensor.
//!
//! ```text
//! X_0 = Σ_g (J_0 − J_θ)                nothing has changed                (b) to (d) of inquiry.rs, per group g
//! X_s = X_0′ − (Σ_g u_s)²/Σ_g i_s      error s, of one amplitude, with the parameters as they were
//! X_p = X_0′ − (Σ_s Σ_g u_s)²/Σ_s Σ_g i_s    all errors s of one kind p, of one amplitude
//! X ≤ 30 + number of parameters        explains the rows as well as changed parameters do
//! ```
//!
//! A drive that suddenly gives 5 % less moves every parameter of its equation by 5 % and leaves no
//! residual: the estimate follows, precisely and wrongly. A change of the plant moves some
//! parameters and leaves others. So after a change, each error that can arise while a machine runs
//! is compared with (b) and (c), over all groups together, because two causes at once are unlikely.
//! A supply that sags is one cause and takes the same share from each drive. So if no single error
//! explains the rows, all errors of one kind and one amplitude are compared.
//!
//! No parameter of a group may be used while one of these holds:
//!
//! * All of its parameters seem to have changed.
//! * An error explains the rows, and changed parameters are no plausible cause.
//! * Its estimate is still moving towards the new value.
//!
//! While an error explains the rows as well as a plausible change of the plant does, or while the
//! estimate has moved although the rows show no change, the truth is either θ̂ or still θ₀, and the
//! published covariance covers both (`inquiry.rs`).
//!
//! With most motion this takes a block or two; it may also never happen. Groups that have not moved
//! may be used meanwhile. A change back is recognised in the same way, because θ₀ stays the
//! estimate before the first change.
//!
//! Rows of the block that raised the alarm do not count, because the change may lie within it; nor
//! do rows of a group whose estimate is still converging (`inquiry_step.rs`).
//!
//! An error is named if no other explains the rows about as well, and if either the rows
//! distinguish a change of this size from none in more than half of the directions (a machine at
//! rest shows one direction, which every cause explains), or the error has explained some blocks of
//! motion. If changed parameters are plausible and explain the rows about as well, both are named.
//! Once the error has explained more blocks of motion, a further change leaves its groups without a
//! reference, and only (c) clears them.

use super::considered::PER_EQUATION;
use super::group::GroupState;
use super::index_set::IndexSet;
use super::inquiry::{Comparison, REFUTED};
use super::persist::Visit;
use super::suspicion::Suspicion;

/// Blocks of motion after which an error that alone explains the change is named, and after which
/// another change leaves nothing to compare with.
const LONG: u32 = 2;
const SURE: u32 = 4;
/// Standard deviations of an error's amplitude above which it counts as the cause of the change.
const SEEN: f64 = 5.0;
/// χ² by which an error must explain more than any other to be named.
const ALONE: f64 = 10.0;

/// An error that explains the last change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cause {
    /// The error, of the amplitude that explains the change.
    pub error: Suspicion,
    /// Changed parameters explain it about as well, and are plausible.
    pub or_parameters: bool,
}

/// State of the search for the cause of the last change.
#[derive(Debug, Clone)]
pub struct CauseSearch {
    /// A change was found in this block.
    begun: bool,
    /// Groups whose cause is unclear, or whose further change followed one that an error explained.
    /// They must not be used, unless they are ambiguous.
    withheld: IndexSet,
    lost: IndexSet,
    /// Withheld groups that an error explains as well as changed parameters do: the parameters are
    /// either θ̂ or still θ₀.
    ambiguous: IndexSet,
    /// Number of blocks for which an error has explained the change, and whether one is named.
    blocks: u32,
    named: bool,
    cause: Option<Cause>,
    // scratch
    compared: Vec<Option<Comparison>>,
}

/// Which hypothesis explains the rows since a change.
enum Found {
    /// No change: true if certain, false if the rows are merely consistent with it.
    Nothing(bool),
    /// Changed parameters alone.
    Plant,
    /// Changed parameters alone, but all of a group.
    Everything,
    Error(Likely),
}

/// An error that explains the rows since a change.
struct Likely {
    error: Suspicion,
    /// χ² by which the next error explains less.
    lead: f64,
    /// χ² by which changed parameters explain less.
    lead_over_parameters: f64,
}

/// The error that leaves least of the rows unexplained, and what the next one leaves.
struct Likeliest {
    error: Option<Suspicion>,
    least: f64,
    second: f64,
}

impl Default for Likeliest {
    fn default() -> Self {
        Self {
            error: None,
            least: f64::INFINITY,
            second: f64::INFINITY,
        }
    }
}

impl Likeliest {
    fn consider(&mut self, leaves: f64, error: Suspicion) {
        if leaves < self.least {
            (self.second, self.least, self.error) = (self.least, leaves, Some(error));
        } else {
            self.second = self.second.min(leaves);
        }
    }

    /// The error, if it leaves no more than `limit` and is seen.
    fn explains(&self, limit: f64) -> Option<Found> {
        let error = self
            .error
            .filter(|error| self.least <= limit && error.deviations > SEEN)?;
        Some(Found::Error(Likely {
            error,
            lead: self.second - self.least,
            lead_over_parameters: -self.least,
        }))
    }
}

impl Suspicion {
    /// An error by its score and information.
    fn of(suspect: usize, score: f64, left: f64) -> Self {
        Self {
            suspect,
            drifting: None,
            amplitude: score / left,
            deviations: score.abs() / left.sqrt(),
            share: 1.0,
        }
    }
}

impl CauseSearch {
    /// No change, for a number of groups.
    pub fn new(groups: usize) -> Self {
        Self {
            begun: false,
            withheld: IndexSet::EMPTY,
            lost: IndexSet::EMPTY,
            ambiguous: IndexSet::EMPTY,
            blocks: 0,
            named: false,
            cause: None,
            compared: vec![None; groups],
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.withheld.visit(v);
        self.lost.visit(v);
        self.ambiguous.visit(v);
        v.small(&mut self.blocks);
        v.flag(&mut self.named);
    }

    /// True if no parameter of group k may be used.
    pub fn withholds(&self, k: usize) -> bool {
        self.unclear().contains(k)
    }

    /// True if some group must not be used.
    pub fn is_unclear(&self) -> bool {
        !self.unclear().is_empty()
    }

    /// True if the parameters of group k are either θ̂ or what they were before the change.
    pub fn is_ambiguous(&self, k: usize) -> bool {
        self.withheld.contains(k) && self.ambiguous.contains(k) && !self.lost.contains(k)
    }

    fn unclear(&self) -> IndexSet {
        self.withheld.difference(self.ambiguous).union(self.lost)
    }

    /// The error that explains the change.
    pub fn cause(&self) -> Option<Cause> {
        self.cause
    }

    /// Ends the search without a result.
    pub fn close(&mut self, groups: &mut [GroupState]) {
        groups.iter_mut().for_each(|group| group.inquiry.close());
        self.begun = false;
        (self.withheld, self.lost, self.ambiguous) = Default::default();
        (self.blocks, self.named, self.cause) = (0, false, None);
    }

    /// Begins the search: the plant may have changed from θ̄ of this block, whose covariance is
    /// the one published last.
    pub fn begin(&mut self, groups: &mut [GroupState]) {
        if self.blocks >= SURE {
            self.lost = self.lost.union(self.withheld);
        }
        self.begun = true;
        (self.withheld, self.ambiguous) = ((0..groups.len()).collect(), IndexSet::EMPTY);
        (self.blocks, self.named) = (0, false);
        groups.iter_mut().for_each(GroupState::begin_inquiry);
    }

    /// True while the cause of the last change is sought.
    pub fn is_open(&self, groups: &[GroupState]) -> bool {
        groups.iter().any(|group| group.inquiry.is_open())
    }

    /// True if the rows of this block count, because the change was found before it.
    pub fn counts(&mut self, groups: &[GroupState]) -> bool {
        let begun = std::mem::replace(&mut self.begun, false);
        !begun && self.is_open(groups)
    }

    /// Leaves out group k, because its set of parameters has changed.
    pub fn leave_out(&mut self, k: usize, groups: &mut [GroupState]) {
        groups[k].inquiry.close();
        self.withheld.remove(k);
        self.lost.remove(k);
    }

    /// Judges the rows so far, if some were `added`. Groups `on_its_way` must not be used until the
    /// cause is clear.
    pub fn judge(&mut self, groups: &mut [GroupState], added: bool, on_its_way: IndexSet) {
        if added {
            self.compare(groups, on_its_way);
        }
        let open = on_its_way.iter().filter(|&k| groups[k].inquiry.is_open());
        open.for_each(|k| self.withheld.insert(k));
        self.ambiguous = self.ambiguous.difference(on_its_way);
    }

    fn compare(&mut self, groups: &mut [GroupState], on_its_way: IndexSet) {
        let settled = groups.iter().all(|group| group.confirmation.is_settled());
        for (group, compared) in groups.iter_mut().zip(&mut self.compared) {
            *compared = group.inquiry.compare(group.limits.fixed());
        }
        for k in 0..groups.len() {
            let again = |c: &Comparison| c.is_nothing() && (settled || c.informed);
            if self.lost.contains(k) && self.compared[k].as_ref().is_some_and(again) {
                self.leave_out(k, groups);
                self.compared[k] = None;
            }
        }
        match self.find(groups) {
            None => {}
            Some(Found::Nothing(sure)) => {
                let compared = self.compared_where(|_| true);
                let moved = compared.iter().filter(|&k| groups[k].inquiry.has_moved());
                self.withheld = self.withheld.difference(compared).union(moved.collect());
                self.ambiguous = self.withheld;
                self.named = false;
                if sure && settled && self.withheld.union(on_its_way).is_empty() {
                    self.clear(groups);
                }
            }
            Some(Found::Plant) => self.clear(groups),
            Some(Found::Everything) => {
                self.withheld = self.withheld.union(self.compared_where(|_| true));
                (self.ambiguous, self.named) = (IndexSet::EMPTY, false);
            }
            Some(Found::Error(likely)) => self.suspect(&likely),
        }
        if self.lost.is_empty() && !self.named {
            self.cause = None;
        }
    }

    /// Groups that can be compared with their reference and for which `holds` is true.
    fn compared_where(&self, holds: impl Fn(&Comparison) -> bool) -> IndexSet {
        let chosen = |k: &usize| !self.lost.contains(*k) && self.compared[*k].as_ref().is_some_and(&holds);
        (0..self.compared.len()).filter(chosen).collect()
    }

    /// The hypothesis that explains the rows; `None` if they cannot be compared.
    fn find(&self, groups: &[GroupState]) -> Option<Found> {
        let all = self.compared_where(|_| true);
        if all.is_empty() {
            return None;
        }
        let compared = || all.iter().filter_map(|k| self.compared[k]);
        let nothing: f64 = compared().map(|c| c.nothing).sum();
        let limit = REFUTED + compared().map(|c| c.count as f64).sum::<f64>();
        if nothing <= limit {
            return Some(Found::Nothing(nothing <= 2.0 * (limit - REFUTED)));
        }
        let base: f64 = compared().map(|c| c.base).sum();
        let pulls = |s: usize| all.iter().map(move |k| groups[k].inquiry.pulls()[s]);
        let errors = groups.first().map_or(0, |group| group.inquiry.pulls().len());
        let mut single = Likeliest::default();
        for s in 0..errors {
            let [score, left] = pulls(s).fold([0.0; 2], |sum, pull| [sum[0] + pull[0], sum[1] + pull[1]]);
            if left > 0.0 {
                single.consider(base - score * score / left, Suspicion::of(s, score, left));
            }
        }
        if let Some(found) = single.explains(limit) {
            return Some(found);
        }
        let mut common = Likeliest::default();
        for place in 1..=PER_EQUATION.min(errors.saturating_sub(1)) {
            let alike = (place..errors).step_by(PER_EQUATION).flat_map(pulls);
            let [score, left] = alike.fold([0.0; 2], |sum, pull| [sum[0] + pull[0], sum[1] + pull[1]]);
            if left > 0.0 {
                common.consider(base - score * score / left, Suspicion::of(place, score, left));
            }
        }
        if let Some(found) = common.explains(limit) {
            return Some(found);
        }
        Some(if self.may_be_the_plant() {
            Found::Plant
        } else {
            Found::Everything
        })
    }

    /// True if a change of the plant is plausible in all groups that have changed.
    fn may_be_the_plant(&self) -> bool {
        let unlikely = |c: &Comparison| !c.plausible && !c.is_nothing();
        self.compared_where(unlikely).is_empty()
    }

    /// Records that an error explains the rows.
    fn suspect(&mut self, likely: &Likely) {
        let changed = self.compared_where(|c| !c.is_nothing());
        let compared = self.compared_where(|_| true);
        let suspected = if changed.is_empty() { compared } else { changed };
        self.withheld = self.withheld.difference(compared).union(suspected);
        let plausible = self.may_be_the_plant();
        self.ambiguous = if plausible { self.withheld } else { IndexSet::EMPTY };
        let some_withheld =
            |holds: fn(&Comparison) -> bool| !self.compared_where(holds).intersection(self.withheld).is_empty();
        let (informed, distinguishes) = (some_withheld(|c| c.informed), some_withheld(|c| c.distinguishes));
        self.blocks = if informed { self.blocks.saturating_add(1) } else { 0 };
        let alone = likely.lead > ALONE;
        self.named = alone && (distinguishes || self.blocks >= LONG) || self.blocks >= SURE;
        self.cause = self.named.then_some(Cause {
            error: likely.error,
            or_parameters: plausible && likely.lead_over_parameters <= ALONE,
        });
    }

    /// Clears all groups: the plant has changed, or nothing has.
    fn clear(&mut self, groups: &mut [GroupState]) {
        let cleared = groups.iter_mut().enumerate().filter(|(k, _)| !self.lost.contains(*k));
        cleared.for_each(|(_, group)| group.inquiry.close());
        (self.withheld, self.ambiguous) = Default::default();
        (self.blocks, self.named) = (0, false);
    }
}
