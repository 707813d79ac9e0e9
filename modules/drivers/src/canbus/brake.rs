//! Holding brake of a wheel on the brake output of its drive (0x60FE, bit 0; CiA 402-2), which this driver switches.
//!
//! A holding brake is no service brake: it is released while the motor holds the wheel, and set when the wheel stands.
//!
//! Order     the drive is enabled, the brake is released, that is read back, the time of the release passes; then
//!           set-points other than 0. At the end the wheel stands, the brake is set, that is read back; then the motor
//!           has no torque
//! Unknown   a brake that was not read back as released is not: its wheel is not moved. What was read before a write
//!           does not count after it
//! Output    bit 0 of 0x60FE:1 sets the brake; where there is a mask, 0x60FE:2, its bit 0 says that the output counts.
//!           The output is written before the mask: a brake that is taken over from the drive does not change by that.
//!           While the wheel turns without torque neither is written. A wheel that loses its torque may roll soon:
//!           then the output is set as it was read last, without being read again first

use base::{Duration, Instant, earliest};
use canopen::master::Ticket;
use canopen::{Master, sdo};

const OUTPUTS: u16 = 0x60FE;
/// Outputs, and the mask of those that count.
const PHYSICAL: u8 = 1;
const MASK: u8 = 2;
/// The brake's bit: 1 sets it.
const SET: u32 = 1;
/// A brake that is not as it shall be is tried again after this.
const RETRY: Duration = Duration::from_millis(100);
/// One that is as it shall be is read again after this: another program may have changed it.
const PERIOD: Duration = Duration::from_secs(1);
/// Time in which it must be as it shall be.
const OBEYS: Duration = Duration::from_secs(1);
/// Number of consecutive requests without an answer, or refused, after which its state is unknown.
const UNANSWERED_MAX: u8 = 2;

/// A transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Access {
    ReadMask,
    WriteMask,
    ReadOutput,
    WriteOutput,
}

/// What the wheel does, as far as the brake asks for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wheel {
    /// Its motor has torque, and it is to move.
    Moves,
    /// It stands, and has no torque, or shall have none.
    Rests,
    /// Something else: the brake stays as it is.
    Other,
}

/// The brake of one wheel.
#[derive(Debug)]
pub(super) struct Brake {
    node: u8,
    has_mask: bool,
    release: Duration,
    /// It shall be released; absent until that is known.
    wanted: Option<bool>,
    /// What the wheel did at the last call of [`Self::advance`].
    wheel: Wheel,
    /// The output counts: the mask is as it must be.
    taken: bool,
    mask: u32,
    /// The outputs as read last; absent: unknown.
    output: Option<u32>,
    /// What was written last released it; absent: nothing was written.
    commanded: Option<bool>,
    /// Something was written, and the outputs were not read since.
    unread: bool,
    /// When it was read back as released.
    released: Option<Instant>,
    /// It has been released for its time.
    free: bool,
    ticket: Option<(Ticket, Access)>,
    next: Access,
    due: Option<Instant>,
    unanswered: u8,
    /// When something was written last: what does not hold is not written again and again without a pause.
    written: Option<Instant>,
    /// When it is late. Set while it is not as it shall be.
    late: Option<Instant>,
    /// Its lateness was reported.
    reported: bool,
}

impl Brake {
    /// `has_mask`: the drive has 0x60FE:2. `release`: from the output to the wheel that turns freely.
    pub(super) fn new(node: u8, has_mask: bool, release: Duration) -> Self {
        Self {
            node,
            has_mask,
            release,
            wanted: None,
            wheel: Wheel::Other,
            taken: false,
            mask: 0,
            output: None,
            commanded: None,
            unread: false,
            released: None,
            free: false,
            ticket: None,
            next: if has_mask { Access::ReadMask } else { Access::ReadOutput },
            due: None,
            unanswered: 0,
            written: None,
            late: None,
            reported: false,
        }
    }

    /// True if the wheel may turn.
    pub(super) fn is_free(&self) -> bool {
        self.free
    }

    /// True if it is known to be set.
    pub(super) fn is_set(&self) -> bool {
        self.taken && !self.unread && self.output.is_some_and(|output| output & SET != 0)
    }

    /// `running`: the drive is booted. True once if the brake does not become what it shall be.
    pub(super) fn advance(&mut self, now: Instant, running: bool, wheel: Wheel, master: &mut Master) -> bool {
        if !running {
            *self = Self::new(self.node, self.has_mask, self.release);
            return false;
        }
        // For a new motion it is reported again.
        self.reported &= wheel != Wheel::Moves || self.wheel == Wheel::Moves;
        self.wheel = wheel;
        let wanted = match wheel {
            Wheel::Moves => Some(true),
            Wheel::Rests => Some(false),
            Wheel::Other => self.wanted,
        };
        if wanted != self.wanted {
            (self.wanted, self.late, self.free, self.reported) = (wanted, Some(now + OBEYS), false, false);
            let is_known = self.taken && self.output.is_some();
            if self.ticket.is_none() {
                match wanted {
                    Some(false) if is_known && !self.is_set() => self.go(Access::WriteOutput, now),
                    _ => self.read_again(now),
                }
            }
        }
        let is_so = wanted.is_none_or(|free| if free { self.released.is_some() } else { self.is_set() });
        self.reported &= !is_so;
        if is_so || wheel == Wheel::Other || self.reported {
            self.late = None;
        } else if self.late.is_none() {
            self.late = Some(now + OBEYS);
        }
        let due = *self.due.get_or_insert(now);
        if self.ticket.is_none() && due <= now {
            self.request(now, master);
        }
        let released = self.released.is_some_and(|since| now.since(since) >= self.release);
        self.free = self.wanted == Some(true) && released;
        let is_late = self.late.is_some_and(|late| late <= now);
        if is_late {
            (self.late, self.reported) = (None, true);
        }
        is_late
    }

    fn request(&mut self, now: Instant, master: &mut Master) {
        if matches!(self.next, Access::WriteMask | Access::WriteOutput) {
            if self.wheel == Wheel::Other {
                // It was to be written after a pause, and the wheel has not waited.
                return self.read_again(now + RETRY);
            }
            self.written = Some(now);
        }
        let outputs = self.output.unwrap_or(0);
        let (node, index) = (self.node, OUTPUTS);
        let ticket = match self.next {
            Access::ReadMask => master.sdo_read(now, node, index, MASK),
            Access::WriteMask => master.sdo_write(now, node, index, MASK, (self.mask | SET).to_le_bytes().as_slice()),
            Access::ReadOutput => master.sdo_read(now, node, index, PHYSICAL),
            Access::WriteOutput => {
                let releases = self.wanted == Some(true);
                (self.commanded, self.unread, self.released) = (Some(releases), true, None);
                let value = if releases { outputs & !SET } else { outputs | SET };
                master.sdo_write(now, node, index, PHYSICAL, value.to_le_bytes().as_slice())
            }
        };
        self.due = Some(now + RETRY);
        self.ticket = ticket.ok().map(|ticket| (ticket, self.next));
    }

    /// A transfer has ended; false if it is not one of these.
    pub(super) fn on_sdo(&mut self, now: Instant, ticket: Ticket, result: Result<&[u8], sdo::Error>) -> bool {
        let Some((_, access)) = self.ticket.take_if(|(own, _)| *own == ticket) else { return false };
        let number = |data: &[u8]| data.try_into().ok().map(u32::from_le_bytes);
        let value = match (access, result) {
            (Access::WriteMask | Access::WriteOutput, Ok(_)) => Some(0),
            (_, Ok(data)) => number(data),
            (_, Err(_)) => None,
        };
        let Some(value) = value else {
            // A frame may be lost; what is refused again is unknown.
            self.unanswered = self.unanswered.saturating_add(1);
            if self.unanswered >= UNANSWERED_MAX {
                (self.output, self.released, self.taken) = (None, None, false);
            }
            self.read_again(now + RETRY);
            return true;
        };
        match access {
            Access::WriteMask => self.go(Access::ReadMask, now),
            // It was released, and the wheel has lost its torque meanwhile.
            Access::WriteOutput if self.wanted == Some(false) && self.commanded == Some(true) => {
                self.go(Access::WriteOutput, now);
            }
            Access::WriteOutput => self.go(Access::ReadOutput, now),
            Access::ReadMask => {
                (self.mask, self.taken, self.unanswered) = (value, value & SET != 0, 0);
                self.go(Access::ReadOutput, now);
            }
            Access::ReadOutput => self.on_output(now, value),
        }
        true
    }

    fn go(&mut self, next: Access, at: Instant) {
        (self.next, self.due) = (next, Some(at));
    }

    /// Another program may change either.
    fn read_again(&mut self, at: Instant) {
        self.go(if self.has_mask { Access::ReadMask } else { Access::ReadOutput }, at);
    }

    /// The outputs were read.
    fn on_output(&mut self, now: Instant, output: u32) {
        let is_released = output & SET == 0;
        (self.output, self.unread, self.unanswered) = (Some(output), false, 0);
        self.taken |= !self.has_mask;
        self.released = if is_released && self.taken { self.released.or(Some(now)) } else { None };
        let write = match self.wanted {
            // It is not set at speed, nor released where no motor holds the wheel.
            _ if self.wheel == Wheel::Other => None,
            Some(free) if free != is_released => Some(Access::WriteOutput),
            Some(_) if !self.taken => Some(Access::WriteMask),
            _ => None,
        };
        let is_other = write == Some(Access::WriteOutput) && self.commanded != self.wanted;
        match write {
            Some(write) if is_other => self.go(write, now),
            Some(write) => self.go(write, self.written.map_or(now, |at| now.max(at + RETRY))),
            None => self.read_again(now + PERIOD),
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let due = self.due.filter(|_| self.ticket.is_none());
        let frees = self.released.filter(|_| self.wanted == Some(true) && !self.free).map(|at| at + self.release);
        earliest([due, frees, self.late])
    }
}
