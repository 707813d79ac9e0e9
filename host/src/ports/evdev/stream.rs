//! A gamepad's lines from a file, a FIFO or a socket, each at its time.

use super::codec::{Line, Reader};
use base::Duration;
use base::gamepad::Event;
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::time::TimeSpec;
use nix::sys::timerfd::{ClockId, Expiration, TimerFd, TimerFlags, TimerSetTimeFlags};
use nix::unistd::read;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

/// Bytes per read.
const READ_MAX: usize = 1024;
/// Reads and lines without an event before others have their turn, for this long.
const READS_MAX: usize = 64;
const BREATH: Duration = Duration::from_millis(1);

const TIMER: u64 = 0;
const FILE: u64 = 1;

/// What a stream had for us.
pub enum Told {
    /// Nothing more for now.
    Nothing,
    /// This happened.
    Event(Event),
    /// A line is wrong.
    Wrong(String),
    /// It has ended.
    End,
}

/// The stream.
pub struct Stream {
    file: OwnedFd,
    reader: Reader,
    timer: TimerFd,
    /// Readable when the file is, or when what it waits for is over.
    both: Epoll,
    /// A file is always readable, and no epoll takes it.
    polled: bool,
    waits: bool,
}

impl Stream {
    /// A stream of lines from `file`, which does not block.
    pub fn new(file: OwnedFd) -> nix::Result<Self> {
        let both = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?;
        let timer = TimerFd::new(ClockId::CLOCK_MONOTONIC, TimerFlags::TFD_NONBLOCK | TimerFlags::TFD_CLOEXEC)?;
        both.add(&timer, EpollEvent::new(EpollFlags::EPOLLIN, TIMER))?;
        let polled = match both.add(&file, EpollEvent::new(EpollFlags::EPOLLIN, FILE)) {
            Ok(()) => true,
            Err(Errno::EPERM) => false,
            Err(errno) => return Err(errno),
        };
        Ok(Self { file, reader: Reader::default(), timer, both, polled, waits: false })
    }

    /// To wait for.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.both.0.as_fd()
    }

    /// True if it is a file, which ends once.
    pub fn is_file(&self) -> bool {
        !self.polled
    }

    /// The file itself.
    pub fn file(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// Takes one thing.
    pub fn poll(&mut self) -> Told {
        match self.try_poll() {
            Ok(told) => told,
            Err(Errno::EAGAIN | Errno::EINTR) => Told::Nothing,
            // Whoever wrote is gone, in whatever manner.
            Err(_) => Told::End,
        }
    }

    fn try_poll(&mut self) -> nix::Result<Told> {
        if self.waits {
            let mut count = [0; 8];
            read(&self.timer, &mut count)?;
            self.waits = false;
            self.heed(true)?;
        }
        for _ in 0..READS_MAX {
            match self.reader.poll() {
                Some(Ok(Line::Event(event))) => return Ok(Told::Event(event)),
                Some(Ok(Line::Wait(Duration::ZERO))) => {}
                Some(Ok(Line::Wait(wait))) => return self.pause(wait),
                Some(Err(why)) => return Ok(Told::Wrong(why)),
                // A FIFO that nobody has opened to write looks ended to who reads it.
                None if self.polled && !self.is_readable()? => return Ok(Told::Nothing),
                None => {
                    let mut bytes = [0; READ_MAX];
                    let count = read(&self.file, &mut bytes)?;
                    if count == 0 {
                        return Ok(Told::End);
                    }
                    self.reader.push(&bytes[..count]);
                }
            }
        }
        // Nothing but remarks, and no end of them.
        self.pause(BREATH)
    }

    fn is_readable(&self) -> nix::Result<bool> {
        let mut events = [EpollEvent::empty(); 2];
        let count = self.both.wait(&mut events, EpollTimeout::ZERO)?;
        Ok(events[..count].iter().any(|event| event.data() == FILE))
    }

    fn pause(&mut self, wait: Duration) -> nix::Result<Told> {
        self.timer.set(Expiration::OneShot(TimeSpec::from_duration(wait)), TimerSetTimeFlags::empty())?;
        self.waits = true;
        self.heed(false)?;
        Ok(Told::Nothing)
    }

    /// While it waits, that more could be read is no reason to wake.
    fn heed(&self, heed: bool) -> nix::Result<()> {
        match (self.polled, heed) {
            (false, _) => Ok(()),
            (true, true) => self.both.add(&self.file, EpollEvent::new(EpollFlags::EPOLLIN, FILE)),
            (true, false) => self.both.delete(&self.file),
        }
    }
}
