//! A master and a drive as its data sheet describes it, a millisecond at a time on a wire that takes none.

use base::{Duration, Instant};
use canopen::axis::drive::Kind;
use canopen::axis::modes::Mode;
use canopen::axis::modes::pp::Setpoint;
use canopen::axis::options::Options;
use canopen::axis::servo::Config;
use canopen::axis::servo::twin::{Load, Twin};
use canopen::axis::{Axis, Goal, PowerState};
use canopen::drives::derive::{Derived, Ratio};
use canopen::eds::Eds;
use canopen::wire::Service;
use canopen::{Event, Master, MasterConfig};

pub const NODE: u8 = 5;
/// SYNC of the cyclic modes.
pub const PERIOD: Duration = Duration::from_millis(10);
const MS: Duration = Duration::from_millis(1);
/// Increments per turn of the emulated motor, where the sheet leaves them open.
const COUNTS: u64 = 4096;

pub struct Rig {
    pub now: Instant,
    pub derived: Derived,
    pub twin: Twin,
    pub axis: Axis,
    /// Target, in SI.
    pub target: f64,
    /// Actual value of the drive in SI, as it was received.
    pub value: f64,
    /// The master is dead: nothing is exchanged.
    pub alone: bool,
    master: Master,
    setpoint: Setpoint,
    booted: bool,
    failure: Option<String>,
}

fn value(ratio: Ratio) -> f64 {
    let (above, below) = ratio.parts();
    above as f64 / below as f64
}

impl Rig {
    /// Both, switched on.
    pub fn new(eds: &Eds, derived: Derived) -> Self {
        let now = Instant::from_millis(1000);
        let scale = derived.scale;
        let counts = value(scale.position.or(Ratio::new(COUNTS, 1)).expect("no zero"));
        let keeps = derived.table.keeps_quick_stop;
        let config = Config {
            kind: Kind::Standard { enables_from_ready: true },
            // What the sheet leaves open, its manual would say.
            options: Options { quick_stop: if keeps { 6 } else { 2 }, ..Options::default() },
            velocity: counts / value(scale.velocity),
            acceleration: counts / value(scale.acceleration),
            index: counts,
            following_fault: false,
            ..Config::default()
        };
        let load = Load { negative: f64::NEG_INFINITY, positive: f64::INFINITY, ..Load::default() };
        let mut twin = Twin::new(eds.dictionary(NODE), MS * 10, config, load);
        twin.power_on(now);
        let cyclic = matches!(derived.table.mode, Mode::CyclicPosition | Mode::CyclicVelocity);
        let config = MasterConfig { sync: cyclic.then_some(PERIOD), ..MasterConfig::default() };
        let node = derived.table.node_config("drive", &derived.parameters);
        Self {
            now,
            master: Master::new(config, &[node]).expect("a valid configuration"),
            axis: Axis::new(derived.table.axis_config()),
            derived,
            twin,
            target: 0.0,
            value: f64::NAN,
            alone: false,
            setpoint: Setpoint::new(MS * 100),
            booted: false,
            failure: None,
        }
    }

    /// Speed of the motor, turns of the output per second times what a turn is; by the load itself.
    pub fn speed(&self, turns_per_si: f64) -> f64 {
        let counts = value(self.derived.scale.position.or(Ratio::new(COUNTS, 1)).expect("no zero"));
        self.twin.load.speed / counts / turns_per_si
    }

    /// Boots the drive and enables its axis.
    pub fn enable(&mut self) -> Result<(), String> {
        for _ in 0..3000 {
            self.run(1);
            if self.booted || self.failure.is_some() {
                break;
            }
        }
        if let Some(failure) = self.failure.take().or((!self.booted).then(|| "does not boot".into())) {
            return Err(failure);
        }
        self.axis.set_goal(self.now, Goal::Enabled);
        self.run(300);
        let (state, enabled) = (self.axis.state(), self.axis.is_enabled());
        if enabled { Ok(()) } else { Err(format!("stays {state:?}")) }
    }

    pub fn state(&self) -> Option<PowerState> {
        self.axis.state()
    }

    pub fn go(&mut self, goal: Goal) {
        self.axis.set_goal(self.now, goal);
    }

    /// Advances the time by this number of milliseconds.
    pub fn run(&mut self, millis: u32) {
        for _ in 0..millis {
            self.now += MS;
            self.twin.handle_timeout(self.now);
            if self.alone {
                while self.twin.poll_tx().is_some() {}
                continue;
            }
            self.master.handle_timeout(self.now);
            for _ in 0..20 {
                self.exchange();
            }
            self.axis.handle_timeout(self.now);
            self.setpoint.handle_timeout(self.now);
            if self.booted {
                self.command();
            }
        }
    }

    fn exchange(&mut self) {
        while let Some(frame) = self.master.poll_tx() {
            self.twin.handle_rx(self.now, &frame);
        }
        while let Some(frame) = self.twin.poll_tx() {
            let known = match Service::of(&frame) {
                Some(Service::Tpdo { number, .. }) => self.derived.table.unpack(number, frame.data()).is_some(),
                _ => true,
            };
            assert!(known, "a TPDO that is not used: {frame:?}");
            self.master.handle_rx(self.now, &frame);
        }
        while let Some(event) = self.master.poll_event() {
            match event {
                Event::Booted { .. } => {
                    self.booted = true;
                    let read = self.master.sdo_read(self.now, NODE, 0x6041, 0);
                    read.expect("a free channel");
                }
                Event::BootFailed { step, reason, .. } => self.failure = Some(format!("{step}: {reason}")),
                Event::SdoRead { index: 0x6041, data, .. } => {
                    self.on_statusword(data.bits().expect("16 bits") as u16);
                }
                Event::Pdo { number, data, len, .. } => {
                    let status = self.derived.table.unpack(number, &data[..usize::from(len)]).expect("one of these");
                    if let Some(value) = status.value {
                        let units = &self.derived.units;
                        let velocity = self.derived.table.value >> 16 == 0x606C;
                        self.value = if velocity { units.velocity_si(value) } else { units.position_si(value) };
                    }
                    if let Some(statusword) = status.statusword {
                        self.on_statusword(statusword);
                    }
                }
                _ => {}
            }
        }
    }

    fn on_statusword(&mut self, statusword: u16) {
        self.axis.handle_statusword(self.now, statusword);
        self.setpoint.handle_statusword(self.now, statusword);
    }

    fn command(&mut self) {
        let (table, units) = (&self.derived.table, &self.derived.units);
        let mut word = self.axis.controlword();
        let enabled = self.axis.is_enabled();
        let target = match table.mode {
            Mode::ProfileVelocity | Mode::CyclicVelocity if enabled => units.velocity(self.target),
            Mode::CyclicPosition => units.position(self.target),
            Mode::ProfilePosition if enabled => {
                self.setpoint.set(self.now, units.position(self.target));
                let (bits, target) = self.setpoint.command();
                word |= bits;
                target
            }
            _ => 0,
        };
        let data = table.pack(word, target);
        // A full queue is emptied by the next turn.
        let _ = self.master.send_pdo(NODE, table.rpdo.number, &data);
    }
}
