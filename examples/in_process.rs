//! Identification inside your own program, without any bus: samples in, estimates out.
//!
//! ```text
//! cargo run --release --example in_process
//! ```
//!
//! What is pushed here comes from a simulated arm, read by encoders of 16 bits; a machine's own
//! loop would do the same. The identifier is the value that the identifier process runs: it
//! validates samples, follows gaps, cuts blocks, and says what may be used.

use thetabus::identify::Identifier;
use thetabus::model::Manipulator;
use thetabus::node::monitor::seconds;
use thetabus::sim::{ArmSimulator, ControllerKind, SensorOptions, SimOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut identifier = Identifier::builder(Manipulator::default())
        .encoder(16, 0.05)
        .block_len(1900)
        .build()?;
    let names = identifier.names().clone();

    // 60 s of the paper's arm; the payload jumps at 45 s.
    let mut arm = SimOptions {
        duration_s: 60.0,
        sensors: SensorOptions::encoder(16, 0.05),
        ..SimOptions::cedro2022()
    };
    arm.controller.kind = ControllerKind::Sampled;
    for sample in ArmSimulator::new(&arm)?.take(arm.sample_count() as usize) {
        let Some(estimate) = identifier.push(&sample) else {
            continue;
        };
        let t_s = seconds(estimate.t_last_ns);
        let truth = arm.true_theta(t_s);
        // theta_7 holds the payload
        match estimate.usable(&names, "theta_7") {
            Some(theta_7) => println!(
                "{t_s:>6.3} s  theta_7 = {:.5} ± {:.5}, true {:.5}",
                theta_7.value, theta_7.std, truth[6]
            ),
            None => println!("{t_s:>6.3} s  theta_7 is not known well enough"),
        }
    }
    Ok(())
}
