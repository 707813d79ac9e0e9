//! Hybrid A*: drivable path for the footprint of a robot, forwards and in reverse; of a base that can, with turns on
//! the spot and moves to the side.
//!
//! D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel, Practical search techniques in path planning for autonomous driving
//! (2008). States are cells of the map and 72 headings, each with the exact pose of the path that reached it; steps are
//! arcs with curvatures of zero, half and the whole limit, turns on the spot and moves to the side. Two heuristics are
//! combined: a path for a round robot around all obstacles (`reach`) and, near the goal, the path of a car without
//! obstacles (Reeds and Shepp), which also ends the search where it is free. Then parts of the path are replaced by
//! better curves (`smooth`).
//!
//! An engine without a clock: [`Search::begin`], then [`Search::advance`] repeatedly. The budget counts work, in
//! expanded states or operations of equal duration (a few microseconds), so that a request has the same result on every
//! machine. The first path may be driven while the search improves it. Buffers are reused: later searches of the same
//! kind allocate nothing.

mod footprint;
mod lattice;
mod open;
mod outline;
mod reach;
mod request;
mod ruler;
mod shot;
mod smooth;

pub use footprint::Footprint;
pub use outline::Outline;
pub use request::{Abilities, Budget, Costs, Goal, Limits, SearchError, Status};

use crate::map::Field;
use crate::path::{Move, Path};
use footprint::Body;
use lattice::{HEADINGS, Lattice, ProximityCost, Sample};
use navitools::{Pose, reeds_shepp_length, wrap};
use open::{NONE, Node, Open};
use reach::Reach;
use request::Margin;
use ruler::Ruler;
use shot::Shot;
use smooth::Smoothing;

/// Passes of the search: weight of the heuristic, and number of cells and headings, in each dimension, that form one
/// state. The coarse pass finds most paths with an eighth of the states; the next pass finds the rest.
const PASSES: [(f32, usize); 4] = [(2.0, 2), (1.5, 1), (1.2, 1), (1.0, 1)];
/// Number of steps of [`Reach`] that take as long as one state.
const REACH_STEPS_PER_STATE: u32 = 16;
/// Number of poses of the exact check of a path that take as long as one state.
const LOOKS_PER_STATE: u32 = 4;
/// Maximum number of steps of [`Reach`] per state.
const REACH_STEPS_MAX: u32 = 400;
/// Distance, in turning radii, below which the path of a car is evaluated too.
const CAR_PATH_RADII: f64 = 4.0;
/// Longest path inside an obstacle to get out of it, m.
const ESCAPE_MAX_M: f32 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Idle,
    /// The heuristic is computed from the goal to the start.
    Reach,
    Search,
    /// `last`: the search is over.
    Smooth {
        last: bool,
    },
    Found,
    NoPath(SearchError),
}

/// Goal, field, margin, offset of the end from the goal, and the headings that are free there.
type ReachKey = (Goal, u64, f64, (f64, f64), u128);

impl Goal {
    /// Number of headings of its ends that are tried.
    const fn headings(&self) -> usize {
        if self.heading.is_some() { 1 } else { HEADINGS }
    }

    /// End of a path beside the goal, with one of the headings.
    fn end(&self, (dx, dy): (f64, f64), index: usize) -> Pose {
        let turn = index as f64 * (2.0 * core::f64::consts::PI / HEADINGS as f64);
        Pose::new(self.x + dx, self.y + dy, self.heading.unwrap_or(0.0) + turn)
    }
}

/// Search with its buffers.
#[derive(Debug)]
pub struct Search {
    limits: Limits,
    phase: Phase,
    start: Pose,
    goal: Goal,
    /// Exact end: a pose, or a point with any heading.
    target: Result<Pose, (f64, f64)>,
    budget: Budget,
    /// Number of margins that were tried without success, and the present one.
    attempt: usize,
    margin: Margin,
    /// Maximum number of margins.
    margins_max: usize,
    /// Work done, that before this margin, and that before the first path.
    work: u32,
    before: u32,
    first: u32,
    expansions: u32,
    pass: usize,
    /// Expansions until the next attempt to end with a curve.
    until_shot: u32,
    /// Penetration of the footprint with its margin into obstacles at the start, m, and true once the path has left
    /// them.
    depth: f64,
    escaped: bool,
    /// True if the footprint itself touches an obstacle at the start.
    contact: bool,
    /// True if the steps are short: with the usual ones everything within reach was tried.
    short: bool,
    /// Parameters for which the buffers are valid: a resolution, a margin, and short steps or not; those of the
    /// heuristic.
    lattice_for: Option<(f64, Margin, bool)>,
    reach_for: Option<ReachKey>,
    body: Body,
    outline: Outline,
    toll: ProximityCost,
    /// Margin for which the heuristic is computed, m, and its cost.
    reach_margin: f64,
    reach_toll: ProximityCost,
    lattice: Lattice,
    reach: Reach,
    open: Open,
    shot: Shot,
    smoothing: Smoothing,
    /// Best path of the search, and the best smoothed path.
    raw: Vec<Move>,
    raw_cost: f32,
    path: Path,
    has_path: bool,
}

impl Search {
    /// Creates a search for a robot. With limits that are not finite or not positive where required, every search ends
    /// with [`SearchError::Invalid`].
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            phase: Phase::Idle,
            start: Pose::default(),
            goal: Goal { x: 0.0, y: 0.0, heading: None, tolerance_m: 0.0 },
            target: Err((0.0, 0.0)),
            budget: Budget::default(),
            attempt: 0,
            margin: Margin::default(),
            margins_max: usize::MAX,
            work: 0,
            before: 0,
            first: 0,
            expansions: 0,
            pass: 0,
            until_shot: 0,
            depth: 0.0,
            escaped: false,
            contact: false,
            short: false,
            lattice_for: None,
            reach_for: None,
            body: Body::default(),
            outline: Outline::new(&limits.corners()),
            toll: ProximityCost::default(),
            reach_margin: 0.0,
            reach_toll: ProximityCost::default(),
            lattice: Lattice::default(),
            reach: Reach::default(),
            open: Open::default(),
            shot: Shot::default(),
            smoothing: Smoothing::default(),
            raw: Vec::new(),
            raw_cost: f32::INFINITY,
            path: Path::default(),
            has_path: false,
        }
    }

    /// Limits of the robot.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Makes the next searches find only paths with the whole margin, or also those with less.
    pub fn keep_margin(&mut self, keep: bool) {
        self.margins_max = if keep { 1 } else { usize::MAX };
    }

    /// Work done since [`Search::begin`].
    #[must_use]
    pub fn work(&self) -> u32 {
        self.work
    }

    /// Number of states expanded since [`Search::begin`].
    #[must_use]
    pub fn expansions(&self) -> u32 {
        self.expansions
    }

    /// Plans in one call.
    ///
    /// # Errors
    /// There is no path; the error has the reason.
    pub fn plan(&mut self, field: &Field, start: Pose, goal: Goal, budget: Budget) -> Result<&Path, SearchError> {
        self.begin(field, start, goal, budget);
        while matches!(self.phase, Phase::Reach | Phase::Search | Phase::Smooth { .. }) {
            self.advance(field, u32::MAX);
        }
        match self.phase {
            Phase::NoPath(why) => Err(why),
            _ => Ok(&self.path),
        }
    }

    /// Begins a search and clears the last path. Results for the goal are kept as long as goal and field do not change.
    pub fn begin(&mut self, field: &Field, start: Pose, goal: Goal, budget: Budget) {
        self.start = start;
        self.goal = goal;
        self.budget = budget;
        (self.work, self.expansions, self.attempt) = (0, 0, 0);
        (self.raw_cost, self.has_path) = (f32::INFINITY, false);
        self.raw.clear();
        if self.is_sensible() {
            self.contact = self.outline.gap(field, start, 1.0) <= 0.0;
            self.begin_margin(field);
        } else {
            self.phase = Phase::NoPath(SearchError::Invalid);
        }
    }

    fn is_sensible(&self) -> bool {
        let Limits { footprint, margin_m, margin_least_m, radius_m, costs, .. } = self.limits;
        let Footprint { length_m, width_m, rear_m } = footprint;
        let sizes = [length_m, width_m, radius_m, costs.keep_m, costs.spot];
        let Costs { reverse, turn, cusp, aside, steer, near, .. } = costs;
        let (preferences, more) = ([reverse, turn, cusp, aside, steer, near], [margin_m, margin_least_m, rear_m]);
        let Pose { x, y, theta } = self.start;
        let places = [x, y, theta.radians(), self.goal.x, self.goal.y, self.goal.heading.unwrap_or(0.0)];
        sizes.iter().all(|size| (1e-3..=1e3).contains(size))
            && preferences.iter().chain(&more).all(|part| (0.0..=1e3).contains(part))
            && (0.0..=1e3).contains(&self.goal.tolerance_m)
            && places.iter().all(|place| place.is_finite())
    }

    /// Begins with the margin of this attempt, or with the next one with which the goal is free.
    fn begin_margin(&mut self, field: &Field) {
        (self.before, self.first, self.pass, self.escaped, self.short) = (self.work, 0, 0, false, false);
        let Some(margin) = self.limits.margin(self.attempt) else {
            self.phase = Phase::NoPath(SearchError::Unreachable);
            return;
        };
        self.margin = margin;
        let costs = self.limits.costs;
        let body = self.limits.body(margin.grown, field);
        self.body = body;
        self.make_steps(field);
        self.toll = ProximityCost::new(body.inner, &costs);
        // One heuristic for all smaller margins: its cells are larger than their differences.
        self.reach_margin = if self.attempt == 0 { margin.grown } else { self.limits.margin_least() };
        let narrow = self.limits.body(self.reach_margin, field);
        self.reach_toll = ProximityCost::new(narrow.inner, &costs);
        match self.find_target(field) {
            Ok(()) => self.phase = Phase::Reach,
            Err(why) => self.fail(field, why),
        }
    }

    /// Makes the steps for this margin.
    fn make_steps(&mut self, field: &Field) {
        let (body, margin, resolution) = (self.body, self.margin, field.frame().resolution);
        if self.lattice_for != Some((resolution, margin, self.short)) {
            self.lattice_for = Some((resolution, margin, self.short));
            let looks = |part: Move| (body.spacing(part, margin.deviation), body.way(part));
            self.lattice.build(&self.limits, resolution, self.short, looks);
        }
        self.lattice.turn_to(self.start.theta.radians());
    }

    /// Ends the search with a reason, or begins again with a smaller margin.
    fn fail(&mut self, field: &Field, why: SearchError) {
        self.attempt += 1;
        if self.attempt < self.margins_max && self.limits.margin(self.attempt).is_some() {
            self.begin_margin(field);
        } else {
            self.phase = Phase::NoPath(why);
        }
    }

    /// True if the robot fits in at the goal with the smallest margin. If not, each search for it ends with
    /// [`SearchError::GoalBlocked`].
    #[must_use]
    pub fn fits(&self, field: &Field, goal: &Goal) -> bool {
        let Some(least) = (0..).map_while(|attempt| self.limits.margin(attempt)).last() else { return false };
        let body = self.limits.body(least.grown, field);
        offsets(goal.tolerance_m, field.frame().resolution).any(|offset| {
            (0..goal.headings()).any(|index| {
                let Pose { x, y, theta } = goal.end(offset, index);
                let (sin, cos) = theta.sin_cos();
                body.is_free(field, x, y, sin, cos)
            })
        })
    }

    /// Finds the end of the path and the start of the heuristic.
    fn find_target(&mut self, field: &Field) -> Result<(), SearchError> {
        let Goal { heading, tolerance_m, .. } = self.goal;
        let (goal, body, headings) = (self.goal, self.body, self.goal.headings());
        let pose = |offset: (f64, f64), index: usize| goal.end(offset, index);
        for offset in offsets(tolerance_m, field.frame().resolution) {
            let is_free = |index: &usize| {
                let Pose { x, y, theta } = pose(offset, *index);
                let (sin, cos) = theta.sin_cos();
                body.is_free(field, x, y, sin, cos)
            };
            let free = (0..headings).filter(is_free).fold(0u128, |free, index| free | 1 << index);
            if free == 0 {
                continue;
            }
            let first = pose(offset, 0);
            self.target = heading.map(|_| first).ok_or((first.x, first.y));
            let key = (self.goal, field.identity(), self.reach_margin, offset, free);
            if self.reach_for != Some(key) {
                self.reach_for = Some(key);
                self.reach.begin(field);
                for index in (0..headings).filter(|index| free >> index & 1 != 0) {
                    let Pose { x, y, theta } = pose(offset, index);
                    let (sin, cos) = theta.sin_cos();
                    self.reach.goal(field, x + body.ahead * cos, y + body.ahead * sin);
                }
            }
            return Ok(());
        }
        Err(SearchError::GoalBlocked)
    }

    /// Continues for about `work` units. The field must be the one of [`Search::begin`]; if its obstacles have changed,
    /// the path may touch them: begin again.
    pub fn advance(&mut self, field: &Field, work: u32) -> Status<'_> {
        let until = self.work.saturating_add(work);
        while self.work < until {
            match self.phase {
                Phase::Reach => self.reach_start(field),
                Phase::Search => self.expand(field),
                Phase::Smooth { last } => self.smooth(field, last),
                Phase::Idle | Phase::Found | Phase::NoPath(_) => break,
            }
        }
        self.status()
    }

    /// Progress of the search.
    #[must_use]
    pub fn status(&self) -> Status<'_> {
        match self.phase {
            Phase::Found => Status::Found(&self.path),
            Phase::NoPath(why) => Status::NoPath(why),
            _ if self.has_path => Status::Improving(&self.path),
            _ => Status::Searching,
        }
    }

    fn reach_start(&mut self, field: &Field) {
        let body = self.body;
        let Pose { x, y, theta } = self.start;
        let (sin, cos) = theta.sin_cos();
        self.depth = body.depth(field, x, y, sin, cos);
        if self.depth > body.depth_max() {
            return self.fail(field, SearchError::StartBlocked);
        }
        let mut pops = REACH_STEPS_MAX;
        let cost = self.reach.cost(field, &self.reach_toll, x + body.ahead * cos, y + body.ahead * sin, &mut pops);
        self.work += 1 + (REACH_STEPS_MAX - pops) / REACH_STEPS_PER_STATE;
        let known = pops > 0;
        if known && cost == f32::INFINITY && self.depth == 0.0 {
            if self.attempt == 0 {
                self.fail(field, SearchError::Unreachable);
            } else {
                // With no margin either.
                self.phase = Phase::NoPath(SearchError::Unreachable);
            }
        } else if known {
            self.begin_pass(field);
        } else if self.work > self.allowed() {
            self.fail(field, SearchError::Budget);
        }
    }

    fn begin_pass(&mut self, field: &Field) {
        let Pose { x, y, theta } = self.start;
        let (sin, cos) = theta.sin_cos();
        let touching = self.depth > 0.0;
        self.escaped |= !touching;
        self.open.clear();
        self.until_shot = 0;
        self.phase = Phase::Search;
        let Some((column, row)) = field.frame().cell(x, y) else {
            return self.fail(field, SearchError::StartBlocked);
        };
        let key = self.key(field, column, row, 0);
        let h = self.estimate(field, Sample { x, y, sin, cos }, 0);
        self.open
            .push(Node { x, y, g: 0.0, h, parent: NONE, key, heading: 0, step: u8::MAX, closed: false, touching }, h);
    }

    /// Key of the state in this pass.
    fn key(&self, field: &Field, column: usize, row: usize, heading: usize) -> u32 {
        let (_, coarse) = PASSES[self.pass];
        (field.frame().index(column / coarse, row / coarse) * HEADINGS + heading / coarse) as u32
    }

    /// Heuristic: estimated cost from a pose to the goal.
    fn estimate(&mut self, field: &Field, at: Sample, heading: usize) -> f32 {
        let mut pops = REACH_STEPS_MAX;
        let (x, y) = (at.x + self.body.ahead * at.cos, at.y + self.body.ahead * at.sin);
        let around = self.reach.cost(field, &self.reach_toll, x, y, &mut pops);
        self.work += (REACH_STEPS_MAX - pops) / REACH_STEPS_PER_STATE;
        let around = (around - self.goal.tolerance_m as f32).max(0.0);
        let radius = self.limits.radius_m;
        match self.target {
            Ok(target) if self.limits.abilities.turns => {
                let turn = libm::fabs(wrap(target.theta.radians() - self.lattice.angle(heading)));
                around.max((turn * self.limits.costs.turning(radius)) as f32 - self.goal.tolerance_m as f32)
            }
            Ok(target) if f64::from(around) < CAR_PATH_RADII * radius => {
                let pose = Pose::new(at.x, at.y, self.lattice.angle(heading));
                let car = reeds_shepp_length(pose, target, radius) - self.goal.tolerance_m;
                around.max(car as f32)
            }
            _ => around,
        }
    }

    /// Expands the most promising state.
    fn expand(&mut self, field: &Field) {
        self.work += 1;
        let (weight, _) = PASSES[self.pass];
        let exhausted = if self.escaped { SearchError::Unreachable } else { SearchError::StartBlocked };
        let Some((index, f)) = self.open.pop() else {
            return self.end_pass(field, exhausted);
        };
        // No remaining state can improve the result by more than the weight.
        if f >= self.raw_cost {
            return self.end_pass(field, exhausted);
        }
        if self.work > self.allowed() || self.open.len() >= self.limits.states_max as usize {
            return self.end_pass(field, SearchError::Budget);
        }
        self.expansions += 1;
        let node = self.open.node(index);
        let heading = usize::from(node.heading);
        let pose = Pose::new(node.x, node.y, self.lattice.angle(heading));
        if !node.touching && self.is_there(pose) && node.g < self.raw_cost {
            self.take(index, node.g);
        }
        if self.until_shot == 0 && !node.touching {
            self.until_shot = (node.h * 3.0) as u32;
            self.shoot(field, index, pose);
        }
        self.until_shot = self.until_shot.saturating_sub(1);
        if self.first == 0 && self.raw_cost.is_finite() {
            return self.end_pass(field, SearchError::Unreachable);
        }
        for step in 0..self.lattice.steps.len() {
            self.follow(field, index, &node, step, weight);
        }
    }

    /// Takes a step from a state and adds its end if it is free and improves on the known cost.
    fn follow(&mut self, field: &Field, parent: u32, node: &Node, step: usize, weight: f32) {
        let body = self.body;
        let heading = usize::from(node.heading);
        let taken = &self.lattice.steps[step];
        let samples = self.lattice.samples(heading, taken);
        let end = samples[samples.len() - 1];
        let (x, y) = (node.x + end.x, node.y + end.y);
        let Some((column, row)) = field.frame().cell(x, y) else { return };
        let after = Lattice::after(heading, taken);
        let key = self.key(field, column, row, after);
        let costs = &self.limits.costs;
        let mut changes = 0.0;
        if let Some(before) = self.lattice.steps.get(usize::from(node.step)) {
            let turned = (taken.steering - before.steering).unsigned_abs();
            changes += costs.steer * 0.25 * f64::from(turned);
            changes += costs.change(before.direction, taken.direction);
        }
        let toll = self.toll.at(body.middle(field, x, y, end.sin, end.cos));
        let g = node.g + taken.cost * toll + changes as f32;
        if g >= self.raw_cost || !self.open.improves(key, g) {
            return;
        }
        let mut touching = node.touching;
        let mut g = g;
        if touching {
            // Out of an obstacle: not deeper than half a cell, which turning away may take, but no contact begins; and
            // only for a limited length.
            let deepest = self.depth + 0.5 * field.frame().resolution;
            let deepest = if self.contact { deepest } else { deepest.min(self.depth.max(self.margin.grown)) };
            for at in samples {
                let depth = body.depth(field, node.x + at.x, node.y + at.y, at.sin, at.cos);
                if depth > if touching { deepest } else { 0.0 } {
                    return;
                }
                touching = depth > 0.0;
            }
            g += 2.0 * taken.cost;
            if touching && g > ESCAPE_MAX_M * 3.0 * (1.0 + costs.near as f32) {
                return;
            }
            let from = Pose::new(node.x, node.y, self.lattice.angle(heading));
            if !self.contact && self.outline.drive(field, from, &[taken.part]).is_err() {
                return;
            }
        } else if !body.is_free_along(field, (node.x, node.y), samples, taken.way) {
            return;
        }
        self.escaped |= !touching;
        let h = self.estimate(field, Sample { x, y, sin: end.sin, cos: end.cos }, after);
        if g + h >= self.raw_cost || h == f32::INFINITY {
            return;
        }
        let node = Node { x, y, g, h, parent, key, heading: after as u8, step: step as u8, closed: false, touching };
        self.open.push(node, g + weight * h);
    }

    /// True if a pose satisfies the goal.
    fn is_there(&self, pose: Pose) -> bool {
        let Goal { x, y, heading, tolerance_m } = self.goal;
        let turned = heading.map_or(0.0, |heading| libm::fabs(navitools::wrap(heading - pose.theta.radians())));
        tolerance_m > 0.0 && libm::hypot(x - pose.x, y - pose.y) <= tolerance_m && turned <= 5f64.to_radians()
    }

    /// Attempts to end with a curve to the goal.
    fn shoot(&mut self, field: &Field, index: u32, pose: Pose) {
        let node = self.open.node(index);
        let before = self.lattice.steps.get(usize::from(node.step)).map(|step| step.part);
        let (limits, deviation) = (&self.limits, self.margin.deviation);
        let ruler = Ruler { field, body: &self.body, toll: &self.toll, limits, deviation };
        self.work += 2;
        if let Some((cost, parts)) = self.shot.best(&ruler, pose, before, self.target, self.raw_cost - node.g) {
            self.raw_cost = node.g + cost;
            self.open.trace(index, &self.lattice, &mut self.raw);
            parts.iter().for_each(|part| append(&mut self.raw, *part));
        }
    }

    /// Records a path that ends with this state.
    fn take(&mut self, index: u32, cost: f32) {
        self.raw_cost = cost;
        self.open.trace(index, &self.lattice, &mut self.raw);
    }

    /// Total work allowed.
    fn allowed(&self) -> u32 {
        let Budget { first, better } = self.budget;
        match self.first {
            0 if self.attempt == 0 => first,
            0 => self.before.saturating_add(first / 2),
            found => found.saturating_add(better.min((found - self.before).max(better / 10))),
        }
    }

    fn end_pass(&mut self, field: &Field, why: SearchError) {
        let found = self.raw_cost.is_finite();
        if found && self.first == 0 {
            self.first = self.work;
        }
        self.pass += 1;
        if !found {
            // A path missed by the coarse pass, or by steps that have no room, may still exist.
            let coarse = PASSES[self.pass - 1].1 > 1;
            let finer = !self.short && Lattice::has_short(&self.limits, field.frame().resolution);
            if why == SearchError::Budget || !coarse && !finer {
                return self.fail(field, why);
            }
            if !coarse {
                (self.short, self.pass) = (true, self.pass - 1);
                self.make_steps(field);
            }
            return self.begin_pass(field);
        }
        let last = self.pass >= PASSES.len() || self.work > self.allowed();
        self.smoothing.begin(self.start, &self.raw);
        self.phase = Phase::Smooth { last };
    }

    fn smooth(&mut self, field: &Field, last: bool) {
        let (limits, deviation) = (&self.limits, self.margin.deviation);
        let ruler = Ruler { field, body: &self.body, toll: &self.toll, limits, deviation };
        self.work += smooth::WORK;
        if self.smoothing.step(&ruler) {
            return;
        }
        let cost = self.smoothing.cost(&ruler).unwrap_or(self.raw_cost);
        if !self.has_path || cost < self.path.cost {
            self.accept(field, cost);
        }
        if !self.has_path {
            self.raw_cost = f32::INFINITY;
            return self.fail(field, SearchError::Budget);
        }
        if last {
            self.phase = Phase::Found;
        } else {
            self.begin_pass(field);
        }
    }

    /// Takes the smoothed path, or the one before smoothing, as the result, if the exact check finds it free.
    fn accept(&mut self, field: &Field, cost: f32) {
        for (moves, cost) in [(self.smoothing.moves(), cost), (&self.raw, self.raw_cost)] {
            let driven = self.outline.drive(field, self.start, moves);
            let Ok((clearance, looks)) = driven else { continue };
            self.work += looks / LOOKS_PER_STATE;
            self.has_path = true;
            self.path.moves.clone_from(moves);
            self.path.lay(self.start, 0.05);
            (self.path.cost, self.path.clearance, self.path.margin) = (cost, clearance, self.margin.margin);
            return;
        }
    }
}

/// Appends a part to a path, merged with the last one if it continues it.
fn append(moves: &mut Vec<Move>, part: Move) {
    match moves.last_mut() {
        Some(last)
            if libm::fabs(last.curvature() - part.curvature()) < 1e-12 && last.direction() == part.direction() =>
        {
            *last = last.with(last.size() + part.size());
        }
        _ if part.extent() < 1e-9 => {}
        _ => moves.push(part),
    }
}

/// Offsets from the goal within the tolerance, from the inside out; at most 8 per ring.
fn offsets(tolerance: f64, resolution: f64) -> impl Iterator<Item = (f64, f64)> {
    let rings = libm::ceil(tolerance / resolution).clamp(0.0, 8.0);
    let ring = move |ring: u32| {
        let radius = tolerance * f64::from(ring) / rings;
        (0..16u32).map(move |index| {
            let (sin, cos) = libm::sincos(f64::from(index) * core::f64::consts::PI / 8.0);
            (radius * cos, radius * sin)
        })
    };
    core::iter::once((0.0, 0.0)).chain((1..=rings as u32).flat_map(ring))
}

#[cfg(test)]
mod tests;
