//! The simulated courier, driven over LCM and from ROS 2, and its left wheel.
//!
//! The driver takes the wheels of such a base to a new speed by a ramp of 20 ms steps, of which the first one is as
//! short as the time since the driver's last event. So that the ramp is not measured, commands alternate between two
//! speeds right below and above the middle between two units of the drive: the shortest step changes what is sent.

use crate::can;
use crate::figures::Samples;
use crate::publisher::{Publisher, Rclpy};
use crate::support::{self, Robot};
use base::can::{Frame, Id};
use base::{Duration, Instant};
use host::clock;
use host::ports::can_udp_codec;
use messages::{Channel, Message, lowlevel};
use nix::cmsg_space;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrIn, recvmsg, setsockopt, sockopt};
use nix::sys::time::TimeSpec;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::io::IoSliceMut;
use std::net::{Ipv4Addr, UdpSocket};
use std::ops::Range;
use std::os::fd::{AsFd, AsRawFd};
use std::process::Stdio;
use testing::Random;

/// Set-point of the left wheel: RPDO1 of node 1.
const RPDO1: Id = Id::Standard(0x201);
/// Motor speed at 1 m/s: gear 20, wheels of 0.085 m.
const RPM_PER_MPS: f64 = 20.0 * 60.0 / (TAU * 0.085);
/// Right below and right above the middle between two units of the drive, 1 rpm.
const LOW_MPS: f64 = 449.499 / RPM_PER_MPS;
const HIGH_MPS: f64 = 449.501 / RPM_PER_MPS;
/// Speed at which ROS falls silent, m/s.
const FAST_MPS: f64 = 0.3;

/// Period of commands that hold a speed.
const PERIOD: Duration = Duration::from_millis(50);
/// Longest time for a set-point. With the spacing of commands it is shorter than their time to live.
const PATIENCE: Duration = Duration::from_millis(150);
/// Longest time for the stop after the last command.
const STOP_PATIENCE: Duration = Duration::from_secs(2);
/// Zeros before motion; longest acceleration after that; constant speed before a measurement.
const RELEASED: Duration = Duration::from_millis(300);
const ACCELERATED: Duration = Duration::from_secs(3);
const SETTLED: Duration = Duration::from_millis(300);
/// Zeros until the robot stands, and silence after that until nobody holds the motion.
const BRAKED: Duration = Duration::from_millis(700);
const SILENT: Duration = Duration::from_millis(400);
/// Attempts to drive on a machine that may be late.
const ATTEMPTS: u32 = 5;
/// Longest time until the robot listens to a publisher.
const JOINED: Duration = Duration::from_secs(15);
/// Longest time for which the publisher of this process is not served.
const TURN_MAX: Duration = Duration::from_millis(20);

/// Way of a velocity to the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Way {
    /// `LL_CMD_VELOCITY` over LCM.
    Lcm,
    /// `/cmd_vel`, published by the crate `rtps` in this process.
    Rtps,
    /// `/cmd_vel`, published by rclpy.
    Rclpy,
}

/// Set-point on the CAN bus.
struct SetPoint {
    at: Instant,
    /// CiA 402: bits 0 to 3 of the controlword are high in operation.
    operates: bool,
    rpm: i32,
}

pub struct Rig {
    robot: Robot,
    pub domain: u32,
    _held: UdpSocket,
    rtps: Option<Publisher>,
    rclpy: Option<Rclpy>,
    can: UdpSocket,
    /// Room for times of reception.
    control: Vec<u8>,
    points: VecDeque<SetPoint>,
    /// Time stamps of `LL_DATA_VELOCITY`, µs.
    pub ticks: Vec<i64>,
    random: Random,
    /// Direction: 1 or -1. It changes with every standstill, so that the robot stays in the hall.
    sign: f64,
    high: bool,
}

impl Rig {
    /// Starts the robot, as a node of ROS that may be commanded.
    pub fn start(seed: u64, extra: &[&str]) -> Self {
        let (domain, held) = domain();
        let config = support::workspace().join("conf/courier").display().to_string();
        let (set, enabled, commands) = (format!("ros2.domain={domain}"), "ros2.enabled=true", "ros2.commands=true");
        let common = ["--config", &config, "--world", "empty", "--set", enabled, "--set", commands, "--set", &set];
        let mut robot = Robot::start_with(0, &[&common[..], extra].concat(), |up, _| {
            // What it prints is not to be among the tables.
            up.stdout(Stdio::null());
        });
        robot.until("all modules RUN and nothing but a command is missing", 60.0, |view| {
            view.all_run() && view.runs("ros2") && view.is_free()
        });
        let can = can::open(robot::topology::can_port_beside(robot.port));
        can.set_nonblocking(true).expect("non-blocking");
        setsockopt(&can, sockopt::ReceiveTimestampns, &true).expect("times of reception");
        Self {
            robot,
            domain,
            _held: held,
            rtps: None,
            rclpy: None,
            can,
            control: cmsg_space!(TimeSpec),
            points: VecDeque::new(),
            ticks: Vec::new(),
            random: Random::new(seed),
            sign: 1.0,
            high: false,
        }
    }

    /// Starts rclpy.
    ///
    /// # Errors
    /// One line: it is not there, or does not find the robot.
    pub fn start_rclpy(&mut self) -> Result<(), String> {
        self.rclpy = Some(Rclpy::start(self.domain)?);
        Ok(())
    }

    /// Starts another publisher in this process, and waits until the robot is found.
    pub fn join(&mut self) {
        self.rtps = Some(Publisher::new(self.domain));
        let until = clock::now() + JOINED;
        while !self.rtps.as_ref().is_some_and(Publisher::is_heard) {
            assert!(clock::now() < until, "nobody listens to /cmd_vel");
            self.turn(TURN_MAX);
        }
    }

    /// Commands a speed, m/s; the time right before that.
    fn command(&mut self, way: Way, speed: f64) -> Instant {
        let vx = self.sign * speed;
        let begin = clock::now();
        match way {
            Way::Lcm => self.robot.publish(lowlevel::CmdVelocity {
                timestamp: 0,
                vx,
                vy: 0.0,
                omega: 0.0,
                priority: lowlevel::CmdMotion::REMOTE,
                source: "bench".into(),
                session: 1,
            }),
            Way::Rtps => self.rtps.as_mut().expect("it has joined").publish(vx),
            Way::Rclpy => return self.rclpy.as_mut().expect("it was started").publish(vx),
        }
        begin
    }

    /// Commands a speed for whole periods.
    fn hold(&mut self, way: Way, speed: f64, time: Duration) {
        let end = clock::now() + time;
        while clock::now() < end {
            let begin = self.command(way, speed);
            self.pass_until(begin + PERIOD);
        }
    }

    /// Drives the robot, which stands and is held by nobody, to a speed.
    fn take_over(&mut self, way: Way, speed: f64) {
        for _ in 0..ATTEMPTS {
            self.hold(way, 0.0, RELEASED);
            let until = clock::now() + ACCELERATED;
            while clock::now() < until {
                let begin = self.command(way, speed);
                if self.wait_for_speed(begin, PERIOD, speed).is_some() {
                    self.hold(way, speed, SETTLED);
                    return;
                }
            }
            self.leave(way);
        }
        self.robot.pass(0.5);
        panic!("the robot is not driven by {way:?}: {:?}", self.robot.view.reason());
    }

    /// Drives at the speed of the measurements.
    pub fn begin(&mut self, way: Way) {
        self.take_over(way, LOW_MPS);
        self.high = false;
    }

    /// Stops, and lets go of the motion. The next motion is in the other direction.
    pub fn leave(&mut self, way: Way) {
        self.hold(way, 0.0, BRAKED);
        self.pass_until(clock::now() + SILENT);
        self.sign = -self.sign;
    }

    /// Commands one change of the speed after another, spaced by chance (µs), while `more` is true of their number:
    /// the time of each until it is in the wheel's set-point.
    pub fn drive(&mut self, way: Way, spacing: Range<u64>, more: impl Fn(usize) -> bool) -> Samples {
        let (mut samples, mut count) = (Samples::default(), 0);
        while more(count) {
            count += 1;
            self.high = !self.high;
            let speed = if self.high { HIGH_MPS } else { LOW_MPS };
            let begin = self.command(way, speed);
            if let Some(at) = self.wait_for_speed(begin, PATIENCE, speed) {
                samples.add(at.since(begin));
            } else {
                samples.lost += 1;
                self.leave(way);
                self.begin(way);
            }
            let micros = spacing.start + self.random.below(spacing.end - spacing.start);
            self.pass_until(begin + Duration::from_micros(micros));
        }
        samples
    }

    /// The only publisher ends at speed, as a process that is killed: time from its last command until the stop has
    /// begun; `None`: it does not begin.
    pub fn fall_silent(&mut self) -> Option<Duration> {
        self.join();
        self.take_over(Way::Rtps, FAST_MPS);
        let pause = Duration::from_micros(15_000 + self.random.below(35_000));
        self.pass_until(clock::now() + pause);
        let begin = self.command(Way::Rtps, FAST_MPS);
        self.end_publishers();
        let stop = self.wait(begin, STOP_PATIENCE, |point| !point.operates || point.rpm == 0);
        self.pass_until(clock::now() + BRAKED);
        self.sign = -self.sign;
        stop.map(|at| at.since(begin))
    }

    pub fn end_publishers(&mut self) {
        (self.rtps, self.rclpy) = (None, None);
    }

    /// Waits for the set-point of a speed, m/s.
    fn wait_for_speed(&mut self, from: Instant, patience: Duration, speed: f64) -> Option<Instant> {
        let rpm = (self.sign * speed * RPM_PER_MPS).round() as i32;
        self.wait(from, patience, |point| point.operates && point.rpm == rpm)
    }

    /// Time of the first such set-point since `from`; `None` if none comes within `patience`.
    fn wait(&mut self, from: Instant, patience: Duration, is: impl Fn(&SetPoint) -> bool) -> Option<Instant> {
        loop {
            while let Some(point) = self.points.pop_front() {
                if point.at >= from && is(&point) {
                    return Some(point.at);
                }
            }
            let left = (from + patience).since(clock::now());
            if left.is_zero() {
                return None;
            }
            self.turn(left);
        }
    }

    fn pass_until(&mut self, end: Instant) {
        loop {
            let left = end.since(clock::now());
            if left.is_zero() {
                return;
            }
            self.turn(left);
        }
    }

    /// Waits until something arrives, `patience` at most, and receives it.
    fn turn(&mut self, patience: Duration) {
        self.receive();
        let ways = [Some(self.robot.bus.as_fd()), Some(self.can.as_fd()), self.rtps.as_ref().map(AsFd::as_fd)];
        let mut fds: Vec<PollFd<'_>> =
            ways.into_iter().flatten().map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        // Rounded up: not to spin through the last millisecond.
        let millis = patience.min(TURN_MAX).as_nanos().div_ceil(1_000_000);
        let polled = poll(&mut fds, PollTimeout::from(u16::try_from(millis).unwrap_or(u16::MAX)));
        drop(fds);
        assert!(matches!(polled, Ok(_) | Err(Errno::EINTR)), "poll: {polled:?}");
        self.receive();
    }

    fn receive(&mut self) {
        if let Some(rtps) = &mut self.rtps {
            rtps.serve();
        }
        while let Some(received) = self.robot.bus.recv().expect("the bus can be read") {
            if let Some(channel @ Channel::LlDataVelocity) = Channel::from_name(received.channel)
                && let Ok(Message::LlDataVelocity(velocity)) = Message::decode(channel, received.payload)
            {
                self.ticks.push(velocity.timestamp);
            }
        }
        while let Some((at, frame)) = self.frame() {
            self.points.extend(set_point(at, &frame));
        }
    }

    /// The next frame of the CAN bus, and when the kernel received it.
    fn frame(&mut self) -> Option<(Instant, Frame)> {
        let mut datagram = [0; 512];
        loop {
            let mut parts = [IoSliceMut::new(&mut datagram)];
            let fd = self.can.as_raw_fd();
            let received = recvmsg::<SockaddrIn>(fd, &mut parts, Some(&mut self.control), MsgFlags::empty());
            let (length, stamp) = match received {
                Ok(received) => {
                    let stamps = received.cmsgs().into_iter().flatten();
                    let stamp = stamps.into_iter().find_map(|control| match control {
                        ControlMessageOwned::ScmTimestampns(time) => Some(time),
                        _ => None,
                    });
                    (received.bytes, stamp.expect("it was asked for"))
                }
                Err(Errno::EINTR) => continue,
                Err(_) => return None,
            };
            let nanos = stamp.tv_sec() as u64 * 1_000_000_000 + stamp.tv_nsec() as u64;
            let at = clock::received(clock::now(), nanos);
            if let Ok(frame) = can_udp_codec::decode(&datagram[..length]) {
                return Some((at, frame));
            }
        }
    }
}

fn set_point(at: Instant, frame: &Frame) -> Option<SetPoint> {
    match (frame.id(), frame.data()) {
        (RPDO1, [control, _, a, b, c, d]) => {
            let rpm = i32::from_le_bytes([*a, *b, *c, *d]);
            Some(SetPoint { at, operates: control & 0x0F == 0x0F, rpm })
        }
        _ => None,
    }
}

/// A domain that no test or bench of this machine uses while the socket is open: at a port between those of its
/// participants and the next domain.
fn domain() -> (u32, UdpSocket) {
    let first = std::process::id();
    let free = (0..100).map(|n| 1 + (first + n) % 100).find_map(|domain| {
        let port = u16::try_from(7400 + 250 * domain + 249).expect("a port");
        Some((domain, UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).ok()?))
    });
    free.expect("some domain is free")
}
