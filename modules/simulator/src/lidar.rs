//! Lidars in the world: each device is emulated on the wire, and sees walls, columns and the legs of people.

use crate::faults::{InjectedFault, parts_per_million};
use crate::scene::Scene;
use base::serial::Word;
use base::{Duration, Instant};
use lidar::emulated::{DIRECTIONS, Device, Faults};
use lidar::sick::{Dialect, Family};
use lidar::{hokuyo, ld, rplidar, sick, ydlidar};
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
    /// YDLIDAR.
    Ydlidar(ydlidar::Model),
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
            Self::Ydlidar(model) => {
                let reach = match model {
                    ydlidar::Model::X4 => 10.0,
                    ydlidar::Model::G4 => 16.0,
                };
                (Box::new(ydlidar::emulated::Device::new(model)), reach)
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
            InjectedFault::Garbled(part) => (Faults { noise_ppm: parts_per_million(part), ..usual }, until),
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
    /// What it would measure now in each direction in which it may measure until it looks anew.
    fn sees(&mut self, now: Instant, scene: &Scene, directions: &[(f64, f64)], stream: u64) {
        let (first, count) = self.device.measures(self.look);
        if count == 0 {
            return;
        }
        // The front stays where it is if the device hangs upside down.
        let turned = |place: usize| (2 * DIRECTIONS - place) % DIRECTIONS;
        let first = if self.config.upside_down { turned(first + count - 1) } else { first };
        let mut random = scene.random(stream ^ u64::from_le_bytes(*b"lidar   "));
        let distances = scene.view(self.config.mount, now, self.reach).distances(directions, (first, count));
        let (wild, lost, reach) = (self.wild, self.lost, self.reach);
        let upside_down = self.config.upside_down;
        let ranges = &mut self.device.scene().0;
        // Each direction has its chance, whichever are measured: it depends on all before it.
        let mut skipped = 0;
        for place in 0..DIRECTIONS {
            let ray = (place + DIRECTIONS - first) % DIRECTIONS;
            if wild == 0.0 && lost == 0.0 && ray >= count {
                skipped += 1;
                continue;
            }
            random.skip_normals(std::mem::take(&mut skipped));
            let chance = NOISE_M * random.normal();
            let range = if wild > 0.0 && random.uniform() < wild {
                (reach * random.uniform()) as f32
            } else if lost > 0.0 && random.uniform() < lost {
                f32::INFINITY
            } else {
                (distances.get(ray).copied().unwrap_or(f64::INFINITY) + chance).max(0.0) as f32
            };
            if ray < count {
                ranges[if upside_down { turned(place) } else { place }] = range;
            }
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
        // One that looks all around at once.
        let model = LidarModel::Sick(Family::Tim7xx, Dialect::Binary);
        let mut lidars = Lidars::new(&[LidarConfig { model, ..ld19() }], Instant::ZERO);
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

    /// A device that is shown all around.
    struct All(Box<dyn Device>);

    impl Device for All {
        fn faults(&mut self) -> &mut Faults {
            self.0.faults()
        }

        fn scene(&mut self) -> &mut lidar::emulated::Scene {
            self.0.scene()
        }

        fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
            self.0.handle_rx(now, bytes);
        }

        fn handle_timeout(&mut self, now: Instant) {
            self.0.handle_timeout(now);
        }

        fn poll_tx(&mut self, now: Instant, bytes: &mut [u8]) -> usize {
            self.0.poll_tx(now, bytes)
        }

        fn poll_timeout(&self) -> Option<Instant> {
            self.0.poll_timeout()
        }
    }

    /// An engine that commands its device.
    trait Engine {
        fn take(&mut self, now: Instant, bytes: &[u8]);
        /// What it sends.
        fn serve(&mut self, now: Instant) -> Vec<lidar::Bytes>;
    }

    impl<P: lidar::Protocol> Engine for lidar::Lidar<P> {
        fn take(&mut self, now: Instant, bytes: &[u8]) {
            self.handle_rx(now, bytes);
        }

        fn serve(&mut self, now: Instant) -> Vec<lidar::Bytes> {
            self.handle_timeout(now);
            while self.poll_event().is_some() {}
            std::iter::from_fn(|| self.poll_tx()).collect()
        }
    }

    #[test]
    fn a_device_that_is_shown_what_it_measures_next_sends_the_same_bytes_as_one_that_is_shown_all() {
        let mut world = World::hall(6.0, 5.0);
        world.start = Pose::new(1.2, 2.0, 0.4);
        world.columns.push(crate::world::Column { centre: navitools::Point { x: 1.3, y: 2.5 }, radius: 0.2 });
        world.places = vec![navitools::Point { x: 4.5, y: 1.0 }, navitools::Point { x: 4.0, y: 4.0 }];
        world.people.count = 5;
        let models = [ld::Model::Ld06, ld::Model::Ld19].map(LidarModel::Ld).into_iter();
        let models = models.chain(
            [rplidar::Model::A1, rplidar::Model::A2, rplidar::Model::A3, rplidar::Model::C1, rplidar::Model::S2]
                .map(LidarModel::Rplidar),
        );
        let models = models.chain([ydlidar::Model::X4, ydlidar::Model::G4].map(LidarModel::Ydlidar));
        let ms = Instant::from_millis;
        for (n, model) in models.enumerate() {
            let config = LidarConfig { model, upside_down: n % 2 == 1, mount: Pose::new(0.2, 0.1, 0.7), ..ld19() };
            let mut scene = Scene::new(Instant::ZERO, world.clone(), Parameters::default(), Sonar::default(), 1);
            let mut some = Lidars::new(&[config], Instant::ZERO);
            let mut all = Lidars::new(&[some.all[0].config.clone()], Instant::ZERO);
            let inner = std::mem::replace(&mut all.all[0].device, Box::new(ld::emulated::Device::new(ld::Model::Ld19)));
            all.all[0].device = Box::new(All(inner));
            let mut random = crate::random::Random::new(n as u64);
            let (mut now, mut sent) = (Instant::ZERO, 0);
            let mut engine: Option<Box<dyn Engine>> = match model {
                LidarModel::Rplidar(model) => Some(Box::new(rplidar::Rplidar::new(rplidar::Config::new(model)))),
                LidarModel::Ydlidar(model) => Some(Box::new(ydlidar::Ydlidar::new(ydlidar::Config::new(model)))),
                _ => None,
            };
            while now < ms(9000) {
                // As the simulator is called: now and then, and late.
                now += Duration::from_micros(100 + (9000.0 * random.uniform()) as u64);
                for (from, fault) in [
                    (3000, InjectedFault::Stall(0)),
                    (3600, InjectedFault::None),
                    (4500, InjectedFault::False(0.05)),
                    (5200, InjectedFault::Loss(0.2)),
                    (6000, InjectedFault::Reboot),
                ] {
                    if (ms(from)..ms(from + 5)).contains(&now) {
                        assert!(some.inject(now, "lidar.a", fault, ms(from + 400)));
                        assert!(all.inject(now, "lidar.a", fault, ms(from + 400)));
                    }
                }
                scene.demand = crate::body::Demand::speed(0.2);
                while scene.next_step() <= now {
                    scene.step();
                }
                some.handle_timeout(now, &scene);
                all.handle_timeout(now, &scene);
                loop {
                    let words = some.poll_tx(now);
                    assert_eq!(words, all.poll_tx(now), "{model:?} at {now:?}");
                    let Some((_, words)) = words else { break };
                    sent += words.len();
                    let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                    engine.iter_mut().for_each(|engine| engine.take(now, &bytes));
                }
                if let Some(engine) = &mut engine {
                    for request in engine.serve(now) {
                        let words: Vec<Word> = request.iter().copied().map(Word::data).collect();
                        some.on_words(now, 0, &words);
                        all.on_words(now, 0, &words);
                    }
                }
            }
            assert!(sent > 20_000, "{model:?}: {sent} bytes");
        }
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
