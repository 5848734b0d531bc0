//! Creates a monitor from an identifier's description.

use crate::messages::Description;
use crate::node::monitor::{Label, MonitorNode};

/// A monitor with the names and units of a description.
pub(super) fn monitor_of(description: &Description) -> MonitorNode {
    let parameters = description.parameters().iter().map(|p| Label::new(p.name(), p.unit()));
    let derived = description.derived().iter().map(|d| Label::new(d.name(), d.unit()));
    MonitorNode::new(parameters.collect(), derived.collect(), None).of_model(description.model_hash)
}
