//! What a machine does not measure is NaN in recordings, where a 0 would be taken for a value; on
//! the bus it is anything and mostly 0.

use crate::messages::{SIGNALS, Sample};

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
    for (signal, values) in SIGNALS.iter().zip(filled.arrays_mut()) {
        if sample.signals & signal.flag == 0 {
            values.fill(value);
        }
    }
    filled
}
