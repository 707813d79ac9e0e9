//! Motion primitives: steps of the robot and their costs.

use super::request::{Costs, Limits};
use crate::path::Move;
use kinematics::Direction;
use navitools::{Arc, Pose};

/// Number of headings: 5° apart.
pub(crate) const HEADINGS: usize = 72;
const STEP: f64 = 2.0 * core::f64::consts::PI / HEADINGS as f64;

/// Turn of a step on the spot, in headings: as many as form one state in the coarse pass, so that it leaves its state.
const SPOT_HEADINGS: i32 = 2;

/// Maximum number of samples of a step, for a robot of odd dimensions: the whole path is checked once more.
const SAMPLES_MAX: f64 = 500.0;

/// Cost factor for proximity to obstacles.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ProximityCost {
    /// Distance of the middle from obstacles at which the footprint touches one, m.
    pub(crate) inner: f32,
    keep: f32,
    weight: f32,
}

impl ProximityCost {
    pub(crate) fn new(inner: f32, costs: &Costs) -> Self {
        Self { inner, keep: costs.keep_m as f32, weight: costs.near as f32 }
    }

    /// Factor at a distance of the middle from obstacles.
    pub(crate) fn at(&self, distance: f32) -> f32 {
        let left = self.keep - (distance - self.inner).max(0.0);
        if left <= 0.0 {
            return 1.0;
        }
        let part = left / self.keep;
        1.0 + self.weight * part * part
    }
}

/// Pose on a step relative to its beginning, already turned to the robot's heading.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) sin: f64,
    pub(crate) cos: f64,
}

impl Sample {
    /// The sample turned about the beginning of the step by an angle.
    pub(crate) fn turned(&self, sin: f64, cos: f64) -> Self {
        Self {
            x: cos * self.x - sin * self.y,
            y: sin * self.x + cos * self.y,
            sin: sin * self.cos + cos * self.sin,
            cos: cos * self.cos - sin * self.sin,
        }
    }
}

/// Step from any heading.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    pub(crate) part: Move,
    /// Change of the heading, in headings.
    pub(crate) turn: i32,
    /// Curvature in halves of the limit, -2 to 2.
    pub(crate) steering: i8,
    pub(crate) direction: Direction,
    /// Cost without proximity and changes, m.
    pub(crate) cost: f32,
    /// Way of the fastest corner from one sample to the next, m.
    pub(crate) way: f32,
    /// Index of its first sample in a heading's list, and number of samples.
    first: usize,
    count: usize,
}

/// Steps from all headings.
#[derive(Debug, Default)]
pub(crate) struct Lattice {
    pub(crate) steps: Vec<Step>,
    /// Poses for heading 0 along the x axis, then turned to the headings of a search.
    local: Vec<Sample>,
    samples: Vec<Sample>,
    heading: Option<f64>,
}

impl Lattice {
    /// Makes steps of about three cells, or `short` ones, which just leave their cell, with curvatures of zero, half and
    /// the whole limit, and those of a base that turns on the spot or goes sideways. `looks` has the distance between
    /// the samples of a motion, m or rad, and the way of the fastest corner for each metre or rad.
    pub(crate) fn build(&mut self, limits: &Limits, resolution: f64, short: bool, looks: impl Fn(Move) -> (f64, f64)) {
        let radius = limits.radius_m;
        self.steps.clear();
        self.local.clear();
        self.heading = None;
        let bins = Self::bins(radius, resolution, short);
        let length = f64::from(bins) * radius * STEP;
        for reverse in [false, true] {
            for steering in [0i8, 1, -1, 2, -2] {
                let (turn, length) = match steering {
                    0 => (0, length),
                    1 | -1 => ((bins / 2).max(1), f64::from((bins / 2).max(1)) * 2.0 * radius * STEP),
                    _ => (bins, length),
                };
                let sign = if reverse { -1.0 } else { 1.0 };
                let arc = Arc { curvature: f64::from(steering) / (2.0 * radius), length: sign * length };
                let turn = turn * i32::from(steering.signum()) * if reverse { -1 } else { 1 };
                self.add(Move::Arc(arc), turn, steering, limits, &looks);
            }
        }
        for side in [1, -1] {
            if limits.abilities.turns {
                let turn = side * SPOT_HEADINGS;
                self.add(Move::Turn(f64::from(turn) * STEP), turn, 0, limits, &looks);
            }
            if limits.abilities.sideways {
                self.add(Move::Aside(f64::from(side) * length), 0, 0, limits, &looks);
            }
        }
    }

    /// Turn of a step at the least radius, in headings: it leaves its cell in any direction.
    fn bins(radius: f64, resolution: f64, short: bool) -> i32 {
        let cells = resolution / (radius * STEP);
        let least = |cells: f64| (libm::ceil(cells) as i32).max(1);
        if short {
            least(core::f64::consts::SQRT_2 * cells)
        } else {
            (libm::round(3.0 * cells) as i32).max(least(1.5 * cells))
        }
    }

    /// True if short steps are shorter than the usual ones.
    pub(crate) fn has_short(limits: &Limits, resolution: f64) -> bool {
        let bins = |short| Self::bins(limits.radius_m, resolution, short);
        bins(true) < bins(false)
    }

    fn add(&mut self, part: Move, turn: i32, steering: i8, limits: &Limits, looks: impl Fn(Move) -> (f64, f64)) {
        let (spacing, way) = looks(part);
        let length = part.extent();
        let count = libm::ceil(length / spacing).min(SAMPLES_MAX) as usize;
        let first = self.local.len();
        for sample in 1..=count {
            let Pose { x, y, theta } = part.with(part.size() * sample as f64 / count as f64).from(Pose::default());
            let (sin, cos) = theta.sin_cos();
            self.local.push(Sample { x, y, sin, cos });
        }
        let cost = (length * limits.costs.of(part, limits.radius_m)) as f32;
        let way = (length / count as f64 * way) as f32;
        self.steps.push(Step { part, turn, steering, direction: part.direction(), cost, way, first, count });
    }

    /// Turns the steps to headings that begin with `heading`.
    pub(crate) fn turn_to(&mut self, heading: f64) {
        if self.heading == Some(heading) {
            return;
        }
        self.heading = Some(heading);
        self.samples.clear();
        for index in 0..HEADINGS {
            let (sin, cos) = libm::sincos(heading + index as f64 * STEP);
            self.samples.extend(self.local.iter().map(|sample| sample.turned(sin, cos)));
        }
    }

    /// Poses on a step from a heading; the last one is its end.
    pub(crate) fn samples(&self, heading: usize, step: &Step) -> &[Sample] {
        &self.samples[heading * self.local.len() + step.first..][..step.count]
    }

    /// Heading after a step.
    pub(crate) fn after(heading: usize, step: &Step) -> usize {
        (heading as i32 + step.turn).rem_euclid(HEADINGS as i32) as usize
    }

    /// Angle of a heading.
    pub(crate) fn angle(&self, heading: usize) -> f64 {
        self.heading.unwrap_or(0.0) + heading as f64 * STEP
    }
}
