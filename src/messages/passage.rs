//! What may happen to a sample between machine and topic.

/// What becomes of a sample on its way to the topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Passage {
    /// It never arrives.
    pub lost: bool,
    /// It is sent so much later than its time \[ns\].
    pub late_ns: u64,
}

impl Passage {
    /// Lost or on time.
    pub fn lost_if(lost: bool) -> Self {
        Self { lost, late_ns: 0 }
    }
}
