//! Rules that hold in every simulated step, whatever fails: always on, fed by the news of a virtual machine.
//!
//! [`Checkers::observe`] receives every [`News`] with its time; the first violation of a rule is kept as a
//! [`Violation`]. Each rule is a file with its source and its bound. All are evaluated from the traffic on the wires,
//! the input that processes were served, and the motion of the body; no rule relies on a module's own report if there
//! is another witness. The knowledge of the drives' driver is what it was served ([`News::Heard`]), so late or lost
//! messages and a slow driver need no allowances. Deterministic; allocates only for a new module, process or source.
//!
//! Independent of module names: [`Limits`] has the names and the bounds of the robot's configuration.

mod authority;
mod believed;
mod blind;
mod body;
mod bounded;
mod clock;
mod critical;
mod drives;
mod facts;
mod feed;
mod foreign;
mod fresh;
mod homed;
mod idle;
mod late_watchdog;
mod life;
mod names;
mod pace;
mod pause;
mod pause_line;
mod promise;
mod queues;
mod refused;
mod released;
mod restarts;
mod resumes;
mod rival;
mod second_robot;
mod sight;
mod single;
mod sources;
mod stop;
mod stopped;
#[cfg(test)]
mod tests;
mod wanted;
pub mod wire;

pub use blind::RangingBoard;
pub use bounded::Guarded;
pub use promise::Promise;
pub use sight::{Hits, SeeingLidar, Sight};

use crate::host::News;
use base::can::Id;
use base::{Duration, Instant};
use facts::Facts;
use kinematics::Chassis;
use messages::{Message, common};
use module::State;
use module::admission::{Commands, Sender};
use pace::Pace;
use simulator::people::NoContact;
use simulator::world::World;
use std::fmt;

/// Name of the steering's axis.
const STEERING: &str = "steering";

/// Base of a robot that turns by its wheels. Its driver brings them to their speeds together, in steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Base {
    /// Kinematics.
    pub chassis: Chassis,
    /// Deceleration of the wheels, m/s².
    pub deceleration_mps2: f64,
}

/// A source of PAUSE that a module of the robot reports, beside the power controller.
#[derive(Clone, Debug, PartialEq)]
pub struct StopReport {
    /// Its name in `LL_EVENT_STOP`: `lidar.front`, `io.estop`.
    pub source: String,
    /// The module that alone reports that it is free.
    pub module: String,
}

/// Bounds of the rules, and names of the modules.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Module that moves the robot.
    pub driver: String,
    /// Module that supervises the others.
    pub watchdog: String,
    /// The module whose motion needs an operator's leave.
    pub planner: String,
    /// Modules without which the robot must not move; the driver is one of them.
    pub critical: Vec<String>,
    /// Module of the power controller, which reports the PAUSE line; absent without one.
    pub power: Option<String>,
    /// Other sources of PAUSE without whose reports the robot does not move.
    pub stops: Vec<StopReport>,
    /// Module that knows where the robot is, and alone says so; absent: whoever may command.
    pub estimator: Option<String>,
    /// Who may command.
    pub commands: Commands,
    /// The CAN buses of the drives: `can.main`; none if all are on serial lines.
    pub buses: Vec<String>,
    /// The propulsion: the driven axle, or each wheel of a base that does not steer.
    pub wheels: Vec<wire::Wheel>,
    /// The steering; absent: the robot turns by its wheels.
    pub steering: Option<wire::Drive>,
    /// The base of a robot that turns by its wheels.
    pub base: Option<Base>,
    /// Bit of the steering's statusword that says that it has a reference; 0: it has none.
    pub homed: u16,
    /// Maximum speed of a command, m/s; a faster one is rejected.
    pub speed: f64,
    /// Maximum steering angle of a command, rad; a greater one is rejected.
    pub steering_angle: f64,
    /// Rear axle to front axle, m; of a robot that turns by its wheels that of the curves of `LL_CMD_MOTION`.
    pub wheelbase: f64,
    /// Greatest speed of the driven tread per speed of the fixed axle; 1 if that is driven as a whole.
    pub tread_ratio: f64,
    /// Maximum rotation of a command, rad/s; a faster one is rejected.
    pub rotation: f64,
    /// Speed limit of manual sources, m/s.
    pub speed_manual: f64,
    /// Speed limit of the planner, m/s.
    pub speed_autonomous: f64,
    /// Deceleration of a quick stop, m/s².
    pub quick_stop: f64,
    /// Deceleration without commands, m/s², of drives that then roll on; `None`: they stop by themselves.
    pub coasting: Option<f64>,
    /// Time to live of a command.
    pub ttl: Duration,
    /// Boards of range finders.
    pub ranging: Vec<RangingBoard>,
    /// The robot's start releases the first homing.
    pub homing_at_start: bool,
    /// The second way to stop: the motors' feed can be cut.
    pub feed_is_cut: bool,
    /// The guard; absent: the robot senses nothing.
    pub guard: Option<Guarded>,
    /// What a guard with sonars promises; absent: none of it is judged.
    pub promise: Option<Promise>,
    /// What a guard with lidars promises; absent: none of it is judged.
    pub sight: Option<Sight>,
    /// Maximum delay between the end of a process and its restart.
    pub restart_max: Duration,
}

impl Limits {
    /// Number of a CAN bus of drives.
    pub(crate) fn bus(&self, name: &str) -> Option<u8> {
        let number = self.buses.iter().position(|bus| bus == name)?;
        u8::try_from(number).ok()
    }

    /// True for a bus of drives, or the serial line of one.
    fn is_bus(&self, target: &str) -> bool {
        self.bus(target).is_some() || self.wheels.iter().any(|wheel| wheel.drive.line() == Some(target))
    }

    /// Number of the wheel whose drive has this RPDO.
    fn wheel(&self, rpdo: u16) -> Option<usize> {
        self.wheels.iter().position(|wheel| wheel.drive.command.id == rpdo)
    }

    /// Number and statusword of the wheel whose drive reports in this frame.
    fn reported(&self, id: u16, data: &[u8]) -> Option<(usize, u16)> {
        self.wheels.iter().enumerate().find_map(|(number, wheel)| Some((number, wheel.drive.reported(id, data)?)))
    }

    /// True for the port of a lidar that the guard uses.
    fn is_lidar(&self, target: &str) -> bool {
        self.sight.as_ref().is_some_and(|sight| sight.lidars.iter().any(|lidar| lidar.bus == target))
    }

    /// Number of the wheel whose motor controller reports in this frame that it is disarmed.
    fn disarmed(&self, id: u16, data: &[u8]) -> Option<usize> {
        self.wheels.iter().position(|wheel| {
            let drive = &wheel.drive;
            drive.protocol != wire::Protocol::Canopen && drive.heartbeat(id, data) == Some(wire::Heartbeat::Down)
        })
    }

    /// True if a drive is sent its set-point in each period, not with each decision only.
    fn repeats(&self) -> bool {
        self.wheels.iter().any(|wheel| wheel.drive.protocol != wire::Protocol::Canopen)
    }

    /// All drives, with their names.
    fn drives(&self) -> impl Iterator<Item = (&str, &wire::Drive)> {
        let wheels = self.wheels.iter().map(|wheel| (wheel.name.as_str(), &wheel.drive));
        wheels.chain(self.steering.iter().map(|steering| (STEERING, steering)))
    }
}

/// Violation of a rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// Time of its detection.
    pub at: Instant,
    /// Rule, by the name of its file.
    pub rule: &'static str,
    /// Description, in one line.
    pub what: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at {:.6} s, rule {}: {}", self.at.as_nanos() as f64 / 1e9, self.rule, self.what)
    }
}

/// Longest times for which rules have a bound; `None` if the event did not occur.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Times {
    /// From the time at which the driver was served an engaged PAUSE to the stop on the bus.
    pub pause_to_stop: Option<Duration>,
    /// From the hang or death of the watchdog or a critical module (the last one of overlapping faults) to the stop on
    /// the bus, or to the drive's report of its own stop.
    pub loss_to_stop: Option<Duration>,
    /// In calm, until a module reached its wanted state.
    pub calm_to_wanted: Option<Duration>,
}

impl Times {
    /// Keeps the longer time of each.
    pub fn add(&mut self, other: &Self) {
        self.pause_to_stop = self.pause_to_stop.max(other.pause_to_stop);
        self.loss_to_stop = self.loss_to_stop.max(other.loss_to_stop);
        self.calm_to_wanted = self.calm_to_wanted.max(other.calm_to_wanted);
    }
}

/// Verdict of a rule: fulfilled, or the violation.
type Verdict = Result<(), String>;

/// All rules.
#[derive(Debug)]
pub struct Checkers {
    facts: Facts,
    listener: wire::Listener,
    pace: Pace,
    authority: authority::Rule,
    blind: blind::Rule,
    body: body::Rule,
    bounded: bounded::Rule,
    clock: clock::Rule,
    drives: drives::Rule,
    feed: feed::Rule,
    foreign: foreign::Rule,
    homed: homed::Rule,
    late_watchdog: late_watchdog::Rule,
    pause: pause::Rule,
    promise: promise::Rule,
    released: released::Rule,
    restarts: restarts::Rule,
    rival: rival::Rule,
    second_robot: second_robot::Rule,
    sight: sight::Rule,
    single: single::Rule,
    stop: stop::Rule,
    stopped: stopped::Rule,
    wanted: wanted::Rule,
    setpoints: u64,
    violation: Option<Violation>,
}

impl Checkers {
    /// Creates the checkers of a machine without processes.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            blind: blind::Rule::new(&limits.ranging),
            drives: drives::Rule::new(&limits),
            feed: feed::Rule::new(limits.wheels.len()),
            foreign: foreign::Rule::new(limits.ttl),
            stop: stop::Rule::new(limits.wheels.len()),
            promise: promise::Rule::new(&limits.ranging),
            listener: wire::Listener::new(&limits.wheels),
            facts: Facts::new(limits),
            authority: authority::Rule::default(),
            body: body::Rule::default(),
            bounded: bounded::Rule::default(),
            clock: clock::Rule::default(),
            homed: homed::Rule::default(),
            late_watchdog: late_watchdog::Rule::default(),
            pause: pause::Rule::default(),
            released: released::Rule::default(),
            restarts: restarts::Rule::default(),
            rival: rival::Rule::default(),
            second_robot: second_robot::Rule::default(),
            sight: sight::Rule::default(),
            single: single::Rule::default(),
            pace: Pace::default(),
            stopped: stopped::Rule::default(),
            wanted: wanted::Rule::default(),
            setpoints: 0,
            violation: None,
        }
    }

    /// The same, of a robot in this world: without it nothing is judged by what is in sight.
    #[must_use]
    pub fn in_world(mut self, world: &World) -> Self {
        self.sight.set_world(world);
        self
    }

    /// Contacts at more than 0.05 m/s in which the robot moved: with what was in sight of a lidar for the time that it
    /// takes to stop, and with what came out of hiding. Both 0 without a guard that uses lidars.
    #[must_use]
    pub fn hits(&self) -> (Hits, Hits) {
        (self.sight.seen, self.sight.hidden)
    }

    /// First violation.
    #[must_use]
    pub fn violation(&self) -> Option<&Violation> {
        self.violation.as_ref()
    }

    /// Number of set-points that moved the robot: a run without motion proves nothing.
    #[must_use]
    pub fn setpoints(&self) -> u64 {
        self.setpoints
    }

    /// Speed of the body, m/s: of a robot that steers; of any other one that of its fastest wheel, so that a turn on
    /// the spot is motion, too.
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.pace.speed
    }

    /// Longest times so far.
    #[must_use]
    pub fn times(&self) -> Times {
        Times { pause_to_stop: self.pause.worst, loss_to_stop: self.stop.worst, calm_to_wanted: self.wanted.worst }
    }

    /// Begins the calm: no faults are injected, and all modules must reach their wanted state (`wanted`).
    pub fn calm(&mut self, now: Instant) {
        self.wanted.calm(now);
    }

    /// Ends the calm.
    pub fn chaos(&mut self) {
        self.wanted.chaos();
    }

    /// Processes a news item. Nothing is evaluated after the first violation.
    pub fn observe(&mut self, now: Instant, news: &News<'_>) {
        if self.violation.is_some() {
            return;
        }
        self.facts.observe(now, news);
        let judged = self.judge(now, news);
        if let Err((rule, what)) = judged.and_then(|()| self.judge_telegrams(now, news)) {
            self.violation = Some(Violation { at: now, rule, what });
        }
    }

    /// Judges what motor controllers are sent and report that are no CANopen nodes.
    fn judge_telegrams(&mut self, now: Instant, news: &News<'_>) -> Result<(), (&'static str, String)> {
        let telegrams = match news {
            News::Can { bus, pid, frame } if *pid != 0 => {
                let Some(bus) = self.facts.limits.bus(bus) else { return Ok(()) };
                self.listener.on_frame(bus, frame)
            }
            News::Words { bus, pid, words } => self.listener.on_words(bus, self.facts.driver.pid == Some(*pid), words),
            News::CanLost { bus, frame } => {
                let Some(bus) = self.facts.limits.bus(bus) else { return Ok(()) };
                let lost = self.listener.on_frame_lost(bus, frame);
                lost.into_iter().for_each(|id| self.drives.on_frame_lost(id));
                return Ok(());
            }
            _ => return Ok(()),
        };
        telegrams.into_iter().try_for_each(|(id, data)| {
            self.facts.on_frame(now, id, &data);
            self.on_frame(now, id, &data)
        })
    }

    fn judge(&mut self, now: Instant, news: &News<'_>) -> Result<(), (&'static str, String)> {
        let facts = &self.facts;
        match news {
            News::Can { bus, pid, frame } => match (facts.limits.bus(bus), frame.id()) {
                (Some(bus), Id::Standard(id)) if *pid != 0 => self.on_frame(now, wire::on_bus(bus, id), frame.data()),
                (Some(bus), _) if *pid == 0 => {
                    self.rival.on_foreign(now, bus, frame, facts);
                    Ok(())
                }
                _ => Ok(()),
            },
            News::Heard { pid, at, sender, message }
                if facts.driver.pid == Some(*pid) && facts.believes(*sender, message) =>
            {
                self.released.on_heard(now, *at, message, facts);
                match message {
                    Message::LlDataGuard(guard) => self.bounded.on_guard(now, *at, guard),
                    Message::LlCmdCreep(creep) => self.bounded.on_creep(*at, creep),
                    _ => {}
                }
                Ok(())
            }
            News::CanLost { bus, frame } => {
                if let (Some(bus), Id::Standard(id)) = (facts.limits.bus(bus), frame.id()) {
                    self.drives.on_frame_lost(wire::on_bus(bus, id));
                }
                Ok(())
            }
            News::Message { sender, message } => self.on_message(now, *sender, message),
            News::Words { bus, words, .. } => {
                self.blind.on_words(now, bus, words, facts);
                self.promise.on_words(now, bus, words, facts);
                Ok(())
            }
            News::Note { line, .. } => match line.parse() {
                Ok(contact) => {
                    named("promise", self.promise.on_contact(now, &contact, facts))?;
                    named("sight", self.sight.on_contact(now, &contact, facts))
                }
                Err(NoContact) => Ok(()),
            },
            News::Started { module, pid } => {
                self.clock.on_started(*pid);
                if *module == facts.limits.watchdog {
                    self.stop.on_back(module);
                    self.late_watchdog.on_late(now, Duration::ZERO);
                } else if *module == facts.limits.driver {
                    self.released.on_driver();
                    self.bounded.on_driver();
                    self.feed.on_driver(now);
                }
                named("single", self.single.on_started(module, *pid))?;
                named("restarts", self.restarts.on_started(now, module, facts))
            }
            News::Exited { module, pid, .. } => {
                self.clock.on_exited(*pid);
                self.single.on_exited(*pid);
                self.restarts.on_exited(now, module);
                self.stop.on_lost(now, module, facts);
                Ok(())
            }
            News::Hung { module, .. } => {
                self.stop.on_lost(now, module, facts);
                Ok(())
            }
            News::Resumed { module, .. } => {
                self.stop.on_back(module);
                Ok(())
            }
            News::Crawls { module, late, .. } if *module == facts.limits.watchdog => {
                self.late_watchdog.on_late(now, *late);
                Ok(())
            }
            News::State { module, state } => {
                self.released.update(now, facts);
                if *module == facts.limits.watchdog && *state == State::Init {
                    self.restarts.on_watchdog();
                }
                named("stopped", self.stopped.on_state(now, module, *state, facts))
            }
            News::Fault { target, fault, until } => {
                self.sight.on_fault(now, target, fault, *until, facts);
                Ok(())
            }
            News::Dropped { whose, count } => named("queues", queues::on_dropped(now, whose, *count, facts)),
            _ => Ok(()),
        }
    }

    fn on_frame(&mut self, now: Instant, id: u16, data: &[u8]) -> Result<(), (&'static str, String)> {
        let Some(wheel) = self.facts.limits.wheel(id) else {
            named("stop", self.stop.on_frame(now, id, data, &self.facts))?;
            self.drives.on_frame(now, id, data, &self.facts);
            self.feed.on_frame(id, data, &self.facts);
            self.released.on_frame(now, id, data, &self.facts);
            return Ok(());
        };
        if self.facts.limits.wheels[wheel].drive.commanded(data).is_none() {
            return Err(("fresh", "a short RPDO".into()));
        }
        let left_over = self.facts.is_left_over(now);
        let facts = &self.facts;
        if facts.wheels[wheel].speed().is_some() {
            self.drives.on_moving(wheel, facts);
        }
        let Some(speed) = facts.set_point.speed() else {
            named("stop", self.stop.on_still(now, facts))?;
            self.feed.on_still(now, facts);
            self.pause.on_still(now, facts);
            self.authority.on_still(facts.set_point);
            return Ok(());
        };
        if facts.wheels[wheel].speed().is_none() {
            // It stands, and others do not: not yet, or it has no part in this motion.
            return Ok(());
        }
        if left_over || now.since(facts.driver.started) <= facts.slack(now) {
            // Or its process died: frames handed over before are still sent.
            return Ok(());
        }
        self.setpoints += 1;
        self.pause.on_moving();
        named("foreign", self.foreign.on_set_point(now, speed, facts))?;
        named("second_robot", self.second_robot.on_set_point(now, speed, facts))?;
        named("rival", self.rival.on_set_point(now, speed, facts))?;
        named("late_watchdog", self.late_watchdog.on_set_point(now, speed, facts))?;
        named("feed", self.feed.on_set_point(now, speed))?;
        named("fresh", fresh::on_set_point(now, speed, facts))?;
        named("resumes", resumes::on_set_point(now, speed, facts))?;
        named("pause", pause::on_set_point(now, speed, facts))?;
        named("critical", critical::on_set_point(now, speed, facts))?;
        named("refused", refused::on_set_point(now, speed, facts))?;
        named("idle", idle::on_set_point(now, speed, facts))?;
        named("blind", self.blind.on_set_point(now, speed, facts))?;
        named("bounded", self.bounded.on_set_point(now, speed, facts))?;
        named("drives", self.drives.on_set_point(now, speed, facts))?;
        named("homed", self.homed.on_set_point(now, speed, facts))?;
        named("authority", self.authority.on_set_point(now, speed, facts))
    }

    fn on_message(&mut self, now: Instant, sender: Sender, message: &Message) -> Result<(), (&'static str, String)> {
        let facts = &self.facts;
        if !facts.believes(sender, message) {
            self.foreign.on_message(now, message, &facts.limits);
            self.second_robot.on_message(now, message, facts);
            return Ok(());
        }
        let pid = sender.pid().unwrap_or(0);
        named("clock", self.clock.on_message(pid, message))?;
        match message {
            Message::LlDataMotion(motion) => {
                self.released.on_motion(now, motion.homed, facts);
                named("homed", self.homed.on_motion(now, pid, motion))?;
                named("authority", self.authority.on_motion(now, motion, facts))
            }
            Message::SimDataTruth(truth) => {
                self.promise.on_truth(truth);
                self.sight.on_truth(now, truth, facts);
                let speed = self.pace.speed(now, pid, truth, facts.limits.base.as_ref());
                named("pause", self.pause.on_truth(now, speed, truth.clearance, facts))?;
                named("body", self.body.on_truth(now, speed, facts))?;
                named("feed", self.feed.on_truth(now, speed, facts))?;
                named("released", self.released.on_truth(now, pid, truth.steering, facts))?;
                named("drives", self.drives.on_truth(now, speed, self.pace.twist, facts))?;
                named("stop", self.stop.on_truth(now, speed, facts))?;
                named("wanted", self.wanted.on_time(now))
            }
            Message::SimDataPeople(people) => {
                self.sight.on_people(now, people, facts);
                Ok(())
            }
            Message::LlCmdCreep(_) => {
                self.promise.on_creep(now);
                self.sight.on_creep(now);
                Ok(())
            }
            Message::CmCmdState(command) => {
                self.on_command(now, pid, command);
                Ok(())
            }
            Message::LlCmdPower(command) => {
                let by_driver = facts.driver.pid == Some(pid);
                named("feed", self.feed.on_power(now, by_driver, command, facts))
            }
            Message::CmDataProcesses(list) => named("wanted", self.wanted.on_list(now, pid, list)),
            _ => Ok(()),
        }
    }

    fn on_command(&mut self, now: Instant, pid: u32, command: &common::CmdState) {
        let Some(to) = State::from_value(command.state) else { return };
        // Commands of the watchdog only repeat earlier ones.
        let watchdog = self.facts.life(&self.facts.limits.watchdog).and_then(|life| life.pid) == Some(pid);
        self.wanted.on_command(now, &command.module, to);
        self.restarts.on_command(&command.module);
        if command.manual && !watchdog {
            self.stopped.on_manual(now, &command.module, to, &self.facts);
        }
    }
}

fn named(rule: &'static str, verdict: Verdict) -> Result<(), (&'static str, String)> {
    verdict.map_err(|what| (rule, what))
}
