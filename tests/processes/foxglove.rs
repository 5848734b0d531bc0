//! The stream for Foxglove, as a client of its protocol that shares no code with the server.

use crate::support::{Process, Program, QUICK, SERVO, Site, WATCHDOG, eventually};
use nix::sys::signal::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::TcpStream;
use thetabus::recording::{Encoder, Entry, RecordingReader, Span};

/// A WebSocket, as far as this test needs one (RFC 6455).
struct Socket(TcpStream);

impl Socket {
    fn open(address: &str) -> Self {
        let mut stream = TcpStream::connect(address).expect("the server listens");
        stream.set_read_timeout(Some(WATCHDOG)).expect("a time");
        let request = format!(
            "GET / HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).expect("it is sent");
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).expect("a head");
            head.extend(byte);
        }
        let head = String::from_utf8_lossy(&head);
        // The answer to that key in section 1.3 of the RFC.
        assert!(head.starts_with("HTTP/1.1 101"), "{head}");
        assert!(head.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{head}");
        Self(stream)
    }

    fn send(&mut self, text: &str) {
        assert!(text.len() < 126, "one short frame");
        let mut frame = vec![0x81, 0x80 | text.len() as u8, 0, 0, 0, 0];
        frame.extend(text.as_bytes());
        self.0.write_all(&frame).expect("it is sent");
    }

    /// Opcode and payload of the next frame.
    fn next(&mut self) -> (u8, Vec<u8>) {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).expect("a frame");
        let length = match head[1] & 0x7f {
            126 => {
                let mut bytes = [0; 2];
                self.0.read_exact(&mut bytes).expect("a length");
                u64::from(u16::from_be_bytes(bytes))
            }
            127 => {
                let mut bytes = [0; 8];
                self.0.read_exact(&mut bytes).expect("a length");
                u64::from_be_bytes(bytes)
            }
            short => u64::from(short),
        };
        let mut payload = vec![0; length as usize];
        self.0.read_exact(&mut payload).expect("a payload");
        (head[0] & 0x0f, payload)
    }
}

fn address_of(monitor: &Process) -> String {
    eventually("the monitor names its server", || {
        let said = monitor.stderr();
        let (_, rest) = said.split_once("connect Foxglove to ws://")?;
        Some(rest.lines().next()?.trim().to_owned())
    })
}

#[test]
fn e2e_a_client_of_the_foxglove_protocol_reads_what_the_recording_holds() {
    let site = Site::new();
    let path = site.dir.path().join("run.mcap");
    let servo = [&QUICK[..], &["--config", SERVO]].concat();
    let _identifier = site.start(Program::Identifier, &servo);
    let record = ["--record", path.to_str().expect("UTF-8"), "--foxglove", "127.0.0.1:0"];
    let mut monitor = site.start(Program::Monitor, &[&servo[..], &record].concat());
    let mut socket = Socket::open(&address_of(&monitor));
    let mut channels = BTreeMap::new();
    while channels.len() < 3 {
        let (opcode, payload) = socket.next();
        let Ok(message) = serde_json::from_slice::<Value>(&payload) else {
            panic!("expected text, got opcode {opcode}")
        };
        for channel in message["channels"].as_array().into_iter().flatten() {
            assert_eq!(
                (&channel["encoding"], &channel["schemaEncoding"]),
                (&"cdr".into(), &"ros2msg".into())
            );
            let topic = channel["topic"].as_str().expect("a topic").to_owned();
            channels.insert(topic, (channel["id"].clone(), channel["schema"].clone()));
        }
    }
    let (id, schema) = &channels["/thetabus/arm/estimate"];
    assert!(
        schema.as_str().is_some_and(|text| text.contains("float64 mass ")),
        "{schema}"
    );
    socket.send(&format!(
        r#"{{"op":"subscribe","subscriptions":[{{"id":7,"channelId":{id}}}]}}"#
    ));
    let _plant = site.start(Program::Plant, &["--config", SERVO, "--speed", "5", "--duration", "60"]);
    let mut received = Vec::new();
    while received.len() < 10 {
        let (opcode, payload) = socket.next();
        if opcode != 2 {
            continue;
        }
        // Message data: 1, the subscription, the time, the message.
        assert_eq!((payload[0], &payload[1..5]), (1, &7u32.to_le_bytes()[..]));
        let t_ns = u64::from_le_bytes(payload[5..13].try_into().expect("8 bytes"));
        received.push((t_ns, payload[13..].to_vec()));
    }
    monitor.signal(Signal::SIGTERM);
    monitor.expect_code(0);

    let mut reader = RecordingReader::open(&path, Span::default()).expect("a recording");
    let mut encoder = Encoder::new(reader.info()).expect("names");
    let mut recorded = BTreeMap::new();
    while let Some(entry) = reader.next_entry().expect("whole") {
        if let Entry::Estimate { estimate, .. } = entry {
            recorded.insert(estimate.t_last_ns, encoder.estimate(estimate).to_vec());
        }
    }
    for (t_ns, message) in &received {
        assert_eq!(recorded.get(t_ns), Some(message), "the estimate of {t_ns} ns");
    }
}

#[test]
fn fault_an_address_of_the_network_is_refused_unless_it_is_meant_to_be_open() {
    let site = Site::new();
    let everywhere = [&QUICK[..], &["--config", SERVO, "--foxglove", "0.0.0.0:0"]].concat();
    let mut refused = site.start(Program::Monitor, &everywhere);
    refused.expect_code(2);
    refused.expect_stderr(&["--foxglove 0.0.0.0:0", "no token", "ssh -L", "--foxglove-open"]);
    let mut run = site.start_run(&[SERVO, "--foxglove", "0.0.0.0:0"]);
    run.expect_code(2);
    run.expect_stderr(&["--foxglove-open"]);
    assert!(!site.out().exists(), "a run that is refused leaves nothing behind");
    let open = site.start(Program::Monitor, &[&everywhere[..], &["--foxglove-open"]].concat());
    let (_, port) = address_of(&open)
        .rsplit_once(':')
        .map(|(a, p)| (a.to_owned(), p.to_owned()))
        .expect("a port");
    Socket::open(&format!("127.0.0.1:{port}"));
}
