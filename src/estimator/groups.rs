//! All independent groups of parameters, and the operations on all of them.

use super::Structure;
use super::cause_search::CauseSearch;
use super::group::GroupState;
use super::options::EstimatorOptions;
use super::pass::Summable;
use super::persist::Visit;
use std::ops::{Deref, DerefMut};

/// The groups, ordered by their first parameter.
#[derive(Debug, Clone)]
pub struct Groups {
    pub states: Vec<GroupState>,
    /// The search for the cause of the last change.
    pub cause_search: CauseSearch,
}

impl Deref for Groups {
    type Target = [GroupState];

    fn deref(&self) -> &[GroupState] {
        &self.states
    }
}

impl DerefMut for Groups {
    fn deref_mut(&mut self) -> &mut [GroupState] {
        &mut self.states
    }
}

impl Groups {
    /// The start state of validated options.
    pub fn new(structure: &Structure, options: &EstimatorOptions) -> Self {
        let groups = structure.groups();
        let states = groups.iter().map(|group| GroupState::new(group, structure, options));
        Self {
            cause_search: CauseSearch::new(groups.len()),
            states: states.collect(),
        }
    }

    /// What goes from block to block; see `persist.rs`.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.states.iter_mut().for_each(|group| group.visit(v));
        self.cause_search.visit(v);
    }

    /// Back to knowing nothing, in place.
    pub fn forget(&mut self, theta: &[f64], options: &EstimatorOptions) {
        self.states.iter_mut().for_each(|group| group.forget(theta, options));
        self.cause_search.close(&mut self.states);
    }

    /// Begins a search for the cause: the plant may have changed in this block. Does nothing if the
    /// rows have no columns of errors to test.
    pub fn begin_cause_search(&mut self, rows: &dyn Summable) {
        if rows.suspect_rows().count() > 0 {
            self.cause_search.begin(&mut self.states);
        }
    }

    /// True if no parameter of this parameter's group may be used until the cause of the change is
    /// clear.
    pub fn withholds(&self, parameter: usize) -> bool {
        let holds = |group: &GroupState| group.parameters.contains(&parameter);
        self.iter()
            .position(holds)
            .is_some_and(|k| self.cause_search.withholds(k))
    }

    /// The group of a parameter; `None` if no equation has it.
    pub fn holding(&self, parameter: usize) -> Option<&GroupState> {
        self.iter().find(|g| g.parameters.contains(&parameter))
    }

    /// Takes the sums of the block at θ for all groups or none, because their estimates must be of
    /// the same block. False if any row is not finite there.
    pub fn compute_innovation(&mut self, rows: &dyn Summable, theta: &[f64]) -> bool {
        self.iter_mut()
            .map(|g| g.equations.take_innovation(rows, theta))
            .fold(true, |all, finite| all & finite)
    }

    /// Starts at θ: nothing is confirmed yet.
    pub fn begin(&mut self, theta: &[f64]) {
        for group in self.iter_mut() {
            group.confirmation.begin(&theta[group.parameters.clone()]);
        }
    }

    /// Call this if the plant has changed: nothing remains confirmed in any group.
    pub fn doubt(&mut self, theta: &[f64]) {
        for group in self.iter_mut() {
            let own = group.parameters.clone();
            group.confirmation.restart(&theta[own]);
        }
    }

    /// Makes σ allow for errors with these second moments.
    pub fn allow_for(&mut self, moments: &[f64]) {
        for group in self.iter_mut() {
            group.considered.moments.copy_from_slice(moments);
        }
    }

    /// Fixes or frees a parameter; either way only θ and the floor of the information remain of it.
    pub fn fix(&mut self, index: usize, fixed: bool, theta: &[f64], floor: f64) {
        if let Some(k) = self.iter().position(|g| g.parameters.contains(&index)) {
            let group = &mut self.states[k];
            let i = index - group.parameters.start;
            group.limits.set_fixed(i, fixed);
            group.forget_parameter(i, floor);
            group.confirmation.begin(&theta[group.parameters.clone()]);
            self.cause_search.leave_out(k, &mut self.states);
        }
    }

    /// Entry (i, j) of the matrix that `of` returns for a group; 0 between groups. i and j count
    /// over all parameters.
    pub fn entry<'a>(&self, i: usize, j: usize, of: impl Fn(usize) -> &'a [f64]) -> f64 {
        let holds = |g: &GroupState| g.parameters.contains(&i) && g.parameters.contains(&j);
        self.iter().position(holds).map_or(0.0, |k| {
            let group = &self[k];
            let (i, j) = (i - group.parameters.start, j - group.parameters.start);
            of(k)[i * group.n + j]
        })
    }

    /// See [`BlockEstimator::product_ratio`](super::BlockEstimator::product_ratio).
    pub fn product_ratio(&self, theta: &[f64], [a, b]: [usize; 2], [c, d]: [usize; 2]) -> (f64, f64) {
        let ratio = theta[a] * theta[b] / (theta[c] * theta[d]);
        // d ln ratio = dθ_a/θ_a + dθ_b/θ_b − dθ_c/θ_c − dθ_d/θ_d
        let terms = [(a, 1.0), (b, 1.0), (c, -1.0), (d, -1.0)];
        let mut variance = 0.0;
        for (i, s) in terms {
            for (j, t) in terms {
                let covariance = self.entry(i, j, |k| self[k].widened.total());
                variance += s * t * covariance / (theta[i] * theta[j]);
            }
        }
        (ratio - 1.0, ratio.abs() * variance.max(0.0).sqrt())
    }

    /// See [`BlockEstimator::information_figures`](super::BlockEstimator::information_figures).
    pub fn information_figures(&self) -> (f64, f64) {
        let (mut sum, mut asymmetry) = (0.0, 0.0f64);
        for group in self.iter() {
            let (n, m) = (group.n, group.information.matrix());
            for i in 0..n {
                if group.limits.is_free(i) {
                    sum += m[i * n + i].max(f64::MIN_POSITIVE).ln();
                }
                for j in 0..i {
                    let scale = (m[i * n + i] * m[j * n + j]).sqrt();
                    if scale > 0.0 {
                        asymmetry = asymmetry.max((m[i * n + j] - m[j * n + i]).abs() / scale);
                    }
                }
            }
        }
        (sum, asymmetry)
    }
}
