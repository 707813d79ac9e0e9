//! Latency from command to wheel: `cargo bench --bench wheel`.
//!
//! From publishing `LL_CMD_MOTION` to RPDO4 with the new speed on the CAN bus, compared with one LCM hop (publish to
//! receive, in this process) in the same run, alternating. Goal: p99 at most 2 ms above the hop's.

#[path = "../advee/tests/support.rs"]
mod support;

use messages::{Message, lowlevel};
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};
use support::Robot;

const COMMANDS: usize = 2000;
const PATIENCE: Duration = Duration::from_millis(200);

fn main() {
    let mut robot = Robot::ready(&[]);
    let can = listen_can(robot::topology::can_port_beside(robot.port));
    // Speeds that differ by more than one rpm, slow enough to stay in the hall.
    let speed = |n: usize| 0.05 + 0.01 * (n % 5) as f64 * if n % 400 < 200 { 1.0 } else { -1.0 };
    robot.drive(0.0, 0.0, 0.5);
    robot.drive(0.03, 0.0, 0.5);
    let (mut wheel, mut hop) = (Vec::new(), Vec::new());
    let mut lost = 0;
    for n in 0..COMMANDS {
        drain(&can);
        while robot.bus.recv().expect("the bus can be read").is_some() {}
        let command = lowlevel::CmdMotion {
            timestamp: n as i64,
            speed: speed(n),
            steering: 0.0,
            priority: 1,
            source: "test".into(),
        };
        let mut bytes = Vec::new();
        Message::from(command).encode(&mut bytes).expect("encodable");
        let begin = Instant::now();
        // Odd turns measure the hop, even ones the wheel, so that neither waits for the other.
        robot.bus.publish("LL_CMD_MOTION", &bytes).expect("the bus takes it");
        if n % 2 == 0 {
            match wait_for_rpdo4(&can, begin, speed(n)) {
                Some(took) => wheel.push(took),
                None => lost += 1,
            }
        } else {
            match wait_for_own(&mut robot, begin) {
                Some(took) => hop.push(took),
                None => lost += 1,
            }
        }
        robot.pass(0.005);
    }
    report("LCM hop", &mut hop);
    report("command to wheel", &mut wheel);
    let p99 = |sorted: &[Duration]| sorted[sorted.len() * 99 / 100].as_secs_f64() * 1e3;
    println!("p99 above one hop: {:.3} ms; not answered within {PATIENCE:?}: {lost}", p99(&wheel) - p99(&hop));
}

fn listen_can(port: u16) -> UdpSocket {
    use nix::sys::socket::{AddressFamily, SockFlag, SockType, SockaddrIn, bind, setsockopt, socket, sockopt};
    use std::os::fd::AsRawFd;
    let fd = socket(AddressFamily::Inet, SockType::Datagram, SockFlag::empty(), None).expect("a socket");
    setsockopt(&fd, sockopt::ReuseAddr, &true).expect("reuse");
    setsockopt(&fd, sockopt::ReusePort, &true).expect("reuse");
    bind(fd.as_raw_fd(), &SockaddrIn::new(0, 0, 0, 0, port)).expect("bind");
    let can = UdpSocket::from(fd);
    can.join_multicast_v4(&Ipv4Addr::new(239, 74, 163, 2), &Ipv4Addr::UNSPECIFIED).expect("join");
    can
}

fn drain(can: &UdpSocket) {
    can.set_nonblocking(true).expect("non-blocking");
    let mut datagram = [0; 512];
    while can.recv(&mut datagram).is_ok() {}
    can.set_nonblocking(false).expect("blocking");
}

/// Arrival of RPDO4 with this speed; it is also repeated with the previous speed.
fn wait_for_rpdo4(can: &UdpSocket, begin: Instant, speed: f64) -> Option<Duration> {
    // Motor speed at 1 m/s: gear 26, wheels of 0.1 m.
    let rpm = (speed * 26.0 * 60.0 / (0.2 * std::f64::consts::PI)).round() as i32;
    let mut datagram = [0; 512];
    loop {
        let left = PATIENCE.checked_sub(begin.elapsed()).filter(|left| !left.is_zero())?;
        can.set_read_timeout(Some(left)).expect("a time limit");
        let len = can.recv(&mut datagram).ok()?;
        let took = begin.elapsed();
        let frame = host::ports::can_udp_codec::decode(&datagram[..len]).ok()?;
        if frame.id() == base::can::Id::Standard(0x501) && frame.data()[2..] == rpm.to_le_bytes() {
            return Some(took);
        }
    }
}

fn wait_for_own(robot: &mut Robot, begin: Instant) -> Option<Duration> {
    loop {
        let left = PATIENCE.checked_sub(begin.elapsed()).filter(|left| !left.is_zero())?;
        robot.bus.wait(left).expect("the bus can be waited for");
        while let Some(received) = robot.bus.recv().expect("the bus can be read") {
            if received.channel == "LL_CMD_MOTION" {
                return Some(begin.elapsed());
            }
        }
    }
}

fn report(name: &str, took: &mut [Duration]) {
    took.sort();
    let at = |share: f64| took[((took.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e6;
    println!(
        "{name:17} p50 {:6.0} us, p99 {:6.0} us, max {:6.0} us ({} samples)",
        at(0.5),
        at(0.99),
        at(1.0),
        took.len()
    );
}
