//! The runs as tables.

use super::estimators::{Method, Outcome};
use crate::studies::document::{Document, Section, Table, percent, two_digits};

/// A parameter is knowable if its bound is below this share of it.
pub const KNOWABLE: f64 = 0.01;
/// The goal for error ÷ bound.
pub(super) const GOAL: f64 = 1.2;
/// Error ÷ bound above which there is no estimate.
pub(super) const LOST: f64 = 100.0;
/// Half the width of a 95 % interval in standard deviations.
pub(super) const INTERVAL: f64 = 1.959_963_984_540_054;
pub(super) const NONE: &str = "–";

/// The runs of one motion with one sensor.
#[derive(Debug, Clone)]
pub struct CaseRuns {
    /// Heading of its table.
    pub group: &'static str,
    /// Motion and sensor.
    pub name: String,
    /// Names of the parameters, as heads of columns.
    pub parameters: Vec<String>,
    /// One per seed.
    pub runs: Vec<Outcome>,
}

pub(super) fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value * value, count + 1));
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

impl CaseRuns {
    fn is_knowable(&self, i: usize) -> bool {
        self.runs.iter().all(|run| run.bound[i] < KNOWABLE * run.truth[i].abs())
    }

    fn knowable(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.parameters.len()).filter(|&i| self.is_knowable(i))
    }

    /// Errors over bounds of a parameter, for the runs that settled.
    fn ratios(&self, method: Method, i: usize) -> impl Iterator<Item = f64> + '_ {
        self.runs.iter().filter_map(move |run| run.ratio(method, i))
    }

    /// RMS error over bound of all knowable parameters together.
    fn pooled(&self, method: Method) -> String {
        let settled = self.ratios(method, 0).count();
        let all = rms(self.knowable().flat_map(|i| self.ratios(method, i)));
        let figure = match all {
            None => return NONE.to_owned(),
            Some(all) if all < LOST => two_digits(all),
            Some(_) => "lost".to_owned(),
        };
        if settled < self.runs.len() {
            format!("{figure} ({settled})")
        } else {
            figure
        }
    }

    /// Number of our 95 % intervals that contain the truth, and of all.
    fn held(&self) -> [usize; 2] {
        let mut held = [0, 0];
        for run in &self.runs {
            if let Some(theta) = &run.estimates[Method::Ours as usize] {
                for i in self.knowable() {
                    held[0] += usize::from((theta[i] - run.truth[i]).abs() <= INTERVAL * run.own_std[i]);
                    held[1] += 1;
                }
            }
        }
        held
    }

    fn line(&self) -> Vec<String> {
        let mut row = vec![self.name.clone()];
        row.extend(Method::ALL.map(|method| self.pooled(method)));
        let [held, all] = self.held();
        row.push(format!("{held} of {all}"));
        row
    }

    /// Our results per parameter: error over bound, with the bound.
    fn parameter_line(&self) -> Vec<String> {
        let mut row = vec![self.name.clone()];
        row.extend((0..self.parameters.len()).map(|i| {
            let bound = rms(self.runs.iter().map(|run| run.bound[i] / run.truth[i])).map_or(NONE.to_owned(), percent);
            match rms(self.ratios(Method::Ours, i)).filter(|_| self.is_knowable(i)) {
                Some(ratio) if ratio > GOAL => format!("**{}** ({bound})", two_digits(ratio)),
                Some(ratio) => format!("{} ({bound})", two_digits(ratio)),
                None => format!("{NONE} ({bound})"),
            }
        }));
        row
    }

    /// Knowable parameters for which our error ÷ bound exceeds a limit, with the value.
    fn above(&self, limit: f64) -> Vec<String> {
        self.knowable()
            .filter_map(|i| {
                let ratio = rms(self.ratios(Method::Ours, i)).filter(|ratio| *ratio > limit)?;
                Some(format!("{} {} {}", self.name, self.parameters[i], two_digits(ratio)))
            })
            .collect()
    }

    /// One line of text.
    pub fn words(&self) -> String {
        let cells = self.line();
        let parts = heads()
            .iter()
            .zip(&cells)
            .skip(1)
            .map(|(head, cell)| format!("{head} {cell}"))
            .collect::<Vec<_>>();
        format!("{:<22} {}", self.name, parts.join("  "))
    }
}

fn heads() -> Vec<&'static str> {
    let mut heads = vec!["motion, sensor"];
    heads.extend(Method::ALL.map(Method::name));
    heads.push("95 % intervals of thetabus that hold");
    heads
}

fn group_sections(group: &str, cases: &[&CaseRuns]) -> [Section; 2] {
    let mut summary = Table::new(&heads());
    let names = cases.first().map(|case| case.parameters.as_slice()).unwrap_or_default();
    let columns: Vec<&str> = std::iter::once("motion, sensor")
        .chain(names.iter().map(String::as_str))
        .collect();
    let mut each = Table::new(&columns);
    for case in cases {
        summary.push(case.line());
        each.push(case.parameter_line());
    }
    [
        Section {
            heading: group.to_owned(),
            text: Vec::new(),
            table: summary,
        },
        Section {
            heading: format!("{group}: thetabus, parameter by parameter"),
            text: vec![format!(
                "Error ÷ bound, bold if above {GOAL}, and in brackets the bound as a share of the parameter; \
                 {NONE} if that is not below {}.",
                percent(KNOWABLE)
            )],
            table: each,
        },
    ]
}

/// Sentences about the parameters that miss the goal.
fn verdict(cases: &[CaseRuns], seeds: u64) -> String {
    let all: usize = cases.iter().map(|case| case.knowable().count()).sum();
    let beyond_chance = GOAL * (1.0 + 2.0 * (0.5 / seeds as f64).sqrt());
    let above = |limit: f64| cases.iter().flat_map(|case| case.above(limit)).collect::<Vec<_>>();
    let (missed, clearly) = (above(GOAL), above(beyond_chance));
    let held = cases
        .iter()
        .map(CaseRuns::held)
        .fold([0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
    let listed = if clearly.is_empty() {
        "none".to_owned()
    } else {
        clearly.join("; ")
    };
    if all == 0 {
        return "**What misses the goal** stands below: only the six-axis robot was asked for.".to_owned();
    }
    format!(
        "**What misses the goal.** The goal is {GOAL} × the bound for every parameter whose bound is below {}. \
         Of {all} such figures of thetabus {} are above it. {seeds} seeds determine a root mean square to {} of \
         itself, so an estimator at the goal is seldom above {}. Above that are {}: {listed}. Of the 95 % intervals \
         {:.1} % contain the truth; the goal is 92 to 97 %.",
        percent(KNOWABLE),
        missed.len(),
        percent((0.5 / seeds as f64).sqrt()),
        two_digits(beyond_chance),
        clearly.len(),
        100.0 * held[0] as f64 / held[1] as f64,
    )
}

fn introduction(cases: &[CaseRuns], seeds: u64, duration_s: f64) -> Section {
    let text = [
        format!(
            "Error ÷ bound is the root mean square over {seeds} seeds of the error after {duration_s} s, divided by \
             the Cramér–Rao bound of the same run, over all parameters whose bound is below {}. An unbiased \
             estimator that loses nothing has 1. In brackets: number of runs that settled, if not all did. Lost: \
             above {LOST}.",
            percent(KNOWABLE)
        ),
        verdict(cases, seeds),
        "**The bound** is the covariance recursion along the true motion of a run whose state at the start is not \
         known. Positions have the noise of their rounding, inputs white noise, and each parameter a prior of 50 %, \
         which matters little below 1 %. The nine parameters of the arm are free in it; thetabus uses θ₁/θ₃ = θ₂/θ₄ \
         and may be better than the bound in these four. Rounding is not white noise. At 13 bits, slow motion stays \
         on a count for many samples, and the rounding of a machine at rest is one value, however often it is read. \
         The bound is only approximate there."
            .to_owned(),
        "**The estimators** are:\n\n- **thetabus** as shipped, on line, with its forgetting \
         (`config/encoder_only.toml`, `config/servo_axis.toml`). Only the axis has a sampled instead of an analog \
         controller. The input of an analog one between samples is not recorded, and any assumption about it moves \
         the mass by more than the bound.\n- **Extended Kalman filter**: θ is in its state, and it works sample by \
         sample. It starts from the values of the configuration, a factor of 2.5 off for the arm. From there it is \
         lost, so it also starts from 10 % off, which no other estimator does.\n- **Prediction error**, off line \
         over the whole run: maximum likelihood with the innovations of a Kalman filter at fixed θ.\n- **Output \
         error**: the same, with the recorded input taken as exact.\n- **Least squares**: on filtered and \
         differentiated positions.\n- **Instrumental variables**: the same, with regressors of a simulation as \
         instruments.\n\nThe search of the likelihoods starts from the instrumental variables' result if it is \
         physically possible, else from the configuration's values. Filters and likelihoods know the noise of the \
         sensors, instruments know the controller."
            .to_owned(),
        "**Why figures are above 1.**\n\n- *thetabus*: on steps at 20 bits, the velocity filter smooths away jumps of \
         the jerk (method.md, section 14). On steps at 13 bits, the rounding of a joint that creeps to its place is not \
         white, so the rows have the wrong weights.\n- *Filter and prediction error*, on moves with rests: they take \
         the rounding of a machine at rest for noise. With one count of white noise added, 8 seeds of trapezoidal, 20 \
         bit, have 1.1 instead of 1.5. On the axis they linearise sticking, and such noise changes nothing.\n- *Least \
         squares and instrumental variables*: they have filters of a fixed width and equations without weights."
            .to_owned(),
    ];
    Section {
        heading: "What is compared".to_owned(),
        text: text.into(),
        table: Table::default(),
    }
}

/// The document; `duration_s` is that of a run, `more` are further sections.
pub fn efficiency_document(cases: &[CaseRuns], seeds: u64, duration_s: f64, more: Vec<Section>) -> Document {
    let mut groups: Vec<&'static str> = cases.iter().map(|case| case.group).collect();
    groups.dedup();
    let mut sections = vec![introduction(cases, seeds, duration_s)];
    for group in groups {
        let of_group: Vec<&CaseRuns> = cases.iter().filter(|case| case.group == group).collect();
        sections.extend(group_sections(group, &of_group));
    }
    sections.extend(more);
    Document {
        title: "Errors beside the Cramér–Rao bound".to_owned(),
        purpose: "This page compares the errors of thetabus and of other estimators with the smallest possible errors."
            .to_owned(),
        sections,
    }
}
