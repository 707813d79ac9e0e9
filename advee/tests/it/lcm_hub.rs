//! `advee lcm hub` as used from the shell, with two clients of this project.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lcm::live::Lcm;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Timeout.
const PATIENCE: Duration = Duration::from_secs(20);

/// Process, ended with the test.
struct Hub(Child);

impl Drop for Hub {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn hub(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_advee"));
    command.args(["lcm", "hub"]).args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn the_hub_prints_its_address_its_clients_and_its_counts() {
    let mut hub = Hub(hub(&["127.0.0.1:0", "--json"]).spawn().unwrap());
    let mut stdout = BufReader::new(hub.0.stdout.take().unwrap()).lines();
    let mut stderr = BufReader::new(hub.0.stderr.take().unwrap()).lines();
    let listening: Value = serde_json::from_str(&stdout.next().unwrap().unwrap()).unwrap();
    let url = lcm::Url::parse(listening["listening"].as_str().unwrap()).unwrap().0;
    let [mut one, mut other] = [(); 2].map(|()| Lcm::new(&url).unwrap());
    other.subscribe("A").unwrap();
    let until = Instant::now() + PATIENCE;
    // Until the subscription is known; each is counted.
    let mut published = 0;
    while other.recv_timeout(Duration::from_millis(20)).unwrap().is_none() {
        assert!(Instant::now() < until);
        published += u64::from(one.publish("A", b"payload").is_ok());
        one.recv().unwrap();
    }
    for client in 0..2 {
        let line = stderr.next().unwrap().unwrap();
        assert!(line.starts_with(&format!("client {client} (127.0.0.1:")) && line.ends_with("): connected"), "{line}");
    }
    drop((one, other));
    for _ in 0..2 {
        let line = stderr.next().unwrap().unwrap();
        assert!(line.contains("): gone; "), "{line}");
    }
    let pid = nix::unistd::Pid::from_raw(hub.0.id() as i32);
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGINT).unwrap();
    let end: Value = serde_json::from_str(&stdout.next().unwrap().unwrap()).unwrap();
    assert_eq!((&end["clients"], &end["published"]), (&json!(2), &json!(published)));
    assert!(end["delivered"].as_u64().unwrap() >= 1);
    assert_eq!(hub.0.wait().unwrap().code(), Some(0));
}

#[test]
fn the_hub_ends_after_its_time_and_names_an_address_it_cannot_use() {
    let output = hub(&["127.0.0.1:0", "--for", "0.05"]).output().unwrap();
    assert!(output.status.success());
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.starts_with("listening at tcpq://127.0.0.1:"), "{said}");
    assert!(said.ends_with("\n0 clients, 0 messages from them, 0 to them, 0 dropped\n"), "{said}");
    let mut refused = Hub(hub(&["192.0.2.1:7700"]).spawn().unwrap());
    let mut said = String::new();
    refused.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(
        said.starts_with("advee: LCM hub: cannot listen at 192.0.2.1:7700: ") && said.lines().count() == 1,
        "{said}"
    );
    assert_eq!(refused.0.wait().unwrap().code(), Some(1));
}
