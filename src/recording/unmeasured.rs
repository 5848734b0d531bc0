//! What a machine does not measure is NaN in recordings, where a 0 would be taken for a value; on
//! the bus it is anything and mostly 0.

use crate::messages::{SIGNALS, Sample};

/// The sample as a recording has it.
pub(super) fn marked(sample: &Sample) -> Sample {
    let mut marked = *sample;
    fill(&mut marked, f64::NAN);
    marked
}

/// Makes it what it was on the bus, with 0 for what is not measured.
pub(super) fn clear(sample: &mut Sample) {
    fill(sample, 0.0);
}

#[inline]
fn fill(sample: &mut Sample, value: f64) {
    let measured = sample.signals;
    for (signal, values) in SIGNALS.iter().zip(sample.arrays_mut()) {
        if measured & signal.flag == 0 {
            values.fill(value);
        }
    }
}
