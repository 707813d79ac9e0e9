//! A port of our own with a lidar at its other end: who it is, and how it measures.

use super::monitor::Seen;
use crate::Failed;
use crate::port::OpenPort;
use ::lidar::probe::{Kind, Probe, farewell};
use ::lidar::{Event, Fault, Health, Lidar, LostReason, Protocol, Sector, Status};
use base::serial::Word;
use base::{Duration, Instant};
use host::clock;
use host::ports::{PortConfig, Received};
use messages::lowlevel::DataScan;
use module::{Input, Output};
use std::collections::BTreeSet;

/// Time limit of the first sector: two start-ups of an engine.
const FIRST_WITHIN: Duration = Duration::from_secs(9);
/// Time over which the speed is measured.
const MEASURED: Duration = Duration::from_secs(1);

/// An opened port.
pub struct Line {
    open: OpenPort,
}

/// What a lidar did while it was started as its driver starts it.
#[derive(Default)]
pub struct Measured {
    /// Sectors of the last second.
    pub seen: Seen,
    /// Faults that began meanwhile, in words.
    pub faults: BTreeSet<&'static str>,
    /// The last health that it reported.
    pub health: Option<Health>,
    /// Why it did not measure.
    pub lost: Option<LostReason>,
}

impl Line {
    /// Opens a port that nobody holds.
    pub fn open(name: &str, port: PortConfig) -> Result<Self, Failed> {
        Ok(Self { open: OpenPort::open(name, port)? })
    }

    /// Asks in one protocol; none at Ctrl-C.
    pub fn probe(&mut self, kind: Kind) -> Result<Option<Probe>, Failed> {
        let mut probe = Probe::new(kind);
        while let Some(due) = probe.poll_timeout() {
            if self.open.wait(due)? {
                return Ok(None);
            }
            let now = clock::now();
            self.receive(now, |now, bytes| probe.handle_rx(now, bytes))?;
            probe.handle_timeout(now);
            while let Some(request) = probe.poll_tx() {
                self.send(now, &request)?;
            }
        }
        Ok(Some(probe))
    }

    /// Starts the lidar and lets it measure for a second, after its motor had `spin_up`; none at Ctrl-C.
    pub fn measure<P: Protocol>(
        &mut self,
        mut engine: Lidar<P>,
        spin_up: Duration,
    ) -> Result<Option<Measured>, Failed> {
        let mut measured = Measured::default();
        let mut until = clock::now() + FIRST_WITHIN;
        let mut from: Option<Instant> = None;
        loop {
            let now = clock::now();
            let mut is_first = false;
            self.receive(now, |now, bytes| engine.handle_rx(now, bytes))?;
            engine.handle_timeout(now);
            while let Some(request) = engine.poll_tx() {
                self.send(now, &request)?;
            }
            while let Some(event) = engine.poll_event() {
                is_first |= measured.take(event, from.is_some_and(|from| from <= now));
            }
            if is_first && from.is_none() {
                (from, until) = (Some(now + spin_up), now + spin_up + MEASURED);
            }
            if until <= now {
                return Ok(Some(measured));
            }
            let due = engine.poll_timeout().map_or(until, |due| due.min(until));
            if self.open.wait(due)? {
                return Ok(None);
            }
        }
    }

    /// Ends what was started, as far as it can be ended.
    pub fn leave(&mut self, kind: Kind, model: Option<::lidar::rplidar::Model>) -> Result<(), Failed> {
        let now = clock::now();
        farewell(kind, model).iter().try_for_each(|request| self.send(now, request))?;
        while let Some(sent) = self.open.port.device.sent_at() {
            if self.open.port.device.take_sent(clock::now()) {
                continue;
            }
            if self.open.wait(sent)? {
                break;
            }
        }
        Ok(())
    }

    fn send(&mut self, now: Instant, bytes: &[u8]) -> Result<(), Failed> {
        let words = Output::Words(bytes.iter().copied().map(Word::data).collect());
        // What has no room is as good as lost on the wire: it is asked again.
        self.open.port.device.send(now, &words).map(|_| ()).map_err(|why| self.open.lost(&why))
    }

    fn receive(&mut self, now: Instant, mut take: impl FnMut(Instant, &[u8])) -> Result<(), Failed> {
        let mut bytes = Vec::new();
        loop {
            match self.open.port.device.receive(now) {
                Ok(Received::Nothing) => return Ok(()),
                Ok(Received::Input { input: Input::Words(words), .. }) => {
                    bytes.clear();
                    bytes.extend(words.iter().map(|word| word.byte));
                    take(now, &bytes);
                }
                Ok(Received::Note(note)) => self.open.tell(&note),
                Ok(_) => {}
                Err(why) => return Err(self.open.lost(&why)),
            }
        }
    }
}

impl Measured {
    /// Takes an event; true for a sector. Sectors count only if they are `measured` at their speed.
    fn take(&mut self, event: Event<'_>, measured: bool) -> bool {
        match event {
            Event::Sector(sector) => {
                self.lost = None;
                if measured {
                    self.add(sector);
                }
                return true;
            }
            Event::Health(health) => self.health = Some(health),
            // While the motor spins up it is slow.
            Event::Fault { fault: Fault::Slow, active: true } if !measured => {}
            Event::Fault { fault, active: true } => _ = self.faults.insert(fault.name()),
            Event::Lost { reason } => self.lost = Some(reason),
            Event::Fault { .. } | Event::Identity(_) | Event::Zone { .. } | Event::Recovered { .. } => {}
        }
        false
    }

    /// Adds a sector, in the frame of the device.
    fn add(&mut self, sector: &Sector) {
        let status = match sector.status {
            Status::Ok => DataScan::OK,
            Status::Blocked => DataScan::BLOCKED,
            Status::Slow => DataScan::SLOW,
            Status::Fault => DataScan::FAULT,
        };
        let [revolution, at_us] = [sector.revolution, sector.at.as_nanos() / 1000];
        let turn = [revolution, at_us].map(|number| i64::try_from(number).unwrap_or(i64::MAX));
        self.seen.add_beams(turn.into(), status, &sector.ranges_m, |k| sector.angle_rad(k));
    }
}
