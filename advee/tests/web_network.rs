//! Driving over a network that delays, stalls and breaks: in every case the zero leaves the server within 250 ms after
//! the last good command was sent, and the robot is commanded to stop within 300 ms.
//!
//! A TCP proxy between the page and the server behaves like a bad radio link. Each command has a distinct speed by
//! which it is identified on the bus; times are those in the senders' messages.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "support/operator.rs"]
mod operator;
mod support;

use messages::{Channel, Message};
use operator::{Page, Received, post};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::mpsc;
use std::time::{Duration, Instant, SystemTime};
use support::{Robot, View};

/// Treatment of data on its way to the server; TCP keeps the order.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Link {
    Good,
    /// Each piece is delayed by up to 200 ms.
    Jitter,
    /// Of 100 pieces 5 are lost, and are retransmitted after 200 to 400 ms; all following ones wait.
    Loss,
    /// No data arrives any more, without a notification.
    Cut,
    /// The connection is broken.
    Reset,
}

struct Proxy {
    at: SocketAddr,
    link: Arc<AtomicU64>,
    ends: Arc<AtomicBool>,
}

impl Proxy {
    fn before(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let at = listener.local_addr().unwrap();
        let (link, ends) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
        let (theirs, ended) = (link.clone(), ends.clone());
        std::thread::spawn(move || {
            for page in listener.incoming().flatten() {
                if ended.load(SeqCst) {
                    return;
                }
                let robot = TcpStream::connect(server).unwrap();
                [&page, &robot].into_iter().for_each(|side| side.set_nodelay(true).unwrap());
                let back = (robot.try_clone().unwrap(), page.try_clone().unwrap());
                let link = theirs.clone();
                std::thread::spawn(move || carry(page, robot, &link));
                std::thread::spawn(move || carry(back.0, back.1, &AtomicU64::new(0)));
            }
        });
        Self { at, link, ends }
    }

    fn set(&self, link: Link) {
        self.link.store(link as u64, SeqCst);
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.ends.store(true, SeqCst);
        let _ = TcpStream::connect(self.at);
    }
}

fn carry(mut from: TcpStream, mut to: TcpStream, link: &AtomicU64) {
    let (sender, pieces) = mpsc::channel::<(Instant, Vec<u8>)>();
    let writer = std::thread::spawn(move || {
        for (when, piece) in pieces {
            std::thread::sleep(when.saturating_duration_since(Instant::now()));
            if to.write_all(&piece).is_err() {
                break;
            }
        }
        let _ = to.shutdown(Shutdown::Both);
    });
    let (mut chance, mut free, mut buffer) = (0x1234_5678_9abc_def1_u64, Instant::now(), [0; 4096]);
    let mut below = |limit: u64| {
        chance ^= chance << 13;
        chance ^= chance >> 7;
        chance ^= chance << 17;
        chance % limit
    };
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        let link = link.load(SeqCst);
        let kept = match link {
            link if link == Link::Jitter as u64 => below(200),
            link if link == Link::Loss as u64 && below(100) < 5 => 200 + below(200),
            link if link == Link::Cut as u64 => continue,
            link if link == Link::Reset as u64 => break,
            _ => 0,
        };
        free = free.max(Instant::now() + Duration::from_millis(kept));
        if sender.send((free, buffer[..count].to_vec())).is_err() {
            break;
        }
    }
    drop(sender);
    let _ = from.shutdown(Shutdown::Both);
    let _ = writer.join();
}

/// µs since the UNIX epoch.
fn wall() -> i64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_micros() as i64
}

/// Messages received on the bus, with their timestamps.
#[derive(Default)]
struct Bus {
    commands: Vec<(i64, f64)>,
    targets: Vec<(i64, f64)>,
}

/// Receives in a separate thread until `ends` is set.
fn listen(url: &str, ends: Arc<AtomicBool>) -> std::thread::JoinHandle<Bus> {
    let mut lcm = support::listen(url);
    std::thread::spawn(move || {
        let mut bus = Bus::default();
        while !ends.load(SeqCst) {
            lcm.wait(Duration::from_millis(50)).unwrap();
            while let Some(received) = lcm.recv().unwrap() {
                let Some(channel @ (Channel::LlCmdMotion | Channel::LlDataMotion)) =
                    Channel::from_name(received.channel)
                else {
                    continue;
                };
                match Message::decode(channel, received.payload) {
                    Ok(Message::LlCmdMotion(motion)) => bus.commands.push((motion.timestamp, motion.speed)),
                    Ok(Message::LlDataMotion(motion)) => bus.targets.push((motion.timestamp, motion.speed_target)),
                    _ => {}
                }
            }
        }
        bus
    })
}

/// Page at the end of a link: it presses, drives, releases, or the link breaks; reconnects if necessary.
struct Hand {
    page: Page,
    at: SocketAddr,
    server: SocketAddr,
    cookie: String,
    hold: u64,
    /// Timestamp of each speed sent, µs since the UNIX epoch.
    said: BTreeMap<u64, i64>,
}

/// Identifies speeds by their micrometres per second.
fn key(speed: f64) -> u64 {
    (speed * 1e6).round() as u64
}

impl Hand {
    fn open(at: SocketAddr, server: SocketAddr, cookie: &str) -> Page {
        let headers = format!("Origin: http://{server}\r\nCookie: {cookie}\r\n");
        let mut page = Page::open(at, server, "/ws/command", &headers).expect("the socket opens");
        let begun = Instant::now();
        // The disconnected page may hold control a little longer.
        loop {
            let told = page.until("authority");
            let t = page.clock();
            page.send(&json!({ "type": "ping", "t": t }));
            let taken = page.ask(json!({ "type": "take", "from": told["holder"]["id"] }));
            if taken.is_ok() {
                return page;
            }
            assert!(begun.elapsed() < Duration::from_secs(5));
        }
    }

    fn drive(&mut self, commands: u32) {
        self.hold += 1;
        for _ in 0..commands {
            let speed = 0.1 + (self.said.len() + 1) as f64 * 1e-6;
            self.said.insert(key(speed), wall());
            self.page.drive(self.hold, speed, 0.0);
            let until = Instant::now() + Duration::from_millis(50);
            while let Some(left) = until.checked_duration_since(Instant::now()).filter(|left| !left.is_zero()) {
                match self.page.receive(left) {
                    // Like the page: a hold that has ended is released, and pressed anew.
                    Received::Message(message) if message["type"] == "ended" && message["hold"] == self.hold => {
                        self.hold += 1;
                    }
                    Received::Closed(..) => {
                        std::thread::sleep(left);
                        break;
                    }
                    _ => {}
                }
            }
        }
    }

    fn back(&mut self) {
        self.page = Self::open(self.at, self.server, &self.cookie);
        self.hold = 0;
    }
}

#[test]
fn whatever_the_network_does_the_robot_stops_in_time() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut robot = Robot::ready(&["--http", &server.to_string()]);
    robot.until("it may be driven", 20.0, View::is_free);
    let codes = robot.advee(&["web", "code", "--json"]);
    let codes: Value = serde_json::from_slice(&codes.stdout).unwrap();
    let cookie = post(server, "/api/pair", "", &json!({ "code": codes["operator"], "name": "phone" })).cookie();
    let ends = Arc::new(AtomicBool::new(false));
    let bus = listen(&robot.url, ends.clone());
    let proxy = Proxy::before(server);
    let page = Hand::open(proxy.at, server, &cookie);
    let mut hand = Hand { page, at: proxy.at, server, cookie, hold: 0, said: BTreeMap::new() };
    for link in
        [Link::Good, Link::Jitter, Link::Loss, Link::Cut, Link::Jitter, Link::Cut, Link::Reset, Link::Loss, Link::Reset]
    {
        let broken = [Link::Cut, Link::Reset].contains(&link);
        // A link that breaks is good until then.
        proxy.set(if broken { Link::Good } else { link });
        hand.drive(if broken { 12 } else { 60 });
        if broken {
            proxy.set(link);
            hand.drive(12);
        } else {
            hand.page.zero(hand.hold);
        }
        std::thread::sleep(Duration::from_millis(900));
        proxy.set(Link::Good);
        if broken {
            hand.back();
        }
    }
    std::thread::sleep(Duration::from_millis(500));
    ends.store(true, SeqCst);
    judge(&bus.join().unwrap(), &hand.said);
}

fn judge(bus: &Bus, said: &BTreeMap<u64, i64>) {
    let (mut passed, mut latest, mut zeros, mut stops) = (0, 0, Vec::new(), Vec::new());
    for (place, (at, speed)) in bus.commands.iter().enumerate() {
        if *speed == 0.0 {
            continue;
        }
        let of = said[&key(*speed)];
        passed += 1;
        latest = latest.max(at - of);
        assert!(at - of < 250_000, "passed on {} µs after it was said", at - of);
        // The next command, moving or not, is in time.
        let next = bus.commands.get(place + 1).expect("a zero at the end");
        assert!(next.0 - of <= 250_000, "the next is {} µs after it was said", next.0 - of);
        if next.1 == 0.0 {
            zeros.push(next.0 - of);
            // If the robot was driven before, it is commanded to stop in time.
            let driven =
                bus.targets.iter().any(|(when, target)| *when > at - 200_000 && *when <= next.0 && *target > 0.05);
            let stands = bus.targets.iter().find(|(when, target)| *when >= *at && *target == 0.0);
            if driven {
                stops.push(stands.expect("it is told to stand").0 - of);
            }
        }
    }
    let worst = |times: &[i64]| times.iter().max().copied().unwrap_or(0) as f64 / 1e3;
    println!(
        "{passed} of {} passed on, {:.0} ms old at most; {} holds ended: zero {:.0} ms, standing {:.0} ms after the \
         last was said",
        said.len(),
        latest as f64 / 1e3,
        zeros.len(),
        worst(&zeros),
        worst(&stops)
    );
    // 300 ms, plus the 50 ms period of LL_DATA_MOTION.
    assert!(stops.iter().all(|after| *after <= 310_000), "{stops:?}");
    assert!(zeros.len() >= 8 && stops.len() >= 5 && passed > 200, "there was something to judge");
}
