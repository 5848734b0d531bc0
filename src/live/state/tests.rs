use super::*;
use crate::node::monitor::tests::estimate;

/// A mass, which jumps, and a derived inertia.
pub(crate) fn state() -> LiveState {
    let quantity = |name: &str, unit: &str| Quantity::new(name, unit, &format!("{name} of the load"));
    let about = About {
        robot: "arm".into(),
        domain: "default".into(),
        model: "test".into(),
        joints: 1,
        position_unit: "rad".into(),
        input_unit: "V".into(),
    };
    LiveState::new(about, vec![quantity("mass", "kg")], vec![quantity("inertia", "kg m^2")])
}

/// A usable estimate.
pub(crate) fn known(block: u64, mass: f64, std: f64) -> Estimate {
    let mut message = estimate(block, mass);
    message.theta_std[0] = std;
    message.derived_len = 1;
    (message.derived[0], message.derived_std[0]) = (2.0 * mass, 2.0 * std);
    message.use_ok = 1;
    message.usable.insert(0);
    message.state = State::Converged as u32;
    message
}

fn status(accepted: u64, state: State) -> Status {
    Status {
        stream_id: 1,
        accepted,
        state: state as u32,
        estimates: accepted / 1000,
        ..Status::default()
    }
}

const S: u64 = 1_000_000_000;

#[test]
fn prop_a_state_without_messages_waits() {
    let view = state().view(5 * S);
    assert_eq!((view.health, view.alive, view.block), (Health::Wait, false, 0));
    assert_eq!(view.words, "waiting for an identifier");
    assert_eq!(view.headline, "no value may be used yet");
    assert_eq!(view.rows[0].value_text, "–");
    let json = serde_json::to_string(&view).unwrap();
    assert!(json.contains("\"heartbeat_s\":null"), "{json}");
}

#[test]
fn prop_a_jump_is_told_from_what_to_what_and_when() {
    let mut state = state();
    for block in 1..=5 {
        state.on_estimate(&known(block, 150.1123, 0.09), None, block * S);
    }
    let mut change = known(6, 160.0, 0.04);
    change.flags |= estimate_flags::CHANGED;
    change.t_change_ns = 4_990_000_000;
    change.state = State::Changing as u32;
    change.usable = ParameterSet::default();
    change.use_ok = 0;
    state.on_estimate(&change, None, 6 * S);
    assert!(state.view(6 * S).headline.starts_with("changed at 4.99 s"));
    state.on_estimate(&known(7, 170.0412, 0.04), None, 7 * S);
    state.on_status(&status(7000, State::Converged), 7 * S);
    let view = state.view(7 * S);
    // The headline uses the derived value, which users know by name.
    assert_eq!(
        view.headline,
        "inertia: 340.08 ± 0.08 kg·m², changed from 300.22 kg·m² at 4.99 s"
    );
    assert_eq!((view.changes.clone(), view.usable), (vec![4.99], 1));
    assert_eq!((view.rows[0].trend, view.rows[0].note()), (Trend::Rising, "usable"));
    assert_eq!(view.words, "settled; all 1 parameters may be used");
}

#[test]
fn prop_after_values_that_were_usable_none_is_so_now_and_not_yet() {
    let mut state = state();
    state.on_estimate(&known(1, 150.0, 0.1), None, S);
    let mut lost = known(2, 150.0, 0.1);
    (lost.use_ok, lost.state) = (0, State::Degraded as u32);
    state.on_estimate(&lost, None, 2 * S);
    assert_eq!(state.view(2 * S).headline, "no value may be used now");
}

#[test]
fn prop_an_identifier_that_dies_is_told_and_its_values_stay() {
    let mut state = state();
    state.on_estimate(&known(1, 150.0, 0.1), None, S);
    state.on_status(&status(1000, State::Converged), S);
    assert!(state.view(S + GONE_NS - 1).alive);
    let view = state.view(10 * S);
    assert!(!view.alive && view.health == Health::Bad);
    assert!(view.words.contains("silent for 9 s"), "{}", view.words);
    assert_eq!(view.rows[0].value, 150.0);
    assert_eq!(view.samples_per_s, 0.0);
}

#[test]
fn prop_rates_come_from_the_clock_and_a_new_stream_begins_anew() {
    let mut state = state();
    for k in 0..20 {
        state.on_status(&status(500 * k, State::Converged), k * S / 2);
    }
    assert_eq!(state.view(10 * S).samples_per_s, 1000.0);
    state.on_estimate(&known(3, 1.0, 0.1), None, S);
    state.on_estimate(&known(6, 1.0, 0.1), None, S);
    assert_eq!((state.view(S).lost_estimates, state.history().points().len()), (2, 2));
    let mut other = known(1, 2.0, 0.1);
    other.stream_id = 2;
    state.on_estimate(&other, None, S);
    assert_eq!((state.generation(), state.history().points().len()), (1, 1));
}

#[test]
fn prop_an_estimate_of_more_parameters_than_there_are_names_is_no_panic() {
    let mut state = state();
    let mut wild = known(1, 1.0, f64::NAN);
    (wild.params, wild.derived_len, wild.equations) = (u32::MAX, u32::MAX, u32::MAX);
    state.on_estimate(&wild, None, S);
    assert_eq!(state.view(S).rows.len(), 2);
}
