//! The slave of CiA 305: two states, and what is set in them.

use super::wire::{Bound, Confirm, FastScan, Request, Response};
use super::{Address, BitRate, Mode, Part, UNCONFIGURED};
use crate::wire::Service;
use base::can::{Frame, Id};
use base::{Deadlines, Duration, Instant, Queue};

/// Time limit for the application to store, before the master gets a failure.
const STORING: Duration = Duration::from_secs(1);

/// What a slave is.
#[derive(Clone, Copy, Debug)]
pub struct SlaveConfig {
    /// Identity, 0x1018.
    pub address: Address,
    /// The node id at power-on, 1 to 127; `None`: none yet.
    pub node_id: Option<u8>,
    /// The bit rate at power-on.
    pub bit_rate: BitRate,
    /// The bit rates it can be set to; empty: it cannot, settings are refused and activation is ignored.
    pub bit_rates: &'static [BitRate],
    /// True if it can store what was set; else that is refused.
    pub stores: bool,
}

/// What the device has to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlaveEvent {
    /// A slave without node id was given one and left the configuration state: it resets its communication, calls
    /// [`Slave::activate_node_id`] then, and boots.
    NodeIdAssigned,
    /// Switch the controller to this bit rate now. The slave is [quiet](Slave::is_quiet) for a while before and after.
    BitRate(BitRate),
    /// Keep these over power-off, then call [`Slave::stored`].
    Store {
        /// 1 to 127; `None`: no node id.
        node_id: Option<u8>,
        /// The bit rate.
        bit_rate: BitRate,
    },
}

base::deadlines! {
    /// What a slave waits for.
    enum Timer {
        /// The controller switches to the new bit rate. Set between activation and switch.
        Switch,
        /// The application should have stored. Set while a request to store is unanswered.
        Store,
    }
}

/// A change of bit rate under way (CiA 305, activate bit timing): silence, switch at [`Timer::Switch`], silence.
#[derive(Clone, Copy, Debug)]
struct Switching {
    rate: BitRate,
    quiet_until: Instant,
}

/// An LSS slave. It hears [`Service::LssRequest`] and takes no other frame.
pub struct Slave {
    config: SlaveConfig,
    mode: Mode,
    /// Of a switch selective: how many words matched.
    selecting: u8,
    /// Of an identification: how many bounds matched.
    identifying: u8,
    /// The word the fastscan is at.
    scanning: u8,
    /// What the node uses.
    active_id: Option<u8>,
    /// What it uses after the next reset.
    pending_id: Option<u8>,
    pending_rate: BitRate,
    switching: Option<Switching>,
    deadlines: Deadlines<Timer>,
    tx: Queue<Frame, 4>,
    events: Queue<SlaveEvent, 4>,
}

impl Slave {
    /// As after power-on, waiting.
    #[must_use]
    pub fn new(config: SlaveConfig) -> Self {
        let node_id = config.node_id.filter(|id| matches!(id, 1..=127));
        Self {
            config: SlaveConfig { node_id, ..config },
            mode: Mode::Waiting,
            selecting: 0,
            identifying: 0,
            scanning: 0,
            active_id: node_id,
            pending_id: node_id,
            pending_rate: config.bit_rate,
            switching: None,
            deadlines: Deadlines::new(),
            tx: Queue::new(),
            events: Queue::new(),
        }
    }

    /// Off and on again: what was stored, or else configured, counts.
    pub fn power_on(&mut self) {
        *self = Self::new(self.config);
    }

    /// The state.
    #[must_use]
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The node id in use.
    #[must_use]
    pub fn node_id(&self) -> Option<u8> {
        self.active_id
    }

    /// Reset of communication or of the node: the node id that was set last is in use from now on.
    pub fn activate_node_id(&mut self) -> Option<u8> {
        self.active_id = self.pending_id;
        self.active_id
    }

    /// True if the node must not send anything: around a change of the bit rate.
    #[must_use]
    pub fn is_quiet(&self, now: Instant) -> bool {
        self.switching.is_some_and(|switching| now < switching.quiet_until)
    }

    /// Answers [`SlaveEvent::Store`]: whether it is kept.
    pub fn stored(&mut self, kept: bool) {
        if !self.deadlines.is_set(Timer::Store) {
            return;
        }
        self.deadlines.clear(Timer::Store);
        if kept {
            self.config.node_id = self.pending_id;
            self.config.bit_rate = self.pending_rate;
        }
        // 2: the storage medium cannot be accessed.
        self.answer(Response::Stored(Confirm { error: if kept { 0 } else { 2 }, specific: 0 }));
    }

    /// A frame from the bus; others than requests do no harm.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        self.handle_timeout(now);
        if frame.id() != Id::Standard(Service::LssRequest.cob_id()) || self.is_quiet(now) {
            return;
        }
        let Some(request) = Request::decode(frame.data()) else {
            return;
        };
        match (request, self.mode) {
            (Request::SwitchGlobal(mode), _) => self.switch(mode),
            (Request::Identify { bound, number }, _) => self.identify(bound, number),
            (Request::IdentifyNonConfigured, _) if self.is_unconfigured() => self.answer(Response::NonConfigured),
            (Request::Select { part, number }, Mode::Waiting) => self.select(part, number),
            (Request::FastScan(scan), Mode::Waiting) if self.is_unconfigured() => self.scan(scan),
            (Request::SetNodeId(id), Mode::Configuration) => self.set_node_id(id),
            (Request::SetBitTiming { table, index }, Mode::Configuration) => self.set_bit_timing(table, index),
            (Request::Activate { delay_ms }, Mode::Configuration) => self.activate(now, delay_ms),
            (Request::Store, Mode::Configuration) => self.store(now),
            (Request::Inquire(part), Mode::Configuration) => {
                let number = self.config.address.words()[part as usize];
                self.answer(Response::Inquired { part, number });
            }
            (Request::InquireNodeId, Mode::Configuration) => {
                self.answer(Response::NodeId(self.active_id.unwrap_or(UNCONFIGURED)));
            }
            _ => {}
        }
    }

    fn answer(&mut self, response: Response) {
        self.tx.push(response.frame());
    }

    /// Neither in use nor waiting for a reset.
    fn is_unconfigured(&self) -> bool {
        self.active_id.is_none() && self.pending_id.is_none()
    }

    fn switch(&mut self, mode: Mode) {
        let leaves = self.mode == Mode::Configuration && mode == Mode::Waiting;
        self.mode = mode;
        self.selecting = 0;
        if leaves && self.active_id.is_none() && self.pending_id.is_some() {
            self.events.push(SlaveEvent::NodeIdAssigned);
        }
    }

    fn select(&mut self, part: Part, number: u32) {
        if part == Part::Vendor {
            self.selecting = 0;
        }
        let matches = part as u8 == self.selecting && number == self.config.address.words()[part as usize];
        self.selecting = if matches { self.selecting + 1 } else { 0 };
        if self.selecting == 4 {
            self.selecting = 0;
            self.mode = Mode::Configuration;
            self.answer(Response::Selected);
        }
    }

    fn identify(&mut self, bound: Bound, number: u32) {
        let Address { vendor, product, revision, serial } = self.config.address;
        if bound == Bound::Vendor {
            self.identifying = 0;
        }
        let within = match bound {
            Bound::Vendor => vendor == number,
            Bound::Product => product == number,
            Bound::RevisionLow => revision >= number,
            Bound::RevisionHigh => revision <= number,
            Bound::SerialLow => serial >= number,
            Bound::SerialHigh => serial <= number,
        };
        let matches = within && bound as u8 == self.identifying;
        self.identifying = if matches { self.identifying + 1 } else { 0 };
        if self.identifying == 6 {
            self.identifying = 0;
            self.answer(Response::Identified);
        }
    }

    fn scan(&mut self, FastScan { number, bit_check, sub, next }: FastScan) {
        match bit_check {
            FastScan::RESET => self.scanning = 0,
            0..=31 if sub == self.scanning && sub <= 3 && next <= 3 => {
                let word = self.config.address.words()[usize::from(sub)];
                if (word ^ number) >> bit_check != 0 {
                    return;
                }
                self.scanning = next;
                if bit_check == 0 && next < sub {
                    self.mode = Mode::Configuration;
                }
            }
            _ => return,
        }
        self.answer(Response::Identified);
    }

    fn set_node_id(&mut self, id: u8) {
        let valid = matches!(id, 1..=127 | UNCONFIGURED);
        if valid {
            self.pending_id = (id != UNCONFIGURED).then_some(id);
        }
        self.answer(Response::NodeIdSet(Confirm { error: u8::from(!valid), specific: 0 }));
    }

    fn set_bit_timing(&mut self, table: u8, index: u8) {
        let rate = BitRate::from_index(index).filter(|rate| table == 0 && self.config.bit_rates.contains(rate));
        if let Some(rate) = rate {
            self.pending_rate = rate;
        }
        self.answer(Response::BitTimingSet(Confirm { error: u8::from(rate.is_none()), specific: 0 }));
    }

    fn activate(&mut self, now: Instant, delay_ms: u16) {
        if self.config.bit_rates.is_empty() {
            return;
        }
        let at = now + Duration::from_millis(u64::from(delay_ms));
        let quiet_until = at + Duration::from_millis(u64::from(delay_ms));
        self.switching = Some(Switching { rate: self.pending_rate, quiet_until });
        self.deadlines.set(Timer::Switch, at);
        self.handle_timeout(now);
    }

    fn store(&mut self, now: Instant) {
        if !self.config.stores {
            return self.answer(Response::Stored(Confirm { error: 1, specific: 0 }));
        }
        if !self.deadlines.is_set(Timer::Store) {
            self.deadlines.set(Timer::Store, now + STORING);
            self.events.push(SlaveEvent::Store { node_id: self.pending_id, bit_rate: self.pending_rate });
        }
    }

    /// Does what is due at `now`: the change of bit rate, the end of waiting for [`Self::stored`].
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.deadlines.take(Timer::Switch, now)
            && let Some(Switching { rate, .. }) = self.switching
        {
            self.events.push(SlaveEvent::BitRate(rate));
        }
        if self.deadlines.is_due(Timer::Store, now) {
            self.stored(false);
        }
    }

    /// A frame to send.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        self.tx.pop()
    }

    /// What the device has to do.
    pub fn poll_event(&mut self) -> Option<SlaveEvent> {
        self.events.pop()
    }

    /// When to call [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }
}
