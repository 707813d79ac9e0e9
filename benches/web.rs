//! Cost of the web server: `cargo bench --bench web`.
//!
//! A patrolling simulated robot, its web server without viewers, with 20 pages of the diagnostic center, each of which
//! also watches a channel, and with 20 viewers of Foxglove that subscribe to everything at full rate: CPU time and
//! memory of the server's process, and the data received by the viewers. Goals: 10 % of a core, 15 MB.

#[path = "../advee/tests/support/page.rs"]
mod page;
#[path = "../advee/tests/support.rs"]
mod support;

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};
use support::Robot;

const VIEWERS: usize = 20;
const MEASURED: Duration = Duration::from_secs(20);

fn main() {
    let at = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free address");
    let mut robot = Robot::ready(&["--http", &at.to_string(), "--set", "world.people=20"]);
    let sent = robot.advee(&["goal", "--route", "patrol"]);
    assert!(sent.status.success(), "{}", String::from_utf8_lossy(&sent.stderr));
    robot.pass(5.0);
    let pid = robot.view.pid("web") as u32;
    let alone = measure(&mut robot, pid);
    println!("nobody looks:  {:5.2} % of a core, {:.1} MB PSS", alone.0, alone.1);
    crowd(&mut robot, pid, at, "pages", page_of);
    // Their places are free again.
    robot.pass(1.0);
    crowd(&mut robot, pid, at, "viewers of Foxglove", look);
    println!("{}", health(at));
}

/// Measures with twenty viewers of a kind.
fn crowd(robot: &mut Robot, pid: u32, at: SocketAddr, kind: &str, look: fn(SocketAddr, &AtomicBool, &[AtomicU64; 2])) {
    let (end, counts) = (Arc::new(AtomicBool::new(false)), Arc::new([AtomicU64::new(0), AtomicU64::new(0)]));
    let viewers: Vec<_> = (0..VIEWERS)
        .map(|_| {
            let (end, counts) = (end.clone(), counts.clone());
            std::thread::spawn(move || look(at, &end, &counts))
        })
        .collect();
    robot.pass(3.0);
    let before = counts.each_ref().map(|count| count.load(Relaxed));
    let begin = Instant::now();
    let looked_at = measure(robot, pid);
    let seconds = begin.elapsed().as_secs_f64();
    let [messages, bytes] = counts.each_ref().map(|count| count.load(Relaxed));
    println!("{VIEWERS} {kind}: {:5.2} % of a core, {:.1} MB PSS", looked_at.0, looked_at.1);
    println!(
        "  each of them: {:.0} messages/s, {:.0} kB/s",
        (messages - before[0]) as f64 / seconds / VIEWERS as f64,
        (bytes - before[1]) as f64 / 1e3 / seconds / VIEWERS as f64
    );
    end.store(true, Relaxed);
    for viewer in viewers {
        viewer.join().expect("a viewer that looks to the end");
    }
}

/// Percent of a core over a while, and MB.
fn measure(robot: &mut Robot, pid: u32) -> (f64, f64) {
    let (before, begin) = (cpu_ticks(pid), Instant::now());
    robot.pass(MEASURED.as_secs_f64());
    let used = (cpu_ticks(pid) - before) as f64 / ticks_per_second() / begin.elapsed().as_secs_f64();
    (100.0 * used, pss_kib(pid) as f64 / 1024.0)
}

/// Page of the diagnostic center that watches a channel; counts parts and bytes.
fn page_of(at: SocketAddr, end: &AtomicBool, counts: &[AtomicU64; 2]) {
    let mut socket = page::Socket::open(at, "/ws/view", "").expect("a seat");
    socket.say(r#"{"watch":["ML_DATA_ESTIMATE"]}"#);
    while !end.load(Relaxed) {
        if let Some(page::Frame::Text(text)) = socket.frame() {
            counts[0].fetch_add(1, Relaxed);
            counts[1].fetch_add(text.len() as u64, Relaxed);
        }
    }
}

/// Viewer that subscribes to everything and counts messages and bytes.
fn look(at: SocketAddr, end: &AtomicBool, counts: &[AtomicU64; 2]) {
    let mut line = TcpStream::connect(at).expect("the server is there");
    line.write_all(
        b"GET /foxglove HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
        Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n",
    )
    .expect("it hears");
    let mut read = BufReader::with_capacity(1 << 16, line.try_clone().expect("a descriptor"));
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        read.read_exact(&mut byte).expect("it answers");
        head.push(byte[0]);
    }
    assert!(head.starts_with(b"HTTP/1.1 101"), "{}", String::from_utf8_lossy(&head));
    let mut asked = BTreeSet::new();
    while !end.load(Relaxed) {
        let (opcode, frame) = frame(&mut read);
        match opcode {
            1 => subscribe(&mut line, &frame, &mut asked),
            2 if frame[0] == 1 => {
                counts[0].fetch_add(1, Relaxed);
                counts[1].fetch_add(frame.len() as u64, Relaxed);
            }
            _ => {}
        }
    }
}

/// Opcode and payload of an unmasked frame (RFC 6455, 5.2).
fn frame(read: &mut impl Read) -> (u8, Vec<u8>) {
    let mut head = [0; 2];
    read.read_exact(&mut head).expect("a frame");
    let mut length = [0; 8];
    let wide = match head[1] {
        126 => 2,
        127 => 8,
        short => {
            length[7] = short;
            0
        }
    };
    read.read_exact(&mut length[8 - wide..]).expect("a frame");
    let mut payload = vec![0; u64::from_be_bytes(length) as usize];
    read.read_exact(&mut payload).expect("a frame");
    (head[0] & 15, payload)
}

/// Subscribes to every channel of an advertisement.
fn subscribe(line: &mut TcpStream, text: &[u8], asked: &mut BTreeSet<u64>) {
    let message: serde_json::Value = serde_json::from_slice(text).expect("JSON");
    let channels = message["channels"].as_array().into_iter().flatten().filter_map(|channel| channel["id"].as_u64());
    let new: Vec<_> = channels.filter(|id| asked.insert(*id)).collect();
    if new.is_empty() {
        return;
    }
    let wanted: Vec<_> = new.iter().map(|id| serde_json::json!({ "id": id, "channelId": id })).collect();
    let text = serde_json::json!({ "op": "subscribe", "subscriptions": wanted }).to_string();
    let mut bytes = vec![0x81, 0x80 | 126];
    bytes.extend(u16::try_from(text.len()).expect("some hundred channels").to_be_bytes());
    // Masked with zeros.
    bytes.extend([0; 4]);
    bytes.extend(text.as_bytes());
    line.write_all(&bytes).expect("it hears");
}

fn health(at: SocketAddr) -> String {
    let mut line = TcpStream::connect(at).expect("the server is there");
    line.write_all(b"GET /health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").expect("it hears");
    let mut text = String::new();
    line.read_to_string(&mut text).expect("it answers");
    text.split_once("\r\n\r\n").map(|(_, body)| body.into()).unwrap_or(text)
}

fn pss_kib(pid: u32) -> u64 {
    let text = fs::read_to_string(format!("/proc/{pid}/smaps_rollup")).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("Pss:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0)
}

/// User and system time, in clock ticks (proc(5), stat, fields 14 and 15).
fn cpu_ticks(pid: u32) -> u64 {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let after_name = text.rsplit(')').next().unwrap_or_default();
    after_name.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum()
}

fn ticks_per_second() -> f64 {
    let ticks = nix::unistd::sysconf(nix::unistd::SysconfVar::CLK_TCK).ok().flatten();
    ticks.unwrap_or(100) as f64
}
