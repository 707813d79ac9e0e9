//! What the module and the thread of the transport exchange.

use crate::clocks::Comparison;
use crate::gate::Passes;
use base::Instant;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Maximum number of messages, and of their bytes, that wait for the thread; further ones are left out and counted.
/// Those that stop the robot have as much room again.
const OUTGOING_MAX: (usize, usize) = (1024, 4 << 20);
/// Maximum number of notes that wait for the module.
const NOTES_MAX: usize = 32;

/// A message of this computer's bus that was accepted by the host.
#[derive(Clone, Debug)]
pub(crate) struct Outgoing {
    /// Time of its publication.
    pub(crate) at: Instant,
    /// Name of its channel.
    pub(crate) channel: String,
    /// Module that it is about, if any.
    pub(crate) module: Option<String>,
    /// It stops the robot: it is left out last.
    pub(crate) stops: bool,
    /// Encoded message.
    pub(crate) payload: Vec<u8>,
}

/// Numbers of messages since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counters {
    /// Sent to the other computer.
    pub(crate) sent: u64,
    /// Received and published here.
    pub(crate) received: u64,
    /// Connections and records refused: no key, changed, repeated, not of the protocol.
    pub(crate) refused: u64,
    /// Received messages dropped since they are too old, or their time stamp is in the future.
    pub(crate) late: u64,
    /// Messages dropped for any other reason, in both directions; wanted limits of a rate do not count.
    pub(crate) dropped: u64,
}

/// State of a connection.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Status {
    /// Address of the other computer; empty without a connection.
    pub(crate) peer: String,
    /// The other computer has the key, is not silent, and its clock is compared.
    pub(crate) up: bool,
    /// Clocks, while it is up.
    pub(crate) clocks: Option<Comparison>,
    /// Modules that have to work there, and do not or are unknown.
    pub(crate) missing: Vec<String>,
    pub(crate) counters: Counters,
}

/// Note for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Note {
    /// A warning.
    Warning(String),
    /// Something without the key was refused by the connection of this name.
    Refused(String, String),
}

#[derive(Debug, Default)]
struct Inner {
    notes: Vec<Note>,
    outgoing: Vec<Outgoing>,
    outgoing_bytes: usize,
    outgoing_lost: u64,
    modules: Option<(Instant, Vec<(String, bool)>)>,
    status: Vec<Status>,
}

/// State that both use.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) end: AtomicBool,
    pub(crate) turns: AtomicU32,
    passes: AtomicU8,
    inner: Mutex<Inner>,
    /// A byte here ends the wait of the thread.
    wake: UnixStream,
}

impl Shared {
    pub(crate) fn new(wake: UnixStream) -> Self {
        let (end, turns, passes) = (AtomicBool::new(false), AtomicU32::new(0), AtomicU8::new(Passes::Nothing as u8));
        Self { end, turns, passes, inner: Mutex::default(), wake }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn wake(&self) {
        // A full pipe wakes, too.
        let _ = (&self.wake).write(&[0]);
    }

    pub(crate) fn set_passes(&self, passes: Passes) {
        self.passes.store(passes as u8, Relaxed);
    }

    pub(crate) fn passes(&self) -> Passes {
        let passes = self.passes.load(Relaxed);
        [Passes::Data, Passes::All].into_iter().find(|known| *known as u8 == passes).unwrap_or_default()
    }

    pub(crate) fn push(&self, message: Outgoing) {
        let mut inner = self.inner();
        let bytes = inner.outgoing_bytes + message.payload.len();
        let room = if message.stops { 2 } else { 1 };
        if inner.outgoing.len() >= room * OUTGOING_MAX.0 || bytes > room * OUTGOING_MAX.1 {
            inner.outgoing_lost += 1;
            return;
        }
        inner.outgoing_bytes = bytes;
        inner.outgoing.push(message);
        drop(inner);
        self.wake();
    }

    /// Messages that wait, and the number of those left out since the last call.
    pub(crate) fn take_outgoing(&self) -> (Vec<Outgoing>, u64) {
        let mut inner = self.inner();
        inner.outgoing_bytes = 0;
        (std::mem::take(&mut inner.outgoing), std::mem::take(&mut inner.outgoing_lost))
    }

    /// Modules of this computer as its watchdog listed them at that time.
    pub(crate) fn set_modules(&self, at: Instant, modules: Vec<(String, bool)>) {
        self.inner().modules = Some((at, modules));
    }

    pub(crate) fn modules(&self) -> Option<(Instant, Vec<(String, bool)>)> {
        self.inner().modules.clone()
    }

    pub(crate) fn set_status(&self, status: Vec<Status>) {
        self.inner().status = status;
    }

    pub(crate) fn status(&self) -> Vec<Status> {
        self.inner().status.clone()
    }

    pub(crate) fn note(&self, note: Note) {
        let mut inner = self.inner();
        if inner.notes.len() < NOTES_MAX && !inner.notes.contains(&note) {
            inner.notes.push(note);
        }
    }

    pub(crate) fn take_notes(&self) -> Vec<Note> {
        std::mem::take(&mut self.inner().notes)
    }
}
