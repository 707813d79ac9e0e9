//! Scheduled events in a total order: by time, then by order of scheduling.

use base::can::{Frame, Notice};
use base::serial::Word;
use base::{Instant, gamepad, gpio, i2c, store, thermal, w1};
use messages::Message;
use module::admission::Sender;
use module::{ExitStatus, PortId};
use std::cmp::Ordering;
use std::rc::Rc;

/// A message on the LCM bus.
pub(super) struct SentMessage {
    pub sender: Sender,
    pub message: Message,
}

/// An event with its data, as a hung process's buffers hold it.
pub(super) enum Waiting {
    Message(Instant, Rc<SentMessage>),
    Heard(Instant, Rc<str>, Rc<[u8]>),
    Can(PortId, Frame),
    Notice(PortId, Notice),
    Down(PortId),
    Up(PortId),
    Words(PortId, Rc<[Word]>),
    Sent(PortId),
    I2c(PortId, i2c::Outcome),
    I2cRequested(PortId, i2c::Transfer),
    OneWire(PortId, w1::Answer),
    Thermal(PortId, thermal::State),
    Gamepad(PortId, Rc<gamepad::Event>),
    Gpio(PortId, gpio::Signal),
    Store(PortId, store::Answer),
    Exited(u32, ExitStatus),
    Started(Rc<str>, u32),
    Unstartable(Rc<str>, Rc<str>),
    HeartbeatStarted(u32),
    HeartbeatLate(u32, Instant),
    /// The watchdog of another robot may have been silent for long enough.
    SecondRobotEnd,
    Terminate,
    Start,
}

/// Events apart from timers and wires.
pub(super) enum Happening {
    Deliver(Rc<SentMessage>),
    Inject(SentMessage),
    /// A foreign frame is sent on the CAN wire of this index.
    Frame(usize, Frame),
    Tell(u32, Waiting),
    /// A delayed event of a slow process is served.
    Serve(u32, Waiting),
    /// Heartbeats are checked.
    Look,
    /// The children of a process have waited for it long enough.
    Lonely(u32),
    /// A supervised process is restarted.
    Again(usize),
}

/// A scheduled event and its position in the total order.
pub(super) struct Entry {
    pub at: Instant,
    pub number: u64,
    pub happening: Happening,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        (self.at, self.number) == (other.at, other.number)
    }
}
impl Eq for Entry {}
impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        (self.at, self.number).cmp(&(other.at, other.number))
    }
}
