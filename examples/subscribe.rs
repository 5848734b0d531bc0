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
use thetabus::messages::{Estimate, ParameterNames, State};
use thetabus::model::Manipulator;
use thetabus::node::monitor::seconds;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let domain = Domain::new(&arguments.next().unwrap_or("default".into()))?;
    let robot = arguments.next().unwrap_or("arm".into());
    let bus = Bus::join(&domain, &robot, "subscribe_example")?;
    // The example is about the arm; of another model `thetabus ctl describe` tells the names.
    let names = ParameterNames::of(&Manipulator::default());
    let mut estimates = Subscriber::<Estimate>::new(&bus)?;
    loop {
        // Sleeps until the identifier publishes; the limit lets the subscriber meet an identifier that starts later.
        estimates.wait(Duration::from_millis(100))?;
        estimates.drain(|estimate| {
            if !names.fit(estimate) {
                println!("block {}: of another model than the arm", estimate.block);
                return;
            }
            let state = State::from_wire(estimate.state).map_or("unknown", State::name);
            print!(
                "block {} at {:.3} s, {state}:",
                estimate.block,
                seconds(estimate.t_last_ns)
            );
            // A controller takes over only what may be used.
            for name in names.as_slice() {
                if let Some(parameter) = estimate.usable(&names, name) {
                    print!("  {name} = {:.6} ± {:.1e}", parameter.value, parameter.std);
                }
            }
            println!();
        })?;
    }
}
