//! 2D lidars, any number of them, each on a serial line or a TCP connection.
//!
//! Devices   by `[lidar.<name>]` of robot.toml (`docs/lidars.md`): LDROBOT, SLAMTEC, YDLIDAR, SICK, Hokuyo
//! Protocol  the engines of `lidar`: identity and health, start of the scan, then sectors
//! Timing    a sector is published as soon as it is complete, with the instant of its first beam
//! Silence   no measurement for 400 ms: reported, ERROR, started anew each time; what it looked at is unknown
//! Cover     with `no_echo = "nothing"`, no echo in any direction for 250 ms: its sectors are BLOCKED, and free nothing
//! Fields    a SICK's own fields and outputs that stop the robot (`stop_fields`, `stop_outputs`): `LL_EVENT_STOP` at
//!           10 Hz and on change; engaged while one is infringed, or not known
//! Data      `LL_DATA_SCAN` for each sector, with the place of the lidar; `LL_DATA_BUS` once a second for each line
//!
//! In STOP no scans are published, and what stops the robot is not known. None of these is a safety device.

mod config;
mod stop;

use base::serial::Word;
use base::{Duration, Fault, Instant, Severity, Ticker, earliest};
use config::{BUS_PERIOD, Engine};
pub use config::{Config, DEVICES_MAX, Device, LidarKeys, MODELS, Model, StopKeys};
use lidar::ld::NoEcho;
use lidar::{Event as LidarEvent, Fault as LidarFault, Health, LostReason, Sector, Status};
use messages::lowlevel::{DataBus, DataScan};
use module::{Actions, Event, Input, Module, PortId, PortSpec, State};
use stop::Stop;

/// Name of the module.
pub const NAME: &str = "driver_lidar";
/// Time in which a motor reaches its speed.
const SPIN_UP: Duration = Duration::from_secs(3);
/// Time without an echo in any direction after which a lidar whose range of 0 is to mean that nothing was received is
/// taken for covered: more than the slowest revolution, 222 ms.
const COVERED_AFTER: Duration = Duration::from_millis(250);

/// Driver of lidars.
#[derive(Debug)]
pub struct Lidars {
    ports: Vec<PortSpec>,
    scanners: Vec<Scanner>,
    state: State,
    statistics: Ticker,
    /// Last result reported to the shell: true if it works.
    working: Option<bool>,
}

/// A lidar and its line.
#[derive(Debug)]
struct Scanner {
    device: Device,
    port: PortId,
    engine: Box<dyn Engine>,
    /// `None` until the host has reported the port.
    up: Option<bool>,
    /// It measures; `None`: not known yet.
    measures: Option<bool>,
    /// What it says that it is.
    identity: String,
    /// Its motor spins up until then: meanwhile it may be slow.
    spins_until: Instant,
    /// Its motor is too slow or too fast; that has been reported.
    slow: bool,
    told_slow: bool,
    /// Last echo in the view that is used; `None`: none since the lidar measures.
    echo: Option<Instant>,
    /// When the last sector came.
    scanned: Instant,
    /// Its optics are blocked, as it says itself; that, or that it receives nothing, has been reported.
    blocked: bool,
    told_blocked: bool,
    /// What of it stops the robot, if anything.
    stop: Option<Stop>,
    /// Bytes of this second, in both directions.
    bytes: usize,
    rx: Vec<u8>,
}

impl Lidars {
    /// Creates the driver, not started yet. Devices beyond [`DEVICES_MAX`] are left out.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let devices = config.devices.into_iter().take(DEVICES_MAX);
        let scanners: Vec<Scanner> =
            devices.enumerate().map(|(n, device)| Scanner::new(device, PortId(n as u8))).collect();
        let port = |scanner: &Scanner| {
            let baud = scanner.device.line_baud();
            PortSpec { bus: scanner.device.bus.clone(), line: module::Line::Serial { baud } }
        };
        Self {
            ports: scanners.iter().map(port).collect(),
            scanners,
            state: State::Init,
            statistics: Ticker::new(Instant::NEVER, BUS_PERIOD),
            working: None,
        }
    }

    /// Reports to the shell whether the module works, if that changed and is known of all lidars.
    fn report_condition(&mut self, out: &mut Actions) {
        let all = || self.scanners.iter().map(|scanner| scanner.measures);
        let works = match all().any(|measures| measures == Some(false)) {
            true => Some(false),
            false => all().all(|measures| measures.is_some()).then_some(true),
        };
        if let Some(working) = works
            && self.working.replace(working) != works
        {
            if working { out.working() } else { out.failed() }
        }
    }
}

impl Scanner {
    fn new(device: Device, port: PortId) -> Self {
        let (engine, stop) = (config::engine(&device), Stop::new(&device));
        Self {
            device,
            port,
            engine,
            up: None,
            measures: None,
            identity: String::new(),
            spins_until: Instant::ZERO,
            slow: false,
            told_slow: false,
            echo: None,
            scanned: Instant::ZERO,
            blocked: false,
            told_blocked: false,
            stop,
            bytes: 0,
            rx: Vec::new(),
        }
    }

    fn on_port(&mut self, now: Instant, input: &Input<'_>, out: &mut Actions) {
        let bus = self.device.bus.as_str();
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, bus, format!("{bus} is up"));
                self.up = Some(true);
            }
            Input::Down(why) => {
                out.raise(Severity::Error, Fault::PortDown, bus, format!("{bus} is down: {why}; retrying"));
                self.engine.handle_closed(now);
                (self.up, self.measures) = (Some(false), Some(false));
            }
            Input::Words(words) if self.up == Some(true) => {
                self.bytes += words.len();
                self.rx.clear();
                self.rx.extend(words.iter().map(|word| word.byte));
                self.engine.handle_rx(now, &self.rx);
            }
            _ => {}
        }
    }

    fn serve(&mut self, now: Instant, publishes: bool, out: &mut Actions) {
        if self.up == Some(true) {
            self.engine.handle_timeout(now);
        }
        while let Some(request) = self.engine.poll_tx() {
            self.bytes += request.len();
            let words: Vec<Word> = request.iter().copied().map(Word::data).collect();
            out.send_words(self.port, &words);
        }
        let Self { device, engine, measures, identity, spins_until, slow, echo, scanned, blocked, .. } = self;
        while let Some(event) = engine.poll_event() {
            match event {
                LidarEvent::Sector(sector) => {
                    *scanned = now;
                    let mut scan = message(device, sector, out.timestamp(sector.at));
                    if scan.ranges.iter().any(|range| *range < f32::INFINITY) {
                        *echo = Some(now);
                    }
                    if scan.status == DataScan::OK && is_covered(now, device, *echo) {
                        scan.status = DataScan::BLOCKED;
                    }
                    if publishes {
                        out.publish(scan);
                    }
                }
                // What is in force of them is asked of the engine.
                LidarEvent::Zone { .. } => {}
                LidarEvent::Identity(text) => {
                    let text = String::from_utf8_lossy(text);
                    if *identity != text {
                        out.note(format!("lidar {}: {text}", device.name));
                        *identity = text.into_owned();
                    }
                }
                LidarEvent::Health(health) => report_health(device, engine.as_ref(), health, out),
                LidarEvent::Fault { fault: LidarFault::Slow, active } => *slow = active,
                LidarEvent::Fault { fault: LidarFault::Blocked, active } => *blocked = active,
                LidarEvent::Fault { fault: LidarFault::Device, active: true } => {
                    let what = engine.error().map_or_else(|| "without a code".into(), |(code, text)| coded(code, text));
                    let message = format!("lidar {} reports an error: {what}", device.name);
                    out.raise(Severity::Error, Fault::LidarError, device.bus.as_str(), message);
                }
                LidarEvent::Fault { fault, active } => report(device, fault, active, out),
                LidarEvent::Lost { reason } => {
                    (*measures, *echo) = (Some(false), None);
                    let why = why(reason, engine.meaning());
                    let message = format!("lidar {} {why}: what it looks at is unknown", device.name);
                    out.raise(Severity::Error, Fault::LidarLost, device.bus.as_str(), message);
                }
                LidarEvent::Recovered { .. } => {
                    (*measures, *spins_until) = (Some(true), now + SPIN_UP);
                    out.clear(Fault::LidarLost, device.bus.as_str(), format!("lidar {} measures", device.name));
                }
            }
        }
    }

    /// Publishes whether its own fields stop the robot.
    fn serve_stop(&mut self, now: Instant, serves: bool, out: &mut Actions) {
        let Self { device, engine, stop: Some(stop), measures, .. } = self else { return };
        // What a device says before its first scan is no result of a scan.
        let evaluates = serves && *measures == Some(true);
        stop.serve(now, device, |zone| engine.result(zone), evaluates, out);
        stop.report(now, device, evaluates, out);
    }

    /// Reports the speed of the motor, after it had time to spin up.
    fn report_speed(&mut self, now: Instant, out: &mut Actions) {
        let spins = self.measures != Some(true) || now < self.spins_until;
        if self.told_slow != self.slow && !(self.slow && spins) {
            self.told_slow = self.slow;
            report(&self.device, LidarFault::Slow, self.slow, out);
        }
    }

    /// Reports optics that are blocked: the device says so, or its sectors have no echo. Before its first echo it has
    /// time to spin up.
    fn report_blocked(&mut self, now: Instant, out: &mut Actions) {
        let is_due = self.echo.is_some() || self.spins_until <= now;
        let covered = self.measures == Some(true) && is_due && is_covered(self.scanned, &self.device, self.echo);
        let blocked = self.blocked || covered;
        if self.told_blocked == blocked {
            return;
        }
        self.told_blocked = blocked;
        let (bus, name) = (self.device.bus.as_str(), &self.device.name);
        if covered && !self.blocked {
            let why = "receives nothing in any direction: covered, or nothing is within its range";
            let message = format!("lidar {name} {why}; what it looks at is unknown");
            out.raise(Severity::Error, Fault::LidarBlocked, bus, message);
        } else if blocked {
            report(&self.device, LidarFault::Blocked, true, out);
        } else {
            out.clear(Fault::LidarBlocked, bus, format!("lidar {name}: no longer reported as blocked"));
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let engine = self.engine.poll_timeout().filter(|_| self.up == Some(true));
        let spins = (self.slow && !self.told_slow && self.measures == Some(true)).then_some(self.spins_until);
        earliest([engine, spins, self.stop.as_ref().and_then(Stop::poll_timeout)])
    }

    /// Publishes `LL_DATA_BUS`, and begins a new second.
    fn publish(&mut self, now: Instant, out: &mut Actions) {
        let counters = self.engine.counters();
        let bytes = std::mem::take(&mut self.bytes) as f64;
        out.publish(DataBus {
            timestamp: out.timestamp(now),
            bus: self.device.bus.clone(),
            // A character has ten bits.
            load: self.device.baud.map_or(0.0, |baud| (10.0 * bytes / f64::from(baud)).min(1.0)),
            frames: i64::from(counters.messages),
            errors: i64::from(counters.rejected) + i64::from(counters.dropped),
            state: if self.up == Some(true) { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes: Vec::new(),
        });
    }
}

/// `LL_DATA_SCAN` of a sector. Upside down a lidar sees the other way round.
fn message(device: &Device, sector: &Sector, timestamp: i64) -> DataScan {
    let LidarKeys { x, y, theta, upside_down, range_max, .. } = device.keys;
    let sign = if upside_down { -1.0 } else { 1.0 };
    let half = device.keys.view_rad() / 2.0;
    let used = |(k, range): (usize, &f32)| if sector.angle_rad(k).abs() <= half { *range } else { f32::NAN };
    DataScan {
        timestamp,
        name: device.name.clone(),
        revolution: i64::try_from(sector.revolution).unwrap_or(i64::MAX),
        status: match sector.status {
            Status::Ok => DataScan::OK,
            Status::Blocked => DataScan::BLOCKED,
            Status::Slow => DataScan::SLOW,
            Status::Fault => DataScan::FAULT,
        },
        x,
        y,
        theta,
        angle_min: sign * sector.angle_min_rad,
        angle_step: sign * sector.angle_step_rad,
        beam_time: sector.beam_time_s,
        range_min: sector.range_min_m,
        range_max: range_max.map_or(sector.range_max_m, |most| sector.range_max_m.min(most as f32)),
        ranges: sector.ranges_m.iter().enumerate().map(used).collect(),
        intensities: sector.intensities.to_vec(),
    }
}

/// True if a lidar receives nothing in any direction, and would free all of them: `echo` is its last one. It may stand
/// in a wide place; more likely something covers it, which reads 0 as well.
fn is_covered(now: Instant, device: &Device, echo: Option<Instant>) -> bool {
    device.keys.no_echo == NoEcho::Nothing && echo.is_none_or(|at| now.since(at) > COVERED_AFTER)
}

/// A code of a device, and what it means where that is known.
fn coded(code: u32, meaning: &[u8]) -> String {
    if meaning.is_empty() {
        format!("code {code}")
    } else {
        format!("code {code}, {}", String::from_utf8_lossy(meaning))
    }
}

/// Reports a device that warns or has an error, until it says otherwise. What it says of its optics is `LidarDirty` or
/// `LidarBlocked`.
fn report_health(device: &Device, engine: &dyn Engine, health: Health, out: &mut Actions) {
    let (bus, name, meaning) = (device.bus.as_str(), &device.name, engine.meaning());
    match health {
        Health::Warning { code } if !engine.is_active(LidarFault::Dirty) => {
            let message = format!("lidar {name} warns: {}; it measures", coded(code, meaning));
            out.raise(Severity::Warning, Fault::LidarWarning, bus, message);
        }
        _ => out.clear(Fault::LidarWarning, bus, format!("lidar {name} no longer warns")),
    }
    match health {
        Health::Error { code } if !engine.is_active(LidarFault::Blocked) => {
            let message = format!("lidar {name} reports an error: {}", coded(code, meaning));
            out.raise(Severity::Error, Fault::LidarError, bus, message);
        }
        _ if engine.is_active(LidarFault::Device) => {}
        _ => out.clear(Fault::LidarError, bus, format!("lidar {name} no longer reports an error")),
    }
}

fn report(device: &Device, fault: LidarFault, active: bool, out: &mut Actions) {
    let (number, severity, what) = match fault {
        LidarFault::Dirty => (Fault::LidarDirty, Severity::Warning, "its optics are dirty"),
        LidarFault::Blocked => (Fault::LidarBlocked, Severity::Error, "its optics are too dirty to measure"),
        LidarFault::Slow => (Fault::LidarSpeed, Severity::Error, "its motor is too slow or too fast"),
        LidarFault::Incomplete => (Fault::LidarIncomplete, Severity::Error, "part of its revolutions does not arrive"),
        LidarFault::Noise => (Fault::LidarDisturbed, Severity::Error, "its line is disturbed"),
        LidarFault::Device => (Fault::LidarError, Severity::Error, "it reports an error"),
    };
    let (bus, name) = (device.bus.as_str(), &device.name);
    if active {
        out.raise(severity, number, bus, format!("lidar {name}: {what}"));
    } else {
        out.clear(number, bus, format!("lidar {name}: not any more: {what}"));
    }
}

/// Why it is lost, in words.
fn why(reason: LostReason, meaning: &[u8]) -> String {
    match reason {
        LostReason::Silent => "is silent".into(),
        LostReason::Garbled => "sends nothing that is valid: wrong model or rate".into(),
        LostReason::Stalled => "sends nothing new: its motor stands".into(),
        LostReason::Refused { code } => format!("refused a request, code {code}"),
        LostReason::Identity => "is another model than configured".into(),
        LostReason::Device { code } => format!("reports an error, {}, and does not measure", coded(code, meaning)),
        LostReason::Closed => "is not connected".into(),
    }
}

impl Module for Lidars {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => self.statistics = Ticker::new(now + BUS_PERIOD, BUS_PERIOD),
            Event::Port { port, input } => {
                if let Some(scanner) = self.scanners.get_mut(usize::from(port.0)) {
                    scanner.on_port(now, &input, out);
                }
            }
            Event::State(state) => self.state = state,
            Event::Timer | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        let publishes = !matches!(self.state, State::Stop | State::Terminate);
        for scanner in &mut self.scanners {
            scanner.serve(now, publishes, out);
            scanner.report_speed(now, out);
            scanner.report_blocked(now, out);
            scanner.serve_stop(now, publishes, out);
        }
        if self.statistics.due(now) {
            self.scanners.iter_mut().for_each(|scanner| scanner.publish(now, out));
        }
        self.report_condition(out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let scanners = self.scanners.iter().filter_map(Scanner::poll_timeout);
        scanners.chain([self.statistics.next()]).min()
    }
}

#[cfg(test)]
mod tests;
