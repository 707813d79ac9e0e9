//! BR-SBS1: sweeps its active beacons once a second, each sighted at its own instant (docs/facts/robot.md 1.2).
//!
//! Sightings are computed on request, from the body's pose at their instants, with noise from a random stream of their
//! own: the same request has the same answer.

use crate::random::Random;
use crate::scene::Scene;
use crate::world::Beacon;
use base::{Duration, Instant};
use core::f64::consts::TAU;
use navitools::{Point, Pose, wrap};
use rs485::boards::sbs1::{
    BEACONS, Debug, GET_BEACON_DATA, GET_DEBUG_DATA, SET_BEACON_IDS, Sighting, build_beacons, build_debug,
};
use rs485::slave::Asked;
use rs485::{Data, frame::Status};

/// Duration of a sweep.
pub const SWEEP: Duration = Duration::from_secs(1);
/// A bearing's error that lasts changes within this time.
const DRIFT: Duration = Duration::from_secs(2);
/// Half of the strength is lost at this distance, m.
const HALF_STRENGTH: f64 = 4.0;
/// A beacon that hangs on a wall is not hidden by it, m.
const MOUNTING: f64 = 0.02;
/// The number of the draw of how it sits.
const TURN: u64 = 1 << 41;
const SUPPLY_MV: u16 = 5000;

/// Mounting and quality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sbs1Config {
    /// Mounting pose on the robot.
    pub mount: Pose,
    /// m.
    pub range: f64,
    /// Deviation of a bearing, rad; half of the variance lasts for `DRIFT`.
    pub sigma: f64,
    /// Steps of a bearing, rad.
    pub quantum: f64,
    /// Probability of a sighting of a visible beacon in a sweep.
    pub seen: f64,
    /// Probability with people in front of it.
    pub crowd: f64,
    /// Probability that a sighting is an outlier: a reflection, or half of the time another beacon.
    pub wild: f64,
    /// Bound of the error of its mounting angle, rad; constant for a run.
    pub turn: f64,
}

impl Default for Sbs1Config {
    /// That of docs/facts/robot.md 1.2.
    fn default() -> Self {
        Self {
            mount: Pose::new(0.25, 0.0, 0.0),
            range: 15.0,
            sigma: 0.5f64.to_radians(),
            quantum: 0.1f64.to_radians(),
            seen: 0.95,
            crowd: 0.3,
            wild: 0.02,
            turn: 3f64.to_radians(),
        }
    }
}

/// The board.
#[derive(Debug)]
pub struct Sbs1 {
    config: Sbs1Config,
    address: u8,
    /// Power-on; the sweep's grid.
    start: Instant,
    /// In order of the sweep; empty for all.
    active: Vec<u8>,
    /// From here on the active beacons are looked for.
    since: Instant,
    /// Until when a beacon is hidden; 0: all are.
    hidden: (Instant, u8),
    /// Until when more sightings are of something else, and how probably.
    wild: (Instant, f64),
    /// Until when its supply is another one, mV.
    supply: (Instant, u16),
    /// Light that it rejects.
    glare: Glare,
}

/// Light that is no beacon.
#[derive(Clone, Copy, Debug, Default)]
struct Glare {
    from: Instant,
    until: Instant,
    /// 1/s.
    rate: f64,
    /// Pulses of earlier ones.
    before: u64,
}

impl Glare {
    fn pulses(&self, now: Instant) -> u64 {
        let shone = now.min(self.until).since(self.from.min(now).min(self.until)).as_secs_f64();
        self.before + (shone * self.rate) as u64
    }
}

impl Sbs1 {
    /// A board that is switched on at `start` and looks for all beacons.
    #[must_use]
    pub fn new(address: u8, config: Sbs1Config, start: Instant) -> Self {
        let (hidden, wild) = ((Instant::ZERO, 0), (Instant::ZERO, 0.0));
        let supply = (Instant::ZERO, SUPPLY_MV);
        Self { config, address, start, active: Vec::new(), since: start, hidden, wild, supply, glare: Glare::default() }
    }

    /// Resets at `now`: all beacons active.
    pub fn reset(&mut self, now: Instant) {
        let (hidden, wild, supply) = (self.hidden, self.wild, self.supply);
        let glare = Glare { from: now.max(self.glare.from), before: 0, ..self.glare };
        *self = Self { hidden, wild, supply, glare, ..Self::new(self.address, self.config, now) };
    }

    /// Hides a beacon until an instant; 0: all.
    pub fn hide(&mut self, until: Instant, beacon: u8) {
        self.hidden = (until, beacon);
    }

    /// A sighting is of something else with this probability until then.
    pub fn mislead(&mut self, until: Instant, probability: f64) {
        self.wild = (until, probability);
    }

    /// Its supply has this voltage until then.
    pub fn feed(&mut self, until: Instant, volts: f64) {
        self.supply = (until, libm::round(volts * 1000.0) as u16);
    }

    /// It rejects pulses at this rate, 1/s, until an instant.
    pub fn glare(&mut self, now: Instant, until: Instant, rate: f64) {
        self.glare = Glare { from: now, until, rate, before: self.glare.pulses(now) };
    }

    /// Its supply is as it should be, and nothing dazzles it.
    pub fn heal(&mut self, now: Instant) {
        self.supply.0 = now;
        self.glare = Glare { until: now.min(self.glare.until), ..self.glare };
    }

    /// Answers a request.
    pub fn answer(&mut self, now: Instant, asked: &Asked, scene: &Scene) -> (Status, Data) {
        match asked.instruction {
            code if code == SET_BEACON_IDS.code && asked.data.len() > BEACONS => (Status::Error, Data::new()),
            code if code == SET_BEACON_IDS.code => {
                self.active = asked.data.to_vec();
                self.since = now;
                (Status::Ok, Data::new())
            }
            code if code == GET_BEACON_DATA.code => {
                (Status::Ok, build_beacons(&self.sightings(now, scene)).into_iter().collect())
            }
            code if code == GET_DEBUG_DATA.code => (Status::Ok, build_debug(self.debug(now)).into_iter().collect()),
            _ => (Status::UnknownInstruction, Data::new()),
        }
    }

    fn debug(&self, now: Instant) -> Debug {
        let sweeps = self.sweeps(now);
        // Sunlight and lamps: a pulse in seven sweeps.
        let rejected = sweeps / 7 + self.glare.pulses(now);
        let supply_mv = if now < self.supply.0 { self.supply.1 } else { SUPPLY_MV };
        Debug { sweeps: sweeps as u16, rejected_pulses: rejected as u16, supply_mv }
    }

    fn sweeps(&self, now: Instant) -> u64 {
        now.since(self.start).as_nanos() as u64 / SWEEP.as_nanos() as u64
    }

    /// The last sighting of each active beacon, not older than a sweep, in order of the sweep.
    fn sightings(&self, now: Instant, scene: &Scene) -> Vec<Sighting> {
        let beacons = &scene.world().beacons;
        let ids: Vec<u8> = match self.active.as_slice() {
            [] => beacons.iter().take(BEACONS).map(|beacon| beacon.id).collect(),
            active => active.to_vec(),
        };
        let slot = SWEEP / (ids.len() as u32).max(1);
        let sight = |(place, id): (u32, &u8)| {
            let beacon = beacons.iter().find(|beacon| beacon.id == *id)?;
            let within = slot * place + slot / 2;
            let since = now.since(self.start).checked_sub(within)?;
            let sweep = since.as_nanos() as u64 / SWEEP.as_nanos() as u64;
            let at = self.start + within + Duration::from_nanos(sweep * SWEEP.as_nanos() as u64);
            if at < self.since {
                return None;
            }
            let (bearing, strength) = self.sight(at, beacon, sweep, scene)?;
            Some(Sighting { id: *id, bearing, strength, age_ms: now.since(at).as_millis() as u16 })
        };
        (0..).zip(&ids).filter_map(sight).collect()
    }

    /// Bearing, 0.01 deg, and strength of a beacon at a moment; none when it is hidden, too far, or just not seen.
    fn sight(&self, at: Instant, beacon: &Beacon, sweep: u64, scene: &Scene) -> Option<(i16, u8)> {
        let own = scene.pose_at(at) * self.config.mount;
        let (dx, dy) = (beacon.at.x - own.x, beacon.at.y - own.y);
        let distance = libm::sqrt(dx * dx + dy * dy);
        if distance > self.config.range || distance <= MOUNTING {
            return None;
        }
        let (hidden, which) = self.hidden;
        if at < hidden && (which == 0 || which == beacon.id) {
            return None;
        }
        let way = (dx / distance, dy / distance);
        if scene.world().ray(own.point(), way, distance - MOUNTING).is_some() {
            return None;
        }
        let mut random = scene.random(self.stream(beacon.id, sweep));
        let hidden = scene.people_between(at, own.point(), beacon.at) > 0;
        if !random.chance(if hidden { self.config.crowd } else { self.config.seen }) {
            return None;
        }
        let turn = self.config.turn * (2.0 * scene.random(self.stream(0, TURN)).uniform() - 1.0);
        let direction = |of: Point| libm::atan2(of.y - own.y, of.x - own.x) - own.theta.radians() - turn;
        let true_bearing = direction(beacon.at);
        let noise =
            (random.normal() + self.drift(at, beacon.id, scene)) * self.config.sigma / core::f64::consts::SQRT_2;
        let wild = if at < self.wild.0 { self.wild.1.max(self.config.wild) } else { self.config.wild };
        let bearing = match random.chance(wild) {
            true => match self.something_else(beacon, &mut random, scene) {
                Some(other) => wrap(direction(other)),
                None => wrap(TAU * random.uniform()),
            },
            false => wrap(true_bearing + noise),
        };
        let quantum = self.config.quantum;
        let bearing = if quantum > 0.0 { libm::round(bearing / quantum) * quantum } else { bearing };
        let hundredths = libm::round(bearing.to_degrees() * 100.0) as i32;
        let bearing = (hundredths + 18_000).rem_euclid(36_000) - 18_000;
        let strength = 255.0 / (1.0 + distance / HALF_STRENGTH);
        Some((bearing as i16, libm::round(strength) as u8))
    }

    /// Another beacon, half of the time; else a reflection, from anywhere.
    fn something_else(&self, beacon: &Beacon, random: &mut Random, scene: &Scene) -> Option<Point> {
        let others = scene.world().beacons.iter().filter(|other| other.id != beacon.id);
        let others: Vec<Point> = others.map(|other| other.at).collect();
        let drawn = (random.uniform() * 2.0 * others.len() as f64) as usize;
        others.get(drawn).copied()
    }

    /// An error of deviation 1 that changes slowly: drawn every [`DRIFT`], a straight line between.
    fn drift(&self, at: Instant, id: u8, scene: &Scene) -> f64 {
        let turns = at.as_nanos() as f64 / DRIFT.as_nanos() as f64;
        let (knot, part) = (libm::floor(turns), turns - libm::floor(turns));
        let drawn = |knot: f64| scene.random(self.stream(id, 1 << 40 | knot as u64)).normal();
        let mixed = drawn(knot) * (1.0 - part) + drawn(knot + 1.0) * part;
        // What mixing two takes from the deviation is given back.
        mixed / libm::sqrt(part * part + (1.0 - part) * (1.0 - part))
    }

    fn stream(&self, id: u8, number: u64) -> u64 {
        u64::from(self.address) << 56 | u64::from(id) << 48 | number
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Parameters;
    use crate::sonar::Sonar;
    use crate::world::{Column, World};
    use rs485::boards::sbs1::{Sightings, parse_beacons, parse_debug};

    fn exact() -> Sbs1Config {
        Sbs1Config { sigma: 0.0, quantum: 0.0, seen: 1.0, wild: 0.0, turn: 0.0, ..Sbs1Config::default() }
    }

    fn scene(beacons: &[(u8, f64, f64)]) -> Scene {
        let beacons = beacons.iter().map(|(id, x, y)| Beacon { id: *id, at: Point { x: *x, y: *y } }).collect();
        let world = World { beacons, ..World::default() };
        Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 1)
    }

    fn ask(board: &mut Sbs1, at_ms: u64, code: u8, data: &[u8], scene: &Scene) -> Vec<u8> {
        let asked = Asked { instruction: code, data: data.iter().copied().collect(), answered: true };
        let (status, data) = board.answer(Instant::from_millis(at_ms), &asked, scene);
        assert_eq!(status, Status::Ok);
        data.to_vec()
    }

    fn beacons(board: &mut Sbs1, at_ms: u64, scene: &Scene) -> Sightings {
        parse_beacons(&ask(board, at_ms, 0x02, &[], scene)).unwrap()
    }

    #[test]
    fn each_beacon_has_its_own_instant_in_the_sweep() {
        let scene = scene(&[(4, 10.25, 0.0), (2, 0.25, 8.0)]);
        let mut board = Sbs1::new(0x30, exact(), Instant::ZERO);
        assert!(beacons(&mut board, 249, &scene).is_empty(), "nothing was sighted yet");
        let sighting = |id, bearing, strength, age_ms| Sighting { id, bearing, strength, age_ms };
        assert_eq!(beacons(&mut board, 251, &scene)[..], [sighting(4, 0, 73, 1)]);
        // 255 / (1 + 10 / 4) and 255 / (1 + 8 / 4).
        let both = [sighting(4, 0, 73, 950), sighting(2, 9000, 85, 450)];
        assert_eq!(beacons(&mut board, 1200, &scene)[..], both);
        assert_eq!(beacons(&mut board, 71_200, &scene)[..], both, "70 sweeps later");
    }

    #[test]
    fn a_bearing_is_that_of_where_the_robot_was_then() {
        let mut scene = scene(&[(1, 3.0, 4.0)]);
        scene.demand.wheels[0] = Some(0.8);
        let mut poses = vec![scene.body().pose()];
        for _ in 0..800 {
            scene.step();
            poses.push(scene.body().pose());
        }
        let mut board = Sbs1::new(0x30, exact(), Instant::ZERO);
        // At 4 s the only beacon was sighted last at 3.5 s.
        let sighting = beacons(&mut board, 4000, &scene)[0];
        assert_eq!(sighting.age_ms, 500);
        let then = poses[700];
        let expected = libm::atan2(4.0 - then.y, 3.0 - then.x - 0.25).to_degrees() * 100.0;
        assert!((f64::from(sighting.bearing) - expected).abs() < 1.0, "{} {expected}", sighting.bearing);
    }

    #[test]
    fn only_active_beacons_are_sighted_and_a_reset_forgets_which() {
        let scene = scene(&[(1, 5.0, 0.0), (2, 5.0, 1.0), (3, 5.0, 2.0)]);
        let mut board = Sbs1::new(0x30, exact(), Instant::ZERO);
        let ids = |sightings: Sightings| sightings.iter().map(|sighting| sighting.id).collect::<Vec<_>>();
        assert_eq!(ids(beacons(&mut board, 1500, &scene)), [1, 2, 3]);
        assert!(ask(&mut board, 1500, 0x01, &[3, 9, 1], &scene).is_empty());
        assert!(beacons(&mut board, 1501, &scene).is_empty(), "what was sighted before was of another sweep");
        assert_eq!(ids(beacons(&mut board, 2600, &scene)), [3, 1], "there is no beacon 9");
        board.reset(Instant::from_millis(3000));
        assert_eq!(ids(beacons(&mut board, 4500, &scene)), [1, 2, 3]);
    }

    #[test]
    fn what_is_hidden_or_too_far_is_not_sighted() {
        let mut world = World {
            beacons: scene(&[(1, 8.0, 0.0), (2, 0.0, 8.0), (3, 15.3, 0.1)]).world().beacons.clone(),
            ..World::default()
        };
        world.columns.push(Column { centre: Point { x: 4.0, y: 0.1 }, radius: 0.25 });
        let scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 1);
        let mut board = Sbs1::new(0x30, exact(), Instant::ZERO);
        let sightings = beacons(&mut board, 2000, &scene);
        assert_eq!(sightings.iter().map(|sighting| sighting.id).collect::<Vec<_>>(), [2]);
    }

    #[test]
    fn a_beacon_that_somebody_stands_before_is_not_sighted_and_one_may_be_something_else() {
        let scene = scene(&[(1, 5.0, 0.0), (2, 5.0, 1.0)]);
        let mut board = Sbs1::new(0x30, exact(), Instant::ZERO);
        let ids = |sightings: &Sightings| sightings.iter().map(|sighting| sighting.id).collect::<Vec<_>>();
        board.hide(Instant::from_millis(2000), 2);
        board.reset(Instant::ZERO);
        assert_eq!(ids(&beacons(&mut board, 1900, &scene)), [1]);
        board.hide(Instant::from_millis(2000), 0);
        assert_eq!(ids(&beacons(&mut board, 1900, &scene)), [0; 0]);
        let right = beacons(&mut board, 3900, &scene);
        assert_eq!(ids(&right), [1, 2]);
        board.mislead(Instant::from_millis(6000), 1.0);
        let wrong = beacons(&mut board, 5900, &scene);
        assert!(wrong.iter().zip(&right).all(|(wrong, right)| wrong.bearing != right.bearing), "{wrong:?}");
        assert_eq!(beacons(&mut board, 7900, &scene), right);
    }

    #[test]
    fn bearings_scatter_as_configured_and_the_same_seed_repeats() {
        let scene = scene(&[(1, 10.0, 0.0)]);
        let config = Sbs1Config { quantum: 0.0, wild: 0.0, turn: 0.0, ..Sbs1Config::default() };
        let run = |board: &mut Sbs1| (1..4000).flat_map(|n| beacons(board, 1000 * n, &scene)).collect::<Vec<_>>();
        let sightings = run(&mut Sbs1::new(0x30, config, Instant::ZERO));
        assert_eq!(sightings, run(&mut Sbs1::new(0x30, config, Instant::ZERO)));
        let n = sightings.len() as f64;
        assert!((n / 3999.0 - 0.95).abs() < 0.02, "{n}");
        let squares: f64 = sightings.iter().map(|s| f64::from(s.bearing) * f64::from(s.bearing)).sum();
        let sigma = libm::sqrt(squares / n);
        assert!((sigma - 50.0).abs() < 3.0, "{sigma} hundredths of a degree");
    }

    #[test]
    fn half_of_an_error_lasts_two_seconds() {
        let scene = scene(&[(1, 10.0, 0.0)]);
        let config = Sbs1Config { sigma: 0.5f64.to_radians(), ..exact() };
        let mut board = Sbs1::new(0x30, config, Instant::ZERO);
        let all: Vec<f64> = (1..8000).map(|n| f64::from(beacons(&mut board, 1000 * n, &scene)[0].bearing)).collect();
        let correlation = |lag: usize| {
            let products = all.iter().zip(&all[lag..]).map(|(a, b)| a * b).sum::<f64>();
            products / (all.len() - lag) as f64 / (all.iter().map(|a| a * a).sum::<f64>() / all.len() as f64)
        };
        let [one, two, four] = [1, 2, 4].map(correlation);
        assert!((0.25..0.5).contains(&one) && two < one - 0.1 && four.abs() < 0.05, "{one} {two} {four}");
    }

    #[test]
    fn it_is_turned_for_a_run_and_wild_now_and_then_half_of_that_to_another_beacon() {
        let beacons_of = |seed| {
            let world = scene(&[(1, 8.0, 0.0), (2, 0.0, 6.0)]).world().clone();
            let scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), seed);
            let config = Sbs1Config { turn: 3f64.to_radians(), wild: 0.02, ..exact() };
            let mut board = Sbs1::new(0x30, config, Instant::ZERO);
            (1..20_000).map(|n| beacons(&mut board, 1000 * n, &scene)[0].bearing).collect::<Vec<i16>>()
        };
        let mut turns = Vec::new();
        for seed in 1..20 {
            let all = beacons_of(seed);
            let usual = all[..9].iter().max_by_key(|one| all.iter().filter(|other| other == one).count()).unwrap();
            // The other one is to the left: 6 m up, 0.25 m back.
            let other = usual + libm::round(libm::atan2(6.0, -0.25).to_degrees() * 100.0) as i16;
            let share = |of: &dyn Fn(&i16) -> bool| all.iter().filter(|one| of(one)).count() as f64 / all.len() as f64;
            let (wild, swapped) = (share(&|one| one != usual), share(&|one| (one - other).abs() < 3));
            assert!((wild - 0.02).abs() < 0.005 && (swapped - 0.01).abs() < 0.004, "{wild} {swapped}");
            assert!(usual.abs() <= 300);
            turns.push(*usual);
        }
        turns.sort_unstable();
        turns.dedup();
        assert!(turns.len() > 15 && turns[0] < -100 && turns[turns.len() - 1] > 100, "{turns:?}");
    }

    #[test]
    fn a_crowd_hides_most_of_a_beacon() {
        let mut world = World::hall(20.0, 12.0);
        world.beacons = scene(&[(1, 19.0, 6.0), (2, 10.2, 11.0)]).world().beacons.clone();
        world.places = vec![Point { x: 14.0, y: 6.0 }, Point { x: 15.0, y: 6.0 }];
        world.people = crate::world::Crowd { count: 30, ..crate::world::Crowd::default() };
        let mut scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 1);
        let mut board = Sbs1::new(0x30, exact(), Instant::ZERO);
        let mut seen = [(0, 0), (0, 0)];
        for second in 60..900 {
            scene.skip(Instant::from_millis(1000 * second));
            let ids: Vec<u8> = beacons(&mut board, 1000 * second, &scene).iter().map(|sighting| sighting.id).collect();
            let own = Point { x: 10.25, y: 6.0 };
            for (number, seen) in (0..).zip(&mut seen) {
                let at = Instant::from_millis(1000 * second - 750 + 500 * number);
                let to = scene.world().beacons[number as usize].at;
                if scene.people_between(at, own, to) > 0 {
                    *seen = (seen.0 + usize::from(ids.contains(&(number as u8 + 1))), seen.1 + 1);
                }
            }
        }
        let (sighted, all) = seen[0];
        assert!(all > 200 && (sighted as f64 / all as f64 - 0.3).abs() < 0.1, "{seen:?}");
    }

    #[test]
    fn glare_is_counted_while_it_lasts_and_the_supply_is_what_it_is_fed() {
        let scene = scene(&[]);
        let mut board = Sbs1::new(0x30, exact(), Instant::ZERO);
        let debug = |board: &mut Sbs1, at_ms| parse_debug(&ask(board, at_ms, 0x03, &[], &scene)).unwrap();
        board.glare(Instant::from_millis(1000), Instant::from_millis(3000), 500.0);
        board.feed(Instant::from_millis(2500), 4.2);
        let during = debug(&mut board, 2000);
        assert_eq!((during.rejected_pulses, during.supply_mv), (500, 4200));
        let after = debug(&mut board, 6000);
        assert_eq!((after.rejected_pulses, after.supply_mv), (1000, 5000));
        board.reset(Instant::from_millis(6500));
        assert_eq!(debug(&mut board, 6600).rejected_pulses, 0);
    }

    #[test]
    fn debug_data_counts_sweeps() {
        let scene = scene(&[]);
        let mut board = Sbs1::new(0x30, exact(), Instant::from_millis(500));
        let debug = parse_debug(&ask(&mut board, 8000, 0x03, &[], &scene)).unwrap();
        assert_eq!(debug, Debug { sweeps: 7, rejected_pulses: 1, supply_mv: 5000 });
    }
}
