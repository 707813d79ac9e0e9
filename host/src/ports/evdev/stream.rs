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

/// Maximum number of bytes per read.
const READ_MAX: usize = 1024;
/// Maximum number of reads and lines without an event; then the stream pauses for [`PAUSE`], so that others are
/// served.
const READS_MAX: usize = 64;
const PAUSE: Duration = Duration::from_millis(1);

const TIMER: u64 = 0;
const FILE: u64 = 1;

/// Result of reading a stream.
pub enum StreamItem {
    /// Empty: nothing more for now.
    Nothing,
    /// An event.
    Event(Event),
    /// An invalid line.
    Wrong(String),
    /// The stream has ended.
    End,
}

/// Stream of lines.
pub struct Stream {
    file: OwnedFd,
    reader: Reader,
    timer: TimerFd,
    /// Readable if the file is, or if the current wait has ended.
    both: Epoll,
    /// False for a file, which is always readable and not accepted by epoll.
    polled: bool,
    waits: bool,
}

impl Stream {
    /// Creates the stream of a non-blocking descriptor.
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

    /// Descriptor to wait for.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.both.0.as_fd()
    }

    /// True for a file, which ends once.
    pub fn is_file(&self) -> bool {
        !self.polled
    }

    /// Descriptor of the source.
    pub fn file(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// Returns the next result.
    pub fn poll(&mut self) -> StreamItem {
        match self.try_poll() {
            Ok(told) => told,
            Err(Errno::EAGAIN | Errno::EINTR) => StreamItem::Nothing,
            // The writer is gone, for whatever reason.
            Err(_) => StreamItem::End,
        }
    }

    fn try_poll(&mut self) -> nix::Result<StreamItem> {
        if self.waits {
            let mut count = [0; 8];
            read(&self.timer, &mut count)?;
            self.waits = false;
            self.set_interest(true)?;
        }
        for _ in 0..READS_MAX {
            match self.reader.poll() {
                Some(Ok(Line::Event(event))) => return Ok(StreamItem::Event(event)),
                Some(Ok(Line::Wait(Duration::ZERO))) => {}
                Some(Ok(Line::Wait(wait))) => return self.pause(wait),
                Some(Err(why)) => return Ok(StreamItem::Wrong(why)),
                // A FIFO without a writer reads as ended.
                None if self.polled && !self.is_readable()? => return Ok(StreamItem::Nothing),
                None => {
                    let mut bytes = [0; READ_MAX];
                    let count = read(&self.file, &mut bytes)?;
                    if count == 0 {
                        return Ok(StreamItem::End);
                    }
                    self.reader.push(&bytes[..count]);
                }
            }
        }
        // Only comments without end.
        self.pause(PAUSE)
    }

    fn is_readable(&self) -> nix::Result<bool> {
        let mut events = [EpollEvent::empty(); 2];
        let count = self.both.wait(&mut events, EpollTimeout::ZERO)?;
        Ok(events[..count].iter().any(|event| event.data() == FILE))
    }

    fn pause(&mut self, wait: Duration) -> nix::Result<StreamItem> {
        self.timer.set(Expiration::OneShot(TimeSpec::from_duration(wait)), TimerSetTimeFlags::empty())?;
        self.waits = true;
        self.set_interest(false)?;
        Ok(StreamItem::Nothing)
    }

    /// Enables or disables waking for input, which is not needed during a wait.
    fn set_interest(&self, interested: bool) -> nix::Result<()> {
        match (self.polled, interested) {
            (false, _) => Ok(()),
            (true, true) => self.both.add(&self.file, EpollEvent::new(EpollFlags::EPOLLIN, FILE)),
            (true, false) => self.both.delete(&self.file),
        }
    }
}
