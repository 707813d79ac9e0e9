//! The sonar cone (SRF-08) and the infrared ranger that looks at the floor (GP2Y0A41); docs/facts/robot.md 2.1, 2.2.

use crate::people::LEG;
use crate::random::Random;
use crate::world::{Ahead, Hit, World};
use navitools::{Point, Pose};

/// Acoustics of a sonar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sonar {
    /// Full opening, rad.
    pub beam: f64,
    /// Number of rays over the opening; further ones are added where a surface reflects straight back.
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
    /// Probabilities of a reading that is too short, missing, and random.
    pub short: f64,
    /// See [`Sonar::short`].
    pub lost: f64,
    /// See [`Sonar::short`].
    pub random: f64,
    /// Probability of an echo from a leg in sound-absorbing clothes: within `CLOTHES`, and beyond.
    pub person: (f64, f64),
    /// The air of a run is at most so much warmer or colder than the sensor takes for granted, K.
    pub warmth: f64,
}

/// Up to here sound finds most clothes, m.
const CLOTHES: f64 = 1.0;
/// The speed of sound changes by so much a kelvin.
const PER_KELVIN: f64 = 0.0017;

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
            short: 0.03,
            lost: 0.10,
            random: 0.02,
            person: (0.9, 0.45),
            warmth: 7.0,
        }
    }
}

impl Sonar {
    /// A sonar without errors.
    #[must_use]
    pub fn exact() -> Self {
        let sigma = (0.0, 0.0);
        Self { sigma, short: 0.0, lost: 0.0, random: 0.0, person: (1.0, 1.0), warmth: 0.0, ..Self::default() }
    }
}

/// Reflector of a sensor's sound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// m.
    pub distance: f64,
    /// Position, m.
    pub at: Point,
    /// Gain of transmission and reception in this direction: 1 on the axis, one half (-6 dB) at the beam's edge.
    pub gain: f64,
}

/// The rays' directions and limits, worked out once.
#[derive(Clone, Debug)]
pub struct Cone {
    sonar: Sonar,
    fan: Vec<(f64, f64)>,
    cos_half_beam: f64,
    sin_half_beam: f64,
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
            sin_half_beam: libm::sin(sonar.beam / 2.0).max(1e-9),
            cos_specular: libm::cos(sonar.specular),
            sonar,
        }
    }

    /// The nearest thing that returns an echo, without noise; whether a leg does is chance. `people` are the middles of
    /// both legs of each who may be near.
    #[must_use]
    pub fn echo(
        &self,
        world: &World,
        people: impl Iterator<Item = [Point; 2]>,
        sensor: Pose,
        random: &mut Random,
    ) -> Option<Echo> {
        let ahead = world.ahead(sensor, self.sonar.range.1);
        let (mut nearest, mut towards) = self.still(world, &ahead, sensor);
        let from = sensor.point();
        for legs in people {
            let heard = random.uniform();
            for leg in legs {
                let distance = leg.distance(from) - LEG;
                let (_, most) = self.sonar.person;
                let sure = if distance <= CLOTHES { self.sonar.person.0 } else { most };
                let gain = self.gain(sensor, leg);
                if distance < nearest.min(self.sonar.range_leg)
                    && distance > 0.0
                    && heard < gain * sure
                    && sees(&ahead, from, leg, distance)
                {
                    (nearest, towards) = (distance, Some(leg));
                }
            }
        }
        let towards = towards.filter(|_| nearest >= self.sonar.range.0)?;
        let whole = towards.distance(from).max(1e-9);
        let part = nearest / whole;
        let at = Point { x: from.x + part * (towards.x - from.x), y: from.y + part * (towards.y - from.y) };
        Some(Echo { distance: nearest, at, gain: self.gain(sensor, at) })
    }

    /// Gain in the direction of a point; 0 outside of the beam.
    fn gain(&self, sensor: Pose, point: Point) -> f64 {
        let (sin, cos) = sensor.theta.sin_cos();
        let (dx, dy) = (point.x - sensor.x, point.y - sensor.y);
        let ahead = dx * cos + dy * sin;
        let length = libm::sqrt(dx * dx + dy * dy);
        if ahead < self.cos_half_beam * length {
            return 0.0;
        }
        // The angle by its sine: half a per cent off at the edge of this beam.
        let off = libm::fabs(dy * cos - dx * sin) / length.max(1e-9) / self.sin_half_beam;
        1.0 - 0.5 * off * off
    }

    /// Distance at which a sensor receives the sound of another one fired at the same moment: half the path there and
    /// back, m. The reflector must be in both beams; the probability of reception is the product of their gains.
    #[must_use]
    pub fn overheard(&self, world: &World, sensor: Pose, other: &Echo, random: &mut Random) -> Option<f64> {
        let gain = self.gain(sensor, other.at);
        let way = other.at.distance(sensor.point());
        let heard =
            random.chance(gain * other.gain) && sees(&world.ahead(sensor, way), sensor.point(), other.at, way - 0.02);
        heard.then_some((way + other.distance) / 2.0)
    }

    /// Distance of the echo of walls and columns, m, and its reflector; without an echo the range, and none.
    fn still(&self, world: &World, ahead: &Ahead, sensor: Pose) -> (f64, Option<Point>) {
        let from = sensor.point();
        let (sin, cos) = sensor.theta.sin_cos();
        let mut nearest = self.sonar.range.1;
        let mut heard = None;
        let mut send = |direction, nearest: &mut f64| {
            if let Some(hit) = ahead.ray(from, direction, *nearest)
                && self.returns(&hit)
            {
                *nearest = hit.distance;
                heard = Some(direction);
            }
        };
        for &(along, across) in &self.fan {
            send((cos * along - sin * across, sin * along + cos * across), &mut nearest);
        }
        // Between the rays of the fan: surfaces square to the sound, and legs thinner than the gap.
        for Point { x, y } in world.mirrors(from) {
            let (dx, dy) = (x - from.x, y - from.y);
            let distance = libm::sqrt(dx * dx + dy * dy);
            if distance > 0.0 && dx * cos + dy * sin >= self.cos_half_beam * distance {
                send((dx / distance, dy / distance), &mut nearest);
            }
        }
        let at = heard.map(|(x, y): (f64, f64)| Point { x: from.x + nearest * x, y: from.y + nearest * y });
        (nearest, at)
    }

    /// Additional path of an earlier run's sound within the time that the sensor measures, m.
    #[must_use]
    pub fn stretch(&self, random: &mut Random) -> f64 {
        let warmer = self.sonar.warmth * (2.0 * random.uniform() - 1.0);
        1.0 / (1.0 + PER_KELVIN * warmer)
    }

    /// Reading for an echo at this distance, m: the beam mixture (Thrun, Burgard, Fox 2005, 6.3) and noise, in steps;
    /// `None`: no echo.
    #[must_use]
    pub fn measure(&self, echo: Option<f64>, stretch: f64, random: &mut Random) -> Option<f64> {
        let Sonar { quantum, sigma: (sigma, growth), range: (least, most), short, lost, random: any, .. } = self.sonar;
        let kind = random.uniform();
        let noisy = match echo {
            _ if kind < short => echo.unwrap_or(most) * random.uniform(),
            _ if kind < short + lost => return None,
            _ if kind < short + lost + any => most * random.uniform(),
            echo => echo? * stretch + random.normal() * (sigma + growth * echo?),
        };
        let steps = libm::round(noisy / quantum) * quantum;
        Some(steps.clamp(least, most))
    }

    fn returns(&self, hit: &Hit) -> bool {
        let thickness = ((hit.radius - 0.06) / (0.25 - 0.06)).clamp(0.0, 1.0);
        let reach = self.sonar.range_leg + thickness * (self.sonar.range.1 - self.sonar.range_leg);
        hit.cos_incidence >= self.cos_specular && hit.distance <= reach
    }
}

fn sees(ahead: &Ahead, from: Point, to: Point, distance: f64) -> bool {
    let whole = to.distance(from).max(1e-9);
    ahead.ray(from, ((to.x - from.x) / whole, (to.y - from.y) / whole), distance).is_none()
}

/// Reading of an infrared ranger at `height` m above the floor; `None` over a drop. `at`: the point that it looks at.
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
        let sensor = Pose::new(x, y, degrees.to_radians());
        let echo = Cone::new(Sonar::default()).echo(world, std::iter::empty(), sensor, &mut Random::new(1))?;
        assert!((echo.at.distance(sensor.point()) - echo.distance).abs() < 1e-9);
        Some(echo.distance)
    }

    #[test]
    fn readings_are_of_the_mixture() {
        let sonar = Sonar { sigma: (0.0, 0.0), ..Sonar::default() };
        let (cone, mut random) = (Cone::new(sonar), Random::new(3));
        let n = 100_000;
        let mut counts = [0u32; 4];
        for _ in 0..n {
            let kind = match cone.measure(Some(3.0), 1.0, &mut random) {
                None => 1,
                Some(3.0) => 0,
                Some(metres) if metres < 3.0 => 2,
                Some(_) => 3,
            };
            counts[kind] += 1;
        }
        let share = counts.map(|count| f64::from(count) / f64::from(n));
        // Half of what is random is nearer than the echo.
        let expected = [0.85, 0.10, 0.04, 0.01];
        assert!(share.iter().zip(expected).all(|(share, expected)| (share - expected).abs() < 0.004), "{share:?}");
        let heard = (0..n).filter(|_| cone.measure(None, 1.0, &mut random).is_some()).count() as f64 / f64::from(n);
        assert!((heard - 0.05).abs() < 0.004, "{heard}: what is not there");
    }

    #[test]
    fn people_are_heard_near_and_seldom_far() {
        let (world, cone) = (World::default(), Cone::new(Sonar::default()));
        let mut random = Random::new(4);
        let mut share = |x: f64| {
            let legs = [Point { x, y: 0.09 }, Point { x, y: -0.09 }];
            let sensor = Pose::new(0.0, 0.0, 0.0);
            let heard = (0..20_000).filter(|_| cone.echo(&world, [legs].into_iter(), sensor, &mut random).is_some());
            heard.count() as f64 / 20_000.0
        };
        let (near, far, beyond) = (share(0.8), share(2.0), share(2.7));
        assert!((near - 0.89).abs() < 0.02 && (far - 0.45).abs() < 0.02 && beyond == 0.0, "{near} {far} {beyond}");
    }

    #[test]
    fn legs_behind_a_wall_are_silent_and_before_it_nearer() {
        let world = World::hall(20.0, 12.0);
        let cone = Cone::new(Sonar::exact());
        let legs = |x| [[Point { x, y: 6.0 }, Point { x, y: 6.2 }]].into_iter();
        let mut random = Random::new(1);
        let mut heard = |x| cone.echo(&world, legs(x), Pose::new(18.5, 6.0, 0.0), &mut random).unwrap().distance;
        assert!((heard(20.5) - 1.5).abs() < 1e-12 && (heard(19.5) - 0.94).abs() < 1e-12);
    }

    #[test]
    fn another_s_echo_is_overheard_at_half_of_both_ways_where_both_beams_are() {
        let mut world = World::default();
        world.columns.push(Column { centre: Point { x: 2.0, y: 0.0 }, radius: 0.25 });
        let cone = Cone::new(Sonar::exact());
        let (left, right) = (Pose::new(0.0, 0.2, 0.0), Pose::new(0.0, -0.2, 0.0));
        let mut random = Random::new(5);
        let echo = cone.echo(&world, std::iter::empty(), left, &mut random).unwrap();
        let way = echo.at.distance(right.point());
        let heard: Vec<_> = (0..4000).filter_map(|_| cone.overheard(&world, right, &echo, &mut random)).collect();
        let sure = heard.len() as f64 / 4000.0;
        assert!((sure - echo.gain * cone.gain(right, echo.at)).abs() < 0.03 && sure > 0.8, "{sure}");
        assert!(heard.iter().all(|heard| (heard - (way + echo.distance) / 2.0).abs() < 1e-12));
        let away = Pose::new(0.0, -0.2, 1.5);
        assert_eq!(cone.overheard(&world, away, &echo, &mut random), None);
        assert!((cone.gain(left, Point { x: 1.0, y: 0.2 }) - 1.0).abs() < 1e-12);
        let (sin, cos) = libm::sincos(27.4f64.to_radians());
        assert!((cone.gain(Pose::default(), Point { x: cos, y: sin }) - 0.5).abs() < 0.01);
    }

    #[test]
    fn warm_air_brings_all_nearer() {
        let cone = Cone::new(Sonar::default());
        let all: Vec<f64> = (0..1000).map(|seed| cone.stretch(&mut Random::new(seed))).collect();
        let (least, most) = all.iter().fold((2.0f64, 0.0f64), |(least, most), s| (least.min(*s), most.max(*s)));
        assert!((least - 1.0 / 1.0119).abs() < 1e-4 && (most - 1.0 / 0.9881).abs() < 1e-4, "{least} {most}");
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
        let cone = Cone::new(Sonar { sigma: (0.01, 0.005), ..Sonar::exact() });
        let run = |seed| {
            let mut random = Random::new(seed);
            (0..2000).map(|_| cone.measure(Some(3.0), 1.0, &mut random).unwrap()).collect::<Vec<_>>()
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
