//! A machine of one's own on the bus, in place of the simulator: publish a sample every
//! millisecond.
//!
//! Here it is a pendulum, J = 2.5 kg m², d = 0.8 N m s/rad, w = 12 N m, pushed by a torque that is
//! held from sample to sample, its angle read from an encoder of 16 bits; `own_plant` identifies
//! it. On a real machine, read the drive where this one computes. Ctrl-C ends it.
//!
//! ```text
//! cargo run --release --example own_machine [SECONDS] [DOMAIN] [ROBOT]
//! ```

use std::f64::consts::TAU;
use std::time::{Duration, Instant};
use thetabus::bus::{Domain, Machine};
use thetabus::messages::signals;
use thetabus::model::JointSample;

const PERIOD: Duration = Duration::from_millis(1);

/// The pendulum's angle and speed, and what its drive reports.
struct Pendulum {
    q: f64,
    dq: f64,
}

impl Pendulum {
    fn sample(&mut self, t_s: f64) -> JointSample {
        let torque = 6.0 * (1.3 * t_s).sin() + 4.0 * (7.1 * t_s).sin() + 2.0 * (17.0 * t_s).cos();
        let count = TAU / 65536.0;
        let mut sample = JointSample::default();
        sample.q[0] = (self.q / count).round() * count;
        sample.input[0] = torque;
        // many small steps of the symplectic Euler method up to the next sample
        for _ in 0..100 {
            self.dq += 1e-5 * (torque - 0.8 * self.dq - 12.0 * self.q.sin()) / 2.5;
            self.q += 1e-5 * self.dq;
        }
        sample
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let seconds: f64 = arguments.next().as_deref().unwrap_or("30").parse()?;
    let domain = Domain::new(&arguments.next().unwrap_or("default".into()))?;
    let robot = arguments.next().unwrap_or("arm".into());
    let mut machine = Machine::open(&domain, &robot, 1)?;

    let mut pendulum = Pendulum { q: 0.3, dq: 0.0 };
    let (samples, start) = ((seconds * 1e3) as u64, Instant::now());
    for k in 0..samples {
        let t_ns = k * PERIOD.as_nanos() as u64;
        let sample = pendulum.sample(t_ns as f64 * 1e-9);
        std::thread::sleep((start + Duration::from_nanos(t_ns)).saturating_duration_since(Instant::now()));
        match k + 1 == samples {
            false => machine.publish(t_ns, signals::Q | signals::INPUT, &sample)?,
            true => machine.publish_last(t_ns, signals::Q | signals::INPUT, &sample)?,
        };
    }
    machine.close()?;
    Ok(())
}
