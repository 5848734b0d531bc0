//! The programs that users have, on both sides of a gateway.

use crate::support::*;
use std::path::{Path, PathBuf};
use thetabus::bus::{Bus, ControlClient, ControlServer, Subscriber};
use thetabus::messages::{Command, Description, Estimate, Request, Response, response_code};

/// Where cargo puts programs of this build, or where `THETABUS_BIN` says.
fn programs() -> PathBuf {
    let test = std::env::current_exe().expect("this test");
    let built = test.ancestors().nth(2).expect("target/release").to_owned();
    std::env::var_os("THETABUS_BIN").map_or(built, PathBuf::from)
}

fn start(args: &[&str], domain: &thetabus::bus::Domain) -> Process {
    Process::start(
        &programs().join("thetabus"),
        &[args, &["--domain", domain.name()]].concat(),
    )
}

/// False if the programs are missing here and may be.
fn are_there() -> bool {
    let must = std::env::var("THETABUS_REQUIRE_PEERS").as_deref() == Ok("1");
    let found = programs().join("thetabus").exists();
    assert!(found || !must, "missing: thetabus in {}", programs().display());
    if !found {
        eprintln!("skipped: thetabus is missing in {}", programs().display());
    }
    found
}

#[test]
fn e2e_ctl_and_monitor_work_on_the_other_host() {
    if !are_there() {
        return;
    }
    let site = Site::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/cedro2022.toml");
    let config = root.to_str().expect("UTF-8");
    let quick = [
        "--config",
        config,
        "--set",
        "estimator.block_len=200",
        "--set",
        "plant.speed=1",
    ];
    let at = endpoint();
    let _out = site.out(&["--listen", &at, "--samples"]);
    let _inward = site.inward(&["--connect", &at, "--samples"]);
    let _identifier = start(&[&["identifier"], &quick[..]].concat(), &site.near);
    let _plant = start(&[&["plant"], &quick[..]].concat(), &site.near);

    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    let description = next(&mut descriptions, "the description", |_| true);
    assert_eq!(description.parameters().len(), 9);
    next(&mut estimates, "the third estimate", |estimate| estimate.block >= 3);

    let ctl = |args: &[&str]| {
        let mut process = start(&[&["ctl"], args].concat(), &site.far);
        let (code, out, log) = process.wait();
        (code.code(), format!("{out}{log}"))
    };
    let (code, text) = ctl(&["describe"]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("theta_9"), "{text}");
    let (code, text) = ctl(&["fix", "theta_3"]);
    assert_eq!(code, Some(0), "{text}");
    next(&mut estimates, "an estimate with theta_3 held", |estimate| {
        estimate.fixed.contains(2)
    });
    let (code, text) = ctl(&["fix", "no_such_parameter"]);
    assert!(code != Some(0) && text.contains("no_such_parameter"), "{text}");

    let out_dir = site.dir.path().join("seen");
    let out_dir = out_dir.to_str().expect("UTF-8");
    let monitor = start(&["monitor", "--config", config, "--out", out_dir], &site.far);
    monitor.says("block");
    let (code, _, log) = monitor.end();
    assert!(code.success(), "{log}");
}

#[test]
fn fault_ctl_is_told_by_the_gateway_why_there_is_no_answer() {
    if !are_there() {
        return;
    }
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    // It takes nothing, as an identifier that hangs.
    let mut server = ControlServer::new(&machine.bus).expect("served");
    let at = endpoint();
    let out = site.out(&["--listen", &at]);
    let _inward = site.inward(&["--connect", &at]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    machine.until(&mut descriptions, "the description", |_| true);

    // Two at once: the second waits for the first. What has failed does not take effect later.
    let client = || eventually("a server of control", || ControlClient::new(&bus).ok());
    let reset = Request::new(Command::Reset);
    let both = [client(), client()].map(|client| (client.begin(&reset).expect("asked"), client));
    for ((pending, client), words) in both
        .iter()
        .zip(["did not answer within 2 s", "was not given to the identifier"])
    {
        let response = eventually("an answer", || client.look(pending).expect("the gateway is there"));
        assert_eq!(response.code, response_code::FAILED);
        assert!(
            response.text().contains("host cell: ") && response.text().contains(words),
            "{}",
            response.text()
        );
    }
    assert_eq!(server.serve(8, |_| Response::default()).expect("served"), 0);

    let ctl = |words: &str| {
        let (code, _, log) = start(&["ctl", "reset"], &site.far).wait();
        assert_eq!(code.code(), Some(1), "{log}");
        assert!(log.contains(words), "{log}");
    };
    ctl("host cell: the identifier of robot \"arm\"");
    out.stop();
    ctl("host cell did not answer within 2.5 s");
}
