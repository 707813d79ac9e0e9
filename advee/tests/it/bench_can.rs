//! `advee bench can` as used from the shell, on a bus over UDP.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{advee, can_port};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

fn bench(one: u16, other: u16) -> (Output, Value) {
    let [one, other] = [one, other].map(|port| format!("udp:239.74.163.2:{port}"));
    let mut command = advee("memq://", Path::new("run"));
    let output = command.args(["bench", "can", &one, &other, "--frames", "300", "--json"]).output().unwrap();
    let report = serde_json::from_slice(&output.stdout).unwrap();
    (output, report)
}

#[test]
fn each_frame_is_received_once_and_in_order_and_none_without_a_bus() {
    let (port, elsewhere) = (can_port(), can_port());
    for (other, lost) in [(port, false), (elsewhere, true)] {
        let (output, report) = bench(port, other);
        assert_eq!(output.status.success(), !lost, "{report}");
        let ways = report["ways"].as_array().unwrap();
        let sent: Vec<u64> = ways.iter().map(|way| way["frames"].as_u64().unwrap()).collect();
        assert_eq!(sent, [300, 300, 600]);
        for way in ways {
            assert_eq!(way["lost"], if lost { way["frames"].clone() } else { 0.into() }, "{report}");
            assert_eq!(
                (way["out_of_order"].as_u64(), way["frames_per_s"].as_f64() > Some(0.0)),
                (Some(0), !lost),
                "{report}"
            );
        }
    }
}
