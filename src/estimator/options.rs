//! Options of an estimator: plain data that is validated once.
//!
//! The names of the variants are those of the configuration files.

use super::Structure;
use super::index_set::IndexSet;
use super::prior::{EquationNoise, ParameterPrior};
use std::mem::swap;
use std::str::FromStr;

/// How the information of earlier blocks is forgotten.
///
/// Γ_m⁻¹ is the information after block m, S = Σ φφᵀ what block m adds, Λ the part of Γ_{m−1}⁻¹
/// that remains when block m is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Forgetting {
    /// Λ = λ Γ⁻¹, Γ_m⁻¹ = Λ + S: (9).
    Exponential,
    /// Π⁻¹ = λ Γ⁻¹ + S, Γ_m = G(εΠ)/ε: (10) and (11) to the letter. Forgets twice: the effective
    /// factor is λ².
    BoundedAsPrinted,
    /// Π⁻¹ = Γ⁻¹ + S, Γ_m = G(εΠ)/ε: (10) without its λ, which keeps Γ⁻¹ ≥ εI.
    Bounded,
    /// Λ = λ Γ⁻¹ + (1 − λ) ε I, Γ_m⁻¹ = Λ + S: information falls to ε and no further.
    Floor,
    /// Λ = Γ⁻¹ − (1 − λ) Γ⁻¹U (UᵀΓ⁻¹U)⁻¹ UᵀΓ⁻¹ with U the directions that the block excites: forget
    /// only what is learnt anew (SIFt-RLS, Lai and Bernstein, arXiv 2404.10844).
    Directional,
}

impl Forgetting {
    /// Every rule.
    pub const ALL: [Self; 5] = [
        Self::Exponential,
        Self::BoundedAsPrinted,
        Self::Bounded,
        Self::Floor,
        Self::Directional,
    ];

    /// The name in configuration files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exponential => "exponential",
            Self::BoundedAsPrinted => "bounded-as-printed",
            Self::Bounded => "bounded",
            Self::Floor => "floor",
            Self::Directional => "directional",
        }
    }

    /// True for the rules that apply a bound G after the update.
    pub fn is_bounded(self) -> bool {
        matches!(self, Self::Bounded | Self::BoundedAsPrinted)
    }
}

impl FromStr for Forgetting {
    type Err = EstimatorError;
    fn from_str(name: &str) -> Result<Self, EstimatorError> {
        Self::ALL
            .into_iter()
            .find(|rule| rule.name() == name)
            .ok_or_else(|| EstimatorError::UnknownName {
                what: "forgetting",
                got: name.to_owned(),
                expected: "exponential, bounded-as-printed, bounded, floor or directional",
            })
    }
}

/// Which function G bounds the covariance in (10).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Bound {
    /// G(x) = (x − (1 − λ)x²)/λ: (11), for λ ≥ ½.
    Polynomial,
    /// G(x) = x/(λ + (1 − λ)x): any λ.
    Rational,
}

impl Bound {
    /// Every bound.
    pub const ALL: [Self; 2] = [Self::Polynomial, Self::Rational];

    /// The name in configuration files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Polynomial => "polynomial",
            Self::Rational => "rational",
        }
    }
}

impl FromStr for Bound {
    type Err = EstimatorError;
    fn from_str(name: &str) -> Result<Self, EstimatorError> {
        Self::ALL
            .into_iter()
            .find(|bound| bound.name() == name)
            .ok_or_else(|| EstimatorError::UnknownName {
                what: "bound",
                got: name.to_owned(),
                expected: "polynomial or rational",
            })
    }
}

/// What to do with rows that lie far outside the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outliers {
    /// Every row counts in full.
    Keep,
    /// Rows beyond this many standard deviations pull with constant force (Huber's M-estimator;
    /// 1.345 keeps 95 % efficiency).
    Huber(f64),
    /// Rows beyond this many standard deviations do not count.
    Gate(f64),
}

/// Detection of a sudden change of the plant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeDetection {
    /// Probability that a block of an unchanged plant raises an alarm, in (0, 0.1].
    pub false_alarm_rate: f64,
    /// Rows that start earlier than this after the located change are not used; in the unit of
    /// [`span`](super::Residuals::span). Zero for exact rows.
    pub margin: u64,
}

impl Default for ChangeDetection {
    fn default() -> Self {
        Self {
            false_alarm_rate: 2e-4,
            margin: 0,
        }
    }
}

/// The options of a [`BlockEstimator`](super::BlockEstimator).
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatorOptions {
    /// Prior of each parameter.
    pub parameters: Vec<ParameterPrior>,
    /// Prior of the noise of each equation.
    pub equations: Vec<EquationNoise>,
    /// Relations imposed on the published estimate: \[i, j, k, l\] for θ_i/θ_j = θ_k/θ_l. All four
    /// belong to one group of equations and differ.
    pub relations: Vec<[usize; 4]>,
    /// The forgetting rule.
    pub forgetting: Forgetting,
    /// The bound G of the bounded rules.
    pub bound: Bound,
    /// λ per block, in (0, 1]; see [`forgetting_factor`] for a time constant.
    pub forgetting_factor: f64,
    /// ε > 0: the initial information is εI, and the floor of the bounded rules and of `floor`.
    pub information_floor: f64,
    /// Gauss–Newton iterations per block, at least 1. With 1 the step is the paper's (8), undamped
    /// and unlimited.
    pub max_iterations: usize,
    /// Largest factor by which an iteration changes a parameter whose lower bound is not negative;
    /// above 1, `inf` for none.
    pub step_factor: f64,
    /// The floor of [`EquationNoise`] as a share of the rows' size, the root mean square of
    /// √Σ(φ_i θ_i)²; the larger of both floors counts.
    pub noise_floor_relative: f64,
    /// Standard deviation of each parameter's rate of change, relative to the parameter \[1/s\], 0
    /// to 1, for rows whose spans are in ns. The published covariance then allows for how far the
    /// estimate may lag behind a machine that warms up; 0 if no parameter changes.
    pub drift_per_s: f64,
    /// Treatment of outliers.
    pub outliers: Outliers,
    /// Change detection; `None` turns it off.
    pub change_detection: Option<ChangeDetection>,
}

impl EstimatorOptions {
    /// Exchanges with `other` what may change at run time: λ, ε, iterations, step limit, relative
    /// noise floor, outlier limits, false-alarm rate and margin.
    pub fn exchange_tunables(&mut self, other: &mut Self) {
        swap(&mut self.forgetting_factor, &mut other.forgetting_factor);
        swap(&mut self.information_floor, &mut other.information_floor);
        swap(&mut self.max_iterations, &mut other.max_iterations);
        swap(&mut self.step_factor, &mut other.step_factor);
        swap(&mut self.noise_floor_relative, &mut other.noise_floor_relative);
        swap(&mut self.outliers, &mut other.outliers);
        swap(&mut self.change_detection, &mut other.change_detection);
    }

    /// The paper's recursion (8), (9) from the given start: exponential forgetting, one iteration,
    /// no bounds except those of `parameters` (plain numbers have none), no extensions.
    pub fn paper(parameters: impl IntoIterator<Item: Into<ParameterPrior>>, equations: usize) -> Self {
        Self {
            parameters: parameters.into_iter().map(Into::into).collect(),
            equations: vec![EquationNoise::LEARNT; equations],
            relations: Vec::new(),
            forgetting: Forgetting::Exponential,
            bound: Bound::Polynomial,
            forgetting_factor: 0.95,
            information_floor: 1e-3,
            max_iterations: 1,
            step_factor: f64::INFINITY,
            noise_floor_relative: 1e-9,
            drift_per_s: 0.0,
            outliers: Outliers::Keep,
            change_detection: None,
        }
    }

    /// With relinearisation and change detection: ten damped iterations limited to a factor of 3,
    /// directional forgetting, change detection.
    pub fn recommended(parameters: impl IntoIterator<Item: Into<ParameterPrior>>, equations: usize) -> Self {
        Self {
            forgetting: Forgetting::Directional,
            information_floor: 1e-6,
            max_iterations: 10,
            step_factor: 3.0,
            change_detection: Some(ChangeDetection::default()),
            ..Self::paper(parameters, equations)
        }
    }

    /// The parameters that are fixed.
    pub(super) fn fixed(&self) -> IndexSet {
        (0..self.parameters.len())
            .filter(|&i| self.parameters[i].fixed)
            .collect()
    }

    /// Fixes these parameters, and frees the others.
    pub(super) fn set_fixed(&mut self, fixed: IndexSet) {
        for (i, prior) in self.parameters.iter_mut().enumerate() {
            prior.fixed = fixed.contains(i);
        }
    }

    /// The start values θ̂₀.
    pub fn theta_start(&self) -> Vec<f64> {
        self.parameters.iter().map(|prior| prior.start).collect()
    }

    /// Checks every value and that the lists fit the structure.
    ///
    /// # Errors
    /// The first invalid option, with the expected and the given value.
    pub fn validate(&self, structure: &Structure) -> Result<(), EstimatorError> {
        let params = structure.params;
        let equations = structure.equations.len();
        if params == 0
            || params > super::MAX_PARAMS
            || equations == 0
            || structure.equations.iter().any(|r| r.start > r.end || r.end > params)
        {
            return Err(EstimatorError::Structure { params, equations });
        }
        self.validate_lists(params, equations)?;
        self.validate_starts()?;
        self.validate_relations(structure)?;
        self.validate_forgetting()?;
        self.validate_fit()?;
        self.validate_rows()
    }

    /// The lists have a number for each parameter or equation, each within its range.
    fn validate_lists(&self, params: usize, equations: usize) -> Result<(), EstimatorError> {
        length("theta_start", params, self.parameters.len())?;
        length("noise_std", equations, self.equations.len())?;
        let deviation = ("a finite number, not negative", |v: f64| v.is_finite() && v >= 0.0);
        let priors = || self.parameters.iter();
        let finite = ("a finite number", f64::is_finite);
        each("theta_start", priors().map(|p| p.start), finite)?;
        each("start_std", priors().map(|p| p.std), deviation)?;
        let lower = ("a number below +inf", |v| v < f64::INFINITY);
        each("lower", priors().map(|p| p.lower), lower)?;
        let upper = ("a number above -inf", |v| v > f64::NEG_INFINITY);
        each("upper", priors().map(|p| p.upper), upper)?;
        each("random_walk", priors().map(|p| p.random_walk), deviation)?;
        let positive = ("a finite number above 0", |v: f64| v.is_finite() && v > 0.0);
        each("noise_std", self.equations.iter().map(|e| e.std), positive)?;
        each("noise_floor", self.equations.iter().map(|e| e.floor), deviation)
    }

    /// The start lies between its bounds.
    fn validate_starts(&self) -> Result<(), EstimatorError> {
        for (index, prior) in self.parameters.iter().enumerate() {
            let ParameterPrior {
                start, lower, upper, ..
            } = *prior;
            if !prior.allows(start) {
                return Err(EstimatorError::StartOutsideBounds {
                    index,
                    start,
                    lower,
                    upper,
                });
            }
        }
        Ok(())
    }

    /// Each relation is of four parameters of one group.
    fn validate_relations(&self, structure: &Structure) -> Result<(), EstimatorError> {
        let groups = structure.groups();
        for (index, relation) in self.relations.iter().enumerate() {
            let linked = groups
                .iter()
                .any(|group| relation.iter().all(|i| group.parameters.contains(i)));
            let differ = (0..4).all(|p| !relation[..p].contains(&relation[p]));
            if !(linked && differ) {
                return Err(EstimatorError::Relation { index, got: *relation });
            }
        }
        Ok(())
    }

    /// The forgetting rule and its numbers are valid.
    fn validate_forgetting(&self) -> Result<(), EstimatorError> {
        let lambda = self.forgetting_factor;
        one(
            "forgetting_factor",
            "a number in (0, 1]",
            lambda,
            lambda > 0.0 && lambda <= 1.0,
        )?;
        if self.forgetting.is_bounded() && self.bound == Bound::Polynomial {
            let expected = "at least 0.5 with the polynomial bound (11), or the rational bound";
            one("forgetting_factor", expected, lambda, lambda >= 0.5)?;
        }
        let floor = self.information_floor;
        one(
            "information_floor",
            "a finite number above 0",
            floor,
            floor.is_finite() && floor > 0.0,
        )
    }

    /// The options of the fit are valid.
    fn validate_fit(&self) -> Result<(), EstimatorError> {
        one(
            "max_iterations",
            "1 to 1000",
            self.max_iterations as f64,
            (1..=1000).contains(&self.max_iterations),
        )?;
        one(
            "step_factor",
            "a number above 1",
            self.step_factor,
            self.step_factor > 1.0,
        )?;
        let drift = self.drift_per_s;
        one("drift_per_s", "a number in [0, 1]", drift, (0.0..=1.0).contains(&drift))
    }

    /// The options of noise, outliers and false alarms are valid.
    fn validate_rows(&self) -> Result<(), EstimatorError> {
        let relative = self.noise_floor_relative;
        one(
            "noise_floor_relative",
            "a number in [0, 0.1]",
            relative,
            (0.0..=0.1).contains(&relative),
        )?;
        match self.outliers {
            Outliers::Keep => {}
            Outliers::Huber(k) => one("outliers.huber", "0.5 to 10", k, (0.5..=10.0).contains(&k))?,
            Outliers::Gate(k) => one("outliers.gate", "2 to 100", k, (2.0..=100.0).contains(&k))?,
        }
        if let Some(detection) = self.change_detection {
            let rate = detection.false_alarm_rate;
            one(
                "false_alarm_rate",
                "a number in (0, 0.1]",
                rate,
                rate > 0.0 && rate <= 0.1,
            )?;
        }
        Ok(())
    }
}

/// λ = exp(−N Δ/τ): the factor per block of `block_len` samples that forgets with the time constant
/// `time_constant_s`.
///
/// # Errors
/// If an argument is not a positive finite number or λ would not lie in (0, 1).
pub fn forgetting_factor(time_constant_s: f64, block_len: usize, sample_period_s: f64) -> Result<f64, EstimatorError> {
    let positive = |v: f64| v.is_finite() && v > 0.0;
    one(
        "time_constant_s",
        "a finite number above 0",
        time_constant_s,
        positive(time_constant_s),
    )?;
    one(
        "sample_period_s",
        "a finite number above 0",
        sample_period_s,
        positive(sample_period_s),
    )?;
    one("block_len", "at least 1", block_len as f64, block_len > 0)?;
    let lambda = (-(block_len as f64) * sample_period_s / time_constant_s).exp();
    one(
        "time_constant_s",
        "not so short that nothing of a block is left",
        time_constant_s,
        lambda > 0.0,
    )?;
    Ok(lambda)
}

fn length(option: &'static str, expected: usize, got: usize) -> Result<(), EstimatorError> {
    if got == expected {
        Ok(())
    } else {
        Err(EstimatorError::Length { option, expected, got })
    }
}

fn each(
    option: &'static str,
    values: impl Iterator<Item = f64>,
    (expected, good): (&'static str, impl Fn(f64) -> bool),
) -> Result<(), EstimatorError> {
    match values.enumerate().find(|&(_, got)| !good(got)) {
        Some((index, got)) => Err(EstimatorError::Entry {
            option,
            index,
            expected,
            got,
        }),
        None => Ok(()),
    }
}

fn one(option: &'static str, expected: &'static str, got: f64, good: bool) -> Result<(), EstimatorError> {
    if good {
        Ok(())
    } else {
        Err(EstimatorError::Value { option, expected, got })
    }
}

/// An option that an estimator cannot work with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EstimatorError {
    /// The structure has no parameters, no equations, or an equation with parameters that do not
    /// exist.
    #[error(
        "expected equations with 1 to 128 parameters that lie within the plant's, got {equations} equations and {params} parameters"
    )]
    Structure {
        /// Number of parameters.
        params: usize,
        /// Number of equations.
        equations: usize,
    },
    /// A list has the wrong length.
    #[error("{option}: expected {expected} values, got {got}")]
    Length {
        /// Name of the option.
        option: &'static str,
        /// Expected length.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// An entry of a list is out of its range.
    #[error("{option}, entry {index}: expected {expected}, got {got}")]
    Entry {
        /// Name of the option.
        option: &'static str,
        /// Index of the entry, counted from 0.
        index: usize,
        /// What was expected.
        expected: &'static str,
        /// Value given.
        got: f64,
    },
    /// A value is out of its range.
    #[error("{option}: expected {expected}, got {got}")]
    Value {
        /// Name of the option.
        option: &'static str,
        /// What was expected.
        expected: &'static str,
        /// Value given.
        got: f64,
    },
    /// The start value of a parameter lies outside its bounds, or these are the wrong way round.
    #[error("theta_start, entry {index}: expected {lower} to {upper}, got {start}")]
    StartOutsideBounds {
        /// Index of the parameter, counted from 0.
        index: usize,
        /// Start value.
        start: f64,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// A relation between parameters that no equation links, or that it names twice.
    #[error("relations, entry {index}: expected four different parameters of one group of equations, got {got:?}")]
    Relation {
        /// Index of the relation, counted from 0.
        index: usize,
        /// The parameters given, counted from 0.
        got: [usize; 4],
    },
    /// A name that is not in the list of choices.
    #[error("{what}: expected {expected}, got \"{got}\"")]
    UnknownName {
        /// The option.
        what: &'static str,
        /// Name given.
        got: String,
        /// The valid names.
        expected: &'static str,
    },
}
