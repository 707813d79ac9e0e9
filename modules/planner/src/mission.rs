//! Execution of a goal: search a path, drive it, wait for obstacles, search a path around them, back out.
//!
//! A path is first searched on the map alone, because people move away; echoes stop the robot on it. If an obstacle
//! remains, a path around it is searched, then another one after backing out, then the robot waits longer. A goal that
//! is driven once fails after a maximum number of attempts; a loop continues, with its next waypoint where that is
//! possible.

use crate::ahead::{self, Ahead};
use crate::config::Config;
use crate::goal::{Goal, Waypoint};
use crate::goal_state::{GoalState, Hindrance};
use crate::obstacles::Obstacles;
use crate::path::{Move, Poses};
use crate::route::{PlanningSpace, Progress, Route};
use crate::track::{Axis, Motion, SPEED_MIN_MPS, STEERED_RAD, Track};
use base::{Duration, Instant};
use kinematics::Direction;
use messages::Hold;
use navitools::Pose;
use std::collections::VecDeque;
use std::mem;

/// Remaining length of the current leg below which the next one is planned, m.
const PLAN_AHEAD_M: f64 = 3.0;
/// Time for which the path must be clear before the robot starts again.
const CLEAR_FOR: Duration = Duration::from_millis(100);
/// Allowed speed above which the robot starts, m/s; below the lowest limit to which a parameter can be set.
const START_SPEED_MIN_MPS: f64 = 0.08;
/// Time for which backing out may be blocked before it ends.
const BACKING_OUT_BLOCKED_MAX: Duration = Duration::from_millis(900);
/// Speed below which the robot is at standstill, m/s.
const STANDSTILL_MPS: f64 = 0.03;
/// Deviation from the path above which a new path is searched, m and rad.
const DEVIATION_MAX: (f64, f64) = (0.30, 0.6);
/// Lateral deviation above which the motion is checked against the map, and the margin beyond the stopping distance, m.
const MAP_CHECK_DEVIATION_M: f64 = 0.06;
const MAP_CHECK_MARGIN_M: f64 = 0.05;
/// Time of commanded motion at standstill after which the robot is stuck.
const STUCK_AFTER: Duration = Duration::from_secs(4);
/// Length of the driven path that is kept for backing out, and distance of its poses, m.
const TRACE_LENGTH_M: f64 = 2.0;
const TRACE_STEP_M: f64 = 0.05;
/// Distance to back out, m.
const BACK_OUT_M: f64 = 0.9;
/// Shortest useful distance to back out, m.
const BACK_OUT_MIN_M: f64 = 0.25;
/// Distance beyond the circle of the farthest corner that makes room for a turn, m.
const ROOM_MARGIN_M: f64 = 0.15;
/// Distance from the start of a stored path of a loop at which the path is driven again, m and rad.
const STORED_PATH_START_MAX: (f64, f64) = (0.12, 0.12);
/// Largest number of waypoints for which paths are stored.
const STORED_PATHS_MAX: usize = 64;
/// Progress towards the waypoint that resets the number of attempts, m.
const PROGRESS_RESETS_ATTEMPTS_M: f64 = 1.0;
/// Longest wait between attempts, as a multiple of `patience`.
const WAIT_MAX_PATIENCE_MULTIPLE: u32 = 3;

/// Inputs of a step.
pub struct StepInput<'a> {
    /// Current time.
    pub now: Instant,
    /// Pose of the robot in the map.
    pub robot: Pose,
    /// Measured motion of the robot.
    pub motion: Motion,
    /// Greatest speeds that the guard permits with the present steering, m/s and rad/s, by [`Direction`].
    pub permitted: [f64; 6],
    /// Obstacles sensed by the sonars.
    pub obstacles: &'a Obstacles,
    /// Configuration.
    pub config: &'a Config,
}

/// Phase of the mission.
enum Phase {
    Idle,
    /// At standstill while a path is searched, around sensed obstacles or on the map alone.
    Planning {
        route: Route,
        around: bool,
    },
    /// Driving, while the path to the next waypoint is searched.
    Driving {
        next: Option<(Route, usize)>,
    },
    /// Blocked by an obstacle.
    Waiting {
        since: Instant,
        gone: Option<Instant>,
    },
    /// Driving back along the path that it came from.
    BackingOut {
        blocked: Option<Instant>,
    },
}

/// Goal and its progress.
pub struct Mission {
    goal: Option<Goal>,
    phase: Phase,
    track: Track,
    ahead: Ahead,
    /// True if the path must be checked for obstacles before it is driven.
    unchecked: bool,
    trace: VecDeque<(Pose, bool)>,
    /// Paths between waypoints that were found on the map alone, by the waypoint at their end.
    stored: Vec<Option<Poses>>,
    attempts: u32,
    /// Smallest distance to the waypoint when the number of attempts was last reset, m.
    nearest: f64,
    /// No path led around what is sensed, so one on the map is planned.
    no_way_around: bool,
    /// Instant since which motion is commanded at standstill.
    stuck: Option<Instant>,
    /// Direction in which the robot made room for a turn; without progress it does not go the opposite way.
    room: Option<Direction>,
    /// True after a contact at the leading end: the robot backs out before it continues.
    bumped: bool,
    /// True if a path to this goal was found.
    is_found: bool,
    /// Goal that the robot was driving to; it goes on to it if this one turns out to be impossible.
    before: Option<Goal>,
    /// Goals that were refused while the robot goes on to another one, each with its number.
    refused: Vec<(i32, GoalState)>,
    id: i32,
    waypoint: usize,
    state: GoalState,
    /// True if the track was replaced.
    replanned: bool,
}

impl Default for Mission {
    fn default() -> Self {
        Self {
            goal: None,
            phase: Phase::Idle,
            track: Track::default(),
            ahead: Ahead::default(),
            unchecked: false,
            trace: VecDeque::new(),
            stored: Vec::new(),
            attempts: 0,
            nearest: f64::INFINITY,
            no_way_around: false,
            stuck: None,
            room: None,
            bumped: false,
            is_found: false,
            before: None,
            refused: Vec::new(),
            id: 0,
            waypoint: 0,
            state: GoalState::NoGoal,
            replanned: false,
        }
    }
}

impl Mission {
    /// Replaces the goal. `drives`: the robot drives to the one before, and goes on to it if no path leads to this one.
    pub fn begin(&mut self, goal: Goal, drives: bool) {
        let before = if self.is_found { self.goal.take() } else { self.before.take() };
        self.replace(goal, before.filter(|_| drives));
    }

    fn replace(&mut self, goal: Goal, before: Option<Goal>) {
        let stored =
            if goal.waypoints.len() <= STORED_PATHS_MAX { vec![None; goal.waypoints.len()] } else { Vec::new() };
        let (trace, bumped, refused) = (mem::take(&mut self.trace), self.bumped, mem::take(&mut self.refused));
        let (id, waypoint, goal) = (goal.id, goal.next, Some(goal));
        *self = Self { id, waypoint, goal, before, stored, trace, bumped, refused, replanned: true, ..Self::default() };
        self.state = GoalState::Planning;
    }

    /// Refuses a goal that is known to be impossible: the robot goes on to the one that it drives to.
    pub fn refuse(&mut self, id: i32, state: GoalState) {
        self.refused.push((id, state));
    }

    /// Goals that were refused since the last call while the robot goes on to another one.
    pub fn take_refused(&mut self) -> Vec<(i32, GoalState)> {
        mem::take(&mut self.refused)
    }

    /// Ends the goal with its final state.
    pub fn end(&mut self, id: i32, state: GoalState) {
        let waypoint = self.waypoint;
        let (trace, refused) = (mem::take(&mut self.trace), mem::take(&mut self.refused));
        *self = Self { id, waypoint, trace, refused, state, replanned: true, ..Self::default() };
    }

    /// Interrupts driving after a stop by another party or a jump of the pose: a path is planned again when the robot
    /// may drive, to this goal and to no other one.
    pub fn interrupt(&mut self) {
        self.phase = Phase::Idle;
        (self.stuck, self.before) = (None, None);
        self.replanned |= !self.track.ahead().is_empty();
        self.track = Track::default();
    }

    /// Applies changed limits and margins to the path that is driven.
    pub fn reshape(&mut self, now: Instant, obstacles: &Obstacles, config: &Config) {
        self.track.shape(&config.body, &config.limits, &config.behaviour);
        self.check_ahead(now, obstacles, config);
    }

    /// Notes a pressed bumper, at the front or at the rear.
    pub fn bump(&mut self, front: bool) {
        self.bumped = self.trace.back().is_some_and(|(_, forward)| *forward == front);
    }

    /// Clears the driven path after a jump of the pose.
    pub fn forget_trace(&mut self) {
        self.trace.clear();
        self.bumped = false;
    }

    /// True if there is a goal to drive to.
    #[must_use]
    pub fn has_goal(&self) -> bool {
        self.goal.is_some()
    }

    /// Number of the goal, the waypoint, and the state.
    #[must_use]
    pub fn status(&self) -> (i32, usize, &GoalState) {
        (self.id, self.waypoint, &self.state)
    }

    /// Cause, with its subject, for which a robot that may drive does not; `None` while it drives.
    #[must_use]
    pub fn hold(&self) -> Option<(Hold, String)> {
        let stands = matches!(self.phase, Phase::Idle | Phase::Planning { .. });
        self.state.hold().or_else(|| stands.then_some((Hold::Planning, String::new())))
    }

    /// Remaining distance to the last waypoint, m; NaN without one or if it is unknown.
    #[must_use]
    pub fn remaining(&self) -> f64 {
        let Some(goal) = self.goal.as_ref().filter(|goal| !goal.looped) else { return f64::NAN };
        let Some(to) = self.track.leads_to() else { return f64::NAN };
        // A track for backing out leads to no waypoint.
        let Some(rest) = goal.waypoints.get(to..) else { return f64::NAN };
        let rest = rest.windows(2).map(|pair| pair[0].at.distance(pair[1].at));
        self.track.remaining() + rest.sum::<f64>()
    }

    /// Path for display.
    #[must_use]
    pub fn path(&self) -> (Vec<f64>, Vec<f64>) {
        self.track.points(100)
    }

    /// True if the path was replaced since the last call.
    pub fn take_replanned(&mut self) -> bool {
        mem::take(&mut self.replanned)
    }

    /// Checks the path ahead for obstacles after a round of the sonars.
    pub fn check_ahead(&mut self, now: Instant, obstacles: &Obstacles, config: &Config) {
        self.ahead = Ahead::check(now, self.track.ahead(), obstacles, config);
        self.unchecked = false;
    }

    fn set_driving(&mut self) {
        if let Some(goal) = &self.goal {
            self.waypoint = goal.next;
            self.state = GoalState::Driving {
                to: goal.next,
                of: goal.waypoints.len(),
                looped: goal.looped,
                narrow: self.track.is_narrow(),
            };
        }
    }

    /// Computes the command of a robot that may drive. Called at 20 Hz.
    pub fn step(&mut self, input: &StepInput<'_>, space: &mut PlanningSpace) -> Motion {
        let stand = Motion { speed: 0.0, ..input.motion };
        if self.goal.is_none() {
            return stand;
        }
        self.record_trace(input);
        if self.unchecked {
            self.check_ahead(input.now, input.obstacles, input.config);
        }
        match mem::replace(&mut self.phase, Phase::Idle) {
            Phase::Idle => {
                if mem::take(&mut self.bumped) && self.back_out(input, space) {
                    return stand;
                }
                self.begin_planning(input, space, false);
                stand
            }
            Phase::Planning { route, around } => {
                self.continue_planning(input, space, route, around);
                stand
            }
            Phase::Driving { next } => self.drive(input, space, next),
            Phase::Waiting { since, gone } => {
                self.wait(input, space, since, gone);
                stand
            }
            Phase::BackingOut { blocked } => self.back_up(input, space, blocked),
        }
    }

    /// Begins to search a path from here to the next waypoint.
    fn begin_planning(&mut self, input: &StepInput<'_>, space: &mut PlanningSpace, around: bool) {
        let Some(goal) = &self.goal else { return };
        let to = goal.waypoints[goal.next];
        if to.is_reached(input.robot) && input.motion.speed.abs() < STANDSTILL_MPS {
            return self.reached(goal.next);
        }
        (self.track, self.no_way_around) = (Track::default(), false);
        if around {
            let Config { body, behaviour, .. } = input.config;
            space.set_obstacles(input.obstacles, input.robot, body, behaviour.margin);
        }
        if let Some(poses) = self.stored_path(goal.next, input.robot).filter(|_| !around) {
            return self.start_driving(poses, input);
        }
        let heading = to.heading.or_else(|| goal.passing(input.robot.point(), goal.next));
        let route = Route::begin(space, input.robot, &to, heading, around);
        self.phase = Phase::Planning { route, around };
    }

    fn continue_planning(&mut self, input: &StepInput<'_>, space: &mut PlanningSpace, mut route: Route, around: bool) {
        match route.advance(space) {
            Progress::Searching => self.phase = Phase::Planning { route, around },
            Progress::Found(poses) => {
                if let Some(goal) = self.goal.as_ref().filter(|_| !around) {
                    let to = goal.next;
                    self.store_path(to, &poses);
                }
                self.start_driving(poses, input);
            }
            // People leave: the robot drives the path on the map as far as that is clear, and waits there.
            Progress::NoPath { why, .. } if around => {
                if !self.count_attempt(input, why) {
                    self.begin_planning(input, space, false);
                    self.no_way_around = true;
                }
            }
            Progress::NoPath { why, forever: false } if mem::take(&mut self.no_way_around) => {
                self.wait_for_way(input, why);
            }
            Progress::NoPath { why, forever } => self.on_no_path(input, space, why, forever),
        }
    }

    fn start_driving(&mut self, poses: Poses, input: &StepInput<'_>) {
        let Some(goal) = &self.goal else { return };
        let Config { body, limits, behaviour, .. } = input.config;
        self.track = Track::new(&poses, Some(goal.next), body, limits, behaviour);
        (self.replanned, self.unchecked, self.stuck) = (true, true, None);
        (self.is_found, self.before) = (true, None);
        self.phase = Phase::Driving { next: None };
        self.set_driving();
    }

    /// Stored path to this waypoint that begins near `from`.
    fn stored_path(&self, to: usize, from: Pose) -> Option<Poses> {
        let path = self.stored.get(to)?.as_ref()?;
        let (start, _) = *path.poses.first()?;
        let near = start.point().distance(from.point()) < STORED_PATH_START_MAX.0
            && (start.theta - from.theta).radians().abs() < STORED_PATH_START_MAX.1;
        near.then(|| path.clone())
    }

    fn store_path(&mut self, to: usize, path: &Poses) {
        if let Some(stored) = self.stored.get_mut(to) {
            *stored = Some(path.clone());
        }
    }

    fn on_no_path(&mut self, input: &StepInput<'_>, space: &PlanningSpace, why: Hindrance, forever: bool) {
        let Some(goal) = &self.goal else { return };
        let (id, to) = (goal.id, goal.next);
        // What is not impossible replaces the goal before it for good.
        let before = self.before.take();
        if forever {
            let state = GoalState::CannotReach(to, why);
            return match before {
                Some(before) => self.go_on(before, id, state),
                None => self.end(id, state),
            };
        }
        if self.count_attempt(input, why) {
            return;
        }
        if !self.attempts.is_multiple_of(2) && self.back_out(input, space) {
            return;
        }
        self.wait_for_way(input, why);
    }

    /// This goal is impossible: the robot goes on to the one that it was driving to.
    fn go_on(&mut self, before: Goal, id: i32, state: GoalState) {
        self.refuse(id, state);
        self.replace(before, None);
        self.is_found = true;
    }

    /// Waits without a path until the next attempt.
    fn wait_for_way(&mut self, input: &StepInput<'_>, why: Hindrance) {
        if let Some(goal) = &self.goal {
            self.state = GoalState::NoPath { to: goal.next, why };
            self.phase = Phase::Waiting { since: input.now, gone: None };
        }
    }

    /// Counts an attempt. Returns true if the goal has failed with it; a loop continues with its next waypoint instead.
    fn count_attempt(&mut self, input: &StepInput<'_>, why: Hindrance) -> bool {
        self.attempts += 1;
        let Some(goal) = self.goal.as_mut().filter(|_| self.attempts >= input.config.behaviour.attempts) else {
            return false;
        };
        if goal.looped {
            goal.next = goal.after(goal.next).unwrap_or(goal.next);
            (self.attempts, self.nearest, self.room) = (0, f64::INFINITY, None);
            return false;
        }
        let (id, waypoint) = (goal.id, goal.next);
        self.end(id, GoalState::GaveUp(waypoint, why));
        true
    }

    fn drive(&mut self, input: &StepInput<'_>, space: &mut PlanningSpace, next: Option<(Route, usize)>) -> Motion {
        let Config { body, limits, .. } = input.config;
        let planned = self.planned(input);
        let allowed = self.allowed(input, planned);
        let command = self.track.follow(input.robot, input.motion, allowed, body, limits);
        while let Some(passed) = self.track.passed() {
            self.pass(passed);
        }
        let (aside, turned) = self.track.error();
        let stands = input.motion.speed.abs() < STANDSTILL_MPS;
        if aside.abs() > DEVIATION_MAX.0 || turned.abs() > DEVIATION_MAX.1 || self.would_collide(input, space) {
            self.phase = Phase::Idle;
            return Motion { speed: 0.0, ..command };
        }
        if self.track.is_done() {
            match stands {
                true => self.arrive(input, space),
                false => self.phase = Phase::Driving { next: None },
            }
            return Motion { speed: 0.0, ..command };
        }
        // The guard judges the path of the present steering angle: the robot steers first, and waits only then.
        let steers = planned > 0.0 && is_steering(input, command);
        if allowed <= 0.0 && stands && !steers {
            self.set_blocked(input);
            self.phase = Phase::Waiting { since: input.now, gone: None };
            return Motion { speed: 0.0, ..command };
        }
        if self.is_stuck(input, command) {
            self.on_no_path(input, space, Hindrance::NotMoving, false);
            return Motion { speed: 0.0, ..command };
        }
        let next = self.plan_ahead(input, space, next);
        self.phase = Phase::Driving { next };
        straightened(input, command)
    }

    /// True if the robot, off its path, would reach a mapped obstacle before it can stop.
    fn would_collide(&self, input: &StepInput<'_>, space: &PlanningSpace) -> bool {
        let Config { body, limits, law, .. } = input.config;
        let (aside, _) = self.track.error();
        if aside.abs() < MAP_CHECK_DEVIATION_M || self.track.is_done() {
            return false;
        }
        let speed = input.motion.speed.abs();
        let distance = speed * law.reaction + speed * speed / (2.0 * limits.deceleration) + MAP_CHECK_MARGIN_M;
        let along = |distance: f64| {
            let rotation = distance * libm::tan(input.motion.steering) / body.wheelbase;
            input.robot.along(navitools::Motion { translation: distance, rotation })
        };
        let there = match self.track.direction() {
            Direction::Forward => along(distance),
            Direction::Backward => along(-distance),
            Direction::Left => Move::Aside(distance).from(input.robot),
            Direction::Right => Move::Aside(-distance).from(input.robot),
            Direction::TurnLeft => Move::Turn(distance / body.arm()).from(input.robot),
            Direction::TurnRight => Move::Turn(-distance / body.arm()).from(input.robot),
        };
        space.is_free(input.robot) && !space.is_free(there)
    }

    /// Speed that the guard allows in the direction of travel, of the one that is `planned`, m/s.
    fn allowed(&self, input: &StepInput<'_>, planned: f64) -> f64 {
        let permitted = self.permitted(input).min(self.permitted_on_curve(input));
        // Below this, the drive hardly turns.
        if permitted < SPEED_MIN_MPS { 0.0 } else { planned.min(permitted) }
    }

    /// Speed that the guard permits in the direction of travel, m/s; on the spot that of the farthest corner.
    fn permitted(&self, input: &StepInput<'_>) -> f64 {
        let direction = self.track.direction();
        let arm = if direction.turns() { input.config.body.arm() } else { 1.0 };
        arm * input.permitted[direction as usize]
    }

    /// Speed at which the rotation of the present curve is what the guard permits, m/s: `driver_canbus` bounds each
    /// part of a velocity of a base that does not steer. Infinite where the base can go straight as well.
    fn permitted_on_curve(&self, input: &StepInput<'_>) -> f64 {
        let steering = input.motion.steering;
        let along = Axis::from(self.track.direction()) == Axis::Along;
        if !input.config.abilities.turns || !along || steering.abs() <= STEERED_RAD {
            return f64::INFINITY;
        }
        let backward = self.track.direction() == Direction::Backward;
        let curvature = libm::tan(steering) / input.config.body.wheelbase;
        turn_permitted(input, if backward { -curvature } else { curvature }) / curvature.abs()
    }

    /// True if nothing but the guard's bound of a turn keeps the robot from the beginning of its way.
    fn cannot_turn(&self, input: &StepInput<'_>) -> bool {
        let turns = match self.track.direction().turns() {
            true => self.permitted(input),
            false if self.permitted(input) >= SPEED_MIN_MPS => self.permitted_on_curve(input),
            false => f64::INFINITY,
        };
        input.config.abilities.turns && turns < SPEED_MIN_MPS && self.planned(input) > 0.0
    }

    /// Speed that the sonars allow on the path, m/s.
    fn planned(&self, input: &StepInput<'_>) -> f64 {
        // Space that is not sensed may be occupied.
        if self.blind_end(input).is_some() {
            return 0.0;
        }
        let people = ahead::person_speed_limit(input.now, self.track.ahead(), input.obstacles, input.config);
        self.ahead.speed(self.track.distance(), input.config).min(people)
    }

    fn is_stuck(&mut self, input: &StepInput<'_>, command: Motion) -> bool {
        if command.speed == 0.0 || input.motion.speed.abs() >= STANDSTILL_MPS / 2.0 {
            self.stuck = None;
            return false;
        }
        input.now.since(*self.stuck.get_or_insert(input.now)) >= STUCK_AFTER
    }

    /// Plans the next leg while this one is driven, so that waypoints are passed without a stop.
    fn plan_ahead(
        &mut self,
        input: &StepInput<'_>,
        space: &mut PlanningSpace,
        next: Option<(Route, usize)>,
    ) -> Option<(Route, usize)> {
        let Config { body, limits, behaviour, .. } = input.config;
        let goal = self.goal.as_ref()?;
        let end = self.track.end()?;
        let Some((mut route, to)) = next else {
            let to = goal.after(self.track.leads_to()?).filter(|_| self.track.remaining() < PLAN_AHEAD_M)?;
            let at = goal.waypoints[to];
            if let Some(poses) = self.stored_path(to, end) {
                self.track.extend(&poses, Some(to), body, limits, behaviour);
                (self.unchecked, self.replanned) = (true, true);
                return None;
            }
            let heading = at.heading.or_else(|| goal.passing(end.point(), to));
            return Some((Route::begin(space, end, &at, heading, false), to));
        };
        match route.advance(space) {
            Progress::Searching => Some((route, to)),
            Progress::Found(poses) => {
                self.store_path(to, &poses);
                self.track.extend(&poses, Some(to), body, limits, behaviour);
                (self.unchecked, self.replanned) = (true, true);
                None
            }
            // Planned again, with its result reported, at the end of this leg.
            Progress::NoPath { .. } => Some((route, to)),
        }
    }

    fn pass(&mut self, passed: usize) {
        if let Some(goal) = &mut self.goal
            && let Some(next) = goal.after(passed)
        {
            goal.next = next;
            (self.attempts, self.nearest, self.room) = (0, f64::INFINITY, None);
            self.set_driving();
        }
    }

    fn reached(&mut self, number: usize) {
        let Some(goal) = &mut self.goal else { return };
        match goal.after(number) {
            Some(next) => {
                goal.next = next;
                (self.attempts, self.nearest, self.room) = (0, f64::INFINITY, None);
                self.phase = Phase::Idle;
                self.set_driving();
            }
            None if goal.looped => self.state = GoalState::AtLoop,
            None => {
                let id = goal.id;
                self.end(id, GoalState::Reached(number));
            }
        }
    }

    /// Handles standstill at the end of the track.
    fn arrive(&mut self, input: &StepInput<'_>, space: &PlanningSpace) {
        let Some(goal) = &self.goal else { return };
        let Waypoint { at, .. } = goal.waypoints[goal.next];
        if goal.waypoints[goal.next].is_reached(input.robot) {
            return self.reached(goal.next);
        }
        let off = at.distance(input.robot.point());
        self.on_no_path(input, space, Hindrance::Beside(off), false);
    }

    fn set_blocked(&mut self, input: &StepInput<'_>) {
        self.state = match (self.blind_end(input), self.ahead.first()) {
            (Some(forward), _) => GoalState::Blind { forward },
            (None, Some((_, at))) => GoalState::InTheWay(at),
            (None, None) => GoalState::SomebodyNear,
        };
    }

    /// End of the robot with a sonar in an unknown state that the direction of travel needs, true at the front: on the
    /// spot and to the side it needs both.
    fn blind_end(&self, input: &StepInput<'_>) -> Option<bool> {
        let Config { body, age_max, .. } = input.config;
        let is_blind = |forward: &bool| input.obstacles.is_blind(input.now, *forward, body, *age_max);
        let ends: &[bool] = match self.track.direction() {
            Direction::Forward => &[true],
            Direction::Backward => &[false],
            _ => &[true, false],
        };
        ends.iter().copied().find(is_blind)
    }

    fn wait(&mut self, input: &StepInput<'_>, space: &mut PlanningSpace, since: Instant, gone: Option<Instant>) {
        let waited = input.now.since(since).as_secs_f64();
        let drives = !self.track.is_done() && self.allowed(input, self.planned(input)) > START_SPEED_MIN_MPS;
        let gone = drives.then(|| gone.unwrap_or(input.now));
        if gone.is_some_and(|gone| input.now.since(gone) >= CLEAR_FOR) {
            self.phase = Phase::Driving { next: None };
            return self.set_driving();
        }
        let patience =
            input.config.behaviour.patience * f64::from((1 + self.attempts / 2).min(WAIT_MAX_PATIENCE_MULTIPLE));
        if waited >= patience && gone.is_none() {
            if self.count_attempt(input, Hindrance::InTheWay) {
                return;
            }
            if self.cannot_turn(input) && self.make_room(input, space) {
                return;
            }
            // A path around may begin closer to a person than the robot is allowed to go: it backs out first. Where
            // none was found, two attempts were counted since the last wait.
            if self.attempts / 2 % 2 == 1 && self.back_out(input, space) {
                return;
            }
            return self.begin_planning(input, space, true);
        }
        self.phase = Phase::Waiting { since, gone };
    }

    /// Backs out along the path that the robot came from; without one, straight back or forward where the map is free.
    fn back_out(&mut self, input: &StepInput<'_>, space: &PlanningSpace) -> bool {
        let steps = (BACK_OUT_M / TRACE_STEP_M) as usize;
        let came = self.trace.back().map(|(_, forward)| *forward);
        let back = self.trace.iter().rev().take_while(|(_, was)| Some(*was) == came).take(steps);
        let direction = |forward: bool| if forward { Direction::Forward } else { Direction::Backward };
        let back = back.map(|(pose, was)| (*pose, direction(!was))).collect::<Vec<_>>();
        let straight = |direction| straight(input, space, direction, BACK_OUT_M);
        let ways = [back, straight(Direction::Backward), straight(Direction::Forward)];
        let ways = ways.map(|poses| Poses { poses, narrow: false });
        ways.iter().any(|poses| self.begin_backing_out(input, poses))
    }

    /// Begins to move straight out of where the guard permits no turn, in the direction in which it permits the most,
    /// until the circle of the farthest corner is beyond what is at the other end. Each time counts as an attempt, and
    /// until the robot has come nearer to its waypoint it does not come back: this ends.
    fn make_room(&mut self, input: &StepInput<'_>, space: &PlanningSpace) -> bool {
        let Config { body, abilities, .. } = input.config;
        let permitted = |direction: Direction| input.permitted[direction as usize];
        let undoes = |direction: Direction| self.room == Some(direction.opposite());
        let mut ways = vec![(Direction::Backward, body.front), (Direction::Forward, body.rear)];
        if abilities.sideways {
            ways.extend([Direction::Left, Direction::Right].map(|direction| (direction, body.width / 2.0)));
        }
        ways.retain(|(direction, _)| permitted(*direction) > START_SPEED_MIN_MPS && !undoes(*direction));
        ways.sort_by(|(a, _), (b, _)| permitted(*b).total_cmp(&permitted(*a)));
        ways.into_iter().any(|(direction, extent)| {
            let length = (body.arm() - extent + ROOM_MARGIN_M).max(BACK_OUT_MIN_M + TRACE_STEP_M);
            let poses = Poses { poses: straight(input, space, direction, length), narrow: false };
            let begins = self.begin_backing_out(input, &poses);
            self.room = if begins { Some(direction) } else { self.room };
            begins
        })
    }

    fn begin_backing_out(&mut self, input: &StepInput<'_>, poses: &Poses) -> bool {
        let Config { body, limits, behaviour, .. } = input.config;
        self.track = Track::new(poses, None, body, limits, behaviour);
        self.check_ahead(input.now, input.obstacles, input.config);
        // A base without steering begins at once, as far as the guard permits; one that steers does so first.
        let refused = input.config.abilities.turns && self.permitted(input) < SPEED_MIN_MPS;
        if self.track.remaining() < BACK_OUT_MIN_M || self.planned(input) <= START_SPEED_MIN_MPS || refused {
            self.track = Track::default();
            return false;
        }
        self.state = GoalState::BackingOut;
        (self.replanned, self.stuck) = (true, None);
        self.phase = Phase::BackingOut { blocked: None };
        true
    }

    fn back_up(&mut self, input: &StepInput<'_>, space: &mut PlanningSpace, blocked: Option<Instant>) -> Motion {
        let Config { body, limits, .. } = input.config;
        let planned = self.planned(input);
        let allowed = self.allowed(input, planned);
        let command = self.track.follow(input.robot, input.motion, allowed, body, limits);
        let stands = input.motion.speed.abs() < STANDSTILL_MPS;
        let steers = planned > 0.0 && is_steering(input, command);
        let blocked = (allowed <= 0.0 && !steers).then(|| blocked.unwrap_or(input.now));
        let gives_up = blocked.is_some_and(|since| input.now.since(since) >= BACKING_OUT_BLOCKED_MAX);
        if (self.track.is_done() || gives_up || self.is_stuck(input, command)) && stands {
            self.trace.clear();
            self.begin_planning(input, space, true);
            return Motion { speed: 0.0, ..command };
        }
        self.phase = Phase::BackingOut { blocked };
        straightened(input, command)
    }

    /// Records the driven path, for backing out, and the progress towards the waypoint.
    fn record_trace(&mut self, input: &StepInput<'_>) {
        let along = input.motion.axis == Axis::Along;
        if !along && input.motion.speed.abs() >= STANDSTILL_MPS {
            // It does not back out over turns on the spot and moves to the side.
            self.trace.clear();
        }
        let last = self.trace.back().map(|(pose, _)| *pose);
        let step = last.map_or(TRACE_STEP_M, |last| last.point().distance(input.robot.point()));
        if step < TRACE_STEP_M || input.motion.speed.abs() < STANDSTILL_MPS {
            return;
        }
        if step > 4.0 * TRACE_STEP_M {
            self.trace.clear();
        }
        if along && !matches!(self.phase, Phase::BackingOut { .. }) {
            self.trace.push_back((input.robot, input.motion.speed > 0.0));
        }
        if self.trace.len() > (TRACE_LENGTH_M / TRACE_STEP_M) as usize {
            self.trace.pop_front();
        }
        let Some(goal) = &self.goal else { return };
        let distance = goal.waypoints[goal.next].at.distance(input.robot.point());
        if distance < self.nearest - PROGRESS_RESETS_ATTEMPTS_M {
            (self.attempts, self.nearest, self.room) = (0, distance, None);
        }
    }
}

/// Poses of a straight way from here as far as the map is free, at most `length` m.
fn straight(input: &StepInput<'_>, space: &PlanningSpace, direction: Direction, length: f64) -> Vec<(Pose, Direction)> {
    let (x, y) = direction.ahead();
    let pose = |n: usize| {
        let along = TRACE_STEP_M * n as f64;
        input.robot * Pose::new(along * x, along * y, 0.0)
    };
    let steps = libm::round(length / TRACE_STEP_M) as usize;
    (0..=steps).map(pose).take_while(|pose| space.is_free(*pose)).map(|pose| (pose, direction)).collect()
}

/// Rotation that the guard permits, rad/s, in the sense of `rotation`.
fn turn_permitted(input: &StepInput<'_>, rotation: f64) -> f64 {
    let direction = if rotation < 0.0 { Direction::TurnRight } else { Direction::TurnLeft };
    input.permitted[direction as usize]
}

/// The command of a base that does not steer, with no more of a small correction than the turn that the guard permits:
/// for a greater one `driver_canbus` would stop the motion.
fn straightened(input: &StepInput<'_>, command: Motion) -> Motion {
    let Motion { speed, steering, axis } = command;
    if !input.config.abilities.turns || axis != Axis::Along || steering.abs() > STEERED_RAD || speed == 0.0 {
        return command;
    }
    let most = libm::atan(input.config.body.wheelbase * turn_permitted(input, speed * steering) / speed.abs());
    Motion { steering: steering.clamp(-most, most), ..command }
}

/// True while the steering is on its way to the commanded angle.
fn is_steering(input: &StepInput<'_>, command: Motion) -> bool {
    (command.steering - input.motion.steering).abs() > STEERED_RAD
}
