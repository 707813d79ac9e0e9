//! Speed of the body, as the rules take it: of a robot that steers its own; of any other one that of its fastest wheel,
//! as the body moves: in a turn on the spot it is not 0.

use super::Base;
use base::Instant;
use kinematics::Twist;
use messages::simulation::DataTruth;
use navitools::Pose;

/// Way between two samples beyond which the body was put elsewhere, m.
const MOVED_MAX_M: f64 = 0.2;

/// The last sample.
#[derive(Debug, Default)]
pub(super) struct Pace {
    /// Time, the process that simulates the body, pose.
    last: Option<(Instant, u32, Pose)>,
    /// Speed at the last sample, m/s.
    pub speed: f64,
    /// Velocity at the last sample of a robot that turns by its wheels, over the time since the one before.
    pub twist: Twist,
}

impl Pace {
    /// Speed at a sample, m/s.
    pub fn speed(&mut self, now: Instant, pid: u32, truth: &DataTruth, base: Option<&Base>) -> f64 {
        let Some(base) = base else {
            self.speed = truth.speed;
            return self.speed;
        };
        let pose = Pose::new(truth.x, truth.y, truth.theta);
        let before = self.last.replace((now, pid, pose));
        let Some((since, _, before)) = before.filter(|(since, simulator, _)| *simulator == pid && *since < now) else {
            (self.speed, self.twist) = (0.0, Twist::ZERO);
            return 0.0;
        };
        let way = before.inverse() * pose;
        if libm::hypot(way.x, way.y) <= MOVED_MAX_M {
            let twist = Twist::new(way.x, way.y, way.theta.radians());
            self.twist = twist * (1.0 / now.since(since).as_secs_f64());
            self.speed = base.fastest_wheel(self.twist);
        }
        self.speed
    }
}
