//! The state shared by all views: updated by messages, of bounded size.

use super::history::{History, Point};
use super::quantity::{About, Quantity};
use super::signals::Signals;
use super::view::{Health, Row, Times, Trend, View};
use crate::messages::{ErrorCode, Estimate, ParameterSet, Sample, State, Status, Timing, estimate_flags, status_flags};
use crate::model::MAX_JOINTS;
use crate::node::monitor::{Truth, seconds};
use crate::node::predicted_input::PredictedInput;
use crate::node::state_words::{misfit_words, poorly_excited_words};
use crate::report::{DERIVED_USABLE, Known, Rounded, headline, pretty_unit};
use std::collections::VecDeque;

/// An identifier silent for this long has ended; it normally sends twice a second.
const GONE_NS: u64 = 2_500_000_000;
/// Number of statuses for a rate.
const RATE_OVER: usize = 8;
/// Number of blocks for a trend.
const TREND_OVER: usize = 8;
/// Number of blocks in a state for text.
const POINTS_FOR_TEXT: usize = 32;
/// Number of changes kept.
const CHANGES: usize = 64;

/// The state of an identification. Times called `now_ns` and `sent_ns` are of CLOCK_MONOTONIC.
#[derive(Debug, Clone)]
pub struct LiveState {
    about: About,
    /// Parameters, then derived values.
    quantities: Vec<Quantity>,
    parameters: usize,
    history: History,
    is_for_text: bool,
    signals: Signals,
    /// `None` if the model is unknown or no view shows signals.
    prediction: Option<PredictedInput>,
    estimate: Option<(Estimate, u64)>,
    status: Option<(Status, u64)>,
    /// Clock, samples and estimates of the last statuses of the stream.
    counts: VecDeque<(u64, u64, u64)>,
    /// Located times \[s\].
    changes: VecDeque<f64>,
    /// Value and standard deviation of each quantity before the last change.
    before: Vec<Option<(f64, f64)>>,
    lost_estimates: u64,
    generation: u64,
    /// The identifier's text about an error that the model lacks.
    lacks: String,
    /// Share of the signals' power that the model is expected to explain, if known.
    least_explained: Option<f64>,
}

impl LiveState {
    /// A state with names and units only.
    pub fn new(about: About, parameters: Vec<Quantity>, derived: Vec<Quantity>) -> Self {
        let count = parameters.len();
        let quantities: Vec<Quantity> = parameters.into_iter().chain(derived).collect();
        Self {
            about,
            history: History::new(quantities.len()),
            is_for_text: false,
            before: vec![None; quantities.len()],
            parameters: count,
            quantities,
            signals: Signals::default(),
            prediction: None,
            estimate: None,
            status: None,
            counts: VecDeque::new(),
            changes: VecDeque::new(),
            lost_estimates: 0,
            generation: 0,
            lacks: String::new(),
            least_explained: None,
        }
    }

    /// The same for a model that is [expected](crate::node::model::Model::least_explained) to
    /// explain this share of each signal's power.
    #[must_use]
    pub fn explaining(mut self, share: f64) -> Self {
        self.least_explained = Some(share);
        self
    }

    /// The same without the history for plots; text needs only the newest blocks.
    #[must_use]
    pub fn for_text(mut self) -> Self {
        self.history = self.history.at_most(POINTS_FOR_TEXT);
        self.is_for_text = true;
        self
    }

    /// The same with a prediction of the joints' inputs.
    #[must_use]
    pub fn predicting(mut self, prediction: PredictedInput) -> Self {
        self.prediction = Some(prediction);
        self
    }

    /// Resets the state for another model, whose inputs are not predicted.
    pub fn rename(&mut self, about: About, parameters: Vec<Quantity>, derived: Vec<Quantity>) {
        let generation = self.generation + 1;
        let new = Self::new(about, parameters, derived);
        let new = if self.is_for_text { new.for_text() } else { new };
        *self = Self { generation, ..new };
    }

    /// Takes an estimate, each one only once; `truth` if known.
    pub fn on_estimate(&mut self, estimate: &Estimate, truth: Option<&dyn Truth>, sent_ns: u64) {
        match self.estimate.as_ref().map(|(last, _)| (last.stream_id, last.block)) {
            Some((stream_id, block)) if stream_id == estimate.stream_id && block < estimate.block => {
                self.lost_estimates += estimate.block - block - 1;
            }
            Some(_) => self.begin(),
            None => {}
        }
        if estimate.flags & estimate_flags::CHANGED != 0 {
            self.on_change(seconds(estimate.t_change_ns));
        }
        if let Some(prediction) = &mut self.prediction {
            prediction.on_estimate(estimate);
        }
        let t_s = seconds(estimate.t_last_ns);
        let truth = truth.map_or_else(Vec::new, |truth| {
            let mut values = truth.theta(t_s);
            values.resize(self.parameters, f64::NAN);
            values.extend(truth.derived(t_s));
            values.resize(self.quantities.len(), f64::NAN);
            values
        });
        let of = |index: usize| self.known(estimate, index);
        let known: Vec<(f64, f64, bool)> = (0..self.quantities.len()).map(of).collect();
        self.history.push(Point {
            block: estimate.block,
            t_s,
            values: known.iter().map(|k| k.0).collect(),
            stds: known.iter().map(|k| k.1).collect(),
            usable: known.iter().map(|k| k.2).collect(),
            truth,
        });
        self.estimate = Some((*estimate, sent_ns));
    }

    /// Takes a status.
    pub fn on_status(&mut self, status: &Status, sent_ns: u64) {
        if self
            .status
            .as_ref()
            .is_some_and(|(last, _)| last.stream_id != status.stream_id)
        {
            self.counts.clear();
            self.lacks.clear();
        }
        if status.error.code == ErrorCode::Misfit as u32 {
            self.lacks = status.error.words().to_owned();
        }
        let seen = [status.accepted, status.missing, status.rejected];
        let seen = seen.into_iter().fold(0, u64::saturating_add);
        if self.counts.len() == RATE_OVER {
            self.counts.pop_front();
        }
        self.counts.push_back((sent_ns, seen, status.estimates));
        self.status = Some((*status, sent_ns));
    }

    /// Takes a sample. With a prediction it is shown once its neighbours have arrived, some
    /// hundredths of a second later.
    pub fn on_sample(&mut self, sample: &Sample) {
        let signals = &mut self.signals;
        match &mut self.prediction {
            Some(prediction) => prediction.push(sample, |passed| signals.push(passed.sample, || passed.input())),
            None => signals.push(sample, || [f64::NAN; MAX_JOINTS]),
        }
    }

    /// Whether inputs are predicted.
    pub fn predicts(&self) -> bool {
        self.prediction.is_some()
    }

    /// The machine and model.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// Parameters, then derived values.
    pub fn quantities(&self) -> &[Quantity] {
        &self.quantities
    }

    /// The estimates so far, thinned.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The last seconds of the joints' signals.
    pub fn signals(&self) -> &Signals {
        &self.signals
    }

    /// Counts the streams: data of another generation are of another run.
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// The present view.
    pub fn view(&self, now_ns: u64) -> View {
        let estimate = self.estimate.as_ref().map(|(estimate, _)| estimate);
        let status = self.status.as_ref().map(|(status, _)| status);
        let flags = status.map_or(0, |status| status.flags);
        let heard_ns = self.status.as_ref().map(|&(_, sent_ns)| now_ns.saturating_sub(sent_ns));
        let alive = heard_ns.is_some_and(|age| age < GONE_NS);
        let state = self.state();
        let rows = self.rows(estimate);
        let usable = rows[..self.parameters].iter().filter(|row| row.usable).count();
        let (samples_per_s, estimates_per_s) = self.rates(alive);
        let counts = self.counts_of(estimate, status);
        let (words, health) = self.words(state, alive, heard_ns, usable, flags);
        let equations = estimate.map_or(0, |e| (e.equations as usize).min(e.fit.len()));
        View {
            headline: self
                .headline(estimate, state)
                .unwrap_or_else(|| self.nothing_usable().into()),
            words,
            state: state.name().to_owned(),
            health,
            alive,
            paused: flags & status_flags::PAUSED != 0,
            heartbeat_s: heard_ns.map_or(f64::NAN, |age| age as f64 / 1e9),
            pid: status.map_or(0, |status| status.pid),
            block: estimate.map_or(0, |e| e.block),
            t_s: estimate.map_or(f64::NAN, |e| seconds(e.t_last_ns)),
            usable,
            parameters: self.parameters,
            rows,
            accepted: counts.0,
            missing: counts.1,
            rejected: counts.2,
            lost_estimates: self.lost_estimates,
            samples_per_s,
            estimates_per_s,
            fit: estimate.map_or_else(Vec::new, |e| e.fit[..equations].to_vec()),
            fit_probability: estimate.map_or(f64::NAN, |e| e.fit_probability),
            step: status.map_or_else(Times::default, |s| times(&s.step)),
            block_step: status.map_or_else(Times::default, |s| times(&s.block)),
            resident_bytes: status.map_or(0, |s| s.process.resident_bytes),
            lacks: self.lacks.clone(),
            error: status.map_or_else(String::new, |s| s.error.words().to_owned()),
            changes: self.changes.iter().copied().collect(),
        }
    }

    /// Begins a new stream.
    fn begin(&mut self) {
        self.history.clear();
        self.changes.clear();
        self.before.fill(None);
        self.lost_estimates = 0;
        self.generation += 1;
    }

    /// Remembers the last usable value of each quantity before the change.
    fn on_change(&mut self, t_s: f64) {
        for (index, before) in self.before.iter_mut().enumerate() {
            let last = self.history.points().rev().filter(|point| point.t_s <= t_s);
            let known = last.map(|p| (p.usable[index], p.values[index], p.stds[index]));
            *before = known.filter(|known| known.0).map(|(_, value, std)| (value, std)).next();
        }
        if self.changes.len() == CHANGES {
            self.changes.pop_front();
        }
        self.changes.push_back(t_s);
    }

    /// Value, standard deviation and whether it may be used.
    fn known(&self, estimate: &Estimate, index: usize) -> (f64, f64, bool) {
        let unknown = (f64::NAN, f64::NAN, false);
        match index.checked_sub(self.parameters) {
            None if index < estimate.params as usize => {
                let numbers = estimate.theta.get(index).zip(estimate.theta_std.get(index));
                numbers.map_or(unknown, |(&value, &std)| (value, std, estimate.is_usable(index)))
            }
            Some(derived) if derived < estimate.derived_len as usize => {
                let numbers = estimate.derived.get(derived).zip(estimate.derived_std.get(derived));
                numbers.map_or(unknown, |(&value, &std)| {
                    let usable = estimate.use_ok == 1 && 3.0 * std < DERIVED_USABLE * value.abs();
                    (value, std, usable)
                })
            }
            _ => unknown,
        }
    }

    fn rows(&self, estimate: Option<&Estimate>) -> Vec<Row> {
        let row = |(index, quantity): (usize, &Quantity)| {
            let known = estimate.map(|estimate| self.known(estimate, index));
            let (value, std, usable) = known.unwrap_or((f64::NAN, f64::NAN, false));
            let derived = index >= self.parameters;
            let rounded = Rounded::new(value, std);
            let marked =
                |set: fn(&Estimate) -> ParameterSet| !derived && estimate.is_some_and(|e| set(e).contains(index));
            Row {
                name: quantity.name.clone(),
                unit: match quantity.unit.as_str() {
                    "1" => String::new(),
                    unit => pretty_unit(unit),
                },
                value,
                std,
                value_text: rounded.value,
                std_text: rounded.std,
                trend: self.trend(index),
                usable,
                excited: derived || marked(|e| e.excited),
                fixed: marked(|e| e.fixed),
                derived,
            }
        };
        self.quantities.iter().enumerate().map(row).collect()
    }

    /// The trend over the last blocks, relative to the standard deviations at both ends.
    fn trend(&self, index: usize) -> Trend {
        let at = |point: &Point| (point.values[index], point.stds[index]);
        let mut points = self.history.points().rev().take(TREND_OVER);
        let (Some((now, std)), Some((then, std_then))) = (points.next().map(at), points.next_back().map(at)) else {
            return Trend::Unknown;
        };
        let sigma = std.hypot(std_then);
        let noise = if sigma.is_finite() {
            2.0 * sigma
        } else {
            1e-3 * now.abs()
        };
        match now - then {
            step if step > noise => Trend::Rising,
            step if step < -noise => Trend::Falling,
            step if step.is_finite() => Trend::Steady,
            _ => Trend::Unknown,
        }
    }

    fn headline(&self, estimate: Option<&Estimate>, state: State) -> Option<String> {
        let estimate = estimate?;
        let known = |(index, quantity): (usize, &'_ Quantity)| (index, self.known(estimate, index), quantity.clone());
        let all: Vec<_> = self.quantities.iter().enumerate().map(known).collect();
        let known: Vec<Known<'_>> = all
            .iter()
            .map(|(index, (value, std, usable), quantity)| Known {
                name: &quantity.name,
                unit: &quantity.unit,
                value: *value,
                std: *std,
                usable: *usable,
                derived: *index >= self.parameters,
                before: self.before[*index],
            })
            .collect();
        let change = self.changes.back().copied();
        match (change, state) {
            (Some(t_s), State::Changing) => {
                Some(format!("changed at {t_s:.2} s; the new values are not confirmed yet"))
            }
            _ => headline(&known, change),
        }
    }

    /// The headline without a value.
    fn nothing_usable(&self) -> &'static str {
        match self.history.points().any(|point| point.usable.contains(&true)) {
            true => "no value may be used now",
            false => "no value may be used yet",
        }
    }

    /// The newer state of estimate and status.
    fn state(&self) -> State {
        let estimate = self.estimate.as_ref().map(|(e, sent_ns)| (*sent_ns, e.state));
        let status = self.status.as_ref().map(|(s, sent_ns)| (*sent_ns, s.state));
        let newest = estimate.into_iter().chain(status).max_by_key(|said| said.0);
        newest
            .and_then(|(_, state)| State::from_wire(state))
            .unwrap_or_default()
    }

    fn counts_of(&self, estimate: Option<&Estimate>, status: Option<&Status>) -> (u64, u64, u64) {
        match (estimate, status) {
            (Some(e), Some(s)) if e.stream_id != s.stream_id => (e.accepted, e.missing, e.rejected),
            (_, Some(s)) => (s.accepted, s.missing, s.rejected),
            (Some(e), None) => (e.accepted, e.missing, e.rejected),
            (None, None) => (0, 0, 0),
        }
    }

    fn rates(&self, alive: bool) -> (f64, f64) {
        let (Some(first), Some(last)) = (self.counts.front(), self.counts.back()) else {
            return (f64::NAN, f64::NAN);
        };
        let span_s = last.0.saturating_sub(first.0) as f64 / 1e9;
        match (alive, span_s > 0.2) {
            (false, _) => (0.0, 0.0),
            (true, false) => (f64::NAN, f64::NAN),
            (true, true) => (
                last.1.saturating_sub(first.1) as f64 / span_s,
                last.2.saturating_sub(first.2) as f64 / span_s,
            ),
        }
    }

    fn words(&self, state: State, alive: bool, heard_ns: Option<u64>, usable: usize, flags: u32) -> (String, Health) {
        let all = self.parameters;
        let so_far = format!("{usable} of {all} parameters may be used");
        if !alive && state != State::Ended {
            let words = match heard_ns {
                None => "waiting for an identifier".to_owned(),
                Some(age) => format!(
                    "the identifier has been silent for {:.0} s; these are its last values",
                    age as f64 / 1e9
                ),
            };
            return (words, if heard_ns.is_some() { Health::Bad } else { Health::Wait });
        }
        if flags & status_flags::PAUSED != 0 && state != State::Ended {
            return ("paused by a command".into(), Health::Warn);
        }
        if flags & status_flags::SILENT != 0 && state != State::Ended {
            return ("the machine sends no samples".into(), Health::Warn);
        }
        match state {
            State::Collecting => match self.status.as_ref().and_then(|(status, _)| status.no_estimate()) {
                Some(words) => (format!("no estimate yet: {words}"), Health::Warn),
                None => ("collecting the first block of samples".into(), Health::Wait),
            },
            State::Converging => (format!("the estimate still moves; {so_far}"), Health::Wait),
            State::Converged if usable < all => (format!("settled; {so_far}"), Health::Good),
            State::Converged => (format!("settled; all {all} parameters may be used"), Health::Good),
            State::Paused => ("paused by a command".into(), Health::Warn),
            State::PoorlyExcited => (
                poorly_excited_words(usable, all),
                match usable {
                    0 => Health::Warn,
                    _ => Health::Good,
                },
            ),
            State::Changing => (
                "the machine has changed; its new values are being found".into(),
                Health::Warn,
            ),
            State::Degraded => ("samples are missing or refused".into(), Health::Warn),
            State::Invalid => ("the estimate must not be used".into(), Health::Bad),
            State::Ended => (format!("the stream has ended; {so_far}"), Health::Good),
            State::Misfit => {
                let why = self.estimate.as_ref();
                let why = why.map_or_else(String::new, |(e, _)| misfit_words(e, self.least_explained));
                (format!("the model does not fit: {why}"), Health::Bad)
            }
        }
    }
}

fn times(timing: &Timing) -> Times {
    let us = |ns: u64| ns as f64 / 1e3;
    Times {
        mean_us: us(timing.mean_ns),
        p99_us: us(timing.p99_ns),
        max_us: us(timing.max_ns),
    }
}

#[cfg(test)]
pub(crate) mod tests;
