//! The robot in its world, as the boards' sensors and drives meet it: a body that steps, and where it was a moment ago.

use crate::body::{Body, Demand, Parameters, STEP};
use crate::random::Random;
use crate::sonar::{Cone, Sonar, floor_distance};
use crate::world::World;
use base::Instant;
use navitools::{Point, Pose};
use std::collections::VecDeque;

/// Poses that are remembered: as many steps as the beacon scanner's answer can be old (a sweep of 1 s), and some.
const MEMORY: usize = 256;
/// The floor rangers hang this high, m.
pub const RANGER_HEIGHT: f64 = 0.12;

/// Body, world and chance.
#[derive(Clone, Debug)]
pub struct Scene {
    world: World,
    body: Body,
    cone: Cone,
    seed: u64,
    /// What the drives want from the next step on.
    pub demand: Demand,
    start: Instant,
    steps: u64,
    /// From which step on the body was where.
    past: VecDeque<(u64, Pose)>,
}

impl Scene {
    /// The body at the world's start; time counts from `start`.
    #[must_use]
    pub fn new(start: Instant, world: World, parameters: Parameters, sonar: Sonar, seed: u64) -> Self {
        let body = Body::new(parameters, world.start);
        let mut past = VecDeque::with_capacity(MEMORY);
        past.push_back((0, body.pose()));
        Self { world, body, cone: Cone::new(sonar), seed, demand: Demand::default(), start, steps: 0, past }
    }

    /// The body.
    #[must_use]
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The world.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// When the next step is due.
    #[must_use]
    pub fn next_step(&self) -> Instant {
        Instant::from_nanos(self.start.as_nanos() + (self.steps + 1) * STEP.as_nanos() as u64)
    }

    /// Whether a step would change nothing.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.body.rests(&self.demand)
    }

    /// Goes on by one step.
    pub fn step(&mut self) {
        self.steps += 1;
        let before = self.body.pose();
        self.body.step(&self.world, &self.demand);
        if self.body.pose() != before {
            if self.past.len() == MEMORY {
                self.past.pop_front();
            }
            self.past.push_back((self.steps, self.body.pose()));
        }
    }

    /// Leaves out the steps up to `now`, in which nothing happened.
    pub fn skip(&mut self, now: Instant) {
        let passed = now.since(self.start).as_nanos() as u64 / STEP.as_nanos() as u64;
        self.steps = self.steps.max(passed);
    }

    /// Where the body was at a moment that is not long past.
    #[must_use]
    pub fn pose_at(&self, at: Instant) -> Pose {
        let step = at.since(self.start).as_nanos() as u64 / STEP.as_nanos() as u64;
        let known = self.past.iter().rev().find(|(from, _)| *from <= step);
        known.or(self.past.front()).map_or(self.body.pose(), |(_, pose)| *pose)
    }

    /// What a sonar at `mount` on the robot measured when it was fired at `at`, m. The same question has the same
    /// answer: its noise is drawn from a stream of its own.
    #[must_use]
    pub fn sonar(&self, mount: Pose, at: Instant, stream: u64) -> Option<f64> {
        self.cone.measure(&self.world, self.pose_at(at) * mount, &mut Random::stream(self.seed, stream))
    }

    /// A sequence of its own for each `stream`: the same question has the same answer.
    #[must_use]
    pub fn random(&self, stream: u64) -> Random {
        Random::stream(self.seed, stream)
    }

    /// What a ranger that looks at the floor at `mount` on the robot measures now, m.
    #[must_use]
    pub fn ranger(&self, mount: Point, stream: u64) -> Option<f64> {
        let at = self.body.pose() * mount;
        floor_distance(&self.world, at, RANGER_HEIGHT, &mut Random::stream(self.seed, stream))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_remembers_where_it_was() {
        let start = Instant::from_millis(3);
        let mut scene = Scene::new(start, World::hall(20.0, 12.0), Parameters::default(), Sonar::default(), 1);
        scene.demand.speed = Some(0.5);
        let mut true_pose = vec![(start, scene.body().pose())];
        for _ in 0..400 {
            let at = scene.next_step();
            scene.step();
            true_pose.push((at, scene.body().pose()));
        }
        for (at, pose) in &true_pose[true_pose.len() - 60..] {
            assert_eq!(scene.pose_at(*at), *pose);
        }
        // Standing still leaves no trace and needs none.
        scene.demand.speed = None;
        while !scene.rests() {
            scene.step();
        }
        let rest = scene.body().pose();
        let later = scene.next_step() + base::Duration::from_secs(10);
        scene.skip(later);
        assert!(scene.next_step() > later);
        assert_eq!(scene.pose_at(later), rest);
    }
}
