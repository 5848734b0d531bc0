//! Another program's view of the estimates: what an adaptive controller or a dashboard would do.
//!
//! ```text
//! cargo run --release --example subscribe            # in one terminal
//! cargo run --release -- run --speed 1               # in another
//! ```
//!
//! Start order does not matter, and one that comes late gets the last estimate at once. Names and
//! units come from the identifier, so this serves any model. Ctrl-C ends it. The optional arguments
//! are the domain and the robot.

use std::time::Duration;
use thetabus::bus::{Bus, Domain, Subscriber};
use thetabus::messages::{Description, Estimate, ParameterNames, State};
use thetabus::node::monitor::seconds;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let domain = Domain::new(&arguments.next().unwrap_or("default".into()))?;
    let robot = arguments.next().unwrap_or("arm".into());
    let bus = Bus::join(&domain, &robot, "subscribe_example")?;
    let mut descriptions = Subscriber::<Description>::new(&bus)?;
    let mut estimates = Subscriber::<Estimate>::new(&bus)?;
    let (mut names, mut units) = (ParameterNames::default(), Vec::new());
    loop {
        // Sleeps until the identifier publishes; the limit lets the subscriber meet an identifier
        // that starts later.
        estimates.wait(Duration::from_millis(100))?;
        descriptions.drain(|description| {
            names = ParameterNames::described(description);
            units = description.parameters().iter().map(|p| p.unit().to_owned()).collect();
        })?;
        estimates.drain(|estimate| {
            let state = State::from_wire(estimate.state).map_or("unknown", State::name);
            print!(
                "block {} at {:.3} s, {state}:",
                estimate.block,
                seconds(estimate.t_last_ns)
            );
            // A controller takes over only what may be used.
            for (name, unit) in names.as_slice().iter().zip(&units) {
                if let Some(parameter) = estimate.usable(&names, name) {
                    print!("  {name} = {:.6} ± {:.1e} {unit}", parameter.value, parameter.std);
                }
            }
            println!();
        })?;
    }
}
