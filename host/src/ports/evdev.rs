//! A gamepad: an event device of the kernel, or a stream of lines in its place; and the simulator's end of such a
//! stream.
//!
//! The port is up while it can detect whether a gamepad appears; an absent gamepad is not a loss of the port. Nothing
//! is polled: inotify reports changes in the folder where the gamepad is to appear, including the change of access
//! rights by udev.

pub mod codec;
mod hub;
mod kernel;
mod stream;
#[cfg(test)]
mod tests;

pub use hub::Hub;

use super::{Device, Lost, Received};
use base::gamepad::{self, Event};
use base::{Duration, Fault, Instant};
use kernel::Kernel;
use module::{Input, Output};
use nix::errno::Errno;
use nix::fcntl::{OFlag, open};
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags};
use nix::sys::inotify::{AddWatchFlags, InitFlags, Inotify};
use nix::sys::stat::Mode;
use nix::sys::time::TimeSpec;
use nix::sys::timerfd::{ClockId, Expiration, TimerFd, TimerFlags, TimerSetTimeFlags};
use nix::unistd::read;
use std::collections::VecDeque;
use std::ffi::OsStr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::{fs, io};
use stream::{Stream, StreamItem};

/// Folder of the event devices.
const INPUT: &str = "/dev/input";

/// Source of a gamepad's events.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GamepadPlace {
    /// The first device under `/dev/input`, by number, with two axes and a button.
    Auto,
    /// This event device, or a link to it.
    Device(PathBuf),
    /// Lines from this file, FIFO or UNIX socket (docs/gamepad.md).
    Stream(PathBuf),
}

/// Open source of events.
enum Source {
    Kernel(Kernel),
    Stream(Stream),
}

/// Gamepad port.
pub struct Gamepad {
    place: GamepadPlace,
    /// Grab the device, so that no other program receives its events.
    grab: bool,
    opened: Option<Opened>,
    source: Option<Source>,
    /// Its presence was reported, its absence not yet.
    present: bool,
    /// A file has been played, which happens once.
    played: bool,
    /// Events to deliver; the current one stays until the next call.
    events: VecDeque<Event>,
    current: Option<Event>,
    /// Reason why it could not be opened.
    note: Option<String>,
}

struct Opened {
    /// Readable if the folder changed, a new attempt is due, or the source has input.
    any: Epoll,
    folder: Inotify,
    again: TimerFd,
}

/// Delay before looking for another gamepad after one disappeared: a peer that hangs up at once is not reconnected at
/// once.
const RETRY_DELAY: Duration = Duration::from_millis(100);

impl Opened {
    fn new() -> nix::Result<Self> {
        let any = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?;
        let folder = Inotify::init(InitFlags::IN_NONBLOCK | InitFlags::IN_CLOEXEC)?;
        let again = TimerFd::new(ClockId::CLOCK_MONOTONIC, TimerFlags::TFD_NONBLOCK | TimerFlags::TFD_CLOEXEC)?;
        any.add(&folder, EpollEvent::new(EpollFlags::EPOLLIN, 0))?;
        any.add(&again, EpollEvent::new(EpollFlags::EPOLLIN, 1))?;
        Ok(Self { any, folder, again })
    }

    /// Watches the existing folders; the first one must exist.
    fn watch(&self, folders: &[PathBuf]) -> Result<(), Lost> {
        // Access rights are granted later: a change of attributes.
        let news = AddWatchFlags::IN_CREATE | AddWatchFlags::IN_MOVED_TO | AddWatchFlags::IN_ATTRIB;
        for (place, path) in folders.iter().enumerate() {
            let watched = self.folder.add_watch(path, news | AddWatchFlags::IN_ONLYDIR);
            if let (0, Err(errno)) = (place, watched) {
                return Err(format!("{}: {}", path.display(), errno.desc()));
            }
        }
        Ok(())
    }

    /// True if something relevant changed since the last call.
    fn changed(&self, matters: impl Fn(&OsStr) -> bool) -> bool {
        // A queue overflow is reported as an event without a name.
        let events = self.folder.read_events().unwrap_or_default();
        let changed = events.iter().any(|event| event.name.as_ref().is_none_or(|name| matters(name)));
        let due = read(&self.again, &mut [0; 8]).is_ok();
        changed || due
    }
}

impl Gamepad {
    /// Creates the port of a gamepad; with `grab` no other program receives the events of an event device.
    pub fn new(place: GamepadPlace, grab: bool) -> Self {
        let (events, current) = (VecDeque::new(), None);
        Self { place, grab, opened: None, source: None, present: false, played: false, events, current, note: None }
    }

    /// Folders whose changes may mean that the gamepad appeared, outermost first.
    fn folders(&self) -> Vec<PathBuf> {
        match &self.place {
            GamepadPlace::Auto => vec![INPUT.into()],
            GamepadPlace::Device(path) | GamepadPlace::Stream(path) => {
                let own = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
                // /dev/input/by-id is created with the first device and removed with the last.
                let above = Some(Path::new(INPUT)).filter(|above| own.starts_with(above) && own != *above);
                above.into_iter().chain([own]).map(PathBuf::from).collect()
            }
        }
    }

    /// True if a change of this name in one of the folders is relevant.
    fn matters(&self, name: &OsStr) -> bool {
        match &self.place {
            GamepadPlace::Auto => name.as_encoded_bytes().starts_with(b"event"),
            GamepadPlace::Device(path) | GamepadPlace::Stream(path) => {
                path.file_name() == Some(name) || path.parent().and_then(Path::file_name) == Some(name)
            }
        }
    }

    /// Looks for a gamepad if there is none.
    fn look(&mut self) {
        let folders = self.folders();
        let Some(opened) = self.opened.as_ref().filter(|_| self.source.is_none() && !self.played) else { return };
        // A new folder is watched before it is searched.
        let watched = opened.watch(&folders);
        let found = match &self.place {
            GamepadPlace::Auto => self.find(),
            GamepadPlace::Device(path) => self.open_device(path).map(Some),
            GamepadPlace::Stream(path) => open_stream(path).map(|stream| Some((Source::Stream(stream), None))),
        };
        match (watched, found) {
            (Err(why), _) => self.note = Some(why),
            (_, Ok(None)) => {}
            (_, Ok(Some((source, device)))) => {
                if opened.any.add(source.fd(), EpollEvent::new(EpollFlags::EPOLLIN, 2)).is_ok() {
                    self.source = Some(source);
                    self.events.extend(device.map(|device| Event::Found(Box::new(device))));
                }
            }
            (_, Err((_, Errno::ENOENT | Errno::ECONNREFUSED))) => {}
            (_, Err((path, errno))) => self.note = Some(format!("{}: {}", path.display(), errno.desc())),
        }
    }

    /// Finds the first gamepad by device number.
    fn find(&self) -> Result<Option<(Source, Option<gamepad::Device>)>, Refused> {
        let entries = fs::read_dir(INPUT).into_iter().flatten().flatten();
        let number = |name: &OsStr| name.to_str()?.strip_prefix("event")?.parse::<u32>().ok();
        let mut numbers: Vec<u32> = entries.filter_map(|entry| number(&entry.file_name())).collect();
        numbers.sort_unstable();
        let mut refused = None;
        for number in numbers {
            match self.open_device(&Path::new(INPUT).join(format!("event{number}"))) {
                Ok(found) if found.1.as_ref().is_some_and(kernel::is_gamepad) => return Ok(Some(found)),
                // Possibly a gamepad; access may be granted later.
                Err((path, Errno::EACCES)) => refused = refused.or(Some((path, Errno::EACCES))),
                Ok(_) | Err(_) => {}
            }
        }
        refused.map_or(Ok(None), Err)
    }

    fn open_device(&self, path: &Path) -> Result<(Source, Option<gamepad::Device>), Refused> {
        let refused = |errno| (path.to_path_buf(), errno);
        let device = Kernel::open(path).map_err(refused)?;
        let described = device.describe().map_err(refused)?;
        // Not before it is known to be a gamepad: other programs may need the device.
        if self.grab && kernel::is_gamepad(&described) {
            device.grab().map_err(refused)?;
        }
        Ok((Source::Kernel(device), Some(described)))
    }

    /// The gamepad disappeared; looks for another one.
    fn lose(&mut self) {
        let source = self.source.take();
        self.played |= matches!(source, Some(Source::Stream(stream)) if stream.is_file());
        if self.present {
            self.events.push_back(Event::Gone);
        }
        if let Some(opened) = &self.opened {
            // If the timer fails, changes in the folder remain as a trigger.
            let _ =
                opened.again.set(Expiration::OneShot(TimeSpec::from_duration(RETRY_DELAY)), TimerSetTimeFlags::empty());
        }
    }
}

/// A path that could not be opened, and the error.
type Refused = (PathBuf, Errno);

fn open_stream(path: &Path) -> Result<Stream, Refused> {
    let refused = |errno| (path.to_path_buf(), errno);
    let broken = |error: io::Error| refused(Errno::from_raw(error.raw_os_error().unwrap_or(0)));
    let kind = fs::metadata(path).map_err(broken)?.file_type();
    let file = if kind.is_socket() {
        let socket = UnixStream::connect(path).map_err(broken)?;
        socket.set_nonblocking(true).map_err(broken)?;
        OwnedFd::from(socket)
    } else {
        // A FIFO without a writer opens, and stays silent.
        let flags = OFlag::O_RDONLY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC | OFlag::O_NOCTTY;
        open(path, flags, Mode::empty()).map_err(refused)?
    };
    Stream::new(file).map_err(refused)
}

impl Source {
    fn fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Kernel(device) => device.fd(),
            Self::Stream(stream) => stream.fd(),
        }
    }
}

impl Device for Gamepad {
    fn open(&mut self) -> Result<(), Lost> {
        self.close();
        let opened = Opened::new().map_err(|errno| errno.desc().to_string())?;
        opened.watch(&self.folders())?;
        self.opened = Some(opened);
        self.look();
        if self.events.is_empty() {
            self.events.push_back(Event::Gone);
        }
        Ok(())
    }

    fn close(&mut self) {
        (self.source, self.opened, self.note, self.current) = (None, None, None, None);
        self.events.clear();
        (self.present, self.played) = (false, false);
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.opened.as_ref().map(|opened| opened.any.0.as_fd())
    }

    fn receive(&mut self, now: Instant) -> Result<Received<'_>, Lost> {
        if let Some(note) = self.note.take() {
            return Ok(Received::Note(note));
        }
        if self.events.is_empty() {
            if self.opened.as_ref().is_some_and(|opened| opened.changed(|name| self.matters(name))) {
                self.look();
            }
            match &mut self.source {
                None => {}
                Some(Source::Kernel(device)) => {
                    let read = device.read(&mut self.events);
                    if read.is_err() {
                        self.lose();
                    }
                }
                Some(Source::Stream(stream)) => match stream.poll() {
                    StreamItem::Event(event) => self.events.push_back(event),
                    StreamItem::Wrong(why) => return Ok(Received::Fault(Fault::MessageMalformed, why)),
                    StreamItem::End => self.lose(),
                    StreamItem::Nothing => {}
                },
            }
        }
        self.current = self.events.pop_front();
        match &self.current {
            Some(Event::Found(_)) => self.present = true,
            Some(Event::Gone) => self.present = false,
            _ => {}
        }
        Ok(match &self.current {
            Some(event) => Received::input(now, Input::Gamepad(event.as_input())),
            // The search may have found a device that cannot be opened.
            None => self.note.take().map_or(Received::Nothing, Received::Note),
        })
    }

    fn send(&mut self, _now: Instant, _output: &Output) -> Result<bool, Lost> {
        Ok(false)
    }
}
