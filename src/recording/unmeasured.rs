//! What a machine does not measure is NaN in recordings, where a 0 would be taken for a value; on
//! the bus it is anything and mostly 0.

use crate::messages::{Sample, signals};

/// The sample as a recording has it.
pub(super) fn marked(sample: &Sample) -> Sample {
    filled(sample, f64::NAN)
}

/// The sample as it was on the bus, with 0 for what is not measured.
pub(super) fn cleared(sample: &Sample) -> Sample {
    filled(sample, 0.0)
}

fn filled(sample: &Sample, value: f64) -> Sample {
    let mut filled = *sample;
    for (signal, values) in [
        (signals::Q, &mut filled.q),
        (signals::DQ, &mut filled.dq),
        (signals::DDQ, &mut filled.ddq),
        (signals::DDDQ, &mut filled.dddq),
        (signals::SETPOINT, &mut filled.setpoint),
        (signals::INPUT, &mut filled.input),
    ] {
        if sample.signals & signal == 0 {
            values.fill(value);
        }
    }
    filled
}
