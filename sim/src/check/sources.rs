//! Recent commands of each source of motion, as received by the driver: of both messages.

use super::facts::DELAY_MAX;
use super::{Base, Limits};
use base::{Duration, Instant};
use kinematics::Twist;
use messages::{Message, lowlevel};
use std::collections::VecDeque;

/// Maximum number of sources; a further one takes the place of the one that has been silent longest.
const SOURCES_MAX: usize = 16;
/// Maximum number of commands per source: 500 ms at 20 Hz are 10.
const COMMANDS_MAX: usize = 32;
/// Highest priority of a command.
const PRIORITY_MAX: i8 = 3;
/// Tolerance of a set-point due to rounding, m/s: one rpm of the motor is 0.0004.
pub(super) const ROUNDING_MPS: f64 = 0.001;

/// A command of either message, as far as the rules depend on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked<'a> {
    pub source: &'a str,
    pub priority: i8,
    /// Forward, m/s; of a robot that turns by its wheels that of the fastest one.
    pub speed: f64,
    /// It commands to stand: of a velocity all components are 0.
    pub zero: bool,
    /// Of `LL_CMD_VELOCITY`.
    pub velocity: bool,
}

impl<'a> Asked<'a> {
    /// The command in a message, if it is one.
    pub fn of(message: &'a Message, limits: &Limits) -> Option<Self> {
        let (source, priority, twist, velocity) = match message {
            Message::LlCmdMotion(command) => {
                let &lowlevel::CmdMotion { speed, steering, priority, ref source, .. } = command;
                let curve = speed * libm::tan(steering) / limits.wheelbase;
                (source, priority, Twist::new(speed, 0.0, curve), false)
            }
            Message::LlCmdVelocity(command) => {
                let &lowlevel::CmdVelocity { vx, vy, omega, priority, ref source, .. } = command;
                (source, priority, Twist::new(vx, vy, omega), true)
            }
            _ => return None,
        };
        // The zero of LL_CMD_MOTION is its speed, whatever its angle.
        let zero = if velocity { twist == Twist::ZERO } else { twist.vx == 0.0 };
        let speed = limits.base.as_ref().map_or(twist.vx, |base| base.fastest(twist, limits.cap(priority)));
        Some(Self { source, priority, speed, zero, velocity })
    }

    /// True if the driver accepts the command in a message.
    pub fn is_in_limits(&self, message: &Message, limits: &Limits) -> bool {
        let bounded = match message {
            Message::LlCmdVelocity(command) => {
                let speeds = [command.vx, command.vy].into_iter().all(|speed| speed.abs() <= limits.speed);
                speeds && command.omega.abs() <= limits.rotation
            }
            Message::LlCmdMotion(command) => {
                command.speed.abs() <= limits.speed && command.steering.abs() <= limits.steering_angle
            }
            _ => false,
        };
        bounded && (0..=PRIORITY_MAX).contains(&self.priority)
    }
}

impl Limits {
    /// Speed limit of a source of this priority, m/s.
    pub(super) fn cap(&self, priority: i8) -> f64 {
        if priority == lowlevel::CmdMotion::PLANNER { self.speed_autonomous } else { self.speed_manual }
    }
}

impl Base {
    /// Speed of the fastest wheel at a velocity, m/s.
    pub(super) fn fastest_wheel(&self, twist: Twist) -> f64 {
        let wheels = self.chassis.wheel_states(twist, &[]);
        wheels.iter().fold(0.0, |fastest, wheel| f64::max(fastest, wheel.speed_mps.abs()))
    }

    /// The same at a command of a source with this speed limit, m/s.
    fn fastest(&self, command: Twist, cap: f64) -> f64 {
        let twist = self.chassis.feasible(command).twist;
        let speed = libm::hypot(twist.vx, twist.vy);
        let kept = if speed > cap { cap / speed } else { 1.0 };
        self.fastest_wheel(twist * kept)
    }
}

/// A command: reception time, service time, speed in m/s, and which message.
#[derive(Clone, Copy, Debug)]
struct ReceivedCommand {
    at: Instant,
    served: Instant,
    speed: f64,
    velocity: bool,
}

/// A source.
#[derive(Debug)]
pub(super) struct Source {
    /// Unique number of the source.
    pub id: u64,
    pub name: String,
    pub priority: i8,
    said: VecDeque<ReceivedCommand>,
    ttl: Duration,
    /// Begin of the period without silence beyond its time to live.
    pub unbroken: Instant,
    /// Time at which the command was served that ended its last silence, or what the driver took for one.
    pub resumed: Instant,
    /// First moving command after zero, or of all: served to the driver's present process.
    pub begun: Option<Instant>,
    /// Time since which it commands zero.
    pub ended: Option<Instant>,
    /// True if its first command is one that begins.
    trusted: bool,
}

impl Source {
    pub fn is_planner(&self) -> bool {
        self.priority == lowlevel::CmdMotion::PLANNER
    }

    /// Instant of its last reception.
    fn heard(&self) -> Instant {
        self.said.back().map_or(Instant::ZERO, |said| said.at)
    }

    /// Expiry of its last command.
    pub fn expires(&self) -> Instant {
        self.heard() + self.ttl
    }

    /// Instant at which it was last processed.
    pub fn served(&self) -> Instant {
        self.said.back().map_or(Instant::ZERO, |said| said.served)
    }

    /// True if its last command is valid, or expired at most `slack` ago.
    pub fn lives(&self, now: Instant, slack: Duration) -> bool {
        self.said.back().is_some_and(|said| now < said.at + self.ttl + slack)
    }

    /// Expiry of its last command that moves the robot; `None` without a recent one.
    pub fn moves_until(&self) -> Option<Instant> {
        self.said.iter().rev().find(|said| said.speed != 0.0).map(|said| said.at + self.ttl)
    }

    /// True if it commands this speed, or a higher one that is limited to it, by a valid command that was superseded at
    /// most `slack` ago.
    pub fn asks(&self, now: Instant, slack: Duration, speed: f64, limit: f64) -> bool {
        self.said.iter().enumerate().any(|(nth, said)| {
            let superseded = self.said.get(nth + 1).is_some_and(|next| now.since(next.served) > slack);
            let lives = now.since(said.at) <= self.ttl + slack && !superseded;
            lives && said.speed * speed > 0.0 && speed.abs() <= said.speed.abs().min(limit) + ROUNDING_MPS
        })
    }

    fn say(&mut self, now: Instant, at: Instant, asked: Asked<'_>) {
        let Asked { speed, zero, velocity, .. } = asked;
        // The newer command of either message counts.
        if self.said.back().is_some_and(|said| at < said.at && velocity != said.velocity) {
            return;
        }
        let silent = |until: Instant| self.said.back().is_none_or(|said| until.since(said.at) + DELAY_MAX >= self.ttl);
        if silent(at) {
            self.unbroken = at;
        }
        // To a driver that hung, a source was silent that was not: it is served only now.
        if silent(now) {
            self.resumed = now;
        }
        if zero {
            self.ended = self.ended.or(Some(now));
        } else if self.ended.is_some() || self.trusted {
            (self.begun, self.ended) = (Some(now), None);
        }
        self.trusted = false;
        while self.said.len() >= COMMANDS_MAX || self.said.front().is_some_and(|said| now.since(said.at) > 2 * self.ttl)
        {
            self.said.pop_front();
        }
        self.said.push_back(ReceivedCommand { at, served: now, speed, velocity });
    }
}

/// All sources.
#[derive(Debug)]
pub(super) struct Sources {
    ttl: Duration,
    known: Vec<Source>,
    next_id: u64,
    /// Processes of the driver so far: one that was restarted does not know who commanded before.
    drivers: u32,
}

impl Sources {
    pub fn new(ttl: Duration) -> Self {
        Self { ttl, known: Vec::with_capacity(SOURCES_MAX), next_id: 0, drivers: 0 }
    }

    /// A process of the driver is started: every source must send zero to any but the first one before it may move.
    pub fn on_driver(&mut self) {
        self.drivers += 1;
        for source in &mut self.known {
            (source.begun, source.ended, source.trusted) = (None, None, self.drivers == 1);
        }
    }

    /// The driver is served a valid command that was received at `at`.
    pub fn said(&mut self, now: Instant, at: Instant, asked: Asked<'_>) {
        let place = self.place(asked.source, asked.priority);
        self.known[place].say(now, at, asked);
    }

    pub fn iter(&self) -> impl Iterator<Item = &Source> {
        self.known.iter()
    }

    pub fn by_id(&self, id: u64) -> Option<&Source> {
        self.known.iter().find(|source| source.id == id)
    }

    fn place(&mut self, name: &str, priority: i8) -> usize {
        if let Some(place) = self.known.iter().position(|known| known.priority == priority && known.name == name) {
            return place;
        }
        self.next_id += 1;
        let new = Source {
            id: self.next_id,
            name: name.into(),
            priority,
            said: VecDeque::with_capacity(COMMANDS_MAX),
            ttl: self.ttl,
            unbroken: Instant::ZERO,
            resumed: Instant::ZERO,
            begun: None,
            ended: None,
            trusted: self.drivers <= 1,
        };
        if self.known.len() < SOURCES_MAX {
            self.known.push(new);
            return self.known.len() - 1;
        }
        let oldest = (0..self.known.len()).min_by_key(|place| self.known[*place].heard()).unwrap_or(0);
        self.known[oldest] = new;
        oldest
    }
}
