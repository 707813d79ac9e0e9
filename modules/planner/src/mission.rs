//! Execution of a goal: search a path, drive it, wait for obstacles, search a path around them, back out.
//!
//! A path is first searched on the map alone, because people move away; echoes stop the robot on it. If an obstacle
//! remains, a path around it is searched, then another one after backing out, then the robot waits longer. A goal that
//! is driven once fails after a maximum number of attempts; a loop continues, with its next waypoint where that is
//! possible.

use crate::config::Config;
use crate::goal::{Goal, Waypoint};
use crate::goal_state::{GoalState, Hindrance};
use crate::guard::{self, Ahead};
use crate::obstacles::Obstacles;
use crate::route::{Progress, Route, Ways};
use crate::track::{Motion, Track};
use base::{Duration, Instant};
use messages::Hold;
use navitools::Pose;
use std::collections::VecDeque;
use std::mem;

/// Remaining length of the current leg below which the next one is planned, m.
const AHEAD: f64 = 3.0;
/// Time for which the path must be clear before the robot starts again.
const GONE: Duration = Duration::from_millis(100);
/// Allowed speed above which the robot starts, m/s.
const WORTH: f64 = 0.08;
/// Time for which backing out may be blocked before it ends.
const HINDERED: Duration = Duration::from_millis(900);
/// Speed below which the robot is at standstill, m/s.
const STANDING: f64 = 0.03;
/// Deviation from the path above which a new path is searched, m and rad.
const OFF: (f64, f64) = (0.30, 0.6);
/// Lateral deviation above which the motion is checked against the map, and the margin beyond the stopping distance, m.
const ASTRAY: f64 = 0.06;
const STEP_AHEAD: f64 = 0.05;
/// Time of commanded motion at standstill after which the robot is stuck.
const STUCK: Duration = Duration::from_secs(4);
/// Length of the driven path that is kept for backing out, and distance of its poses, m.
const TRACE: f64 = 2.0;
const TRACE_STEP: f64 = 0.05;
/// Distance to back out, m.
const BACK: f64 = 0.9;
/// Shortest useful distance to back out, m.
const BACK_LEAST: f64 = 0.25;
/// Distance from the start of a stored path of a loop at which the path is driven again, m and rad.
const AGAIN: (f64, f64) = (0.12, 0.12);
/// Largest number of waypoints for which paths are stored.
const KEPT: usize = 64;
/// Progress towards the waypoint that resets the number of attempts, m.
const FORGIVEN: f64 = 1.0;
/// Longest wait between attempts, as a multiple of `patience`.
const WAITS_MAX: u32 = 3;

/// Inputs of a step.
pub struct Sight<'a> {
    /// Current time.
    pub now: Instant,
    /// Pose of the robot in the map.
    pub robot: Pose,
    /// Speed and steering angle of the robot.
    pub motion: Motion,
    /// Obstacles sensed by the sonars.
    pub obstacles: &'a Obstacles,
    /// Configuration.
    pub config: &'a Config,
}

/// Phase of the mission.
enum Doing {
    Nothing,
    /// At standstill while a path is searched, around sensed obstacles or on the map alone.
    Thinking {
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
    Backing {
        blocked: Option<Instant>,
    },
}

/// Goal and its progress.
pub struct Mission {
    goal: Option<Goal>,
    doing: Doing,
    track: Track,
    ahead: Ahead,
    /// True if the path must be checked for obstacles before it is driven.
    unseen: bool,
    trace: VecDeque<(Pose, bool)>,
    /// Paths between waypoints that were found on the map alone, by the waypoint at their end.
    kept: Vec<Option<Vec<(Pose, bool)>>>,
    attempts: u32,
    /// Smallest distance to the waypoint when the number of attempts was last reset, m.
    nearest: f64,
    /// Instant since which motion is commanded at standstill.
    stuck: Option<Instant>,
    /// True after a contact at the leading end: the robot backs out before it continues.
    bumped: bool,
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
            doing: Doing::Nothing,
            track: Track::default(),
            ahead: Ahead::default(),
            unseen: false,
            trace: VecDeque::new(),
            kept: Vec::new(),
            attempts: 0,
            nearest: f64::INFINITY,
            stuck: None,
            bumped: false,
            id: 0,
            waypoint: 0,
            state: GoalState::NoGoal,
            replanned: false,
        }
    }
}

impl Mission {
    /// Replaces the goal.
    pub fn begin(&mut self, goal: Goal) {
        let kept = if goal.waypoints.len() <= KEPT { vec![None; goal.waypoints.len()] } else { Vec::new() };
        let (trace, bumped) = (mem::take(&mut self.trace), self.bumped);
        *self = Self { id: goal.id, kept, trace, bumped, goal: Some(goal), replanned: true, ..Self::default() };
        self.state = GoalState::Planning;
    }

    /// Ends the goal with its final state.
    pub fn end(&mut self, id: i32, state: GoalState) {
        let waypoint = self.waypoint;
        let trace = mem::take(&mut self.trace);
        *self = Self { id, waypoint, trace, state, replanned: true, ..Self::default() };
    }

    /// Interrupts driving after a stop by another party or a jump of the pose: a path is planned again when the robot
    /// may drive.
    pub fn interrupt(&mut self) {
        self.doing = Doing::Nothing;
        self.stuck = None;
        self.replanned |= !self.track.ahead().is_empty();
        self.track = Track::default();
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
        let stands = matches!(self.doing, Doing::Nothing | Doing::Thinking { .. });
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
    pub fn look(&mut self, now: Instant, obstacles: &Obstacles, config: &Config) {
        self.ahead = Ahead::look(now, self.track.ahead(), obstacles, config);
        self.unseen = false;
    }

    fn say_driving(&mut self) {
        if let Some(goal) = &self.goal {
            self.waypoint = goal.next;
            self.state = GoalState::Driving { to: goal.next, of: goal.waypoints.len(), looped: goal.looped };
        }
    }

    /// Computes the command of a robot that may drive. Called at 20 Hz.
    pub fn step(&mut self, sight: &Sight<'_>, ways: &mut Ways) -> Motion {
        let stand = Motion { speed: 0.0, steering: sight.motion.steering };
        if self.goal.is_none() {
            return stand;
        }
        self.remember(sight);
        if self.unseen {
            self.look(sight.now, sight.obstacles, sight.config);
        }
        match mem::replace(&mut self.doing, Doing::Nothing) {
            Doing::Nothing => {
                if mem::take(&mut self.bumped) && self.back_out(sight, ways) {
                    return stand;
                }
                self.think(sight, ways, false);
                stand
            }
            Doing::Thinking { route, around } => {
                self.thinking(sight, ways, route, around);
                stand
            }
            Doing::Driving { next } => self.drive(sight, ways, next),
            Doing::Waiting { since, gone } => {
                self.wait(sight, ways, since, gone);
                stand
            }
            Doing::Backing { blocked } => self.back(sight, ways, blocked),
        }
    }

    /// Begins to search a path from here to the next waypoint.
    fn think(&mut self, sight: &Sight<'_>, ways: &mut Ways, around: bool) {
        let Some(goal) = &self.goal else { return };
        let to = goal.waypoints[goal.next];
        if to.is_reached(sight.robot) && sight.motion.speed.abs() < STANDING {
            return self.reached(goal.next);
        }
        self.track = Track::default();
        if around {
            ways.sense(sight.obstacles, sight.robot, &sight.config.body);
        }
        if let Some(poses) = self.kept_way(goal.next, sight.robot).filter(|_| !around) {
            return self.set_out(poses, sight);
        }
        let heading = to.heading.or_else(|| goal.passing(sight.robot.point(), goal.next));
        let route = Route::begin(ways, sight.robot, &to, heading, around);
        self.doing = Doing::Thinking { route, around };
    }

    fn thinking(&mut self, sight: &Sight<'_>, ways: &mut Ways, mut route: Route, around: bool) {
        match route.advance(ways) {
            Progress::Going => self.doing = Doing::Thinking { route, around },
            Progress::Found(poses) => {
                if let Some(goal) = self.goal.as_ref().filter(|_| !around) {
                    let to = goal.next;
                    self.keep_way(to, &poses);
                }
                self.set_out(poses, sight);
            }
            Progress::NoWay { why, forever } => self.no_way(sight, ways, why, forever && !around),
        }
    }

    fn set_out(&mut self, poses: Vec<(Pose, bool)>, sight: &Sight<'_>) {
        let Some(goal) = &self.goal else { return };
        let Config { body, limits, manners, .. } = sight.config;
        self.track = Track::new(&poses, Some(goal.next), body, limits, manners);
        (self.replanned, self.unseen, self.stuck) = (true, true, None);
        self.doing = Doing::Driving { next: None };
        self.say_driving();
    }

    /// Stored path to this waypoint that begins near `from`.
    fn kept_way(&self, to: usize, from: Pose) -> Option<Vec<(Pose, bool)>> {
        let way = self.kept.get(to)?.as_ref()?;
        let (start, _) = *way.first()?;
        let near =
            start.point().distance(from.point()) < AGAIN.0 && (start.theta - from.theta).radians().abs() < AGAIN.1;
        near.then(|| way.clone())
    }

    fn keep_way(&mut self, to: usize, way: &[(Pose, bool)]) {
        if let Some(kept) = self.kept.get_mut(to) {
            *kept = Some(way.to_vec());
        }
    }

    fn no_way(&mut self, sight: &Sight<'_>, ways: &Ways, why: Hindrance, forever: bool) {
        let Some(goal) = &self.goal else { return };
        let (id, to) = (goal.id, goal.next);
        if forever {
            return self.end(id, GoalState::CannotReach(to, why));
        }
        if self.is_enough(sight, why) {
            return;
        }
        if !self.attempts.is_multiple_of(2) && self.back_out(sight, ways) {
            return;
        }
        self.state = GoalState::NoPath { to, why };
        self.doing = Doing::Waiting { since: sight.now, gone: None };
    }

    /// Counts an attempt. Returns true if the goal has failed with it; a loop continues with its next waypoint instead.
    fn is_enough(&mut self, sight: &Sight<'_>, why: Hindrance) -> bool {
        self.attempts += 1;
        let Some(goal) = self.goal.as_mut().filter(|_| self.attempts >= sight.config.manners.attempts) else {
            return false;
        };
        if goal.looped {
            goal.next = goal.after(goal.next).unwrap_or(goal.next);
            (self.attempts, self.nearest) = (0, f64::INFINITY);
            return false;
        }
        let (id, waypoint) = (goal.id, goal.next);
        self.end(id, GoalState::GaveUp(waypoint, why));
        true
    }

    fn drive(&mut self, sight: &Sight<'_>, ways: &mut Ways, next: Option<(Route, usize)>) -> Motion {
        let Config { body, limits, .. } = sight.config;
        let allowed = self.allowed(sight);
        let command = self.track.follow(sight.robot, sight.motion, allowed, body, limits);
        while let Some(passed) = self.track.passed() {
            self.pass(passed);
        }
        let (aside, turned) = self.track.error();
        let stands = sight.motion.speed.abs() < STANDING;
        if aside.abs() > OFF.0 || turned.abs() > OFF.1 || self.leaves_the_floor(sight, ways) {
            self.doing = Doing::Nothing;
            return Motion { speed: 0.0, ..command };
        }
        if self.track.is_done() {
            match stands {
                true => self.arrive(sight, ways),
                false => self.doing = Doing::Driving { next: None },
            }
            return Motion { speed: 0.0, ..command };
        }
        if allowed <= 0.0 && stands {
            self.say_blocked(sight);
            self.doing = Doing::Waiting { since: sight.now, gone: None };
            return Motion { speed: 0.0, ..command };
        }
        if self.is_stuck(sight, command) {
            self.no_way(sight, ways, Hindrance::NotMoving, false);
            return Motion { speed: 0.0, ..command };
        }
        let next = self.think_ahead(sight, ways, next);
        self.doing = Doing::Driving { next };
        command
    }

    /// True if the robot, off its path, would reach a mapped obstacle before it can stop.
    fn leaves_the_floor(&self, sight: &Sight<'_>, ways: &Ways) -> bool {
        let Config { body, limits, manners, .. } = sight.config;
        let (aside, _) = self.track.error();
        if aside.abs() < ASTRAY || self.track.is_done() {
            return false;
        }
        let speed = sight.motion.speed.abs();
        let way = speed * manners.reaction + speed * speed / (2.0 * limits.deceleration) + STEP_AHEAD;
        let way = if self.track.forward().unwrap_or(true) { way } else { -way };
        let rotation = way * libm::tan(sight.motion.steering) / body.wheelbase;
        let there = sight.robot.along(navitools::Motion { translation: way, rotation });
        ways.is_free(sight.robot) && !ways.is_free(there)
    }

    /// Speed that the sonars allow in the direction of travel, m/s.
    fn allowed(&self, sight: &Sight<'_>) -> f64 {
        let forward = self.track.forward().unwrap_or(true);
        let sudden = guard::sudden(sight.now, forward, sight.obstacles, sight.config);
        let meeting = guard::meeting(sight.now, self.track.ahead(), sight.obstacles, sight.config);
        self.ahead.speed(self.track.way(), sight.config).min(sudden).min(meeting)
    }

    fn is_stuck(&mut self, sight: &Sight<'_>, command: Motion) -> bool {
        if command.speed == 0.0 || sight.motion.speed.abs() >= STANDING / 2.0 {
            self.stuck = None;
            return false;
        }
        sight.now.since(*self.stuck.get_or_insert(sight.now)) >= STUCK
    }

    /// Plans the next leg while this one is driven, so that waypoints are passed without a stop.
    fn think_ahead(
        &mut self,
        sight: &Sight<'_>,
        ways: &mut Ways,
        next: Option<(Route, usize)>,
    ) -> Option<(Route, usize)> {
        let Config { body, limits, manners, .. } = sight.config;
        let goal = self.goal.as_ref()?;
        let (end, _) = self.track.end()?;
        let Some((mut route, to)) = next else {
            let to = goal.after(self.track.leads_to()?).filter(|_| self.track.remaining() < AHEAD)?;
            let at = goal.waypoints[to];
            if let Some(poses) = self.kept_way(to, end) {
                self.track.extend(&poses, Some(to), body, limits, manners);
                (self.unseen, self.replanned) = (true, true);
                return None;
            }
            let heading = at.heading.or_else(|| goal.passing(end.point(), to));
            return Some((Route::begin(ways, end, &at, heading, false), to));
        };
        match route.advance(ways) {
            Progress::Going => Some((route, to)),
            Progress::Found(poses) => {
                self.keep_way(to, &poses);
                self.track.extend(&poses, Some(to), body, limits, manners);
                (self.unseen, self.replanned) = (true, true);
                None
            }
            // Planned again, with its result reported, at the end of this leg.
            Progress::NoWay { .. } => Some((route, to)),
        }
    }

    fn pass(&mut self, passed: usize) {
        if let Some(goal) = &mut self.goal
            && let Some(next) = goal.after(passed)
        {
            goal.next = next;
            (self.attempts, self.nearest) = (0, f64::INFINITY);
            self.say_driving();
        }
    }

    fn reached(&mut self, number: usize) {
        let Some(goal) = &mut self.goal else { return };
        match goal.after(number) {
            Some(next) => {
                goal.next = next;
                (self.attempts, self.nearest) = (0, f64::INFINITY);
                self.doing = Doing::Nothing;
                self.say_driving();
            }
            None if goal.looped => self.state = GoalState::AtLoop,
            None => {
                let id = goal.id;
                self.end(id, GoalState::Reached(number));
            }
        }
    }

    /// Handles standstill at the end of the track.
    fn arrive(&mut self, sight: &Sight<'_>, ways: &Ways) {
        let Some(goal) = &self.goal else { return };
        let Waypoint { at, .. } = goal.waypoints[goal.next];
        if goal.waypoints[goal.next].is_reached(sight.robot) {
            return self.reached(goal.next);
        }
        let off = at.distance(sight.robot.point());
        self.no_way(sight, ways, Hindrance::Beside(off), false);
    }

    fn say_blocked(&mut self, sight: &Sight<'_>) {
        let forward = self.track.forward().unwrap_or(true);
        self.state = match self.ahead.first() {
            _ if sight.obstacles.is_blind(sight.now, forward, &sight.config.body) => GoalState::Blind { forward },
            Some((_, at)) => GoalState::InTheWay(at),
            None => GoalState::SomebodyNear,
        };
    }

    fn wait(&mut self, sight: &Sight<'_>, ways: &mut Ways, since: Instant, gone: Option<Instant>) {
        let waited = sight.now.since(since).as_secs_f64();
        let drives = !self.track.is_done() && self.allowed(sight) > WORTH;
        let gone = drives.then(|| gone.unwrap_or(sight.now));
        if gone.is_some_and(|gone| sight.now.since(gone) >= GONE) {
            self.doing = Doing::Driving { next: None };
            return self.say_driving();
        }
        let patience = sight.config.manners.patience * f64::from((1 + self.attempts / 2).min(WAITS_MAX));
        if waited >= patience && gone.is_none() {
            if self.is_enough(sight, Hindrance::InTheWay) {
                return;
            }
            // A path around may begin closer to a person than the robot is allowed to go: it backs out first.
            if self.attempts.is_multiple_of(2) && self.back_out(sight, ways) {
                return;
            }
            return self.think(sight, ways, true);
        }
        self.doing = Doing::Waiting { since, gone };
    }

    /// Backs out along the path that the robot came from; without one, straight back or forward where the map is free.
    fn back_out(&mut self, sight: &Sight<'_>, ways: &Ways) -> bool {
        let steps = (BACK / TRACE_STEP) as usize;
        let came = self.trace.back().map(|(_, forward)| *forward);
        let back = self.trace.iter().rev().take_while(|(_, was)| Some(*was) == came).take(steps);
        let back: Vec<(Pose, bool)> = back.map(|(pose, was)| (*pose, !was)).collect();
        let straight = |forward: bool| {
            let step = if forward { TRACE_STEP } else { -TRACE_STEP };
            let pose = move |n: usize| sight.robot * Pose::new(step * n as f64, 0.0, 0.0);
            let free = (0..=steps).map(pose).take_while(|pose| ways.is_free(*pose));
            free.map(|pose| (pose, forward)).collect::<Vec<_>>()
        };
        [back, straight(false), straight(true)].iter().any(|poses| self.retreat(sight, poses))
    }

    fn retreat(&mut self, sight: &Sight<'_>, poses: &[(Pose, bool)]) -> bool {
        let Config { body, limits, manners, .. } = sight.config;
        self.track = Track::new(poses, None, body, limits, manners);
        self.look(sight.now, sight.obstacles, sight.config);
        if self.track.remaining() < BACK_LEAST || self.allowed(sight) <= WORTH {
            self.track = Track::default();
            return false;
        }
        self.state = GoalState::BackingOut;
        (self.replanned, self.stuck) = (true, None);
        self.doing = Doing::Backing { blocked: None };
        true
    }

    fn back(&mut self, sight: &Sight<'_>, ways: &mut Ways, blocked: Option<Instant>) -> Motion {
        let Config { body, limits, .. } = sight.config;
        let allowed = self.allowed(sight);
        let command = self.track.follow(sight.robot, sight.motion, allowed, body, limits);
        let stands = sight.motion.speed.abs() < STANDING;
        let blocked = (allowed <= 0.0).then(|| blocked.unwrap_or(sight.now));
        let gives_up = blocked.is_some_and(|since| sight.now.since(since) >= HINDERED);
        if (self.track.is_done() || gives_up || self.is_stuck(sight, command)) && stands {
            self.trace.clear();
            self.think(sight, ways, true);
            return Motion { speed: 0.0, ..command };
        }
        self.doing = Doing::Backing { blocked };
        command
    }

    /// Records the driven path, for backing out, and the progress towards the waypoint.
    fn remember(&mut self, sight: &Sight<'_>) {
        let last = self.trace.back().map(|(pose, _)| *pose);
        let step = last.map_or(TRACE_STEP, |last| last.point().distance(sight.robot.point()));
        if step < TRACE_STEP || sight.motion.speed.abs() < STANDING {
            return;
        }
        if step > 4.0 * TRACE_STEP {
            self.trace.clear();
        }
        if !matches!(self.doing, Doing::Backing { .. }) {
            self.trace.push_back((sight.robot, sight.motion.speed > 0.0));
        }
        if self.trace.len() > (TRACE / TRACE_STEP) as usize {
            self.trace.pop_front();
        }
        let Some(goal) = &self.goal else { return };
        let distance = goal.waypoints[goal.next].at.distance(sight.robot.point());
        if distance < self.nearest - FORGIVEN {
            (self.attempts, self.nearest) = (0, distance);
        }
    }
}
