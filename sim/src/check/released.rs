//! Wheels do not move by themselves (docs/design.md, section 4): homing needs an operator's release that is newer than
//! the last cause of a stop, a steering with a reference turns for a source of motion, or straight ahead after homing,
//! and under a cause none turns.
//!
//! The witnesses are the body, whose wheels turn, and the steering's statusword, which says whether it has a reference;
//! where it does not, `LL_DATA_MOTION`.
//! A release is an act that was served to the driver: motion of a manual source after its zero, a goal, a mode that
//! orders the robot to drive, an operator's RUN for the driver, the planner or all, `LL_CMD_HOMING`; and where the
//! configuration says so, the robot's start.
//! Causes are those that the driver was served, its own restart, and a steering that booted.

use super::Verdict;
use super::facts::{Facts, orders_to_drive};
use super::pause_line::{PAUSE_TIMEOUT, Pause};
use super::wire::Heartbeat;
use base::{Duration, Instant};
use messages::Message;
use module::State;

/// Time from a cause until the wheels stand: the drive's watch of the master's heartbeat, 200 ms, and its ramp, 50 ms.
const STANDS_WITHIN: Duration = Duration::from_millis(500);
/// Timeout of the watchdog's list.
const LIST_TIMEOUT: Duration = Duration::from_millis(250);
/// Least angle by which turning wheels change between two samples of the body, 50 ms apart, rad. The steering turns by
/// 0.035 at full speed, by 0.0087 towards its switch.
const TURNED_MIN_RAD: f64 = 0.004;
/// The same for wheels that must stand still, rad: faster than towards the switch.
const TURNED_STOPPED_RAD: f64 = 0.01;
/// Time in which the steering reaches any angle: 1.22 rad at 0.7 rad/s, and its ramps.
const REACHED_WITHIN: Duration = Duration::from_secs(2);
/// Time in which a steering that is homed finds its switch and turns straight ahead. If it is homed again it keeps its
/// reference meanwhile.
const HOMED_WITHIN: Duration = Duration::from_secs(17);

/// The steering, and the releases of its homing.
#[derive(Debug, Default)]
pub(super) struct Rule {
    /// The steering has a reference.
    referenced: bool,
    /// Begin of the reference.
    homed: Instant,
    /// Last angle, rad, and the process that simulates the body.
    angle: Option<(u32, f64)>,
    /// Last instant at which a cause other than homing was known to the driver.
    cause: Instant,
    /// Beginning of the present cause, while there is one.
    causes: Option<Instant>,
    /// Reception time of the last act.
    act: Option<Instant>,
    /// Processes of the driver so far.
    drivers: u32,
    /// The release by the robot's start was used: homing has ended, or was interrupted.
    started: bool,
    /// Homing has turned the wheels by that release.
    starts: bool,
}

impl Rule {
    /// Something may have changed: causes that begin and end between two samples count.
    pub fn update(&mut self, now: Instant, facts: &Facts) {
        if is_caused(now, facts) {
            self.on_cause(now);
            self.causes.get_or_insert(now);
        } else {
            self.causes = None;
        }
    }

    fn on_cause(&mut self, now: Instant) {
        self.cause = now;
        self.started |= self.starts;
    }

    /// A process of the driver is started.
    pub fn on_driver(&mut self) {
        self.drivers += 1;
        self.started |= self.drivers > 1;
    }

    /// The driver is served a message.
    pub fn on_heard(&mut self, now: Instant, at: Instant, message: &Message, facts: &Facts) {
        self.update(now, facts);
        let run_of = [facts.limits.driver.as_str(), facts.limits.planner.as_str(), "*"];
        let acts = match message {
            Message::MlCmdGoal(goal) => !goal.waypoints.is_empty(),
            Message::MlCmdMode(command) => orders_to_drive(command),
            Message::LlCmdHoming(_) => true,
            Message::CmCmdState(command) => {
                command.manual && command.state == State::Run as i8 && run_of.contains(&command.module.as_str())
            }
            Message::LlCmdMotion(_) | Message::LlCmdVelocity(_) => {
                facts.sources.iter().any(|source| !source.is_planner() && source.begun == Some(now))
            }
            _ => false,
        };
        if acts {
            self.act = Some(at);
        }
    }

    /// Processes a frame on the wire, except those to the propulsion.
    pub fn on_frame(&mut self, now: Instant, id: u16, data: &[u8], facts: &Facts) {
        let Some(steering) = &facts.limits.steering else { return };
        if let Some(status) = steering.reported(id, data) {
            if facts.limits.homed != 0 {
                self.on_reference(now, status & facts.limits.homed != 0);
            }
        } else if steering.heartbeat(id, data) == Some(Heartbeat::Down) {
            self.on_cause(now);
            self.referenced = false;
        }
    }

    /// The driver tells whether the steering has a reference: the witness for a drive that does not say it.
    pub fn on_motion(&mut self, now: Instant, homed: bool, facts: &Facts) {
        if facts.limits.homed == 0 {
            self.on_reference(now, homed);
        }
    }

    fn on_reference(&mut self, now: Instant, referenced: bool) {
        if referenced && !self.referenced {
            self.homed = now;
        }
        self.started |= referenced;
        self.referenced = referenced;
    }

    /// Processes a sample of the body's steering angle, rad, by the simulator of this process: another one's body
    /// begins anew, with its wheels straight ahead.
    pub fn on_truth(&mut self, now: Instant, pid: u32, angle: f64, facts: &Facts) -> Verdict {
        self.update(now, facts);
        if facts.limits.steering.is_none() {
            return Ok(());
        }
        let before = self.angle.replace((pid, angle)).filter(|(simulator, _)| *simulator == pid);
        let turned = before.map_or(0.0, |(_, before)| (angle - before).abs());
        // A drive that is out of reach, or was a moment ago, stops by itself.
        let unreached = facts.is_disturbed(now) || now.since(facts.driver.ill(now)) < STANDS_WITHIN;
        if turned < TURNED_MIN_RAD || unreached || facts.is_steering_ill(now) {
            return Ok(());
        }
        if let Some(since) = self.causes {
            let lasts = turned >= TURNED_STOPPED_RAD && now.since(since) > STANDS_WITHIN;
            return if lasts { Err(format!("the wheels turn, and are to stand since {since:?}")) } else { Ok(()) };
        }
        let release = self.act.filter(|act| *act + facts.slack(now) >= self.cause);
        let starts = facts.limits.homing_at_start && !self.started;
        self.starts |= starts && release.is_none();
        let homes = || {
            let straightens = self.homed >= self.cause && now.since(self.homed) < REACHED_WITHIN;
            straightens || release.is_some_and(|act| now.since(act) < HOMED_WITHIN)
        };
        let commanded = || facts.sources.iter().any(|source| source.lives(now, REACHED_WITHIN));
        let permitted = if self.referenced { homes() || commanded() } else { release.is_some() || starts };
        let permitted = permitted || now.since(self.cause) < STANDS_WITHIN;
        if permitted {
            return Ok(());
        }
        let why = if self.referenced { "nobody steers" } else { "nobody has released homing" };
        Err(format!("the wheels turn, and {why} since the stop at {:?}", self.cause))
    }
}

/// True while the driver was served a cause of a stop that no act ends.
fn is_caused(now: Instant, facts: &Facts) -> bool {
    let late = facts.driver.late;
    let line = facts.limits.power.is_some();
    let paused = match facts.pause.state() {
        Pause::Engaged(_) => true,
        Pause::Unheard => line,
        Pause::Open => line && now.since(facts.pause.heard()) >= PAUSE_TIMEOUT + late,
    };
    let listed = |(at, missing): (Instant, Option<Instant>)| missing.is_none() && now.since(at) < LIST_TIMEOUT + late;
    paused || !facts.list.is_some_and(listed) || facts.state.0 != State::Run
}
