//! A process's membership in a domain, and the services it opens there.

use super::domain::check_name;
use super::membership::Membership;
use super::orphans;
use super::topic::{control, latched, sample};
use super::{BusError, ControlService, Domain, EventService, ICEORYX2_VERSION, Latched, PubSubService, Topic, wiped};
use crate::messages::{Header, Request, Response, Sample};
use iceoryx2::prelude::{
    Config, LogLevel, MessagingPattern, NodeBuilder, NodeName, Service, ServiceName, SignalHandlingMode, ipc,
    set_log_level_from_env_or,
};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{RequestResponseOpenError, RequestResponseOpenOrCreateError};
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use std::fmt;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Time limit for retries while another process is busy, and the pause between attempts.
const PATIENCE: Duration = Duration::from_secs(4);
const PAUSE: Duration = Duration::from_millis(50);

/// This process in a domain, for one robot. Cheap to clone; belongs to one thread.
#[derive(Clone)]
pub struct Bus(Rc<Inner>);

struct Inner {
    membership: Rc<Membership>,
    domain: Domain,
    robot: String,
    config: Config,
}

impl fmt::Debug for Bus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Bus")
            .field("domain", &self.0.domain.name())
            .field("robot", &self.0.robot)
            .finish_non_exhaustive()
    }
}

impl Bus {
    /// Joins a domain; `name` identifies this program to others. Cleans up resources of dead
    /// processes.
    ///
    /// # Errors
    /// If the robot's name is invalid, the domain's directory cannot be used, another user owns its
    /// objects, or a time limit passes.
    pub fn join(domain: &Domain, robot: &str, name: &str) -> Result<Self, BusError> {
        check_name("robot", robot)?;
        // iceoryx2's messages about retries and missing files are not useful to users; ours name
        // robot, domain and topic.
        set_log_level_from_env_or(LogLevel::Error);
        domain.create_root()?;
        let config = domain.config()?;
        let node_name = NodeName::new(name).map_err(|e| BusError::Join {
            domain: domain.name().into(),
            root: domain.root().into(),
            cause: e.to_string(),
        })?;
        let node_config = config.clone();
        let membership = Membership::new(domain, &config, move || {
            NodeBuilder::new()
                .name(&node_name)
                .config(&node_config)
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .create::<ipc::Service>()
        })?;
        Ok(Self(Rc::new(Inner {
            membership: Rc::new(membership),
            domain: domain.clone(),
            robot: robot.into(),
            config,
        })))
    }

    /// The same process for another robot of the domain.
    ///
    /// # Errors
    /// If the name is invalid.
    pub fn for_robot(&self, robot: &str) -> Result<Self, BusError> {
        check_name("robot", robot)?;
        Ok(Self(Rc::new(Inner {
            membership: self.0.membership.clone(),
            domain: self.0.domain.clone(),
            robot: robot.into(),
            config: self.0.config.clone(),
        })))
    }

    /// The domain.
    pub fn domain(&self) -> &Domain {
        &self.0.domain
    }

    /// The robot.
    pub fn robot(&self) -> &str {
        &self.0.robot
    }

    /// Frees the resources of dead processes in this domain; returns the number of processes.
    pub fn clean_up_dead(&self) -> u64 {
        self.0.membership.node.try_cleanup_dead_nodes().cleanups
    }

    pub(super) fn topic_error(&self, topic: Topic, problem: impl Into<String>) -> BusError {
        BusError::Topic {
            topic,
            robot: self.0.robot.clone(),
            domain: self.0.domain.name().into(),
            problem: problem.into(),
        }
    }

    pub(super) fn service_name(&self, topic: Topic) -> Result<ServiceName, BusError> {
        ServiceName::new(&format!("thetabus/{}/{topic}", self.0.robot))
            .map_err(|e| self.topic_error(topic, e.to_string()))
    }

    /// The event service that wakes a topic's consumers; the first process creates it.
    pub(super) fn event(&self, topic: Topic) -> Result<EventService, BusError> {
        self.event_named(topic, &self.service_name(topic)?)
    }

    /// The event service by which a reader acknowledges messages.
    pub(super) fn receipts(&self, topic: Topic) -> Result<EventService, BusError> {
        let name = ServiceName::new(&format!("thetabus/{}/{topic}/receipts", self.0.robot))
            .map_err(|e| self.topic_error(topic, e.to_string()))?;
        self.event_named(topic, &name)
    }

    fn event_named(&self, topic: Topic, name: &ServiceName) -> Result<EventService, BusError> {
        let programs = self.domain().limits().programs;
        let (nodes, notifiers) = match topic {
            Topic::Control => (control::MAX_NODES, control::MAX_CLIENTS),
            _ => (programs, 2),
        };
        let builder = || self.0.membership.node.service_builder(name).event();
        self.persist(
            || match builder().open() {
                Err(EventOpenError::DoesNotExist) => builder()
                    .max_notifiers(notifiers)
                    .max_listeners(nodes)
                    .max_nodes(nodes)
                    .open_or_create(),
                opened => opened.map_err(EventOpenOrCreateError::EventOpenError),
            },
            |e| {
                matches!(
                    e,
                    EventOpenOrCreateError::SystemInFlux
                        | EventOpenOrCreateError::EventOpenError(
                            EventOpenError::Interrupt
                                | EventOpenError::HangsInCreation
                                | EventOpenError::IsMarkedForDestruction
                                | EventOpenError::DoesNotSupportRequestedAmountOfNotifiers
                                | EventOpenError::DoesNotSupportRequestedAmountOfListeners
                                | EventOpenError::DoesNotSupportRequestedAmountOfNodes
                        )
                        | EventOpenOrCreateError::EventCreateError(
                            EventCreateError::Interrupt | EventCreateError::IsBeingCreatedByAnotherInstance
                        )
                )
            },
        )
        .map_err(|e| {
            self.topic_error(
                topic,
                format!("an event service of it cannot be opened: {e:?}; {}", self.advice()),
            )
        })
    }

    /// `estimate`, `status`, `description` or `journal`; the first process creates it with its
    /// [`Limits`](super::Limits), and later ones use it as it is.
    pub(super) fn latched<T: Latched>(&self) -> Result<PubSubService<T>, BusError> {
        let name = self.service_name(T::TOPIC)?;
        let limits = self.domain().limits();
        let builder = || {
            let service = self.0.membership.node.service_builder(&name);
            service
                .publish_subscribe::<T>()
                .user_header::<Header>()
                .enable_safe_overflow(true)
        };
        self.persist(
            || match builder().open() {
                Err(PublishSubscribeOpenError::DoesNotExist) => builder()
                    .subscriber_max_buffer_size(T::BUFFER)
                    .subscriber_max_borrowed_samples(latched::MAX_BORROWED)
                    .history_size(T::HISTORY)
                    .max_publishers(latched::MAX_PUBLISHERS)
                    .max_subscribers(limits.estimate_subscribers)
                    .max_nodes(limits.programs)
                    .open_or_create(),
                opened => opened.map_err(PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError),
            },
            |e| in_flux(e) || has_other_limits(e),
        )
        .map_err(|e| self.pub_sub_error::<T>(T::TOPIC, &e))
    }

    /// `sample`, opened by its publisher. Consumers of an earlier publisher with another delivery
    /// mode release the service once they notice that the publisher has ended, so a mismatch is
    /// retried.
    pub(super) fn create_sample(&self, overflow: bool, buffer: usize) -> Result<PubSubService<Sample>, BusError> {
        let name = self.service_name(Topic::Sample)?;
        let limits = self.domain().limits();
        // In lockstep no required consumer joins later.
        let history = if overflow { sample::HISTORY.min(buffer) } else { 0 };
        self.persist(
            || {
                self.0
                    .membership
                    .node
                    .service_builder(&name)
                    .publish_subscribe::<Sample>()
                    .user_header::<Header>()
                    .enable_safe_overflow(overflow)
                    .subscriber_max_buffer_size(buffer)
                    .subscriber_max_borrowed_samples(sample::MAX_BORROWED)
                    .history_size(history)
                    .max_publishers(sample::MAX_PUBLISHERS)
                    .max_subscribers(limits.sample_subscribers)
                    .max_nodes(limits.programs)
                    .open_or_create()
            },
            |e| {
                in_flux(e)
                    || has_other_limits(e)
                    || matches!(
                        e,
                        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
                            PublishSubscribeOpenError::IncompatibleOverflowBehavior
                                | PublishSubscribeOpenError::DoesNotSupportRequestedMinBufferSize
                                | PublishSubscribeOpenError::DoesNotSupportRequestedMinHistorySize
                        )
                    )
            },
        )
        .map_err(|e| self.pub_sub_error::<Sample>(Topic::Sample, &e))
    }

    /// `sample`, opened by its consumers: `None` until a publisher has created it.
    pub(super) fn open_sample(&self) -> Result<Option<PubSubService<Sample>>, BusError> {
        let name = self.service_name(Topic::Sample)?;
        let opened = self
            .0
            .membership
            .node
            .service_builder(&name)
            .publish_subscribe::<Sample>()
            .user_header::<Header>()
            .open();
        match opened {
            Ok(service) => Ok(Some(service)),
            Err(PublishSubscribeOpenError::DoesNotExist | PublishSubscribeOpenError::Interrupt) => Ok(None),
            Err(PublishSubscribeOpenError::HangsInCreation | PublishSubscribeOpenError::IsMarkedForDestruction) => {
                orphans::sweep(self.domain());
                Ok(None)
            }
            Err(e) => Err(self.pub_sub_error::<Sample>(
                Topic::Sample,
                &PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(e),
            )),
        }
    }

    /// Plain services of iceoryx2, with its own defaults except for the message; the first process
    /// creates them.
    pub(super) fn bare(&self, name: &str) -> Result<(PubSubService<Sample>, EventService), BusError> {
        let failed = |e: &dyn fmt::Debug| self.topic_error(Topic::Sample, format!("{name} cannot be opened: {e:?}"));
        let name = ServiceName::new(&format!("thetabus/{}/{name}", self.0.robot)).map_err(|e| failed(&e))?;
        let node = &self.0.membership.node;
        let messages = node
            .service_builder(&name)
            .publish_subscribe::<Sample>()
            .user_header::<Header>();
        let messages = messages.open_or_create().map_err(|e| failed(&e))?;
        let events = node
            .service_builder(&name)
            .event()
            .open_or_create()
            .map_err(|e| failed(&e))?;
        Ok((messages, events))
    }

    /// `control`, created by its server; the leftover of a killed server is reused.
    pub(super) fn create_control(&self) -> Result<ControlService, BusError> {
        let name = self.service_name(Topic::Control)?;
        self.persist(
            || self.control_builder(&name).open_or_create(),
            |e| {
                matches!(
                    e,
                    RequestResponseOpenOrCreateError::SystemInFlux
                        | RequestResponseOpenOrCreateError::RequestResponseOpenError(
                            RequestResponseOpenError::Interrupt
                                | RequestResponseOpenError::HangsInCreation
                                | RequestResponseOpenError::IsMarkedForDestruction
                        )
                )
            },
        )
        .map_err(|e| self.topic_error(Topic::Control, format!("cannot be opened: {e:?}; {}", self.advice())))
    }

    /// `control`, opened by a client: `None` while there is no server.
    pub(super) fn open_control(&self) -> Result<Option<ControlService>, BusError> {
        let name = self.service_name(Topic::Control)?;
        let opened = self.persist(
            || self.control_builder(&name).open(),
            |e| {
                matches!(
                    e,
                    RequestResponseOpenError::Interrupt | RequestResponseOpenError::HangsInCreation
                )
            },
        );
        match opened {
            Ok(service) => Ok(Some(service)),
            Err(RequestResponseOpenError::DoesNotExist | RequestResponseOpenError::IsMarkedForDestruction) => Ok(None),
            Err(RequestResponseOpenError::ExceedsMaxNumberOfNodes) => {
                Err(self.topic_error(Topic::Control, control::FULL.to_owned()))
            }
            Err(e) => Err(self.topic_error(Topic::Control, format!("cannot be opened: {e:?}; {}", self.advice()))),
        }
    }

    fn control_builder(
        &self,
        name: &ServiceName,
    ) -> iceoryx2::service::builder::request_response::Builder<Request, (), Response, (), ipc::Service> {
        self.0
            .membership
            .node
            .service_builder(name)
            .request_response::<Request, Response>()
            .max_servers(1)
            .max_clients(control::MAX_CLIENTS)
            .max_active_requests_per_client(1)
            .max_response_buffer_size(1)
            .max_nodes(control::MAX_NODES)
    }

    /// Retries while the failure indicates that another process is doing the same, or was killed
    /// while doing it.
    fn persist<T, E>(&self, mut attempt: impl FnMut() -> Result<T, E>, passing: impl Fn(&E) -> bool) -> Result<T, E> {
        let start = Instant::now();
        loop {
            match attempt() {
                Err(e) if passing(&e) && start.elapsed() < PATIENCE => {
                    orphans::sweep(self.domain());
                    std::thread::sleep(PAUSE);
                }
                done => return done,
            }
        }
    }

    /// What to do about a service that cannot be opened for no reason of its own.
    fn advice(&self) -> String {
        wiped::advice(self.domain()).unwrap_or_else(|| {
            format!(
                "all programs of a domain need iceoryx2 {ICEORYX2_VERSION} and the same user; another --domain starts afresh"
            )
        })
    }

    /// Creates a topic with messages of a wrong type.
    #[cfg(test)]
    pub(super) fn occupy(&self, topic: Topic) -> Result<PubSubService<crate::messages::Status>, BusError> {
        let name = self.service_name(topic)?;
        let service = self
            .0
            .membership
            .node
            .service_builder(&name)
            .publish_subscribe::<crate::messages::Status>();
        service
            .user_header::<Header>()
            .create()
            .map_err(|e| self.topic_error(topic, format!("{e:?}")))
    }

    fn pub_sub_error<T>(&self, topic: Topic, error: &PublishSubscribeOpenOrCreateError) -> BusError
    where
        T: iceoryx2::prelude::ZeroCopySend,
    {
        use PublishSubscribeOpenError as Open;
        let found = self.found(topic);
        let problem = match error {
            PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(open) => match open {
                Open::IncompatibleTypes => {
                    let expected = TypeDetail::new::<T>(TypeVariant::FixedSize);
                    format!(
                        "expected messages {} of {} bytes with ThetabusHeaderV3, found {}; build both programs from the same version of \
                         thetabus",
                        expected.type_name(),
                        expected.size(),
                        found.types
                    )
                }
                Open::IncompatibleOverflowBehavior | Open::DoesNotSupportRequestedMinBufferSize => format!(
                    "another program holds it with {}; stop that program, or use its delivery mode",
                    found.qos
                ),
                Open::VersionMismatch | Open::ServiceInCorruptedState => format!(
                    "it is damaged or was made by another version of iceoryx2 than {ICEORYX2_VERSION} ({open:?}); stop those \
                     programs and use the same version, or use another --domain"
                ),
                Open::InsufficientPermissions => "it belongs to another user; use another --domain".into(),
                Open::ExceedsMaxNumberOfNodes => "as many programs use it as it was made for: stop one of them, or raise bus.max_programs and start the programs of this robot anew".into(),
                other => format!("cannot be opened ({other:?}); {}", self.advice()),
            },
            PublishSubscribeOpenOrCreateError::PublishSubscribeCreateError(create) => {
                format!("cannot be created ({create:?}); {}", self.advice())
            }
            PublishSubscribeOpenOrCreateError::SystemInFlux => {
                format!("other programs keep creating and removing it; {}", self.advice())
            }
        };
        self.topic_error(topic, problem)
    }

    /// Description of a service that does not fit.
    fn found(&self, topic: Topic) -> Found {
        let unknown = || Found {
            types: "something else".into(),
            qos: "other settings".into(),
        };
        let Ok(name) = self.service_name(topic) else {
            return unknown();
        };
        match ipc::Service::details(&name, &self.0.config, MessagingPattern::PublishSubscribe) {
            Ok(Some(details)) => {
                let config = details.static_details.publish_subscribe();
                let types = config.message_type_details();
                Found {
                    types: format!(
                        "{} of {} bytes with {}",
                        types.payload.type_name(),
                        types.payload.size(),
                        types.user_header.type_name()
                    ),
                    qos: format!(
                        "overflow {} and a buffer of {}",
                        if config.has_safe_overflow() { "on" } else { "off" },
                        config.subscriber_max_buffer_size()
                    ),
                }
            }
            _ => unknown(),
        }
    }
}

struct Found {
    types: String,
    qos: String,
}

fn in_flux(error: &PublishSubscribeOpenOrCreateError) -> bool {
    matches!(
        error,
        PublishSubscribeOpenOrCreateError::SystemInFlux
            | PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
                PublishSubscribeOpenError::Interrupt
                    | PublishSubscribeOpenError::HangsInCreation
                    | PublishSubscribeOpenError::IsMarkedForDestruction
            )
            | PublishSubscribeOpenOrCreateError::PublishSubscribeCreateError(
                PublishSubscribeCreateError::Interrupt
                    | PublishSubscribeCreateError::IsBeingCreatedByAnotherInstance
                    | PublishSubscribeCreateError::HangsInCreation
            )
    )
}

/// True if the topic was created with other limits. The next attempt then uses the existing topic
/// as it is.
fn has_other_limits(error: &PublishSubscribeOpenOrCreateError) -> bool {
    matches!(
        error,
        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
            PublishSubscribeOpenError::DoesNotSupportRequestedAmountOfSubscribers
                | PublishSubscribeOpenError::DoesNotSupportRequestedAmountOfNodes
        )
    )
}
