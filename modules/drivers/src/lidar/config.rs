//! Which lidars there are, where they sit, and the engine of each.

use base::Duration;
use lidar::hokuyo::Hokuyo;
use lidar::ld::{self, LdLidar, NoEcho};
use lidar::rplidar::{self, Rplidar};
use lidar::sick::{self, Dialect, Sick};
use lidar::ydlidar::{self, Ydlidar};
use lidar::{Counters, Event, Fault, FieldResult, Lidar, Protocol, Text, Zone};
use settings::{Choice, Corners, settings};
use std::f64::consts::TAU;
use std::fmt;

/// Model of a lidar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// LDROBOT.
    Ld(ld::Model),
    /// SLAMTEC.
    Rplidar(rplidar::Model),
    /// YDLIDAR.
    Ydlidar(ydlidar::Model),
    /// SICK.
    Sick(sick::Family),
    /// Hokuyo, by the begin of its model.
    Hokuyo(&'static str),
}

/// Models by their names in the configuration.
pub const MODELS: Choice<Model> = Choice(&[
    ("ld06", Model::Ld(ld::Model::Ld06)),
    ("ld19", Model::Ld(ld::Model::Ld19)),
    ("stl-19p", Model::Ld(ld::Model::Stl19p)),
    ("rplidar-a1", Model::Rplidar(rplidar::Model::A1)),
    ("rplidar-a2", Model::Rplidar(rplidar::Model::A2)),
    ("rplidar-a3", Model::Rplidar(rplidar::Model::A3)),
    ("rplidar-c1", Model::Rplidar(rplidar::Model::C1)),
    ("rplidar-s2", Model::Rplidar(rplidar::Model::S2)),
    ("ydlidar-x4", Model::Ydlidar(ydlidar::Model::X4)),
    ("ydlidar-g4", Model::Ydlidar(ydlidar::Model::G4)),
    ("sick-lms1xx", Model::Sick(sick::Family::Lms1xx)),
    ("sick-tim5xx", Model::Sick(sick::Family::Tim5xx)),
    ("sick-tim7xx", Model::Sick(sick::Family::Tim7xx)),
    ("urg-04lx", Model::Hokuyo("URG-04LX")),
    ("utm-30lx", Model::Hokuyo("UTM-30LX")),
    ("ust-10lx", Model::Hokuyo("UST-10LX")),
    ("ust-20lx", Model::Hokuyo("UST-20LX")),
]);

const NO_ECHO: Choice<NoEcho> = Choice(&[("unknown", NoEcho::Unknown), ("nothing", NoEcho::Nothing)]);

const MODES: Choice<rplidar::Mode> = Choice(&[
    ("standard", rplidar::Mode::Standard),
    ("express", rplidar::Mode::Express),
    ("ultra", rplidar::Mode::Ultra),
    ("dense", rplidar::Mode::Dense),
]);

const DIALECTS: Choice<Dialect> = Choice(&[("cola-a", Dialect::Text), ("cola-b", Dialect::Binary)]);

settings! {
    /// Keys of `[lidar.<name>]` for the driver.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct LidarKeys {
        /// Model; a device that says that it is another one is refused.
        model: Model = required, MODELS;
        /// Where it sits: forward from the robot's reference point.
        x_m as x: f64 = 0.0, -20.0..=20.0;
        /// Where it sits: to the left.
        y_m as y: f64 = 0.0, -20.0..=20.0;
        /// Direction of its front in the robot, counter-clockwise.
        theta_rad as theta: f64 = 0.0, -7.0..=7.0;
        /// It hangs upside down.
        upside_down: bool = false;
        /// Opening angle around its front that is used; the robot itself is outside of it. Absent: all that the model
        /// sees.
        view_rad as view: Option<f64> = optional, 0.1..=6.3;
        /// Distance up to which it surely measures the darkest surface around; where nothing was received it is free up
        /// to there. Absent: the longest range of the model.
        range_max_m as range_max: Option<f64> = optional, 0.1..=200.0;
        /// LDROBOT, SLAMTEC, YDLIDAR, SICK: what a range of 0 means: `"unknown"`, or `"nothing"` was received, for a
        /// device and a place where near and dark things were shown not to read 0.
        no_echo: NoEcho = NoEcho::Unknown, NO_ECHO;
        /// SLAMTEC: what is asked for, single samples or capsules. Absent: `"express"` of an A1 and A2, `"ultra"` of an
        /// A3, `"dense"` of a C1 and S2.
        mode: Option<rplidar::Mode> = optional, MODES;
        /// SICK: protocol, as set in the device.
        dialect: Dialect = Dialect::Binary, DIALECTS;
    }
}

settings! {
    /// Keys of `[lidar.<name>]` about what a SICK evaluates by itself (docs/lidars.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct StopKeys {
        /// SICK LMS1xx, TiM7xx: numbers of the fields of the device that stop the robot as PAUSE does, while one of
        /// them is infringed, not valid, or not reported.
        stop_fields: Vec<u16> = Vec::new(), 1..=48;
        /// SICK: numbers of the switching outputs of the device that stop the robot as PAUSE does, while one of them is
        /// not active, or not reported.
        stop_outputs: Vec<u16> = Vec::new(), 1..=16;
        /// In simulation: corners of the fields of the device, by number, from its front on; each switches the output
        /// of its number. Absent: one field, a square of 2 m around it.
        simulated_fields_m as simulated_fields: Option<Vec<Vec<[f64; 2]>>> = optional, Corners(-50.0..=50.0);
    }
}

impl StopKeys {
    /// True if something that the device evaluates stops the robot.
    #[must_use]
    pub fn stops(&self) -> bool {
        self.zones().next().is_some()
    }

    /// What of it stops the robot.
    pub fn zones(&self) -> impl Iterator<Item = Zone> + '_ {
        // At most 48, by their rules.
        let fields = self.stop_fields.iter().map(|number| Zone::Field(*number as u8));
        fields.chain(self.stop_outputs.iter().map(|number| Zone::Output(*number as u8)))
    }
}

/// A lidar.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// Its name in the configuration.
    pub name: String,
    /// Its port.
    pub bus: String,
    /// Rate of its serial line, Bd; `None`: a TCP connection.
    pub baud: Option<u32>,
    /// Its keys.
    pub keys: LidarKeys,
    /// What of it stops the robot.
    pub stop: StopKeys,
}

/// All lidars.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// At most [`DEVICES_MAX`].
    pub devices: Vec<Device>,
}

/// Lidars of a robot at most.
pub const DEVICES_MAX: usize = 16;

impl LidarKeys {
    /// Opening angle that is used, around its front, rad.
    #[must_use]
    pub fn view_rad(&self) -> f64 {
        let all = self.model.view_rad();
        self.view.map_or(all, |used| used.min(all))
    }
}

impl Device {
    /// Rate of its line, Bd; of a TCP connection that of Ethernet with 100 Mbit/s.
    #[must_use]
    pub fn line_baud(&self) -> u32 {
        self.baud.unwrap_or(100_000_000)
    }
}

impl Model {
    /// Opening angle of what it sees, around its front, rad (data sheets of the makers).
    #[must_use]
    pub fn view_rad(self) -> f64 {
        match self {
            Self::Ld(_) | Self::Rplidar(_) | Self::Ydlidar(_) => TAU,
            Self::Hokuyo("URG-04LX") => TAU * 240.0 / 360.0,
            Self::Sick(_) | Self::Hokuyo(_) => TAU * 270.0 / 360.0,
        }
    }

    /// True if it evaluates fields by itself, and reports their results.
    #[must_use]
    pub fn has_fields(self) -> bool {
        matches!(self, Self::Sick(sick::Family::Lms1xx | sick::Family::Tim7xx))
    }

    /// True if it has switching outputs that go by what it evaluates, and reports them.
    #[must_use]
    pub fn has_outputs(self) -> bool {
        matches!(self, Self::Sick(_))
    }

    /// True if DTR of its adapter has to be low: an RPLIDAR A1 turns only then, and the others do not heed it. The SDK
    /// of SLAMTEC lowers it for all of them.
    #[must_use]
    pub fn wants_dtr_low(self) -> bool {
        matches!(self, Self::Rplidar(_))
    }

    /// Rate of a serial line as the device is delivered, Bd.
    #[must_use]
    pub fn usual_baud(self) -> u32 {
        match self {
            Self::Ld(_) => 230_400,
            Self::Rplidar(model) => model.baud(),
            Self::Ydlidar(model) => model.baud(),
            Self::Sick(_) | Self::Hokuyo(_) => 115_200,
        }
    }
}

/// An engine of whatever protocol.
pub(super) trait Engine: fmt::Debug {
    fn handle_rx(&mut self, now: base::Instant, bytes: &[u8]);
    fn handle_closed(&mut self, now: base::Instant);
    fn handle_timeout(&mut self, now: base::Instant);
    fn poll_tx(&mut self) -> Option<lidar::Bytes>;
    fn poll_event(&mut self) -> Option<Event<'_>>;
    fn poll_timeout(&self) -> Option<base::Instant>;
    fn counters(&self) -> &Counters;
    fn result(&self, zone: Zone) -> FieldResult;
    fn is_active(&self, fault: Fault) -> bool;
    fn meaning(&self) -> &Text;
    fn error(&self) -> Option<(u32, &Text)>;
}

impl<P: Protocol + fmt::Debug> Engine for Lidar<P> {
    fn handle_rx(&mut self, now: base::Instant, bytes: &[u8]) {
        self.handle_rx(now, bytes);
    }

    fn handle_closed(&mut self, now: base::Instant) {
        self.handle_closed(now);
    }

    fn handle_timeout(&mut self, now: base::Instant) {
        self.handle_timeout(now);
    }

    fn poll_tx(&mut self) -> Option<lidar::Bytes> {
        self.poll_tx()
    }

    fn poll_event(&mut self) -> Option<Event<'_>> {
        self.poll_event()
    }

    fn poll_timeout(&self) -> Option<base::Instant> {
        self.poll_timeout()
    }

    fn counters(&self) -> &Counters {
        self.counters()
    }

    fn is_active(&self, fault: Fault) -> bool {
        self.is_active(fault)
    }

    fn meaning(&self) -> &Text {
        self.meaning()
    }

    fn error(&self) -> Option<(u32, &Text)> {
        self.error()
    }

    fn result(&self, zone: Zone) -> FieldResult {
        self.result(zone)
    }
}

/// The engine of a device.
pub(super) fn engine(device: &Device) -> Box<dyn Engine> {
    let LidarKeys { model, no_echo, mode, dialect, .. } = device.keys;
    match model {
        Model::Ld(model) => Box::new(LdLidar::new(ld::Config { model, no_echo })),
        Model::Rplidar(model) => {
            let usual = rplidar::Config::new(model);
            Box::new(Rplidar::new(rplidar::Config { mode: mode.unwrap_or(usual.mode), no_echo, ..usual }))
        }
        Model::Ydlidar(model) => Box::new(Ydlidar::new(ydlidar::Config { model, no_echo })),
        Model::Sick(family) => {
            let StopKeys { stop_fields, stop_outputs, .. } = &device.stop;
            let (fields, outputs) = (!stop_fields.is_empty(), !stop_outputs.is_empty());
            Box::new(Sick::new(sick::Config { no_echo, fields, outputs, ..sick::Config::new(family, dialect) }))
        }
        Model::Hokuyo(model) => {
            let bytes_per_s = device.baud.map_or(0, |baud| baud / 10);
            Box::new(Hokuyo::new(lidar::hokuyo::Config { bytes_per_s, ..lidar::hokuyo::Config::new(model) }))
        }
    }
}

/// Period of the statistics of lines.
pub(super) const BUS_PERIOD: Duration = Duration::from_secs(1);
