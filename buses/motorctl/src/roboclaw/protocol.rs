//! The start-up of a RoboClaw, its commands and its feedback: one transaction at a time.
//!
//! Steps: version; speed zero; status; serial timeout set, and read back; positions; speeds until both axes stand.

use super::Device;
use super::wire::{Answer, Bytes, ERRORS, GAP, Packet, Received, Request, TIME_UNIT};
use crate::config::Timing;
use crate::engine::{Progress, Protocol, Setpoint, Shared};
use crate::event::{LostReason, Reaction, Refusal, Step};
use base::{Duration, Instant, earliest};

/// Bits of a byte on the wire.
const BITS_PER_BYTE: u64 = 10;
/// Time of the device for its answer, beside the wire. More than [`GAP`], so that what the device has of a damaged
/// request is discarded before the next.
const ANSWER_WITHIN: Duration = Duration::from_millis(12);
const _: () = assert!(ANSWER_WITHIN.as_nanos() > GAP.as_nanos());
/// Attempts of a request of the start-up.
const TRIES: u8 = 5;
/// Time limit to stand, when an axis turned at the start.
const STANDSTILL_WITHIN: Duration = Duration::from_secs(5);

/// What is read in each period.
const READS: [Request; 4] = [Request::Position(0), Request::Speed(0), Request::Position(1), Request::Speed(1)];
/// What is read in turn, one in each period: errors in every other one.
const SLOW_READS: [Request; 8] = [
    Request::Status,
    Request::Supply,
    Request::Status,
    Request::Currents,
    Request::Status,
    Request::Temperature,
    Request::Status,
    Request::TimeLimit,
];

#[derive(Clone, Copy, Debug)]
enum Phase {
    Off,
    /// `tries` are left for the request under way; the axes must stand by `until`.
    Starting {
        tries: u8,
        until: Instant,
    },
    Ready {
        /// Speeds that wait to be sent, counts/s.
        drive: Option<[i32; 2]>,
        /// When the last drive command was acknowledged.
        acknowledged: Instant,
        /// Reads of this period that are left, the slow one included.
        reads: usize,
        slow: usize,
    },
}

/// A request under way.
#[derive(Clone, Copy, Debug)]
struct Outstanding {
    request: Request,
    until: Instant,
    /// The answer was damaged: what follows it is awaited, not read.
    damaged: bool,
}

/// Packet serial for one device.
#[derive(Debug)]
pub struct PacketSerial {
    device: Device,
    timing: Timing,
    phase: Phase,
    /// True if the version is the expected one.
    identified: bool,
    outstanding: Option<Outstanding>,
    tx: Option<Packet>,
    rx: Bytes,
    /// Counter of each axis, and the counts since the first answer, without its wrap.
    counters: [Option<i32>; 2],
    counts: [i64; 2],
}

impl PacketSerial {
    pub(super) fn new(device: Device, timing: Timing) -> Self {
        Self {
            device,
            timing,
            phase: Phase::Off,
            identified: false,
            outstanding: None,
            tx: None,
            rx: Bytes::new(),
            counters: [None; 2],
            counts: [0; 2],
        }
    }

    fn ask(&mut self, now: Instant, request: Request) {
        let packet = request.packet(self.device.address);
        let bits = (packet.len() + request.answer_len()) as u64 * BITS_PER_BYTE;
        let on_wire = Duration::from_nanos((bits * 1_000_000_000).div_ceil(self.device.baud.into()));
        self.outstanding = Some(Outstanding { request, until: now + on_wire + ANSWER_WITHIN, damaged: false });
        self.tx = Some(packet);
        self.rx.clear();
    }

    /// Next request of the start-up.
    fn proceed(&mut self, now: Instant, request: Request) -> Progress {
        if let Phase::Starting { tries, .. } = &mut self.phase {
            *tries = TRIES;
        }
        self.ask(now, request);
        Progress::Pending
    }

    fn units(&self) -> u8 {
        // At most 2, by the check of the configuration.
        (self.timing.time_limit.as_millis() / TIME_UNIT.as_millis()) as u8
    }

    /// Next request of a device that is ready.
    fn next(&mut self, now: Instant) {
        let Phase::Ready { drive, reads, slow, .. } = &mut self.phase else { return };
        let request = if let Some(speeds) = drive.take() {
            Request::Drive(speeds)
        } else if *reads > 1 {
            *reads -= 1;
            READS[READS.len() - *reads]
        } else if *reads == 1 {
            (*reads, *slow) = (0, (*slow + 1) % SLOW_READS.len());
            SLOW_READS[*slow]
        } else {
            return;
        };
        self.ask(now, request);
    }

    fn unanswered(&mut self, now: Instant, request: Request) -> Progress {
        match &mut self.phase {
            Phase::Starting { tries: 1, .. } => {
                let step = match request {
                    Request::Version => Step::Contact,
                    Request::SetTimeLimit(_) | Request::TimeLimit => Step::TimeLimit,
                    Request::Status => Step::Enable,
                    _ => Step::Standstill,
                };
                return Progress::Refused(step, Refusal::Silent);
            }
            Phase::Starting { tries, .. } => {
                *tries -= 1;
                self.ask(now, request);
            }
            Phase::Ready { .. } => self.next(now),
            Phase::Off => {}
        }
        Progress::Pending
    }

    fn answered(&mut self, now: Instant, request: Request, answer: &Answer, shared: &mut Shared<2>) -> Progress {
        self.measure(now, request, answer, shared);
        match self.phase {
            Phase::Off => Progress::Pending,
            Phase::Starting { until, .. } => self.started(now, request, answer, until, shared),
            Phase::Ready { .. } => {
                let progress = self.operating(now, answer);
                self.next(now);
                progress
            }
        }
    }

    fn started(
        &mut self,
        now: Instant,
        request: Request,
        answer: &Answer,
        until: Instant,
        shared: &Shared<2>,
    ) -> Progress {
        match (request, answer) {
            (_, Answer::Version(text)) => {
                // Not empty: `windows` takes no zero.
                let model = self.device.model.as_bytes();
                if !text.windows(model.len()).any(|part| part == model) {
                    return Progress::Refused(Step::Identity, Refusal::Identity { found: text.clone() });
                }
                self.identified = true;
                self.proceed(now, Request::Drive([0; 2]))
            }
            (Request::Drive(_), _) => self.proceed(now, Request::Status),
            (_, Answer::Status(bits)) if bits & ERRORS != 0 => {
                Progress::Refused(Step::Enable, Refusal::Fault { errors: bits & ERRORS })
            }
            (_, Answer::Status(_)) => self.proceed(now, Request::SetTimeLimit(self.units())),
            (Request::SetTimeLimit(_), _) => self.proceed(now, Request::TimeLimit),
            (_, Answer::TimeLimit(units)) if *units != self.units() => {
                let found = TIME_UNIT * u32::from(*units);
                Progress::Refused(Step::TimeLimit, Refusal::TimeLimit { found })
            }
            (_, Answer::TimeLimit(_)) => self.proceed(now, Request::Position(0)),
            (Request::Position(0), _) => self.proceed(now, Request::Position(1)),
            (Request::Position(_), _) => self.proceed(now, Request::Speed(0)),
            (Request::Speed(0), _) => self.proceed(now, Request::Speed(1)),
            (Request::Speed(_), _) if shared.stands(0) && shared.stands(1) => {
                self.phase = Phase::Ready { drive: None, acknowledged: now, reads: 0, slow: 0 };
                Progress::Started(None, Reaction::Stops)
            }
            (Request::Speed(_), _) if until <= now => Progress::Refused(Step::Standstill, Refusal::Moving),
            (Request::Speed(_), _) => self.proceed(now, Request::Speed(0)),
            _ => Progress::Pending,
        }
    }

    fn operating(&mut self, now: Instant, answer: &Answer) -> Progress {
        match answer {
            Answer::Acknowledged => {
                if let Phase::Ready { acknowledged, .. } = &mut self.phase {
                    *acknowledged = now;
                }
                Progress::Pending
            }
            Answer::Status(bits) if bits & ERRORS != 0 => Progress::Lost(LostReason::Fault { errors: bits & ERRORS }),
            Answer::TimeLimit(units) if *units != self.units() => Progress::Lost(LostReason::TimeLimitChanged),
            _ => Progress::Pending,
        }
    }

    fn measure(&mut self, now: Instant, request: Request, answer: &Answer, shared: &mut Shared<2>) {
        match (request, answer) {
            (Request::Position(axis), Answer::Position(counter)) => {
                let before = self.counters[axis].replace(*counter).unwrap_or(*counter);
                self.counts[axis] += i64::from(counter.wrapping_sub(before));
            }
            (Request::Speed(axis), Answer::Speed(speed)) => {
                let counts_per_turn = self.device.counts_per_turn[axis];
                let (speed, counts) = (f64::from(*speed), self.counts[axis] as f64);
                shared.measured(now, axis, speed / counts_per_turn, counts / counts_per_turn);
            }
            (_, Answer::Supply(volts)) => shared.feedback.iter_mut().for_each(|axis| axis.supply_v = *volts),
            (_, Answer::Temperature(c)) => shared.feedback.iter_mut().for_each(|axis| axis.temperature_c = *c),
            (_, Answer::Currents(currents)) => {
                shared.feedback.iter_mut().zip(currents).for_each(|(axis, current)| axis.current_a = *current);
            }
            _ => {}
        }
    }

    /// Sends a request whose answer is not awaited.
    fn leave(&mut self, request: Request) {
        self.reset();
        self.tx = Some(request.packet(self.device.address));
    }
}

impl Protocol<2> for PacketSerial {
    type Rx = [u8];
    type Tx = Packet;

    fn start(&mut self, now: Instant) {
        (self.counters, self.identified) = ([None; 2], false);
        self.phase = Phase::Starting { tries: TRIES, until: now + STANDSTILL_WITHIN };
        self.ask(now, Request::Version);
    }

    fn reset(&mut self) {
        self.phase = Phase::Off;
        (self.outstanding, self.tx) = (None, None);
    }

    fn withdraw(&mut self, _: Instant) {
        self.reset();
        if self.identified {
            self.leave(Request::Duty([0; 2]));
        }
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8], shared: &mut Shared<2>) -> Progress {
        for byte in bytes {
            match self.outstanding {
                Some(Outstanding { request, damaged: false, .. }) => {
                    // An answer is complete, or damaged, before the buffer is full.
                    let _ = self.rx.push(*byte);
                    match request.read(self.device.address, &self.rx) {
                        Received::More => {}
                        Received::Answer(answer) => {
                            self.outstanding = None;
                            let progress = self.answered(now, request, &answer, shared);
                            if progress != Progress::Pending {
                                return progress;
                            }
                        }
                        Received::Garbled => {
                            shared.reject();
                            self.outstanding = self.outstanding.map(|it| Outstanding { damaged: true, ..it });
                        }
                    }
                }
                _ => shared.reject(),
            }
        }
        Progress::Pending
    }

    fn handle_timeout(&mut self, now: Instant, _: &mut Shared<2>) -> Progress {
        if let Phase::Ready { acknowledged, .. } = self.phase
            && acknowledged + self.timing.feedback_within <= now
        {
            return Progress::Lost(LostReason::Silent);
        }
        match self.outstanding {
            Some(Outstanding { request, until, .. }) if until <= now => {
                self.outstanding = None;
                self.unanswered(now, request)
            }
            _ => Progress::Pending,
        }
    }

    fn send(&mut self, now: Instant, setpoint: &Setpoint<2>, shared: &Shared<2>) {
        let counts = |axis: usize| {
            let turns = setpoint.velocity_radps[axis] * shared.axes[axis].turns_per_rad();
            // Saturates; the limits of an axis are far below.
            libm::round(turns * self.device.counts_per_turn[axis]) as i32
        };
        let speeds = [counts(0), counts(1)];
        if let Phase::Ready { drive, reads, .. } = &mut self.phase {
            (*drive, *reads) = (Some(speeds), READS.len() + 1);
            if self.outstanding.is_none() {
                self.next(now);
            }
        }
    }

    fn halt(&mut self, _: Instant) {
        self.leave(Request::Drive([0; 2]));
    }

    fn disarm(&mut self, _: Instant) {
        self.leave(Request::Duty([0; 2]));
    }

    fn poll_tx(&mut self, _: Instant) -> Option<Packet> {
        self.tx.take()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let acknowledged = match self.phase {
            Phase::Ready { acknowledged, .. } => Some(acknowledged + self.timing.feedback_within),
            _ => None,
        };
        earliest([acknowledged, self.outstanding.map(|outstanding| outstanding.until)])
    }
}
