//! Time from the release of the pad until the zero leaves the web server: `cargo bench --bench web_command`.
//!
//! A simulated robot is driven over `/ws/command` and released a thousand times. Times: from before the page writes to
//! its socket until the server has made the message (its timestamp), and until it is received on the bus. Goal: 20 ms.

#[path = "../advee/tests/support/operator.rs"]
mod operator;
#[path = "../advee/tests/support.rs"]
mod support;

use messages::{Channel, Message};
use operator::{Page, post};
use serde_json::{Value, json};
use std::net::TcpListener;
use std::time::{Duration, Instant, SystemTime};
use support::Robot;

const TIMES: u64 = 1000;

fn main() {
    let at = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free address");
    let mut robot = Robot::ready(&["--http", &at.to_string()]);
    let told = robot.advee(&["web", "code", "--json"]);
    let codes: Value = serde_json::from_slice(&told.stdout).expect("codes");
    let cookie = post(at, "/api/pair", "", &json!({ "code": codes["operator"], "name": "bench" })).cookie();
    let mut page = Page::command(at, &cookie);
    page.ask(json!({ "type": "take", "from": null })).expect("nobody else is there");
    let (mut said, mut heard) = (Vec::new(), Vec::new());
    for hold in 1..=TIMES {
        page.drive(hold, 0.05, 0.0);
        until(&mut robot, |speed| speed > 0.0);
        std::thread::sleep(Duration::from_millis(20));
        let (begun, wall) = (Instant::now(), wall());
        page.zero(hold);
        let timestamp = until(&mut robot, |speed| speed == 0.0);
        heard.push(begun.elapsed().as_secs_f64() * 1e3);
        said.push((timestamp - wall) as f64 / 1e3);
        // Two further zeros follow.
        until(&mut robot, |speed| speed == 0.0);
        until(&mut robot, |speed| speed == 0.0);
    }
    for (what, times) in [("zero is made", &mut said), ("zero is heard on the bus", &mut heard)] {
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
        println!("{what}: p50 {:.2} ms, p99 {:.2} ms, worst of {TIMES} {:.2} ms", at(0.5), at(0.99), at(1.0));
    }
}

/// µs since the UNIX epoch.
fn wall() -> i64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970").as_micros() as i64
}

/// Timestamp of the next motion command that satisfies `is`.
fn until(robot: &mut Robot, is: impl Fn(f64) -> bool) -> i64 {
    let begun = Instant::now();
    loop {
        robot.bus.wait(Duration::from_millis(100)).expect("the bus can be waited for");
        while let Some(received) = robot.bus.recv().expect("the bus can be read") {
            if let Some(channel @ Channel::LlCmdMotion) = Channel::from_name(received.channel)
                && let Ok(Message::LlCmdMotion(motion)) = Message::decode(channel, received.payload)
                && is(motion.speed)
            {
                return motion.timestamp;
            }
        }
        assert!(begun.elapsed() < Duration::from_secs(5), "no such command");
    }
}
