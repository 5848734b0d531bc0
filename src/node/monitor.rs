//! The monitor as a value: estimates in, text lines and a record of the run out.

use super::block_history::BlockHistory;
use super::state_words::{misfit_words, poorly_excited_words};
use super::stream::{Place, StreamCursor};
use crate::messages::{Description, ErrorCode, Estimate, LastError, State, Status, estimate_flags};
use std::fmt::Write as _;

pub use super::block_history::{BlockRecord, Change};
pub use super::misfit::lacking_words;

/// Share of an estimate below which a true value is only rounding of a sum that cancels.
const NOTHING: f64 = 1e-12;

/// Name and unit of a column: a parameter or a derived value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    /// Short name: `theta_1`, `mass_2`.
    pub name: String,
    /// SI unit, `"1"` if there is none.
    pub unit: String,
}

impl Label {
    /// This name and unit.
    pub fn new(name: impl Into<String>, unit: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            unit: unit.into(),
        }
    }
}

/// The true values, if known from the simulator's configuration.
pub trait Truth {
    /// The parameters at a stream time \[s\].
    fn theta(&self, t_s: f64) -> Vec<f64>;
    /// The derived values at a stream time \[s\], in the order of the labels.
    fn derived(&self, t_s: f64) -> Vec<f64>;
}

/// Collects estimates and status of one robot.
pub struct MonitorNode {
    parameters: Vec<Label>,
    derived: Vec<Label>,
    truth: Option<Box<dyn Truth>>,
    cursor: StreamCursor,
    history: BlockHistory,
    last: Option<Estimate>,
    status: Option<Status>,
    /// The last report of an error that the model lacks.
    misfit: Option<LastError>,
    lost_estimates: u64,
    /// The model of the labels; 0 if unknown.
    model_hash: u64,
    /// The model of the first estimate that does not fit the labels.
    foreign: Option<u64>,
    /// Share of the signals' power that the model is expected to explain, if known.
    least_explained: Option<f64>,
}

impl MonitorNode {
    /// A monitor of a plant with these parameters and derived values.
    pub fn new(parameters: Vec<Label>, derived: Vec<Label>, truth: Option<Box<dyn Truth>>) -> Self {
        Self {
            parameters,
            derived,
            truth,
            cursor: StreamCursor::new(),
            history: BlockHistory::default(),
            last: None,
            status: None,
            misfit: None,
            lost_estimates: 0,
            model_hash: 0,
            foreign: None,
            least_explained: None,
        }
    }

    /// The same for a model that is [expected](super::model::Model::least_explained) to explain
    /// this share of each signal's power.
    #[must_use]
    pub fn explaining(mut self, share: f64) -> Self {
        self.least_explained = Some(share);
        self
    }

    /// The same for estimates of one model only, by its
    /// [hash](crate::model::PlantDefinition::hash), because the labels would be wrong for another
    /// one.
    #[must_use]
    pub fn of_model(mut self, model_hash: u64) -> Self {
        self.model_hash = model_hash;
        self
    }

    /// True if the labels match a description: the same model and derived values.
    pub fn is_described_by(&self, description: &Description) -> bool {
        let (own, its) = (self.model_hash, description.model_hash);
        let derived = description.derived().iter().map(|d| (d.name(), d.unit()));
        (own == 0 || its == 0 || own == its) && self.derived.iter().map(|d| (&*d.name, &*d.unit)).eq(derived)
    }

    /// The model of the first estimate that was ignored because it does not fit the labels.
    pub fn foreign_model(&self) -> Option<u64> {
        self.foreign
    }

    /// Takes an estimate; false if it was already received (a late joiner gets the last one again),
    /// or is of [another model](Self::foreign_model) and is ignored.
    pub fn on_estimate(&mut self, estimate: &Estimate) -> bool {
        let (own, its) = (self.model_hash, estimate.model_hash);
        if own != 0 && its != 0 && own != its {
            self.foreign.get_or_insert(its);
            return false;
        }
        match self.cursor.advance(estimate.stream_id, estimate.block) {
            Place::Duplicate => return false,
            // A new stream: the record of the previous one no longer belongs to this run.
            Place::First => {
                self.history.clear();
                self.lost_estimates = 0;
            }
            // Estimates are numbered by block, so a block without an estimate looks like a lost
            // one; both are counted.
            Place::Gap { missing } => self.lost_estimates = self.lost_estimates.saturating_add(missing),
            Place::Next => {}
        }
        let t_s = seconds(estimate.t_last_ns);
        self.history.push(BlockRecord {
            block: estimate.block,
            t_s,
            change_s: (estimate.flags & estimate_flags::CHANGED != 0).then(|| seconds(estimate.t_change_ns)),
            worst_relative_error: self
                .truth
                .as_ref()
                .map(|truth| worst_relative_error(estimate, &truth.theta(t_s))),
        });
        self.last = Some(*estimate);
        true
    }

    /// Takes a status.
    pub fn on_status(&mut self, status: &Status) {
        if self.status.is_some_and(|last| last.stream_id != status.stream_id) {
            self.misfit = None;
        }
        if status.error.code == ErrorCode::Misfit as u32 {
            self.misfit = Some(status.error);
        }
        self.status = Some(*status);
    }

    /// True once the identifier has said that the stream ended and its last estimate has arrived.
    pub fn is_complete(&self) -> bool {
        self.status.is_some_and(|status| {
            let arrived = |last: Estimate| last.stream_id == status.stream_id && last.block >= status.last_block;
            status.state == State::Ended as u32 && (status.last_block == 0 || self.last.is_some_and(arrived))
        })
    }

    /// One line of text: block, time, state, then each value with its standard deviation and unit.
    pub fn line(&self, estimate: &Estimate) -> String {
        let mut line = format!(
            "block {:>4}  {:>9.3} s  {:<14}",
            estimate.block,
            seconds(estimate.t_last_ns),
            State::from_wire(estimate.state).map_or("unknown", State::name)
        );
        if estimate.flags & estimate_flags::CHANGED != 0 {
            let _ = write!(line, "  changed at {:.3} s", seconds(estimate.t_change_ns));
        }
        let theta = self.parameters.iter().zip(&estimate.theta).zip(&estimate.theta_std);
        let derived = self.derived.iter().zip(&estimate.derived).zip(&estimate.derived_std);
        for ((label, value), std) in theta.chain(derived) {
            let _ = write!(line, "  {}={value:.6}", label.name);
            if std.is_finite() {
                let _ = write!(line, "±{std:.1e}");
            }
            if label.unit != "1" {
                let _ = write!(line, " {}", label.unit);
            }
        }
        line.push_str("  fit");
        for (e, fit) in estimate.fit.iter().take(estimate.equations as usize).enumerate() {
            let _ = write!(line, "{}{fit:.2}", if e == 0 { ' ' } else { '/' });
        }
        match State::from_wire(estimate.state) {
            Some(State::Misfit) => _ = write!(line, " ({})", misfit_words(estimate, self.least_explained)),
            Some(State::PoorlyExcited) => {
                let usable = (0..self.parameters.len()).filter(|&i| estimate.is_usable(i)).count();
                let _ = write!(line, " ({})", poorly_excited_words(usable, self.parameters.len()));
            }
            _ => {}
        }
        let lost = estimate.missing.saturating_add(estimate.rejected);
        if lost > 0 {
            let _ = write!(line, "  [missing {}, rejected {}]", estimate.missing, estimate.rejected);
        }
        if let Some(words) = self.misfit() {
            let is_misfit = State::from_wire(estimate.state) == Some(State::Misfit);
            let _ = write!(line, "  [{}]", lacking_words(words, is_misfit));
        }
        line
    }

    /// Parameters, in the order of θ.
    pub fn parameters(&self) -> &[Label] {
        &self.parameters
    }

    /// Derived values, in the order of the message.
    pub fn derived(&self) -> &[Label] {
        &self.derived
    }

    /// The true values, if known.
    pub fn truth(&self) -> Option<&dyn Truth> {
        self.truth.as_deref()
    }

    /// Blocks of the current stream that had an estimate.
    pub fn blocks(&self) -> u64 {
        self.history.blocks()
    }

    /// The last blocks of the current stream, some thousands at most.
    pub fn records(&self) -> &[BlockRecord] {
        self.history.records()
    }

    /// The last estimate.
    pub fn last_estimate(&self) -> Option<&Estimate> {
        self.last.as_ref()
    }

    /// The identifier's text about an error that the model lacks, if the residuals showed one.
    pub fn misfit(&self) -> Option<&str> {
        self.misfit.as_ref().map(|error| error.words())
    }

    /// The last status.
    pub fn last_status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// Blocks between the first and the last record without an estimate.
    pub fn lost_estimates(&self) -> u64 {
        self.lost_estimates
    }

    /// The changes reported so far.
    pub fn changes(&self) -> Vec<Change> {
        self.history.changes()
    }
}

fn worst_relative_error(estimate: &Estimate, truth: &[f64]) -> f64 {
    let judged = |i: usize| estimate.usable.is_empty() || estimate.usable.contains(i);
    truth
        .iter()
        .enumerate()
        .filter(|&(i, _)| judged(i))
        .filter_map(|(i, &value)| relative_error(estimate.theta[i], value))
        .map(f64::abs)
        .fold(
            0.0,
            |worst, error| if error > worst || error.is_nan() { error } else { worst },
        )
}

/// (estimate − truth) / truth; `None` if the truth is 0 or only rounding.
pub fn relative_error(estimate: f64, truth: f64) -> Option<f64> {
    let is_nothing = truth == 0.0 || truth.abs() < NOTHING * estimate.abs();
    (!is_nothing).then(|| (estimate - truth) / truth)
}

/// Nanoseconds of stream time as seconds.
pub fn seconds(t_ns: u64) -> f64 {
    t_ns as f64 / 1e9
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::block_history::REMEMBERED;
    use super::*;
    use crate::messages::MAX_DERIVED;
    use crate::model::{MAX_JOINTS, MAX_PARAMS};

    /// An estimate of one parameter.
    pub(crate) fn estimate(block: u64, theta: f64) -> Estimate {
        let mut message = Estimate {
            stream_id: 1,
            block,
            t_first_ns: (block - 1) * 1_000_000_000,
            t_last_ns: block * 1_000_000_000 - 1_000_000,
            accepted: block * 1000,
            excited: [0].into_iter().collect(),
            state: State::Converging as u32,
            params: 1,
            equations: 1,
            iterations: 1,
            condition: 1.0,
            fit: [1.0; MAX_JOINTS],
            fit_probability: 1.0,
            theta_std: [f64::NAN; MAX_PARAMS],
            derived_std: [f64::NAN; MAX_DERIVED],
            ..Estimate::EMPTY
        };
        message.theta[0] = theta;
        message
    }

    /// The mass jumps from 10 to 20 at 2.5 s.
    struct Jump;

    impl Truth for Jump {
        fn theta(&self, t_s: f64) -> Vec<f64> {
            vec![if t_s < 2.5 { 10.0 } else { 20.0 }]
        }
        fn derived(&self, _: f64) -> Vec<f64> {
            Vec::new()
        }
    }

    pub(crate) fn monitor() -> MonitorNode {
        let label = Label {
            name: "mass".into(),
            unit: "kg".into(),
        };
        MonitorNode::new(vec![label], Vec::new(), Some(Box::new(Jump)))
    }

    #[test]
    fn prop_blocks_to_1_percent_count_from_the_block_that_holds_the_change() {
        let mut monitor = monitor();
        // Block 3 contains the change (2 s … 3 s), block 4 reports it, block 5 is the first that is
        // right and stays right.
        for (block, theta) in [(1, 10.0), (2, 10.0), (3, 15.0), (4, 19.0), (5, 20.1), (6, 20.0)] {
            let mut message = estimate(block, theta);
            if block == 4 {
                message.flags |= estimate_flags::CHANGED;
                message.t_change_ns = 2_500_000_000;
            }
            assert!(monitor.on_estimate(&message));
        }
        assert_eq!(
            monitor.changes(),
            [Change {
                block: 4,
                t_s: 2.5,
                detected_t_s: 3.999,
                blocks_to_1_percent: Some(2)
            }]
        );
    }

    #[test]
    fn prop_a_monitor_of_a_million_blocks_counts_them_all_and_remembers_the_last() {
        let mut monitor = monitor();
        for block in 1..=1_000_000 {
            let mut message = estimate(block, if block < 3 { 10.0 } else { 20.0 });
            if block == 3 || block == 900_000 {
                message.flags |= estimate_flags::CHANGED;
                message.t_change_ns = block * 1_000_000_000 - 500_000_000;
            }
            monitor.on_estimate(&message);
        }
        assert_eq!((monitor.blocks(), monitor.lost_estimates()), (1_000_000, 0));
        assert!(monitor.records().len() <= 2 * REMEMBERED);
        let changes: Vec<_> = monitor
            .changes()
            .iter()
            .map(|c| (c.block, c.blocks_to_1_percent))
            .collect();
        assert_eq!(changes, [(3, Some(0)), (900_000, Some(0))]);
    }

    #[test]
    fn prop_an_estimate_that_leaves_again_has_not_settled() {
        let mut monitor = monitor();
        for (block, theta) in [(1, 10.0), (2, 10.0), (3, 20.0), (4, 19.0)] {
            let mut message = estimate(block, theta);
            if block == 3 {
                message.flags |= estimate_flags::CHANGED;
                message.t_change_ns = 2_500_000_000;
            }
            monitor.on_estimate(&message);
        }
        assert_eq!(monitor.changes()[0].blocks_to_1_percent, None);
    }

    #[test]
    fn prop_a_late_joiner_counts_the_repeated_estimate_once_and_a_new_stream_starts_over() {
        let mut monitor = monitor();
        assert!(monitor.on_estimate(&estimate(7, 10.0)));
        assert!(!monitor.on_estimate(&estimate(7, 10.0)));
        assert!(monitor.on_estimate(&estimate(9, 10.0)));
        assert_eq!(monitor.lost_estimates(), 1);
        let mut restarted = estimate(1, 10.0);
        restarted.stream_id = 2;
        assert!(monitor.on_estimate(&restarted));
        assert_eq!((monitor.records().len(), monitor.lost_estimates()), (1, 0));
    }

    #[test]
    fn fault_estimates_of_another_model_are_left_out_and_told() {
        let mut monitor = monitor().of_model(7);
        let mut message = estimate(1, 10.0);
        message.model_hash = 7;
        assert!(monitor.on_estimate(&message));
        (message.block, message.model_hash) = (2, 8);
        assert!(!monitor.on_estimate(&message));
        assert_eq!((monitor.blocks(), monitor.foreign_model()), (1, Some(8)));
    }

    #[test]
    fn fault_a_nan_in_an_estimate_counts_as_an_error_not_as_agreement() {
        let mut message = estimate(1, f64::NAN);
        assert!(!(worst_relative_error(&message, &[10.0]) <= 0.01));
        message.theta[0] = 10.0;
        assert!(worst_relative_error(&message, &[10.0]) <= 0.01);
        assert_eq!(
            worst_relative_error(&message, &[0.0]),
            0.0,
            "beside 0 nothing is relative"
        );
        assert_eq!(relative_error(0.1, 3e-17), None);
        assert_eq!(relative_error(-0.5, 1e-3), Some(-501.0));
    }

    #[test]
    fn regress_the_readable_line_names_values_deviations_and_units() {
        let mut message = estimate(24, 170.25);
        message.theta_std[0] = 0.125;
        message.missing = 3;
        let line = monitor().line(&message);
        for part in [
            "block   24",
            "23.999 s",
            "converging",
            "mass=170.250000±1.2e-1 kg",
            "missing 3",
        ] {
            assert!(line.contains(part), "{part:?} is not in {line:?}");
        }
    }

    #[test]
    fn prop_complete_means_ended_and_the_last_estimate_here() {
        let mut monitor = monitor();
        let mut status = Status {
            stream_id: 1,
            accepted: 2000,
            missing: 0,
            rejected: 0,
            last_seq: 1999,
            last_t_ns: 0,
            estimates: 2,
            last_block: 2,
            streams: 1,
            state: State::Converging as u32,
            pid: 1,
            ..Status::default()
        };
        monitor.on_estimate(&estimate(1, 10.0));
        status.state = State::Ended as u32;
        monitor.on_status(&status);
        assert!(!monitor.is_complete(), "the estimate of block 2 is still on its way");
        monitor.on_estimate(&estimate(2, 10.0));
        assert!(monitor.is_complete());
    }
}
