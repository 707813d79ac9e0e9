//! A CAN wire: exact frame lengths, arbitration, one frame at a time, and error handling (ISO 11898-1): error frames,
//! error counters, retransmission, missing acknowledgement, bus-off and recovery.
//!
//! A port is a controller. Every error is seen by all controllers, as an error flag enforces: there are no local
//! errors, and no undetected ones. Without faults none of this takes time or random numbers.

mod controller;
#[cfg(test)]
mod tests;

use super::news::Traffic;
use super::owner::Owner;
use base::can::{Frame, INTERMISSION, Id, Notice, frame_bits};
use base::{Duration, Instant};
use controller::{Controller, Queued};
use module::PortId;
use simulator::Random;
use simulator::faults::InjectedFault;
use std::collections::VecDeque;
use std::rc::Rc;

/// Error flag, superimposed flags of the other nodes, and delimiter, bits.
const ERROR_FRAME: u32 = 6 + 6 + 8;
/// Error frame without other nodes.
const LONE_ERROR_FRAME: u32 = 6 + 8;
/// Bits from the acknowledge slot to the end of a frame, which an unacknowledged frame lacks.
const AFTER_ACKNOWLEDGE: u32 = 8;
/// Bits that an error-passive transmitter waits after the intermission.
const SUSPEND_BITS: u32 = 8;
/// Recessive bits required for recovery from bus-off; here an idle bus is assumed.
const RECOVERY_BITS: u32 = 128 * 11;
/// Port of a node that no process represents.
const FOREIGN: Owner = Owner { pid: 0, port: PortId(0) };
/// Minimum interval between notices other than changes of state.
const NOTICE_INTERVAL: Duration = Duration::from_millis(100);

/// Base frames win over extended ones with the same first 11 bits, data over remote.
fn rank(frame: &Frame) -> u64 {
    let remote = u64::from(frame.is_remote());
    match frame.id() {
        Id::Standard(id) => u64::from(id) << 21 | remote << 20,
        Id::Extended(id) => u64::from(id >> 18) << 21 | 1 << 20 | u64::from(id & 0x3_FFFF) << 1 | remote,
    }
}

/// Event of the wire.
#[derive(Debug, PartialEq)]
pub(super) enum WireEvent {
    /// A frame was sent and is for all other ports on the wire.
    Frame(Owner, Frame),
    /// A frame was sent, but no node received it.
    Lost(Frame),
    /// A port is bus-off.
    Off(Owner),
    /// A port recovered from bus-off.
    Back(Owner),
    /// Notice of a port's controller.
    Notice(Owner, Notice),
}

/// Result of the frame on the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Outcome {
    Sent,
    Unacknowledged,
    Destroyed,
}

#[derive(Debug)]
struct Sending {
    end: Instant,
    by: usize,
    queued: Queued,
    outcome: Outcome,
}

/// A piece of cable.
#[derive(Debug, Default)]
struct Segment {
    sending: Option<Sending>,
    /// End of the intermission.
    free: Instant,
    /// Instant of the next arbitration; frames handed over at the same instant take part.
    start: Option<Instant>,
}

/// A wire. Each port sends its frames in order; among their first ones the lowest identifier wins.
#[derive(Debug)]
pub(super) struct CanWire {
    pub bitrate: u32,
    /// Ports of living processes, which receive frames.
    pub ports: Vec<Owner>,
    pub traffic: Traffic,
    controllers: Vec<Controller>,
    /// The wire itself, then for each controller its part of the cable while that is cut.
    segments: Vec<Segment>,
    events: VecDeque<WireEvent>,
    /// Instant of the next minor notice, and earliest instant of one.
    news: Option<Instant>,
    quiet: Instant,
    random: Random,
    noise: (Instant, f64),
    corrupt: (Instant, u64),
    /// Number of frames begun.
    tries: u64,
    /// Number of a frame, as in [`Traffic::sent`], that no node will receive.
    lose: Option<u64>,
    /// Until this time a recovering controller goes bus-off again.
    off: Instant,
}

impl CanWire {
    pub fn new(bitrate: u32, random: Random, lose: Option<u64>) -> Self {
        Self {
            bitrate: bitrate.max(1),
            ports: Vec::new(),
            traffic: Traffic::default(),
            controllers: Vec::new(),
            segments: vec![Segment::default()],
            events: VecDeque::new(),
            news: None,
            quiet: Instant::ZERO,
            random,
            noise: (Instant::ZERO, 0.0),
            corrupt: (Instant::ZERO, 0),
            tries: 0,
            lose,
            off: Instant::ZERO,
        }
    }

    fn time(&self, bits: u32) -> Duration {
        Duration::from_nanos(u64::from(bits) * 1_000_000_000 / u64::from(self.bitrate))
    }

    /// Opens a port of a module; false while its controller is bus-off. `many`: it represents several nodes, which
    /// acknowledge each other's frames.
    pub fn join(&mut self, owner: Owner, module: &Rc<str>, many: bool) -> bool {
        self.ports.push(owner);
        let left = |controller: &&mut Controller| {
            controller.module == *module
                && controller.owner.port == owner.port
                && !self.ports.contains(&controller.owner)
        };
        if let Some(controller) = self.controllers.iter_mut().find(left) {
            controller.owner = owner;
            return controller.back.is_none();
        }
        self.controllers.push(Controller::new(owner, module.clone(), many));
        self.segments.push(Segment::default());
        true
    }

    /// True if a port's controller takes part, and receives the frames on the wire.
    pub fn hears(&self, now: Instant, owner: Owner) -> bool {
        self.place(owner).is_some_and(|place| self.takes_part(now, place, 0))
    }

    /// Sends a frame as a node that no process represents. It is connected from its first frame on.
    pub fn send_foreign(&mut self, now: Instant, frame: Frame) {
        if self.place(FOREIGN).is_none() {
            self.controllers.push(Controller::new(FOREIGN, "".into(), true));
            self.segments.push(Segment::default());
        }
        self.send(now, FOREIGN, frame);
    }

    fn place(&self, owner: Owner) -> Option<usize> {
        self.controllers.iter().position(|controller| controller.owner == owner)
    }

    /// Part of the cable to which a controller is connected.
    fn segment(&self, now: Instant, place: usize) -> usize {
        if now < self.controllers[place].cut { place + 1 } else { 0 }
    }

    fn takes_part(&self, now: Instant, place: usize, segment: usize) -> bool {
        self.controllers[place].back.is_none() && self.segment(now, place) == segment
    }

    pub fn send(&mut self, now: Instant, owner: Owner, frame: Frame) {
        let Some(place) = self.place(owner) else { return };
        if self.controllers[place].push(now, frame) {
            self.kick(now, self.segment(now, place));
        } else {
            self.traffic.dropped += 1;
        }
    }

    /// A port wants to send: arbitration begins as soon as the segment is free.
    fn kick(&mut self, now: Instant, segment: usize) {
        let segment = &mut self.segments[segment];
        if segment.sending.is_none() {
            let at = segment.free.max(now);
            segment.start = Some(segment.start.map_or(at, |start| start.min(at)));
        }
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let segment = |segment: &Segment| segment.sending.as_ref().map(|sending| sending.end).or(segment.start);
        let segments = self.segments.iter().filter_map(segment);
        let back = self.controllers.iter().filter_map(|controller| controller.back);
        segments.chain(back).chain(self.news).min()
    }

    /// Serves the deadlines.
    pub fn handle_timeout(&mut self, now: Instant) {
        for place in 0..self.controllers.len() {
            if self.controllers[place].back.is_some_and(|back| back <= now) {
                self.come_back(now, place);
            }
        }
        for number in 0..self.segments.len() {
            let segment = &mut self.segments[number];
            if let Some(sending) = segment.sending.take_if(|sending| sending.end <= now) {
                self.end(now, number, sending);
            } else if segment.start.take_if(|start| *start <= now).is_some() {
                self.arbitrate(now, number);
            }
        }
        self.tell(now);
    }

    /// Next event.
    pub fn poll_event(&mut self) -> Option<WireEvent> {
        self.events.pop_front()
    }

    fn arbitrate(&mut self, now: Instant, number: usize) {
        let (mut winner, mut later) = (None, None);
        for place in 0..self.controllers.len() {
            let segment = self.segment(now, place);
            let controller = &mut self.controllers[place];
            self.traffic.dropped += controller.forget(now);
            // Its cable may have been cut or repaired within its frame.
            let sends = |segment: &Segment| segment.sending.as_ref().is_some_and(|sending| sending.by == place);
            if !controller.waits() || controller.back.is_some() || self.segments.iter().any(sends) {
                continue;
            }
            if segment != number {
                // Its cable was cut or repaired while it waited. Not before it may send: two nodes waiting on both
                // sides would wake each other for ever.
                let when = now.max(controller.suspended);
                self.kick(when, segment);
                continue;
            }
            if controller.suspended > now {
                later = Some(later.map_or(controller.suspended, |at: Instant| at.min(controller.suspended)));
                continue;
            }
            let key = (controller.head().map(rank), controller.owner);
            if winner.is_none_or(|(best, _)| key < best) {
                winner = Some((key, place));
            }
        }
        let begun = winner.and_then(|(_, by)| Some((by, self.controllers[by].pop()?)));
        match begun {
            Some((by, queued)) => self.begin(now, number, by, queued),
            None => self.segments[number].start = later,
        }
    }

    fn begin(&mut self, now: Instant, number: usize, by: usize, queued: Queued) {
        let bits = frame_bits(&queued.frame);
        let heard = self.controllers[by].many
            || (0..self.controllers.len()).any(|place| place != by && self.takes_part(now, place, number));
        let (outcome, bits) = match self.destroyed_at(now, bits) {
            Some(bit) => (Outcome::Destroyed, bit + if heard { ERROR_FRAME } else { LONE_ERROR_FRAME }),
            None if heard => (Outcome::Sent, bits),
            None => (Outcome::Unacknowledged, bits - AFTER_ACKNOWLEDGE + LONE_ERROR_FRAME),
        };
        let time = self.time(bits);
        if number == 0 {
            self.traffic.busy += time;
        }
        self.segments[number].sending = Some(Sending { end: now + time, by, queued, outcome });
    }

    /// Bit after which the frame that begins now is destroyed, if it is.
    fn destroyed_at(&mut self, now: Instant, bits: u32) -> Option<u32> {
        self.tries += 1;
        let every = self.corrupt.1;
        let hit = now < self.corrupt.0 && every > 0 && self.tries.is_multiple_of(every);
        let noise = if now < self.noise.0 { 1.0 - libm::pow(1.0 - self.noise.1, f64::from(bits)) } else { 0.0 };
        (self.random.chance(noise) || hit).then(|| 1 + (self.random.bits() % u64::from(bits)) as u32)
    }

    fn end(&mut self, now: Instant, number: usize, sending: Sending) {
        let Sending { by, queued, outcome, .. } = sending;
        match outcome {
            Outcome::Sent => self.sent(now, number, by, queued.frame),
            Outcome::Unacknowledged => self.controllers[by].no_acknowledge(),
            Outcome::Destroyed => {
                self.controllers[by].transmit_error();
                self.others(now, number, by, Controller::receive_error);
                self.traffic.errors += 1;
            }
        }
        let free = now + self.time(INTERMISSION);
        self.segments[number].free = free;
        if self.controllers[by].is_over() {
            self.go_off(now, by);
        } else if outcome != Outcome::Sent {
            self.controllers[by].again(queued);
        }
        if self.controllers[by].is_passive() {
            self.controllers[by].suspended = free + self.time(SUSPEND_BITS);
        }
        if self.controllers.iter().any(Controller::waits) {
            self.kick(now, number);
        }
    }

    fn sent(&mut self, now: Instant, number: usize, by: usize, frame: Frame) {
        self.controllers[by].sent(now);
        self.others(now, number, by, Controller::received);
        self.traffic.sent += 1;
        self.events.push_back(match self.lose.take_if(|lose| *lose == self.traffic.sent) {
            Some(_) => WireEvent::Lost(frame),
            None => WireEvent::Frame(self.controllers[by].owner, frame),
        });
    }

    /// Effect of a frame on all other active controllers.
    fn others(&mut self, now: Instant, number: usize, by: usize, each: fn(&mut Controller)) {
        for place in (0..self.controllers.len()).filter(|place| *place != by) {
            if self.takes_part(now, place, number) {
                each(&mut self.controllers[place]);
            }
        }
    }

    fn go_off(&mut self, now: Instant, place: usize) {
        let recovery = self.time(RECOVERY_BITS);
        let controller = &mut self.controllers[place];
        self.traffic.dropped += controller.go_off(now, recovery);
        let owner = controller.owner;
        self.events.extend(controller.poll_state().map(|notice| WireEvent::Notice(owner, notice)));
        self.events.push_back(WireEvent::Off(owner));
    }

    fn come_back(&mut self, now: Instant, place: usize) {
        let recovery = self.time(RECOVERY_BITS);
        let controller = &mut self.controllers[place];
        controller.come_back(now);
        if now < self.off && !controller.many {
            controller.go_off(now, recovery);
            return;
        }
        self.events.push_back(WireEvent::Back(controller.owner));
    }

    /// Reports changes of state at once, other notices at intervals.
    fn tell(&mut self, now: Instant) {
        let due = self.news.take_if(|at| *at <= now).is_some();
        for controller in &mut self.controllers {
            let owner = controller.owner;
            self.events.extend(controller.poll_state().map(|notice| WireEvent::Notice(owner, notice)));
            if due {
                self.quiet = now + NOTICE_INTERVAL;
                self.events.extend(
                    std::iter::from_fn(|| controller.poll_news()).map(|notice| WireEvent::Notice(owner, notice)),
                );
            }
        }
        if self.news.is_none() && self.controllers.iter().any(Controller::has_news) {
            self.news = Some(self.quiet.max(now));
        }
    }

    /// Injects a fault into the wire; false if it does not apply to a wire. A fault of a port affects those that
    /// represent a single node: the masters.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        match injected {
            InjectedFault::Noise(rate) => self.noise = (until, rate),
            InjectedFault::Corrupt(every) => self.corrupt = (until, every),
            InjectedFault::Lose(nth) => self.lose = Some(self.traffic.sent.saturating_add(nth)),
            InjectedFault::Cut => self.cut(now, until),
            InjectedFault::BusOff => {
                // Momentary, unless a duration is given.
                self.off = if until == Instant::NEVER { now } else { until };
                self.masters(now, Self::go_off);
            }
            InjectedFault::None => {
                (self.noise.0, self.corrupt.0, self.off, self.lose) = (now, now, now, None);
                self.cut(now, now);
            }
            _ => return false,
        }
        self.tell(now);
        true
    }

    fn cut(&mut self, now: Instant, until: Instant) {
        self.masters(now, |wire, now, place| {
            wire.controllers[place].cut = until;
            let segment = wire.segment(now, place);
            wire.kick(now, segment);
        });
    }

    /// Applies a change to all active masters; a frame being sent by one of them is destroyed.
    fn masters(&mut self, now: Instant, each: impl Fn(&mut Self, Instant, usize)) {
        for number in 0..self.segments.len() {
            let many = |sending: &mut Sending| !self.controllers[sending.by].many;
            if let Some(sending) = self.segments[number].sending.take_if(many) {
                self.segments[number].free = now + self.time(ERROR_FRAME + INTERMISSION);
                self.controllers[sending.by].again(sending.queued);
                self.kick(now, number);
            }
        }
        for place in 0..self.controllers.len() {
            if !self.controllers[place].many && self.controllers[place].back.is_none() {
                each(self, now, place);
            }
        }
    }

    /// Removes a dead process; frames that it handed over are still sent, as by the kernel.
    pub fn close(&mut self, pid: u32) {
        self.ports.retain(|owner| owner.pid != pid);
    }
}
