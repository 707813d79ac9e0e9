//! The module around it: what it hears, when it acts, what it says.

use crate::config::Config;
use crate::goal::{Goal, Status};
use crate::mission::{Mission, Sight};
use crate::obstacles::Obstacles;
use crate::route::Ways;
use crate::senses::{Senses, Taken};
use crate::track::Motion;
use base::{Duration, Fault, Instant, Severity, Ticker};
use messages::lowlevel::{CmdMotion, DataSrfs, EventStop};
use messages::middlelevel::{CmdGoal, DataEstimate, DataGoal, DataObstacles, DataPlan};
use messages::{Channel, Message};
use module::{Actions, Event, Module, State};

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
    /// Why it does not drive, in words.
    waits: Option<String>,
    told: (i32, usize, Status, String),
    control: Ticker,
    tell: Ticker,
    show: Ticker,
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
            waits: None,
            told: (0, 0, Status::Idle, String::new()),
            control: Ticker::new(Instant::NEVER, CONTROL),
            tell: Ticker::new(Instant::NEVER, TELL),
            show: Ticker::new(Instant::NEVER, SHOW),
        }
    }

    fn on_message(&mut self, now: Instant, at: Instant, message: &Message, out: &mut Actions) {
        let at = at.min(now);
        match message {
            Message::MlDataEstimate(estimate) => self.on_estimate(at, estimate, out),
            Message::LlDataMotion(motion) => self.senses.on_motion(at, motion),
            Message::LlEventStop(stop) => {
                self.senses.on_stop(stop);
                if let Some(front) = bumper(stop) {
                    self.mission.bump(front);
                }
            }
            Message::LlDataSrfs(srfs) => self.on_sonars(now, at, srfs),
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

    fn on_sonars(&mut self, now: Instant, at: Instant, srfs: &DataSrfs) {
        self.senses.on_sonars(at);
        let Some(fired) = self.senses.when_fired(at) else { return };
        let (body, ways) = (&self.config.body, &self.ways);
        // The pose may be off by so much to either side.
        let slack = 0.10 + 2.0 * fired.sigma.min(0.2);
        let speed = fired.moved.translation;
        let mapped = |point| ways.is_mapped(point, slack);
        self.obstacles.update(now, fired.pose, speed, &srfs.srfs, |point| body.covers(point, 0.0), mapped);
        self.mission.look(now, &self.obstacles, &self.config);
    }

    fn on_goal(&mut self, command: &CmdGoal, out: &mut Actions) {
        match Goal::of(command) {
            Ok(Some(goal)) => self.mission.begin(goal),
            Ok(None) => self.mission.end(command.id, Status::Cancelled, "cancelled: there is no goal".into()),
            Err(why) => {
                out.report(Severity::Warning, Fault::GoalRefused, "", format!("goal {} refused: {why}", command.id));
                self.mission.end(command.id, Status::Failed, format!("refused: {why}"));
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
        self.waits = self.senses.objection(now, NAME);
        let drives = wants && self.waits.is_none();
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

    fn tell(&mut self, now: Instant, out: &mut Actions) {
        let (id, waypoint, status, words) = self.mission.status();
        let words = self.waits.as_deref().filter(|_| self.mission.has_goal()).unwrap_or(words);
        let told = (self.told.0, self.told.1, self.told.2, self.told.3.as_str());
        let changed = (id, waypoint, status, words) != told;
        if !(self.tell.due(now) | changed) {
            return;
        }
        out.publish(DataGoal {
            timestamp: out.timestamp(now),
            id,
            waypoint: waypoint as i32,
            status: status as i8,
            remaining: self.mission.remaining(),
            message: words.into(),
        });
        if changed {
            self.told = (id, waypoint, status, words.into());
        }
    }

    fn show(&mut self, now: Instant, out: &mut Actions) {
        let due = self.show.due(now);
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

/// Whether a bumper in front is pressed, 1 to 4, or one behind.
fn bumper(stop: &EventStop) -> Option<bool> {
    let number: u32 = stop.source.strip_prefix("bumper").filter(|_| stop.engaged)?.parse().ok()?;
    Some(number <= 4)
}

impl Module for Planner {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::MlDataEstimate, Channel::LlDataMotion, Channel::LlDataSrfs, Channel::LlEventStop, Channel::MlCmdGoal]
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.control = Ticker::new(now, CONTROL);
                self.tell = Ticker::new(now, TELL);
                self.show = Ticker::new(now, SHOW);
                out.working();
            }
            Event::Message { at, message } => self.on_message(now, at, message, out),
            Event::State(state) => self.senses.state = Some(state),
            Event::Timer | Event::Port { .. } | Event::Heard { .. } | Event::Process(_) => {}
        }
        if self.control.due(now) && self.is_busy() {
            self.control(now, out);
        }
        self.tell(now, out);
        self.show(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let control = if self.is_busy() { self.control.next() } else { Instant::NEVER };
        [control, self.tell.next(), self.show.next()].into_iter().min()
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
