//! Section `[model]` and those below it: the equations whose parameters are identified.

use super::super::kind::Kind;
use super::table::{FINITE, NOT_NEGATIVE, POSITIVE, choice, joints, table};
use crate::model::{DriveInput, Motion};
use crate::sim::SimOptions;

table! {
    /// Section `[model]`.
    Model where arm = SimOptions::cedro2022().arm; {
        kind: String = "manipulator".to_owned(), Kind::Name, "",
            "manipulator: the two-joint arm with DC motors, equations (24) to (27), parameters theta_1 to theta_9. servo_axis: mass, viscous_friction, coulomb_friction, offset of one axis. robot: an arm from its URDF, with the further sections that config/robots/six_axis.toml lists. Programs with models of their own accept those names, too; the first is their default";
        gravity_m_s2: f64 = arm.gravity_m_s2, Kind::Real(NOT_NEGATIVE), "m/s²",
            "Acceleration of gravity g in the equations";
        coulomb_friction: bool = false, Kind::Flag, "",
            "Whether the manipulator has Coulomb friction at both joints: parameters coulomb_friction_1 and coulomb_inductance_1 behind theta_5, coulomb_friction_2 and coulomb_inductance_2 behind theta_9; needs rows = \"projected\"";
        offset: bool = false, Kind::Flag, "",
            "Whether the manipulator has a constant torque at both joints: parameters offset_1 and offset_2, behind those of friction";
    }
}

table! {
    /// Section `[model.servo_axis]`.
    ServoAxisModel {
        motion: Motion = Motion::default(), choice::<Motion>(), "",
            "linear: positions in m, forces in N. rotary: positions in rad, torques in N m";
        input: DriveInput = DriveInput::default(), choice::<DriveInput>(), "",
            "What the drive's input is: control voltage [V], motor current [A], or force or torque itself [N or N m]";
        gain: f64 = 1.0, Kind::Real(FINITE), "N or N m per unit of input",
            "What the drive gives for one unit of input; 1 for a force or torque";
    }
}

table! {
    /// Section `[model.known]`.
    Known {
        length_1_m: Option<f64> = None, Kind::Real(POSITIVE), "m",
            "Length l1 of link 1";
        winding_resistance_ohm: Option<Vec<f64>> = None, joints(POSITIVE), "Ω",
            "Resistance R_w of each motor";
        torque_constant_n_m_per_a: Option<Vec<f64>> = None, joints(POSITIVE), "N m/A",
            "Torque constant k_m of each motor";
    }
}
