//! What the tools share on the bus: a connection, its clock, Ctrl-C.

use super::{Common, Failed};
use base::{Duration, Epoch, Instant};
use host::bus::{Bus, Received};
use host::clock;
use messages::{Channel, Message, common};
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use std::os::fd::AsFd;

/// A tool on the bus.
pub struct Tool {
    bus: Bus,
    epoch: Epoch,
    interrupt: SignalFd,
    /// `drive@HOST:PID`, unique among tools.
    pub source: String,
}

/// Why waiting ended.
pub enum Heard {
    /// A message.
    Message(Message),
    /// The time has come.
    Nothing,
    /// Ctrl-C or SIGTERM.
    Interrupt,
}

impl Tool {
    /// Joins the bus as the tool `name` and subscribes to `channels`. From now on Ctrl-C is returned by [`Tool::hear`].
    pub fn join(common: &Common, name: &str, channels: &[Channel]) -> Result<Self, Failed> {
        Self::join_at(&common.lcm_url(), name, channels)
    }

    /// Joins the bus of a running robot.
    pub fn join_at(lcm_url: &str, name: &str, channels: &[Channel]) -> Result<Self, Failed> {
        let interrupt = interrupt()?;
        let names: Vec<&str> = channels.iter().map(|channel| channel.name()).collect();
        let bus = Bus::open(lcm_url, &names)?;
        let host = nix::unistd::gethostname().ok().and_then(|host| host.into_string().ok()).unwrap_or_default();
        let source = format!("{name}@{host}:{}", std::process::id());
        Ok(Self { bus, epoch: clock::epoch(), interrupt, source })
    }

    /// The timestamp of a message that is made now.
    pub fn timestamp(&self) -> i64 {
        self.epoch.timestamp(clock::now())
    }

    /// Sends.
    pub fn publish(&mut self, message: impl Into<Message>) -> Result<(), Failed> {
        Ok(self.bus.publish(&message.into())?)
    }

    /// The next message, unless `until` comes before.
    pub fn hear(&mut self, until: Instant) -> Result<Heard, Failed> {
        loop {
            if let Ok(Some(_)) = self.interrupt.read_signal() {
                return Ok(Heard::Interrupt);
            }
            let now = clock::now();
            match self.bus.receive(now) {
                Received::Message { message, .. } => return Ok(Heard::Message(message)),
                // A tool is not the place to complain of others: `advee lcm echo` shows them.
                Received::Malformed { .. } | Received::Foreign => {}
                Received::Broken(why) => return Err(why.into()),
                Received::Nothing if until <= now => return Ok(Heard::Nothing),
                Received::Nothing => wait(&[self.bus.as_fd(), self.interrupt.as_fd()], until.since(now))?,
            }
        }
    }
}

/// Waits until one of them can be read, or for `at_most`.
pub fn wait(fds: &[std::os::fd::BorrowedFd<'_>], at_most: Duration) -> Result<(), Failed> {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    let mut fds: Vec<PollFd<'_>> = fds.iter().map(|fd| PollFd::new(*fd, PollFlags::POLLIN)).collect();
    // Rounded up: not to spin through the last millisecond.
    let ms = u16::try_from(at_most.as_nanos().div_ceil(1_000_000)).unwrap_or(u16::MAX);
    match poll(&mut fds, PollTimeout::from(ms)) {
        Ok(_) | Err(nix::errno::Errno::EINTR) => Ok(()),
        Err(errno) => Err(format!("poll: {}", errno.desc()).into()),
    }
}

/// Ctrl-C and SIGTERM as something to wait for.
pub fn interrupt() -> Result<SignalFd, Failed> {
    let mut set = SigSet::empty();
    set.add(Signal::SIGINT);
    set.add(Signal::SIGTERM);
    let opened =
        set.thread_block().and_then(|()| SignalFd::with_flags(&set, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC));
    opened.map_err(|errno| format!("signalfd: {}", errno.desc()).into())
}

/// True if a message is an error of `module`; its text then.
pub fn error_of<'a>(message: &'a Message, module: &str) -> Option<&'a common::Error> {
    match message {
        Message::CmEventError(error) if error.module == module => Some(error),
        _ => None,
    }
}
