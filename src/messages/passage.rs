//! Faults of a sample's transport from the machine to the topic.

/// How a sample travels to the topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Passage {
    /// It never arrives.
    pub lost: bool,
    /// Delay of its sending after its time \[ns\].
    pub late_ns: u64,
}

impl Passage {
    /// Lost or on time.
    pub fn lost_if(lost: bool) -> Self {
        Self { lost, late_ns: 0 }
    }
}
