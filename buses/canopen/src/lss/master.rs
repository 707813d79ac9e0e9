//! The master of CiA 305: one command at a time, each of which ends in [`Event::Done`] or [`Event::Failed`].

use super::command::{Command, Event, Failure, Refusal, StartError, Timing};
use super::scan::{Next, Scan};
use super::wire::{Bound, Confirm, Request, Response};
use super::{Address, Mode, Part, UNCONFIGURED};
use crate::wire::Service;
use alloc::vec::Vec;
use base::can::{Frame, Id};
use base::{Duration, Instant, Queue};

/// No more slaves fit a network.
const SLAVES_MAX: usize = 127;

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

    /// True if no command runs.
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
                self.fail(run.command, Failure::Refused(Refusal::of(run.command, confirm)));
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

    /// How far the search for one slave is, 0 to 1; `None` while none is searched for. It begins anew for each slave
    /// that [`Command::FindAll`] finds, and after a question that must be asked again.
    #[must_use]
    pub fn scan_share(&self) -> Option<f64> {
        self.run.as_ref()?.scan.as_ref().map(Scan::share)
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

fn delay(command: Command) -> Duration {
    match command {
        Command::Activate { delay_ms } => Duration::from_millis(u64::from(delay_ms)),
        _ => Duration::ZERO,
    }
}
