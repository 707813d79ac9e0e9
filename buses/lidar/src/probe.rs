//! What is at the other end of a line: a device is identified without a configuration, for tools that commission it.
//!
//! A [`Probe`] asks for identity and state in one protocol, and changes nothing in the device: it starts no scan, no
//! motor and no measurement, and logs in nowhere. An LDROBOT is not asked at all, since it sends by itself. One
//! exception: an RPLIDAR or YDLIDAR that scans answers nothing else, so if bytes arrive instead of an answer its scan
//! is stopped before it is asked once more.
//!
//! | protocol | asked for |
//! |---|---|
//! | LDROBOT | nothing; packets with a right checksum |
//! | RPLIDAR | `GET_INFO`, `GET_HEALTH`; from firmware 1.24 on the desired speed of the motor |
//! | YDLIDAR | device information, health; of a G4 the set speed of the motor |
//! | CoLa | `DeviceIdent`, `SerialNumber`, `SCdevicestate`, `LCMstate`, `LMPscancfg`; what is refused is left out |
//! | SCIP 2.0 | `VV`, `PP`, `II`; valid while the sensor scans, too |
//!
//! Time and memory are bounded whatever arrives: a probe ends after [`LIMIT`], or after [`BYTES_MAX`].
//!
//! Sources as in [`rplidar`], [`ydlidar`], [`sick`] and [`hokuyo`](crate::hokuyo); `SerialNumber` and `LMPscancfg`:
//! SICK's published driver `sick_scan_xd`, its table of commands and its recorded answers.

mod answers;
#[cfg(test)]
mod tests;

use crate::engine::Bytes;
use crate::event::{Health, Text};
use crate::sick::wire::{TELEGRAM_MAX, Writer};
use crate::{ld, rplidar, sick, ydlidar};
use alloc::vec::Vec;
use base::{Duration, Instant, Queue, earliest};

/// Time limit of a probe.
pub const LIMIT: Duration = Duration::from_secs(4);
/// Bytes after which a probe ends.
pub const BYTES_MAX: usize = 512 * 1024;
/// Bytes that are kept for an answer at most.
const RX_MAX: usize = TELEGRAM_MAX;
/// RPLIDAR, YDLIDAR: more bytes than any answer has; they come from a scan.
const ANSWER_MAX: usize = 100;
/// Attempts of a question.
const TRIES: u8 = 2;
/// Packets of an LDROBOT after which it is known, and its rates are measured: about half a second.
const PACKETS: u32 = 192;
/// Packets of an LDROBOT by which it is recognized, one right after the other.
const PACKETS_MIN: u32 = 4;
/// Time in which what a stopped RPLIDAR or YDLIDAR had under way arrives.
const STOPPING: Duration = Duration::from_millis(30);

/// Protocol in which a line is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// LDROBOT: listens.
    Ld,
    /// SLAMTEC.
    Rplidar,
    /// YDLIDAR.
    Ydlidar,
    /// SICK, in this dialect.
    Cola(sick::Dialect),
    /// Hokuyo, SCIP 2.0.
    Scip,
}

impl Kind {
    /// Name of the protocol.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ld => "LDROBOT",
            Self::Rplidar => "RPLIDAR",
            Self::Ydlidar => "YDLIDAR",
            Self::Cola(sick::Dialect::Text) => "CoLa A",
            Self::Cola(sick::Dialect::Binary) => "CoLa B",
            Self::Scip => "SCIP 2.0",
        }
    }

    const fn asks(self) -> &'static [Ask] {
        match self {
            Self::Ld => &[Ask::Listen],
            Self::Rplidar | Self::Ydlidar => &[Ask::Info, Ask::Health, Ask::Speed],
            Self::Cola(_) => &[Ask::Identity, Ask::Serial, Ask::DeviceState, Ask::Contamination, Ask::ScanConfig],
            Self::Scip => &[Ask::Version, Ask::Parameters, Ask::State],
        }
    }

    /// What ends a scan, during which the device answers nothing else.
    fn stop(self) -> Option<Bytes> {
        let number = match self {
            Self::Rplidar => rplidar::wire::request::STOP,
            Self::Ydlidar => ydlidar::wire::command::STOP,
            Self::Ld | Self::Cola(_) | Self::Scip => return None,
        };
        Some(rplidar::wire::encode(number, &[]))
    }

    /// Time limit of an answer; of a Hokuyo also that of a line with 19200 bit/s.
    const fn within(self) -> Duration {
        match self {
            Self::Ld => Duration::from_millis(900),
            Self::Rplidar | Self::Ydlidar => Duration::from_millis(150),
            Self::Cola(_) => Duration::from_millis(400),
            Self::Scip => Duration::from_millis(350),
        }
    }
}

/// A question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ask {
    Listen,
    Info,
    Health,
    Speed,
    Identity,
    Serial,
    DeviceState,
    Contamination,
    ScanConfig,
    Version,
    Parameters,
    State,
}

/// What a device says of itself. A text is empty, and a number absent, where the device did not say it.
#[derive(Clone, Debug, PartialEq)]
pub struct Identity {
    /// Protocol in which it answered.
    pub kind: Kind,
    /// Model, in the words of the device.
    pub model: Text,
    /// Firmware.
    pub firmware: Text,
    /// Hardware.
    pub hardware: Text,
    /// Serial number.
    pub serial: Text,
    /// RPLIDAR: the model by its number, if it is one of those that the engine knows.
    pub rplidar: Option<rplidar::Model>,
    /// YDLIDAR: the number of its model.
    pub ydlidar: Option<u8>,
    /// Its own judgement, with the code of its protocol; of a SICK the worse of state and contamination.
    pub health: Option<Health>,
    /// SICK: code of `SCdevicestate`: 0 busy, 1 ready, others errors.
    pub state: Option<u8>,
    /// SICK: code of `LCMstate`: 0 clean, 1 warning, 2 error, 3 fatal.
    pub contamination: Option<u8>,
    /// Hokuyo: text of `STAT`.
    pub words: Text,
    /// Hokuyo: text of `LASR`.
    pub laser: Text,
    /// Revolutions per second: as an LDROBOT turns now; of the others the desired value.
    pub rate_hz: Option<f64>,
    /// LDROBOT: samples per second by the clock of the device.
    pub samples_per_s: Option<f64>,
}

impl Identity {
    fn new(kind: Kind) -> Self {
        Self {
            kind,
            model: Text::new(),
            firmware: Text::new(),
            hardware: Text::new(),
            serial: Text::new(),
            rplidar: None,
            ydlidar: None,
            health: None,
            state: None,
            contamination: None,
            words: Text::new(),
            laser: Text::new(),
            rate_hz: None,
            samples_per_s: None,
        }
    }

    /// LDROBOT: the model by its samples per second; LD06 and LD19 send alike.
    #[must_use]
    pub fn ld_model(&self) -> Option<ld::Model> {
        let [slow, fast] = [ld::Model::Ld19, ld::Model::Stl19p].map(|model| f64::from(model.samples_per_s()));
        let rate = self.samples_per_s?;
        Some(if rate < (slow + fast) / 2.0 { ld::Model::Ld19 } else { ld::Model::Stl19p })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    New,
    /// What arrives belongs to the scan before.
    Stopping {
        until: Instant,
    },
    Asking {
        number: usize,
        tries: u8,
        until: Instant,
    },
    Ended,
}

/// Identification in one protocol. Reads no clock and owns no port: feed it bytes and time, and after any call drain
/// [`Probe::poll_tx`], then arm one timer for [`Probe::poll_timeout`]; it has ended when that is `None`.
///
/// ```
/// use base::Instant;
/// use lidar::emulated::Device;
/// use lidar::probe::{Kind, Probe};
/// use lidar::rplidar::{self, Model};
///
/// let mut probe = Probe::new(Kind::Rplidar);
/// let mut device = rplidar::emulated::Device::new(Model::C1);
/// let mut now = Instant::from_millis(1000);
/// while probe.poll_timeout().is_some() {
///     let mut bytes = [0; 64];
///     let count = device.poll_tx(now, &mut bytes);
///     probe.handle_rx(now, &bytes[..count]);
///     probe.handle_timeout(now);
///     while let Some(request) = probe.poll_tx() {
///         device.handle_rx(now, &request);
///     }
///     now += core::time::Duration::from_millis(1);
/// }
/// let found = probe.identity().expect("it answers");
/// assert_eq!(found.rplidar, Some(Model::C1));
/// assert!(!device.scans());
/// ```
#[derive(Debug)]
pub struct Probe {
    kind: Kind,
    phase: Phase,
    tx: Queue<Bytes, 4>,
    rx: Vec<u8>,
    /// Bytes since the first question, and since the last one.
    received: usize,
    arrived: usize,
    /// End of everything.
    limit: Instant,
    /// RPLIDAR, YDLIDAR: its scan was stopped.
    was_stopped: bool,
    /// RPLIDAR, YDLIDAR: it can be asked for its set speed.
    has_speed: bool,
    identity: Identity,
    /// The device was recognized.
    is_found: bool,
    packets: Packets,
}

/// Packets of an LDROBOT so far.
#[derive(Clone, Copy, Debug, Default)]
struct Packets {
    count: u32,
    /// Clock of the last one, and the time since the first one, ms.
    last_ms: Option<u16>,
    took_ms: u32,
    /// Degrees per second, summed.
    speed_sum: u32,
}

impl Probe {
    /// A probe; its first [`Probe::handle_timeout`] begins it.
    #[must_use]
    pub fn new(kind: Kind) -> Self {
        Self {
            kind,
            phase: Phase::New,
            tx: Queue::new(),
            rx: Vec::new(),
            received: 0,
            arrived: 0,
            limit: Instant::NEVER,
            was_stopped: false,
            has_speed: false,
            identity: Identity::new(kind),
            is_found: false,
            packets: Packets::default(),
        }
    }

    /// What was found; `None`: no device of this protocol answered, or not yet.
    #[must_use]
    pub fn identity(&self) -> Option<&Identity> {
        self.is_found.then_some(&self.identity)
    }

    /// Bytes that arrived since the begin, of whatever kind: a device of another protocol, or at another rate.
    #[must_use]
    pub fn received(&self) -> usize {
        self.received
    }

    /// Takes bytes that arrived at `now`.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        let Phase::Asking { number, .. } = self.phase else { return };
        self.received = self.received.saturating_add(bytes.len());
        self.arrived = self.arrived.saturating_add(bytes.len());
        for byte in bytes {
            if self.rx.len() == RX_MAX {
                self.rx.clear();
            }
            self.rx.push(*byte);
            if self.take(number) {
                self.rx.clear();
                return self.ask(now, number + 1);
            }
        }
        if self.received > BYTES_MAX {
            self.end();
        }
    }

    /// Serves deadlines; late and needless calls do no harm. The first call begins.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.phase == Phase::New {
            self.limit = now + LIMIT;
            self.ask(now, 0);
        }
        if self.limit <= now {
            self.end();
        }
        match self.phase {
            Phase::Stopping { until } if until <= now => self.ask(now, 0),
            Phase::Asking { number, tries, until } if until <= now => self.unanswered(now, number, tries),
            _ => {}
        }
    }

    /// Next output, to be sent in order.
    pub fn poll_tx(&mut self) -> Option<Bytes> {
        self.tx.pop()
    }

    /// Instant of the next [`Self::handle_timeout`]; a past instant means at once. `None`: it has ended.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.phase {
            Phase::New => Some(Instant::ZERO),
            Phase::Stopping { until } | Phase::Asking { until, .. } => earliest([Some(until), Some(self.limit)]),
            Phase::Ended => None,
        }
    }

    fn end(&mut self) {
        self.phase = Phase::Ended;
        self.rx = Vec::new();
    }

    /// Begins a question; after the last one the probe ends.
    fn ask(&mut self, now: Instant, number: usize) {
        match self.kind.asks().get(number) {
            None => self.end(),
            Some(Ask::Speed) if !self.has_speed => self.ask(now, number + 1),
            Some(_) => self.send(now, number, TRIES),
        }
    }

    fn send(&mut self, now: Instant, number: usize, tries: u8) {
        let Some(ask) = self.kind.asks().get(number) else { return self.end() };
        self.rx.clear();
        self.arrived = 0;
        if let Some(request) = self.request(*ask) {
            self.tx.push(request);
        }
        self.phase = Phase::Asking { number, tries, until: now + self.kind.within() };
    }

    /// The time of an answer is over.
    fn unanswered(&mut self, now: Instant, number: usize, tries: u8) {
        let is_streaming = self.arrived > ANSWER_MAX;
        if self.kind == Kind::Ld {
            self.measured();
            self.end();
        } else if let Some(stop) = self.kind.stop()
            && number == 0
            && is_streaming
            && !self.was_stopped
        {
            self.was_stopped = true;
            self.tx.push(stop);
            self.phase = Phase::Stopping { until: now + STOPPING };
        } else if tries > 1 {
            self.send(now, number, tries - 1);
        } else if self.is_found {
            self.ask(now, number + 1);
        } else {
            self.end();
        }
    }

    fn request(&self, ask: Ask) -> Option<Bytes> {
        use rplidar::wire::{conf, encode, get_conf, request};
        use ydlidar::wire::command;
        let line = |text: &[u8]| Bytes::from_slice(text).ok();
        let read = |name| match self.kind {
            Kind::Cola(dialect) => Bytes::from_slice(&Writer::<80>::new(dialect, name).frame()).ok(),
            _ => None,
        };
        match ask {
            Ask::Listen => None,
            Ask::Info if self.kind == Kind::Ydlidar => Some(encode(command::GET_INFO, &[])),
            Ask::Health if self.kind == Kind::Ydlidar => Some(encode(command::GET_HEALTH, &[])),
            Ask::Speed if self.kind == Kind::Ydlidar => Some(encode(command::GET_SPEED, &[])),
            Ask::Info => Some(encode(request::GET_INFO, &[])),
            Ask::Health => Some(encode(request::GET_HEALTH, &[])),
            Ask::Speed => Some(get_conf(conf::DESIRED_SPEED, None)),
            Ask::Identity => read("sRN DeviceIdent"),
            Ask::Serial => read("sRN SerialNumber"),
            Ask::DeviceState => read("sRN SCdevicestate"),
            Ask::Contamination => read("sRN LCMstate"),
            Ask::ScanConfig => read("sRN LMPscancfg"),
            Ask::Version => line(b"VV\n"),
            Ask::Parameters => line(b"PP\n"),
            Ask::State => line(b"II\n"),
        }
    }

    /// True if the answer to this question is complete; it was taken then.
    fn take(&mut self, number: usize) -> bool {
        let Some(ask) = self.kind.asks().get(number) else { return false };
        match self.kind {
            Kind::Ld => self.take_packet(),
            Kind::Rplidar => self.take_answer(*ask),
            Kind::Ydlidar => self.take_value(*ask),
            Kind::Cola(dialect) => self.take_telegram(*ask, dialect),
            Kind::Scip => self.take_line(*ask),
        }
    }
}

/// Requests that end what [`Lidar`](crate::Lidar) started, for a tool that leaves: an RPLIDAR stops scanning, and its
/// motor if it is commanded; a YDLIDAR stops scanning; a SICK sends no more scans; a Hokuyo goes to rest. An LDROBOT
/// takes no requests.
#[must_use]
pub fn farewell(kind: Kind, rplidar: Option<rplidar::Model>) -> Vec<Bytes> {
    use rplidar::Motor;
    use rplidar::wire::{encode, request};
    match kind {
        Kind::Ld => Vec::new(),
        Kind::Rplidar => {
            let motor = match rplidar.map(rplidar::Model::motor) {
                Some(Motor::Pwm(_)) => Some(encode(request::SET_MOTOR_PWM, &0_u16.to_le_bytes())),
                Some(Motor::Rpm(_)) => Some(encode(request::SET_MOTOR_RPM, &0_u16.to_le_bytes())),
                Some(Motor::None) | None => None,
            };
            kind.stop().into_iter().chain(motor).collect()
        }
        Kind::Ydlidar => kind.stop().into_iter().collect(),
        Kind::Cola(dialect) => {
            let telegram = Writer::<80>::new(dialect, "sEN LMDscandata").blank().u8(0).frame();
            Bytes::from_slice(&telegram).into_iter().collect()
        }
        Kind::Scip => Bytes::from_slice(b"QT\n").into_iter().collect(),
    }
}
