//! Serial lines of 9-bit words, each carried as two bytes: a device, or the simulator's end of a pseudo-terminal.

use super::{Device, Lost, Received};
use crate::live::sys;
use base::serial::Word;
use base::{Duration, Instant};
use module::{Input, Output};
use nix::errno::Errno;
use nix::fcntl::{OFlag, open};
use nix::pty::{grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::stat::Mode;
use nix::sys::termios::{self, BaudRate, ControlFlags, FlushArg, SetArg, SpecialCharacterIndices};
use nix::unistd::{read, write};
use rs485::transport::TwoByte;
use std::collections::VecDeque;
use std::fs;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

/// Start bit, eight data bits, the ninth, stop bit.
const BITS_PER_WORD: u64 = 11;
/// Bytes that may wait for the device; more is dropped whole.
const QUEUE_MAX: usize = 16 * 1024;
/// Bytes per read.
const READ_MAX: usize = 1024;

/// A serial line.
pub struct Serial {
    place: Place,
    baud: u32,
    file: Option<OwnedFd>,
    codec: TwoByte,
    words: Vec<Word>,
    queue: VecDeque<u8>,
    /// Bytes written since the device was opened.
    written: u64,
    /// Outputs that are not wholly written: where each ends, and its words.
    outputs: VecDeque<(u64, u64)>,
    /// When the last word of each written output leaves the wire.
    sent: VecDeque<Instant>,
    /// When the wire is free.
    wire_free: Instant,
}

enum Place {
    Terminal(PathBuf),
    /// The link, and the device file of the other side that it leads to while this is open.
    Pseudo(PathBuf, PathBuf),
}

impl Serial {
    /// A device file.
    pub fn terminal(path: PathBuf, baud: u32) -> Self {
        Self::new(Place::Terminal(path), baud)
    }

    /// A pseudo-terminal, its other side offered by a link.
    pub fn pseudo(link: PathBuf, baud: u32) -> Self {
        Self::new(Place::Pseudo(link, PathBuf::new()), baud)
    }

    fn new(place: Place, baud: u32) -> Self {
        Self {
            place,
            baud: baud.max(1),
            file: None,
            codec: TwoByte::new(),
            words: Vec::new(),
            queue: VecDeque::new(),
            written: 0,
            outputs: VecDeque::new(),
            sent: VecDeque::new(),
            wire_free: Instant::ZERO,
        }
    }

    /// What the words of an output cost on the wire.
    fn wire_time(&self, words: u64) -> Duration {
        Duration::from_nanos(words.saturating_mul(BITS_PER_WORD * 1_000_000_000) / u64::from(self.baud))
    }

    fn forget(&mut self) {
        self.queue.clear();
        self.outputs.clear();
        self.sent.clear();
        self.written = 0;
    }

    /// The other side of a pseudo-terminal is closed: what is sent goes nowhere, as on a wire without a listener.
    fn nobody_listens(&mut self, now: Instant) {
        let waiting = self.queue.len();
        self.queue.clear();
        self.count_written(now, waiting);
        self.codec.reset();
    }

    fn count_written(&mut self, now: Instant, bytes: usize) {
        self.written += bytes as u64;
        while let Some(&(end, words)) = self.outputs.front()
            && end <= self.written
        {
            self.outputs.pop_front();
            self.wire_free = self.wire_free.max(now) + self.wire_time(words);
            self.sent.push_back(self.wire_free);
        }
    }

    fn write_what_goes(&mut self, now: Instant) -> Result<(), Lost> {
        while !self.queue.is_empty() {
            let Some(file) = &self.file else {
                return Ok(());
            };
            match write(file, self.queue.as_slices().0) {
                Ok(count) => {
                    self.queue.drain(..count);
                    self.count_written(now, count);
                }
                Err(Errno::EAGAIN) => return Ok(()),
                Err(Errno::EINTR) => {}
                Err(Errno::EIO) if self.by_edge() => self.nobody_listens(now),
                Err(errno) => return Err(errno.desc().into()),
            }
        }
        Ok(())
    }

    fn open_file(&mut self) -> Result<OwnedFd, Lost> {
        match &mut self.place {
            Place::Terminal(path) => open_terminal(path, self.baud),
            Place::Pseudo(link, other_side) => open_pseudo(link, other_side),
        }
    }
}

/// Opens a device raw, 8 data bits, no parity, 1 stop bit, and keeps others out.
fn open_terminal(path: &Path, baud: u32) -> Result<OwnedFd, Lost> {
    let named = |errno: Errno| format!("{}: {}", path.display(), errno.desc());
    let rate = baud_rate(baud).ok_or_else(|| format!("{}: {baud} Bd is no rate of a terminal", path.display()))?;
    let flags = OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC;
    let file = open(path, flags, Mode::empty()).map_err(named)?;
    sys::take_exclusively(file.as_fd()).map_err(|error| format!("{}: {error}", path.display()))?;
    make_raw(&file, Some(rate)).map_err(named)?;
    termios::tcflush(&file, FlushArg::TCIOFLUSH).map_err(named)?;
    Ok(file)
}

/// Makes a pseudo-terminal and a link to its other side, in place of any old link.
fn open_pseudo(link: &Path, other_side: &mut PathBuf) -> Result<OwnedFd, Lost> {
    let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC);
    let named = |errno: Errno| format!("pseudo-terminal: {}", errno.desc());
    let master = master.map_err(named)?;
    grantpt(&master).map_err(named)?;
    unlockpt(&master).map_err(named)?;
    *other_side = ptsname_r(&master).map_err(named)?.into();
    // On Linux the attributes of a master are those of its other side.
    make_raw(&master, None).map_err(named)?;
    let fresh = link.with_extension("new");
    let _ = fs::remove_file(&fresh);
    std::os::unix::fs::symlink(&*other_side, &fresh)
        .and_then(|()| fs::rename(&fresh, link))
        .map_err(|error| format!("{}: {error}", link.display()))?;
    Ok(master.into())
}

fn make_raw(file: &impl AsFd, rate: Option<BaudRate>) -> nix::Result<()> {
    let mut settings = termios::tcgetattr(file)?;
    termios::cfmakeraw(&mut settings);
    settings.control_flags.remove(ControlFlags::CSTOPB | ControlFlags::CRTSCTS);
    settings.control_flags.insert(ControlFlags::CLOCAL | ControlFlags::CREAD);
    settings.control_chars[SpecialCharacterIndices::VMIN as usize] = 1;
    settings.control_chars[SpecialCharacterIndices::VTIME as usize] = 0;
    if let Some(rate) = rate {
        termios::cfsetspeed(&mut settings, rate)?;
    }
    termios::tcsetattr(file, SetArg::TCSANOW, &settings)
}

fn baud_rate(baud: u32) -> Option<BaudRate> {
    Some(match baud {
        1200 => BaudRate::B1200,
        2400 => BaudRate::B2400,
        4800 => BaudRate::B4800,
        9600 => BaudRate::B9600,
        19_200 => BaudRate::B19200,
        38_400 => BaudRate::B38400,
        57_600 => BaudRate::B57600,
        115_200 => BaudRate::B115200,
        230_400 => BaudRate::B230400,
        460_800 => BaudRate::B460800,
        500_000 => BaudRate::B500000,
        921_600 => BaudRate::B921600,
        1_000_000 => BaudRate::B1000000,
        2_000_000 => BaudRate::B2000000,
        _ => return None,
    })
}

impl Device for Serial {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        self.file = Some(self.open_file()?);
        Ok(())
    }

    fn close(&mut self) {
        self.forget();
        self.codec.reset();
        let was_open = self.file.take().is_some();
        let Place::Pseudo(link, other_side) = &self.place else {
            return;
        };
        // Only while it is ours: another may have made its own meanwhile.
        if was_open && fs::read_link(link).is_ok_and(|target| target == *other_side) {
            let _ = fs::remove_file(link);
        }
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.file.as_ref().map(AsFd::as_fd)
    }

    fn by_edge(&self) -> bool {
        matches!(self.place, Place::Pseudo(..))
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        let mut bytes = [0; READ_MAX];
        loop {
            let Some(file) = &self.file else {
                return Ok(Received::Nothing);
            };
            match read(file, &mut bytes) {
                Ok(0) => return Err("the device is gone".into()),
                Ok(count) => {
                    self.words.clear();
                    self.words.extend(bytes[..count].iter().filter_map(|byte| self.codec.decode(*byte)));
                    return Ok(Received::Input(Input::Words(&self.words)));
                }
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN) => return Ok(Received::Nothing),
                Err(Errno::EIO) if self.by_edge() => {
                    self.nobody_listens(now);
                    return Ok(Received::Nothing);
                }
                Err(errno) => return Err(errno.desc().into()),
            }
        }
    }

    fn send(&mut self, now: Instant, output: &Output) -> Result<bool, Lost> {
        let Output::Words(words) = output else {
            return Ok(false);
        };
        if self.queue.len() + 2 * words.len() > QUEUE_MAX {
            return Ok(false);
        }
        self.queue.extend(words.iter().copied().flat_map(TwoByte::encode));
        self.outputs.push_back((self.written + self.queue.len() as u64, words.len() as u64));
        self.write_what_goes(now)?;
        Ok(true)
    }

    fn wants_to_write(&self) -> bool {
        !self.queue.is_empty()
    }

    fn on_writable(&mut self, now: Instant) -> Result<(), Lost> {
        self.write_what_goes(now)
    }

    fn sent_at(&self) -> Option<Instant> {
        self.sent.front().copied()
    }

    fn sent_told(&mut self) {
        self.sent.pop_front();
    }
}

impl Drop for Serial {
    fn drop(&mut self) {
        self.close();
    }
}
