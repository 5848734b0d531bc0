//! Identification inside your own program, without any bus: samples in, estimates out.
//!
//! ```text
//! cargo run --release --example in_process
//! ```
//!
//! The identifier node is the value that the identifier process runs: it validates samples, follows gaps, cuts blocks and gives
//! messages with deviations and flags. Here a simulated arm feeds it; a machine's own loop would do the same.

use thetabus::estimator::{BlockEstimator, EstimatorOptions};
use thetabus::messages::{Estimate, Sample, signals};
use thetabus::model::{Manipulator, Plant};
use thetabus::node::identifier::{IdentifierNode, IdentifierOptions};
use thetabus::node::monitor::seconds;
use thetabus::rows::{InputSource, PointwiseBlock, structure};
use thetabus::sim::{ArmSimulator, SimOptions};

const BLOCK_LEN: usize = 1900;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let plant = Manipulator::default();
    let start = vec![0.01, 0.01, 0.1, 0.1, 10.0, 0.01, 0.1, 10.0, 0.5];
    let estimator = BlockEstimator::new(
        structure(&plant),
        EstimatorOptions::recommended(start, plant.equations().len()),
    )?;
    let options = IdentifierOptions::new(
        BLOCK_LEN as u64,
        plant.joints(),
        signals::Q | signals::DQ | signals::DDQ | signals::DDDQ | signals::INPUT,
    );
    let rows = PointwiseBlock::new(plant, InputSource::Measured, BLOCK_LEN);
    let mut identifier = IdentifierNode::new(options, rows, estimator, None, std::process::id());

    // 60 s of the paper's arm; the payload jumps at 45 s.
    let arm = SimOptions {
        duration_s: 60.0,
        ..SimOptions::cedro2022()
    };
    for (seq, joints) in ArmSimulator::new(&arm)?.enumerate().take(arm.sample_count() as usize) {
        let seq = seq as u64;
        let sample = Sample::new(1, seq, seq * 1_000_000, plant.joints(), signals::ALL, &joints);
        identifier.on_sample(&sample, &mut |estimate: &Estimate| {
            let t_s = seconds(estimate.t_last_ns);
            let truth = arm.true_theta(t_s);
            // theta_7 holds the payload, theta_9 the length of the link that carries it.
            println!(
                "block {:>2}  {t_s:>6.3} s  theta_7 {:.6} (true {:.6})  theta_9 {:.6} (true {:.6})",
                estimate.block, estimate.theta[6], truth[6], estimate.theta[8], truth[8]
            );
        });
    }
    Ok(())
}
