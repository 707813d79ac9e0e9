//! Hybrid A*: a drivable way for the footprint of an Ackermann robot, forwards and in reverse.
//!
//! D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel, Practical search techniques in path planning for autonomous driving
//! (2008). States are cells of the map and 72 headings, each with the exact pose of the way that reached it; steps are
//! arcs of nought, half and the whole curvature limit. Two estimates of the cost to go are combined: a way for a round
//! robot around all obstacles ([`reach`]) and, near the goal, the way of a car without obstacles (Reeds and Shepp), which
//! also ends the search where it is free. Then parts of the way are replaced by better curves ([`smooth`]).
//!
//! An engine: it owns no clock. [`Search::begin`], then [`Search::advance`] as often as one likes; the budget is work, an
//! expanded state or what takes as long (a few microseconds), so that the same request has the same answer on every
//! machine. The first way found may be driven while the search looks for a better one. Buffers are kept: from the second
//! search of a kind on nothing is allocated.

mod footprint;
mod lattice;
mod open;
mod reach;
mod shot;
mod smooth;

pub use footprint::Footprint;

use crate::map::Field;
use crate::path::Path;
use footprint::Body;
use lattice::{HEADINGS, Lattice, Toll};
use navitools::{Arc, Pose, reeds_shepp_length};
use open::{NONE, Node, Open};
use reach::Reach;
use shot::Shot;
use smooth::Smoothing;
use std::fmt;

/// What the robot is, and what it prefers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Its rectangle.
    pub footprint: Footprint,
    /// Kept free around it on all sides, m; not below 0.
    pub margin_m: f64,
    /// The least turning radius of the rear axle's middle, m; above zero.
    pub radius_m: f64,
    /// Preferences.
    pub costs: Costs,
    /// States that one search may hold; 48 bytes each.
    pub states_max: u32,
}

impl Limits {
    /// Limits of a robot with this footprint and turning radius; all else as usual.
    #[must_use]
    pub fn new(footprint: Footprint, radius_m: f64) -> Self {
        Self { footprint, margin_m: 0.02, radius_m, costs: Costs::default(), states_max: 400_000 }
    }
}

/// Preferences, in metres of free straight road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Costs {
    /// What a metre in reverse costs more.
    pub reverse: f64,
    /// What a metre at the least radius costs more.
    pub turn: f64,
    /// A change between forwards and reverse.
    pub cusp: f64,
    /// From the least radius on one side to that on the other.
    pub steer: f64,
    /// What a metre with no clearance costs more.
    pub near: f64,
    /// More clearance than this is worth nothing, m.
    pub keep_m: f64,
}

impl Default for Costs {
    fn default() -> Self {
        Self { reverse: 0.7, turn: 0.1, cusp: 0.7, steer: 0.1, near: 1.5, keep_m: 0.35 }
    }
}

impl Costs {
    /// What a metre along an arc costs.
    fn way(&self, arc: &Arc, radius: f64) -> f64 {
        let reverse = if arc.length < 0.0 { self.reverse } else { 0.0 };
        1.0 + reverse + self.turn * libm::fabs(arc.curvature) * radius
    }
}

/// Where to go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// rad; `None`: any.
    pub heading: Option<f64>,
    /// Nearer than this is there, m; the heading is then good to 5°. With 0 the way ends exactly at the goal.
    pub tolerance_m: f64,
}

/// How much work a search may do; a unit is a state expanded, or what takes as long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Until a first way is found.
    pub first: u32,
    /// After that, for a better one; not more than it took to find the first one, or a tenth of this.
    pub better: u32,
}

impl Default for Budget {
    fn default() -> Self {
        Self { first: 200_000, better: 20_000 }
    }
}

/// Why there is no way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoWay {
    /// The robot does not fit in at the goal.
    GoalBlocked,
    /// The robot stands in something, or outside of the map, and does not get out.
    StartBlocked,
    /// Everything within reach was tried.
    Unreachable,
    /// The work allowed was done first.
    Budget,
    /// A coordinate is no number, or a limit makes no sense.
    Invalid,
}

impl fmt::Display for NoWay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::GoalBlocked => "the robot does not fit in at the goal",
            Self::StartBlocked => "the robot stands in an obstacle or outside of the map",
            Self::Unreachable => "no way leads to the goal",
            Self::Budget => "no way was found with the work allowed",
            Self::Invalid => "a coordinate is no number",
        })
    }
}

impl std::error::Error for NoWay {}

/// How far a search has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Status<'a> {
    /// No way yet.
    Searching,
    /// A way that can be driven; a better one is looked for.
    Improving(&'a Path),
    /// The best way found. Further calls do nothing.
    Found(&'a Path),
    /// None. Further calls do nothing.
    NoWay(NoWay),
}

/// How greedy the search is, pass after pass: the weight of the estimate.
const WEIGHTS: [f32; 3] = [2.0, 1.3, 1.0];
/// Steps of [`Reach`] that take as long as a state.
const POPS: u32 = 16;
/// A state may send [`Reach`] so far.
const POPS_MAX: u32 = 400;
/// Nearer than so many radii the way of a car is asked for too.
const NEAR_RADII: f64 = 4.0;
/// In an obstacle the robot may drive so far to get out, m.
const ESCAPE_M: f32 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Idle,
    /// The estimate goes from the goal to the start.
    Reach,
    Search,
    /// `last`: the search is over.
    Smooth { last: bool },
    Found,
    NoWay(NoWay),
}

/// A search, with its buffers.
#[derive(Debug)]
pub struct Search {
    limits: Limits,
    phase: Phase,
    start: Pose,
    goal: Goal,
    /// Where exactly to end: a pose, or a point with any heading.
    target: Result<Pose, (f64, f64)>,
    budget: Budget,
    /// Work done, and how much of it before the first way.
    work: u32,
    first: u32,
    expansions: u32,
    pass: usize,
    /// Expansions until the next try to end with a curve.
    until_shot: u32,
    escaped: bool,
    /// What the buffers are for: resolution, goal, field's generation.
    lattice_for: f64,
    reach_for: Option<(Goal, u32, usize, usize)>,
    body: Option<Body>,
    toll: Toll,
    lattice: Lattice,
    reach: Reach,
    open: Open,
    shot: Shot,
    smoothing: Smoothing,
    /// The best way of the search, and the best one smoothed.
    raw: Vec<Arc>,
    raw_cost: f32,
    path: Path,
    has_path: bool,
}

impl Search {
    /// A search for a robot. The limits' numbers are finite and above zero where they say so, else every search ends with
    /// [`NoWay::Invalid`].
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            phase: Phase::Idle,
            start: Pose::default(),
            goal: Goal { x: 0.0, y: 0.0, heading: None, tolerance_m: 0.0 },
            target: Err((0.0, 0.0)),
            budget: Budget::default(),
            work: 0,
            first: 0,
            expansions: 0,
            pass: 0,
            until_shot: 0,
            escaped: false,
            lattice_for: 0.0,
            reach_for: None,
            body: None,
            toll: Toll::default(),
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

    /// The limits it was made with.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Work done since [`Search::begin`].
    #[must_use]
    pub fn work(&self) -> u32 {
        self.work
    }

    /// States expanded since [`Search::begin`].
    #[must_use]
    pub fn expansions(&self) -> u32 {
        self.expansions
    }

    /// Plans in one go.
    ///
    /// # Errors
    /// There is no way, and why.
    pub fn plan(&mut self, field: &Field, start: Pose, goal: Goal, budget: Budget) -> Result<&Path, NoWay> {
        self.begin(field, start, goal, budget);
        while matches!(self.phase, Phase::Reach | Phase::Search | Phase::Smooth { .. }) {
            self.advance(field, u32::MAX);
        }
        match self.phase {
            Phase::NoWay(why) => Err(why),
            _ => Ok(&self.path),
        }
    }

    /// Begins a search; the last one's path is gone. What is learnt of the goal stays while goal and field do.
    pub fn begin(&mut self, field: &Field, start: Pose, goal: Goal, budget: Budget) {
        self.start = start;
        self.goal = goal;
        self.budget = budget;
        (self.work, self.first, self.expansions, self.pass) = (0, 0, 0, 0);
        (self.raw_cost, self.has_path, self.escaped) = (f32::INFINITY, false, false);
        self.raw.clear();
        self.phase = match self.prepare(field) {
            Ok(()) => Phase::Reach,
            Err(why) => Phase::NoWay(why),
        };
    }

    fn prepare(&mut self, field: &Field) -> Result<(), NoWay> {
        let Limits { footprint, margin_m, radius_m, costs, .. } = self.limits;
        let Footprint { length_m, width_m, rear_m } = footprint;
        let sizes = [length_m, width_m, radius_m, costs.keep_m];
        let parts = [margin_m, rear_m, self.goal.tolerance_m, costs.reverse, costs.turn, costs.cusp, costs.steer, costs.near];
        let Pose { x, y, theta } = self.start;
        let places = [x, y, theta.radians(), self.goal.x, self.goal.y, self.goal.heading.unwrap_or(0.0)];
        let sensible = sizes.iter().all(|size| (1e-3..=1e3).contains(size))
            && parts.iter().all(|part| (0.0..=1e3).contains(part))
            && places.iter().all(|place| place.is_finite());
        if !sensible {
            return Err(NoWay::Invalid);
        }
        let body = Body::new(footprint.grown(margin_m), field);
        let resolution = field.frame().resolution;
        if self.lattice_for != resolution {
            self.lattice_for = resolution;
            self.lattice = Lattice::new(radius_m, resolution, Self::spacing(field), &costs);
            self.reach_for = None;
        }
        self.lattice.turn_to(theta.radians());
        self.toll = Toll::new(body.inner, &costs);
        self.body = Some(body);
        self.find_target(field, &body)
    }

    /// Poses of a step or a curve are checked so far apart, m.
    fn spacing(field: &Field) -> f64 {
        (1.5 * field.frame().resolution).min(0.1)
    }

    /// Where to end, and from where the estimate begins.
    fn find_target(&mut self, field: &Field, body: &Body) -> Result<(), NoWay> {
        let key = (self.goal, field.generation(), field.frame().width, field.frame().height);
        let known = self.reach_for == Some(key);
        self.reach_for = Some(key);
        if !known {
            self.reach.begin(field);
        } else {
            return Ok(());
        }
        let Goal { x, y, heading, tolerance_m } = self.goal;
        let mut any = false;
        for (dx, dy) in offsets(tolerance_m, field.frame().resolution) {
            let headings = if heading.is_some() { 1 } else { HEADINGS };
            for index in 0..headings {
                let turn = index as f64 * (2.0 * core::f64::consts::PI / HEADINGS as f64);
                let pose = Pose::new(x + dx, y + dy, heading.unwrap_or(0.0) + turn);
                let (sin, cos) = pose.theta.sin_cos();
                if body.is_free(field, pose.x, pose.y, sin, cos) {
                    any = true;
                    self.reach.goal(field, pose.x + body.ahead * cos, pose.y + body.ahead * sin);
                    self.target = heading.map(|_| pose).ok_or((pose.x, pose.y));
                }
            }
            if any {
                return Ok(());
            }
        }
        self.reach_for = None;
        Err(NoWay::GoalBlocked)
    }

    /// Works on for about `work` units. The field is the one of [`Search::begin`]; if its obstacles have changed the
    /// path may touch them: begin again.
    pub fn advance(&mut self, field: &Field, work: u32) -> Status<'_> {
        let until = self.work.saturating_add(work);
        while self.work < until {
            match self.phase {
                Phase::Reach => self.reach_start(field),
                Phase::Search => self.expand(field),
                Phase::Smooth { last } => self.smooth(field, last),
                Phase::Idle | Phase::Found | Phase::NoWay(_) => break,
            }
        }
        self.status()
    }

    /// How far it has come.
    #[must_use]
    pub fn status(&self) -> Status<'_> {
        match self.phase {
            Phase::Found => Status::Found(&self.path),
            Phase::NoWay(why) => Status::NoWay(why),
            _ if self.has_path => Status::Improving(&self.path),
            _ => Status::Searching,
        }
    }

    fn reach_start(&mut self, field: &Field) {
        let Some(body) = self.body else { return };
        let Pose { x, y, theta } = self.start;
        let (sin, cos) = theta.sin_cos();
        let overlap = body.overlap(field, x, y, sin, cos);
        if overlap == u32::MAX {
            self.phase = Phase::NoWay(NoWay::StartBlocked);
            return;
        }
        let mut pops = POPS_MAX;
        let cost =
            self.reach.cost(field, &self.toll, x + body.ahead * cos, y + body.ahead * sin, &mut pops);
        self.work += 1 + (POPS_MAX - pops) / POPS;
        let known = pops > 0;
        if known && cost == f32::INFINITY && overlap == 0 {
            self.phase = Phase::NoWay(NoWay::Unreachable);
        } else if known {
            self.begin_pass(field);
        } else if self.work > self.budget.first {
            self.phase = Phase::NoWay(NoWay::Budget);
        }
    }

    fn begin_pass(&mut self, field: &Field) {
        let Some(body) = self.body else { return };
        let Pose { x, y, theta } = self.start;
        let (sin, cos) = theta.sin_cos();
        let overlap = body.overlap(field, x, y, sin, cos).min(u32::from(u16::MAX)) as u16;
        self.escaped |= overlap == 0;
        self.open.clear();
        self.until_shot = 0;
        self.phase = Phase::Search;
        let Some((column, row)) = field.frame().cell(x, y) else {
            self.phase = Phase::NoWay(NoWay::StartBlocked);
            return;
        };
        let key = (field.frame().index(column, row) * HEADINGS) as u32;
        let h = self.estimate(field, &body, x, y, 0, sin, cos);
        self.open.push(Node { x, y, g: 0.0, h, parent: NONE, key, step: u8::MAX, closed: false, overlap }, h);
    }

    /// The cost to go from a pose.
    fn estimate(&mut self, field: &Field, body: &Body, x: f64, y: f64, heading: usize, sin: f64, cos: f64) -> f32 {
        let mut pops = POPS_MAX;
        let (ahead_x, ahead_y) = (x + body.ahead * cos, y + body.ahead * sin);
        let around = self.reach.cost(field, &self.toll, ahead_x, ahead_y, &mut pops);
        self.work += (POPS_MAX - pops) / POPS;
        let around = (around - self.goal.tolerance_m as f32).max(0.0);
        let radius = self.limits.radius_m;
        match self.target {
            Ok(target) if f64::from(around) < NEAR_RADII * radius => {
                let pose = Pose::new(x, y, self.lattice.angle(heading));
                let car = reeds_shepp_length(pose, target, radius) - self.goal.tolerance_m;
                around.max(car as f32)
            }
            _ => around,
        }
    }

    /// Expands the most promising state.
    fn expand(&mut self, field: &Field) {
        let Some(body) = self.body else { return };
        self.work += 1;
        let weight = WEIGHTS[self.pass];
        let Some((index, f)) = self.open.pop() else {
            let why = if self.escaped { NoWay::Unreachable } else { NoWay::StartBlocked };
            return self.end_pass(why);
        };
        // Nothing that is left is better by more than the weight.
        if f >= self.raw_cost {
            return self.end_pass(NoWay::Unreachable);
        }
        if self.work > self.allowed() || self.open.len() >= self.limits.states_max as usize {
            return self.end_pass(NoWay::Budget);
        }
        self.expansions += 1;
        let node = self.open.node(index);
        let heading = node.key as usize % HEADINGS;
        let pose = Pose::new(node.x, node.y, self.lattice.angle(heading));
        if node.overlap == 0 && self.is_there(pose) && node.g < self.raw_cost {
            self.take(index, &[], node.g);
        }
        if self.until_shot == 0 && node.overlap == 0 {
            self.until_shot = (node.h * 3.0) as u32;
            self.shoot(field, &body, index, pose);
        }
        self.until_shot = self.until_shot.saturating_sub(1);
        if self.pass == 0 && self.raw_cost.is_finite() {
            return self.end_pass(NoWay::Unreachable);
        }
        for step in 0..self.lattice.steps.len() {
            self.follow(field, &body, index, &node, heading, step, weight);
        }
    }

    #[expect(clippy::too_many_arguments, reason = "one step of the inner loop, cut out of it")]
    fn follow(&mut self, field: &Field, body: &Body, parent: u32, node: &Node, heading: usize, step: usize, weight: f32) {
        let taken = &self.lattice.steps[step];
        let samples = self.lattice.samples(heading, taken);
        let end = samples[samples.len() - 1];
        let (x, y) = (node.x + end.x, node.y + end.y);
        let frame = field.frame();
        let Some((column, row)) = frame.cell(x, y) else { return };
        let after = Lattice::after(heading, taken);
        let key = (frame.index(column, row) * HEADINGS + after) as u32;
        let costs = &self.limits.costs;
        let mut changes = 0.0;
        if let Some(before) = self.lattice.steps.get(usize::from(node.step)) {
            let turned = (taken.steering - before.steering).unsigned_abs();
            changes += costs.steer * 0.25 * f64::from(turned);
            if before.reverse != taken.reverse {
                changes += costs.cusp;
            }
        }
        let toll = self.toll.at(body.middle(field, x, y, end.sin, end.cos));
        let g = node.g + taken.cost * toll + changes as f32;
        if g >= self.raw_cost || !self.open.improves(key, g) {
            return;
        }
        let overlap = if node.overlap == 0 {
            let free = |at: &lattice::Sample| body.is_free(field, node.x + at.x, node.y + at.y, at.sin, at.cos);
            // The end first: where it is not free, nothing in between matters.
            if !samples.iter().rev().all(free) {
                return;
            }
            0
        } else {
            // Out of an obstacle: on no pose deeper in than before, and not for long.
            let mut last = u32::from(node.overlap);
            for at in samples {
                let overlap = body.overlap(field, node.x + at.x, node.y + at.y, at.sin, at.cos);
                if overlap > last {
                    return;
                }
                last = overlap;
            }
            if last > 0 && g > ESCAPE_M * (1.0 + costs.near as f32) {
                return;
            }
            last as u16
        };
        self.escaped |= overlap == 0;
        let h = self.estimate(field, body, x, y, after, end.sin, end.cos);
        if g + h >= self.raw_cost || h == f32::INFINITY {
            return;
        }
        let node = Node { x, y, g, h, parent, key, step: step as u8, closed: false, overlap };
        self.open.push(node, g + weight * h);
    }

    /// True if a pose is as good as the goal.
    fn is_there(&self, pose: Pose) -> bool {
        let Goal { x, y, heading, tolerance_m } = self.goal;
        let turned = heading.map_or(0.0, |heading| libm::fabs(navitools::wrap(heading - pose.theta.radians())));
        tolerance_m > 0.0 && libm::hypot(x - pose.x, y - pose.y) <= tolerance_m && turned <= 5f64.to_radians()
    }

    /// Tries to end with a curve to the goal.
    fn shoot(&mut self, field: &Field, body: &Body, index: u32, pose: Pose) {
        let node = self.open.node(index);
        let before = self.lattice.steps.get(usize::from(node.step)).map(|step| step.arc);
        let ruler = Ruler { field, body, toll: &self.toll, limits: &self.limits };
        self.work += 2;
        if let Some((cost, arcs)) = self.shot.best(&ruler, pose, before, self.target, self.raw_cost - node.g) {
            self.raw_cost = node.g + cost;
            self.open.trace(index, &self.lattice, &mut self.raw);
            arcs.iter().for_each(|arc| append(&mut self.raw, *arc));
        }
    }

    /// A way is found that ends with a state.
    fn take(&mut self, index: u32, arcs: &[Arc], cost: f32) {
        self.raw_cost = cost;
        self.open.trace(index, &self.lattice, &mut self.raw);
        arcs.iter().for_each(|arc| append(&mut self.raw, *arc));
    }

    /// The work allowed in all.
    fn allowed(&self) -> u32 {
        match self.first {
            0 => self.budget.first,
            first => first.saturating_add(self.budget.better.min(first.max(self.budget.better / 10))),
        }
    }

    fn end_pass(&mut self, why: NoWay) {
        if self.raw_cost == f32::INFINITY {
            self.phase = Phase::NoWay(why);
            return;
        }
        if self.first == 0 {
            self.first = self.work;
        }
        self.pass += 1;
        let last = self.pass >= WEIGHTS.len() || self.work > self.allowed();
        self.smoothing.begin(self.start, &self.raw);
        self.phase = Phase::Smooth { last };
    }

    fn smooth(&mut self, field: &Field, last: bool) {
        let Some(body) = self.body else { return };
        let ruler = Ruler { field, body: &body, toll: &self.toll, limits: &self.limits };
        self.work += smooth::WORK;
        if self.smoothing.step(&ruler) {
            return;
        }
        let cost = self.smoothing.cost(&ruler).unwrap_or(self.raw_cost);
        if !self.has_path || cost < self.path.cost {
            self.has_path = true;
            self.path.cost = cost;
            self.path.arcs.clone_from(self.smoothing.arcs());
            self.path.lay(self.start, 0.05);
            let footprint = self.limits.footprint;
            let each = self.path.points.iter().step_by(2).chain(self.path.points.last());
            self.path.clearance = each.fold(1.0, |least, point| least.min(footprint.clearance(field, point.pose, least)));
        }
        if last {
            self.phase = Phase::Found;
        } else {
            self.begin_pass(field);
        }
    }
}

/// What measures a curve: is it free, and what does it cost?
struct Ruler<'a> {
    field: &'a Field,
    body: &'a Body,
    toll: &'a Toll,
    limits: &'a Limits,
}

impl Ruler<'_> {
    /// The cost of arcs from a pose, after an arc that leads there; `None` if they touch something, or cost `most`.
    fn cost(&self, start: Pose, before: Option<Arc>, arcs: &[Arc], most: f32) -> Option<f32> {
        let Limits { radius_m, costs, .. } = self.limits;
        let spacing = Search::spacing(self.field);
        let (mut pose, mut before, mut cost) = (start, before, 0.0);
        for arc in arcs {
            if let Some(before) = before {
                cost += self.change(&before, arc);
            }
            let length = libm::fabs(arc.length);
            let count = libm::ceil(length / spacing).max(1.0);
            let each = (length / count * costs.way(arc, *radius_m)) as f32;
            let part = Arc { length: arc.length / count, ..*arc }.motion();
            // The pose of each part follows from the last one: rounding stays far below the margin.
            for _ in 0..count as u32 {
                pose = pose.along(part);
                let (sin, cos) = pose.theta.sin_cos();
                if cost >= most || !self.body.is_free(self.field, pose.x, pose.y, sin, cos) {
                    return None;
                }
                cost += each * self.toll.at(self.body.middle(self.field, pose.x, pose.y, sin, cos));
            }
            before = Some(*arc);
        }
        (cost < most).then_some(cost)
    }

    /// The cost of going from one arc to another.
    fn change(&self, before: &Arc, after: &Arc) -> f32 {
        let Limits { radius_m, costs, .. } = self.limits;
        let turned = libm::fabs(after.curvature - before.curvature) * radius_m / 2.0;
        let cusp = if (before.length < 0.0) != (after.length < 0.0) { costs.cusp } else { 0.0 };
        (costs.steer * turned + cusp) as f32
    }
}

/// Adds an arc to a way; what goes on as before is one arc.
fn append(arcs: &mut Vec<Arc>, arc: Arc) {
    match arcs.last_mut() {
        Some(last)
            if libm::fabs(last.curvature - arc.curvature) < 1e-12 && (last.length < 0.0) == (arc.length < 0.0) =>
        {
            last.length += arc.length;
        }
        _ if arc.length == 0.0 => {}
        _ => arcs.push(arc),
    }
}

/// Places about the goal within the tolerance, from the inside out; at most 8 around.
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
