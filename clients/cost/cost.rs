//! Processor time per message in Rust: `cost publish|read COUNT DOMAIN` prints nanoseconds. See
//! cost.py.

use std::time::Duration;
use thetabus::bus::{Bus, Delivery, Domain, Machine, SampleSubscriber};
use thetabus::messages::signals;
use thetabus::model::JointSample;

/// Time that this thread has run \[ns\], proc_pid_schedstat.
fn used_ns() -> u64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    text.split_whitespace()
        .next()
        .and_then(|first| first.parse().ok())
        .unwrap_or(0)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let (count, domain): (u64, _) = (arguments[2].parse()?, Domain::new(&arguments[3])?);
    let used = if arguments[1] == "publish" {
        let delivery = Delivery::Lockstep {
            consumers: 1,
            limit: Duration::from_secs(20),
        };
        let mut machine = Machine::delivering(&domain, "arm", 2, delivery)?;
        let begun = used_ns();
        for k in 0..count {
            let sample = JointSample {
                q: [1e-3 * k as f64; 8],
                ..JointSample::default()
            };
            machine.publish(k * 1_000_000, signals::Q | signals::INPUT, &sample)?;
        }
        let used = used_ns() - begun;
        machine.close()?;
        used
    } else {
        let bus = Bus::join(&domain, "arm", "cost")?;
        let mut samples = SampleSubscriber::new(&bus)?;
        let mut sum = 0.0;
        samples.next(Duration::MAX)?;
        let begun = used_ns();
        for _ in 1..count {
            sum += samples.next(Duration::MAX)?.map_or(0.0, |(sample, _)| sample.q[0]);
        }
        assert!(sum > 0.0);
        used_ns() - begun
    };
    println!("{}", used as f64 / count as f64);
    Ok(())
}
