//! One end of a measurement, in a separate process: our side; `benches/peers/peer.c` is that of the others.
//!
//! `TRANSPORT PORT RECV_BUF ROLE ARGUMENTS`; a transport is `udpm` or `shm`, followed by `-epoll` to wait as modules
//! do.
//!
//! | role | arguments | subscribes to | does |
//! |---|---|---|---|
//! | `echo` | | `PING` | answers with its own message of equal size on `PONG` |
//! | `ping` | size, trips | `PONG` | sends `PING`, waits for the answer; an eighth of the trips before, to warm up |
//! | `send` | rate, ms, size | nothing | sends `rate` messages/s, those due each millisecond; 0: as fast as it can |
//! | `count` | size | `PING`; mix: everything | counts until the end |
//! | `idle` | | `OTHER` | waits |
//!
//! Size 0 is the mix of [`kind`]. A peer prints `ready` and its receive buffer, 0 if unknown; `ping` and `send` then
//! wait for a line; at its end each prints one line of names and numbers. `send` waits for a line again before it
//! announces the end on the bus. CPU time is read from outside.

use lcm::Url;
use lcm::live::{Lcm, PublishError, Received};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use std::io::{Write, stdin, stdout};
use std::os::fd::AsFd;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Number of the message after the last.
const END: u64 = u64::MAX;
/// Size of number and size at the beginning of every message.
const HEAD: usize = 16;
/// Without a limit, as plain sockets.
const FOREVER: Duration = Duration::MAX;

/// Channel and size of a message of the mix, on average 2450 bytes: 67 750 of them are ten times the traffic of MIT's
/// robot Talos in a second, 166 MB. Of 80 messages 31 are poses and states, 32 packets of a rotating laser, 16 scans of
/// a line laser, one an image.
pub fn kind(number: u64) -> (&'static str, usize) {
    match (number % 80, number % 5) {
        (0, _) => ("IMAGE", 104_288),
        (_, 0 | 2) => ("POSE", 128),
        (_, 1 | 3) => ("LASER", 1206),
        _ => ("SCAN", 3072),
    }
}

fn kind_of(size: usize, number: u64) -> (&'static str, usize) {
    if size == 0 { kind(number) } else { ("PING", size) }
}

/// Context, and the way in which its process waits.
struct Bus {
    lcm: Lcm,
    epoll: Option<Epoll>,
    out: Vec<u8>,
}

impl Bus {
    fn open(transport: &str, port: &str, recv_buf: &str, pattern: Option<&str>) -> Self {
        let (provider, epoll) = transport.split_once('-').map_or((transport, false), |(provider, _)| (provider, true));
        let shm = if provider == "shm" { "auto" } else { "off" };
        let url = format!("udpm://239.255.76.67:{port}?ttl=0&recv_buf_size={recv_buf}&shm={shm}");
        let mut lcm = Lcm::new(&Url::parse(&url).expect("a URL").0).expect("a bus");
        if let Some(pattern) = pattern {
            lcm.subscribe(pattern).expect("a subscription");
        }
        let epoll = epoll.then(|| {
            let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).expect("an epoll");
            epoll.add(lcm.as_fd(), EpollEvent::new(EpollFlags::EPOLLIN, 0)).expect("a descriptor");
            epoll
        });
        Self { lcm, epoll, out: vec![0x5a; 1 << 17] }
    }

    fn publish(&mut self, channel: &str, number: u64, size: usize) {
        self.out[..8].copy_from_slice(&number.to_le_bytes());
        self.out[8..HEAD].copy_from_slice(&(size as u64).to_le_bytes());
        match self.lcm.publish(channel, &self.out[..size]) {
            Ok(()) | Err(PublishError::Busy) => {} // a message not sent is lost, and shows where it is counted
            Err(error) => panic!("{error}"),
        }
    }

    /// Waits for a message; with epoll takes all available ones. `on` gets number and size from the message, and its
    /// real size.
    fn receive(&mut self, mut on: impl FnMut(u64, u64, usize)) {
        let mut take = |payload: &[u8]| {
            // The official library's self test is shorter than a head.
            let Some((head, _)) = payload.split_first_chunk::<HEAD>() else { return };
            let [number, size] = [0, 8].map(|at| u64::from_le_bytes(head[at..at + 8].try_into().expect("8 bytes")));
            on(number, size, payload.len());
        };
        let Some(epoll) = &self.epoll else {
            if let Some(Received { payload, .. }) = self.lcm.recv_timeout(FOREVER).expect("the bus can be read") {
                take(payload);
            }
            return;
        };
        epoll.wait(&mut [EpollEvent::empty()], EpollTimeout::NONE).expect("a wait");
        while let Some(Received { payload, .. }) = self.lcm.recv().expect("the bus can be read") {
            take(payload);
        }
    }
}

/// Runs the role in the arguments; see the head of the file.
pub fn main(arguments: &[String]) {
    let [transport, port, recv_buf, role, rest @ ..] = arguments else { panic!("{arguments:?}") };
    let number = |at: usize| rest.get(at).map_or(0, |text: &String| text.parse::<u64>().expect("a number"));
    let open = |pattern| Bus::open(transport, port, recv_buf, pattern);
    match role.as_str() {
        "echo" => echo(open(Some("PING"))),
        "ping" => ping(open(Some("PONG")), number(0) as usize, number(1)),
        "send" => send(open(None), number(0), Duration::from_millis(number(1)), number(2) as usize),
        "count" => count(open(Some(if number(0) == 0 { ".*" } else { "PING" })), number(0) as usize),
        "idle" => {
            let mut bus = open(Some("OTHER"));
            ready(&bus);
            loop {
                bus.receive(|_, _, _| {});
            }
        }
        _ => panic!("no role {role}"),
    }
    line(); // stay, so that its CPU time can be read
}

fn ready(bus: &Bus) {
    let granted = bus.lcm.udpm().and_then(|udpm| udpm.granted_recv_buf_size().ok()).unwrap_or(0);
    say(&format!("ready {granted}"));
}

fn say(text: &str) {
    println!("{text}");
    stdout().flush().expect("somebody listens");
}

fn line() {
    let read = stdin().read_line(&mut String::new()).expect("somebody speaks");
    if read == 0 {
        std::process::exit(0);
    }
}

fn echo(mut bus: Bus) {
    ready(&bus);
    loop {
        let mut heard = None;
        bus.receive(|number, _, len| heard = Some((number, len)));
        if let Some((number, len)) = heard {
            bus.publish("PONG", number, len);
        }
    }
}

fn ping(mut bus: Bus, size: usize, trips: u64) {
    let warm = trips / 8;
    let mut took = Vec::with_capacity(trips as usize);
    ready(&bus);
    line();
    for trip in 0..warm + trips {
        let begin = Instant::now();
        bus.publish("PING", trip, size);
        let mut heard = false;
        while !heard {
            bus.receive(|number, _, _| heard |= number == trip);
        }
        if trip >= warm {
            took.push(begin.elapsed());
        }
    }
    took.sort_unstable();
    let at = |percent: usize| took[took.len() * percent / 100].as_nanos();
    say(&format!("trips {} p50 {} p99 {}", warm + trips, at(50), at(99)));
}

fn send(mut bus: Bus, rate: u64, span: Duration, size: usize) {
    ready(&bus);
    line();
    let begin = Instant::now();
    let mut sent = 0;
    while begin.elapsed() < span {
        let mut due = sent + 1;
        if rate > 0 {
            let tick = begin.elapsed().as_millis() as u64 + 1;
            sleep(Duration::from_millis(tick).saturating_sub(begin.elapsed()));
            due = rate * tick / 1000;
        }
        while sent < due {
            let (channel, size) = kind_of(size, sent);
            bus.publish(channel, sent, size);
            sent += 1;
        }
    }
    say(&format!("sent {sent} span {}", begin.elapsed().as_nanos()));
    line(); // all peers have had time to receive
    loop {
        bus.publish(kind_of(size, 1).0, END, HEAD);
        sleep(Duration::from_millis(10));
    }
}

fn count(mut bus: Bus, size: usize) {
    let (mut received, mut wrong, mut bytes, mut ended) = (0_u64, 0_u64, 0, false);
    let (mut last, mut first_at, mut last_at) = (None, None, None);
    ready(&bus);
    while !ended {
        bus.receive(|number, says, len| match number {
            END => ended = true,
            // Complete, of the right size, and in order.
            _ if says != len as u64 || len != kind_of(size, number).1 || last.is_some_and(|last| number <= last) => {
                wrong += 1;
            }
            _ => {
                let now = Instant::now();
                first_at.get_or_insert(now);
                (received, bytes, last) = (received + 1, bytes + len, Some(number));
                last_at = Some(now);
            }
        });
    }
    let span = first_at.zip(last_at).map_or(0, |(first, last): (Instant, Instant)| (last - first).as_nanos());
    say(&format!("received {received} wrong {wrong} bytes {bytes} span {span}"));
}
