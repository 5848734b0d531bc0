//! Faults of the simulated sensors, each a table of its own.

use super::load;

#[test]
fn e2e_faults_are_tables_of_their_own_and_survive_a_round_trip() {
    use thetabus::sim::{Fault, FaultKind, FaultSignal};
    let text = "
        [plant]
        duration_s = 10
        [[plant.faults]]
        kind = \"stuck\"
        signal = \"q\"
        joint = 2
        from_s = 3
        to_s = 4.5
        [[plant.faults]]
        kind = \"intermittent\"
        from_s = 5
        share = 0.25
    ";
    let config = load(text, &[]).unwrap();
    let expected = [
        Fault {
            kind: FaultKind::Stuck,
            signal: FaultSignal::Q,
            joint: Some(1),
            from_s: 3.0,
            to_s: 4.5,
        },
        Fault {
            kind: FaultKind::Intermittent {
                share: 0.25,
                period_s: 0.0,
            },
            signal: FaultSignal::Sample,
            joint: None,
            from_s: 5.0,
            to_s: f64::INFINITY,
        },
    ];
    assert_eq!(config.plant.sim.faults, expected);
    assert_eq!(load(&config.to_toml(), &[]).unwrap().plant, config.plant);
    let inline = r#"plant.faults=[{kind="off", signal="input", from_s=1}]"#;
    assert_eq!(
        load("", &[inline]).unwrap().plant.sim.faults[0].signal,
        FaultSignal::Input
    );
    // Faults of the signals are not part of the hash of the estimation.
    assert_eq!(config.config_hash(), load("", &[]).unwrap().config_hash());
}

#[test]
fn fault_a_fault_that_is_wrong_itself_is_named_with_its_table_and_key() {
    let cases = [
        (
            "kind = \"of\"\nfrom_s = 1",
            ["test.toml:2: plant.faults[1].kind", "\"off\""],
        ),
        ("kind = \"off\"", ["test.toml:1: plant.faults[1]", "from_s"]),
        (
            "kind = \"off\"\nfrom_s = -1",
            ["test.toml:3: plant.faults[1].from_s", "-1"],
        ),
        (
            "kind = \"off\"\nfrom_s = 1\nuntil_s = 2",
            ["test.toml:4: plant.faults[1].until_s", "unknown key"],
        ),
        (
            "kind = \"off\"\nfrom_s = 2\nto_s = 1",
            ["test.toml:1: plant.faults: table 1, to_s", "after from_s"],
        ),
        ("kind = \"delayed\"\nfrom_s = 2", ["table 1, delay_s", "got 0"]),
        ("kind = \"wrong\"\nfrom_s = 2", ["table 1, signal", "single signal"]),
        (
            "kind = \"off\"\nsignal = \"q\"\njoint = 3\nfrom_s = 2",
            ["table 1, joint: expected a joint of the machine", "got 3"],
        ),
    ];
    for (table, parts) in cases {
        let error = load(&format!("[[plant.faults]]\n{table}\n"), &[]).unwrap_err();
        for part in parts {
            assert!(error.contains(part), "{part:?} is not in {error}");
        }
    }
    let error = load("[plant]\nfaults = [3]", &[]).unwrap_err();
    assert!(error.contains("plant.faults[1]: expected a table, got"), "{error}");
    let warned = load(
        "[plant.sensors]\nencoder_bits = 16\n[[plant.faults]]\nkind = \"off\"\nsignal = \"ddq\"\nfrom_s = 0",
        &[],
    );
    assert!(warned.unwrap().warnings()[0].message.contains("has no effect"));
}
