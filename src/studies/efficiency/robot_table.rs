//! The runs of the six-axis robot as tables.

use super::robot::{ROBOT_RUN_S, RobotMethod, RobotOutcome};
use super::table::{GOAL, INTERVAL, KNOWABLE, LOST, NONE, rms};
use crate::robot::{FrictionTerm, RobotModel, Standard};
use crate::studies::document::{Section, Table, percent, two_digits};

/// Groups of parameters in the tables.
const GROUPS: [&str; 11] = [
    "bodies",
    "rotor inertia",
    "viscous",
    "coulomb",
    "offset",
    "reversal",
    "load, which is 0",
    "stribeck, which is 0",
    "spring, which is 0",
    "drag, which is 0",
    "asymmetric, which is 0",
];
/// Groups whose parameters are 0, so relative bounds do not exist.
const ZERO: std::ops::Range<usize> = 6..11;

/// The robot's runs with one motion.
#[derive(Debug, Clone)]
pub struct RobotRuns {
    /// The motion.
    pub name: &'static str,
    /// Names of the parameters.
    pub parameters: Vec<String>,
    /// Index of each parameter's group in [`GROUPS`].
    groups: Vec<usize>,
    /// One per seed.
    pub runs: Vec<RobotOutcome>,
}

/// The group of each parameter of a model.
fn groups(model: &RobotModel) -> Vec<usize> {
    let base = model.base().parameters.iter();
    let mut groups: Vec<usize> = base
        .map(|parameter| usize::from(matches!(parameter.leading, Standard::Rotor { .. })))
        .collect();
    for friction in model.friction() {
        groups.extend(friction.terms.iter().map(|term| match term {
            FrictionTerm::Viscous => 2,
            FrictionTerm::Coulomb => 3,
            FrictionTerm::Offset => 4,
            FrictionTerm::Reversal => 5,
            FrictionTerm::Load => 6,
            FrictionTerm::Stribeck => 7,
            FrictionTerm::Spring => 8,
            FrictionTerm::Drag => 9,
            FrictionTerm::Asymmetric => 10,
        }));
    }
    groups
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some(0.5 * (values[last / 2] + values[last.div_ceil(2)]))
}

impl RobotRuns {
    /// Runs of a model with a motion, one per seed.
    pub fn new(name: &'static str, model: &RobotModel, runs: Vec<RobotOutcome>) -> Self {
        Self {
            name,
            parameters: model.parameters().iter().map(|p| p.name.clone()).collect(),
            groups: groups(model),
            runs,
        }
    }

    fn is_knowable(&self, i: usize) -> bool {
        self.runs.iter().all(|run| run.bound[i] < KNOWABLE * run.truth[i].abs())
    }

    fn knowable(&self) -> Vec<usize> {
        (0..self.parameters.len()).filter(|&i| self.is_knowable(i)).collect()
    }

    fn ratios(&self, method: RobotMethod, i: usize) -> impl Iterator<Item = f64> + '_ {
        self.runs.iter().filter_map(move |run| run.ratio(method, i))
    }

    /// RMS error over bound of these parameters together.
    fn pooled(&self, method: RobotMethod, of: &[usize]) -> String {
        let settled = self.ratios(method, 0).count();
        let figure = match rms(of.iter().flat_map(|&i| self.ratios(method, i))) {
            None => return NONE.to_owned(),
            Some(all) if all < LOST => two_digits(all),
            Some(_) => "lost".to_owned(),
        };
        match settled < self.runs.len() {
            true => format!("{figure} ({settled})"),
            false => figure,
        }
    }

    /// Number of our 95 % intervals that contain the truth, and of all.
    fn held(&self, of: &[usize]) -> [usize; 2] {
        let mut held = [0, 0];
        for run in &self.runs {
            for &i in of {
                held[0] += usize::from(
                    run.ratio(RobotMethod::Ours, i)
                        .is_some_and(|ratio| (ratio * run.bound[i]).abs() <= INTERVAL * run.own_std[i]),
                );
                held[1] += 1;
            }
        }
        held
    }

    fn line(&self) -> Vec<String> {
        let of = self.knowable();
        let mut row = vec![self.name.to_owned()];
        row.extend(RobotMethod::ALL.map(|method| self.pooled(method, &of)));
        let [held, all] = self.held(&of);
        row.push(format!("{held} of {all}"));
        row
    }

    /// Our results, one line per group.
    fn group_lines(&self) -> Vec<Vec<String>> {
        let line = |group: usize| {
            let members: Vec<usize> = (0..self.groups.len()).filter(|&i| self.groups[i] == group).collect();
            let of: Vec<usize> = members
                .iter()
                .copied()
                .filter(|&i| ZERO.contains(&group) || self.is_knowable(i))
                .collect();
            let figures =
                |method: RobotMethod| -> Vec<f64> { of.iter().filter_map(|&i| rms(self.ratios(method, i))).collect() };
            let ours = figures(RobotMethod::Ours);
            let worst = of
                .iter()
                .filter_map(|&i| Some((rms(self.ratios(RobotMethod::Ours, i))?, i)))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            let [held, all] = self.held(&of);
            vec![
                self.name.to_owned(),
                GROUPS[group].to_owned(),
                format!("{} of {}", of.len(), members.len()),
                median(ours.clone()).map_or(NONE.to_owned(), two_digits),
                worst.map_or(NONE.to_owned(), |(ratio, i)| {
                    format!("{} ({})", two_digits(ratio), self.parameters[i])
                }),
                ours.iter().filter(|ratio| **ratio > GOAL).count().to_string(),
                median(figures(RobotMethod::WeightedWindows)).map_or(NONE.to_owned(), two_digits),
                format!("{held} of {all}"),
            ]
        };
        (0..GROUPS.len()).map(line).collect()
    }

    /// Our result for a parameter: error over bound, with the bound.
    fn cell(&self, i: usize) -> String {
        let share = rms(self.runs.iter().map(|run| run.bound[i] / run.truth[i])).map_or(NONE.to_owned(), percent);
        match rms(self.ratios(RobotMethod::Ours, i)).filter(|_| self.is_knowable(i)) {
            Some(ratio) if ratio > GOAL => format!("**{}** ({share})", two_digits(ratio)),
            Some(ratio) => format!("{} ({share})", two_digits(ratio)),
            None => NONE.to_owned(),
        }
    }

    /// One line of text.
    pub fn words(&self) -> String {
        let cells = self.line();
        let parts: Vec<String> = heads()
            .iter()
            .zip(&cells)
            .skip(1)
            .map(|(head, cell)| format!("{head} {cell}"))
            .collect();
        format!("{:<22} {}", self.name, parts.join("  "))
    }

    /// Increase of the bound due to rounded positions: median and maximum.
    fn of_rounding(&self) -> Option<[f64; 2]> {
        let more: Vec<f64> = self
            .knowable()
            .into_iter()
            .filter_map(|i| rms(self.runs.iter().map(|run| run.bound[i] / run.exact_bound[i])))
            .map(|ratio| ratio - 1.0)
            .collect();
        let most = more.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Some([median(more)?, most])
    }
}

fn heads() -> Vec<&'static str> {
    let mut heads = vec!["motion"];
    heads.extend(RobotMethod::ALL.map(RobotMethod::name));
    heads.push("95 % intervals of thetabus that hold");
    heads
}

fn verdict(cases: &[RobotRuns]) -> String {
    let seeds = cases.iter().map(|case| case.runs.len()).max().unwrap_or_default();
    let beyond_chance = GOAL * (1.0 + 2.0 * (0.5 / seeds.max(1) as f64).sqrt());
    let mut figures = Vec::new();
    let mut held = [0, 0];
    for case in cases {
        let of = case.knowable();
        let [own, all] = case.held(&of);
        held = [held[0] + own, held[1] + all];
        figures.extend(of.into_iter().filter_map(|i| {
            let ratio = rms(case.ratios(RobotMethod::Ours, i))?;
            Some((
                ratio,
                format!("{} {} {}", case.name, case.parameters[i], two_digits(ratio)),
            ))
        }));
    }
    let above = |limit: f64| figures.iter().filter(move |(ratio, _)| *ratio > limit);
    let clearly: Vec<&str> = above(beyond_chance).map(|(_, words)| words.as_str()).collect();
    let listed = if clearly.is_empty() {
        "none".to_owned()
    } else {
        clearly.join("; ")
    };
    format!(
        "**What misses the goal.** Of {} figures of thetabus whose bound is below {}, {} are above {GOAL}; {} are above {}, \
         which {seeds} seeds seldom make of {GOAL}: {listed}. Of the 95 % intervals {:.1} % contain the truth.",
        figures.len(),
        percent(KNOWABLE),
        above(GOAL).count(),
        clearly.len(),
        two_digits(beyond_chance),
        100.0 * held[0] as f64 / held[1].max(1) as f64,
    )
}

fn rounding(cases: &[RobotRuns]) -> String {
    let words: Vec<String> = cases
        .iter()
        .filter_map(|case| {
            let [middle, most] = case.of_rounding()?;
            let name = case.name.trim_start_matches("six-axis, ");
            Some(format!(
                "{name} by {} in the median and {} at most",
                percent(middle),
                percent(most)
            ))
        })
        .collect();
    words.join(", ")
}

/// The sections of the robot; empty without runs.
pub fn robot_sections(cases: &[RobotRuns]) -> Vec<Section> {
    let Some(first) = cases.first() else { return Vec::new() };
    let mut summary = Table::new(&heads());
    let mut by_group = Table::new(&[
        "motion",
        "parameters",
        "known below 1 %",
        "median",
        "worst",
        "above 1.2",
        "windows, weighted: median",
        "95 % intervals that hold",
    ]);
    for case in cases {
        summary.push(case.line());
        case.group_lines().into_iter().for_each(|line| by_group.push(line));
    }
    let mut columns = vec!["parameter"];
    columns.extend(cases.iter().map(|case| case.name.trim_start_matches("six-axis, ")));
    let mut each = Table::new(&columns);
    for (i, name) in first.parameters.iter().enumerate() {
        if cases.iter().any(|case| case.is_knowable(i)) {
            let mut row = vec![name.clone()];
            row.extend(cases.iter().map(|case| case.cell(i)));
            each.push(row);
        }
    }
    let text = vec![
        format!(
            "The robot of `config/robots/six_axis.toml` after {ROBOT_RUN_S} s at 1 kHz, {} seeds, with encoders of 16 bits and torque \
             noise of 0.5 % of each drive's range. Its bodies are up to 15 % off the URDF, different for each seed. Its drives have \
             offsets of half their Coulomb friction, because an error cannot be a share of 0. All {} parameters are free: {} of bodies \
             and rotors and six of friction for each joint. There are three motions: the sums of sines that the configuration simulates, \
             different for each seed; the periodic motion of `thetabus excite` from {TRIES_WORDS}; and moves from posture to posture \
             with rests of half a second.",
            first.runs.len(),
            first.parameters.len(),
            first.groups.iter().filter(|group| **group < 2).count(),
        ),
        verdict(cases),
        format!(
            "**The bound** is the information of the innovations of a Kalman filter along the true motion, with positions, \
             velocities and the engagement of friction as states that are unknown at the start. Torques have white noise, \
             positions that of their rounding, and parameters the prior of the service. With exact positions it would be \
             that of a regression of the torques on the true motion. Rounding makes the bound larger: {}.",
            rounding(cases)
        ),
        "**thetabus** runs as shipped, on line, and looks for a payload, although there is none. Off line, **windows** are \
         the rows of the service's windows, with equal weights, or **weighted** by the known noise of each joint's torque. \
         **Differentiated** is weighted least squares on filtered and differentiated positions without the samples about rest \
         and reversals. **Instrumental variables** are the same with the rows of the reference motion as instruments."
            .to_owned(),
        "**Why figures are above 1.** The cause is reversals. The identifier's own windows, with the known noise as weights, \
         lose as much, so the cause is in the rows and not in their weights on line. Differentiated positions leave out \
         reversals and lose less. With windows of 0.25 s, as for logs at 100 Hz, instead of 0.1 s, the designed motion and \
         the moves had 1.3. With velocities over 10 instead of 20 ms to either side, three seeds of the designed motion have \
         1.0.\n\nThe Stribeck term, whose truth is 0, has the largest error, because smoothed velocities blur reversals. It \
         is 1.5 times its bound with encoders of 24 bits, velocities over 4 ms and the drives' own presliding. The drives' \
         own presliding alone brings instrumental variables to 1.1: the configuration assumes twice that travel, and its term \
         for the difference corrects the area of a reversal, not its shape."
            .to_owned(),
    ];
    vec![
        Section {
            heading: "Six-axis robot".to_owned(),
            text,
            table: summary,
        },
        Section {
            heading: "Six-axis robot: thetabus by groups".to_owned(),
            text: vec![format!(
                "Error ÷ bound of each parameter whose bound is below {}: median and worst of a group, and how many are above {GOAL}. \
                 If the truth is 0, all parameters count.",
                percent(KNOWABLE)
            )],
            table: by_group,
        },
        Section {
            heading: "Six-axis robot: thetabus, parameter by parameter".to_owned(),
            text: vec![format!(
                "Error ÷ bound, bold if above {GOAL}, and in brackets the bound as a share of the parameter; {NONE} if that is \
                 not below {} for every seed. Parameters without a figure are left out.",
                percent(KNOWABLE)
            )],
            table: each,
        },
    ]
}

/// How the designed motion was found.
const TRIES_WORDS: &str = "400 tries";
