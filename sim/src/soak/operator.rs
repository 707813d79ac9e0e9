//! Simulated operator: sees the robot from outside and commands it like a remote control.
//!
//! Sends motion commands at 20 Hz, first zero, drives squares and random walks where there is space, stops at times, by
//! zero or by silence, and begins again after every stop. Commands RUN to modules in PAUSE or STOP; releases the robot
//! where a stop waits for a person: homes it, overrules a silent source of PAUSE, switches the motors on, pushes it
//! back from an edge. Where there is a planner, lets that drive, too. Where a robot that turns by its wheels follows
//! neither a turn nor a curve, backs it out straight, or drives it straight where there is more space.

use super::scenario::Behaviour;
use super::tally::Goals;
use crate::check::Limits;
use crate::host::News;
use base::{Duration, Instant};
use kinematics::{Chassis, Twist};
use messages::{Hold, Message, common, lowlevel, middlelevel, simulation};
use module::admission::Way;
use navitools::{Ackermann, Point, Pose};
use rs485::boards::psc1::CHANNELS;
use simulator::Random;
use simulator::world::World;
use std::fmt;

/// Period of its actions.
pub(super) const PERIOD: Duration = Duration::from_millis(50);
/// Delay of a new begin after the robot was seen not to follow.
const RETRY_DELAY: Duration = Duration::from_millis(500);
/// Speed below which a robot stands that is commanded to move faster, m/s: something is in its way.
const STANDS_MPS: f64 = 0.05;
/// Rotation above which a commanded turn would be seen, rad/s.
const TURNS_RADPS: f64 = 0.05;
/// Distance, m, and turn, rad, above which the robot has moved; and by which a leg has brought it to another place.
const MOVED: (f64, f64) = (0.005, 0.005);
const ELSEWHERE: (f64, f64) = (0.02, 0.05);
/// Number of legs in succession that the robot did not follow after which the next one is straight.
const REFUSED_MAX: u32 = 2;
/// Clearance of a robot that touches something, m.
const TOUCHES_M: f64 = 0.01;
/// Duration of zero commands before a new begin.
const ZERO: Duration = Duration::from_millis(300);
/// Period of attending to modules that do not run.
const TEND_PERIOD: Duration = Duration::from_secs(2);
/// Look-ahead beyond the end of a leg, and its step, s.
const LOOK_AHEAD_S: (f64, f64) = (1.0, 0.25);
/// Part of the legs of a robot that turns by its wheels that are any motion of it, not that of a robot that steers.
const FREE: f64 = 0.4;
/// Number of legs that are compared.
const PATHS_TRIED: u32 = 12;
/// Way by which the robot is pushed back from an edge at a time, m.
const PUSH_M: f64 = 0.4;
/// Distance ahead of the body, and beside it, within which the floor rangers look, m.
const RANGED_M: f64 = 0.15;
/// Power channel that feeds the motors.
const MOTORS: &str = "motors";
/// Beginning of the simulator's command that pushes the robot.
pub(super) const PUSHES: &str = "put:";
/// Source names of the operator and of the planner.
pub(super) const SOURCE: &str = "operator";
pub(super) const PLANNER: &str = "planner";
/// Maximum time for which the planner drives.
const GOAL_TIME_MAX: Duration = Duration::from_secs(60);

/// Current activity.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    /// Silent until then.
    Silent(Instant),
    /// Commands zero until then.
    Zero(Instant),
    /// Drives until then.
    Drive { leg: Leg, until: Instant },
    /// Silent until then, followed by a goal for the planner: it cannot be released while a manual source drives.
    Yields(Instant),
    /// Lets the planner drive until then.
    Waits(Instant),
}

/// What he commands on a piece of a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Leg {
    /// `LL_CMD_MOTION`: speed, m/s, and steering angle, rad.
    Curve(f64, f64),
    /// `LL_CMD_VELOCITY` of a robot that turns by its wheels.
    Free(Twist),
}

impl Leg {
    /// Speed forward, m/s.
    fn speed(self) -> f64 {
        match self {
            Self::Curve(speed, _) => speed,
            Self::Free(twist) => twist.vx,
        }
    }

    /// What remains is to stand.
    fn zero(self) -> Self {
        match self {
            Self::Curve(..) => Self::Curve(0.0, 0.0),
            Self::Free(_) => Self::Free(Twist::ZERO),
        }
    }

    fn message(self) -> Message {
        let (timestamp, priority, source) = (0, lowlevel::CmdMotion::REMOTE, SOURCE.into());
        match self {
            Self::Curve(speed, steering) => lowlevel::CmdMotion { timestamp, speed, steering, priority, source }.into(),
            Self::Free(Twist { vx, vy, omega }) => {
                lowlevel::CmdVelocity { timestamp, vx, vy, omega, priority, source, session: 1 }.into()
            }
        }
    }
}

/// The operator.
#[derive(Debug)]
pub(super) struct Operator {
    behaviour: Behaviour,
    /// The base of a robot that turns by its wheels, and its greatest rotation, rad/s.
    base: Option<(Chassis, f64)>,
    /// The robot has a PAUSE line with buttons of its own; another one's are programs, which he overrules.
    has_line: bool,
    /// Last command.
    last: Leg,
    /// The world with its edges as walls: the operator sees both.
    world: World,
    random: Random,
    doing: Doing,
    /// Number of remaining sides of a square.
    square: u32,
    motion: Option<lowlevel::DataMotion>,
    /// Causes for which the robot does not move.
    holds: Option<lowlevel::DataHold>,
    truth: simulation::DataTruth,
    processes: common::DataProcesses,
    /// Time since which the robot does not follow.
    disobeyed: Option<Instant>,
    /// Sign of the next leg's speed: away from what the robot stood before.
    away: Option<f64>,
    /// Pose at the beginning of the leg.
    began: Pose,
    /// Number of legs in succession that did not move a robot that nothing held.
    refused: u32,
    /// The next leg is by hand: the planner did not drive.
    by_hand: bool,
    tends: Instant,
    goal: i32,
    /// What the planner says about the goal.
    answer: String,
    /// The planner waits because its way is blocked.
    blocked: bool,
    /// Since when.
    blocked_since: Option<Instant>,
    goals: Goals,
}

/// Predicate of a sentence whose subject is the operator.
impl fmt::Display for Operator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.doing {
            Doing::Silent(_) => f.write_str("is silent"),
            Doing::Zero(_) => f.write_str("commands zero"),
            Doing::Drive { leg: Leg::Curve(speed, steering), .. } => {
                write!(f, "commands {speed:.2} m/s, {steering:.2} rad")
            }
            Doing::Drive { leg: Leg::Free(Twist { vx, vy, omega }), .. } => {
                write!(f, "commands {vx:.2} and {vy:.2} m/s, {omega:.2} rad/s")
            }
            Doing::Yields(_) => f.write_str("is about to send a goal"),
            Doing::Waits(_) => write!(f, "waits for the planner: {:?}", self.answer),
        }
    }
}

impl Operator {
    pub fn new(behaviour: &Behaviour, limits: &Limits, world: &World, seed: u64) -> Self {
        let base = limits.base.as_ref().map(|base| (base.chassis.clone(), limits.rotation));
        Self::of_base(behaviour, base, limits.power.is_some(), world, seed)
    }

    fn of_base(behaviour: &Behaviour, base: Option<(Chassis, f64)>, has_line: bool, world: &World, seed: u64) -> Self {
        Self {
            behaviour: *behaviour,
            base,
            has_line,
            last: Leg::Curve(0.0, 0.0),
            world: world.fenced(),
            random: Random::stream(seed, u64::from_le_bytes(*b"operator")),
            doing: Doing::Silent(Instant::ZERO),
            square: 0,
            motion: None,
            holds: None,
            truth: simulation::DataTruth::default(),
            processes: common::DataProcesses::default(),
            disobeyed: None,
            away: None,
            began: Pose::default(),
            refused: 0,
            by_hand: false,
            tends: Instant::ZERO,
            goal: 0,
            answer: String::new(),
            blocked: false,
            blocked_since: None,
            goals: Goals::default(),
        }
    }

    /// Goals so far.
    pub fn goals(&self) -> Goals {
        self.goals
    }

    pub fn observe(&mut self, news: &News<'_>) {
        let News::Message { sender, message } = news else { return };
        match message {
            // From another robot, or from nobody.
            _ if sender.way != Way::Memory => {}
            Message::LlDataMotion(motion) => self.motion = Some(motion.clone()),
            Message::LlDataHold(list) if list.is_of_motion() => self.holds = Some(list.clone()),
            Message::SimDataTruth(truth) => self.truth = truth.clone(),
            Message::CmDataProcesses(list) => self.processes = list.clone(),
            Message::MlDataGoal(goal) if goal.id == self.goal && matches!(self.doing, Doing::Waits(_)) => {
                self.answer.clone_from(&goal.message);
                self.blocked = goal.status == middlelevel::DataGoal::BLOCKED;
                if self.blocked && self.behaviour.patience > 0.0 {
                    return;
                }
                self.blocked_since = None;
                self.take(goal);
            }
            _ => {}
        }
    }

    /// Takes what the planner reports about the goal; does not let it wait any longer.
    fn take(&mut self, goal: &middlelevel::DataGoal) {
        self.goals.take(goal);
        let gives_up = [middlelevel::DataGoal::BLOCKED, middlelevel::DataGoal::FAILED];
        self.by_hand |= gives_up.contains(&goal.status);
        if goal.status != middlelevel::DataGoal::DRIVING && goal.status != middlelevel::DataGoal::IDLE {
            self.doing = Doing::Silent(Instant::ZERO);
        }
    }

    /// Acts at this time; passes each message to `say`.
    pub fn act(&mut self, now: Instant, mut say: impl FnMut(Message)) {
        self.lose_patience(now);
        self.tend(now, &mut say);
        self.watch(now);
        match self.doing {
            Doing::Silent(until) | Doing::Waits(until) if until <= now => self.doing = Doing::Zero(now + ZERO),
            Doing::Zero(until) if until <= now && self.may_drive() => self.go(now),
            Doing::Yields(until) if until <= now => self.send(now, &mut say),
            Doing::Drive { until, .. } if until <= now => self.change(now),
            _ => {}
        }
        self.last = match self.doing {
            Doing::Silent(_) | Doing::Yields(_) | Doing::Waits(_) => return,
            Doing::Zero(_) => self.last.zero(),
            Doing::Drive { leg, .. } => leg,
        };
        say(self.last.message());
    }

    /// Gives up a goal whose way has been blocked for too long.
    fn lose_patience(&mut self, now: Instant) {
        if !matches!(self.doing, Doing::Waits(_)) || !self.blocked {
            self.blocked_since = None;
        } else if now.since(*self.blocked_since.get_or_insert(now)).as_secs_f64() >= self.behaviour.patience {
            self.take(&middlelevel::DataGoal { status: middlelevel::DataGoal::BLOCKED, ..Default::default() });
        }
    }

    /// True if it could drive, as far as it sees.
    fn may_drive(&self) -> bool {
        self.motion.as_ref().is_some_and(|motion| motion.homed)
    }

    /// Commands RUN where an operator must, and homing where necessary.
    fn tend(&mut self, now: Instant, say: &mut impl FnMut(Message)) {
        if now < self.tends {
            return;
        }
        self.tends = now + TEND_PERIOD;
        let held = |process: &&common::Process| {
            let held = [common::DataState::PAUSE, common::DataState::STOP];
            held.contains(&process.state) || process.wanted == common::DataState::TERMINATE
        };
        let modules = self.processes.processes.iter().filter(held).map(|process| process.module.clone());
        for module in modules.collect::<Vec<_>>() {
            let state = common::DataState::RUN;
            say(common::CmdState { timestamp: 0, module, state, manual: true, source: SOURCE.into() }.into());
        }
        self.release(say);
    }

    /// Ends, by a deliberate act, the causes that wait for one: homing, a source of PAUSE that fell silent, a drive
    /// that was too fast, or stood, or one that did not brake and has lost its feed.
    fn release(&self, say: &mut impl FnMut(Message)) {
        let Some(list) = &self.holds else { return };
        let has = |holds: &[Hold]| holds.iter().any(|hold| list.has(*hold));
        if has(&[Hold::PauseOther, Hold::SpeedExceeded, Hold::WheelStood])
            || !self.has_line && has(&[Hold::PauseButton])
        {
            let (module, state) = (list.module.clone(), common::DataState::RUN);
            say(common::CmdState { timestamp: 0, module, state, manual: true, source: SOURCE.into() }.into());
        }
        if has(&[Hold::FeedCut, Hold::FeedOff])
            && let Some(motors) = CHANNELS.iter().position(|name| *name == MOTORS)
        {
            let device = motors as i8;
            say(lowlevel::CmdPower { timestamp: 0, device, action: lowlevel::CmdPower::ON }.into());
        }
        let homed = self.motion.as_ref().is_none_or(|motion| motion.homed);
        if has(&[Hold::ToBeHomed, Hold::HomingFailed]) && !homed {
            say(lowlevel::CmdHoming { timestamp: 0, axis: "steering".into() }.into());
        }
        let floor = list.holds.iter().find(|hold| hold.code == Hold::PauseFloor.code());
        if let Some(floor) = floor.filter(|_| self.truth.speed.abs() < STANDS_MPS) {
            self.leave_edge(floor.subject.contains("front"), say);
        }
    }

    /// Pushes the robot back by hand if its floor rangers look over an edge, and lets its boards look again.
    fn leave_edge(&self, front: bool, say: &mut impl FnMut(Message)) {
        let (rear, ahead, half_width) = self.behaviour.body;
        let (x, away) = if front { (ahead + RANGED_M, -PUSH_M) } else { (-rear - RANGED_M, PUSH_M) };
        let corner = |y: f64| (self.pose() * Pose::new(x, y, 0.0)).point();
        let reach = half_width + RANGED_M;
        if [-reach, 0.0, reach].into_iter().any(|y| !self.world.floor(corner(y))) {
            let Pose { x, y, theta } = self.pose() * Pose::new(away, 0.0, 0.0);
            let fault = format!("{PUSHES}{x:.3},{y:.3},{:.4}", theta.radians());
            say(simulation::CmdFault { target: "robot".into(), fault, ..Default::default() }.into());
        }
        let (module, state) = ("*".into(), common::DataState::RUN);
        say(common::CmdState { timestamp: 0, module, state, manual: true, source: SOURCE.into() }.into());
    }

    /// Stops if the robot does not follow, or comes too close to an obstacle.
    fn watch(&mut self, now: Instant) {
        if !matches!(self.doing, Doing::Drive { .. } | Doing::Waits(_)) {
            return;
        }
        let wanted = if let Doing::Drive { leg, .. } = self.doing { leg.speed() } else { 0.0 };
        let stands = |target: f64| wanted.abs() > STANDS_MPS && target.abs() < STANDS_MPS;
        let stays = self.stays();
        let held = |motion: &lowlevel::DataMotion| motion.reason.is_empty() && (stays || stands(motion.speed_target));
        let held = self.motion.as_ref().is_some_and(held);
        let disobeys = held || self.motion.as_ref().is_none_or(|motion| !motion.reason.is_empty());
        let since = match (disobeys, self.disobeyed) {
            (true, since) => *self.disobeyed.insert(since.unwrap_or(now)),
            (false, _) => {
                self.disobeyed = None;
                now
            }
        };
        let Doing::Drive { leg, .. } = self.doing else {
            // The planner needs a moment to begin; a later stop latches it until it is released again.
            if now.since(since) >= 4 * RETRY_DELAY {
                (self.disobeyed, self.by_hand) = (None, true);
                self.doing = Doing::Silent(now);
            }
            return;
        };
        let pose = self.pose();
        let near = self.room(pose, leg, 0.0) < self.behaviour.clearance / 2.0;
        let near = near && self.room(pose, leg, 0.0) < self.clearance(pose) - 0.01;
        if now.since(since) >= RETRY_DELAY || near {
            // A robot that senses nothing stands against it.
            let blocked = held || self.truth.clearance < TOUCHES_M;
            self.away = (blocked && !stays).then(|| -leg.speed().signum());
            self.judge(held);
            (self.disobeyed, self.square) = (None, 0);
            self.doing = match self.random.chance(0.5) {
                true => Doing::Zero(now + self.for_up_to(1.0)),
                false => Doing::Silent(now + self.for_up_to(1.0)),
            };
        }
    }

    /// True if a robot that is commanded to turn on the spot, or to go sideways, is where it was at the beginning.
    fn stays(&self) -> bool {
        let Doing::Drive { leg: Leg::Free(Twist { vx, vy, omega }), .. } = self.doing else { return false };
        let commanded = omega.abs() > TURNS_RADPS || vy.abs() > STANDS_MPS;
        vx.abs() <= STANDS_MPS && commanded && !self.is_beyond(MOVED)
    }

    /// True if the robot is that far from where the leg began.
    fn is_beyond(&self, (distance, turn): (f64, f64)) -> bool {
        let pose = self.pose();
        let turned = (pose.theta - self.began.theta).radians().abs();
        pose.point().distance(self.began.point()) > distance || turned > turn
    }

    /// Counts a leg that has ended: one that brought the robot elsewhere, or one that it was `free` to follow, and did
    /// not. A robot that steers has bounds for the present angle of its steering: there any other leg helps.
    fn judge(&mut self, free: bool) {
        if self.is_beyond(ELSEWHERE) {
            self.refused = 0;
        } else if free && self.base.is_some() {
            self.refused += 1;
        }
    }

    /// The current leg has ended.
    fn change(&mut self, now: Instant) {
        self.judge(self.motion.as_ref().is_some_and(|motion| motion.reason.is_empty()));
        let Behaviour { silence, zero, .. } = self.behaviour;
        let chance = self.random.uniform();
        self.doing = match () {
            () if chance < silence => Doing::Silent(now + self.for_up_to(1.0)),
            () if chance < silence + zero => Doing::Zero(now + self.for_up_to(1.0)),
            () => self.leg(now),
        };
    }

    fn for_up_to(&mut self, seconds: f64) -> Duration {
        ZERO + Duration::from_secs_f64(seconds * self.random.uniform())
    }

    /// Zero has been commanded for a while.
    fn go(&mut self, now: Instant) {
        let planner = |process: &common::Process| process.module == PLANNER && process.state == common::DataState::RUN;
        let by_hand = std::mem::take(&mut self.by_hand) || self.refused > 0;
        let planned = self.random.chance(0.5) && !by_hand;
        if planned && self.processes.processes.iter().any(planner) {
            self.doing = Doing::Yields(now + ZERO);
            return;
        }
        self.doing = self.leg(now);
    }

    /// Sends a goal to the planner.
    fn send(&mut self, now: Instant, say: &mut impl FnMut(Message)) {
        self.doing = Doing::Waits(now + GOAL_TIME_MAX + Duration::from_secs_f64(self.behaviour.patience));
        self.blocked = false;
        self.goal += 1;
        self.goals.sent += 1;
        self.answer.clear();
        let waypoint = middlelevel::Waypoint { tolerance: 0.2, ..self.somewhere() };
        let waypoints = vec![waypoint];
        say(middlelevel::CmdGoal { timestamp: 0, id: self.goal, waypoints, r#loop: false }.into());
    }

    /// A place with space around.
    fn somewhere(&mut self) -> middlelevel::Waypoint {
        let corners = self.world.walls.iter().flat_map(|wall| [wall.a, wall.b]);
        let corners: Vec<Point> = corners.chain([self.world.start.point()]).collect();
        let range = |of: fn(&Point) -> f64| {
            let all = corners.iter().map(of);
            (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
        };
        let (x, y) = (range(|p| p.x), range(|p| p.y));
        for _ in 0..100 {
            let pose = Pose::new(self.between(x.0, x.1), self.between(y.0, y.1), 0.0);
            if self.clearance(pose) > 2.0 * self.behaviour.clearance {
                return middlelevel::Waypoint { x: pose.x, y: pose.y, ..middlelevel::Waypoint::default() };
            }
        }
        let start = self.world.start;
        middlelevel::Waypoint { x: start.x, y: start.y, ..middlelevel::Waypoint::default() }
    }

    /// Next leg: of a square, or the random one with the most space.
    fn leg(&mut self, now: Instant) -> Doing {
        let pose = self.pose();
        self.began = pose;
        if self.refused >= REFUSED_MAX {
            (self.away, self.square) = (None, 0);
            let (leg, seconds) = self.straight(pose);
            return Doing::Drive { leg, until: now + Duration::from_secs_f64(seconds) };
        }
        let mut best = (f64::NEG_INFINITY, Leg::Curve(0.0, 0.0), 0.0);
        for thought in 0..PATHS_TRIED {
            let (leg, seconds) = self.thought(thought);
            let room = self.room(pose, leg, seconds);
            if room > best.0 {
                best = (room, leg, seconds);
            }
            if room >= self.behaviour.clearance {
                break;
            }
        }
        let (_, leg, seconds) = best;
        self.away = None;
        self.square = self.square.saturating_sub(1);
        Doing::Drive { leg, until: now + Duration::from_secs_f64(seconds) }
    }

    /// A straight leg where turns and curves are refused, and its duration, s: that with the most space first, then the
    /// others in turn.
    fn straight(&mut self, pose: Pose) -> (Leg, f64) {
        let (seconds, speed) = (self.between(self.behaviour.leg.0, self.behaviour.leg.1), self.behaviour.speed / 2.0);
        let mut legs = vec![Leg::Curve(-speed, 0.0), Leg::Curve(speed, 0.0)];
        if let Some((chassis, _)) = &self.base {
            let sideways = [speed, -speed].map(|vy| chassis.feasible(Twist::new(0.0, vy, 0.0)).twist);
            legs.extend(sideways.into_iter().filter(|twist| twist.vy.abs() > STANDS_MPS).map(Leg::Free));
        }
        legs.sort_by(|a, b| self.room(pose, *b, seconds).total_cmp(&self.room(pose, *a, seconds)));
        (legs[(self.refused - REFUSED_MAX) as usize % legs.len()], seconds)
    }

    /// A candidate leg, and its duration, s.
    fn thought(&mut self, number: u32) -> (Leg, f64) {
        let Behaviour { speed, steering, leg, wheelbase, .. } = self.behaviour;
        if number > 0 || self.away.is_some() {
            self.square = 0;
        } else if self.square == 0 && self.random.chance(0.1) {
            // Sides and corners alternate.
            self.square = 8;
        }
        if self.square > 0 {
            let radius = wheelbase / libm::tan(steering);
            let quarter = core::f64::consts::FRAC_PI_2 * radius / (speed / 2.0);
            return match self.square.is_multiple_of(2) {
                true => (Leg::Curve(speed, 0.0), 2.0),
                false => (Leg::Curve(speed / 2.0, steering), quarter),
            };
        }
        let rotation = self.base.as_ref().map(|(_, rotation)| *rotation);
        if let Some(rotation) = rotation.filter(|_| self.random.chance(FREE)) {
            let [vx, vy, omega] = [speed, speed, rotation].map(|most| self.between(-most, most));
            // Any of them alone, and all together.
            let wanted = match self.random.bits() % 4 {
                0 => Twist::new(0.0, vy, 0.0),
                1 => Twist::new(0.0, 0.0, omega),
                2 => Twist::new(vx, 0.0, omega),
                _ => Twist::new(vx, vy, omega),
            };
            let possible = |wanted| self.base.as_ref().map_or(wanted, |(chassis, _)| chassis.feasible(wanted).twist);
            // Of what a base cannot do nothing is left, and to stand is no leg: among people it has the most space.
            let twist = match possible(wanted) {
                nothing if nothing == Twist::default() => possible(Twist::new(vx, 0.0, omega)),
                twist => twist,
            };
            return (Leg::Free(twist), self.between(leg.0, leg.1));
        }
        let forward = if self.random.chance(0.7) { 1.0 } else { -1.0 };
        let forward = self.away.unwrap_or(forward);
        let speed = forward * self.between(0.1, speed);
        let straight = self.random.chance(0.3);
        let steering = if straight { 0.0 } else { self.between(-steering, steering) };
        (Leg::Curve(speed, steering), self.between(leg.0, leg.1))
    }

    fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.random.uniform()
    }

    fn pose(&self) -> Pose {
        Pose::new(self.truth.x, self.truth.y, self.truth.theta)
    }

    fn clearance(&self, pose: Pose) -> f64 {
        if let Some(shape) = &self.behaviour.shape {
            return self.world.clearance_of_shape(pose, shape);
        }
        let (rear, front, half_width) = self.behaviour.body;
        self.world.clearance(pose, -rear, front, half_width)
    }

    /// Minimum clearance on the way and while stopping at its end; not at its very beginning, so that a way out of a
    /// corner counts.
    fn room(&self, mut pose: Pose, leg: Leg, seconds: f64) -> f64 {
        let geometry = Ackermann { wheelbase_m: self.behaviour.wheelbase, track_m: 0.0 };
        let (beyond, step) = LOOK_AHEAD_S;
        let steps = libm::ceil((seconds + beyond) / step) as u32;
        let mut least = f64::INFINITY;
        for number in 0..steps {
            pose = match leg {
                Leg::Curve(speed, steering) => pose.along(geometry.motion(speed * step, steering)),
                Leg::Free(twist) => kinematics::integrate(pose, twist, step),
            };
            if number + 1 >= steps.min(4) {
                least = least.min(self.clearance(pose));
            }
        }
        least
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use module::admission::Sender;

    const STEP_S: f64 = 0.05;

    /// Time until an operator has brought a robot 0.2 m away from where it stands, 7 cm before a wall, and may only go
    /// straight, backward or, with the wall behind it, forward, s.
    fn leaves(seed: u64, behind: bool) -> f64 {
        let wall = if behind { "walls = [[-0.42, -3, -0.42, 3]]" } else { "walls = [[0.42, -3, 0.42, 3]]" };
        let node = settings::Node::parse(std::path::Path::new("world.toml"), &format!("start = [0, 0, 0]\n{wall}"));
        let world: World = settings::read_as(&node.expect("TOML")).expect("a world");
        let behaviour = Behaviour { wheelbase: 0.3, body: (0.35, 0.35, 0.25), ..Behaviour::default() };
        let wheel = kinematics::Limits { speed_mps: 0.8, acceleration_mps2: 0.5, deceleration_mps2: 0.8 };
        let chassis = Chassis::differential(0.42, wheel).expect("a track of 0.42 m");
        let mut operator = Operator::of_base(&behaviour, Some((chassis, 1.2)), false, &world, seed);
        let sender = Sender { way: Way::Memory, process: None };
        let (mut x, mut command) = (0.0, Twist::ZERO);
        for tick in 0..2000 {
            let now = Instant::from_millis(50 * tick);
            let permitted = match (command.omega == 0.0 && command.vy == 0.0, behind) {
                (true, false) => command.vx.clamp(-0.1, 0.0),
                (true, true) => command.vx.clamp(0.0, 0.1),
                (false, _) => 0.0,
            };
            x += permitted * STEP_S;
            let truth = simulation::DataTruth { x, speed: permitted, clearance: 0.07, ..Default::default() };
            let motion = lowlevel::DataMotion { homed: true, speed_target: permitted, ..Default::default() };
            for message in [truth.into(), motion.into()] {
                operator.observe(&News::Message { sender, message: &message });
            }
            if f64::abs(x) > 0.2 {
                return now.since(Instant::ZERO).as_secs_f64();
            }
            operator.act(now, |message| match message {
                Message::LlCmdMotion(motion) => {
                    let omega = motion.speed * libm::tan(motion.steering) / behaviour.wheelbase;
                    command = Twist::new(motion.speed, 0.0, omega);
                }
                Message::LlCmdVelocity(velocity) => command = Twist::new(velocity.vx, velocity.vy, velocity.omega),
                _ => {}
            });
        }
        panic!("seed {seed}: it does not leave the wall: {operator}");
    }

    #[test]
    fn where_turns_and_curves_are_refused_it_goes_straight() {
        for seed in 0..200 {
            for behind in [false, true] {
                let seconds = leaves(seed, behind);
                assert!(seconds < 20.0, "seed {seed}, {behind}: {seconds} s");
            }
        }
    }
}
