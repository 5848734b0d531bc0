//! Progress of a command: one updated line on a terminal, and nothing without a terminal.

use crate::peers::permitted;
use crate::support::Site;
use std::process::{Command, Stdio};

#[test]
fn e2e_identify_and_report_say_how_far_they_are_on_a_terminal_alone() {
    let site = Site::new();
    site.start_run(&["--speed", "max", "--duration", "19"]).expect_code(0);
    let out = site.out();
    let program = env!("CARGO_BIN_EXE_thetabus");
    let recording = out.to_str().expect("UTF-8");
    let into = |name: &str| site.dir.path().join(name).to_str().expect("UTF-8").to_owned();
    for (command, words) in [("identify", "identifying from "), ("report", "reading ")] {
        let piped = Command::new(program)
            .args([command, recording, "--out", &into(&format!("{command}-1"))])
            .output()
            .expect("it starts");
        let said = String::from_utf8_lossy(&piped.stderr);
        assert!(piped.status.success(), "{command}: {said}");
        assert!(
            !said.contains(['\r', '\x1b']) && !said.contains(words),
            "{command}: {said}"
        );
        // From util-linux: gives a program a terminal.
        if !permitted("script", &["--version"]) {
            continue;
        }
        let line = format!(
            "stty cols 60; {program} {command} {recording} --out {}",
            into(&format!("{command}-2"))
        );
        let output = Command::new("script")
            .args(["-qefc", &line, "/dev/null"])
            .env("TERM", "xterm")
            .env("SHELL", "/bin/sh")
            .stdin(Stdio::null())
            .output()
            .expect("script");
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{command}: {said}");
        assert!(said.contains(words), "{command}: {said}");
        // The line is taken away before the table, and none is as wide as the terminal.
        let (_, after) = said.rsplit_once("\r\x1b[K").expect("it is cleared");
        assert!(
            after.contains("theta_9") && !after.contains(words),
            "{command}: {after}"
        );
        for line in said.split(['\r', '\n']).filter(|line| line.contains(words)) {
            assert!(line.replace("\x1b[K", "").chars().count() < 60, "{command}: {line}");
        }
    }
}
