//! Planner module: subscriptions, control loop, published messages.

use crate::attention::Attention;
use crate::config::Config;
use crate::goal::Goal;
use crate::goal_state::{GoalState, Hindrance};
use crate::mission::{Mission, StepInput};
use crate::mode::Mode;
use crate::obstacles::{Fired, Obstacles};
use crate::parameters::Parameters;
use crate::people::Person;
use crate::ranges::{self, READING_VALID_FOR, Sounding};
use crate::route::PlanningSpace;
use crate::search::Abilities;
use crate::senses::{EstimateCheck, Located, Senses, Wait};
use crate::track::{Axis, Motion};
use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use messages::lowlevel::{CmdMotion, CmdVelocity, DataRanges, DataScan, EventStop};
use messages::middlelevel::{
    CmdGoal, DataEstimate, DataGoal, DataMode, DataObstacles, DataPersons, DataPlan, TrackedPerson,
};
use messages::{Channel, Message, StopSource};
use module::admission::Origin;
use module::{Actions, ActiveHold, Event, Holds, Module, State};
use navitools::{Point, Pose};

mod modes;

/// Name of the module, and the source of its motion commands.
pub const NAME: &str = "planner";

/// Period of motion commands.
const CONTROL_PERIOD: Duration = Duration::from_millis(50);
/// Longest period of `ML_DATA_GOAL`.
const GOAL_PERIOD_MAX: Duration = Duration::from_millis(200);
/// Period of `ML_DATA_OBSTACLES`, and longest period of `ML_DATA_PLAN`.
const SCENE_PERIOD: Duration = Duration::from_secs(1);
/// Period of `ML_DATA_PERSONS` while scans are used.
const PERSONS_PERIOD: Duration = Duration::from_millis(200);
/// Period at which scans change the path that is checked; obstacles are entered with each sector.
const SCAN_PERIOD: Duration = Duration::from_millis(50);
/// Greatest age of a sector; an older timestamp is of another clock.
const SCAN_AGE_MAX: Duration = Duration::from_millis(300);
/// Greatest coordinate of a lidar on the robot, m, and direction, rad.
const MOUNT_MAX: f64 = 20.0;
/// Number of zero commands after the last motion, in case some are lost.
const ZERO_COMMANDS: u32 = 10;

base::deadlines! {
    /// Periodic work, from the start on.
    enum Timer {
        /// Step of the control loop.
        Control,
        /// `ML_DATA_GOAL` is published.
        Goal,
        /// `ML_DATA_PLAN` and `ML_DATA_OBSTACLES` are published.
        Scene,
        /// `ML_DATA_PERSONS` is published. Set from the first scan that is used until one after the last.
        Persons,
        /// `ML_DATA_MODE` is published.
        Mode,
        /// `ML_DATA_PARAMETERS` is published.
        Parameters,
    }
}

/// Planner module.
pub struct Planner {
    /// Configuration with the present values of the parameters.
    config: Config,
    parameters: Parameters,
    mode: Mode,
    attention: Attention,
    /// Refused modes and parameters that were reported since the last periodic `ML_DATA_PARAMETERS`.
    refusals: u8,
    /// Mode, state and text as last published.
    published_mode: (Mode, i8, String),
    space: PlanningSpace,
    senses: Senses,
    obstacles: Obstacles,
    /// Instant of the last scan that was checked along the path.
    scanned: Instant,
    /// Instant of the last scan that was used while the robot knew where it is.
    scan_used: Instant,
    mission: Mission,
    /// Last motion command.
    command: Motion,
    /// Session of `LL_CMD_VELOCITY`: the time of the start.
    session: i64,
    /// Number of zero commands still to be sent.
    zeros: u32,
    /// True if the last estimate was not a number, or its time ran backwards.
    estimate_bad: bool,
    /// The floor rangers of a board engage PAUSE: those at the front, or at the rear.
    edge: Option<bool>,
    /// True if the planner drove the robot in the last step.
    was_driving: bool,
    /// Causes that hold the robot, the most important one first.
    waits: Vec<Wait>,
    holds: Holds,
    /// Goal, waypoint, status and text as last published.
    published: (i32, usize, i8, String),
    deadlines: Deadlines<Timer>,
}

impl Planner {
    /// Creates the module.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            space: PlanningSpace::new(&config),
            parameters: Parameters::new(&config.limits, &config.behaviour),
            config,
            mode: Mode::default(),
            attention: Attention::default(),
            refusals: 0,
            published_mode: (Mode::default(), DataMode::IDLE, String::new()),
            senses: Senses::default(),
            obstacles: Obstacles::new(),
            scanned: Instant::ZERO,
            scan_used: Instant::ZERO,
            mission: Mission::default(),
            command: Motion::default(),
            session: 0,
            zeros: 0,
            estimate_bad: false,
            edge: None,
            was_driving: false,
            waits: Vec::new(),
            holds: Holds::default(),
            published: (0, 0, DataGoal::IDLE, String::new()),
            deadlines: Deadlines::new(),
        }
    }

    fn on_message(&mut self, now: Instant, at: Instant, from: Origin, message: &Message, out: &mut Actions) {
        let at = at.min(now);
        match message {
            Message::MlDataEstimate(estimate) => self.on_estimate(at, estimate, out),
            Message::LlDataMotion(motion) => self.senses.on_motion(at, motion),
            Message::LlDataVelocity(velocity) => self.senses.on_velocity(velocity),
            Message::LlDataGuard(guard) => self.senses.on_guard(at, guard),
            Message::LlDataHold(holds) => self.senses.on_hold(at, holds),
            // Of another sender than the power controller: no bumper was met, and nothing of the line is released.
            Message::LlEventStop(stop) if !from.due => self.senses.on_stop_of_another(at, stop),
            Message::LlEventStop(stop) => {
                self.senses.on_stop(at, stop);
                self.on_line(stop);
            }
            Message::LlDataRanges(ranges) => {
                self.senses.on_ranges(at);
                self.on_floor(at, ranges);
                self.on_soundings(now, &ranges::of_ranges(at, ranges));
            }
            Message::LlDataScan(scan) => self.on_scan(now, at, scan, out),
            Message::LlDataSrfs(srfs) if self.senses.lacks_ranges(at) => {
                self.on_soundings(now, &ranges::of_srfs(at, srfs, self.config.sonar_beam));
            }
            Message::MlCmdGoal(goal) => self.on_goal(now, goal, out),
            Message::MlCmdMode(command) => self.on_mode(now, command, out),
            Message::MlCmdParameter(command) => self.on_parameter(now, command, out),
            _ => {}
        }
    }

    /// A report about the PAUSE line: what touches the robot, and where it sees no floor. Others say nothing of that.
    fn on_line(&mut self, stop: &EventStop) {
        if !StopSource::is_of_line(&stop.source) {
            return;
        }
        let source = StopSource::from_name(&stop.source);
        if let Some(front) = source.is_front().filter(|_| stop.engaged) {
            self.mission.bump(front);
        }
        self.edge = source.is_front().filter(|_| stop.engaged && source.is_floor());
    }

    fn on_estimate(&mut self, at: Instant, estimate: &DataEstimate, out: &mut Actions) {
        let check = self.senses.on_estimate(at, estimate);
        let bad = matches!(check, EstimateCheck::NotFinite | EstimateCheck::OutOfOrder);
        if self.estimate_bad && !bad {
            out.clear(Fault::EstimateBad, "", "the estimate is valid again");
        }
        self.estimate_bad = bad;
        match check {
            EstimateCheck::Ok => {}
            EstimateCheck::Jumped => {
                self.obstacles.clear();
                self.attention = Attention::default();
                self.mission.interrupt();
                self.mission.forget_trace();
            }
            EstimateCheck::NotFinite => {
                out.raise(Severity::Error, Fault::EstimateBad, "", "the estimate is not a number: the robot stops");
            }
            EstimateCheck::OutOfOrder => {
                let why = "the estimate's time runs backwards: the robot stops";
                out.raise(Severity::Error, Fault::EstimateBad, "", why);
            }
        }
    }

    fn on_soundings(&mut self, now: Instant, soundings: &[Sounding]) {
        self.senses.on_soundings(soundings);
        let fired = |sounding: &Sounding| {
            let located = self.senses.when_fired(sounding.at)?;
            Some(Fired { sounding: *sounding, robot: located.pose, speed: located.moved.translation })
        };
        let Some(round) = soundings.iter().map(fired).collect::<Option<Vec<_>>>() else { return };
        let known = soundings.iter().filter(|sounding| sounding.is_known());
        let newest = known.map(|sounding| sounding.at).max().unwrap_or(now);
        let Some(last) = self.senses.when_fired(newest) else { return };
        let (body, space, slack) = (&self.config.body, &self.space, slack(&last));
        let mapped = |point| space.is_mapped(point, slack);
        self.obstacles.update(now, last.pose, &round, |point| body.covers(point, 0.0), mapped);
        self.mission.check_ahead(now, &self.obstacles, &self.config);
    }

    fn on_scan(&mut self, now: Instant, at: Instant, scan: &DataScan, out: &Actions) {
        // The middle of the sector stands for all of it.
        let half = (scan.beam_time * scan.ranges.len() as f64 / 2.0 * 1e6).clamp(0.0, 1e5) as i64;
        let age = out.timestamp(at).saturating_sub(scan.timestamp.saturating_add(half));
        let age = Duration::from_micros(u64::try_from(age).unwrap_or(0)).min(SCAN_AGE_MAX);
        let sits = [scan.x, scan.y, scan.theta].iter().all(|value| value.abs() <= MOUNT_MAX);
        let Some(located) = self.senses.when_fired(at - age).filter(|_| sits) else { return };
        let lidar = located.pose * Pose::new(scan.x, scan.y, scan.theta);
        let (body, space, slack) = (&self.config.body, &self.space, slack(&located));
        let mapped = |point| space.is_mapped(point, slack);
        self.obstacles.on_scan(at - age, (located.pose, lidar), scan, |point| body.covers(point, 0.0), mapped);
        if self.senses.located(now).is_some() {
            self.scan_used = now;
            if !self.deadlines.is_set(Timer::Persons) {
                self.deadlines.set(Timer::Persons, now);
            }
        }
        if now.since(self.scanned) >= SCAN_PERIOD {
            self.scanned = now;
            self.mission.check_ahead(now, &self.obstacles, &self.config);
        }
    }

    /// Remembers the edge that a board's floor rangers see, as long as it engages PAUSE for it.
    fn on_floor(&mut self, at: Instant, ranges: &DataRanges) {
        let Some((front, robot)) = self.edge.zip(self.senses.when_fired(at)) else { return };
        for (place, theta) in ranges::without_floor(ranges).filter(|(place, _)| (place.x > 0.0) == front) {
            self.obstacles.add_edge(robot.pose * Pose::new(place.x, place.y, theta));
        }
    }

    /// Begins a goal, or refuses it. A robot that drives to another one then goes on: it is not stopped by a mistake.
    /// One that is held ends it, since the command may have released what holds it, for that goal alone. What replaces
    /// or ends the goal of another mode ends that mode.
    fn on_goal(&mut self, now: Instant, command: &CmdGoal, out: &mut Actions) {
        let drives = self.is_driving(now);
        let refused = match Goal::of(command) {
            Ok(None) => {
                self.leave_mode(now);
                return self.mission.end(command.id, GoalState::Cancelled);
            }
            Ok(Some(_)) if self.mode == Mode::Manual => GoalState::ModeManual,
            Ok(Some(goal)) => match self.impossible(&goal, drives) {
                None => {
                    self.leave_mode(now);
                    return self.mission.begin(goal, drives);
                }
                Some((waypoint, why)) => GoalState::CannotReach(waypoint, why),
            },
            Err(why) => GoalState::Refused(why),
        };
        if drives {
            return self.mission.refuse(command.id, refused);
        }
        if matches!(refused, GoalState::Refused(_) | GoalState::ModeManual) {
            out.report(Severity::Warning, Fault::GoalRefused, "", format!("goal {} {refused}", command.id));
        }
        self.leave_mode(now);
        self.mission.end(command.id, refused);
    }

    /// Waypoint of a goal that cannot be reached, and why, as far as that is known without a search. Where the robot
    /// cannot stand is looked at only if there is something to lose: it may stand there already.
    fn impossible(&self, goal: &Goal, drives: bool) -> Option<(usize, Hindrance)> {
        let blocked = || {
            let first = goal.waypoints.first().filter(|_| drives)?;
            Some((0, self.space.blocked(first)?))
        };
        self.space.outside(&goal.waypoints).or_else(blocked)
    }

    /// True if the robot drives to a goal: nothing holds it.
    fn is_driving(&self, now: Instant) -> bool {
        let runs = self.senses.state == Some(State::Run);
        self.was_driving && runs && self.mission.has_goal() && self.waits_now(now).is_empty()
    }

    /// Causes that hold the robot.
    fn waits_now(&self, now: Instant) -> Vec<Wait> {
        // Without readings ahead the robot does not back out either: from there it could not continue.
        let Config { body, age_max, has_sonars, .. } = &self.config;
        let blind = has_sonars.then(|| self.obstacles.is_blind(now, true, body, *age_max));
        self.senses.waits(now, NAME, blind)
    }

    /// True if there is anything to command or to wait for.
    fn is_busy(&self) -> bool {
        self.mission.has_goal() || self.zeros > 0 || self.attends()
    }

    /// One step of the control loop.
    fn control(&mut self, now: Instant, out: &mut Actions) {
        self.attend(now);
        let wants = self.mission.has_goal() && self.senses.state == Some(State::Run);
        let located = self.senses.located(now);
        self.waits = self.waits_now(now);
        let drives = wants && self.waits.is_empty();
        if self.was_driving && !drives {
            self.mission.interrupt();
        }
        self.was_driving = drives;
        let aim = match located {
            Some(located) if drives => {
                let (motion, permitted) = (self.motion(), self.senses.permitted(now));
                let Self { obstacles, config, .. } = self;
                let input = StepInput { now, robot: located.pose, motion, permitted, obstacles, config };
                self.mission.step(&input, &mut self.space)
            }
            _ => Motion { speed: 0.0, ..self.motion() },
        };
        // With or without a goal, a motion ends with a zero command that is received.
        self.zeros = if wants { ZERO_COMMANDS } else { self.zeros };
        if self.zeros == 0 {
            return;
        }
        self.zeros -= 1;
        self.command = self.reachable(aim);
        let Motion { speed, steering, axis } = self.command;
        let (timestamp, priority, source) = (out.timestamp(now), CmdMotion::PLANNER, NAME.into());
        let (vx, vy, omega) = match axis {
            Axis::Along if self.steers() || speed != 0.0 => {
                return out.publish(CmdMotion { timestamp, speed, steering, priority, source });
            }
            Axis::Along => (0.0, 0.0, 0.0),
            Axis::Aside => (0.0, speed, 0.0),
            Axis::Spot => (0.0, 0.0, speed / self.config.body.arm()),
        };
        // A new session follows the release by the goal, so it is sent with the first zero already.
        out.publish(CmdVelocity { timestamp, vx, vy, omega, priority, source, session: self.session });
    }

    fn steers(&self) -> bool {
        self.config.abilities == Abilities::default()
    }

    /// Measured motion.
    fn measured(&self) -> Motion {
        let Config { body, limits, .. } = &self.config;
        let most = libm::tan(limits.steering) / body.wheelbase;
        if self.steers() { self.senses.motion() } else { self.senses.motion_of_wheels(body.arm(), most) }
    }

    /// Measured motion and steering angle of the robot. At standstill a base that does not steer has no angle: that of
    /// the command is the one with which it begins.
    fn motion(&self) -> Motion {
        let motion = self.measured();
        if self.steers() { motion } else { Motion { steering: self.command.steering, ..motion } }
    }

    /// Command that the drives can follow until the next step. Decelerations take effect at once.
    fn reachable(&self, aim: Motion) -> Motion {
        let limits = &self.config.limits;
        let period = CONTROL_PERIOD.as_secs_f64();
        let axis = aim.axis;
        let (last, now) = (self.command.along(axis), self.measured().along(axis));
        let step = limits.acceleration * period;
        // A new direction begins at standstill, and a start at the measured speed.
        let from = if last * aim.speed < 0.0 { 0.0 } else { last };
        let from = if from.abs() > now.abs() + 0.2 { now } else { from };
        let faster = from.abs() + step;
        let speed = aim.speed.clamp(-faster, faster).clamp(-limits.speed, limits.speed);
        // At most twice the steering rate.
        let turn = 2.0 * limits.steering_rate * period;
        let steering = aim.steering.clamp(self.command.steering - turn, self.command.steering + turn);
        let steering = steering.clamp(-limits.steering, limits.steering);
        let curvature = libm::tan(steering).abs() / self.config.body.wheelbase;
        let speed = match axis {
            Axis::Along if speed.abs() * curvature > limits.rotation => (limits.rotation / curvature).copysign(speed),
            _ => speed,
        };
        let sane = speed.is_finite() && steering.is_finite();
        if sane { Motion { speed, steering, axis } } else { Motion::default() }
    }

    /// Causes that prevent driving to a goal.
    fn waits(&self) -> &[Wait] {
        if self.mission.has_goal() { &self.waits } else { &[] }
    }

    fn publish_holds(&mut self, now: Instant, out: &mut Actions) {
        let mut holds = std::mem::take(&mut self.holds);
        let waits = self.waits();
        // Without such a cause, the mission has the cause for which it does not drive.
        let own = self.mode_hold().or_else(|| self.mission.hold()).filter(|_| waits.is_empty());
        let own = own.as_ref().map(|(hold, subject)| ActiveHold::new(*hold, subject));
        let waits =
            waits.iter().map(|wait| ActiveHold { hold: wait.hold, subject: &wait.subject, latched: wait.latched });
        holds.publish(now, NAME, waits.chain(own), out);
        self.holds = holds;
    }

    fn publish_goal(&mut self, now: Instant, out: &mut Actions) {
        self.publish_holds(now, out);
        let refused = self.publish_refused(now, out);
        let (id, waypoint, state) = self.mission.status();
        let message = self.goal_message();
        let current = (id, waypoint, state.status() as i8, message);
        let changed = current != self.published;
        // What is refused is told once, and followed by the goal that goes on.
        if !(self.deadlines.tick(Timer::Goal, now, GOAL_PERIOD_MAX) | changed | refused) {
            return;
        }
        if changed {
            self.published = current;
        }
        let (id, waypoint, status, message) = &self.published;
        out.publish(DataGoal {
            timestamp: out.timestamp(now),
            id: *id,
            waypoint: *waypoint as i32,
            status: *status,
            remaining: self.mission.remaining(),
            message: message.clone(),
        });
    }

    /// Publishes the goals that were refused while the robot goes on; true if there were any.
    fn publish_refused(&mut self, now: Instant, out: &mut Actions) -> bool {
        let all = self.mission.take_refused();
        for (id, state) in &all {
            let message = format!("{state}; the robot goes on to the goal before it");
            out.report(Severity::Warning, Fault::GoalRefused, "", format!("goal {id} refused: {message}"));
            let (timestamp, status, remaining) = (out.timestamp(now), state.status() as i8, f64::NAN);
            let waypoint = if let GoalState::CannotReach(to, _) = state { *to as i32 } else { 0 };
            out.publish(DataGoal { timestamp, id: *id, waypoint, status, remaining, message });
        }
        !all.is_empty()
    }

    fn publish_scene(&mut self, now: Instant, out: &mut Actions) {
        let due = self.deadlines.tick(Timer::Scene, now, SCENE_PERIOD);
        if self.mission.take_replanned() | due {
            let (x, y) = self.mission.path();
            out.publish(DataPlan { timestamp: out.timestamp(now), x, y });
        }
        if due {
            let (x, y) = self.obstacles.hits().map(|hit| (hit.at.x, hit.at.y)).unzip();
            out.publish(DataObstacles { timestamp: out.timestamp(now), size: crate::obstacles::CELL_M, x, y });
        }
    }

    /// Publishes the confirmed tracks while scans are used, and once none after the last scan.
    fn publish_persons(&mut self, now: Instant, out: &mut Actions) {
        if !self.deadlines.tick(Timer::Persons, now, PERSONS_PERIOD) {
            return;
        }
        let uses_scans = now.since(self.scan_used) <= READING_VALID_FOR;
        if !uses_scans {
            self.deadlines.clear(Timer::Persons);
        }
        let tracked = self.obstacles.people(now).filter(|person| uses_scans && person.confirmed);
        let mut persons: Vec<TrackedPerson> = tracked
            .map(|Person { id, at: Point { x, y }, velocity: (vx, vy), sigma, velocity_sigma, .. }| TrackedPerson {
                id,
                x,
                y,
                vx,
                vy,
                sigma,
                velocity_sigma,
            })
            .collect();
        persons.sort_unstable_by_key(|person| person.id);
        out.publish(DataPersons { timestamp: out.timestamp(now), persons });
    }
}

/// Accuracy of a pose, m, to either side.
fn slack(located: &Located) -> f64 {
    0.10 + 2.0 * located.sigma.min(0.2)
}

impl Module for Planner {
    fn subscriptions(&self) -> &[Channel] {
        const ALL: [Channel; 12] = [
            Channel::MlDataEstimate,
            Channel::LlDataMotion,
            Channel::LlDataGuard,
            Channel::LlDataHold,
            Channel::LlDataRanges,
            Channel::LlDataScan,
            Channel::LlDataSrfs,
            Channel::LlEventStop,
            Channel::MlCmdGoal,
            Channel::MlCmdMode,
            Channel::MlCmdParameter,
            Channel::LlDataVelocity,
        ];
        // Of a robot that steers, `LL_DATA_MOTION` has it all.
        if self.steers() { &ALL[..11] } else { &ALL }
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.session = out.timestamp(now);
                for timer in [Timer::Control, Timer::Goal, Timer::Scene, Timer::Mode, Timer::Parameters] {
                    self.deadlines.set(timer, now);
                }
                self.holds.start(now);
                out.working();
            }
            Event::Message { at, from, message } => self.on_message(now, at, from, message, out),
            Event::State(state) => self.senses.state = Some(state),
            Event::Timer | Event::Port { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        if self.deadlines.tick(Timer::Control, now, CONTROL_PERIOD) && self.is_busy() {
            self.control(now, out);
        }
        self.publish_goal(now, out);
        self.publish_mode(now, out);
        self.publish_scene(now, out);
        self.publish_persons(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let mut due = self.deadlines;
        // While there is nothing to control, the timer keeps its phase without waking the module.
        if !self.is_busy() {
            due.clear(Timer::Control);
        }
        earliest([due.next(), Some(self.holds.next())])
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
