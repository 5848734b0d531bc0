//! The state as events: the complete state for a new browser, updates for connected ones.

use crate::live::history::Point;
use crate::live::signals::SignalPoint;
use crate::live::state::LiveState;
use hyper::body::Bytes;
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::broadcast;

/// Largest number of updates waiting for a browser; the oldest are dropped first, for all browsers
/// together.
const WAITING: usize = 16;
/// Longest state inside the page \[bytes\], so that page, styles and scripts stay below 150 kB; and
/// the largest factor by which it is thinned for that.
const FIRST: usize = 60_000;
const THINNEST: usize = 64;
/// Number of new points above which browsers get the complete, thinned state instead.
const MANY: usize = 100;

/// Passes the state from the caller to the server.
#[derive(Clone)]
pub struct Feed(Arc<Inner>);

struct Inner {
    state: Mutex<LiveState>,
    /// Returns the time of CLOCK_MONOTONIC \[ns\].
    now_ns: fn() -> u64,
    place: Mutex<Place>,
    /// The complete state at the last update, for browsers that connect before the next.
    whole: Mutex<Option<Bytes>>,
    events: broadcast::Sender<Update>,
    /// Whether the page shows controls to those who know the token.
    control: bool,
}

/// Position of the updates.
#[derive(Default)]
struct Place {
    generation: u64,
    block: u64,
    t_ns: u64,
}

/// An update for all browsers.
#[derive(Debug, Clone)]
pub(super) enum Update {
    /// The new part.
    Part(Bytes),
    /// Too much is new: send the complete state.
    Renew,
}

impl Feed {
    /// A feed of a state; `now_ns` is the clock of its times.
    pub fn new(state: LiveState, now_ns: fn() -> u64, control: bool) -> Self {
        Self(Arc::new(Inner {
            state: Mutex::new(state),
            now_ns,
            place: Mutex::default(),
            whole: Mutex::new(None),
            events: broadcast::Sender::new(WAITING),
            control,
        }))
    }

    /// Gives access to the state.
    pub fn with<T>(&self, act: impl FnOnce(&mut LiveState) -> T) -> T {
        act(&mut self.0.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Sends updates to all browsers; call it a few times per second.
    pub fn publish(&self) {
        // Before the update is made: a browser that still gets the old complete state is already
        // subscribed to the update.
        *self.0.whole.lock().unwrap_or_else(PoisonError::into_inner) = None;
        if self.0.events.receiver_count() == 0 {
            return;
        }
        let mut place = self.0.place.lock().unwrap_or_else(PoisonError::into_inner);
        let update = self.with(|state| {
            let is_new = place.generation != state.generation();
            let points = state.history().after(place.block);
            let renew = is_new || points.len() > MANY;
            let update = match renew {
                true => Update::Renew,
                false => Update::Part(event(
                    "update",
                    &json!({
                        "view": state.view((self.0.now_ns)()),
                        "points": points.map(point).collect::<Vec<_>>(),
                        "signals": signals(state, place.t_ns),
                    }),
                )),
            };
            place.generation = state.generation();
            place.block = state.history().points().next_back().map_or(0, |point| point.block);
            place.t_ns = state.signals().points().next_back().map_or(0, |point| point.t_ns);
            update
        });
        let _ = self.0.events.send(update);
    }

    pub(super) fn subscribe(&self) -> broadcast::Receiver<Update> {
        self.0.events.subscribe()
    }

    /// The complete state as an event, no older than the last update. A reader subscribes first,
    /// and detects duplicates by their number.
    pub(super) fn whole(&self) -> Bytes {
        let mut whole = self.0.whole.lock().unwrap_or_else(PoisonError::into_inner);
        let make = || event("whole", &self.with(|state| self.as_json(state, 1)));
        whole.get_or_insert_with(make).clone()
    }

    /// The same as JSON alone for the page itself, with every second point, every fourth and so on
    /// until it is not longer than [`FIRST`]: the first event has the rest.
    pub(super) fn first_json(&self) -> String {
        let whole = self.whole();
        let text = std::str::from_utf8(&whole).unwrap_or("");
        let mut data = text
            .split_once("data: ")
            .map_or("", |(_, data)| data)
            .trim_end()
            .to_owned();
        let mut every = 1;
        while data.len() > FIRST && every < THINNEST {
            every *= 2;
            data = self.with(|state| self.as_json(state, every)).to_string();
        }
        data
    }

    /// The state with one of `every` points, the newest among them.
    fn as_json(&self, state: &LiveState, every: usize) -> Value {
        let chosen = |index: usize, count: usize| (count - 1 - index).is_multiple_of(every);
        let points = state.history().points();
        let count = points.len();
        let points = points.enumerate().filter(|(index, _)| chosen(*index, count));
        let rows = signals(state, 0);
        let count = rows.len();
        let rows = rows.into_iter().enumerate().filter(|(index, _)| chosen(*index, count));
        let about = state.about();
        let quantities: Vec<Value> = state
            .quantities()
            .iter()
            .map(|q| {
                json!({
                    "name": q.name, "unit": q.unit, "meaning": q.meaning, "lower": short(q.lower), "upper": short(q.upper),
                })
            })
            .collect();
        json!({
            "about": {
                "robot": about.robot, "domain": about.domain, "model": about.model, "joints": about.joints,
                "position_unit": about.position_unit, "input_unit": about.input_unit,
            },
            "control": self.0.control,
            "predicts": state.predicts(),
            "quantities": quantities,
            "limit": state.history().limit(),
            "view": state.view((self.0.now_ns)()),
            "points": points.map(|(_, own)| point(own)).collect::<Vec<_>>(),
            "signals": rows.map(|(_, row)| row).collect::<Vec<_>>(),
        })
    }
}

/// An event in the format of `EventSource`.
fn event(name: &str, data: &Value) -> Bytes {
    format!("event: {name}\ndata: {data}\n\n").into()
}

fn point(point: &Point) -> Value {
    let row = |values: &[f64]| values.iter().map(|&value| short(value)).collect::<Vec<_>>();
    json!({
        "b": point.block, "t": short(point.t_s), "v": row(&point.values), "s": row(&point.stds), "w": row(&point.truth),
    })
}

/// The signals after a time, as columns: time, then position, setpoint, input and predicted input
/// of each joint.
fn signals(state: &LiveState, after_ns: u64) -> Vec<Vec<Value>> {
    let joints = state.about().joints;
    let row = |point: &SignalPoint| {
        let mut row = vec![short(point.t_ns as f64 / 1e9)];
        for joint in 0..joints.min(point.position.len()) {
            let (input, predicted) = (point.input[joint], point.predicted[joint]);
            row.extend([point.position[joint], point.setpoint[joint], input, predicted].map(short));
        }
        row
    };
    // 0 means "from the beginning", and a first sample may have time 0.
    match after_ns {
        0 => state.signals().points().map(row).collect(),
        _ => state.signals().after(after_ns).map(row).collect(),
    }
}

/// Seven significant digits, enough for a plot. Non-finite values are null.
fn short(value: f64) -> Value {
    format!("{value:.6e}")
        .parse::<f64>()
        .ok()
        .filter(|v| v.is_finite())
        .map_or(Value::Null, |v| json!(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::state::tests::{known, state};

    fn parsed(bytes: &Bytes) -> (String, Value) {
        let text = std::str::from_utf8(bytes).unwrap();
        let (name, data) = text.split_once('\n').unwrap();
        let data = data.strip_prefix("data: ").unwrap().trim_end();
        (name.replace("event: ", ""), serde_json::from_str(data).unwrap())
    }

    #[test]
    fn prop_updates_hold_what_is_new_and_a_flood_or_a_new_stream_asks_for_the_whole() {
        let feed = Feed::new(state(), || 0, false);
        feed.publish();
        let mut listener = feed.subscribe();
        for block in 1..=3 {
            feed.with(|state| state.on_estimate(&known(block, 170.04, 0.04), None, block));
        }
        feed.publish();
        let Update::Part(part) = listener.try_recv().unwrap() else {
            panic!("three points are not many")
        };
        let (name, data) = parsed(&part);
        assert_eq!(
            (name.as_str(), data["points"].as_array().map(Vec::len)),
            ("update", Some(3))
        );
        assert_eq!(data["view"]["rows"][0]["value"], 170.04);
        assert_eq!(data["points"][2]["v"][1], 340.08);
        assert_eq!(data["points"][2]["w"].as_array().map(Vec::len), Some(0));
        feed.with(|state| state.on_estimate(&known(4, 171.0, f64::NAN), None, 4));
        feed.publish();
        let Update::Part(part) = listener.try_recv().unwrap() else {
            panic!("one point is not many")
        };
        let (_, data) = parsed(&part);
        assert_eq!(data["points"].as_array().map(Vec::len), Some(1));
        assert_eq!(data["points"][0]["s"][0], Value::Null);
        for block in 5..=200 {
            feed.with(|state| state.on_estimate(&known(block, 171.0, 0.1), None, block));
        }
        feed.publish();
        assert!(matches!(listener.try_recv(), Ok(Update::Renew)));
        let (name, data) = parsed(&feed.whole());
        assert_eq!(
            (name.as_str(), data["points"].as_array().map(Vec::len)),
            ("whole", Some(200))
        );
        assert_eq!(
            (&data["about"]["robot"], &data["control"]),
            (&json!("arm"), &json!(false))
        );
    }

    #[test]
    fn prop_the_page_holds_no_more_of_a_long_run_than_it_may_and_the_newest_of_it() {
        let feed = Feed::new(state(), || 0, false);
        for block in 1..=5_000 {
            feed.with(|state| state.on_estimate(&known(block, 170.04 + 1e-6 * block as f64, 0.04), None, block));
        }
        assert!(feed.whole().len() > FIRST, "{}", feed.whole().len());
        let first = feed.first_json();
        assert!(first.len() <= FIRST, "{}", first.len());
        let data: Value = serde_json::from_str(&first).unwrap();
        let points = data["points"].as_array().unwrap();
        assert!(points.len() > 100, "{}", points.len());
        assert_eq!(points[points.len() - 1]["b"], 5_000);
    }

    #[test]
    fn prop_a_listener_that_never_listens_holds_nothing_up() {
        let feed = Feed::new(state(), || 0, false);
        let mut listener = feed.subscribe();
        for block in 1..=10_000 {
            feed.with(|state| state.on_estimate(&known(block, 1.0, 0.1), None, block));
            feed.publish();
        }
        assert!(matches!(
            listener.try_recv(),
            Err(broadcast::error::TryRecvError::Lagged(_))
        ));
        assert!(listener.len() <= WAITING);
    }
}
