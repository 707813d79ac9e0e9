//! Sends nine bits by mark and space parity on a separate thread, because a change of parity waits for the wire.
//!
//! For each run of words of one parity (an address, then the rest of its frame):
//!
//! 1. wait until all written data has left (including the UART's shift register, if the driver reports it), then set
//!    mark or space parity, so that no word leaves in the parity of its neighbour;
//! 2. `write` the whole run;
//!
//! and finally wait again until all data has left: only then does the output count as sent. The last run of a frame has
//! space parity, so the line receives in space parity before any board may answer (two words of silence). While an
//! address leaves, the line receives in mark parity too: on a half-duplex bus nobody else sends then; on a full-duplex
//! link, input during that one word is read with inverted ninth bits and rejected by its CRC.
//!
//! The kernel's own waiting (`tcdrain`, `TCSETSW2`) polls the wire at timer ticks, in the serial core at every second
//! one. With a tick of 4 ms this makes a gap of 4 to 8 ms between an address and the rest; boards accept 5 ms. So this
//! module polls itself (`TIOCSERGETLSR`) and uses the kernel's waiting only if a driver does not report. Drivers of USB
//! adapters report an outdated state (`ftdi_sio`: that of the last packet received): there it waits until the device
//! has all data, and then for their time on the wire. The gap is measured, and reported if it is too long.

use super::BITS_PER_WORD;
use super::driver::Driver;
use super::line::with_parity;
use crate::clock;
use crate::sys;
use base::serial::Word;
use base::{Duration, Instant};
use nix::errno::Errno;
use nix::libc::termios2;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::sys::termios::tcdrain;
use nix::unistd::write;
use rs485::transport::runs;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender as Jobs, channel};
use std::thread;

/// Maximum gap between two words; a board drops a frame with a longer one (`docs/facts/boards.md` 1).
const GAP_MAX: Duration = Duration::from_millis(5);
/// Maximum time from a USB adapter's receipt of a byte to its start bit, with reserve.
const ADAPTER: Duration = Duration::from_millis(1);
/// Time after which a device that accepts no bytes counts as failed.
const STUCK_MS: u16 = 1000;

/// Result of an output: the longest gap inside it, or the reason why the device is lost.
type Done = io::Result<Duration>;

/// Handle of the thread.
pub struct Sender {
    jobs: Jobs<Vec<Word>>,
    done: Receiver<Done>,
    ready: Arc<EventFd>,
    /// Readable if the device is, or if an output has left.
    both: Epoll,
    /// Number of outputs that have not left.
    pub waiting: usize,
    slow: bool,
}

impl Sender {
    /// Starts the thread. It ends after the handle was dropped and the current output was sent.
    pub fn start(file: Arc<OwnedFd>) -> io::Result<Self> {
        let settings = sys::line_settings(file.as_fd())?;
        let ready = Arc::new(EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?);
        let both = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?;
        both.add(&*file, EpollEvent::new(EpollFlags::EPOLLIN, 0))?;
        both.add(&*ready, EpollEvent::new(EpollFlags::EPOLLIN, 1))?;
        let (jobs, todo) = channel::<Vec<Word>>();
        let (tell, done) = channel();
        let tells = ready.clone();
        thread::Builder::new().name("parity".into()).spawn(move || {
            let by_usb = Driver::is_usb_serial(file.as_fd());
            let mut line = Tty { file, settings, by_usb, written: 0 };
            for words in todo {
                let result = send(&mut line, &words);
                let lost = result.is_err();
                if tell.send(result).is_err() || tells.write(1).is_err() || lost {
                    return;
                }
            }
        })?;
        Ok(Self { jobs, done, ready, both, waiting: 0, slow: false })
    }

    /// Descriptor to wait for, in place of the device's.
    pub fn fd(&self) -> BorrowedFd<'_> {
        self.both.0.as_fd()
    }

    /// Queues an output.
    pub fn send(&mut self, words: Vec<Word>) {
        self.waiting += 1;
        // A thread that has ended reported its reason.
        let _ = self.jobs.send(words);
    }

    /// Result of an output that has left since, with a note for people, once, if a gap was too long.
    pub fn sent(&mut self) -> Option<io::Result<Option<String>>> {
        let done = match self.done.try_recv() {
            Ok(done) => done,
            Err(_) => {
                // Clears the readiness; an output that leaves from now on sets it again.
                let _ = self.ready.read();
                self.done.try_recv().ok()?
            }
        };
        self.waiting -= 1;
        Some(done.map(|gap| {
            (gap > GAP_MAX && !std::mem::replace(&mut self.slow, true)).then(|| {
                format!(
                    "the parity changed {:.1} ms after an address: boards drop a frame with a gap of more than {} ms, \
                     and an rt_priority of the module keeps it short",
                    gap.as_secs_f64() * 1e3,
                    GAP_MAX.as_millis()
                )
            })
        }))
    }
}

/// Operations on a line.
trait Line {
    /// Waits until all data has left, then sets mark or space parity.
    fn set_parity(&mut self, mark: bool) -> io::Result<()>;
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Waits until all data has left.
    fn drain(&mut self) -> io::Result<()>;
    fn now(&self) -> Instant;
}

/// Sends an output; returns the longest time between two of its runs, including the first run's time on the wire.
fn send(line: &mut impl Line, words: &[Word]) -> Done {
    let (mut gap, mut written, mut last) = (Duration::ZERO, None, false);
    for (mark, run) in runs(words) {
        line.set_parity(mark)?;
        gap = gap.max(written.map_or(Duration::ZERO, |at| line.now().since(at)));
        let bytes: Vec<u8> = run.iter().map(|word| word.byte).collect();
        line.write(&bytes)?;
        // After the rest of a frame, another one may follow at any time.
        (written, last) = (mark.then(|| line.now()), mark);
    }
    if last { line.set_parity(false) } else { line.drain() }?;
    Ok(gap)
}

struct Tty {
    file: Arc<OwnedFd>,
    settings: termios2,
    /// True for the terminal of a USB adapter.
    by_usb: bool,
    /// Number of bytes written since all data had left.
    written: u32,
}

impl Line for Tty {
    fn set_parity(&mut self, mark: bool) -> io::Result<()> {
        let waits = self.wait_until_sent()?;
        sys::set_line_settings(self.file.as_fd(), &with_parity(&self.settings, mark), !waits)
    }

    fn write(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            match write(&*self.file, bytes) {
                Ok(count) => {
                    bytes = &bytes[count..];
                    self.written = self.written.saturating_add(count as u32);
                }
                Err(Errno::EAGAIN) => {
                    let mut room = [PollFd::new(self.file.as_fd(), PollFlags::POLLOUT)];
                    if poll(&mut room, PollTimeout::from(STUCK_MS))? == 0 {
                        return Err(io::Error::new(io::ErrorKind::TimedOut, "it accepts no bytes"));
                    }
                }
                Err(Errno::EINTR) => {}
                Err(errno) => return Err(errno.into()),
            }
        }
        Ok(())
    }

    fn drain(&mut self) -> io::Result<()> {
        if !self.wait_until_sent()? {
            tcdrain(&*self.file)?;
        }
        Ok(())
    }

    fn now(&self) -> Instant {
        clock::now()
    }
}

impl Tty {
    /// Waits until all data has left; returns false at once if the driver does not report it.
    fn wait_until_sent(&mut self) -> io::Result<bool> {
        let word = Duration::from_nanos(BITS_PER_WORD * 1_000_000_000 / u64::from(self.settings.c_ospeed.max(1)));
        // The driver buffers less than a page.
        let until = clock::now() + Duration::from_millis(STUCK_MS.into()) + word * 4096;
        let written = std::mem::take(&mut self.written);
        loop {
            let sent = if self.by_usb {
                Some(sys::line_waiting(self.file.as_fd())? == 0)
            } else {
                sys::line_has_sent(self.file.as_fd())?
            };
            match sent {
                Some(true) if self.by_usb && written > 0 => {
                    thread::sleep(word * written + ADAPTER);
                    return Ok(true);
                }
                None => return Ok(false),
                Some(true) => return Ok(true),
                Some(false) if clock::now() > until => {
                    return Err(io::Error::new(io::ErrorKind::TimedOut, "the written data is not sent"));
                }
                Some(false) => thread::sleep(word),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line that records all operations; a change of parity takes `change`.
    #[derive(Default)]
    struct Log {
        did: Vec<String>,
        now: Instant,
        change: Duration,
        breaks_at: Option<usize>,
    }

    impl Log {
        fn note(&mut self, what: String) -> io::Result<()> {
            self.did.push(what);
            match self.breaks_at {
                Some(at) if self.did.len() > at => Err(Errno::EIO.into()),
                _ => Ok(()),
            }
        }
    }

    impl Line for Log {
        fn set_parity(&mut self, mark: bool) -> io::Result<()> {
            self.now += self.change;
            self.note(if mark { "drain, mark".into() } else { "drain, space".into() })
        }

        fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
            self.note(format!("{bytes:02x?}"))
        }

        fn drain(&mut self) -> io::Result<()> {
            self.note("drain".into())
        }

        fn now(&self) -> Instant {
            self.now
        }
    }

    fn frame() -> Vec<Word> {
        let rest = [0x01, 0xFF, 0x9C].map(Word::data);
        [Word::address(0x20)].into_iter().chain(rest).collect()
    }

    #[test]
    fn an_address_leaves_in_mark_parity_and_the_rest_in_space_parity_each_drained_before_the_change() {
        let mut line = Log::default();
        send(&mut line, &frame()).unwrap();
        assert_eq!(line.did, ["drain, mark", "[20]", "drain, space", "[01, ff, 9c]", "drain"]);
    }

    #[test]
    fn the_line_is_left_in_space_parity_to_receive_addresses() {
        let mut line = Log::default();
        send(&mut line, &[Word::data(1), Word::address(2)]).unwrap();
        assert_eq!(line.did, ["drain, space", "[01]", "drain, mark", "[02]", "drain, space"]);
    }

    #[test]
    fn the_gap_after_an_address_is_measured() {
        let mut line = Log { change: Duration::from_millis(4), ..Log::default() };
        let two: Vec<Word> = frame().into_iter().chain(frame()).collect();
        assert_eq!(send(&mut line, &two).unwrap(), Duration::from_millis(4));
        assert_eq!(send(&mut line, &[Word::data(1)]).unwrap(), Duration::ZERO);
    }

    #[test]
    fn a_vanishing_device_ends_the_output_at_once() {
        let mut line = Log { breaks_at: Some(2), ..Log::default() };
        assert!(send(&mut line, &frame()).is_err());
        assert_eq!(line.did, ["drain, mark", "[20]", "drain, space"]);
    }
}
