//! Who gets in, and what comes in.

use crate::support::*;
use std::collections::BTreeSet;
use thetabus::bus::{Bus, ControlClient, ControlServer, Subscriber};
use thetabus::messages::{Command, Description, Estimate, Request, Response, response_code};

fn user(name: &str, password: &str) -> String {
    format!("{{ transport: {{ auth: {{ usrpwd: {{ user: '{name}', password: '{password}' }} }} }} }}")
}

#[test]
fn fault_a_peer_without_credentials_gets_nothing() {
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let users = site.file("users", "floor:secret\n");
    let guarded = format!(
        "{{ transport: {{ auth: {{ usrpwd: {{ user: 'floor', password: 'secret', dictionary_file: '{users}' }} }} }} }}"
    );
    let at = endpoint();
    let out = site.out(&["--listen", &at, "--config", &site.file("out.json5", &guarded)]);
    out.says("carries out");

    let none = site.inward(&["--connect", &at]);
    let other = Site::new();
    let wrong = other.inward(&[
        "--connect",
        &at,
        "--config",
        &site.file("wrong.json5", &user("floor", "guess")),
    ]);
    for refused in [&none, &wrong] {
        refused.says("not connected");
    }
    let third = Site::new();
    let right = third.inward(&[
        "--connect",
        &at,
        "--config",
        &site.file("right.json5", &user("floor", "secret")),
    ]);
    let reader = |site: &Site| {
        let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
        (
            Subscriber::<Description>::new(&bus).expect("subscribed"),
            Subscriber::<Estimate>::new(&bus).expect("subscribed"),
        )
    };
    let (mut descriptions, mut estimates) = reader(&third);
    machine.until(&mut descriptions, "the description, with the password", |_| true);
    let refused = [reader(&site), reader(&other)];
    for block in 1..5 {
        machine.estimates.send(&estimate(block)).expect("sent");
        next(&mut estimates, "an estimate, with the password", |_| true);
    }
    for (mut descriptions, mut estimates) in refused {
        let count = descriptions.drain(|_| {}).expect("looked") + estimates.drain(|_| {}).expect("looked");
        assert_eq!(count, 0, "nothing without the password");
    }
    assert!(!none.stderr().contains("robot connected") && !wrong.stderr().contains("robot connected"));
    drop(right);
}

/// Inodes of the sockets of a process.
fn sockets(pid: u32) -> BTreeSet<String> {
    let links = std::fs::read_dir(format!("/proc/{pid}/fd"))
        .expect("the process lives")
        .flatten();
    let targets = links.filter_map(|entry| std::fs::read_link(entry.path()).ok());
    targets
        .filter_map(|target| Some(target.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned()))
        .collect()
}

/// Local addresses of the sockets of a process in /proc/net/`table`.
fn addresses(pid: u32, table: &str) -> Vec<String> {
    let own = sockets(pid);
    let text = std::fs::read_to_string(format!("/proc/net/{table}")).unwrap_or_default();
    let fields = text
        .lines()
        .skip(1)
        .map(|line| line.split_whitespace().collect::<Vec<_>>());
    fields
        .filter(|fields| own.contains(fields[9]))
        .map(|fields| fields[1].to_owned())
        .collect()
}

#[test]
fn prop_only_the_loopback_interface_is_used_unless_told_otherwise() {
    let site = Site::new();
    let _machine = Machine::new(&site.near);
    let at = endpoint();
    let router = gateway(&["route", "--listen", &at]);
    let out = site.out(&["--connect", &at]);
    let inward = site.inward(&["--connect", &at]);
    router.says("routes");
    out.says("carries out");
    inward.says("robot connected");
    // 127.0.0.1 as /proc/net/tcp writes it.
    let loopback = "0100007F:";
    for process in [&router, &out, &inward] {
        let tcp = addresses(process.pid(), "tcp");
        assert!(
            !tcp.is_empty() && tcp.iter().all(|address| address.starts_with(loopback)),
            "{tcp:?}"
        );
        for table in ["tcp6", "udp", "udp6"] {
            assert_eq!(
                addresses(process.pid(), table),
                Vec::<String>::new(),
                "{table}: no scouting"
            );
        }
    }
}

#[test]
fn fault_wrong_usage_is_told_with_what_to_do() {
    let site = Site::new();
    let file = site.file("wrong.json5", "{ connect: { endpoints: ['udp/127.0.0.1:7447'] } }");
    let expected = "expected tcp/ADDRESS:PORT or tls/ADDRESS:PORT, for example tcp/127.0.0.1:7447";
    for (args, words) in [
        (vec!["out", "--host", "Cell 1"], "[a-z0-9_-]"),
        (vec!["out", "--robot", "no robot"], "[a-z0-9_-]"),
        (vec!["in", "--robot", "arm", "--robot", "*"], "[a-z0-9_-]"),
        (vec!["in", "--from", "*"], "--host"),
        (vec!["in", "--connect", "nonsense"], expected),
        (vec!["out", "--listen", "tcp/127.0.0.1:99999"], expected),
        (vec!["route", "--listen", "udp/127.0.0.1:7447"], expected),
        (vec!["out", "--config", &file], expected),
        (vec!["in", "--max-robots", "0"], "a number of robots, 1 or more"),
        (
            vec!["route", "--config", "/nowhere/zenoh.json5"],
            "/nowhere/zenoh.json5",
        ),
    ] {
        let on = ["--domain", site.near.name()];
        let args = if args[0] == "route" {
            args
        } else {
            [&args[..], &on].concat()
        };
        let (code, _, log) = gateway(&args).wait();
        assert_eq!(code.code(), Some(2), "{log}");
        assert!(log.contains(words) && !log.contains(".rs"), "{log}");
    }
    // What only the system knows to be wrong.
    for (args, words) in [
        (["route", "--listen", "tls/127.0.0.1:1"], "TLS private key"),
        (["route", "--listen", "tcp/256.1.1.1:7447"], "tcp/256.1.1.1:7447"),
    ] {
        let (code, _, log) = gateway(&args).wait();
        assert_eq!(code.code(), Some(1), "{log}");
        assert!(log.contains(words) && !log.contains(".rs"), "{log}");
    }
}

/// The access control that docs/gateway.md shows.
const SEE_ONLY: &str = r#"access_control: {
    enabled: true, default_permission: "deny",
    rules: [
      { id: "see", permission: "allow", flows: ["ingress", "egress"], key_exprs: ["thetabus/**"],
        messages: ["put", "delete", "declare_subscriber", "declare_queryable", "reply", "liveliness_token", "liveliness_query", "declare_liveliness_subscriber"] },
      { id: "last", permission: "allow", flows: ["ingress", "egress"], key_exprs: ["thetabus/*/*/*"], messages: ["query"] },
      { id: "command", permission: "deny", flows: ["ingress"], key_exprs: ["thetabus/*/*/control"], messages: ["query"] },
    ],
    subjects: [{ id: "viewer", usernames: ["viewer"] }],
    policies: [{ rules: ["see", "last", "command"], subjects: ["viewer"] }],
  },"#;

#[test]
fn fault_a_user_who_may_see_cannot_command() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/gateway.md");
    let page = std::fs::read_to_string(page).expect("the page");
    assert!(
        page.contains(SEE_ONLY),
        "docs/gateway.md shows another access control than the one that is tested"
    );
    let site = Site::new();
    let mut machine = Machine::new(&site.near);
    let mut server = ControlServer::new(&machine.bus).expect("served");
    let users = site.file("users", "viewer:secret\n");
    let guarded = format!(
        "{{ transport: {{ auth: {{ usrpwd: {{ user: 'cell', password: 'x', dictionary_file: '{users}' }} }} }}, {SEE_ONLY} }}"
    );
    let at = endpoint();
    let out = site.out(&["--listen", &at, "--config", &site.file("out.json5", &guarded)]);
    out.says("carries out");
    machine.estimates.send(&estimate(1)).expect("sent");
    let _inward = site.inward(&[
        "--connect",
        &at,
        "--config",
        &site.file("in.json5", &user("viewer", "secret")),
    ]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribed");
    machine.until(&mut descriptions, "the description", |_| true);
    machine.until(&mut estimates, "the last estimate", |estimate| estimate.block == 1);
    machine.estimates.send(&estimate(2)).expect("sent");
    next(&mut estimates, "an estimate", |estimate| estimate.block == 2);
    let client = eventually("a server of control", || ControlClient::new(&bus).ok());
    let pending = client.begin(&Request::new(Command::Reset)).expect("asked");
    let response = eventually("an answer", || {
        assert_eq!(
            server.serve(1, |_| Response::default()).expect("looked"),
            0,
            "nothing comes in"
        );
        client.look(&pending).expect("the gateway is there")
    });
    assert_eq!(response.code, response_code::FAILED, "{}", response.text());
}

/// A certificate of the test's own for 127.0.0.1, and who signed it; false if openssl is missing
/// here and may be.
fn certificates(site: &Site) -> bool {
    let script = "set -e; key='-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes'
        openssl req -x509 $key -keyout ca.key -out ca.pem -days 2 -subj /CN=ca
        openssl req $key -keyout key.pem -out host.csr -subj /CN=localhost
        printf 'subjectAltName=IP:127.0.0.1\\nbasicConstraints=CA:FALSE\\n' > ext
        openssl x509 -req -in host.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -extfile ext -out host.pem";
    let output = std::process::Command::new("sh")
        .args(["-c", script])
        .current_dir(site.dir.path())
        .output();
    let made = output.is_ok_and(|output| output.status.success());
    let must = std::env::var("THETABUS_REQUIRE_PEERS").as_deref() == Ok("1");
    assert!(made || !must, "missing: openssl");
    if !made {
        eprintln!("skipped: openssl is missing");
    }
    made
}

#[test]
fn fault_a_peer_that_does_not_know_the_certificate_gets_nothing_by_tls() {
    let site = Site::new();
    if !certificates(&site) {
        return;
    }
    let at = endpoint().replace("tcp/", "tls/");
    let mut machine = Machine::new(&site.near);
    let path = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let (key, host, ca) = (path("key.pem"), path("host.pem"), path("ca.pem"));
    let tls = |words: &str| format!("{{ transport: {{ link: {{ tls: {{ {words} }} }} }} }}");
    let own = tls(&format!("listen_private_key: '{key}', listen_certificate: '{host}'"));
    let out = site.out(&["--listen", &at, "--config", &site.file("out.json5", &own)]);
    out.says("carries out");
    let other = Site::new();
    let refused = other.inward(&["--connect", &at]);
    refused.says("not connected");
    let known = tls(&format!("root_ca_certificate: '{ca}'"));
    let inward = site.inward(&["--connect", &at, "--config", &site.file("in.json5", &known)]);
    let bus = Bus::join(&site.far, "arm", "reader").expect("joined");
    let mut descriptions = Subscriber::<Description>::new(&bus).expect("subscribed");
    machine.until(&mut descriptions, "the description", |_| true);
    assert!(!refused.stderr().contains("robot connected"), "{}", refused.stderr());
    drop(inward);
}
