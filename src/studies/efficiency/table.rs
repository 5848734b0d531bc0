//! The runs as tables.

use super::{Method, Outcome};
use crate::studies::document::{Document, Section, Table, percent, two_digits};

/// A parameter counts while its bound is below this share of it.
const KNOWABLE: f64 = 0.01;
/// What is asked of the estimator: error ÷ bound up to this is good …
const GOOD: f64 = 1.2;
/// … and up to this acceptable on smooth motion.
const ACCEPTABLE: f64 = 1.6;
/// Half the width of a 95 % interval in standard deviations.
const INTERVAL: f64 = 1.959_963_984_540_054;
const NONE: &str = "–";

/// The runs of one motion seen through one sensor.
#[derive(Debug, Clone)]
pub struct CaseRuns {
    /// Heading under which it stands.
    pub group: &'static str,
    /// Motion and sensor.
    pub name: String,
    /// Names of the parameters, as heads of columns.
    pub parameters: Vec<String>,
    /// One per seed.
    pub runs: Vec<Outcome>,
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
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

    /// Runs in which the method found a θ̂.
    fn settled(&self, method: usize) -> usize {
        self.runs.iter().filter(|run| run.estimates[method].is_some()).count()
    }

    /// Errors over bounds of a parameter.
    fn ratios(&self, method: usize, i: usize) -> impl Iterator<Item = f64> + '_ {
        self.runs.iter().filter_map(move |run| {
            let theta = run.estimates[method].as_ref()?;
            Some((theta[i] - run.truth[i]) / run.bound[i])
        })
    }

    /// RMS error over bound of each knowable parameter.
    fn efficiency(&self, method: usize) -> Vec<(usize, f64)> {
        self.knowable()
            .filter_map(|i| Some((i, rms(self.ratios(method, i))?)))
            .collect()
    }

    fn pooled(&self, method: usize) -> String {
        let all = rms(self.knowable().flat_map(|i| self.ratios(method, i)));
        let settled = self.settled(method);
        match all {
            None => NONE.to_owned(),
            Some(all) if settled < self.runs.len() => format!("{} ({settled})", two_digits(all)),
            Some(all) => two_digits(all),
        }
    }

    /// 95 % intervals of ours that hold the truth.
    fn held(&self) -> String {
        let (mut held, mut all) = (0, 0);
        for run in &self.runs {
            if let Some(theta) = &run.estimates[0] {
                for i in self.knowable() {
                    all += 1;
                    held += usize::from((theta[i] - run.truth[i]).abs() <= INTERVAL * run.own_std[i]);
                }
            }
        }
        if all == 0 {
            NONE.to_owned()
        } else {
            format!("{held} of {all}")
        }
    }

    fn line(&self) -> Vec<String> {
        let worst = self.efficiency(0).into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let mut row = vec![
            self.name.clone(),
            self.pooled(0),
            worst.map_or(NONE.to_owned(), |(i, e)| {
                format!("{} {}", self.parameters[i], two_digits(e))
            }),
            self.held(),
        ];
        row.extend((1..Method::ALL.len()).map(|method| self.pooled(method)));
        row
    }

    /// One line for people.
    pub fn words(&self) -> String {
        let heads = heads();
        let cells = self.line();
        let parts: Vec<String> = heads
            .iter()
            .zip(&cells)
            .skip(1)
            .map(|(head, cell)| format!("{head} {cell}"))
            .collect();
        format!("{:<28} {}", self.name, parts.join("  "))
    }
}

fn heads() -> Vec<String> {
    let mut heads = vec![
        "motion, sensor".to_owned(),
        Method::Ours.name().to_owned(),
        "worst parameter".to_owned(),
        "95 % intervals hold".to_owned(),
    ];
    heads.extend(Method::ALL[1..].iter().map(|method| method.name().to_owned()));
    heads
}

fn table(heads: &[String]) -> Table {
    Table::new(&heads.iter().map(String::as_str).collect::<Vec<_>>())
}

fn with_parameters(case: &CaseRuns, first: &[&str]) -> Table {
    let heads: Vec<String> = first
        .iter()
        .map(|head| (*head).to_owned())
        .chain(case.parameters.clone())
        .collect();
    table(&heads)
}

fn group_sections(cases: &[&CaseRuns]) -> Vec<Section> {
    let Some(first) = cases.first() else {
        return Vec::new();
    };
    let mut summary = table(&heads());
    let mut each = with_parameters(first, &["motion, sensor", "estimator"]);
    let mut bounds = with_parameters(first, &["motion, sensor", "start of the run"]);
    for case in cases {
        summary.push(case.line());
        for (method, kind) in Method::ALL.iter().enumerate() {
            let of = case.efficiency(method);
            let mut row = vec![case.name.clone(), kind.name().to_owned()];
            row.extend((0..case.parameters.len()).map(|i| {
                let found = of.iter().find(|(place, _)| *place == i);
                found.map_or(NONE.to_owned(), |(_, e)| two_digits(*e))
            }));
            each.push(row);
        }
        let middle = |known: bool, i: usize| {
            let of_run = |run: &Outcome| {
                if known {
                    run.bound[i]
                } else {
                    run.bound_unknown_start[i]
                }
            };
            rms(case.runs.iter().map(|run| of_run(run) / run.truth[i])).map_or(NONE.to_owned(), percent)
        };
        for (name, known) in [("known", true), ("unknown", false)] {
            let mut row = vec![case.name.clone(), name.to_owned()];
            row.extend((0..case.parameters.len()).map(|i| middle(known, i)));
            bounds.push(row);
        }
    }
    let group = first.group;
    vec![
        Section {
            heading: group.to_owned(),
            text: Vec::new(),
            table: summary,
        },
        Section {
            heading: format!("{group}: parameter by parameter"),
            text: vec![format!("Error ÷ bound; – if the bound is not below {}.", percent(KNOWABLE))],
            table: each,
        },
        Section {
            heading: format!("{group}: the bound"),
            text: vec![
                "The bound relative to the parameter, root mean square over the seeds, for estimators that know the state at the start of the run and for \
                 those that do not."
                    .to_owned(),
            ],
            table: bounds,
        },
    ]
}

/// What misses the goals, in a sentence.
fn verdict(cases: &[CaseRuns]) -> String {
    let above = |limit: f64| {
        let names = cases
            .iter()
            .filter(|case| case.efficiency(0).iter().any(|(_, e)| *e > limit));
        names
            .map(|case| format!("{} ({})", case.name, case.group))
            .collect::<Vec<_>>()
    };
    let said = |names: Vec<String>| match names.len() {
        0 => "none".to_owned(),
        _ => names.join("; "),
    };
    format!(
        "A parameter of thetabus is above {ACCEPTABLE} × the bound in {} of {count} cases: {}. Above {GOOD} ×, in {} of {count}.",
        above(ACCEPTABLE).len(),
        said(above(ACCEPTABLE)),
        above(GOOD).len(),
        count = cases.len(),
    )
}

/// The document; `duration_s` is that of a run.
pub fn efficiency_document(cases: &[CaseRuns], seeds: u64, duration_s: f64) -> Document {
    let mut groups: Vec<&'static str> = Vec::new();
    for case in cases {
        if !groups.contains(&case.group) {
            groups.push(case.group);
        }
    }
    let mut sections = vec![Section {
        heading: "What is compared".to_owned(),
        text: vec![
            format!(
                "Error ÷ bound: the root mean square over {seeds} seeds of the error after {duration_s} s over the Cramér–Rao bound of the same run, of all parameters \
                 whose bound is below {}. An unbiased estimator that loses nothing has 1; {seeds} errors tell a root mean square to {} of itself, those of several \
                 parameters together somewhat better. In brackets: runs that settled, if not all did.",
                percent(KNOWABLE),
                percent((0.5 / seeds as f64).sqrt())
            ),
            "The bound is the covariance recursion along the true motion, with the state at the start known, as in the trials: the positions have the noise of their rounding, \
             the inputs white noise. An estimator that may be switched on at any time does not know that state; what this costs is in the last table of each machine. The nine \
             parameters of the arm are free in the bound; thetabus uses θ₁/θ₃ = θ₂/θ₄ and may be better than it in these four. At 13 bits slow motion stays on a count for \
             many samples, and its rounding is no white noise: the bound is then an orientation."
                .to_owned(),
            "**thetabus** runs as shipped, on line, with its forgetting (`config/encoder_only.toml`, `config/servo_axis.toml`). The **extended Kalman filter** has θ in its state and works sample \
             by sample. Off line, over the whole run at once: **prediction error** is maximum likelihood with the innovations of a Kalman filter at fixed θ; **output error** \
             takes the recorded input for exact; **least squares** work on filtered and differentiated positions, **instrumental variables** the same with regressors of a simulation as \
             instruments. All start from the values of the configuration, a factor of 2.5 off for the arm. The first three know the noise of the sensors; the last one knows \
             the controller, too."
                .to_owned(),
            verdict(cases),
        ],
        table: Table::default(),
    }];
    for group in groups {
        let of_group: Vec<&CaseRuns> = cases.iter().filter(|case| case.group == group).collect();
        sections.extend(group_sections(&of_group));
    }
    Document {
        title: "Efficiency".to_owned(),
        sections,
    }
}
