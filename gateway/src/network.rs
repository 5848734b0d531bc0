//! zenoh's configuration and session.
//!
//! zenoh by itself listens on every interface, finds others by multicast and takes messages of 1
//! GiB. Here nothing of that holds unless the user's own file says so: the file is laid over the
//! defaults below, key by key, and endpoints of the command line over both.

use crate::error::{GatewayError, network, words};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use zenoh::{Config, Session, Wait};

/// Where a gateway listens or connects to if no endpoint is given: this host alone.
pub const LOOPBACK: &str = "tcp/127.0.0.1:7447";
/// Pauses between attempts to connect, each twice the one before, as zenoh's own: from this one to
/// that.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
const LONGEST_PAUSE: Duration = Duration::from_secs(4);
/// Period of checking for a stop meanwhile.
const LOOK: Duration = Duration::from_millis(50);
/// The same during an attempt, which takes milliseconds if all is well.
const FIRST_LOOK: Duration = Duration::from_millis(2);

/// How the network is reached.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct NetworkArgs {
    /// Endpoint of a router or gateway, for example tcp/10.0.0.5:7447 or tls/router.example:7447;
    /// may be repeated
    #[arg(long, value_name = "ENDPOINT", value_parser = endpoint)]
    pub connect: Vec<String>,
    /// Endpoint to listen on, for example tcp/10.0.0.4:7447; may be repeated
    #[arg(long, value_name = "ENDPOINT", value_parser = endpoint)]
    pub listen: Vec<String>,
    /// zenoh's own configuration, JSON5: TLS, user and password, access control
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// An endpoint as the command line or a file has it.
///
/// # Errors
/// What was expected.
pub fn endpoint(text: &str) -> Result<String, String> {
    let is_port = |port: &str| port.parse::<u16>().is_ok();
    let address = text.strip_prefix("tcp/").or_else(|| text.strip_prefix("tls/"));
    // Behind these are zenoh's own settings of a link.
    let address = address.and_then(|address| address.split(['?', '#']).next());
    match address.and_then(|address| address.rsplit_once(':')) {
        Some((host, port)) if is_host(host) && is_port(port) => Ok(text.to_owned()),
        _ => Err(format!(
            "expected tcp/ADDRESS:PORT or tls/ADDRESS:PORT, for example {LOOPBACK} or tls/router.example:7447"
        )),
    }
}

/// Whether this may be an address: a name, or four numbers, or in brackets one of IPv6.
fn is_host(host: &str) -> bool {
    match host.strip_prefix('[') {
        Some(six) => six.strip_suffix(']').is_some_and(|six| !six.is_empty()),
        None => !host.is_empty() && !host.contains([':', '/', '[', ']', ',', ';', ' ']),
    }
}

/// All endpoints of a section, whatever lists they are in.
fn endpoints(value: &Value) -> Vec<&str> {
    match value {
        Value::String(text) => vec![text],
        Value::Array(list) => list.iter().flat_map(endpoints).collect(),
        Value::Object(modes) => modes.values().flat_map(endpoints).collect(),
        _ => Vec::new(),
    }
}

/// Keys that name a file to read.
const FILES: [&str; 6] = [
    "/transport/auth/usrpwd/dictionary_file",
    "/transport/link/tls/root_ca_certificate",
    "/transport/link/tls/listen_private_key",
    "/transport/link/tls/listen_certificate",
    "/transport/link/tls/connect_private_key",
    "/transport/link/tls/connect_certificate",
];

/// What a program is if its user says nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Waits for others on the loopback interface.
    Host,
    /// Connects to the loopback interface.
    Guest,
    /// Passes on what others send.
    Router,
}

/// The gateway's own defaults.
fn defaults() -> Value {
    json!({
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "listen": { "endpoints": [] },
        "connect": { "endpoints": [] },
        "transport": {
            "link": {
                // 16 batches of 64 KiB: two seconds of samples at 1 kHz, before any is dropped.
                "tx": { "queue": { "size": { "data": 16, "data_low": 16 } } },
                // The longest message, a description, has 45 kB.
                "rx": { "max_message_size": 1_048_576 },
            },
            "shared_memory": { "enabled": false },
        },
        "adminspace": { "enabled": false },
    })
}

/// Lays `over` onto `base`, objects key by key, anything else as a whole.
fn lay(base: &mut Value, over: Value) {
    match (base, over) {
        (Value::Object(base), Value::Object(over)) => {
            for (key, value) in over {
                lay(base.entry(key).or_insert(Value::Null), value);
            }
        }
        (base, over) => *base = over,
    }
}

/// Whether a configuration has endpoints in `section`, for any mode.
fn has_endpoints(config: &Value, section: &str) -> bool {
    match &config[section]["endpoints"] {
        Value::Array(list) => !list.is_empty(),
        Value::Object(modes) => modes
            .values()
            .any(|list| list.as_array().is_some_and(|list| !list.is_empty())),
        _ => false,
    }
}

fn read(path: &Path) -> Result<Value, GatewayError> {
    let text = std::fs::read_to_string(path).map_err(|source| GatewayError::ConfigFile {
        path: path.to_owned(),
        source,
    })?;
    let wrong = |problem: String| GatewayError::Config {
        path: path.to_owned(),
        problem,
    };
    let file: Value = json5::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let auth = &file["transport"]["auth"]["usrpwd"];
    if auth["user"].is_null() != auth["password"].is_null() {
        // zenoh would say that it is invalid.
        return Err(wrong(
            "transport.auth.usrpwd: one of user and password without the other".into(),
        ));
    }
    // By itself, so that what is wrong is said of the file and not hidden by what is laid over it.
    match Config::from_json5(&file.to_string()) {
        Ok(_) if file.is_object() => {
            for section in ["connect", "listen"] {
                for text in endpoints(&file[section]["endpoints"]) {
                    endpoint(text).map_err(|problem| wrong(format!("{section}.endpoints: {text:?}: {problem}")))?;
                }
            }
            for key in FILES {
                if let Some(Value::String(name)) = file.pointer(key) {
                    let key = key.trim_start_matches('/').replace('/', ".");
                    // zenoh would say of some that it cannot connect, and try again.
                    std::fs::File::open(name).map_err(|e| wrong(format!("{key}: {name}: {e}")))?;
                }
            }
            Ok(file)
        }
        Ok(_) => Err(wrong("no object".into())),
        Err(e) => Err(wrong(words(e))),
    }
}

/// The whole configuration as JSON: defaults, file, command line, and `part` for what none of the
/// three states.
///
/// # Errors
/// The file cannot be read.
pub fn merged(args: &NetworkArgs, part: Part) -> Result<Value, GatewayError> {
    let mut config = defaults();
    if let Some(path) = &args.config {
        lay(&mut config, read(path)?);
    }
    for (section, endpoints) in [("connect", &args.connect), ("listen", &args.listen)] {
        if !endpoints.is_empty() {
            lay(&mut config, json!({ section: { "endpoints": endpoints } }));
        }
    }
    let scouts = config["scouting"]["multicast"]["enabled"] == json!(true);
    if !has_endpoints(&config, "connect") && !has_endpoints(&config, "listen") && !scouts {
        let section = if part == Part::Guest { "connect" } else { "listen" };
        lay(&mut config, json!({ section: { "endpoints": [LOOPBACK] } }));
    }
    if config.get("mode").is_none() {
        // A client has one router or gateway and hears of nobody else; a peer lets others in.
        let mode = match part {
            Part::Router => "router",
            _ if has_endpoints(&config, "listen") || scouts => "peer",
            _ => "client",
        };
        lay(&mut config, json!({ "mode": mode }));
    }
    if config["mode"] == json!("client")
        && !has_endpoints(&config, "connect")
        && !scouts
        && let Some(path) = &args.config
    {
        return Err(GatewayError::Config {
            path: path.clone(),
            problem: "mode client without connect.endpoints: it has nobody to connect to, and does not listen".into(),
        });
    }
    Ok(config)
}

/// Opens the session; tries again until it succeeds or `stop` is set, then `None`.
///
/// # Errors
/// The configuration is wrong, or an endpoint to listen on is taken.
pub fn open(args: &NetworkArgs, part: Part, stop: &AtomicBool) -> Result<Option<Session>, GatewayError> {
    let merged = merged(args, part)?;
    let config = Config::from_json5(&merged.to_string()).map_err(network("its configuration"))?;
    let is_client = merged["mode"] == json!("client");
    let mut is_told = false;
    let mut pause = FIRST_PAUSE;
    loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let Some(opened) = attempt(&config, stop) else {
            return Ok(None);
        };
        match opened {
            Ok(session) => return Ok(Some(session)),
            Err(_) if !is_told && !is_sound(args, &merged, stop)? => return Ok(None),
            Err(e) if is_client => {
                if !is_told {
                    tracing::warn!(
                        "not connected to {}: {}; trying on. Nobody listens there, or user, password or certificate are refused",
                        merged["connect"]["endpoints"],
                        words(e)
                    );
                    is_told = true;
                }
                let since = Instant::now();
                while since.elapsed() < pause && !stop.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                }
                pause = LONGEST_PAUSE.min(2 * pause);
            }
            Err(e) => {
                let at = &merged["listen"]["endpoints"];
                return Err(network("opening the session")(format!(
                    "listening on {at}: {}",
                    words(e)
                )));
            }
        }
    }
}

/// Whether zenoh accepts the configuration without its endpoints: what it refuses then, it will refuse
/// at each attempt. False if `stop` was set meanwhile.
///
/// # Errors
/// zenoh refuses it.
fn is_sound(args: &NetworkArgs, merged: &Value, stop: &AtomicBool) -> Result<bool, GatewayError> {
    let mut alone = merged.clone();
    let nowhere = json!({
        "mode": "peer",
        "connect": { "endpoints": [] },
        "listen": { "endpoints": [] },
        "scouting": { "multicast": { "enabled": false } },
    });
    lay(&mut alone, nowhere);
    let alone = Config::from_json5(&alone.to_string()).map_err(network("its configuration"))?;
    match attempt(&alone, stop) {
        None => Ok(false),
        Some(Ok(session)) => {
            // It has done its work; how it ends is of no interest.
            let _ = session.close().wait();
            Ok(true)
        }
        Some(Err(e)) => Err(match &args.config {
            Some(path) => GatewayError::Config {
                path: path.clone(),
                problem: words(e),
            },
            None => network("its configuration")(e),
        }),
    }
}

/// One attempt; `None` if `stop` was set meanwhile. Whoever accepts and says nothing keeps zenoh for
/// 10 s, so a thread of its own waits, which ends with the process.
fn attempt(config: &Config, stop: &AtomicBool) -> Option<zenoh::Result<Session>> {
    let config = config.clone();
    let opening = std::thread::spawn(move || zenoh::open(config).wait());
    while !opening.is_finished() {
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        std::thread::sleep(FIRST_LOOK);
    }
    Some(opening.join().unwrap_or_else(|_| Err("zenoh panicked".into())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    fn with_file(text: &str) -> (tempfile::NamedTempFile, NetworkArgs) {
        let mut file = tempfile::NamedTempFile::new().expect("a file");
        file.write_all(text.as_bytes()).expect("written");
        let args = NetworkArgs {
            config: Some(file.path().to_owned()),
            ..NetworkArgs::default()
        };
        (file, args)
    }

    #[test]
    fn prop_without_a_word_nothing_but_the_loopback_interface_is_used() {
        for (part, section, mode) in [
            (Part::Host, "listen", "peer"),
            (Part::Guest, "connect", "client"),
            (Part::Router, "listen", "router"),
        ] {
            let config = merged(&NetworkArgs::default(), part).expect("a configuration");
            assert_eq!(config[section]["endpoints"], json!([LOOPBACK]), "{part:?}");
            assert_eq!(config["mode"], json!(mode), "{part:?}");
            assert_eq!(config["scouting"]["multicast"]["enabled"], json!(false));
            assert_eq!(config["scouting"]["gossip"]["enabled"], json!(false));
            let other = if section == "listen" { "connect" } else { "listen" };
            assert_eq!(config[other]["endpoints"], json!([]), "{part:?}");
            assert!(Config::from_json5(&config.to_string()).is_ok(), "zenoh understands it");
        }
    }

    #[test]
    fn prop_a_file_changes_what_it_names_and_the_command_line_goes_before_it() {
        let (_file, mut args) = with_file(
            "{ // zenoh's own words\n connect: { endpoints: ['tls/a:1'] }, transport: { auth: { usrpwd: { user: 'u', password: 'p' } } } }",
        );
        let config = merged(&args, Part::Guest).expect("a configuration");
        assert_eq!(config["connect"]["endpoints"], json!(["tls/a:1"]));
        assert_eq!(config["transport"]["auth"]["usrpwd"]["user"], json!("u"));
        assert_eq!(
            config["transport"]["shared_memory"]["enabled"],
            json!(false),
            "not named in the file"
        );
        assert_eq!(
            config["scouting"]["multicast"]["enabled"],
            json!(false),
            "not named in the file"
        );
        args.connect = vec!["tcp/b:2".into()];
        let config = merged(&args, Part::Guest).expect("a configuration");
        assert_eq!(config["connect"]["endpoints"], json!(["tcp/b:2"]));
        assert!(Config::from_json5(&config.to_string()).is_ok(), "zenoh understands it");
    }

    #[test]
    fn fault_a_file_that_is_none_of_zenohs_is_refused_with_its_name() {
        let stop = AtomicBool::new(false);
        for text in [
            "[]",
            "{ mode: ",
            "{ connect: 7 }",
            "{ no_such_key: 1 }",
            "{ listen: { endpoints: { peer: ['udp/127.0.0.1:7447'] } } }",
            "{ transport: { link: { tls: { root_ca_certificate: '/nowhere/ca.pem' } } } }",
            "{ transport: { auth: { usrpwd: { dictionary_file: '/nowhere/users' } } } }",
            "{ transport: { auth: { usrpwd: { user: 'floor' } } } }",
            "{ mode: 'client', listen: { endpoints: ['tcp/127.0.0.1:0'] } }",
            // What zenoh refuses at an attempt to connect, and would refuse at each.
            "{ access_control: { enabled: true, default_permission: 'deny',
                rules: [{ id: 'r', permission: 'allow', messages: ['put'], key_exprs: ['**'] }],
                subjects: [{ id: 's', usernames: ['v'] }], policies: [{ rules: ['no such rule'], subjects: ['s'] }] } }",
        ] {
            let (file, args) = with_file(text);
            let error = open(&args, Part::Guest, &stop).expect_err("refused");
            let name = file.path().display().to_string();
            assert!(error.to_string().contains(&name) && error.is_usage(), "{error}");
        }
        let args = NetworkArgs {
            config: Some("/nowhere/zenoh.json5".into()),
            ..NetworkArgs::default()
        };
        assert!(open(&args, Part::Guest, &stop).expect_err("missing").is_usage());
    }

    #[test]
    fn fault_a_list_of_users_that_is_none_is_refused_at_once_by_either_end() {
        let (users, _) = with_file("floor without a password\n");
        let users = users.path().display();
        let (_file, args) = with_file(&format!(
            "{{ transport: {{ auth: {{ usrpwd: {{ user: 'a', password: 'b', dictionary_file: '{users}' }} }} }} }}"
        ));
        for part in [Part::Guest, Part::Host] {
            let error = open(&args, part, &AtomicBool::new(false)).expect_err("refused");
            assert!(
                error.to_string().contains("dictionary file: invalid format") && error.is_usage(),
                "{error}"
            );
        }
    }

    #[test]
    fn fault_endpoints_that_are_none_are_refused_with_what_was_expected() {
        for good in [
            LOOPBACK,
            "tls/router.example:7447",
            "tcp/[::1]:0",
            "tcp/10.0.0.4:7447#iface=eth0",
        ] {
            assert_eq!(endpoint(good).as_deref(), Ok(good));
        }
        for wrong in [
            "",
            "nonsense",
            "127.0.0.1:7447",
            "tcp/",
            "tcp/127.0.0.1",
            "tcp/:7447",
            "tcp/127.0.0.1:",
            "tcp/127.0.0.1:99999",
            "tcp/::1:7447",
            "tcp/[]:7447",
            "udp/127.0.0.1:7447",
            "tcp//a:1",
            "tcp/a:1,tcp/b:2",
        ] {
            let error = endpoint(wrong).expect_err(wrong);
            assert!(
                error.contains("tcp/ADDRESS:PORT") && error.contains(LOOPBACK),
                "{error}"
            );
        }
    }
}
