//! Messages of strangers: of another schema, or of a second publisher besides the identifier. They
//! are ignored, counted, and reported once.
//!
//! Topics of the identifier admit a second publisher, because bridges need one. A reader of both
//! would mix two sources, so it listens to the process that holds the identifier's role or, if none
//! does, to the first publisher until that has ended.

use super::lock::role_holder;
use super::membership::exists;
use super::{Bus, BusError, Latched, PubSubService, Role, Topic};
use crate::messages::SCHEMA_VERSION;
use iceoryx2::prelude::{CallbackProgression, ipc};
use iceoryx2::service::port_factory::PortFactory as _;
use std::time::{Duration, Instant};

/// How long a publisher is remembered as a stranger.
const REMEMBERED: Duration = Duration::from_millis(100);

/// Counts messages of another schema.
#[derive(Debug, Default)]
pub(super) struct ForeignSchemas {
    count: u64,
}

impl ForeignSchemas {
    /// True for a message of our schema; reports the first other one.
    pub(super) fn admits(&mut self, topic: Topic, found: u32) -> bool {
        if found == SCHEMA_VERSION {
            return true;
        }
        if self.count == 0 {
            let error = BusError::Schema {
                topic,
                expected: SCHEMA_VERSION,
                found,
            };
            tracing::warn!("{error}; such messages are left out");
        }
        self.count = self.count.saturating_add(1);
        false
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }
}

/// The publisher to which a reader of one of the identifier's topics listens.
#[derive(Debug, Default)]
pub(super) struct Speaker {
    current: Option<u128>,
    stranger: Option<(u128, Instant)>,
    logged: Option<u128>,
    count: u64,
}

/// A publisher and its process.
type Port = (u128, Option<i32>);

impl Speaker {
    /// True for a message of that publisher; reports the first one of a stranger.
    pub(super) fn admits<T: Latched>(&mut self, bus: &Bus, service: &PubSubService<T>, publisher: u128) -> bool {
        if self.current == Some(publisher) {
            return true;
        }
        let known = self
            .stranger
            .is_some_and(|(stranger, at)| stranger == publisher && at.elapsed() < REMEMBERED);
        if !known {
            let ports = ports(service);
            let holder = role_holder(bus.domain(), bus.robot(), Role::Identifier);
            match choose(&ports, holder, self.current, publisher) {
                None => {
                    (self.current, self.stranger) = (Some(publisher), None);
                    return true;
                }
                Some((_, pid)) => {
                    self.stranger = Some((publisher, Instant::now()));
                    self.tell(T::TOPIC, &ports, publisher, pid);
                }
            }
        }
        self.count = self.count.saturating_add(1);
        false
    }

    fn tell(&mut self, topic: Topic, ports: &[Port], publisher: u128, listened_to: Option<i32>) {
        if self.logged == Some(publisher) {
            return;
        }
        self.logged = Some(publisher);
        let name = |pid: Option<i32>| pid.map_or("unknown".to_owned(), |pid| pid.to_string());
        let stranger = ports.iter().find(|(id, _)| *id == publisher).and_then(|(_, pid)| *pid);
        tracing::warn!(
            "topic {topic}: process {} publishes beside the identifier, process {}; its messages are left out",
            name(stranger),
            name(listened_to)
        );
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }
}

/// The publisher to listen to instead of `publisher`; `None` if it is this one.
fn choose(ports: &[Port], holder: Option<i32>, current: Option<u128>, publisher: u128) -> Option<Port> {
    let of_holder = |port: &&Port| holder.is_some() && port.1 == holder;
    if ports.iter().any(|port| port.0 == publisher && of_holder(&port)) {
        return None;
    }
    let instead = ports.iter().find(of_holder);
    instead
        .or_else(|| ports.iter().find(|port| Some(port.0) == current))
        .copied()
}

/// The publishers of a topic whose processes are alive, as far as visible.
fn ports<T: Latched>(service: &PubSubService<T>) -> Vec<Port> {
    let mut ports = Vec::new();
    service.dynamic_config().list_publishers(|details| {
        let pid = details.node_id.pid::<ipc::Service>().ok().map(|pid| pid.value());
        if pid.is_none_or(exists) {
            ports.push((details.publisher_id.value(), pid));
        }
        CallbackProgression::Continue
    });
    ports
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_identifier_is_listened_to_and_without_one_the_first_publisher_until_it_has_gone() {
        const IDENTIFIER: Port = (1, Some(100));
        const OTHER: Port = (2, Some(200));
        const THIRD: Port = (3, Some(300));
        let cases: [(&[Port], Option<i32>, Option<u128>, u128, Option<Port>); 9] = [
            // the identifier, in any starting order
            (&[IDENTIFIER, OTHER], Some(100), None, 1, None),
            (&[IDENTIFIER, OTHER], Some(100), Some(2), 1, None),
            (&[IDENTIFIER, OTHER], Some(100), None, 2, Some(IDENTIFIER)),
            (&[IDENTIFIER, OTHER], Some(100), Some(1), 2, Some(IDENTIFIER)),
            // one that published and left immediately
            (&[IDENTIFIER], Some(100), Some(1), 2, Some(IDENTIFIER)),
            // the role is free, or its holder does not publish here
            (&[OTHER], None, None, 2, None),
            (&[OTHER, THIRD], Some(100), Some(2), 3, Some(OTHER)),
            // the first one has ended
            (&[THIRD], None, Some(2), 3, None),
            // messages left in the queue by a publisher that has ended
            (&[], None, None, 2, None),
        ];
        for (i, (ports, holder, current, publisher, instead)) in cases.into_iter().enumerate() {
            assert_eq!(choose(ports, holder, current, publisher), instead, "case {i}");
        }
    }
}
