//! The master of CiA 305: one command at a time, each of which ends in [`Event::Done`] or [`Event::Failed`].

use super::scan::{Next, Scan};
use super::wire::{Bound, Confirm, Request, Response};
use super::{Address, BitRate, Mode, Part, UNCONFIGURED};
use crate::wire::Service;
use alloc::vec::Vec;
use base::can::{Frame, Id};
use base::{Duration, Instant, Queue};

/// No more slaves fit a network.
const SLAVES_MAX: usize = 127;

/// How long the master waits for what.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// For the answer to a request (100 ms).
    pub answer: Duration,
    /// For the answers to one question of a fastscan or an identification, always in full (20 ms): more than one slave
    /// may answer, and an answer that comes later is taken for that to the next question. Each repetition of a scan
    /// takes twice as long. Slow slaves and a bus full of them need more.
    pub scan: Duration,
    /// After a frame that is not answered (2 ms); there are slaves that cannot take the next one at once.
    pub gap: Duration,
    /// How often something unanswered is tried, 1 to 8 (3).
    pub attempts: u8,
}

impl Default for Timing {
    fn default() -> Self {
        let millis = Duration::from_millis;
        Self { answer: millis(100), scan: millis(20), gap: millis(2), attempts: 3 }
    }
}

/// Which slaves [`Command::Identify`] means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // bounds are part of it
pub struct Range {
    pub vendor: u32,
    pub product: u32,
    pub revision: (u32, u32),
    pub serial: (u32, u32),
}

/// What the master can do. Those from [`Self::InquireAddress`] on mean the slave in the configuration state; a choice
/// of one is up to the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// All slaves into a state. A slave that got a node id boots when it goes to waiting.
    SwitchGlobal(Mode),
    /// This slave into the configuration state, all others to waiting.
    Select(Address),
    /// The slave without node id with the lowest address into the configuration state, all others to waiting: one
    /// [`Event::Found`].
    Find,
    /// As [`Self::Find`] until none is left, at most 127; at the end all are waiting. [`Event::Found`] for each, maybe none.
    FindAll,
    /// Is there a slave within this range? [`Event::Present`].
    Identify(Range),
    /// Is there a slave without node id? [`Event::Present`].
    IdentifyNonConfigured,
    /// [`Event::Address`].
    InquireAddress,
    /// [`Event::NodeId`].
    InquireNodeId,
    /// 1 to 127, or [`UNCONFIGURED`] to have none. In use when the slave resets its communication; a slave without node
    /// id does when it goes to waiting.
    SetNodeId(u8),
    /// In use after [`Self::Activate`], or when stored, after power-on.
    SetBitRate(BitRate),
    /// All slaves in the configuration state change their bit rate: for `delay_ms` before and after nobody may send.
    /// Between them comes [`Event::SwitchNow`].
    Activate {
        /// ms.
        delay_ms: u16,
    },
    /// Node id and bit rate are kept over power-off.
    Store,
}

/// Why a command was not taken. Nothing was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartError {
    /// Another one runs.
    Busy,
    /// Neither 1 to 127 nor [`UNCONFIGURED`].
    NodeId,
}

/// A slave said no.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// To a node id: out of range.
    NodeIdOutOfRange,
    /// To a bit rate.
    BitRateNotSupported,
    /// It cannot store.
    StoreNotSupported,
    /// It could not store: its medium failed.
    StorageAccess,
    /// The manufacturer's own reason.
    Specific(u8),
    /// A code that the standard does not name.
    Other(u8),
}

/// Why a command did not succeed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// Nobody answered, as often as it was tried.
    NoAnswer,
    /// The slave said no.
    Refused(Refusal),
    /// The answers to a scan contradict each other each time: frames are lost, answers come late, or a slave answers what
    /// does not concern it. What was found before stands.
    Contradiction,
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A slave without node id.
    Found(Address),
    /// The answer to [`Command::Identify`] and [`Command::IdentifyNonConfigured`].
    Present(bool),
    /// The answer to [`Command::InquireAddress`].
    Address(Address),
    /// The answer to [`Command::InquireNodeId`]; `None`: it has none.
    NodeId(Option<u8>),
    /// The master's own controller changes its bit rate now.
    SwitchNow,
    /// The command is done. The next one may start.
    Done(Command),
    /// The command failed. The next one may start.
    Failed(Command, Failure),
}

/// What a frame is followed by.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wait {
    Gap,
    Answer,
    /// All answers, in full.
    Window,
    /// For an activation.
    Delay,
}

/// A command under way.
struct Run {
    command: Command,
    /// Which of its frames; the scan is behind the last.
    at: u8,
    /// `None` until the frames before the scan are sent.
    scan: Option<Scan>,
    /// What was asked and is waited for.
    request: Request,
    wait: Wait,
    until: Instant,
    heard: bool,
    attempt: u8,
    words: [u32; 4],
    /// Found so far, and in which pass last: none can be found twice in one, as it is in the configuration state then.
    found: Vec<(Address, u16)>,
    pass: u16,
}

/// An LSS master.
pub struct Master {
    timing: Timing,
    run: Option<Run>,
    tx: Queue<Frame, 4>,
    events: Queue<Event, 8>,
}

impl Master {
    /// Idle.
    #[must_use]
    pub fn new(timing: Timing) -> Self {
        let Timing { answer, scan, gap, attempts } = timing;
        let [answer, scan, gap] = [answer, scan, gap].map(|wait| wait.max(Duration::from_micros(1)));
        let timing = Timing { answer, scan, gap, attempts: attempts.clamp(1, 8) };
        Self { timing, run: None, tx: Queue::new(), events: Queue::new() }
    }

    /// Starts a command; its end comes as an event.
    ///
    /// # Errors
    /// Another one runs, or the node id is none.
    pub fn start(&mut self, now: Instant, command: Command) -> Result<(), StartError> {
        if self.run.is_some() {
            return Err(StartError::Busy);
        }
        if matches!(command, Command::SetNodeId(id) if !matches!(id, 1..=127 | UNCONFIGURED)) {
            return Err(StartError::NodeId);
        }
        let run = Run {
            command,
            at: 0,
            scan: None,
            request: Request::SwitchGlobal(Mode::Waiting),
            wait: Wait::Gap,
            until: now,
            heard: false,
            attempt: 0,
            words: [0; 4],
            found: Vec::new(),
            pass: 0,
        };
        self.go_on(now, run);
        Ok(())
    }

    /// Whether no command runs.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.run.is_none()
    }

    /// Forgets the command that runs, without an event. Slaves stay in the state they are in.
    pub fn cancel(&mut self) {
        self.run = None;
        self.tx.clear();
    }

    /// Sends the frame that `run` is at, or ends it.
    fn go_on(&mut self, now: Instant, mut run: Run) {
        let Some((request, wait)) = run.next() else {
            self.events.push(Event::Done(run.command));
            return;
        };
        let Timing { answer, scan, gap, .. } = self.timing;
        let limit = match wait {
            Wait::Gap => gap,
            Wait::Answer => answer,
            Wait::Window => Duration::from_nanos(scan.as_nanos() as u64 * (1 << run.attempt)),
            Wait::Delay => delay(run.command),
        };
        (run.request, run.wait, run.until, run.heard) = (request, wait, now + limit, false);
        self.tx.push(request.frame());
        self.run = Some(run);
    }

    fn fail(&mut self, command: Command, failure: Failure) {
        // Whoever the scan has chosen would obey what is sent to another one.
        if matches!(command, Command::Find | Command::FindAll) {
            self.tx.push(Request::SwitchGlobal(Mode::Waiting).frame());
        }
        self.events.push(Event::Failed(command, failure));
    }

    /// A frame from the bus; others than responses do no harm.
    pub fn handle_rx(&mut self, now: Instant, frame: &Frame) {
        if frame.id() != Id::Standard(Service::LssResponse.cob_id()) {
            return;
        }
        let Some(response) = Response::decode(frame.data()) else {
            return;
        };
        let Some(mut run) = self.run.take() else {
            return;
        };
        let confirm = match (run.request, response) {
            (Request::FastScan(_) | Request::Identify { .. }, Response::Identified)
            | (Request::IdentifyNonConfigured, Response::NonConfigured) => {
                run.heard = true;
                None
            }
            (Request::Select { part: Part::Serial, .. }, Response::Selected) => Some(Confirm::default()),
            (Request::SetNodeId(_), Response::NodeIdSet(confirm))
            | (Request::SetBitTiming { .. }, Response::BitTimingSet(confirm))
            | (Request::Store, Response::Stored(confirm)) => Some(confirm),
            (Request::Inquire(asked), Response::Inquired { part, number }) if asked == part => {
                run.words[part as usize] = number;
                if part == Part::Serial {
                    self.events.push(Event::Address(Address::from_words(run.words)));
                }
                Some(Confirm::default())
            }
            (Request::InquireNodeId, Response::NodeId(id)) => {
                self.events.push(Event::NodeId(matches!(id, 1..=127).then_some(id)));
                Some(Confirm::default())
            }
            _ => None,
        };
        match confirm {
            None => self.run = Some(run),
            Some(confirm) if confirm.error != 0 => {
                self.fail(run.command, Failure::Refused(refusal(run.command, confirm)));
            }
            Some(_) => {
                run.at += 1;
                run.attempt = 0;
                self.go_on(now, run);
            }
        }
    }

    /// Does what is due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.run.as_ref().is_none_or(|run| now < run.until) {
            return;
        }
        let Some(mut run) = self.run.take() else {
            return;
        };
        match run.wait {
            Wait::Gap => {
                run.at += 1;
                self.go_on(now, run);
            }
            Wait::Answer => self.unanswered(now, run),
            Wait::Window => match &mut run.scan {
                Some(scan) => {
                    let next = scan.advance(run.heard);
                    self.scanned(now, run, next);
                }
                None if run.heard || run.attempt + 1 >= self.timing.attempts => {
                    self.events.push(Event::Present(run.heard));
                    self.events.push(Event::Done(run.command));
                }
                None => {
                    run.attempt += 1;
                    run.at = 0;
                    self.go_on(now, run);
                }
            },
            // Half of it is over; `heard` tells the halves apart, as nothing is answered.
            Wait::Delay => {
                if !run.heard {
                    self.events.push(Event::SwitchNow);
                    (run.until, run.heard) = (run.until + delay(run.command), true);
                }
                if run.until <= now {
                    self.events.push(Event::Done(run.command));
                } else {
                    self.run = Some(run);
                }
            }
        }
    }

    fn unanswered(&mut self, now: Instant, mut run: Run) {
        run.attempt += 1;
        if run.attempt >= self.timing.attempts {
            return self.fail(run.command, Failure::NoAnswer);
        }
        if matches!(run.command, Command::Select(_)) {
            run.at = 0;
        }
        self.go_on(now, run);
    }

    fn scanned(&mut self, now: Instant, mut run: Run, next: Next) {
        let last = run.attempt + 1 >= self.timing.attempts;
        match (next, run.command) {
            (Next::Ask, _) => self.go_on(now, run),
            (Next::Found(address), Command::FindAll) => self.found(now, run, address),
            (Next::Found(address), command) => {
                self.events.push(Event::Found(address));
                self.events.push(Event::Done(command));
            }
            (Next::Nobody, Command::FindAll) if last => {
                run.finish();
                self.go_on(now, run);
            }
            (Next::Nobody, command) if last => self.fail(command, Failure::NoAnswer),
            (Next::Contradiction, command) if last => self.fail(command, Failure::Contradiction),
            (Next::Nobody, _) => {
                run.attempt += 1;
                run.scan = Some(Scan::new());
                self.go_on(now, run);
            }
            // The lost answer may have been the last: the slave is in the configuration state then.
            (Next::Contradiction, _) => {
                run.attempt += 1;
                run.pass += 1;
                (run.at, run.scan) = (0, None);
                self.go_on(now, run);
            }
        }
    }

    fn found(&mut self, now: Instant, mut run: Run, address: Address) {
        match run.found.iter_mut().find(|(known, _)| *known == address) {
            Some((_, pass)) if *pass == run.pass => return self.fail(run.command, Failure::Contradiction),
            Some((_, pass)) => *pass = run.pass,
            // Only somebody new renews the attempts: this ends.
            None => {
                run.found.push((address, run.pass));
                run.attempt = 0;
                self.events.push(Event::Found(address));
            }
        }
        if run.found.len() == SLAVES_MAX {
            run.finish();
        } else {
            run.scan = Some(Scan::new());
        }
        self.go_on(now, run);
    }

    /// A frame to send.
    pub fn poll_tx(&mut self) -> Option<Frame> {
        self.tx.pop()
    }

    /// What happened.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    /// When to call [`Self::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.run.as_ref().map(|run| run.until)
    }
}

impl Run {
    /// What it sends next; `None` at its end.
    fn next(&mut self) -> Option<(Request, Wait)> {
        let at = usize::from(self.at);
        let waiting = Request::SwitchGlobal(Mode::Waiting);
        match (self.command, at) {
            (Command::SwitchGlobal(mode), 0) => Some((Request::SwitchGlobal(mode), Wait::Gap)),
            (Command::Select(_) | Command::Find | Command::FindAll, 0) => Some((waiting, Wait::Gap)),
            (Command::Select(address), 1..=4) => {
                let (part, number) = (Part::ALL[at - 1], address.words()[at - 1]);
                Some((Request::Select { part, number }, if at == 4 { Wait::Answer } else { Wait::Gap }))
            }
            (Command::Find | Command::FindAll, 1) => {
                let scan = self.scan.get_or_insert_with(Scan::new);
                Some((Request::FastScan(scan.request()), Wait::Window))
            }
            (Command::FindAll, 2) => Some((waiting, Wait::Gap)),
            (Command::Identify(range), 0..=5) => {
                let (bound, number) = (Bound::ALL[at], range.bounds()[at]);
                Some((Request::Identify { bound, number }, if at == 5 { Wait::Window } else { Wait::Gap }))
            }
            (Command::IdentifyNonConfigured, 0) => Some((Request::IdentifyNonConfigured, Wait::Window)),
            (Command::InquireAddress, 0..=3) => Some((Request::Inquire(Part::ALL[at]), Wait::Answer)),
            (Command::InquireNodeId, 0) => Some((Request::InquireNodeId, Wait::Answer)),
            (Command::SetNodeId(id), 0) => Some((Request::SetNodeId(id), Wait::Answer)),
            (Command::SetBitRate(rate), 0) => {
                Some((Request::SetBitTiming { table: 0, index: rate as u8 }, Wait::Answer))
            }
            (Command::Activate { delay_ms }, 0) => Some((Request::Activate { delay_ms }, Wait::Delay)),
            (Command::Store, 0) => Some((Request::Store, Wait::Answer)),
            _ => None,
        }
    }

    /// No more scans: on to the last frame.
    fn finish(&mut self) {
        self.at = 2;
        self.scan = None;
    }
}

impl Range {
    fn bounds(&self) -> [u32; 6] {
        let Self { vendor, product, revision, serial } = *self;
        [vendor, product, revision.0, revision.1, serial.0, serial.1]
    }
}

fn delay(command: Command) -> Duration {
    match command {
        Command::Activate { delay_ms } => Duration::from_millis(u64::from(delay_ms)),
        _ => Duration::ZERO,
    }
}

fn refusal(command: Command, Confirm { error, specific }: Confirm) -> Refusal {
    match (command, error) {
        (_, 0xFF) => Refusal::Specific(specific),
        (Command::SetNodeId(_), 1) => Refusal::NodeIdOutOfRange,
        (Command::SetBitRate(_), 1) => Refusal::BitRateNotSupported,
        (Command::Store, 1) => Refusal::StoreNotSupported,
        (Command::Store, 2) => Refusal::StorageAccess,
        (_, other) => Refusal::Other(other),
    }
}
