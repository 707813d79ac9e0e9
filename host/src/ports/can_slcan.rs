//! A CAN adapter on a serial device that speaks Lawicel's ASCII protocol (`slcan`): USB sticks, pseudo-terminals.
//!
//! The adapter determines what is known of the bus; many report nothing. Its flags are polled once a second beside the
//! traffic until it rejects that command.

pub mod codec;

use super::queue::Queue;
use super::restart::Restart;
use super::{Device, Lost, Received};
use crate::{clock, sys};
use base::can::{BusState, Frame, Health, Id, Notice};
use base::{Duration, Fault, Instant};
use codec::{AdapterLine, Flags, Lines};
use module::{Input, Line, Output};
use nix::errno::Errno;
use nix::fcntl::{OFlag, open};
use nix::libc;
use nix::sys::stat::Mode;
use nix::sys::termios::{FlushArg, tcflush};
use nix::unistd::{read, write};
use std::collections::VecDeque;
use std::io::ErrorKind;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::PathBuf;

/// Meaningless to an adapter on USB; the usual rate of one behind a serial chip.
const BAUD: u32 = 115_200;
/// Time that an adapter in use has to close its channel and to finish its output.
const SETTLE: Duration = Duration::from_millis(50);
/// Period of polling the flags.
const FLAGS_PERIOD: Duration = Duration::from_secs(1);
/// Maximum number of bytes per read.
const READ_MAX: usize = 1024;

/// CAN adapter with the slcan protocol.
pub struct CanSlcan {
    path: PathBuf,
    bitrate: u32,
    /// True if frames with 29-bit identifiers are wanted.
    extended: bool,
    file: Option<OwnedFd>,
    /// End of the time in which the adapter closes its channel after opening.
    settles: Option<Instant>,
    lines: Lines,
    unread: VecDeque<AdapterLine>,
    /// Unsent rest of a line.
    rest: String,
    queue: Queue,
    /// Commands without an answer so far.
    pending: VecDeque<PendingCommand>,
    /// Next time to poll the flags; `None` if the adapter has none.
    flags: Option<Instant>,
    health: Health,
    /// Notices that are delivered before the next read.
    notices: VecDeque<Notice>,
    restart: Restart,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum PendingCommand {
    Bitrate,
    Open,
    Flags,
}

impl CanSlcan {
    /// Creates the port of an adapter at a device file, for a bus of `bitrate` bit/s.
    pub fn new(path: PathBuf, bitrate: u32) -> Self {
        Self {
            path,
            bitrate,
            extended: true,
            file: None,
            settles: None,
            lines: Lines::default(),
            unread: VecDeque::new(),
            rest: String::new(),
            queue: Queue::default(),
            pending: VecDeque::new(),
            flags: None,
            health: Health::default(),
            notices: VecDeque::new(),
            restart: Restart::default(),
        }
    }

    fn lost(&self, why: &str) -> Lost {
        format!("{}: {why}", self.path.display())
    }

    /// Opens the device and closes the adapter's channel, whatever its state.
    fn begin(&mut self, now: Instant) -> Result<(), Lost> {
        let flags = OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC;
        let file = open(&self.path, flags, Mode::empty()).map_err(|errno| self.lost(errno.desc()))?;
        sys::take_exclusively(file.as_fd()).map_err(|error| match error.kind() {
            ErrorKind::WouldBlock => self.lost("another process holds it"),
            _ => self.lost(&error.to_string()),
        })?;
        let told = |error: std::io::Error| self.lost(&format!("its settings: {error}"));
        let mut settings = sys::line_settings(file.as_fd()).map_err(told)?;
        (settings.c_iflag, settings.c_oflag, settings.c_lflag) = (0, 0, 0);
        settings.c_cflag = libc::CS8 | libc::CREAD | libc::CLOCAL | libc::BOTHER;
        (settings.c_ispeed, settings.c_ospeed) = (BAUD, BAUD);
        (settings.c_cc[libc::VMIN], settings.c_cc[libc::VTIME]) = (1, 0);
        sys::set_line_settings(file.as_fd(), &settings, false).map_err(told)?;
        self.file = Some(file);
        // The first end of line completes whatever another program left unfinished.
        self.rest.push_str("\rC\r");
        self.flush()?;
        self.settles = Some(now + SETTLE);
        Ok(())
    }

    /// Discards all input so far and opens the adapter's channel.
    fn join(&mut self, now: Instant, command: &str) -> Result<(), Lost> {
        let Some(file) = &self.file else { return Ok(()) };
        tcflush(file, FlushArg::TCIFLUSH).map_err(|errno| self.lost(errno.desc()))?;
        self.lines.clear();
        self.rest.push_str(command);
        self.rest.push_str("O\r");
        self.pending.extend([PendingCommand::Bitrate, PendingCommand::Open]);
        self.flags = Some(now + FLAGS_PERIOD);
        self.restart.on(now);
        self.flush()
    }

    /// Writes pending output.
    fn flush(&mut self) -> Result<(), Lost> {
        let Some(file) = &self.file else { return Ok(()) };
        while !self.rest.is_empty() {
            match write(file, self.rest.as_bytes()) {
                Ok(written) => drop(self.rest.drain(..written)),
                Err(Errno::EAGAIN) => break,
                Err(Errno::EINTR) => {}
                Err(errno) => return Err(self.lost(errno.desc())),
            }
        }
        Ok(())
    }

    fn read(&mut self) -> Result<(), Lost> {
        let Some(file) = &self.file else { return Ok(()) };
        let mut bytes = [0; READ_MAX];
        let length = match read(file, &mut bytes) {
            Ok(0) => return Err(self.lost("hung up")),
            Ok(length) => length,
            Err(Errno::EAGAIN | Errno::EINTR) => 0,
            Err(errno) => return Err(self.lost(errno.desc())),
        };
        self.unread.extend(bytes[..length].iter().filter_map(|byte| self.lines.push(*byte)));
        Ok(())
    }

    /// Polls the flags if that is due and the last answer has arrived.
    fn poll_flags(&mut self, now: Instant) -> Result<(), Lost> {
        if self.flags.is_some_and(|due| due <= now) && self.pending.is_empty() {
            self.flags = Some(now + FLAGS_PERIOD);
            self.pending.push_back(PendingCommand::Flags);
            self.rest.push_str("F\r");
            self.flush()?;
        }
        Ok(())
    }

    /// The adapter rejected a command.
    fn on_rejection(&mut self) -> Result<Received<'static>, Lost> {
        match self.pending.pop_front() {
            Some(PendingCommand::Bitrate) => Err(self.lost(&format!("the adapter refuses {} bit/s", self.bitrate))),
            Some(PendingCommand::Open) => Err(self.lost("the adapter does not open its channel")),
            Some(PendingCommand::Flags) => {
                self.flags = None;
                Ok(Received::Note("the adapter does not report the state of its controller".into()))
            }
            None => Ok(Received::Fault(Fault::PortOverrun, "the adapter refuses a frame".into())),
        }
    }

    fn on_flags(&mut self, flags: Flags) {
        self.pending.retain(|pending| *pending != PendingCommand::Flags);
        // Adapters do not report the error counters.
        self.on_health(Health { state: flags.state, ..Health::default() });
        self.notices.extend(flags.error.then_some(Notice::Errors(1)));
        self.notices.extend(flags.lost.then_some(Notice::Lost(1)));
    }

    fn on_health(&mut self, health: Health) {
        if health != self.health {
            self.health = health;
            self.notices.push_back(Notice::Health(health));
        }
    }

    /// Result to deliver for a line of the adapter, if any.
    fn on_line(&mut self, now: Instant, line: AdapterLine) -> Result<Option<Received<'static>>, Lost> {
        match line {
            AdapterLine::Frame(frame) if self.extended || matches!(frame.id(), Id::Standard(_)) => {
                return Ok(Some(Received::input(now, Input::Can { frame, at: now })));
            }
            AdapterLine::Frame(_) | AdapterLine::Other => {}
            // Some adapters answer frames too; only answers to commands before them are awaited.
            AdapterLine::Acknowledged if self.pending.front() == Some(&PendingCommand::Flags) => {}
            AdapterLine::Acknowledged => drop(self.pending.pop_front()),
            AdapterLine::Rejected => return self.on_rejection().map(Some),
            AdapterLine::Flags(flags) => self.on_flags(flags),
            AdapterLine::Health(health) => self.on_health(health),
            AdapterLine::Malformed => {
                let what = "dropped a line that is not of the slcan protocol";
                return Ok(Some(Received::Fault(Fault::MessageMalformed, what.into())));
            }
        }
        Ok(None)
    }

    /// Drops pending frames that are too old; those still in the kernel are older.
    fn drop_old(&mut self, now: Instant) {
        if self.queue.drop_old(now) {
            self.drop_output();
        }
    }

    /// Discards all unsent output.
    fn drop_output(&mut self) {
        if let Some(file) = &self.file {
            let _ = tcflush(file, FlushArg::TCOFLUSH);
        }
        // Ends a partial line, which the adapter rejects.
        self.rest.clear();
        self.rest.push('\r');
    }

    fn write_frame(&mut self, frame: &Frame) -> Result<(), Lost> {
        codec::encode(frame, &mut self.rest);
        self.flush()
    }
}

impl Device for CanSlcan {
    fn expect(&mut self, _line: Line, everything: bool) {
        self.extended = everything;
    }

    fn open(&mut self) -> Result<(), Lost> {
        let now = clock::now();
        let Some(command) = codec::bitrate_command(self.bitrate) else {
            return Err(self.lost(&format!("the slcan protocol has no {} bit/s", self.bitrate)));
        };
        match self.settles {
            None => {
                self.close();
                if self.health.state == BusState::Off && !self.restart.is_due(now) {
                    return Err(self.lost("bus-off"));
                }
                self.begin(now)?;
                Err(self.lost("the adapter is closing its channel"))
            }
            Some(until) if now < until => Err(self.lost("the adapter is closing its channel")),
            Some(_) => {
                self.settles = None;
                self.health = Health::default();
                self.join(now, command)
            }
        }
    }

    fn is_preparing(&self) -> bool {
        self.settles.is_some()
    }

    fn close(&mut self) {
        if self.file.is_some() && self.settles.is_none() {
            self.drop_output();
            self.rest.push_str("C\r");
            let _ = self.flush();
        }
        (self.file, self.settles) = (None, None);
        self.lines.clear();
        self.rest.clear();
        self.unread.clear();
        self.queue.clear();
        self.pending.clear();
        self.notices.clear();
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.file.as_ref().map(AsFd::as_fd)
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        self.poll_flags(now)?;
        loop {
            if let Some(notice) = self.notices.pop_front() {
                return Ok(Received::input(now, Input::CanNotice(notice)));
            }
            if self.health.state == BusState::Off {
                self.restart.off(now);
                return Err(self.lost("bus-off"));
            }
            if self.unread.is_empty() {
                self.read()?;
            }
            let Some(line) = self.unread.pop_front() else {
                return Ok(Received::Nothing);
            };
            if let Some(received) = self.on_line(now, line)? {
                return Ok(received);
            }
        }
    }

    fn send(&mut self, now: Instant, output: &Output) -> Result<bool, Lost> {
        let (Some(_), Output::Can(frame)) = (&self.file, output) else {
            return Ok(false);
        };
        self.drop_old(now);
        if !self.rest.is_empty() {
            return Ok(self.queue.push(now, *frame));
        }
        self.queue.passed(now);
        self.write_frame(frame)?;
        Ok(true)
    }

    fn wants_to_write(&self) -> bool {
        !self.rest.is_empty()
    }

    fn on_writable(&mut self, now: Instant) -> Result<(), Lost> {
        self.drop_old(now);
        self.flush()?;
        while self.rest.is_empty()
            && let Some(frame) = self.queue.front().copied()
        {
            self.queue.pop(now);
            self.write_frame(&frame)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
