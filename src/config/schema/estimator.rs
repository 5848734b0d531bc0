//! Section `[estimator]`: the recursion over blocks of samples.

use super::super::choice::choices;
use super::super::kind::{Interval, Kind};
use super::table::{FINITE, LONGEST_S, NOT_NEGATIVE, POSITIVE, choice, equations, parameters, table};
use crate::estimator::{Bound, CEDRO2022_BLOCK_LEN, ChangeDetection, Forgetting, cedro2022_estimator};

choices! {
    /// Which bounds the parameters keep.
    BoundsKind {
        /// None.
        None = "none",
        /// The physical ones of the model.
        Model = "model",
        /// Those in `lower` and `upper`.
        Listed = "listed",
    }

    /// Which relations published estimates satisfy.
    RelationsKind {
        /// None.
        None = "none",
        /// Those that the model knows.
        Model = "model",
    }

    /// What is done about rows far outside the noise.
    OutliersKind {
        /// They are kept.
        Keep = "keep",
        /// They pull with constant force.
        Huber = "huber",
        /// They are left out.
        Gate = "gate",
    }
}

table! {
    /// Section `[estimator]`.
    Estimator where estimator = cedro2022_estimator(); {
        block_len: u64 = CEDRO2022_BLOCK_LEN as u64, Kind::Whole(1, 10_000_000), "samples",
            "Samples per block, the paper's N; one estimate per block";
        theta_start: Vec<f64> = Vec::new(), parameters(FINITE), "",
            "Start values of the parameters, in the order and units of the model; none: the model's own";
        start_std: Vec<f64> = Vec::new(), parameters(NOT_NEGATIVE), "",
            "Standard deviations of the start values, reported until data come; none: the values' magnitudes";
        forgetting: Forgetting = estimator.forgetting, choice::<Forgetting>(), "",
            "Rule by which old information is forgotten: exponential is (9), bounded-as-printed (10) with (11) literally, bounded (10) without its own λ";
        bound: Bound = estimator.bound, choice::<Bound>(), "",
            "Function G of the bounded rules: polynomial is (11), for λ of at least 0.5; rational is x/(λ + (1 − λ) x)";
        forgetting_factor: Option<f64> = Some(estimator.forgetting_factor), Kind::Real(Interval::above(0.0, 1.0)), "",
            "λ per block; 1 forgets nothing";
        time_constant_s: Option<f64> = None, Kind::Real(Interval::above(0.0, LONGEST_S)), "s",
            "Instead of forgetting_factor: time τ in which old information falls to 1/e, λ = exp(−block_len sample_period_s/τ)";
        information_floor: f64 = estimator.information_floor, Kind::Real(Interval::above(0.0, 1e30)), "",
            "ε: the information at the start is ε times the identity, and never less with the rules bounded and floor";
        max_iterations: u64 = estimator.max_iterations as u64, Kind::Whole(1, 1000), "",
            "Gauss-Newton iterations per block; 1 is the paper's single undamped step (8)";
        step_factor: f64 = estimator.step_factor, Kind::Real(Interval::above(1.0, f64::INFINITY).or_infinite()), "",
            "Largest factor by which an iteration changes a positive parameter; inf for no limit";
        bounds: BoundsKind = BoundsKind::None, choice::<BoundsKind>(), "",
            "Which bounds the parameters keep: none, the physical ones of the model, or those listed in lower and upper";
        lower: Vec<f64> = Vec::new(), parameters(FINITE.or_infinite()), "",
            "Lower bounds for bounds = \"listed\"; -inf for none";
        upper: Vec<f64> = Vec::new(), parameters(FINITE.or_infinite()), "",
            "Upper bounds for bounds = \"listed\"; inf for none";
        relations: RelationsKind = RelationsKind::None, choice::<RelationsKind>(), "",
            "Whether published estimates satisfy what the model knows of its parameters, the arm's theta_1/theta_3 = theta_2/theta_4 for one";
        fixed: Vec<String> = Vec::new(), Kind::Words, "",
            "Names of parameters that keep their start value";
        noise_std: Vec<f64> = Vec::new(), equations(POSITIVE), "",
            "Standard deviation of each equation's rows, in the equation's unit: weighs equations that share parameters; none: 1";
        noise_floor: Vec<f64> = Vec::new(), equations(NOT_NEGATIVE), "",
            "Lower limit of the estimated noise of the weighted rows, and the noise that residuals are compared with: 1 for projected rows whose sensors are configured; none: 0, and residuals are compared with what was learnt; a single number counts for all equations";
        noise_floor_relative: f64 = estimator.noise_floor_relative, Kind::Real(Interval::closed(0.0, 0.1)), "",
            "noise_floor as a share of the rows' size; keeps tests from reacting to rounding if data are free of noise";
        random_walk: Vec<f64> = Vec::new(), parameters(NOT_NEGATIVE), "",
            "For drifting plants: standard deviation of each parameter's random walk per block, relative to the parameter; none: 0";
        outliers: OutliersKind = OutliersKind::Keep, choice::<OutliersKind>(), "",
            "Rows far outside the noise: keep them, let them pull with constant force (huber), or leave them out (gate)";
        huber_limit: f64 = 1.345, Kind::Real(Interval::closed(0.5, 10.0)), "standard deviations",
            "Where huber begins; 1.345 keeps 95 % efficiency for normal noise";
        gate_limit: f64 = 6.0, Kind::Real(Interval::closed(2.0, 100.0)), "standard deviations",
            "Where gate begins";
        change_detection: bool = false, Kind::Flag, "",
            "Look for sudden changes of the plant, locate them in the block and follow them";
        false_alarm_rate: f64 = ChangeDetection::default().false_alarm_rate, Kind::Real(Interval::above(0.0, 0.1)), "",
            "Probability that a block of an unchanged plant raises an alarm";
        change_margin_s: f64 = 0.0, Kind::Real(Interval::closed(0.0, 60.0)), "s",
            "Time after a located change that is left out, too, because the change affects rows there; 0 for exact signals";
    }
}
