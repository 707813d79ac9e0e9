//! Serial lines of 9-bit words, on a device that carries them as two bytes each or by parity; lines of bytes; and the
//! simulator's end of either, a pseudo-terminal.

mod driver;
mod line;
mod sender;
mod setup;

pub use driver::Driver;

use super::{Device, Lost, Received};
use ::settings::{Table, settings};
use base::serial::Word;
use base::{Duration, Instant};
use module::{Input, Output};
use nix::errno::Errno;
use nix::fcntl::OFlag;
use nix::pty::{grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::stat::fstat;
use nix::sys::termios::{self, SetArg};
use nix::unistd::{read, write};
use rs485::transport::{NinthFirst, Parity, TwoByte};
use sender::Sender;
use setup::Setup;
use std::collections::VecDeque;
use std::fs;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

settings! {
    /// How nine bits cross a serial port.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Transport {
        /// Two bytes a word, the low byte first.
        TwoByte = "two-byte",
        /// Two bytes a word, the ninth bit first.
        NinthFirst = "ninth-first",
        /// Mark and space parity.
        Parity = "parity",
    }
}

settings! {
    /// Parity of a line of bytes.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum ByteParity {
        /// None, and two stop bits.
        None = "none",
        /// Even.
        Even = "even",
        /// Odd.
        Odd = "odd",
    }
}

settings! {
    /// `rs485_direction = { … }`: when RTS enables the driver of the line.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Direction {
        /// RTS is high while sending.
        rts_on_send: bool = true;
        /// RTS is high while not sending; the opposite of `rts_on_send`.
        rts_after_send: bool = derived !rts_on_send;
        /// Time from RTS to the first start bit.
        delay_before_ms: u32 = 0, 0..=100;
        /// Time from the last stop bit to RTS.
        delay_after_ms: u32 = 0, 0..=100;
    }
    check Direction::check;
}

impl Direction {
    fn check(&self, table: &Table<'_>) {
        if self.rts_on_send == self.rts_after_send {
            table.refuse("rts_after_send", "the opposite of rts_on_send");
        }
    }
}

/// Start bit, eight data bits, the ninth, parity or a second stop bit, stop bit.
const BITS_PER_WORD: u64 = 11;
/// Maximum number of bytes that wait for the device; an output that does not fit is dropped as a whole.
const QUEUE_MAX: usize = 16 * 1024;
/// Maximum number of bytes per read.
const READ_MAX: usize = 1024;

/// Maximum number of outputs that wait for a change of parity; further ones are dropped as a whole.
const OUTPUTS_MAX: usize = 32;

/// Period of the check that the path still leads to the open device.
const PATH_PERIOD: Duration = Duration::from_secs(1);

/// Device file and its settings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TerminalConfig {
    /// Device file, or a link to it.
    pub path: PathBuf,
    /// Rate, Bd; not limited to the list in termios.
    pub baud: u32,
    /// Encoding of nine bits.
    pub transport: Transport,
    /// Words of eight bits instead, with this parity.
    pub bytes: Option<ByteParity>,
    /// Program and its arguments, run before each opening; empty: none.
    pub setup: Vec<String>,
    /// Direction control by the driver, if enabled.
    pub direction: Option<Direction>,
    /// Request that the driver delivers received bytes immediately.
    pub low_latency: bool,
    /// Lower DTR, which the kernel raises when it opens the device: an adapter may switch a motor by it.
    pub dtr_low: bool,
}

impl TerminalConfig {
    /// Two bytes per word, and no other settings.
    #[must_use]
    pub const fn new(path: PathBuf, baud: u32) -> Self {
        Self {
            path,
            baud,
            transport: Transport::TwoByte,
            bytes: None,
            setup: Vec::new(),
            direction: None,
            low_latency: false,
            dtr_low: false,
        }
    }
}

/// A serial line.
pub struct Serial {
    place: Place,
    baud: u32,
    file: Option<Arc<OwnedFd>>,
    codec: Codec,
    /// Sending thread of parity mode, while the device is open.
    sender: Option<Sender>,
    setup: Setup,
    /// Notes for people not delivered yet.
    notes: VecDeque<String>,
    words: Vec<Word>,
    queue: VecDeque<u8>,
    /// Number of bytes written since the device was opened.
    written: u64,
    /// Outputs not completely written: the byte count at the end of each, and its number of words.
    outputs: VecDeque<(u64, u64)>,
    /// Time at which the last word of each written output leaves the wire.
    sent: VecDeque<Instant>,
    /// Time at which the wire is free.
    wire_free: Instant,
    /// Time of the next check of the path.
    path_check: Instant,
}

enum Place {
    Terminal(TerminalConfig),
    /// The link, and the device file of the other end that it points to while this is open.
    Pseudo(PathBuf, PathBuf),
}

enum Codec {
    TwoByte(TwoByte),
    NinthFirst(NinthFirst),
    Parity(Parity),
    Bytes,
}

impl Codec {
    fn decode(&mut self, byte: u8) -> Option<Word> {
        match self {
            Self::TwoByte(codec) => codec.decode(byte),
            Self::NinthFirst(codec) => codec.decode(byte),
            Self::Parity(codec) => codec.decode(byte),
            Self::Bytes => Some(Word::data(byte)),
        }
    }

    fn encode(&self, words: &[Word], to: &mut VecDeque<u8>) {
        match self {
            Self::Bytes => to.extend(words.iter().map(|word| word.byte)),
            Self::NinthFirst(_) => to.extend(words.iter().copied().flat_map(NinthFirst::encode)),
            // Parity has a sending thread.
            Self::TwoByte(_) | Self::Parity(_) => to.extend(words.iter().copied().flat_map(TwoByte::encode)),
        }
    }

    fn reset(&mut self) {
        match self {
            Self::TwoByte(codec) => codec.reset(),
            Self::NinthFirst(codec) => codec.reset(),
            Self::Parity(codec) => codec.reset(),
            Self::Bytes => {}
        }
    }
}

impl Serial {
    /// Creates the port of a device file.
    pub fn terminal(mut config: TerminalConfig) -> Self {
        let codec = match (config.bytes, config.transport) {
            (Some(_), _) => Codec::Bytes,
            (None, Transport::TwoByte) => Codec::TwoByte(TwoByte::new()),
            (None, Transport::NinthFirst) => Codec::NinthFirst(NinthFirst::new()),
            (None, Transport::Parity) => Codec::Parity(Parity::new()),
        };
        let setup = Setup::new(std::mem::take(&mut config.setup));
        let baud = config.baud;
        Self::new(Place::Terminal(config), baud, codec, setup)
    }

    /// Creates the port of a pseudo-terminal whose other end is offered by a link.
    pub fn pseudo(link: PathBuf, baud: u32) -> Self {
        Self::offered(link, baud, Codec::TwoByte(TwoByte::new()))
    }

    /// The same, for a line of bytes.
    pub fn pseudo_bytes(link: PathBuf, baud: u32) -> Self {
        Self::offered(link, baud, Codec::Bytes)
    }

    fn offered(link: PathBuf, baud: u32, codec: Codec) -> Self {
        // A link left by a killed process points to a number that will be reused for another terminal, of any line: it
        // must not be found there.
        let _ = fs::remove_file(&link);
        Self::new(Place::Pseudo(link, PathBuf::new()), baud, codec, Setup::new(Vec::new()))
    }

    fn new(place: Place, baud: u32, codec: Codec, setup: Setup) -> Self {
        Self {
            place,
            baud: baud.max(1),
            file: None,
            codec,
            sender: None,
            setup,
            notes: VecDeque::new(),
            words: Vec::new(),
            queue: VecDeque::new(),
            written: 0,
            outputs: VecDeque::new(),
            sent: VecDeque::new(),
            wire_free: Instant::ZERO,
            path_check: Instant::ZERO,
        }
    }

    /// Transmission time of `words`.
    fn wire_time(&self, words: u64) -> Duration {
        Duration::from_nanos(words.saturating_mul(BITS_PER_WORD * 1_000_000_000) / u64::from(self.baud))
    }

    fn forget(&mut self) {
        self.queue.clear();
        self.outputs.clear();
        self.sent.clear();
        self.notes.clear();
        self.written = 0;
    }

    /// The other end of a pseudo-terminal is closed: output is lost, as on a wire without a listener.
    fn drop_without_listener(&mut self, now: Instant) {
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

    fn write_pending(&mut self, now: Instant) -> Result<(), Lost> {
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
                Err(Errno::EIO) if self.by_edge() => self.drop_without_listener(now),
                Err(errno) => return Err(errno.desc().into()),
            }
        }
        Ok(())
    }

    /// Checks that the path does not lead to another device by now. A link that was left by a killed simulator, or by
    /// an adapter, may have led to the device of another line when it was opened; that line cannot be opened while this
    /// one holds it. A path that leads nowhere is no reason to give up a device that works.
    fn check_path(&mut self, now: Instant) -> Result<(), Lost> {
        let (Place::Terminal(config), Some(file)) = (&self.place, &self.file) else {
            return Ok(());
        };
        if now < self.path_check {
            return Ok(());
        }
        self.path_check = now + PATH_PERIOD;
        let (Ok(there), Ok(here)) = (fs::metadata(&config.path), fstat(file)) else {
            return Ok(());
        };
        if there.rdev() != here.st_rdev {
            return Err(format!("{} is another device now", config.path.display()));
        }
        Ok(())
    }

    /// Collects the results of the sending thread.
    fn poll_sender(&mut self, now: Instant) -> Result<(), Lost> {
        let Some(sender) = &mut self.sender else {
            return Ok(());
        };
        while let Some(result) = sender.sent() {
            self.notes.extend(result.map_err(|error| error.to_string())?);
            self.sent.push_back(now);
        }
        Ok(())
    }

    fn open_file(&mut self) -> Result<(), Lost> {
        match &mut self.place {
            Place::Pseudo(link, other_side) => self.file = Some(Arc::new(open_pseudo(link, other_side)?)),
            Place::Terminal(config) => {
                // Setting up an absent device is pointless: opening reports it.
                if config.path.exists() {
                    self.setup.proceed()?;
                    if self.setup.runs() {
                        return Err("its set-up command is running".into());
                    }
                }
                let line::Opened { file, notes } = line::open_terminal(config)?;
                let file = Arc::new(file);
                if matches!(self.codec, Codec::Parity(_)) {
                    let sender = Sender::start(file.clone());
                    self.sender = Some(sender.map_err(|error| format!("{}: {error}", config.path.display()))?);
                }
                self.file = Some(file);
                self.notes.extend(notes);
            }
        }
        Ok(())
    }
}

/// Creates a pseudo-terminal and a link to its other end, which replaces an existing link.
fn open_pseudo(link: &Path, other_side: &mut PathBuf) -> Result<OwnedFd, Lost> {
    let master = posix_openpt(OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC);
    let named = |errno: Errno| format!("pseudo-terminal: {}", errno.desc());
    let master = master.map_err(named)?;
    grantpt(&master).map_err(named)?;
    unlockpt(&master).map_err(named)?;
    *other_side = ptsname_r(&master).map_err(named)?.into();
    // On Linux the attributes of a master are those of its other end.
    let mut settings = termios::tcgetattr(&master).map_err(named)?;
    termios::cfmakeraw(&mut settings);
    termios::tcsetattr(&master, SetArg::TCSANOW, &settings).map_err(named)?;
    let fresh = link.with_extension("new");
    let _ = fs::remove_file(&fresh);
    std::os::unix::fs::symlink(&*other_side, &fresh)
        .and_then(|()| fs::rename(&fresh, link))
        .map_err(|error| format!("{}: {error}", link.display()))?;
    Ok(master.into())
}

impl Device for Serial {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        self.open_file()
    }

    fn is_preparing(&self) -> bool {
        self.setup.runs()
    }

    fn close(&mut self) {
        self.forget();
        self.codec.reset();
        self.sender = None;
        let was_open = self.file.take().is_some();
        if was_open {
            self.setup.forget();
        }
        let Place::Pseudo(link, other_side) = &self.place else {
            return;
        };
        // Only if it is ours: another process may have replaced it.
        if was_open && fs::read_link(link).is_ok_and(|target| target == *other_side) {
            let _ = fs::remove_file(link);
        }
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        match &self.sender {
            Some(sender) => Some(sender.fd()),
            None => self.file.as_ref().map(|file| file.as_fd()),
        }
    }

    fn by_edge(&self) -> bool {
        matches!(self.place, Place::Pseudo(..))
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        self.poll_sender(now)?;
        if let Some(note) = self.notes.pop_front() {
            return Ok(Received::Note(note));
        }
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
                    return Ok(Received::input(now, Input::Words(&self.words)));
                }
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN) => return Ok(Received::Nothing),
                Err(Errno::EIO) if self.by_edge() => {
                    self.drop_without_listener(now);
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
        self.check_path(now)?;
        if let Some(sender) = &mut self.sender {
            let room = sender.waiting < OUTPUTS_MAX;
            if room {
                sender.send(words.clone());
            }
            return Ok(room);
        }
        if self.queue.len() + 2 * words.len() > QUEUE_MAX {
            return Ok(false);
        }
        self.codec.encode(words, &mut self.queue);
        self.outputs.push_back((self.written + self.queue.len() as u64, words.len() as u64));
        self.write_pending(now)?;
        Ok(true)
    }

    fn wants_to_write(&self) -> bool {
        !self.queue.is_empty()
    }

    fn on_writable(&mut self, now: Instant) -> Result<(), Lost> {
        self.write_pending(now)
    }

    fn sent_at(&self) -> Option<Instant> {
        self.sent.front().copied()
    }

    fn take_sent(&mut self, now: Instant) -> bool {
        let sent = self.sent.front().is_some_and(|at| *at <= now);
        if sent {
            self.sent.pop_front();
        }
        sent
    }
}

impl Drop for Serial {
    fn drop(&mut self) {
        self.close();
    }
}

#[cfg(test)]
mod tests;
