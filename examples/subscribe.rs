//! Another program's view of the estimates: what an adaptive controller or a dashboard would do.
//!
//! ```text
//! cargo run --release --example subscribe            # in one terminal
//! cargo run --release -- run --speed 1               # in another
//! ```
//!
//! Start order does not matter, and one that comes late gets the last estimate at once. Ctrl-C ends it. The optional arguments are the
//! domain and the robot.

use std::time::Duration;
use thetabus::bus::{Bus, Domain, Subscriber};
use thetabus::messages::{Estimate, State};
use thetabus::node::monitor::seconds;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let domain = Domain::new(&arguments.next().unwrap_or("default".into()))?;
    let robot = arguments.next().unwrap_or("arm".into());
    let bus = Bus::join(&domain, &robot, "subscribe_example")?;
    let mut estimates = Subscriber::<Estimate>::new(&bus)?;
    loop {
        // Sleeps until the identifier publishes; the limit lets the subscriber meet an identifier that starts later.
        estimates.wait(Duration::from_millis(100))?;
        estimates.drain(|estimate| {
            let theta = &estimate.theta[..estimate.params as usize];
            let state = State::from_wire(estimate.state).map_or("unknown", State::name);
            // A controller takes θ̂ over only where `use_ok` is 1.
            println!(
                "block {} at {:.3} s, {state}, use_ok {}: {theta:?}",
                estimate.block,
                seconds(estimate.t_last_ns),
                estimate.use_ok
            );
        })?;
    }
}
