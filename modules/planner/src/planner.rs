//! The module around it: what it hears, when it acts, what it says.

use crate::config::Config;
use crate::goal::Goal;
use crate::goal_state::GoalState;
use crate::mission::{Mission, Sight};
use crate::obstacles::{Fired, Obstacles};
use crate::ranges::{self, Sounding};
use crate::route::Ways;
use crate::senses::{Senses, Taken, Wait};
use crate::track::Motion;
use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use messages::lowlevel::CmdMotion;
use messages::middlelevel::{CmdGoal, DataEstimate, DataGoal, DataObstacles, DataPlan};
use messages::{Channel, Message, StopSource};
use module::{Actions, ActiveHold, Event, Holds, Module, State};

/// The module's name, and the source of its motion.
pub const NAME: &str = "planner";

/// Motion is commanded this often.
const CONTROL: Duration = Duration::from_millis(50);
/// How the goal fares is told at least this often.
const TELL: Duration = Duration::from_millis(200);
/// What stands around is told this often, and the path at least so.
const SHOW: Duration = Duration::from_secs(1);
/// After the last motion zero is commanded so often before it falls silent: one may be lost.
const ZEROS: u32 = 10;

base::deadlines! {
    /// Periodic work, from the start on.
    enum Timer {
        /// A turn of the control loop.
        Control,
        /// `ML_DATA_GOAL` is published.
        Goal,
        /// `ML_DATA_PLAN` and `ML_DATA_OBSTACLES` are published.
        Scene,
    }
}

/// The module.
pub struct Planner {
    config: Config,
    ways: Ways,
    senses: Senses,
    obstacles: Obstacles,
    mission: Mission,
    /// What was commanded last.
    command: Motion,
    /// Zeros that are still to be sent.
    zeros: u32,
    /// The last estimate was no number, or its time ran backwards.
    bad: bool,
    /// It drove by itself at the last step.
    drove: bool,
    /// Why it does not drive, the weightiest first.
    waits: Vec<Wait>,
    holds: Holds,
    /// Goal, waypoint, status and text as published last.
    told: (i32, usize, i8, String),
    deadlines: Deadlines<Timer>,
}

impl Planner {
    /// The module.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self {
            ways: Ways::new(&config),
            config,
            senses: Senses::default(),
            obstacles: Obstacles::new(),
            mission: Mission::default(),
            command: Motion::default(),
            zeros: 0,
            bad: false,
            drove: false,
            waits: Vec::new(),
            holds: Holds::default(),
            told: (0, 0, DataGoal::IDLE, String::new()),
            deadlines: Deadlines::new(),
        }
    }

    fn on_message(&mut self, now: Instant, at: Instant, message: &Message, out: &mut Actions) {
        let at = at.min(now);
        match message {
            Message::MlDataEstimate(estimate) => self.on_estimate(at, estimate, out),
            Message::LlDataMotion(motion) => self.senses.on_motion(at, motion),
            Message::LlDataHold(holds) => self.senses.on_hold(at, holds),
            Message::LlEventStop(stop) => {
                self.senses.on_stop(stop);
                let source = StopSource::from_name(&stop.source);
                if let Some(front) = source.is_front_bumper().filter(|_| stop.engaged) {
                    self.mission.bump(front);
                }
            }
            Message::LlDataRanges(ranges) => {
                self.senses.on_ranges(at);
                self.on_soundings(now, &ranges::of_ranges(at, ranges));
            }
            Message::LlDataSrfs(srfs) if self.senses.lacks_ranges(at) => {
                self.on_soundings(now, &ranges::of_srfs(at, srfs, self.config.sonar_beam));
            }
            Message::MlCmdGoal(goal) => self.on_goal(goal, out),
            _ => {}
        }
    }

    fn on_estimate(&mut self, at: Instant, estimate: &DataEstimate, out: &mut Actions) {
        let taken = self.senses.on_estimate(at, estimate);
        let bad = matches!(taken, Taken::Nonsense | Taken::Backwards);
        if self.bad && !bad {
            out.clear(Fault::EstimateBad, "", "the estimate can be driven by again");
        }
        self.bad = bad;
        match taken {
            Taken::Well => {}
            Taken::Jumped => {
                self.obstacles.forget();
                self.mission.interrupt();
                self.mission.forget_trace();
            }
            Taken::Nonsense => {
                out.raise(Severity::Error, Fault::EstimateBad, "", "the estimate is no number: the robot stands");
            }
            Taken::Backwards => {
                let why = "the estimate's time runs backwards: the robot stands";
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
        let (body, ways) = (&self.config.body, &self.ways);
        // The pose may be off by so much to either side.
        let slack = 0.10 + 2.0 * last.sigma.min(0.2);
        let robot = last.pose;
        let mapped = |point| ways.is_mapped(point, slack);
        self.obstacles.update(now, robot, &round, |point| body.covers(point, 0.0), mapped);
        self.mission.look(now, &self.obstacles, &self.config);
    }

    fn on_goal(&mut self, command: &CmdGoal, out: &mut Actions) {
        match Goal::of(command) {
            Ok(Some(goal)) => self.mission.begin(goal),
            Ok(None) => self.mission.end(command.id, GoalState::Cancelled),
            Err(why) => {
                out.report(Severity::Warning, Fault::GoalRefused, "", format!("goal {} refused: {why}", command.id));
                self.mission.end(command.id, GoalState::Refused(why));
            }
        }
    }

    /// There is anything to command, or to wait for.
    fn is_busy(&self) -> bool {
        self.mission.has_goal() || self.zeros > 0
    }

    /// One turn of the control loop.
    fn control(&mut self, now: Instant, out: &mut Actions) {
        let wants = self.mission.has_goal() && self.senses.state == Some(State::Run);
        let located = self.senses.located(now);
        // Blind ahead it does not drive back either: from there it could not go on.
        let blind = self.obstacles.is_blind(now, true, &self.config.body);
        self.waits = self.senses.waits(now, NAME, blind);
        let drives = wants && self.waits.is_empty();
        if self.drove && !drives {
            self.mission.interrupt();
        }
        self.drove = drives;
        let aim = match located {
            Some(located) if drives => {
                let motion = self.senses.motion();
                let Self { obstacles, config, .. } = self;
                let sight = Sight { now, robot: located.pose, motion, obstacles, config };
                self.mission.step(&sight, &mut self.ways)
            }
            _ => Motion { speed: 0.0, steering: self.senses.motion().steering },
        };
        // With or without a goal, what was begun is ended by a zero that is heard.
        self.zeros = if wants { ZEROS } else { self.zeros };
        if self.zeros == 0 {
            return;
        }
        self.zeros -= 1;
        self.command = self.reachable(aim);
        let Motion { speed, steering } = self.command;
        let timestamp = out.timestamp(now);
        out.publish(CmdMotion { timestamp, speed, steering, priority: CmdMotion::PLANNER, source: NAME.into() });
    }

    /// What the drives can follow until the next turn. To slower it goes at once.
    fn reachable(&self, aim: Motion) -> Motion {
        let limits = &self.config.limits;
        let period = CONTROL.as_secs_f64();
        let (last, now) = (self.command.speed, self.senses.motion().speed);
        let step = limits.acceleration * period;
        // A new direction begins from standing, and a start from how fast it really goes.
        let from = if last * aim.speed < 0.0 { 0.0 } else { last };
        let from = if from.abs() > now.abs() + 0.2 { now } else { from };
        let faster = from.abs() + step;
        let speed = aim.speed.clamp(-faster, faster).clamp(-limits.speed, limits.speed);
        // Not twice as fast as the wheels turn.
        let turn = 2.0 * limits.steering_rate * period;
        let steering = aim.steering.clamp(self.command.steering - turn, self.command.steering + turn);
        let steering = steering.clamp(-limits.steering, limits.steering);
        let sane = speed.is_finite() && steering.is_finite();
        if sane { Motion { speed, steering } } else { Motion { speed: 0.0, steering: 0.0 } }
    }

    /// What keeps a goal from being driven to.
    fn waits(&self) -> &[Wait] {
        if self.mission.has_goal() { &self.waits } else { &[] }
    }

    fn publish_holds(&mut self, now: Instant, out: &mut Actions) {
        let mut holds = std::mem::take(&mut self.holds);
        let waits = self.waits();
        // Of a goal that nothing keeps from being driven to, the mission knows what it does about it.
        let own = self.mission.hold().filter(|_| waits.is_empty());
        let own = own.as_ref().map(|(hold, subject)| ActiveHold::new(*hold, subject));
        let waits =
            waits.iter().map(|wait| ActiveHold { hold: wait.hold, subject: &wait.subject, latched: wait.latched });
        holds.publish(now, NAME, waits.chain(own), out);
        self.holds = holds;
    }

    fn tell(&mut self, now: Instant, out: &mut Actions) {
        self.publish_holds(now, out);
        let (id, waypoint, state) = self.mission.status();
        let message = self.waits().first().map_or_else(|| state.to_string(), |wait| wait.message(NAME));
        let told = (id, waypoint, state.status() as i8, message);
        let changed = told != self.told;
        if !(self.deadlines.tick(Timer::Goal, now, TELL) | changed) {
            return;
        }
        if changed {
            self.told = told;
        }
        let (id, waypoint, status, message) = &self.told;
        out.publish(DataGoal {
            timestamp: out.timestamp(now),
            id: *id,
            waypoint: *waypoint as i32,
            status: *status,
            remaining: self.mission.remaining(),
            message: message.clone(),
        });
    }

    fn show(&mut self, now: Instant, out: &mut Actions) {
        let due = self.deadlines.tick(Timer::Scene, now, SHOW);
        if self.mission.take_replanned() | due {
            let (x, y) = self.mission.path();
            out.publish(DataPlan { timestamp: out.timestamp(now), x, y });
        }
        if due {
            let (x, y) = self.obstacles.hits().map(|hit| (hit.at.x, hit.at.y)).unzip();
            out.publish(DataObstacles { timestamp: out.timestamp(now), size: crate::obstacles::CELL, x, y });
        }
    }
}

impl Module for Planner {
    fn subscriptions(&self) -> &[Channel] {
        &[
            Channel::MlDataEstimate,
            Channel::LlDataMotion,
            Channel::LlDataHold,
            Channel::LlDataRanges,
            Channel::LlDataSrfs,
            Channel::LlEventStop,
            Channel::MlCmdGoal,
        ]
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                for timer in [Timer::Control, Timer::Goal, Timer::Scene] {
                    self.deadlines.set(timer, now);
                }
                self.holds.start(now);
                out.working();
            }
            Event::Message { at, message } => self.on_message(now, at, message, out),
            Event::State(state) => self.senses.state = Some(state),
            Event::Timer | Event::Port { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        if self.deadlines.tick(Timer::Control, now, CONTROL) && self.is_busy() {
            self.control(now, out);
        }
        self.tell(now, out);
        self.show(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let mut due = self.deadlines;
        // While there is nothing to control the loop keeps its grid, and wakes nobody.
        if !self.is_busy() {
            due.clear(Timer::Control);
        }
        earliest([due.next(), Some(self.holds.next())])
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
