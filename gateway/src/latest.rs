//! The last messages of a robot, for whoever comes late.

use crate::keys;
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use thetabus::bus::Topic;
use zenoh::Wait;
use zenoh::query::Query;

/// As many entries of the journal as the bus keeps.
const JOURNAL: usize = 64;

/// A message with its envelope, as it was sent.
#[derive(Debug, Clone)]
struct Sent {
    payload: Vec<u8>,
    envelope: Vec<u8>,
}

/// The last message of each topic; of the journal the last 64.
#[derive(Debug, Default)]
pub struct Latest {
    topics: Mutex<[VecDeque<Sent>; keys::CARRIED.len()]>,
    /// Topics whose schema is known, with its text.
    schemas: Mutex<Vec<(Topic, String)>>,
}

impl Latest {
    /// Keeps a message; samples are not kept.
    pub fn keep(&self, topic: Topic, payload: &[u8], envelope: &[u8]) {
        let limit = match topic {
            Topic::Sample => return,
            Topic::Journal => JOURNAL,
            _ => 1,
        };
        let Some(index) = keys::CARRIED.iter().position(|carried| *carried == topic) else {
            return;
        };
        let kept = &mut self.topics.lock().unwrap_or_else(PoisonError::into_inner)[index];
        while kept.len() >= limit {
            kept.pop_front();
        }
        kept.push_back(Sent {
            payload: payload.to_vec(),
            envelope: envelope.to_vec(),
        });
    }

    /// Keeps the `ros2msg` text of topics.
    pub fn keep_schemas(&self, schemas: Vec<(Topic, String)>) {
        *self.schemas.lock().unwrap_or_else(PoisonError::into_inner) = schemas;
    }

    /// Answers a question about messages or schemas of `robot` on `host`.
    pub fn answer(&self, query: &Query, host: &str, robot: &str) {
        let is_asked = |key: &str| {
            let asked = query.key_expr();
            zenoh::key_expr::KeyExpr::try_from(key.to_owned()).is_ok_and(|key| asked.intersects(&key))
        };
        for (index, topic) in keys::CARRIED.into_iter().enumerate() {
            let key = keys::key(host, robot, topic.name());
            if !is_asked(&key) {
                continue;
            }
            // Cloned, because an answer may wait for the network.
            let kept = self.topics.lock().unwrap_or_else(PoisonError::into_inner)[index].clone();
            for sent in kept {
                let answer = query.reply(&key, sent.payload).attachment(sent.envelope);
                // Whoever asked may have gone.
                let _ = answer.encoding(encoding(topic)).wait();
            }
        }
        let schemas = self.schemas.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for (topic, text) in schemas {
            let key = keys::key(host, robot, &format!("{topic}/{}", keys::SCHEMA));
            if is_asked(&key) {
                let _ = query.reply(&key, text).wait();
            }
        }
    }
}

/// What zenoh tells readers of the bytes.
pub fn encoding(topic: Topic) -> zenoh::bytes::Encoding {
    let message = match topic {
        Topic::Sample => "Sample",
        Topic::Estimate => "Estimate",
        Topic::Status => "Status",
        Topic::Description => "Description",
        Topic::Journal => "Journal",
        Topic::Control => "Response",
        Topic::Command => "MachineCommand",
    };
    zenoh::bytes::Encoding::APPLICATION_CDR.with_schema(format!("thetabus/msg/{message}"))
}
