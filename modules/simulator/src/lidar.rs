//! Lidars in the world: each device is emulated on the wire, and sees walls, columns and the legs of people.

use crate::faults::InjectedFault;
use crate::scene::Scene;
use base::serial::Word;
use base::{Duration, Instant};
use lidar::emulated::{DIRECTIONS, Device, Faults};
use lidar::sick::{Dialect, Family};
use lidar::{hokuyo, ld, rplidar, sick};
use navitools::Pose;
use std::f64::consts::TAU;

/// Interval at which a device's surroundings are looked at anew.
const LOOK: Duration = Duration::from_millis(25);
/// Standard deviation of a distance, m.
const NOISE_M: f64 = 0.01;
/// Time without supply of a device that restarts.
const RESTART: Duration = Duration::from_millis(300);
/// Least time between two moments at which the bytes on a line are handed on, as adapters do.
const PASSES: Duration = Duration::from_millis(2);
/// Bytes that are handed on at once.
const CHUNK: usize = 512;

/// A lidar.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarConfig {
    /// Its port's name, as its driver has it: `lidar.front`. The target of faults.
    pub bus: String,
    /// Rate of its line, Bd, as its driver has it.
    pub baud: u32,
    /// What it is.
    pub model: LidarModel,
    /// Where it sits on the robot; its front is along x.
    pub mount: Pose,
    /// It hangs upside down.
    pub upside_down: bool,
    /// Corners of the fields that a SICK evaluates, from its front on, m; `None`: as it is delivered.
    pub fields: Option<Vec<Vec<[f64; 2]>>>,
}

/// What a lidar is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LidarModel {
    /// LDROBOT.
    Ld(ld::Model),
    /// SLAMTEC.
    Rplidar(rplidar::Model),
    /// SICK.
    Sick(Family, Dialect),
    /// Hokuyo.
    Hokuyo(hokuyo::emulated::Model),
}

impl LidarModel {
    /// A Hokuyo that says this name: a URG-04LX, or one with 270° in steps of 0.25°.
    #[must_use]
    pub fn hokuyo(name: &'static str) -> Self {
        let like = match name {
            "URG-04LX" => hokuyo::emulated::Model::URG_04LX,
            _ => hokuyo::emulated::Model { name, ..hokuyo::emulated::Model::UTM_30LX },
        };
        Self::Hokuyo(like)
    }

    /// The device at power-on, with these fields, if it has any, and the distance up to which it sees, m.
    fn device(self, fields: Option<&[Vec<[f64; 2]>]>) -> (Box<dyn Device>, f64) {
        match self {
            Self::Ld(model) => (Box::new(ld::emulated::Device::new(model)), 12.0),
            Self::Rplidar(model) => {
                let reach = match model {
                    rplidar::Model::A3 => 25.0,
                    rplidar::Model::S2 => 30.0,
                    _ => 12.0,
                };
                (Box::new(rplidar::emulated::Device::new(model)), reach)
            }
            Self::Sick(family, dialect) => {
                let reach = f64::from(sick::Config::new(family, dialect).range_max_m);
                let device = sick::emulated::Device::new(family, dialect);
                let corner = |corner: &[f64; 2]| corner.map(|part| part as f32);
                let field = |field: &Vec<[f64; 2]>| -> sick::emulated::Field { field.iter().map(corner).collect() };
                let device = match fields {
                    Some(fields) => device.with_fields(fields.iter().map(field).collect()),
                    None => device,
                };
                (Box::new(device), reach)
            }
            Self::Hokuyo(model) => {
                let reach = f64::from(model.parameters.range_max_mm) / 1000.0;
                (Box::new(hokuyo::emulated::Device::new(model)), reach)
            }
        }
    }
}

/// All of them.
#[derive(Default)]
pub(crate) struct Lidars {
    all: Vec<Lidar>,
    /// Cosine and sine of the directions in which the devices look.
    directions: Vec<(f64, f64)>,
}

struct Lidar {
    config: LidarConfig,
    device: Box<dyn Device>,
    reach: f64,
    look: Instant,
    looks: u64,
    /// When the bytes on its line may be handed on again.
    pass: Instant,
    /// They are handed on now.
    passes: bool,
    /// Probabilities of a beam: of a distance that is none of anything, and of no echo.
    wild: f64,
    lost: f64,
    /// End of a fault.
    until: Instant,
}

impl Lidars {
    pub fn new(configs: &[LidarConfig], now: Instant) -> Self {
        let lidar = |config: &LidarConfig| {
            let (device, reach) = config.model.device(config.fields.as_deref());
            let (looks, wild, lost, until) = (0, 0.0, 0.0, Instant::NEVER);
            Lidar {
                config: config.clone(),
                device,
                reach,
                look: now,
                looks,
                pass: now,
                passes: false,
                wild,
                lost,
                until,
            }
        };
        let direction = |n| {
            let (sin, cos) = libm::sincos(n as f64 * TAU / DIRECTIONS as f64);
            (cos, sin)
        };
        Self { all: configs.iter().map(lidar).collect(), directions: (0..DIRECTIONS).map(direction).collect() }
    }

    pub fn on_words(&mut self, now: Instant, place: usize, words: &[Word]) {
        let Some(lidar) = self.all.get_mut(place) else { return };
        let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
        lidar.device.handle_rx(now, &bytes);
    }

    /// Lets all measure.
    pub fn handle_timeout(&mut self, now: Instant, scene: &Scene) {
        for (place, lidar) in self.all.iter_mut().enumerate() {
            if lidar.until <= now {
                *lidar.device.faults() = Faults::default();
                (lidar.wild, lidar.lost, lidar.until) = (0.0, 0.0, Instant::NEVER);
            }
            if lidar.look <= now {
                lidar.look = now + LOOK;
                lidar.looks += 1;
                lidar.sees(now, scene, &self.directions, (place as u64) << 32 | lidar.looks);
            }
            let due = lidar.device.poll_timeout().is_none_or(|due| due <= now);
            lidar.device.handle_timeout(now);
            if due && lidar.pass <= now {
                (lidar.pass, lidar.passes) = (now + PASSES, true);
            }
        }
    }

    /// Next bytes, and the place of their lidar.
    pub fn poll_tx(&mut self, now: Instant) -> Option<(usize, Vec<Word>)> {
        self.all.iter_mut().enumerate().filter(|(_, lidar)| lidar.passes).find_map(|(place, lidar)| {
            let mut bytes = [0; CHUNK];
            let count = lidar.device.poll_tx(now, &mut bytes);
            lidar.passes = count == CHUNK;
            (count > 0).then(|| (place, bytes[..count].iter().copied().map(Word::data).collect()))
        })
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let ends = self.all.iter().map(|lidar| lidar.until).filter(|until| *until < Instant::NEVER);
        // A line that carries bytes is due at once.
        let due = |lidar: &Lidar| lidar.device.poll_timeout().map(|due| due.max(lidar.pass));
        self.all.iter().filter_map(due).chain(ends).min()
    }

    /// Something is wrong with a lidar, or not any more; false if that is no target, or no fault of its kind.
    pub fn inject(&mut self, now: Instant, target: &str, injected: InjectedFault, until: Instant) -> bool {
        let Some(lidar) = self.all.iter_mut().find(|lidar| lidar.config.bus == target) else { return false };
        let usual = Faults::default();
        let (wild, lost) = match injected {
            InjectedFault::False(part) => (part, 0.0),
            InjectedFault::Loss(part) => (0.0, part),
            _ => (0.0, 0.0),
        };
        let (faults, until) = match injected {
            InjectedFault::False(_) | InjectedFault::Loss(_) => (usual, until),
            InjectedFault::Silent => (Faults { cut: true, ..usual }, until),
            InjectedFault::Garbled(part) => {
                (Faults { noise_per_mille: (1000.0 * part).clamp(1.0, 1000.0) as u16, ..usual }, until)
            }
            InjectedFault::Stuck => (Faults { repeats: true, ..usual }, until),
            InjectedFault::Blind => (Faults { blocked: true, ..usual }, until),
            InjectedFault::Stall(_) => (Faults { motor_stopped: true, ..usual }, until),
            InjectedFault::Reboot => (Faults { unpowered: true, ..usual }, now + RESTART),
            InjectedFault::None => (usual, Instant::NEVER),
            _ => return false,
        };
        *lidar.device.faults() = faults;
        (lidar.wild, lidar.lost, lidar.until) = (wild, lost, until);
        true
    }
}

impl Lidar {
    /// What it would measure in each direction now.
    fn sees(&mut self, now: Instant, scene: &Scene, directions: &[(f64, f64)], stream: u64) {
        let mut random = scene.random(stream ^ u64::from_le_bytes(*b"lidar   "));
        let distances = scene.view(self.config.mount, now, self.reach).distances(directions);
        let (wild, lost, reach) = (self.wild, self.lost, self.reach);
        let noisy = distances.into_iter().map(|distance| {
            let noisy = (distance + NOISE_M * random.normal()).max(0.0) as f32;
            if wild > 0.0 && random.uniform() < wild {
                (reach * random.uniform()) as f32
            } else if lost > 0.0 && random.uniform() < lost {
                f32::INFINITY
            } else {
                noisy
            }
        });
        let ranges = &mut self.device.scene().0;
        ranges.iter_mut().zip(noisy).for_each(|(range, noisy)| *range = noisy);
        if self.config.upside_down {
            // The front stays where it is.
            ranges[1..].reverse();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Parameters;
    use crate::sonar::Sonar;
    use crate::world::World;
    use lidar::{FieldResult, Zone};

    #[test]
    fn a_lidar_sees_the_walls_from_where_it_sits() {
        let mut world = World::hall(20.0, 12.0);
        world.start = Pose::new(5.0, 6.0, TAU / 4.0);
        let scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 1);
        // Half a metre ahead of the robot, looking to its right, which is along x of the hall.
        let config = |upside_down| LidarConfig {
            bus: "lidar.a".into(),
            baud: 230_400,
            model: LidarModel::Sick(Family::Tim7xx, Dialect::Binary),
            mount: Pose::new(0.5, 0.0, -TAU / 4.0),
            upside_down,
            fields: None,
        };
        for (upside_down, left, right) in [(false, 5.5, 6.5), (true, 6.5, 5.5)] {
            let mut lidars = Lidars::new(&[config(upside_down)], Instant::ZERO);
            lidars.handle_timeout(Instant::ZERO, &scene);
            let seen = lidars.all[0].device.scene();
            for (direction, distance) in [(0, 15.0), (DIRECTIONS / 4, left), (3 * DIRECTIONS / 4, right)] {
                assert!((f64::from(seen.0[direction]) - distance).abs() < 0.06, "{direction}: {}", seen.0[direction]);
            }
        }
    }

    #[test]
    fn a_sick_evaluates_the_fields_that_it_is_given_by_what_stands_in_them() {
        // A wall at 1.0 m ahead; the field ends before it, or reaches beyond it.
        let mut world = World::hall(20.0, 12.0);
        world.start = Pose::new(19.0, 6.0, 0.0);
        let scene = Scene::new(Instant::ZERO, world, Parameters::default(), Sonar::default(), 1);
        for (reach, result) in [(0.8, FieldResult::Free), (1.2, FieldResult::Infringed)] {
            let config = LidarConfig {
                bus: "lidar.a".into(),
                baud: 115_200,
                model: LidarModel::Sick(Family::Tim7xx, Dialect::Binary),
                mount: Pose::default(),
                upside_down: false,
                fields: Some(vec![vec![[0.0, -0.3], [reach, -0.3], [reach, 0.3], [0.0, 0.3]]]),
            };
            let mut lidars = Lidars::new(&[config], Instant::ZERO);
            let own = sick::Config { fields: true, ..sick::Config::new(Family::Tim7xx, Dialect::Binary) };
            let mut engine = sick::Sick::new(own);
            for now in (0..1500).map(Instant::from_millis) {
                lidars.handle_timeout(now, &scene);
                while let Some((_, words)) = lidars.poll_tx(now) {
                    let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                    engine.handle_rx(now, &bytes);
                }
                engine.handle_timeout(now);
                while let Some(request) = engine.poll_tx() {
                    let words: Vec<Word> = request.iter().copied().map(Word::data).collect();
                    lidars.on_words(now, 0, &words);
                }
                while engine.poll_event().is_some() {}
            }
            assert_eq!(engine.result(Zone::Field(1)), result, "{reach} m");
        }
    }

    fn ld19() -> LidarConfig {
        LidarConfig {
            bus: "lidar.a".into(),
            baud: 230_400,
            model: LidarModel::Ld(ld::Model::Ld19),
            mount: Pose::default(),
            upside_down: false,
            fields: None,
        }
    }

    #[test]
    fn beams_are_wild_or_have_no_echo_as_often_as_asked() {
        let scene = Scene::new(Instant::ZERO, World::hall(6.0, 6.0), Parameters::default(), Sonar::default(), 1);
        let mut lidars = Lidars::new(&[ld19()], Instant::ZERO);
        let seen = |lidars: &mut Lidars, now| {
            lidars.handle_timeout(now, &scene);
            lidars.all[0].device.scene().0
        };
        let ms = Instant::from_millis;
        let usual = seen(&mut lidars, ms(0));
        assert!(lidars.inject(ms(1), "lidar.a", InjectedFault::False(0.1), ms(50)));
        let wild = seen(&mut lidars, ms(25));
        let off = usual.iter().zip(&wild).filter(|(usual, wild)| (**usual - **wild).abs() > 0.1).count();
        assert!((DIRECTIONS / 13..DIRECTIONS / 9).contains(&off), "{off} of {DIRECTIONS}");
        assert!(lidars.inject(ms(26), "lidar.a", InjectedFault::Loss(0.5), ms(60)));
        let lost = seen(&mut lidars, ms(50)).iter().filter(|range| **range == f32::INFINITY).count();
        assert!((DIRECTIONS * 2 / 5..DIRECTIONS * 3 / 5).contains(&lost), "{lost} of {DIRECTIONS}");
        assert!(seen(&mut lidars, ms(75)).iter().all(|range| range.is_finite()), "it has ended");
    }

    #[test]
    fn a_fault_ends_by_itself_and_others_are_refused() {
        let scene = Scene::new(Instant::ZERO, World::hall(20.0, 12.0), Parameters::default(), Sonar::default(), 1);
        let mut lidars = Lidars::new(&[ld19()], Instant::ZERO);
        let ms = Instant::from_millis;
        assert!(lidars.inject(ms(0), "lidar.a", InjectedFault::Silent, ms(200)));
        assert!(!lidars.inject(ms(0), "lidar.a", InjectedFault::Hold, ms(200)));
        assert!(!lidars.inject(ms(0), "lidar.b", InjectedFault::Silent, ms(200)));
        let mut first = None;
        for now in (0..1000).map(ms) {
            lidars.handle_timeout(now, &scene);
            if lidars.poll_tx(now).is_some() {
                first.get_or_insert(now);
            }
        }
        // Its motor spins up meanwhile.
        assert!(first.is_some_and(|first| first >= ms(200)), "{first:?}");
    }
}
