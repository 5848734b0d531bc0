//! Topic `command`: from a controller to the machine.

use super::table::message;
use crate::model::MAX_JOINTS;
#[cfg(feature = "bus")]
use iceoryx2::prelude::ZeroCopySend;

message! {
    /// Topic `command`: the input that a controller adds to the machine's own loop in response to a
    /// sample.
    pub struct MachineCommand = "ThetabusCommandV3" {
        stream_id: u64, One, "", "stream_id of the sample that is answered; a command for another stream does not count";
        seq: u64, One, "", "seq of that sample; the command holds from the next one on";
        until_ns: u64, One, "ns", "Stream time at which the command expires; the machine then runs on its own loop alone";
        joints: u32, One, "", "Number of joints, 1 to 8";
        pad: u32, Padding, "", "Zero";
        feed_forward: [f64; MAX_JOINTS], Joint, "{input}", "Input that is added to what the machine's own loop gives";
    }
}
