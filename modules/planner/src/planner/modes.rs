//! Operation modes and parameters of the planner module: their commands, what a mode does by itself, and what is
//! published about them.

use super::{NAME, Planner, Timer};
use crate::attention::{self, Attention, Manner, Step};
use crate::goal::{Goal, Status, Waypoint};
use crate::goal_state::GoalState;
use crate::mode::Mode;
use base::{Duration, Fault, Instant, Severity};
use messages::Hold;
use messages::middlelevel::{CmdMode, CmdParameter, DataMode};
use module::{Actions, State};

/// Longest period of `ML_DATA_MODE`, and of `ML_DATA_PARAMETERS`.
const MODE_PERIOD_MAX: Duration = Duration::from_secs(1);
/// Refused modes and parameters that are reported at most between two periodic `ML_DATA_PARAMETERS`.
pub(super) const REFUSALS_MAX: u8 = 10;

impl Planner {
    /// Enters a mode: what the one before it was doing ends. HOME is entered where no home place is configured, too:
    /// the robot then stands, and the cause is published.
    pub(super) fn on_mode(&mut self, now: Instant, command: &CmdMode, out: &mut Actions) {
        let Some(mode) = Mode::of(command.mode) else {
            return self.refuse(Fault::ModeRefused, format!("there is no mode {}", command.mode), out);
        };
        let goes_on = mode == Mode::Route && self.mode == Mode::Route;
        if self.mission.has_goal() && !goes_on {
            let (id, ..) = self.mission.status();
            self.mission.end(id, GoalState::Cancelled);
        }
        self.enter(now, mode);
        if mode == Mode::Home {
            self.go_home(out);
        }
    }

    fn go_home(&mut self, out: &mut Actions) {
        let id = Mode::Home.goal_id();
        let Some(home) = self.config.home else {
            return self.refuse(Fault::ModeRefused, Hold::NoHome.words(""), out);
        };
        let goal = Goal::to(id, Waypoint::new(home.point(), Some(home.theta.radians())));
        match self.impossible(&goal, false) {
            None => self.mission.begin(goal, false),
            Some((waypoint, why)) => self.mission.end(id, GoalState::CannotReach(waypoint, why)),
        }
    }

    /// A goal is commanded: a mode that sets goals by itself ends. MANUAL stays.
    pub(super) fn leave_mode(&mut self, now: Instant) {
        if self.mode != Mode::Manual && self.mode != Mode::Route {
            self.enter(now, Mode::Route);
        }
    }

    fn enter(&mut self, now: Instant, mode: Mode) {
        self.mode = mode;
        self.attention = Attention::default();
        self.apply(now);
    }

    /// Drives by the present values of the parameters from now on.
    fn apply(&mut self, now: Instant) {
        self.parameters.apply(self.mode == Mode::Approach, &mut self.config);
        self.mission.reshape(now, &self.obstacles, &self.config);
    }

    /// Changes a parameter, or refuses it with a report.
    pub(super) fn on_parameter(&mut self, now: Instant, command: &CmdParameter, out: &mut Actions) {
        match self.parameters.set(&command.parameter, command.value) {
            Ok(changed) => {
                if changed {
                    self.apply(now);
                }
                // Also the answer to a command that changes nothing.
                self.publish_parameters(now, out);
            }
            Err(why) => self.refuse(Fault::ParameterRefused, format!("parameter refused: {why}"), out),
        }
    }

    /// Reports what was refused, unless a sender floods the planner.
    fn refuse(&mut self, fault: Fault, why: String, out: &mut Actions) {
        if self.refusals < REFUSALS_MAX {
            self.refusals += 1;
            out.report(Severity::Warning, fault, "", why);
        }
    }

    /// True if a person decides what the robot does.
    pub(super) fn attends(&self) -> bool {
        self.mode == Mode::Approach || (self.mode == Mode::Wait && self.config.abilities.turns)
    }

    /// Sets and ends the goals of the modes APPROACH and WAIT.
    pub(super) fn attend(&mut self, now: Instant) {
        let Some(robot) = self.senses.located(now).map(|located| located.pose).filter(|_| self.attends()) else {
            return;
        };
        let approaches = self.mode == Mode::Approach;
        let body = self.config.body;
        let distance = approaches.then(|| attention::stopping_distance(&self.config.behaviour));
        let manner = Manner { distance, turns: self.config.abilities.turns };
        self.attention.look(now, robot, &body, &self.obstacles);
        let step = if self.mission.has_goal() {
            self.attention.on_the_way(robot, &body, manner)
        } else {
            let (.., state) = self.mission.status();
            if self.attention.aim().is_some() && state.status() == Status::Failed {
                self.attention.fail(now);
            }
            // In WAIT a robot that something holds does not set out to turn later, when nobody expects it.
            let ready = approaches || self.is_ready(now);
            match ready && !self.attention.rests(now) {
                true => self.attention.at_rest(robot, &body, manner),
                false => Step::Nothing,
            }
        };
        let id = self.mode.goal_id();
        match step {
            Step::Nothing => {}
            Step::Stop => self.mission.end(id, GoalState::Cancelled),
            Step::Go(to) => self.mission.begin(Goal::to(id, to), false),
        }
    }

    /// True if nothing holds the robot but that the planner has not begun to command it.
    fn is_ready(&self, now: Instant) -> bool {
        let waits = self.waits_now(now);
        self.senses.state == Some(State::Run) && waits.iter().all(|wait| wait.hold == Hold::Starting)
    }

    /// Cause for which the mode itself holds a robot that may drive.
    pub(super) fn mode_hold(&self) -> Option<(Hold, String)> {
        let has_goal = self.mission.has_goal();
        let hold = match self.mode {
            Mode::Manual => Hold::ModeManual,
            Mode::Home if self.config.home.is_none() => Hold::NoHome,
            Mode::Wait | Mode::Approach if !has_goal => Hold::WaitsForPeople,
            Mode::Route | Mode::Wait | Mode::Approach | Mode::Home => return None,
        };
        Some((hold, String::new()))
    }

    /// Text of `ML_DATA_GOAL`: what holds the robot, else the state of the goal.
    pub(super) fn goal_message(&self) -> String {
        let (.., state) = self.mission.status();
        self.waits().first().map_or_else(|| state.to_string(), |wait| wait.message(NAME))
    }

    /// State of the mode, and its text.
    fn mode_state(&self, now: Instant) -> (i8, String) {
        let (.., goal) = self.mission.status();
        let has_goal = self.mission.has_goal();
        let drives = has_goal && goal.status() == Status::Driving && self.waits().is_empty();
        match self.mode {
            Mode::Manual => (DataMode::IDLE, Hold::ModeManual.words("")),
            Mode::Home if self.config.home.is_none() => (DataMode::FAILED, Hold::NoHome.words("")),
            Mode::Wait | Mode::Approach if drives => (DataMode::DRIVING, self.way_in_words()),
            Mode::Wait | Mode::Approach if !has_goal => {
                let attends = self.attention.person().filter(|_| self.mode == Mode::Approach);
                match attends {
                    Some(_) if self.attention.rests(now) => {
                        (DataMode::WAITING, "finds no way to the person: tries again soon".into())
                    }
                    Some(_) => (DataMode::ARRIVED, "stands before a person".into()),
                    None => (DataMode::WAITING, "waits for people".into()),
                }
            }
            Mode::Route | Mode::Wait | Mode::Approach | Mode::Home => {
                let state = match goal.status() {
                    Status::Idle | Status::Cancelled => DataMode::IDLE,
                    Status::Driving if drives => DataMode::DRIVING,
                    Status::Driving | Status::Blocked => DataMode::WAITING,
                    Status::Reached => DataMode::ARRIVED,
                    Status::Failed => DataMode::FAILED,
                };
                (state, self.goal_message())
            }
        }
    }

    fn way_in_words(&self) -> String {
        match self.attention.aim() {
            Some(aim) if aim.drives => format!("drives to a person at {:.1}, {:.1}", aim.person.x, aim.person.y),
            _ => "turns to a person".into(),
        }
    }

    pub(super) fn publish_mode(&mut self, now: Instant, out: &mut Actions) {
        let (state, text) = self.mode_state(now);
        let current = (self.mode, state, text);
        let changed = current != self.published_mode;
        if self.deadlines.tick(Timer::Mode, now, MODE_PERIOD_MAX) | changed {
            let (timestamp, has_home) = (out.timestamp(now), self.config.home.is_some());
            let (mode, state, text) = current.clone();
            self.published_mode = current;
            out.publish(DataMode { timestamp, mode: mode as i8, state, text, has_home });
        }
        if self.deadlines.tick(Timer::Parameters, now, MODE_PERIOD_MAX) {
            self.refusals = 0;
            self.publish_parameters(now, out);
        }
    }

    fn publish_parameters(&self, now: Instant, out: &mut Actions) {
        let parameters = self.parameters.message(out.timestamp(now));
        out.publish(parameters);
    }
}
