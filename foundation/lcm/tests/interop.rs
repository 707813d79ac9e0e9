//! Both ways with the official LCM, the Python package `lcm`. `make test` installs it into `.venv`; the variable
//! `ADVEE_PYTHON` names another Python.
#![cfg(feature = "live")]
#![allow(clippy::disallowed_methods, reason = "real sockets and processes")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

mod common;

use lcm::live::Lcm;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const COUNT: usize = 200;

/// Message `n` of the series: sizes from 0 to 60000, all byte values.
fn message(n: usize) -> (String, Vec<u8>) {
    let size = 60_000 * n / (COUNT - 1);
    (format!("PEER_{}", n % 7), (0..size).map(|i| (i + n + i / 256) as u8).collect())
}

/// A Python that has the official LCM; prints and gives `None` where there is none, unless one was named.
fn python() -> Option<PathBuf> {
    let named = std::env::var_os("ADVEE_PYTHON");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let python = named.as_ref().map_or_else(|| root.join(".venv/bin/python"), PathBuf::from);
    let found = Command::new(&python).args(["-c", "import lcm"]).output();
    if found.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    assert!(named.is_none(), "ADVEE_PYTHON has no official lcm");
    println!("skipped: no official lcm (make test makes it)");
    None
}

/// A script of `tests/peers` as a process, ended with the test.
struct Peer(Child);

impl Peer {
    fn start(python: &Path, script: &str, arguments: &[&str]) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(script);
        let mut command = Command::new(python);
        command.arg(script).args(arguments);
        Self(command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_official_subscriber_receives_exactly_what_we_publish() {
    let Some(python) = python() else { return };
    let url = common::url();
    let mut peer = Peer::start(&python, "subscriber.py", &[&url.to_string(), "PEER_.*", &COUNT.to_string()]);
    let mut out = BufReader::new(peer.0.stdout.take().unwrap());
    let mut ready = String::new();
    out.read_line(&mut ready).unwrap();
    assert_eq!(ready, "ready\n");
    let mut lcm = Lcm::new(&url.clone().into()).unwrap();
    for n in 0..COUNT {
        let (channel, payload) = message(n);
        lcm.publish("OTHER", b"not for the peer").unwrap();
        lcm.publish(&channel, &payload).unwrap();
        let mut lengths = [[0; 4]; 2];
        out.read_exact(lengths.as_flattened_mut()).unwrap();
        let [channel_len, payload_len] = lengths.map(|length| u32::from_be_bytes(length) as usize);
        assert_eq!((channel_len, payload_len), (channel.len(), payload.len()));
        let mut got = vec![0; channel_len + payload_len];
        out.read_exact(&mut got).unwrap();
        assert!(got == [channel.as_bytes(), &payload].concat(), "message {n} differs");
    }
    assert!(peer.0.wait().unwrap().success());
}

#[test]
fn we_receive_exactly_what_the_official_publisher_sends() {
    let Some(python) = python() else { return };
    let url = common::url();
    let mut lcm = Lcm::new(&url.clone().into()).unwrap();
    lcm.subscribe("PEER_.*").unwrap();
    let mut peer = Peer::start(&python, "publisher.py", &[&url.to_string()]);
    let mut go = peer.0.stdin.take().unwrap();
    for n in 0..COUNT {
        go.write_all(b"\n").unwrap();
        assert!(lcm.wait(Duration::from_secs(10)).unwrap(), "message {n} did not come");
        let received = lcm.recv().unwrap().expect("a wanted message");
        let (channel, payload) = message(n);
        assert_eq!(received.channel, channel);
        assert!(received.payload == payload, "message {n} differs");
    }
    drop(go);
    assert!(peer.0.wait().unwrap().success());
    let stats = lcm.stats();
    assert_eq!((stats.received, stats.malformed, stats.lost), (COUNT as u64, 0, 0));
}
