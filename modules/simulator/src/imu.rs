//! Inertial measurement units on the body: each device is emulated on the wire, and measures how the body moves.

use crate::faults::{InjectedFault, parts_per_million};
use crate::scene::Scene;
use base::can::Frame;
use base::i2c::{Error, Outcome, Transfer};
use base::serial::Word;
use base::{Duration, Instant};
use imu::Model;
use imu::emulated::{Emulated, Faults, Truth};
use imu::frame::Rotation;
use kinematics::Twist;

/// Standard deviation of the acceleration, m/s².
const ACCELERATION_NOISE_MPS2: f64 = 0.02;
/// Standard deviation of the rotation, rad/s.
const ROTATION_NOISE_RADPS: f64 = 0.003;
/// The zero of each axis of a gyroscope is up to this off, constant for a run, rad/s.
const ZERO_MAX_RADPS: f64 = 0.01;
/// Acceleration of gravity, m/s².
const GRAVITY_MPS2: f64 = 9.81;
/// In the box of the robot, °C.
const TEMPERATURE_C: f64 = 30.0;
/// Time without supply of a device that restarts.
const RESTART: Duration = Duration::from_millis(300);
/// Bytes that are handed on at once.
const CHUNK: usize = 256;

/// An inertial measurement unit.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuConfig {
    /// Its name with its kind, the target of faults: `imu.base`.
    pub name: String,
    /// Port of its own serial line, or the name of the bus that it is on.
    pub bus: String,
    /// Rate of its own line, Bd, as its driver has it; `None`: it is on a bus.
    pub baud: Option<u32>,
    /// What it is.
    pub model: Model,
    /// Roll, pitch and yaw by which it is mounted, rad.
    pub mount: [f64; 3],
}

/// All of them.
#[derive(Default)]
pub(crate) struct Imus(Vec<Unit>);

struct Unit {
    config: ImuConfig,
    device: Emulated,
    device_from_robot: Rotation,
    /// Number of the serial line, among those of all units.
    line: Option<usize>,
    zero: [f64; 3],
    /// What `biased` adds to the zero about the robot's vertical axis, rad/s.
    biased: f64,
    /// When it measured last, and how the body moved then.
    last: (Instant, Twist),
    measurements: u64,
    /// End of a fault.
    until: Instant,
}

impl Imus {
    pub fn new(configs: &[ImuConfig], now: Instant, scene: &Scene) -> Self {
        let mut lines = 0..;
        let unit = |(place, config): (u64, &ImuConfig)| {
            let mut random = scene.random(place << 32 ^ u64::from_le_bytes(*b"imu zero"));
            let [roll, pitch, yaw] = config.mount;
            Unit {
                config: config.clone(),
                device: Emulated::new(config.model),
                device_from_robot: Rotation::from_angles(roll, pitch, yaw).inverse(),
                line: config.baud.and_then(|_| lines.next()),
                zero: std::array::from_fn(|_| ZERO_MAX_RADPS * (2.0 * random.uniform() - 1.0)),
                biased: 0.0,
                last: (now, Twist::ZERO),
                measurements: 0,
                until: Instant::NEVER,
            }
        };
        Self((0..).zip(configs).map(unit).collect())
    }

    /// Lets all measure.
    pub fn handle_timeout(&mut self, now: Instant, scene: &Scene) {
        for (place, unit) in (0..).zip(&mut self.0) {
            if unit.until <= now {
                unit.set_faults(Faults::default(), 0.0, Instant::NEVER);
            }
            if unit.device.poll_timeout().is_some_and(|due| due <= now) {
                unit.measure(now, scene, place);
            }
            unit.device.handle_timeout(now);
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let ends = self.0.iter().map(|unit| unit.until).filter(|until| *until < Instant::NEVER);
        self.0.iter().filter_map(|unit| unit.device.poll_timeout()).chain(ends).min()
    }

    /// Next bytes, and the number of the serial line that they are on.
    pub fn poll_tx(&mut self) -> Option<(usize, Vec<Word>)> {
        self.0.iter_mut().find_map(|unit| {
            let mut bytes = [0; CHUNK];
            let count = unit.device.poll_tx(&mut bytes);
            let line = unit.line.filter(|_| count > 0)?;
            Some((line, bytes[..count].iter().copied().map(Word::data).collect()))
        })
    }

    /// The next frame on the CAN bus.
    pub fn poll_frame(&mut self) -> Option<Frame> {
        self.0.iter_mut().find_map(|unit| unit.device.poll_frame())
    }

    /// Outcome of a transfer on an I2C bus; `None`: no unit there answers at this address.
    pub fn answer(&mut self, now: Instant, bus: &str, transfer: &Transfer) -> Option<Outcome> {
        let on_bus = self.0.iter_mut().filter(|unit| unit.config.bus == bus);
        on_bus.map(|unit| unit.device.handle_transfer(now, transfer)).find(|outcome| *outcome != Err(Error::NoAddress))
    }

    /// Something is wrong with a unit, or not any more; false if that is no target, or no fault of its kind.
    pub fn inject(&mut self, now: Instant, target: &str, injected: InjectedFault, until: Instant) -> bool {
        let Some(unit) = self.0.iter_mut().find(|unit| unit.config.name == target) else { return false };
        let usual = Faults::default();
        let (faults, biased, until) = match injected {
            InjectedFault::Silent => (Faults { cut: true, ..usual }, 0.0, until),
            InjectedFault::Garbled(part) => (Faults { noise_ppm: parts_per_million(part), ..usual }, 0.0, until),
            InjectedFault::Stuck => (Faults { frozen: true, ..usual }, 0.0, until),
            InjectedFault::Wrong => (Faults { acceleration_excess: -0.9, ..usual }, 0.0, until),
            InjectedFault::Biased(by) => (usual, by, until),
            InjectedFault::Reboot => (Faults { unpowered: true, ..usual }, 0.0, now + RESTART),
            InjectedFault::None => (usual, 0.0, Instant::NEVER),
            _ => return false,
        };
        unit.set_faults(faults, biased, until);
        true
    }
}

impl Unit {
    fn set_faults(&mut self, faults: Faults, biased: f64, until: Instant) {
        *self.device.faults() = faults;
        (self.biased, self.until) = (biased, until);
    }

    /// What it is exposed to now, with its errors.
    fn measure(&mut self, now: Instant, scene: &Scene, place: u64) {
        self.measurements += 1;
        let mut random = scene.random(place << 32 ^ self.measurements ^ u64::from_le_bytes(*b"imu     "));
        let twist = scene.body().twist();
        let (last, before) = std::mem::replace(&mut self.last, (now, twist));
        let seconds = now.since(last).as_secs_f64();
        let change = |new: f64, old: f64| if seconds > 0.0 { (new - old) / seconds } else { 0.0 };
        // The frame in which the velocity is given turns with the robot.
        let forward = change(twist.vx, before.vx) - twist.omega * twist.vy;
        let left = change(twist.vy, before.vy) + twist.omega * twist.vx;
        let acceleration = self.device_from_robot.apply([forward, left, GRAVITY_MPS2]);
        let rotation = self.device_from_robot.apply([0.0, 0.0, twist.omega + self.biased]);
        let level = Rotation::from_angles(0.0, 0.0, scene.body().pose().theta.radians());
        self.device.set(Truth {
            acceleration_mps2: acceleration.map(|value| value + ACCELERATION_NOISE_MPS2 * random.normal()),
            rotation_radps: std::array::from_fn(|n| {
                rotation[n] + self.zero[n] + ROTATION_NOISE_RADPS * random.normal()
            }),
            orientation: level.after(self.device_from_robot.inverse()).quaternion(),
            temperature_c: TEMPERATURE_C,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Demand, Parameters};
    use crate::sonar::Sonar;
    use crate::world::World;
    use imu::{Event, Imu};

    fn config(mount: [f64; 3]) -> ImuConfig {
        let (name, model) = ("imu.base".into(), Model::WitMotion);
        ImuConfig { name, bus: "imu.base".into(), baud: Some(115_200), model, mount }
    }

    fn scene() -> Scene {
        Scene::new(Instant::ZERO, World::hall(20.0, 12.0), Parameters::default(), Sonar::exact(), 1)
    }

    /// Samples of a second and a half from the body's start with this demand, by an engine on the line.
    fn samples(mount: [f64; 3], demand: Demand) -> (Vec<imu::Sample>, f64) {
        let mut scene = scene();
        let mut imus = Imus::new(&[config(mount)], Instant::ZERO, &scene);
        let mut engine = Imu::new(Model::WitMotion);
        scene.demand = demand;
        let mut samples = Vec::new();
        for now in (0..1500).map(Instant::from_millis) {
            while scene.next_step() <= now {
                scene.step();
            }
            imus.handle_timeout(now, &scene);
            while let Some((0, words)) = imus.poll_tx() {
                let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                engine.handle_rx(now, &bytes);
            }
            engine.handle_timeout(now);
            while let Some(event) = engine.poll_event() {
                samples.extend(if let Event::Sample(sample) = event { Some(sample) } else { None });
            }
        }
        (samples, scene.body().twist().omega)
    }

    #[test]
    fn a_unit_measures_how_the_body_moves_in_its_own_frame() {
        let mean = |samples: &[imu::Sample], of: fn(&imu::Sample) -> f64| {
            samples.iter().map(of).sum::<f64>() / samples.len() as f64
        };
        // Speeds up along its x axis, then along its y axis to the right.
        for (yaw, axis, sign) in [(0.0, 0, 1.0), (std::f64::consts::FRAC_PI_2, 1, -1.0)] {
            let (samples, _) = samples([0.0, 0.0, yaw], Demand { steering: Some(0.0), ..Demand::speed(0.5) });
            let speeds_up = samples[..10].iter().map(|sample| sign * sample.acceleration_mps2[axis]);
            assert!(speeds_up.fold(0.0, f64::max) > 0.3, "{:?}", &samples[..10]);
            assert!((mean(&samples, |sample| sample.acceleration_mps2[2]) - 9.81).abs() < 0.01);
        }
        // In a curve, hanging upside down.
        let (samples, omega) =
            samples([std::f64::consts::PI, 0.0, 0.0], Demand { steering: Some(0.4), ..Demand::speed(0.5) });
        let end = &samples[samples.len() - 20..];
        let turned = mean(end, |sample| sample.rotation_radps[2]);
        assert!(omega > 0.2 && (turned + omega).abs() < ZERO_MAX_RADPS + 0.01, "{turned} {omega}");
        assert!((mean(end, |sample| sample.acceleration_mps2[2]) + 9.81).abs() < 0.02);
    }

    #[test]
    fn a_fault_ends_by_itself_and_others_are_refused() {
        let scene = scene();
        let ms = Instant::from_millis;
        let mut imus = Imus::new(&[config([0.0; 3])], ms(0), &scene);
        assert!(imus.inject(ms(0), "imu.base", InjectedFault::Silent, ms(200)));
        assert!(!imus.inject(ms(0), "imu.base", InjectedFault::Hold, ms(200)));
        assert!(!imus.inject(ms(0), "imu.top", InjectedFault::Silent, ms(200)));
        let mut first = None;
        for now in (0..1000).map(ms) {
            imus.handle_timeout(now, &scene);
            if imus.poll_tx().is_some() {
                first.get_or_insert(now);
            }
        }
        assert_eq!(first, Some(ms(200)));
    }
}
