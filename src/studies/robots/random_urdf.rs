//! The URDF of a robot drawn at random.

use crate::studies::draw::Draw;
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;

/// Standard gravity \[m/s²\].
const GRAVITY: f64 = 9.81;
/// Acceleration that the drives are sized for \[m/s² or rad/s²\].
const ACCELERATION: f64 = 4.0;

/// A chain of one to seven joints: a seventh of them prismatic, axes and frames square to each
/// other or of any direction, bodies that are boxes of 0.3 to 60 kg, and drives that carry them.
pub(super) fn random_urdf(draw: &mut Draw) -> String {
    let joints = draw.of(&[1, 2, 2, 3, 3, 4, 5, 6, 6, 7]);
    let (heaviest, size, decay) = (draw.log(0.3, 60.0), draw.log(0.1, 0.6), draw.between(0.5, 1.0));
    let masses: Vec<f64> = (0..=joints)
        .map(|i| heaviest * decay.powi(i) * draw.log(0.5, 2.0))
        .collect();
    let mut text = String::from("<robot name=\"random\">\n");
    for (i, mass) in masses.iter().enumerate() {
        text.push_str(&link(i, *mass, size, draw));
    }
    for i in 0..joints as usize {
        let carried: f64 = masses[i + 1..].iter().sum();
        let reach = size * (1.0 + 0.5 * (joints as usize - i) as f64);
        text.push_str(&joint(i, (carried, reach), size, draw));
    }
    text.push_str("</robot>\n");
    text
}

/// A box of this mass, whose centre is off the joint.
fn link(i: usize, mass: f64, size: f64, draw: &mut Draw) -> String {
    let edges: [f64; 3] = std::array::from_fn(|_| size * draw.log(0.1, 0.8));
    let [x, y, z]: [f64; 3] = std::array::from_fn(|_| match draw.chance(0.3) {
        true => 0.0,
        false => size * draw.between(-0.4, 0.4),
    });
    let inertia = |a: usize, b: usize| mass * (edges[a].powi(2) + edges[b].powi(2)) / 12.0;
    let (xx, yy, zz) = (inertia(1, 2), inertia(0, 2), inertia(0, 1));
    let mut text = format!("<link name=\"l{i}\"><inertial><origin xyz=\"{x} {y} {z}\"/><mass value=\"{mass}\"/>");
    let _ = writeln!(
        text,
        "<inertia ixx=\"{xx}\" iyy=\"{yy}\" izz=\"{zz}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>"
    );
    text
}

/// The joint behind link `i`, which carries this mass over this reach.
fn joint(i: usize, (carried, reach): (f64, f64), size: f64, draw: &mut Draw) -> String {
    let turns = !draw.chance(0.15);
    let is_square = draw.chance(0.7);
    let [roll, pitch, yaw]: [f64; 3] = std::array::from_fn(|_| match is_square {
        true => FRAC_PI_2 * draw.of(&[-1.0, 0.0, 0.0, 1.0]),
        false => draw.between(-3.0, 3.0),
    });
    let [x, y, z]: [f64; 3] = std::array::from_fn(|_| match draw.chance(0.4) {
        true => 0.0,
        false => size * draw.between(-1.0, 1.0),
    });
    let axis = match draw.chance(0.8) {
        true => draw.of(&[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
        false => {
            let axis: [f64; 3] = [draw.between(0.5, 1.0), draw.between(-1.0, 1.0), draw.between(-1.0, 1.0)];
            let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
            axis.map(|x| x / length)
        }
    };
    let (kind, effort, speed, range) = match turns {
        true => (
            "revolute",
            carried * reach * (GRAVITY + ACCELERATION * reach) * draw.between(1.0, 2.0),
            draw.between(1.0, 4.0),
            draw.between(0.7, 3.0),
        ),
        false => (
            "prismatic",
            carried * (GRAVITY + ACCELERATION) * draw.between(1.5, 3.0),
            draw.between(0.3, 1.5),
            draw.between(0.1, 0.6),
        ),
    };
    let ([a, b, c], next) = (axis, i + 1);
    let mut text = format!(
        "<joint name=\"j{i}\" type=\"{kind}\"><parent link=\"l{i}\"/><child link=\"l{next}\"/>\
         <origin xyz=\"{x} {y} {z}\" rpy=\"{roll} {pitch} {yaw}\"/><axis xyz=\"{a} {b} {c}\"/>"
    );
    let _ = writeln!(
        text,
        "<limit lower=\"-{range}\" upper=\"{range}\" effort=\"{effort}\" velocity=\"{speed}\"/></joint>"
    );
    text
}
