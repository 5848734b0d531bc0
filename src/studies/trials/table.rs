//! Results of many runs as lines and tables.

use super::cases::Case;
use super::disturbance::Disturbance;
use super::score::TrialResult;
use crate::studies::document::{Document, Section, Table, percent, two_digits};
use crate::studies::metrics::median;

/// Results of the runs of one or several cases.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CaseResult {
    /// One per seed, with its disturbance.
    pub runs: Vec<(Disturbance, TrialResult)>,
}

/// Columns: name in a table, name in a line.
const COLUMNS: [(&str, &str); 15] = [
    ("dangerous blocks", "danger"),
    ("false alarms per 1000", "alarms"),
    ("95 % intervals hold", "cover"),
    ("usable of excited", "usable"),
    ("usable of knowable", "knowable"),
    ("use_ok", "use_ok"),
    ("changes found", "found"),
    ("error at the end, median / worst", "error"),
    ("σ at the end, worst", "sigmas"),
    ("error ÷ bound", "eff"),
    ("largest", "max"),
    ("cause named right", "cause"),
    ("another cause named", "wrong"),
    ("named as most of σ", "unseen"),
    ("worst dangerous value", "worst:"),
];

const NONE: &str = "–";

/// True if a text names a cause: one of these words, and the number of the joint if there is one.
fn names(text: &str, (words, joint): (&[&str], Option<usize>)) -> bool {
    let text = text.to_lowercase();
    words.iter().any(|word| text.contains(word)) && joint.is_none_or(|joint| text.contains(&format!("joint {joint}")))
}

fn share(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

fn in_percent(part: u64, whole: u64, digits: usize) -> String {
    share(part, whole).map_or(NONE.to_owned(), |share| format!("{:.digits$} %", 100.0 * share))
}

/// The largest value; NaN is larger than any other.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(
        0.0,
        |a: f64, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) },
    )
}

impl CaseResult {
    fn sum(&self, value: impl Fn(&TrialResult) -> u64) -> u64 {
        self.runs.iter().map(|(_, run)| value(run)).sum()
    }

    /// RMS over seeds and marks of the error over the Cramér–Rao bound, per parameter; `None` if
    /// the bound is not below 1 %.
    pub fn efficiency(&self) -> Vec<Option<f64>> {
        let params = self.runs.iter().map(|(_, run)| run.parameters.len()).max().unwrap_or(0);
        let of = |i: usize| {
            let scores = || self.runs.iter().filter_map(move |(_, run)| run.parameters.get(i));
            let marks: u32 = scores().map(|p| p.marks).sum();
            let sum: f64 = scores().map(|p| p.squared_ratio).sum();
            (marks > 0).then(|| (sum / f64::from(marks)).sqrt())
        };
        (0..params).map(of).collect()
    }

    /// Final error of the worst parameter whose bound is below 1 %, or of any if there is no bound:
    /// median over the runs and maximum.
    fn end_errors(&self) -> (f64, f64) {
        let of_run = |run: &TrialResult| {
            let known = run.parameters.iter().filter(|p| p.bound < 0.01);
            largest(known.map(|p| p.end_error))
        };
        let mut errors: Vec<f64> = self.runs.iter().map(|(_, run)| of_run(run)).collect();
        let worst = largest(errors.iter().copied());
        if errors.is_empty() {
            return (f64::NAN, f64::NAN);
        }
        (median(&mut errors), worst)
    }

    /// Number of runs whose cause was named correctly in the text of `of`, and of runs that have
    /// one.
    fn causes(&self, of: impl Fn(&TrialResult) -> Option<&String>) -> (u64, u64) {
        let with = self
            .runs
            .iter()
            .filter_map(|(d, run)| d.cause().map(|cause| (cause, run)));
        with.fold((0, 0), |(right, all), (cause, run)| {
            let is_right = of(run).is_some_and(|named| names(named, cause));
            (right + u64::from(is_right), all + 1)
        })
    }

    /// Number of runs whose last named cause they do not have.
    fn wrong_causes(&self) -> u64 {
        let named = self
            .runs
            .iter()
            .filter_map(|(d, run)| run.named_cause.as_ref().map(|named| (d, named)));
        let wrong = named.filter(|(d, named)| match d {
            // a little of everything
            Disturbance::Drawn => false,
            // the text leaves open whether anything but the parameters has changed
            _ if named.starts_with("changed parameters or ") => false,
            _ => d.cause().is_none_or(|cause| !names(named, cause)),
        });
        wrong.count() as u64
    }

    fn cells(&self) -> Vec<String> {
        let blocks = self.sum(|r| r.blocks);
        let (middle, worst) = self.end_errors();
        let efficiency = self.efficiency();
        let known = || efficiency.iter().enumerate().filter_map(|(i, e)| e.map(|e| (i, e)));
        let count = known().count() as f64;
        let mean = (known().map(|(_, e)| e * e).sum::<f64>() / count).sqrt();
        let worst_parameter = known().max_by(|a, b| a.1.total_cmp(&b.1));
        let of_parameters =
            |value: fn(&super::ParameterScore) -> u64| self.sum(|r| r.parameters.iter().map(value).sum());
        let sigmas = largest(
            self.runs
                .iter()
                .flat_map(|(_, r)| r.parameters.iter().map(|p| p.end_sigmas)),
        );
        let alarms = share(self.sum(|r| r.false_alarms), self.sum(|r| r.quiet));
        let (right, causes) = self.causes(|run| run.named_cause.as_ref());
        let (unseen, _) = self.causes(|run| run.named_limit.as_ref());
        let or_none = |is_some: bool, text: String| if is_some { text } else { NONE.to_owned() };
        vec![
            format!("{} of {blocks}", self.sum(|r| r.dangerous)),
            alarms.map_or(NONE.to_owned(), |share| two_digits(1000.0 * share)),
            in_percent(of_parameters(|p| p.covered), of_parameters(|p| p.intervals), 1),
            in_percent(self.sum(|r| r.usable), self.sum(|r| r.excited), 0),
            in_percent(self.sum(|r| r.knowable_usable), self.sum(|r| r.knowable), 0),
            in_percent(self.sum(|r| r.use_ok), blocks, 0),
            format!("{} of {}", self.sum(|r| r.detected), self.sum(|r| r.changes)),
            format!("{} / {}", percent(middle), percent(worst)),
            two_digits(sigmas),
            or_none(count > 0.0, two_digits(mean)),
            worst_parameter.map_or(NONE.to_owned(), |(i, e)| format!("{}: {}", i + 1, two_digits(e))),
            or_none(causes > 0, format!("{right} of {causes}")),
            format!("{} of {}", self.wrong_causes(), self.runs.len()),
            or_none(causes > 0, format!("{unseen} of {causes}")),
            self.worst_danger(),
        ]
    }

    fn worst_danger(&self) -> String {
        let worst = self.runs.iter().filter_map(|(_, run)| run.worst.as_ref());
        let worst = worst.max_by(|a, b| a.sigmas.total_cmp(&b.sigmas));
        worst.map_or(NONE.to_owned(), |danger| {
            format!(
                "{} {} off, {} σ, block {}",
                danger.name,
                percent(danger.error),
                two_digits(danger.sigmas),
                danger.block
            )
        })
    }

    /// One line of text, with the names of the figures.
    pub fn line(&self) -> String {
        let cells = self.cells();
        let parts = COLUMNS.iter().zip(&cells).filter(|(_, cell)| *cell != NONE);
        let parts: Vec<String> = parts.map(|((_, name), cell)| format!("{name} {cell}")).collect();
        parts.join("  ")
    }

    /// All runs of these results as one.
    pub fn pool<'a>(results: impl IntoIterator<Item = &'a Self>) -> Self {
        Self {
            runs: results
                .into_iter()
                .flat_map(|result| result.runs.iter().cloned())
                .collect(),
        }
    }
}

/// A table without the columns that are empty in all rows.
fn table(rows: &[(String, CaseResult)]) -> Table {
    let cells: Vec<Vec<String>> = rows.iter().map(|(_, result)| result.cells()).collect();
    let used: Vec<usize> = (0..COLUMNS.len())
        .filter(|&c| cells.iter().any(|row| row[c] != NONE && !row[c].ends_with(" of 0")))
        .collect();
    let heads: Vec<&str> = std::iter::once("case")
        .chain(used.iter().map(|&c| COLUMNS[c].0))
        .collect();
    let mut table = Table::new(&heads);
    for ((name, _), row) in rows.iter().zip(&cells) {
        let values = used.iter().map(|&c| row[c].clone());
        table.push(std::iter::once(name.clone()).chain(values).collect());
    }
    table
}

/// The document: totals first, then a table per group.
pub fn trials_document(results: &[(Case, CaseResult)], seeds: u64) -> Document {
    let mut groups: Vec<&'static str> = Vec::new();
    for (case, _) in results {
        if !groups.contains(&case.group) {
            groups.push(case.group);
        }
    }
    let pooled = |chosen: &dyn Fn(&Case) -> bool| {
        CaseResult::pool(
            results
                .iter()
                .filter(|(case, _)| chosen(case))
                .map(|(_, result)| result),
        )
    };
    let mut totals = Vec::new();
    for &group in &groups {
        totals.push((format!("**{group}**"), pooled(&|case| case.group == group)));
        // By what distinguishes the cases of the group: one word at a time.
        let of_group = || results.iter().filter(|(case, _)| case.group == group);
        let places = of_group().map(|(case, _)| case.spec.words().len()).max().unwrap_or(0);
        for place in 0..places {
            let mut words: Vec<String> = Vec::new();
            for word in of_group().filter_map(|(case, _)| case.spec.words().get(place).cloned()) {
                if !words.contains(&word) {
                    words.push(word);
                }
            }
            if words.len() > 1 {
                for word in words {
                    let with = |case: &Case| case.group == group && case.spec.words().get(place) == Some(&word);
                    totals.push((word.clone(), pooled(&with)));
                }
            }
        }
    }
    let explanation = EXPLANATION.iter().map(|text| (*text).to_owned());
    let mut sections = vec![Section {
        heading: "Totals".to_owned(),
        text: explanation.chain([format!("{seeds} seeds per case.")]).collect(),
        table: table(&totals),
    }];
    for group in groups {
        let of_group = results.iter().filter(|(case, _)| case.group == group);
        let rows: Vec<(String, CaseResult)> = of_group.map(|(case, result)| (case.name(), result.clone())).collect();
        sections.push(Section {
            heading: group.to_owned(),
            text: Vec::new(),
            table: table(&rows),
        });
    }
    Document {
        title: "Trials".to_owned(),
        purpose: "This page counts how often an estimate that is marked usable is wrong, for other motions, sensors, faults and model errors.".to_owned(),
        sections,
    }
}

const EXPLANATION: [&str; 5] = [
    "Each run goes through the identifier node of the service with the options of `config/encoder_only.toml`, the servo axis with those of `config/servo_axis.toml`. The noise of the \
     sensors is configured. Unless the model is wrong, the payload of the arm changes once, in the block in the middle of the run, at a time that the seed chooses. \
     For a random arm, the seed draws links, motors, payload, controller, encoders, sample period, one of the motions, and the size of what is wrong. \
     For a random axis, the seed draws the machine (mass, friction, drive, encoder, controller), the size and pace of its motion, the sample period and the length of a block; nothing changes during the run. \
     `studies trials --show` prints the settings of each case.",
    "A **dangerous block** has `use_ok = 1` and a usable parameter or a derived value that is more than 5 σ and more than 0.5 % off. An alarm is false if nothing changed in its block or in \
     the one before.\n\nThe columns of intervals count values with σ below half the value, in blocks without a change, from block 6 on. Usable shares count parameters in all blocks from \
     block 6 on. A parameter is knowable while its Cramér–Rao bound is below 1 %. The bound is that of the same run without its disturbance, up to the change of the payload.",
    "The truth is that of the block's last sample. The truth of a derived value is computed from the true parameters with the constants in the identifier's configuration, so a winding that has \
     become warm counts as a true change of both.",
    "Error ÷ bound is the root mean square over seeds and three blocks before the change, of the knowable parameters together and of the worst of them. The bound leaves the nine \
     parameters and the state at the start free. The error at the end is that of the worst knowable parameter, or of the worst of all parameters if there is no bound. A parameter \
     whose truth is zero has no relative error and is left out there; as a usable value it is dangerous beyond 5 σ.",
    "A cause is named right if the last message of the status says that it would explain the misfit or the change. Another cause is named if that message names one that the run does not have, and does not say that changed parameters would explain the change as well. A run with nothing but a new payload or lost samples has no cause; runs with a little of every error are not counted. An error that the motion does not show leaves no misfit. The \
     status then says that most of the std of a parameter may be that error, unseen.",
];
