//! Views of a running system: the page for a browser and for badly behaved clients, the table and
//! the lines of `watch`.

use crate::peers::permitted;
use crate::support::{Process, Program, QUICK, Site, WATCHDOG, column, eventually};
use nix::sys::signal::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::time::Duration;
use thetabus::bus::{Bus, Subscriber};
use thetabus::messages::{Estimate, status_flags};

/// Exact signals and the estimator that notices changes.
pub const BEST: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/cedro2022_best.toml");

/// Where a monitor serves its page: address and token.
pub fn page_of(monitor: &Process) -> (String, String) {
    let url = eventually("the monitor names its page", || {
        let said = monitor.stderr();
        let line = said.lines().find_map(|line| line.split_once("see it live at http://"));
        line.map(|(_, url)| url.to_owned())
    });
    let (address, rest) = url.split_once('/').expect("a path");
    let token = rest.strip_prefix("?token=").unwrap_or("");
    (address.to_owned(), token.to_owned())
}

/// Sends a request, with `Host` unless another one is among the headers.
fn send(address: &str, request: &str, headers: &[(&str, &str)], body: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).expect("the page is served");
    stream.set_read_timeout(Some(WATCHDOG)).expect("a time");
    let mut text = format!("{request} HTTP/1.1\r\n");
    if !headers.iter().any(|(name, _)| *name == "Host") {
        text.push_str(&format!("Host: {address}\r\n"));
    }
    for (name, value) in headers {
        text.push_str(&format!("{name}: {value}\r\n"));
    }
    text.push_str(&format!("Content-Length: {}\r\n\r\n{body}", body.len()));
    stream.write_all(text.as_bytes()).expect("it is sent");
    stream
}

/// Status code and the whole answer.
fn ask(address: &str, request: &str, headers: &[(&str, &str)], body: &str) -> (u32, String) {
    let mut answer = String::new();
    let _ = send(address, request, headers, body).read_to_string(&mut answer);
    let code = answer.split_whitespace().nth(1).and_then(|code| code.parse().ok());
    (code.unwrap_or(0), answer)
}

/// The stream of events, as a browser reads it.
pub struct Events(BufReader<TcpStream>);

impl Events {
    pub fn open(address: &str) -> Self {
        Self(BufReader::new(send(address, "GET /events", &[], "")))
    }

    /// Reads the next event and leaves it.
    pub fn skip(&mut self) {
        let mut line = String::new();
        while !line.starts_with("data: ") {
            line.clear();
            assert!(
                self.0.read_line(&mut line).expect("it goes on") > 0,
                "the stream has ended"
            );
        }
    }

    /// Name and data of the next event.
    fn next(&mut self) -> (String, Value) {
        let mut name = String::new();
        loop {
            let mut line = String::new();
            assert!(
                self.0.read_line(&mut line).expect("it goes on") > 0,
                "the stream has ended"
            );
            if let Some(event) = line.strip_prefix("event: ") {
                name = event.trim().to_owned();
            } else if let Some(data) = line.strip_prefix("data: ") {
                return (name, serde_json::from_str(data.trim()).expect("JSON"));
            }
        }
    }

    /// The first view that is wanted.
    #[track_caller]
    fn view(&mut self, what: &str, mut wanted: impl FnMut(&Value) -> bool) -> Value {
        eventually(what, || {
            let (_, mut data) = self.next();
            Some(data["view"].take()).filter(|view| wanted(view))
        })
    }
}

fn identifier(site: &Site) -> Process {
    site.start(Program::Identifier, &[&QUICK[..], &["--config", BEST]].concat())
}

fn monitor(site: &Site, args: &[&str]) -> Process {
    site.start(Program::Monitor, &[&QUICK[..], &["--config", BEST], args].concat())
}

fn plant(site: &Site) -> Process {
    site.start(
        Program::Plant,
        &["--config", BEST, "--speed", "10", "--duration", "170"],
    )
}

/// Identifier, monitor with a page, plant at ten times the speed of life.
fn live(site: &Site, web: &[&str]) -> [Process; 3] {
    let identifier = identifier(site);
    let monitor = monitor(site, &[&["--web", "127.0.0.1:0"], web].concat());
    page_of(&monitor);
    let plant = plant(site);
    [identifier, monitor, plant]
}

#[test]
fn e2e_the_page_shows_what_is_on_the_bus_and_says_that_an_identifier_died() {
    let site = Site::new();
    let bus = Bus::join(&site.domain, "arm", "observer").expect("join");
    let mut estimates = Subscriber::<Estimate>::new(&bus).expect("subscribe");
    let mut published = BTreeMap::new();
    let [mut identifier, monitor, _plant] = live(&site, &[]);
    let (address, token) = page_of(&monitor);
    assert_eq!(token, "", "what is only shown on this machine needs no token");

    // The page and its parts are in the program, and load nothing from elsewhere.
    let mut bytes = 0;
    for path in ["/", "/page.js", "/page.css", "/uplot.js", "/uplot.css"] {
        let (code, text) = ask(&address, &format!("GET {path}"), &[], "");
        assert_eq!(code, 200, "{path}");
        let elsewhere = ["src=\"http", "href=\"http", "url(http", "@import", "import("];
        assert!(!elsewhere.iter().any(|foreign| text.contains(foreign)), "{path}");
        bytes += text.len();
    }
    assert!(bytes < 150_000, "{bytes} bytes");

    let mut events = Events::open(&address);
    let (first, data) = events.next();
    assert_eq!((first.as_str(), &data["control"]), ("whole", &Value::Bool(false)));
    assert_eq!(data["about"]["domain"], site.domain.name());
    let mut compared = 0;
    // A jump at 45 s is found and marked on the way.
    let view = events.view("the jump is marked", |view| {
        estimates.drain(|e| _ = published.insert(e.block, *e)).expect("drain");
        let block = view["block"].as_u64().expect("a block");
        if let Some(estimate) = published.get(&block) {
            let rows = view["rows"].as_array().expect("rows");
            for (i, row) in rows.iter().enumerate().take(9) {
                assert_eq!(row["value"].as_f64(), Some(estimate.theta[i]), "block {block}, {row}");
                assert_eq!(row["usable"], estimate.is_usable(i));
            }
            compared += 1;
        }
        view["changes"].as_array().is_some_and(|changes| !changes.is_empty())
    });
    assert!(compared >= 10, "{compared}");
    // Bounds as the configuration has them, and the input of each joint beside the one that was
    // predicted.
    let (_, whole) = Events::open(&address).next();
    assert_eq!(
        (&whole["predicts"], &whole["quantities"][0]["lower"]),
        (&Value::Bool(true), &0.0.into())
    );
    let rows = whole["signals"].as_array().expect("rows");
    let pairs = rows.iter().filter_map(|row| Some((row[3].as_f64()?, row[4].as_f64()?)));
    let (mut difference, mut size, mut count) = (0.0, 0.0, 0);
    for (measured, predicted) in pairs {
        difference += (measured - predicted).powi(2);
        size += measured * measured;
        count += 1;
    }
    // 40 points a second. Signals are exact, so that only the change of 20 kg in 150, not yet
    // learnt, can be seen.
    assert!(
        count > 100 && difference < 0.04 * size,
        "{count} points: {difference} of {size}"
    );
    let change_s = view["changes"][0].as_f64().expect("a time");
    assert!((change_s - 45.0).abs() < 0.2, "{change_s}");
    let told = events.view("the page states the jump in words", |view| {
        view["headline"]
            .as_str()
            .is_some_and(|words| words.contains("changed from"))
    });
    let words = told["headline"].as_str().expect("words");
    assert!(
        words.starts_with("mass_2: 1") && words.contains(" kg, changed from 150"),
        "{words}"
    );

    identifier.signal(Signal::SIGKILL);
    identifier.wait();
    let dead = events.view("the page reports that the identifier is gone", |view| {
        view["alive"] == false
    });
    assert!(
        dead["words"].as_str().is_some_and(|words| words.contains("silent for")),
        "{dead}"
    );
    assert!(dead["rows"][0]["value"].is_f64(), "the last values stay");
    let _second = self::identifier(&site);
    let block = dead["block"].as_u64().expect("a block");
    events.view("the next one is shown", |view| {
        view["alive"] == true && view["block"].as_u64() > Some(block)
    });
}

#[test]
fn fault_only_the_own_page_with_its_token_can_pause_a_robot() {
    let site = Site::new();
    let [_identifier, monitor, _plant] = live(&site, &["--web-control"]);
    let (address, token) = page_of(&monitor);
    let mut observer = site.observer();
    observer.status("it runs", |s| s.accepted > 0);
    let path = format!("POST /control?token={token}");
    let json = ("Content-Type", "application/json");
    let pause = r#"{"command":"pause"}"#;
    let own = format!("http://{address}");
    for (request, headers, code) in [
        ("POST /control", &[json][..], 403),
        ("POST /control?token=0123456789abcdef0123456789abcdef", &[json], 403),
        (&path, &[json, ("Origin", "http://evil.example")], 403),
        (&path, &[json, ("Origin", "null")], 403),
        (&path, &[json, ("Host", "evil.example")], 403),
        // What a form of another page can send without asking.
        (&path, &[("Content-Type", "text/plain")], 415),
        (&path, &[("Content-Type", "application/x-www-form-urlencoded")], 415),
        (&path.replace("POST", "GET"), &[json], 405),
    ] {
        let (got, answer) = ask(&address, request, headers, pause);
        assert_eq!(got, code, "{request} {headers:?}: {answer}");
    }
    for (body, code) in [("{}", 409), (r#"{"command":"restore"}"#, 409), (&"x".repeat(5000), 400)] {
        assert_eq!(ask(&address, &path, &[json], body).0, code, "{body:.40}");
    }
    observer.look();
    assert_eq!(
        observer
            .last_status
            .map(|s| (s.flags & status_flags::PAUSED, s.process.commands)),
        Some((0, 0))
    );

    let headers = [json, ("Origin", own.as_str())];
    let (code, answer) = ask(&address, &path, &headers, pause);
    assert_eq!(code, 200, "{answer}");
    observer.status("it is paused", |s| s.flags & status_flags::PAUSED != 0);
    let fix = r#"{"command":"fix","name":"theta_3","value":4.5}"#;
    assert_eq!(ask(&address, &path, &headers, r#"{"command":"resume"}"#).0, 200);
    assert_eq!(ask(&address, &path, &headers, fix).0, 200);
    observer.estimate("theta_3 is held", |e| e.theta[2] == 4.5);
    let (code, answer) = ask(&address, &path, &headers, r#"{"command":"free","name":"nobody"}"#);
    assert!(code == 409 && answer.contains("expected a parameter"), "{answer}");

    // Without --web-control there are no controls, with any token.
    let second = self::monitor(&site, &["--web", "127.0.0.1:0"]);
    let (address, _) = page_of(&second);
    assert_eq!(ask(&address, &path, &[json], pause).0, 404);
}

#[test]
fn fault_an_address_of_the_network_needs_the_token_to_show_anything() {
    let site = Site::new();
    let monitor = monitor(&site, &["--web", "0.0.0.0:0"]);
    let (address, token) = page_of(&monitor);
    let address = address.replace("0.0.0.0", "127.0.0.1");
    for path in ["/", "/events", "/?token=", "/events?token=1"] {
        assert_eq!(ask(&address, &format!("GET {path}"), &[], "").0, 403, "{path}");
    }
    assert_eq!(
        ask(&address, &format!("GET /?token={token}"), &[("Host", "robot.lab")], "").0,
        200
    );
    // The same port again is refused in words.
    let taken = address.clone();
    let mut second = self::monitor(&site, &["--web", &taken]);
    second.expect_code(2);
    second.expect_stderr(&["--web", "the port is in use"]);
}

/// Memory of a process [bytes].
fn resident(process: &Process) -> u64 {
    let statm = std::fs::read_to_string(format!("/proc/{}/statm", process.pid())).expect("it lives");
    let pages: u64 = statm
        .split_whitespace()
        .nth(1)
        .and_then(|p| p.parse().ok())
        .expect("a number");
    pages * 4096
}

#[test]
fn fault_two_hundred_rude_clients_neither_stop_a_monitor_nor_grow_its_memory() {
    let site = Site::new();
    let [_identifier, mut monitor, _plant] = live(&site, &[]);
    let (address, _) = page_of(&monitor);
    let mut polite = Events::open(&address);
    polite.view("estimates come", |view| view["block"].as_u64() > Some(5));
    let before = resident(&monitor);
    let connect = || TcpStream::connect(&address).expect("the system takes them");
    let mut rude = Vec::new();
    for kind in 0..200 {
        let mut stream = connect();
        stream.set_nonblocking(true).expect("it can");
        let _ = match kind % 4 {
            // Says nothing.
            0 => Ok(()),
            // Begins and does not end.
            1 => stream.write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\nX-"),
            // A head without end; what the system does not take at once is left.
            2 => stream.write_all(&[b'x'; 1 << 20]),
            // Listens and never reads.
            _ => stream.write_all(format!("GET /events HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()),
        };
        rude.push(stream);
    }
    // It goes on for the one who was there before, through ten seconds in which the rude ones hold
    // on.
    let (_, now) = polite.next();
    let block = now["view"]["block"].as_u64().expect("a block");
    polite.view("a hundred blocks more", |view| {
        view["block"].as_u64() > Some(block + 100)
    });
    // 128 connections with a buffer or two each: a megabyte; the rest is room for the allocator.
    let after = resident(&monitor);
    assert!(after < before + 40_000_000, "{before} bytes became {after}");
    // Whoever says nothing is cut off, so that there is room again although nobody left.
    eventually("a new browser is served", || {
        let mut stream = TcpStream::connect(&address).ok()?;
        stream.set_read_timeout(Some(Duration::from_secs(2))).expect("a time");
        stream
            .write_all(format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes())
            .ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        answer.starts_with("HTTP/1.1 200").then_some(())
    });
    assert!(monitor.is_running());
    drop(rude);
}

/// The value of an attribute behind a place in a page.
fn attribute<'a>(html: &'a str, card: &str, name: &str) -> Option<&'a str> {
    let tag = html.find(&format!("data-name=\"{card}\"")).map(|at| &html[at..])?;
    let tag = &tag[..tag.find('>')?];
    let (_, rest) = tag.split_once(&format!(" {name}=\""))?;
    rest.split('"').next()
}

/// A page as a browser shows it after two seconds; on a busy machine it gets more.
fn shown(site: &Site, url: &str) -> String {
    let mut html = String::new();
    for timeout_ms in [2_000, 8_000, 30_000] {
        let profile = site.dir.path().join(format!("browser{timeout_ms}"));
        let output = Command::new("chromium")
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--window-size=390,844",
                "--dump-dom",
            ])
            .arg(format!("--timeout={timeout_ms}"))
            .arg(format!("--user-data-dir={}", profile.display()))
            .arg(url)
            .output()
            .expect("a browser");
        html = String::from_utf8_lossy(&output.stdout).into_owned();
        if html.contains("data-ready=\"yes\"") {
            return html;
        }
    }
    panic!("the page is not ready: {html:.3000}");
}

#[test]
fn e2e_a_browser_shows_a_change_a_death_and_a_return() {
    if !permitted("chromium", &["--version"]) {
        return;
    }
    let site = Site::new();
    let mut identifier = identifier(&site);
    let monitor = monitor(&site, &["--web", "127.0.0.1:0", "--web-control"]);
    let (address, token) = page_of(&monitor);
    let _plant = site.start(
        Program::Plant,
        &["--config", BEST, "--speed", "10", "--duration", "1000"],
    );
    let mut events = Events::open(&address);
    let url = format!("http://{address}/?token={token}");
    events.view("the page states the jump in words", |view| {
        view["headline"]
            .as_str()
            .is_some_and(|words| words.contains("changed from"))
    });
    let html = shown(&site, &url);
    assert!(
        html.contains("changed from 150") && html.contains("<b>1</b> change"),
        "{html:.3000}"
    );
    let block = |html: &str| attribute(html, "theta_1", "data-block").and_then(|text| text.parse::<u64>().ok());
    let first = block(&html).expect("a block");
    // Buttons only with the token.
    assert!(html.contains("<form id=\"control\">"), "{html:.3000}");
    let later = shown(&site, &format!("http://{address}/"));
    assert!(later.contains("<form id=\"control\" hidden=\"\">"), "{later:.3000}");
    assert!(block(&later) > Some(first), "the values go on");

    identifier.signal(Signal::SIGKILL);
    identifier.wait();
    Events::open(&address).view("the page reports that the identifier is gone", |view| {
        view["alive"] == false
    });
    let html = shown(&site, &url);
    assert!(
        html.contains("<b>no identifier</b>") && html.contains("silent for"),
        "{html:.3000}"
    );
    let last = block(&html).expect("the last values stay");
    let _second = self::identifier(&site);
    Events::open(&address).view("the next one is shown", |view| {
        view["alive"] == true && view["block"].as_u64() > Some(last)
    });
    let html = shown(&site, &url);
    assert!(
        !html.contains("<b>no identifier</b>") && block(&html) > Some(last),
        "{html:.3000}"
    );
}

#[test]
fn e2e_a_browser_shows_the_values_and_plots_of_a_run() {
    if !permitted("chromium", &["--version"]) {
        return;
    }
    let site = Site::new();
    let run = site.start_run(
        &[
            &[BEST],
            &QUICK[..],
            &["--speed", "10", "--duration", "1000", "--web", "127.0.0.1:0"],
        ]
        .concat(),
    );
    let (address, _) = page_of(&run);
    eventually("some blocks", || {
        let csv = std::fs::read_to_string(site.out().join("estimates.csv")).ok()?;
        (csv.lines().count() > 10).then_some(())
    });
    let html = shown(&site, &format!("http://{address}/"));
    // Each value is that of its block in the run's own file.
    let csv = site.out().join("estimates.csv");
    let blocks = column(&csv, "block");
    for name in ["theta_1", "theta_9"] {
        let number = |attr: &str| attribute(&html, name, attr).and_then(|text| text.parse::<f64>().ok());
        let block = number("data-block").expect("a block");
        let index = blocks.iter().position(|b| *b == block).expect("a block of the run");
        assert_eq!(
            number("data-value"),
            Some(column(&csv, name)[index]),
            "{name}, block {block}"
        );
    }
    // The plots on the first screen are drawn, with a canvas each.
    assert!(html.matches("<canvas").count() >= 2, "{html:.3000}");
    assert!(html.contains("usable"));
}

#[test]
fn e2e_watch_writes_one_readable_line_per_block_where_there_is_no_terminal() {
    let site = Site::new();
    let _identifier = identifier(&site);
    let watch = site.start(Program::Thetabus, &["watch", "--config", BEST]);
    let _plant = plant(&site);
    eventually("lines", || (watch.stdout().lines().count() > 20).then_some(()));
    for line in watch.stdout().lines() {
        assert!(line.starts_with("block ") && line.contains(" usable"), "{line}");
        // 150 columns of values, and why a model does not fit.
        assert!(line.chars().count() <= 270 && !line.contains('\x1b'), "{line}");
    }
}

#[test]
fn e2e_watch_gives_the_terminal_back_on_a_key_and_on_a_signal() {
    // From util-linux: gives a program a terminal.
    if !permitted("script", &["--version"]) {
        return;
    }
    let site = Site::new();
    let _identifier = identifier(&site);
    let _plant = plant(&site);
    for by_signal in [false, true] {
        let program = env!("CARGO_BIN_EXE_thetabus");
        let domain = site.domain.name();
        let watch = format!("{program} watch --config {} --domain {domain}", BEST);
        let line = format!("stty rows 24 cols 80; {watch}; echo code=$?; stty -a; echo every line");
        let mut child = Command::new("script")
            .args(["-qefc", &line, "/dev/null"])
            .env("TERM", "xterm")
            .env("SHELL", "/bin/sh")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("script");
        let mut keys = child.stdin.take().expect("piped");
        let stdout = child.stdout.take().expect("piped");
        let (send, seen) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let mut stdout = stdout;
            let mut bytes = [0; 4096];
            while let Ok(count) = stdout.read(&mut bytes) {
                if count == 0 || send.send(bytes[..count].to_vec()).is_err() {
                    break;
                }
            }
        });
        let mut shown = Vec::new();
        let mut look = || {
            shown.extend(seen.try_iter().flatten());
            String::from_utf8_lossy(&shown).into_owned()
        };
        eventually("the table", || look().contains("theta_9").then_some(()));
        assert!(look().contains("\x1b[?1049h"), "the screen is taken over");
        if by_signal {
            let pid = eventually("the process", || {
                site.processes().into_iter().find(|pid| {
                    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
                    line.starts_with(program.as_bytes()) && line.windows(6).any(|word| word == b"\0watch")
                })
            });
            let pid = nix::unistd::Pid::from_raw(pid.cast_signed());
            nix::sys::signal::kill(pid, Signal::SIGTERM).expect("it lives");
        } else {
            keys.write_all(b"q").expect("a terminal");
        }
        // What stty says comes in several pieces, so the end is a line of its own.
        let said = eventually("the end", || Some(look()).filter(|said| said.contains("every line")));
        let (_, after) = said.split_once("\x1b[?1049l").expect("the screen is given back");
        assert!(after.contains("code=0"), "{after}");
        assert!(after.contains(" icanon") && after.contains(" echo "), "{after}");
        let _ = child.wait();
    }
}
