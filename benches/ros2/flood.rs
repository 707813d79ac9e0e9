//! Flood of datagrams from another network namespace, over a cable, at the port of `ros2` and, for comparison, at a
//! port of the same address that is closed: what it costs the robot's control loop.
//!
//! All of it is in a process with a network namespace of its own, which holds the other one by a descriptor: with the
//! process both end, and the cable with them. None has a name that others see.

use crate::figures::{Samples, median, verdict};
use crate::hosts::Host;
use crate::rig::{Rig, Way};
use base::{Duration, Instant};
use host::clock;
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::unistd::Pid;
use rtps::{Limits, Participant, Prefix};
use std::fmt;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::ops::Range;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use testing::Random;

/// The two ends of the cable, and their addresses.
const NEAR: (&str, &str) = ("robot", "10.91.7.1");
const FAR: (&str, &str) = ("flood", "10.91.7.2");
/// Datagrams per second.
const RATE: f64 = 50_000.0;
/// Different datagrams, sent one after the other again and again.
const DATAGRAMS: usize = 4000;
/// Pause of the sender, which then sends what is due.
const PAUSE: Duration = Duration::from_micros(500);
/// Flood before the measurement.
const SETTLED: Duration = Duration::from_millis(500);
/// Time between two commands, µs.
const SPACING: Range<u64> = 12_000..30_000;
/// Period of `LL_DATA_VELOCITY`, µs.
const TICK: i64 = 50_000;
/// Greatest ratio of a figure under the flood at the port of `ros2` to that at the closed port.
const RATIO: f64 = 1.1;

/// Figures under a flood.
pub struct Leg {
    /// Deviation of the period of `LL_DATA_VELOCITY`, by its time stamps.
    jitter: Samples,
    /// From `LL_CMD_VELOCITY` over LCM to the wheel.
    latency: Samples,
    /// Datagrams per second that arrived.
    rate: f64,
}

impl fmt::Display for Leg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [jitter, latency] = [&self.jitter, &self.latency].map(|samples| samples.at(0.99));
        write!(f, "p99 of jitter {jitter:.2} ms, of latency {latency:.2} ms, {:.0} datagrams/s", self.rate)
    }
}

/// A flood at the port of `ros2`, and one at a closed port.
pub type Pair = [Leg; 2];

/// Whether this user may make network namespaces.
///
/// # Errors
/// One line with the reason.
pub fn may() -> Result<(), String> {
    testing::tool("ip", "-V")?;
    let output = Command::new("unshare").args(["-n", "ip", "link", "set", "lo", "up"]).output();
    let output = output.map_err(|error| format!("unshare: {error}"))?;
    match output.status.success() {
        true => Ok(()),
        false => Err(format!("no network namespace: {}", String::from_utf8_lossy(&output.stderr).trim())),
    }
}

/// Measures pairs in alternating order. To be called in a process with a network namespace of its own.
pub fn measure(pairs: usize, time: Duration, seed: u64) -> Vec<Pair> {
    let (here, far) = (Host::here(), Host::new());
    for command in ["link set lo up", "link set lo multicast on"] {
        here.ip(command);
    }
    here.cable(NEAR, &far, FAR);
    // The way of the robot's own multicast, which does not leave: it has a TTL of 0.
    here.ip(&format!("route add default dev {}", NEAR.0));
    let mut rig = Rig::start(seed, &["--set", &format!("ros2.address={:?}", NEAR.1)]);
    let port = rtps::unicast_port(rig.domain, 0).expect("a port");
    drop(UdpSocket::bind((NEAR.1, port + 1)).expect("a closed port beside it"));
    let targets = [port, port + 1].map(|port| SocketAddrV4::new(address(NEAR), port));
    let datagrams = datagrams(rig.domain, &mut Random::new(seed));
    let leg = |rig: &mut Rig, to| measure_one(rig, &far, to, &datagrams, time);
    let measure = |pair: usize| {
        let [open, closed] = if pair.is_multiple_of(2) {
            let open = leg(&mut rig, targets[0]);
            [open, leg(&mut rig, targets[1])]
        } else {
            let closed = leg(&mut rig, targets[1]);
            [leg(&mut rig, targets[0]), closed]
        };
        eprintln!("pair {pair}: at the port of ros2 {open}; at the closed port {closed}");
        [open, closed]
    };
    (0..pairs).map(measure).collect()
}

fn address((_, address): (&str, &str)) -> Ipv4Addr {
    address.parse().expect("an address")
}

fn measure_one(rig: &mut Rig, far: &Host, to: SocketAddrV4, datagrams: &[Vec<u8>], time: Duration) -> Leg {
    rig.begin(Way::Lcm);
    let ended = AtomicBool::new(false);
    let leg = std::thread::scope(|scope| {
        let flood = scope.spawn(|| far.run(|| send(to, datagrams, &ended)));
        // Also if the measurement fails: the scope waits for the flood.
        let end = End(&ended);
        drive(rig, SETTLED);
        rig.ticks.clear();
        let (begin, before) = (clock::now(), arrived());
        let latency = drive(rig, time);
        let rate = (arrived() - before) as f64 / clock::now().since(begin).as_secs_f64();
        drop(end);
        flood.join().expect("it only sends");
        Leg { jitter: jitter(&rig.ticks), latency, rate }
    });
    rig.leave(Way::Lcm);
    leg
}

fn drive(rig: &mut Rig, time: Duration) -> Samples {
    let end = clock::now() + time;
    rig.drive(Way::Lcm, SPACING, |_| clock::now() < end)
}

/// Ends the flood with its own end.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Sends from one processor until the end.
fn send(to: SocketAddrV4, datagrams: &[Vec<u8>], ended: &AtomicBool) {
    stay_on_one_processor();
    let socket = UdpSocket::bind((FAR.1, 0)).expect("the cable is plugged in");
    let (begin, mut sent) = (clock::now(), 0);
    let mut datagrams = datagrams.iter().cycle();
    while !ended.load(Ordering::Relaxed) {
        let due = (RATE * clock::now().since(begin).as_secs_f64()) as usize;
        for datagram in datagrams.by_ref().take(due - sent) {
            // One that finds a buffer full is lost, as an attacker's may be.
            let _ = socket.send_to(datagram, to);
        }
        sent = due;
        std::thread::sleep(PAUSE);
    }
}

fn stay_on_one_processor() {
    let this = Pid::from_raw(0);
    let may = sched_getaffinity(this).expect("the processors");
    let first = (0..CpuSet::count()).find(|cpu| may.is_set(*cpu).unwrap_or(false)).expect("one at least");
    let mut own = CpuSet::new();
    own.set(first).expect("it is there");
    sched_setaffinity(this, &own).expect("it may be used");
}

/// Packets that have come out of the cable so far (proc(5), net/dev).
fn arrived() -> u64 {
    let text = std::fs::read_to_string("/proc/self/net/dev").expect("/proc");
    let fields = text.lines().find_map(|line| line.trim_start().strip_prefix(NEAR.0)?.strip_prefix(':'));
    let packets = fields.and_then(|fields| fields.split_whitespace().nth(1)?.parse().ok());
    packets.expect("the cable is plugged in")
}

fn jitter(ticks: &[i64]) -> Samples {
    let mut jitter = Samples::default();
    for pair in ticks.windows(2) {
        jitter.add(Duration::from_micros((pair[1] - pair[0] - TICK).unsigned_abs()));
    }
    jitter
}

/// One half looks like participants that announce themselves, the other half is malformed.
fn datagrams(domain: u32, random: &mut Random) -> Vec<Vec<u8>> {
    let each = |n: usize| {
        let announcement = announcement(domain, random);
        if n.is_multiple_of(2) { announcement } else { spoil(announcement, random) }
    };
    (0..DATAGRAMS).map(each).collect()
}

/// What a participant says that nobody has heard of.
fn announcement(domain: u32, random: &mut Random) -> Vec<u8> {
    let mut prefix = [0; 12];
    prefix.copy_from_slice(&random.bytes(12));
    let own = SocketAddrV4::new(address(FAR), 9);
    let mut other = Participant::new(rtps::Config {
        domain,
        prefix: Prefix(prefix),
        locators: vec![own],
        announce_to: vec![own],
        announce_period: Duration::from_secs(3),
        lease: Duration::from_secs(3600),
        name: "x".repeat(200),
        user_data: vec![0; 500],
        endpoint_data: |_| Vec::new(),
        limits: Limits::default(),
    });
    other.handle_timeout(Instant::from_millis(1));
    other.poll_tx().expect("an announcement").datagram
}

/// Cuts a datagram off, alters it, or replaces it by chance.
fn spoil(mut datagram: Vec<u8>, random: &mut Random) -> Vec<u8> {
    let at = random.index(datagram.len());
    match random.below(3) {
        0 => datagram.truncate(at),
        1 => datagram[at] = random.edge_byte(),
        _ => datagram = random.bytes(datagram.len()),
    }
    datagram
}

/// Prints the table.
pub fn print(pairs: &[Pair]) {
    let rates = [0_usize, 1].map(|which| median(pairs.iter().map(|pair| pair[which].rate).collect()));
    println!("\nflood from one core of another network namespace, {} pairs", pairs.len());
    println!("datagrams/s that arrived: {:.0} at the port of ros2, {:.0} at a closed port\n", rates[0], rates[1]);
    println!("| control loop, p99 | port of `ros2`, ms | closed port, ms | ratio | median of the pairs | goal |");
    println!("|---|---|---|---|---|---|");
    print_row("period of `LL_DATA_VELOCITY`: deviation from 50 ms", pairs, |leg| &leg.jitter);
    print_row("`LL_CMD_VELOCITY` over LCM to the wheel", pairs, |leg| &leg.latency);
    let lost = [0_usize, 1].map(|which| pairs.iter().map(|pair| pair[which].latency.lost).sum::<usize>());
    println!("\ncommands not answered in time: {} at the port of ros2, {} at a closed port", lost[0], lost[1]);
}

fn print_row(what: &str, pairs: &[Pair], of: impl Fn(&Leg) -> &Samples) {
    let mut pooled = [Samples::default(), Samples::default()];
    for pair in pairs {
        pooled.iter_mut().zip(pair).for_each(|(all, leg)| all.append(of(leg)));
    }
    let [open, closed] = pooled.map(|samples| samples.at(0.99));
    let ratios = pairs.iter().map(|[open, closed]| of(open).at(0.99) / of(closed).at(0.99));
    let (ratio, of_pairs) = (open / closed, median(ratios.collect()));
    let word = verdict(ratio.max(of_pairs), RATIO);
    println!("| {what} | {open:.2} | {closed:.2} | {ratio:.2} | {of_pairs:.2} | {RATIO}: {word} |");
}
