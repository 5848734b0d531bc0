//! Every key there is, defined once: its section, name, type, range, unit and meaning.
//!
//! From this one list follow the structures that a file is read into, the checks and their messages, and `config/default.toml`.

use super::kind::{Interval, Key, Kind, Len};
use serde::{Deserialize, Serialize};

/// Keys of which one excludes the others.
pub(super) const EXCLUSIVE: &[&[&str]] = &[
    &["estimator.forgetting_factor", "estimator.time_constant_s"],
    &["plant.setpoint.csv.path", "plant.setpoint.csv.rows"],
];

/// Keys that configurations had once, with what to write now.
pub(super) const RETIRED: &[(&str, &str)] = &[(
    "identifier.projected.velocity_half_width",
    "is a time now: write velocity_half_width_s, the samples times plant.sample_period_s, for example 0.01 for 10 samples at 1 ms",
)];

/// All keys, in the order of `config/default.toml`.
pub fn keys() -> impl Iterator<Item = &'static Key> {
    SECTIONS.iter().flat_map(|section| section.keys)
}

/// The key with this full name.
pub(super) fn key(path: &str) -> Option<&'static Key> {
    let (section, name) = path.rsplit_once('.')?;
    keys().find(|key| key.section == section && key.name == name)
}

/// A section of the configuration.
pub(super) struct Section {
    pub name: &'static str,
    pub meaning: &'static str,
    pub keys: &'static [Key],
}

/// Whether a field may be left out.
trait Field {
    const OPTIONAL: bool = false;
}
impl Field for bool {}
impl Field for u64 {}
impl Field for f64 {}
impl Field for String {}
impl Field for RealOrWord {}
impl Field for FaultForm {}
impl<T: Field> Field for Vec<T> {}
impl<T: Field> Field for Option<T> {
    const OPTIONAL: bool = true;
}

/// A number, or a word that stands for one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RealOrWord {
    /// A number.
    Real(f64),
    /// A word.
    Word(String),
}

/// One `[[plant.faults]]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultForm {
    /// What it does.
    pub kind: String,
    /// To what.
    #[serde(default = "FaultForm::sample")]
    pub signal: String,
    /// To which joint, counted from 1; 0 for all.
    #[serde(default)]
    pub joint: u64,
    /// First instant \[s\].
    pub from_s: f64,
    /// First instant that is right again \[s\].
    #[serde(default = "FaultForm::never")]
    pub to_s: f64,
    /// Factor of `wrong`.
    #[serde(default = "FaultForm::one")]
    pub gain: f64,
    /// Addend of `wrong`, in the signal's unit.
    #[serde(default)]
    pub offset: f64,
    /// Period of `slow` and `intermittent` \[s\].
    #[serde(default)]
    pub period_s: f64,
    /// Delay of `delayed` \[s\].
    #[serde(default)]
    pub delay_s: f64,
    /// Share of `intermittent`.
    #[serde(default = "FaultForm::half")]
    pub share: f64,
}

impl FaultForm {
    fn sample() -> String {
        "sample".to_owned()
    }
    fn never() -> f64 {
        f64::INFINITY
    }
    fn one() -> f64 {
        1.0
    }
    fn half() -> f64 {
        0.5
    }
}

/// Name, whether it may be left out, kind, unit, meaning.
macro_rules! table_keys {
    ($section:literal: $( $name:ident $optional:literal, $kind:expr, $unit:literal, $meaning:literal; )*) => {
        &[ $( Key {
            section: $section,
            name: stringify!($name),
            kind: $kind,
            unit: $unit,
            meaning: $meaning,
            optional: $optional,
        }, )* ]
    };
}

/// The keys of a `[[plant.faults]]`.
static FAULT_KEYS: &[Key] = table_keys! { "plant.faults":
    kind false, Kind::Choice(&["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"]), "",
        "off: nothing comes. stuck: the value at the beginning. garbage: NaN, infinities, any number. wrong: gain x + offset. slow: a new value once per period_s. delayed: the value of delay_s ago, samples come so much later. intermittent: off in a share of periods";
    signal true, Kind::Choice(&["sample", "time", "q", "dq", "ddq", "dddq", "setpoint", "input"]), "",
        "What it happens to: the whole sample (default; off then means that it is lost), its time stamp (stuck and wrong only), or one of its signals (off then clears its bit in the mask, or gives NaN for a single joint)";
    joint true, Kind::Whole(0, 2), "",
        "Joint of the signal; 0 for both (default)";
    from_s false, Kind::Real(Interval::closed(0.0, LONGEST_S)), "s",
        "Beginning in stream time";
    to_s true, Kind::Real(Interval::above(0.0, f64::INFINITY).or_infinite()), "s",
        "First instant that is right again; inf for never (default)";
    gain true, Kind::Real(FINITE), "",
        "Factor of wrong; 1 (default). Of time: how fast the clock runs from from_s on";
    offset true, Kind::Real(FINITE), "unit of the signal, s for time",
        "Addend of wrong; 0 (default)";
    period_s true, Kind::Real(Interval::closed(0.0, LONGEST_S)), "s",
        "Period of slow and intermittent; a sample period at least (default)";
    delay_s true, Kind::Real(Interval::closed(0.0, 10.0)), "s",
        "Delay of delayed, above 0. Late samples need a pace: at speed \"max\" there is no late";
    share true, Kind::Real(Interval::closed(0.0, 1.0)), "",
        "Share of periods that are off, drawn from plant.seed; 0.5 (default)";
};

macro_rules! sections {
    ($( $field:ident : $struct:ident = $section:literal, $about:literal {
        $( $name:ident : $type:ty, $kind:expr, $unit:literal, $meaning:literal; )*
    } )*) => {
        /// The configuration in the form of its file: every section with its keys.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct FileForm {
            $(
                #[doc = $about]
                #[serde(rename = $section)]
                pub $field: $struct,
            )*
        }
        $(
            #[doc = $about]
            #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
            #[serde(deny_unknown_fields)]
            pub struct $struct {
                $( #[doc = $meaning] pub $name: $type, )*
            }
        )*
        pub(super) static SECTIONS: &[Section] = &[ $( Section {
            name: $section,
            meaning: $about,
            keys: &[ $( Key {
                section: $section,
                name: stringify!($name),
                kind: $kind,
                unit: $unit,
                meaning: $meaning,
                optional: <$type as Field>::OPTIONAL,
            }, )* ],
        }, )* ];
    };
}

const FINITE: Interval = Interval::ANY;
const POSITIVE: Interval = Interval::POSITIVE;
const NOT_NEGATIVE: Interval = Interval::NOT_NEGATIVE;
/// Longest time that a key may ask for: some thirty years.
const LONGEST_S: f64 = 1e9;
const LIST: Len = Len::From(1, 100_000);

/// A number per joint.
const fn joints(interval: Interval) -> Kind {
    Kind::Reals(Len::Joints, interval)
}

/// A number per parameter, or none.
const fn parameters(interval: Interval) -> Kind {
    Kind::Reals(Len::Parameters, interval)
}

/// A number per equation, or none.
const fn equations(interval: Interval) -> Kind {
    Kind::Reals(Len::Equations, interval)
}

sections! {
    bus: Bus = "bus", "Which topics, and how samples are delivered" {
        robot: String, Kind::Name, "",
            "Name of the machine; the topics are thetabus/ROBOT/sample, estimate, status";
        domain: String, Kind::Name, "",
            "Isolates whole runs from each other; programs of one run name the same domain";
        delivery: String, Kind::Choice(&["auto", "realtime", "lockstep"]), "",
            "realtime: the plant never waits, a late consumer loses the oldest samples. lockstep: the plant waits, nothing is lost. auto: lockstep where plant.speed is \"max\", else realtime";
        lockstep_consumers: u64, Kind::Whole(0, 64), "",
            "Consumers of samples that must be attached before a lockstep run starts; `run` sets it";
        lockstep_limit_s: f64, Kind::Real(Interval::closed(0.1, 3600.0)), "s",
            "Longest time that a lockstep run waits for its consumers, or for one of them that is stuck, which is then cut off";
        sample_buffer: u64, Kind::Whole(256, 65536), "",
            "Samples that a consumer of a realtime run may be behind before it loses the oldest; the plant takes about 560 bytes of shared memory for each, times max_sample_subscribers";
        max_sample_subscribers: u64, Kind::Whole(1, 64), "",
            "Programs that can receive samples at a time: identifiers, recorders, your own. Whoever makes the topic decides: the plant";
        max_estimate_subscribers: u64, Kind::Whole(2, 128), "",
            "Programs that can receive estimates at a time, and status, journal and description. Whoever makes the topic decides: the first program to start";
        max_programs: u64, Kind::Whole(4, 256), "",
            "Programs that can have a topic open at a time, publishers included; at least as many as the subscribers";
    }
    plant: Plant = "plant", "The simulated machine" {
        duration_s: f64, Kind::Real(Interval::above(0.0, LONGEST_S)), "s",
            "Length of the run in simulated time";
        machine: String, Kind::Choice(&["arm", "servo_axis", "model"]), "",
            "arm: two joints, sections plant.arm, plant.mass_2, plant.controller. servo_axis: one joint, section plant.servo_axis; the first joint's values of lists count, in m for a linear axis. model: the equations of the model itself, section plant.model; what a program with a model of its own simulates by default";
        speed: RealOrWord, Kind::RealOr(Interval::closed(1e-3, 1e3), "max"), "",
            "Simulated seconds per second; \"max\" is as fast as it can be computed and consumed";
        seed: u64, Kind::Whole(0, i64::MAX as u64), "",
            "Seed of everything random; the same seed gives the same samples, bit by bit";
        sample_period_s: f64, Kind::Real(Interval::closed(1e-5, 0.1)), "s",
            "Time between two samples, the paper's Δ; also converts estimator.time_constant_s";
        substeps: u64, Kind::Whole(1, 1000), "",
            "Runge-Kutta steps per sample";
        initial_q_rad: Vec<f64>, joints(Interval::closed(-100.0, 100.0)), "rad",
            "Joint positions at the start; the arm starts at rest, its weight held by the motors";
        faults: Vec<FaultForm>, Kind::Tables(FAULT_KEYS), "",
            "What goes wrong on the way from the machine to its listeners, a table [[plant.faults]] for each fault, in order; the machine and its controller are not concerned";
    }
    arm: Arm = "plant.arm", "The simulated arm: two uniform beams, a DC motor at each joint" {
        length_1_m: f64, Kind::Real(POSITIVE), "m",
            "Length l1 of link 1, the column";
        mass_1_kg: f64, Kind::Real(POSITIVE), "kg",
            "Mass m1 of link 1";
        length_2_m: f64, Kind::Real(POSITIVE), "m",
            "Length l2 of link 2, the arm";
        gravity_m_s2: f64, Kind::Real(NOT_NEGATIVE), "m/s²",
            "Acceleration of gravity g";
        winding_resistance_ohm: Vec<f64>, joints(POSITIVE), "Ω",
            "Resistance R_w of each motor";
        winding_inductance_h: Vec<f64>, joints(POSITIVE), "H",
            "Inductance L of each motor";
        torque_constant_n_m_per_a: Vec<f64>, joints(POSITIVE), "N m/A",
            "Torque constant k_m of each motor";
        back_emf_constant_v_s_per_rad: Vec<f64>, joints(NOT_NEGATIVE), "V s/rad",
            "Back-EMF constant k_e of each motor";
    }
    mass_2: Mass2 = "plant.mass_2", "Mass m2 of link 2 with its payload over time, as points" {
        t_s: Vec<f64>, Kind::Reals(LIST, Interval::closed(0.0, LONGEST_S)), "s",
            "Times of the points, rising, the first one 0";
        mass_kg: Vec<f64>, Kind::Reals(LIST, POSITIVE), "kg",
            "Masses from these times on, as many";
        between: String, Kind::Choice(&["step", "linear"]), "",
            "Between two points the mass keeps the value of the first (step) or follows the straight line (linear)";
    }
    servo_plant: ServoAxisPlant = "plant.servo_axis", "The simulated servo axis, in m and N or in rad and N m: M dv/dt = gain u − viscous_friction v − coulomb_friction sign v − offset" {
        t_s: Vec<f64>, Kind::Reals(LIST, Interval::closed(0.0, LONGEST_S)), "s",
            "Times from which on the masses hold, rising, the first one 0";
        mass: Vec<f64>, Kind::Reals(LIST, POSITIVE), "kg or kg m²",
            "Masses or moments of inertia from these times on, as many";
        viscous_friction: f64, Kind::Real(NOT_NEGATIVE), "N s/m or N m s/rad",
            "Friction that grows with speed";
        coulomb_friction: f64, Kind::Real(NOT_NEGATIVE), "N or N m",
            "Friction that does not; the axis sticks while it is not overcome";
        offset: f64, Kind::Real(FINITE), "N or N m",
            "Constant force or torque against positive motion";
        gain: f64, Kind::Real(FINITE), "N or N m per unit of input",
            "What the drive gives for one unit of input, not 0";
        proportional_gain: f64, Kind::Real(NOT_NEGATIVE), "input per m or rad",
            "Gain Kp of the controller u = Kp (setpoint − q) − Kd v, analog or sampled as plant.controller.kind says";
        derivative_gain: f64, Kind::Real(NOT_NEGATIVE), "input per m/s or rad/s",
            "Gain Kd of the controller";
        input_limit: f64, Kind::Real(POSITIVE.or_infinite()), "unit of the input",
            "Most that the drive gives, either sign; inf: no limit";
        position_resolution: f64, Kind::Real(NOT_NEGATIVE), "m or rad",
            "One count of the position sensor, and no measured derivatives; 0: as plant.sensors.encoder_bits says";
    }
    model_plant: ModelPlant = "plant.model", "The simulated machine of the model's own equations; joint j follows the setpoint of joint j mod 2" {
        theta: Vec<f64>, parameters(FINITE), "the parameters' own",
            "True values of the parameters in their order; none: a quarter above their start values";
        change_s: Option<f64>, Kind::Real(Interval::above(0.0, LONGEST_S)), "s",
            "Time of a change of the true values";
        theta_after: Vec<f64>, parameters(FINITE), "the parameters' own",
            "True values from change_s on";
        proportional_gain: Vec<f64>, equations(NOT_NEGATIVE), "input per rad or m",
            "Gain Kp of each joint's controller u = Kp (setpoint - q) - Kd dq, sampled and held; none: from the joint's inertia";
        derivative_gain: Vec<f64>, equations(NOT_NEGATIVE), "input per rad/s or m/s",
            "Gain Kd of each joint; none: from the joint's inertia";
    }
    controller: Controller = "plant.controller", "The PD controllers (13): u = Kp (setpoint − q) − Kd dq" {
        kind: String, Kind::Choice(&["analog", "sampled"]), "",
            "analog: continuous, as in the paper. sampled: computed once per sample and held; unstable for |q2| near π/2 at 1 kHz";
        feedback: String, Kind::Choice(&["true", "measured"]), "",
            "Position that the controller works with: the true one, or as its sample has it (sampled only); the velocity is true, as from a tachometer";
        proportional_gain_v_per_rad: Vec<f64>, joints(NOT_NEGATIVE), "V/rad",
            "Gain Kp of each joint";
        derivative_gain_v_s_per_rad: Vec<f64>, joints(NOT_NEGATIVE), "V s/rad",
            "Gain Kd of each joint";
        voltage_limit_v: f64, Kind::Real(POSITIVE.or_infinite()), "V",
            "Most that each drive gives, either sign, feed-forward included; inf: no limit";
    }
    sensors: Sensors = "plant.sensors", "What stands between the machine's exact signals and its samples" {
        input_noise_v: f64, Kind::Real(NOT_NEGATIVE), "V",
            "Standard deviation of white noise on the measured voltage; the motor itself does not see it";
        spike_probability: f64, Kind::Real(Interval::closed(0.0, 1.0)), "",
            "Share of samples whose measured voltage carries a spike, per joint";
        spike_v: f64, Kind::Real(NOT_NEGATIVE), "V",
            "Standard deviation of the spikes";
        input_limit_v: f64, Kind::Real(POSITIVE.or_infinite()), "V",
            "Most that the voltage measurement shows, either sign; inf: no limit";
        input_resolution_v: f64, Kind::Real(NOT_NEGATIVE), "V",
            "One count of the voltage measurement, the range by 2^bits; 0: voltages without rounding";
        encoder_bits: u64, Kind::Whole(0, 40), "bits",
            "2^bits counts per turn on each joint, and no measured derivatives; 0: positions without rounding";
        position_noise_rad: f64, Kind::Real(NOT_NEGATIVE), "rad",
            "Standard deviation of white noise on the measured positions, before they are rounded";
        position_spike_probability: f64, Kind::Real(Interval::closed(0.0, 1.0)), "",
            "Share of samples whose measured position carries a spike, per joint";
        position_spike_rad: f64, Kind::Real(NOT_NEGATIVE), "rad",
            "Standard deviation of the spikes on positions";
        eccentricity_rad: f64, Kind::Real(Interval::closed(-0.1, 0.1)), "rad",
            "Size a of the error of encoders mounted off their axes, which show q + a sin(q + eccentricity_phase_rad); 100 arc seconds are 4.8e-4";
        eccentricity_phase_rad: f64, Kind::Real(FINITE), "rad",
            "Where on the turn this error is 0 and rises, with the opposite sign";
        resonance_hz: f64, Kind::Real(Interval::closed(0.0, 1000.0)), "Hz",
            "Frequency of a resonance between each joint and its encoder, as of a soft coupling; 0: none";
        resonance_damping: f64, Kind::Real(Interval::closed(0.0, 10.0)), "",
            "Damping ratio of this resonance";
        input_delay_s: f64, Kind::Real(Interval::closed(-0.01, 0.01)), "s",
            "The recorded voltage acts this much later than the positions of its sample say";
        jitter_s: f64, Kind::Real(Interval::closed(0.0, 1e-3)), "s",
            "Standard deviation of the instant at which the positions are read";
        stamp_jitter_s: f64, Kind::Real(Interval::closed(0.0, 0.01)), "s",
            "Standard deviation of the samples' instants around their grid, at most 0.4 periods off; controller and time stamps keep to the true instants";
        loss_probability: f64, Kind::Real(Interval::closed(0.0, 0.999)), "",
            "Share of samples that are lost on their way to everybody";
        loss_burst: u64, Kind::Whole(1, 10_000), "samples",
            "Samples that are lost in one go";
    }
    unmodelled: Unmodelled = "plant.unmodelled", "What the arm does beyond the equations that are identified; all off by default" {
        coulomb_friction_n_m: Vec<f64>, joints(NOT_NEGATIVE), "N m",
            "Friction of each joint that does not depend on speed";
        friction_speed_rad_per_s: f64, Kind::Real(POSITIVE), "rad/s",
            "Speed over which this friction changes its sign, as tanh(dq/speed); the smaller, the more plant.substeps it takes";
        base_tilt_rad: f64, Kind::Real(Interval::closed(-0.5, 0.5)), "rad",
            "How far the axis of joint 1 is off the vertical";
        heating_share: f64, Kind::Real(Interval::closed(-0.9, 10.0)), "",
            "Share by which both winding resistances grow from the start on, at a constant rate";
        heating_s: f64, Kind::Real(POSITIVE), "s",
            "Time that this takes; they stay then";
    }
    setpoint: Setpoint = "plant.setpoint", "Commanded positions; only the section of the chosen kind is used" {
        kind: String, Kind::Choice(&["steps", "square", "sines", "random_sines", "random", "moves", "chirp", "csv"]), "",
            "Kind of commanded motion, for both joints";
    }
    steps: Steps = "plant.setpoint.steps", "A cycle of levels" {
        levels_rad: Vec<Vec<f64>>, Kind::RealsPerJoint(Len::From(1, 10_000), FINITE), "rad",
            "Levels of each joint, in turn";
        dwell_s: Vec<f64>, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Time on each level, at least one sample period; whole samples";
        shift_s: Vec<f64>, joints(Interval::closed(0.0, LONGEST_S)), "s",
            "How far into the cycle the run starts";
    }
    square: Square = "plant.setpoint.square", "Between offset + amplitude and offset − amplitude" {
        amplitude_rad: Vec<f64>, joints(FINITE), "rad",
            "Amplitude of each joint";
        offset_rad: Vec<f64>, joints(FINITE), "rad",
            "Mean of each joint";
        period_s: Vec<f64>, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Period of each joint, at least two sample periods";
        shift_s: Vec<f64>, joints(Interval::closed(0.0, LONGEST_S)), "s",
            "How far into the period the run starts";
    }
    sines: Sines = "plant.setpoint.sines", "A sum of given sines" {
        offset_rad: Vec<f64>, joints(FINITE), "rad",
            "Mean of each joint";
        frequency_hz: Vec<Vec<f64>>, Kind::RealsPerJoint(Len::From(1, 64), POSITIVE), "Hz",
            "Frequencies of each joint";
        amplitude_rad: Vec<Vec<f64>>, Kind::RealsPerJoint(Len::From(1, 64), FINITE), "rad",
            "Amplitudes, as many as frequencies";
        phase_rad: Vec<Vec<f64>>, Kind::RealsPerJoint(Len::From(1, 64), FINITE), "rad",
            "Phases at the start, as many as frequencies";
    }
    random_sines: RandomSines = "plant.setpoint.random_sines", "A sum of sines drawn from the seed, velocities equal" {
        count: u64, Kind::Whole(1, 64), "",
            "Number of sines per joint, spread evenly over the logarithmic frequency range";
        min_frequency_hz: Vec<f64>, joints(POSITIVE), "Hz",
            "Lowest frequency of each joint";
        max_frequency_hz: Vec<f64>, joints(Interval::above(0.0, 1e6)), "Hz",
            "Highest frequency of each joint";
        amplitude_rad: Vec<f64>, joints(NOT_NEGATIVE), "rad",
            "Bound of each joint's motion";
    }
    random: Random = "plant.setpoint.random", "Levels and dwell times drawn uniformly from the seed" {
        min_rad: Vec<f64>, joints(FINITE), "rad",
            "Lowest level of each joint";
        max_rad: Vec<f64>, joints(FINITE), "rad",
            "Highest level of each joint";
        min_dwell_s: Vec<f64>, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Shortest time on a level, at least one sample period";
        max_dwell_s: Vec<f64>, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Longest time on a level";
    }
    moves: Moves = "plant.setpoint.moves", "Moves from point to point, each followed by a rest; levels and times drawn uniformly from the seed" {
        profile: String, Kind::Choice(&["minimum_jerk", "trapezoidal"]), "",
            "minimum_jerk: a polynomial of degree 5. trapezoidal: a third of the time each to speed up, cruise and slow down";
        min_rad: Vec<f64>, joints(FINITE), "rad",
            "Lowest level of each joint";
        max_rad: Vec<f64>, joints(FINITE), "rad",
            "Highest level of each joint";
        min_move_s: Vec<f64>, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Shortest duration of a move, at least one sample period; whole samples";
        max_move_s: Vec<f64>, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Longest duration of a move";
        min_rest_s: Vec<f64>, joints(Interval::closed(0.0, LONGEST_S)), "s",
            "Shortest rest after a move; whole samples";
        max_rest_s: Vec<f64>, joints(Interval::closed(0.0, LONGEST_S)), "s",
            "Longest rest after a move";
    }
    chirp: Chirp = "plant.setpoint.chirp", "A sine whose frequency moves exponentially, again and again" {
        amplitude_rad: Vec<f64>, joints(FINITE), "rad",
            "Amplitude of each joint";
        offset_rad: Vec<f64>, joints(FINITE), "rad",
            "Mean of each joint";
        start_frequency_hz: Vec<f64>, joints(POSITIVE), "Hz",
            "First frequency of each joint";
        end_frequency_hz: Vec<f64>, joints(POSITIVE), "Hz",
            "Last frequency of each joint";
        sweep_s: Vec<f64>, joints(Interval::above(0.0, LONGEST_S)), "s",
            "Time from the first to the last frequency";
    }
    csv: Csv = "plant.setpoint.csv", "Values at given times, read from a file" {
        path: Option<String>, Kind::Path, "",
            "File with the columns t_s, q1_rad, q2_rad and rising times; relative to the configuration file's directory";
        rows: Option<String>, Kind::Rows, "",
            "The rows of such a file themselves: what a configuration that a program writes, into a recording for instance, has in the place of path";
        between: String, Kind::Choice(&["step", "linear"]), "",
            "Between two rows the setpoint keeps the value of the first (step) or follows the straight line (linear)";
    }
    model: Model = "model", "The equations whose parameters are identified" {
        kind: String, Kind::Name, "",
            "manipulator: the two-joint arm with DC motors of equations (24) to (27), parameters theta_1 to theta_9. servo_axis: mass, viscous_friction, coulomb_friction, offset of one axis. A program with models of its own knows their names, too, and means the first of them unless this says otherwise";
        gravity_m_s2: f64, Kind::Real(NOT_NEGATIVE), "m/s²",
            "Acceleration of gravity g in the equations";
        coulomb_friction: bool, Kind::Flag, "",
            "Whether the manipulator has Coulomb friction at both joints: parameters coulomb_friction_1 and coulomb_inductance_1 behind theta_5, coulomb_friction_2 and coulomb_inductance_2 behind theta_9; needs rows = \"projected\"";
        offset: bool, Kind::Flag, "",
            "Whether the manipulator has a constant torque at both joints: parameters offset_1 and offset_2, behind those of friction";
    }
    servo_axis: ServoAxisModel = "model.servo_axis", "What is known of a servo axis" {
        motion: String, Kind::Choice(&["linear", "rotary"]), "",
            "linear: positions in m, forces in N. rotary: positions in rad, torques in N m";
        input: String, Kind::Choice(&["voltage", "current", "force"]), "",
            "What the drive's input is: control voltage [V], motor current [A], or force or torque itself [N or N m]";
        gain: f64, Kind::Real(FINITE), "N or N m per unit of input",
            "What the drive gives for one unit of input; 1 for a force or torque";
    }
    known: Known = "model.known", "What is known of the machine; with all three, physical values are derived from the estimate, such as mass_2 in kg" {
        length_1_m: Option<f64>, Kind::Real(POSITIVE), "m",
            "Length l1 of link 1";
        winding_resistance_ohm: Option<Vec<f64>>, joints(POSITIVE), "Ω",
            "Resistance R_w of each motor";
        torque_constant_n_m_per_a: Option<Vec<f64>>, joints(POSITIVE), "N m/A",
            "Torque constant k_m of each motor";
    }
    identifier: Identifier = "identifier", "How samples become rows of the estimation problem" {
        rows: String, Kind::Choice(&["pointwise", "projected"]), "",
            "pointwise: one row per sample and equation, from measured q, dq, ddq, dddq. projected: one row per window and equation, from q and the input alone";
        input: String, Kind::Choice(&["measured", "controller"]), "",
            "Where the drives' voltage comes from: measured, or computed from setpoint, q and dq by the PD law as in (27)";
        proportional_gain_v_per_rad: Vec<f64>, joints(NOT_NEGATIVE), "V/rad",
            "Gain Kp of each joint for input = \"controller\"";
        derivative_gain_v_s_per_rad: Vec<f64>, joints(NOT_NEGATIVE), "V s/rad",
            "Gain Kd of each joint for input = \"controller\"";
        input_limit: Vec<f64>, Kind::Reals(Len::From(1, 8), POSITIVE.or_infinite()), "V, A, N or N m",
            "Magnitude at which the measurement of the inputs ends, one number or one per joint: samples there are refused and counted as saturated; inf: no limit";
        frozen_after_s: f64, Kind::Real(Interval::closed(0.0, 3600.0)), "s",
            "A position or input that stands still to the bit for so long although the other one says that it must move is frozen: its samples are refused, its block left out; 0: never";
    }
    projected: Projected = "identifier.projected", "Rows from positions and inputs; for rows = \"projected\"" {
        window_s: RealOrWord, Kind::RealOr(POSITIVE, "auto"), "s",
            "Length of a window, 8 to 2000 sample periods; about 1.3 periods of the fastest motion that matters. \"auto\": chosen from the first motion and reviewed, 25 to 200 ms and at least 20 sample periods; stride_s and velocity_half_width_s are upper limits then";
        stride_s: f64, Kind::Real(POSITIVE), "s",
            "Time from a window to the next; a fifth of the window loses nothing worth having, and more than 0.02 loses much";
        velocity_half_width_s: f64, Kind::Real(POSITIVE), "s",
            "Time on either side that the velocity filter uses, rounded to 3 to 100 sample periods; 0.01 for 16-bit encoders, 0.005 from 20 bits on";
        timing: String, Kind::Choice(&["held", "continuous"]), "",
            "Input between samples: held by a sampled controller, or continuous except for jumps at sample instants";
        input_delay_s: f64, Kind::Real(FINITE), "s",
            "The recorded input acts on the plant this much later; negative where it was recorded late";
        estimate_input_delay: bool, Kind::Flag, "",
            "Identify the delay too, as the parameter input_delay [s], starting at input_delay_s";
        input_delay_limit_s: f64, Kind::Real(POSITIVE), "s",
            "Largest magnitude of an identified delay";
        position_resolution: Option<Vec<f64>>, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "rad or m",
            "One count of the encoders, one number for all joints or one per joint; 0 if positions are not rounded";
        position_noise: Option<Vec<f64>>, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "rad or m",
            "Standard deviation of white noise on the positions, one number or one per joint; 0 if only position_resolution is set";
        input_noise: Option<Vec<f64>>, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "V, A, N or N m",
            "Standard deviation of white noise on the inputs, one number or one per joint; 0 if only input_resolution is set";
        input_resolution: Option<Vec<f64>>, Kind::Reals(Len::From(1, 8), NOT_NEGATIVE), "V, A, N or N m",
            "One count of the measured inputs, one number or one per joint; 0 if they are not rounded";
        learn_noise: Option<bool>, Kind::Flag, "",
            "Take the noise from the signals, block by block, instead of the four levels above; not set: true if none of them is set";
    }
    considered: ConsideredErrors = "identifier.considered", "Standard deviations of errors that the machine may have and the model leaves out: not estimated, but sigma allows for what they could do as far as the data leave them open; for rows = \"projected\"" {
        input_delay_s: f64, Kind::Real(NOT_NEGATIVE), "s",
            "Delay of the recorded input beyond input_delay_s";
        gain: f64, Kind::Real(NOT_NEGATIVE), "",
            "Relative error of each drive's gain; 0 if parameters are meant in units of the drive as it reports itself";
        coulomb: f64, Kind::Real(NOT_NEGATIVE), "",
            "Coulomb friction at each joint whose model has none, as a share of the largest root mean square of its input so far";
        resonance_hz: f64, Kind::Real(NOT_NEGATIVE), "Hz",
            "Natural frequency of the flexibility between each motor and its load; 0 if the joints are rigid";
        drift_per_s: f64, Kind::Real(Interval::closed(0.0, 1.0)), "1/s",
            "Rate of change of each parameter, relative to the parameter: how far the estimate may lag behind a machine that warms up";
        zero_rad: f64, Kind::Real(NOT_NEGATIVE), "rad",
            "Error of each encoder's zero, or of gravity's direction; without effect on an axis that moves along a line";
        eccentricity_rad: f64, Kind::Real(NOT_NEGATIVE), "rad",
            "Amplitude of an encoder error of one period per turn; 1e-4 is 20 arc seconds; without effect on an axis that moves along a line";
    }
    estimator: Estimator = "estimator", "The recursion over blocks of samples" {
        block_len: u64, Kind::Whole(1, 10_000_000), "samples",
            "Samples per block, the paper's N; one estimate per block";
        theta_start: Vec<f64>, parameters(FINITE), "",
            "Start values of the parameters, in the order and units of the model; none: the model's own";
        start_std: Vec<f64>, parameters(NOT_NEGATIVE), "",
            "Standard deviations of the start values, reported until data come; none: the values' magnitudes";
        forgetting: String,
            Kind::Choice(&["exponential", "bounded-as-printed", "bounded", "floor", "directional"]), "",
            "Rule by which old information is forgotten: exponential is (9), bounded-as-printed (10) with (11) literally, bounded (10) without its own λ";
        bound: String, Kind::Choice(&["polynomial", "rational"]), "",
            "Function G of the bounded rules: polynomial is (11), for λ of at least 0.5; rational is x/(λ + (1 − λ) x)";
        forgetting_factor: Option<f64>, Kind::Real(Interval::above(0.0, 1.0)), "",
            "λ per block; 1 forgets nothing";
        time_constant_s: Option<f64>, Kind::Real(Interval::above(0.0, LONGEST_S)), "s",
            "Instead of forgetting_factor: time τ in which old information falls to 1/e, λ = exp(−block_len sample_period_s/τ)";
        information_floor: f64, Kind::Real(Interval::above(0.0, 1e30)), "",
            "ε: the information at the start is ε times the identity, and never less with the rules bounded and floor";
        max_iterations: u64, Kind::Whole(1, 1000), "",
            "Gauss-Newton iterations per block; 1 is the paper's single undamped step (8)";
        step_factor: f64, Kind::Real(Interval::above(1.0, f64::INFINITY).or_infinite()), "",
            "Largest factor by which an iteration changes a positive parameter; inf for no limit";
        bounds: String, Kind::Choice(&["none", "model", "listed"]), "",
            "Which bounds the parameters keep: none, the physical ones of the model, or those listed in lower and upper";
        lower: Vec<f64>, parameters(FINITE.or_infinite()), "",
            "Lower bounds for bounds = \"listed\"; -inf for none";
        upper: Vec<f64>, parameters(FINITE.or_infinite()), "",
            "Upper bounds for bounds = \"listed\"; inf for none";
        relations: String, Kind::Choice(&["none", "model"]), "",
            "Whether published estimates satisfy what the model knows of its parameters, the arm's theta_1/theta_3 = theta_2/theta_4 for one";
        fixed: Vec<String>, Kind::Words, "",
            "Names of parameters that keep their start value";
        noise_std: Vec<f64>, equations(POSITIVE), "",
            "Standard deviation of each equation's rows, in the equation's unit: weighs equations that share parameters; none: 1";
        noise_floor: Vec<f64>, equations(NOT_NEGATIVE), "",
            "Smallest standard deviation of the weighed rows that is believed, and the noise that residuals are judged by: 1 for projected rows whose sensors are configured; none: 0, and residuals are judged by what was learnt; a single number counts for all equations";
        noise_floor_relative: f64, Kind::Real(Interval::closed(0.0, 0.1)), "",
            "The same as a share of the rows' size; keeps tests from firing on rounding where data are free of noise";
        random_walk: Vec<f64>, parameters(NOT_NEGATIVE), "",
            "For drifting plants: standard deviation of each parameter's random walk per block, relative to the parameter; none: 0";
        outliers: String, Kind::Choice(&["keep", "huber", "gate"]), "",
            "Rows far outside the noise: keep them, let them pull with constant force (huber), or leave them out (gate)";
        huber_limit: f64, Kind::Real(Interval::closed(0.5, 10.0)), "standard deviations",
            "Where huber begins; 1.345 keeps 95 % efficiency for normal noise";
        gate_limit: f64, Kind::Real(Interval::closed(2.0, 100.0)), "standard deviations",
            "Where gate begins";
        change_detection: bool, Kind::Flag, "",
            "Look for sudden changes of the plant, locate them in the block and follow them";
        false_alarm_rate: f64, Kind::Real(Interval::above(0.0, 0.1)), "",
            "Probability that a block of an unchanged plant raises an alarm";
        change_margin_s: f64, Kind::Real(Interval::closed(0.0, 60.0)), "s",
            "After a located change so much more is left out, for rows that the change itself has smeared; 0 for exact signals";
    }
    supervision: Supervision = "supervision", "What `thetabus run` does about a process that fails or is killed" {
        restarts: u64, Kind::Whole(0, 1_000_000), "",
            "Times that each process is started again before the run gives up; 0: the run fails with the first one. A run with restarts ends with exit code 3, because something was lost with each";
        backoff_s: f64, Kind::Real(Interval::closed(0.0, 3600.0)), "s",
            "Pause before the first restart; twice as long before each further one";
        backoff_limit_s: f64, Kind::Real(Interval::closed(0.0, 3600.0)), "s",
            "Longest pause";
        healthy_s: f64, Kind::Real(Interval::above(0.0, LONGEST_S)), "s",
            "A process that has run this long has its restarts forgiven, and the pause begins anew";
    }
    realtime_plant: RealtimePlant = "realtime.plant", "Real-time settings of the plant simulator" {
        scheduler_priority: u64, Kind::Whole(0, 99), "",
            "Priority of the real-time policy SCHED_FIFO, 1 to 99; 0: the system's default policy. What the system refuses is told, and the program goes on";
        cpu_affinity: Vec<u64>, Kind::Wholes(Len::From(0, 64), 0, 1023), "",
            "Numbers of the CPUs to run on; none: all that the system gives";
        lock_memory: bool, Kind::Flag, "",
            "Keep all memory from being swapped out";
    }
    realtime_identifier: RealtimeIdentifier = "realtime.identifier", "Real-time settings of the identifier" {
        scheduler_priority: u64, Kind::Whole(0, 99), "",
            "Priority of the real-time policy SCHED_FIFO, 1 to 99; 0: the system's default policy. What the system refuses is told, and the program goes on";
        cpu_affinity: Vec<u64>, Kind::Wholes(Len::From(0, 64), 0, 1023), "",
            "Numbers of the CPUs to run on; none: all that the system gives";
        lock_memory: bool, Kind::Flag, "",
            "Keep all memory from being swapped out";
    }
    realtime_monitor: RealtimeMonitor = "realtime.monitor", "Real-time settings of the monitor" {
        scheduler_priority: u64, Kind::Whole(0, 99), "",
            "Priority of the real-time policy SCHED_FIFO, 1 to 99; 0: the system's default policy. What the system refuses is told, and the program goes on";
        cpu_affinity: Vec<u64>, Kind::Wholes(Len::From(0, 64), 0, 1023), "",
            "Numbers of the CPUs to run on; none: all that the system gives";
        lock_memory: bool, Kind::Flag, "",
            "Keep all memory from being swapped out";
    }
    log: Log = "log", "Columns of a log file for `thetabus identify`" {
        time: Option<String>, Kind::Label, "",
            "Column of the time; without it rows follow each other at plant.sample_period_s";
        time_unit: String, Kind::Choice(&["s", "ms", "us", "ns"]), "",
            "Unit of the time column";
        q: Vec<String>, Kind::Words, "",
            "Columns of the positions, one per joint";
        position_unit: String, Kind::Choice(&["rad", "deg", "turn", "m", "mm", "um"]), "",
            "Unit of the position columns: of length where the model moves along a line, else of angle";
        input: Vec<String>, Kind::Words, "",
            "Columns of the inputs, one per joint";
        input_unit: f64, Kind::Real(FINITE), "",
            "One unit of the input columns in the model's unit, 0.001 for millivolts; negative where a positive input drives the machine backwards, not 0";
        setpoint: Vec<String>, Kind::Words, "",
            "Columns of the setpoints, one per joint in the unit of the positions, or none";
    }
    monitor: Monitor = "monitor", "What is kept of a run" {
        out_dir: Option<String>, Kind::Path, "",
            "Directory for estimates.csv and summary.json, which must not hold files yet; not set: `run` takes thetabus-out/TIME, `monitor` writes none";
        record_file_mib: u64, Kind::Whole(0, 1_048_576), "MiB",
            "A recording goes on in a new file when one has this size; 0 for no limit";
        record_files: u64, Kind::Whole(0, 1_000_000), "",
            "Files of a recording that are kept, the oldest making room for a new one; 0 for all";
        record_joint_states: bool, Kind::Flag, "",
            "Samples stand in recordings as sensor_msgs/msg/JointState, too, on the topic /ROBOT/joint_states, which tools of ROS 2 know";
    }
    control: Control = "controller", "The controller that uses estimates: feed-forward beside the machine's own loop" {
        feed_forward: String, Kind::Choice(&["none", "fixed", "adaptive"]), "",
            "adaptive: from estimates that may be used. fixed: from controller.theta throughout. none: no controller; `run` starts one otherwise";
        theta: Vec<f64>, parameters(FINITE), "the parameters' own",
            "Parameters that the controller begins with; none: estimator.theta_start";
        max_std: f64, Kind::Real(Interval::closed(1e-6, 10.0)), "",
            "Largest standard deviation of a parameter that is taken, as a share of it";
        blend_s: f64, Kind::Real(Interval::closed(1e-3, 1e3)), "s",
            "Time in which a parameter may move by its own size: a new estimate never steps the input";
        silence_s: f64, Kind::Real(Interval::closed(0.1, 1e6)), "s",
            "An identifier that has not been heard for so long is silent; the last estimates hold";
        deadline_s: f64, Kind::Real(Interval::closed(1e-3, 10.0)), "s",
            "Stream time for which a command holds; without a newer one the machine goes on with its own loop alone";
        input_limit: Vec<f64>, equations(POSITIVE.or_infinite()), "unit of the input",
            "Most feed-forward of each joint, either sign; none: no limit";
        derivative_gain: Vec<f64>, equations(NOT_NEGATIVE), "input per rad/s or m/s",
            "Gain Kd of each joint's own loop, which brakes the wanted velocity, too; none: that of plant.controller for an arm, else 0";
    }
    checkpoint: Checkpoint = "checkpoint", "What the identifier keeps, so that its next start can be warm" {
        dir: Option<String>, Kind::Path, "",
            "Directory of the checkpoints, which must exist; not set: none are written, and --warm is refused";
        period_s: f64, Kind::Real(Interval::closed(0.1, 1e6)), "s",
            "Time from one checkpoint to the next; another is written at the end, and on `thetabus ctl save`";
    }
}
