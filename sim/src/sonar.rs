//! The sonar cone (SRF-08) and the infrared ranger that looks at the floor (GP2Y0A41); docs/facts/robot.md 2.1, 2.2.

use crate::random::Random;
use crate::world::{Hit, World};
use navitools::{Point, Pose};

/// How a sonar hears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sonar {
    /// Full opening, rad.
    pub beam: f64,
    /// Rays over the opening; more are sent where a surface mirrors straight back.
    pub rays: u32,
    /// A wall met at more than this from its normal returns nothing, rad.
    pub specular: f64,
    /// Nearest and farthest distance, m.
    pub range: (f64, f64),
    /// Farthest distance, m, of a leg of 6 cm radius; it grows to the full range at 25 cm.
    pub range_leg: f64,
    /// Steps of the answer, m.
    pub quantum: f64,
    /// Deviation, m, and its growth per m.
    pub sigma: (f64, f64),
}

impl Default for Sonar {
    fn default() -> Self {
        Self {
            beam: 55f64.to_radians(),
            rays: 9,
            specular: 25f64.to_radians(),
            range: (0.03, 6.0),
            range_leg: 2.5,
            quantum: 0.01,
            sigma: (0.01, 0.005),
        }
    }
}

/// The rays' directions and limits, worked out once.
#[derive(Clone, Debug)]
pub struct Cone {
    sonar: Sonar,
    fan: Vec<(f64, f64)>,
    cos_half_beam: f64,
    cos_specular: f64,
}

impl Cone {
    /// A cone of this sonar.
    #[must_use]
    pub fn new(sonar: Sonar) -> Self {
        let steps = f64::from(sonar.rays.max(2) - 1);
        let ray = |i| {
            let (sin, cos) = libm::sincos(sonar.beam * (f64::from(i) / steps - 0.5));
            (cos, sin)
        };
        Self {
            fan: (0..sonar.rays.max(2)).map(ray).collect(),
            cos_half_beam: libm::cos(sonar.beam / 2.0),
            cos_specular: libm::cos(sonar.specular),
            sonar,
        }
    }

    /// The nearest thing that returns an echo, m, without noise.
    #[must_use]
    pub fn echo(&self, world: &World, sensor: Pose) -> Option<f64> {
        let from = sensor.point();
        let (sin, cos) = sensor.theta.sin_cos();
        let mut nearest = self.sonar.range.1;
        let mut heard = false;
        let mut send = |direction, nearest: &mut f64| {
            if let Some(hit) = world.ray(from, direction, *nearest)
                && self.returns(&hit)
            {
                *nearest = hit.distance;
                heard = true;
            }
        };
        for &(along, across) in &self.fan {
            send((cos * along - sin * across, sin * along + cos * across), &mut nearest);
        }
        // Between the rays of the fan: where a surface stands square to the sound, or a leg is thinner than the gap.
        for Point { x, y } in world.mirrors(from) {
            let (dx, dy) = (x - from.x, y - from.y);
            let distance = libm::sqrt(dx * dx + dy * dy);
            if distance > 0.0 && dx * cos + dy * sin >= self.cos_half_beam * distance {
                send((dx / distance, dy / distance), &mut nearest);
            }
        }
        (heard && nearest >= self.sonar.range.0).then_some(nearest)
    }

    /// What the sensor answers, m: the echo with noise, in steps; none: no echo.
    #[must_use]
    pub fn measure(&self, world: &World, sensor: Pose, random: &mut Random) -> Option<f64> {
        let echo = self.echo(world, sensor)?;
        let Sonar { quantum, sigma: (sigma, growth), range: (least, most), .. } = self.sonar;
        let noisy = echo + random.normal() * (sigma + growth * echo);
        let steps = libm::round(noisy / quantum) * quantum;
        Some(steps.clamp(least, most))
    }

    fn returns(&self, hit: &Hit) -> bool {
        let thickness = ((hit.radius - 0.06) / (0.25 - 0.06)).clamp(0.0, 1.0);
        let reach = self.sonar.range_leg + thickness * (self.sonar.range.1 - self.sonar.range_leg);
        hit.cos_incidence >= self.cos_specular && hit.distance <= reach
    }
}

/// What an infrared ranger at `height` m above the floor answers, m; none over a drop. `at` is where it looks.
#[must_use]
pub fn floor_distance(world: &World, at: Point, height: f64, random: &mut Random) -> Option<f64> {
    // 20 mV of noise are about 2 mm at 12 cm (docs/facts/robot.md 2.2).
    world.floor(at).then(|| height + 0.002 * random.normal())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Column;

    fn echo(world: &World, x: f64, y: f64, degrees: f64) -> Option<f64> {
        Cone::new(Sonar::default()).echo(world, Pose::new(x, y, degrees.to_radians()))
    }

    #[test]
    fn a_wall_is_heard_at_its_foot_while_the_foot_is_in_the_beam() {
        let world = World::hall(20.0, 12.0);
        for degrees in [-27.0, -10.0, 0.0, 3.3, 27.0] {
            let heard = echo(&world, 17.0, 6.0, degrees).unwrap();
            assert!((heard - 3.0).abs() < 1e-12, "{degrees}: {heard}");
        }
    }

    #[test]
    fn a_smooth_wall_beyond_the_specular_limit_is_silent() {
        let world = World::hall(20.0, 12.0);
        // The beam reaches 27.5 deg to the side, a wall returns 25 deg: silent beyond 52.5.
        let heard = echo(&world, 17.0, 6.0, 51.0).unwrap();
        assert!(heard > 3.0 && heard < 3.0 / libm::cos(25f64.to_radians()) + 1e-9, "{heard}");
        assert_eq!(echo(&world, 17.0, 6.0, 54.0), None);
    }

    #[test]
    fn a_thin_leg_is_heard_between_the_rays_but_not_far() {
        let mut world = World::default();
        world.columns.push(Column { centre: Point { x: 2.0, y: 0.0 }, radius: 0.06 });
        for tenth in -270..=270 {
            let heard = echo(&world, 0.0, 0.0, f64::from(tenth) / 10.0).unwrap();
            assert!((heard - 1.94).abs() < 0.02, "{tenth}: {heard}");
        }
        assert_eq!(echo(&world, -1.0, 0.0, 0.0), None);
        world.columns[0].radius = 0.3;
        assert!((echo(&world, -3.0, 0.0, 0.0).unwrap() - 4.7).abs() < 1e-12);
    }

    #[test]
    fn nothing_is_heard_beyond_the_range_or_right_at_the_sensor() {
        let world = World::hall(20.0, 12.0);
        assert_eq!(echo(&world, 13.9, 6.0, 0.0), None);
        assert_eq!(echo(&world, 19.98, 6.0, 0.0), None);
    }

    #[test]
    fn noise_is_as_wide_as_said_and_in_steps_and_repeats_with_its_seed() {
        let world = World::hall(20.0, 12.0);
        let cone = Cone::new(Sonar::default());
        let run = |seed| {
            let mut random = Random::new(seed);
            let sensor = Pose::new(17.0, 6.0, 0.0);
            (0..2000).map(|_| cone.measure(&world, sensor, &mut random).unwrap()).collect::<Vec<_>>()
        };
        let all = run(1);
        assert!(all.iter().all(|m| (m * 100.0 - libm::round(m * 100.0)).abs() < 1e-9));
        let variance = all.iter().map(|m| (m - 3.0) * (m - 3.0)).sum::<f64>() / 2000.0;
        assert!((libm::sqrt(variance) - 0.025).abs() < 0.002, "{variance}");
        assert!(all == run(1) && all != run(2));
    }

    #[test]
    fn over_an_edge_there_is_no_floor() {
        let mut world = World::hall(20.0, 12.0);
        let p = |x, y| Point { x, y };
        world.drops.push(vec![p(1.0, 1.0), p(2.0, 1.0), p(2.0, 2.0), p(1.0, 2.0)]);
        let mut random = Random::new(1);
        assert_eq!(floor_distance(&world, p(1.5, 1.5), 0.12, &mut random), None);
        let seen = floor_distance(&world, p(5.0, 5.0), 0.12, &mut random).unwrap();
        assert!((seen - 0.12).abs() < 0.008);
    }
}
