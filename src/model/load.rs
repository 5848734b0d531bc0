//! A load at the flange of a robot, given by mass, centre of mass and, if known, the inertia about
//! it.

/// Density of the ball that represents a load of unknown shape \[kg/m³\]: aluminium and air.
const DENSITY: f64 = 2000.0;

/// Inertia of an aluminium ball about its centre \[kg m²\]; `mass` in kg, not below 0.
pub fn ball_inertia(mass: f64) -> f64 {
    let radius = (mass / DENSITY * 3.0 / (4.0 * std::f64::consts::PI)).cbrt();
    0.4 * mass * radius * radius
}

/// Ten parameters about the flange, in its axes: m, m c, then the inertia xx, xy, yy, xz, yz, zz.
///
/// `mass` in kg, the centre of mass c in m, the inertia about it in kg m² in the same order;
/// without one, that of a [ball](ball_inertia). Does not check whether a body can have these
/// values.
pub fn load_at_flange(mass: f64, center: [f64; 3], inertia: Option<[f64; 6]>) -> [f64; 10] {
    let [x, y, z] = center;
    let ball = ball_inertia(mass);
    let [xx, xy, yy, xz, yz, zz] = inertia.unwrap_or([ball, 0.0, ball, 0.0, 0.0, ball]);
    [
        mass,
        mass * x,
        mass * y,
        mass * z,
        xx + mass * (y * y + z * z),
        xy - mass * x * y,
        yy + mass * (x * x + z * z),
        xz - mass * x * z,
        yz - mass * y * z,
        zz + mass * (x * x + y * y),
    ]
}
