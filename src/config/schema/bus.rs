//! Section `[bus]`: topics and delivery.

use super::super::choice::choices;
use super::super::kind::{Interval, Kind};
use super::table::{choice, table};

choices! {
    /// How samples are delivered.
    Delivery {
        /// Lockstep for a simulation at full speed, else realtime.
        Auto = "auto",
        /// The plant never waits; a late consumer loses the oldest samples.
        Realtime = "realtime",
        /// The plant waits for its consumers; nothing is lost.
        Lockstep = "lockstep",
    }
}

table! {
    /// Section `[bus]`.
    Bus {
        robot: String = "arm".to_owned(), Kind::Name, "",
            "Name of the machine; the topics are thetabus/ROBOT/sample, estimate, status";
        domain: String = "default".to_owned(), Kind::Name, "",
            "Isolates whole runs from each other; programs of one run name the same domain";
        delivery: Delivery = Delivery::Auto, choice::<Delivery>(), "",
            "realtime: the plant never waits, a late consumer loses the oldest samples. lockstep: the plant waits, nothing is lost. auto: lockstep if plant.speed is \"max\", else realtime";
        lockstep_consumers: u64 = 1, Kind::Whole(0, 64), "",
            "Consumers of samples that must be attached before a lockstep run starts; `run` sets it";
        lockstep_limit_s: f64 = 10.0, Kind::Real(Interval::closed(0.1, 3600.0)), "s",
            "Longest time that a lockstep run waits for its consumers, or for one of them that is stuck, which is then cut off";
        sample_buffer: u64 = 4096, Kind::Whole(256, 65536), "",
            "Samples that a consumer of a realtime run may be behind before it loses the oldest; the plant takes about 500 bytes of shared memory for each sample and consumer, so sample_buffer times max_sample_subscribers times 500 bytes";
        max_sample_subscribers: u64 = 16, Kind::Whole(1, 64), "",
            "Programs that can receive samples at a time: identifiers, recorders, your own. Set by the program that creates the topic: the plant";
        max_estimate_subscribers: u64 = 32, Kind::Whole(2, 128), "",
            "Programs that can receive estimates at a time, and status, journal and description. Set by the program that creates the topic: the first one to start";
        max_programs: u64 = 64, Kind::Whole(4, 256), "",
            "Programs that can have a topic open at a time, publishers included; at least as many as the subscribers";
    }
}
