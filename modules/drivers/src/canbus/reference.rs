//! Reference of a drive that was booted: checks that it is the one that homing with this configuration produces.
//!
//! A drive that kept its power keeps its position and its reference while this process, or the bus, is gone. Its homing
//! method (0x6098) and home offset (0x607C) must be ours; whether it is homed at all is in its statusword.

use canopen::master::Ticket;

const METHOD: u16 = 0x6098;
const OFFSET: u16 = 0x607C;
/// Number of retries of an unanswered request.
const RETRIES: u8 = 2;
/// Objects in the order in which they are read.
const OBJECTS: [u16; 2] = [METHOD, OFFSET];

/// Comparison of the drive's homing parameters with ours.
#[derive(Debug)]
pub(super) struct ReferenceCheck {
    expected: [i32; OBJECTS.len()],
    /// Next object.
    next: usize,
    ticket: Option<Ticket>,
    unanswered: u8,
    same: bool,
}

impl ReferenceCheck {
    /// `offset`: position of the homing switch, counts.
    pub(super) fn new(method: i8, offset: i32) -> Self {
        Self { expected: [method.into(), offset], next: 0, ticket: None, unanswered: 0, same: false }
    }

    /// Starts again.
    pub(super) fn start(&mut self) {
        (self.next, self.ticket, self.unanswered, self.same) = (0, None, 0, true);
    }

    /// Requests the next object by `read`. Returns true once all are as expected, false once one is not or cannot be
    /// read.
    pub(super) fn poll(&mut self, read: impl FnOnce(u16) -> Option<Ticket>) -> Option<bool> {
        if !self.same || self.next >= OBJECTS.len() {
            return Some(self.same);
        }
        if self.ticket.is_none() {
            self.ticket = read(OBJECTS[self.next]);
        }
        None
    }

    /// A transfer has ended; `data` if it was read. Returns false for another one's.
    pub(super) fn on_sdo(&mut self, ticket: Ticket, data: Option<&[u8]>) -> bool {
        if self.ticket.take_if(|own| *own == ticket).is_none() {
            return false;
        }
        if data.is_none() && self.unanswered < RETRIES {
            self.unanswered += 1;
            return true;
        }
        let found = match data {
            Some(&[a]) => Some(i32::from(a as i8)),
            Some(&[a, b, c, d]) => Some(i32::from_le_bytes([a, b, c, d])),
            _ => None,
        };
        self.same &= found.is_some() && found == self.expected.get(self.next).copied();
        self.next += 1;
        true
    }
}
