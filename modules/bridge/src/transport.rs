//! The thread of the connections: sockets, the robot's bus, and the clock.

#[cfg(test)]
mod tests;

use crate::allow::Entry;
use crate::connection::Time;
use crate::gate::Passes;
use crate::key_file;
use crate::link::{Link, Turn};
use crate::settings;
use crate::shared::{Note, Outgoing, Shared, Status};
use base::{Duration, Epoch, Instant};
use host::bus::{Bus, Received};
use host::clock;
use messages::Channel;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::io::Read;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::thread::JoinHandle;

/// Longest wait: the module checks whether the thread goes on.
const WAIT_MAX: Duration = Duration::from_millis(100);
/// Period of the state that the module reads; a change of a connection is shown at once.
const STATUS_PERIOD: Duration = Duration::from_millis(50);
/// Time after which a bus that cannot be read is read again.
const BUS_RETRY: Duration = Duration::from_secs(1);
/// Messages of the bus that are read before others have their turn.
const BURST: usize = 256;

/// The thread, as its module sees it.
#[derive(Debug)]
pub(crate) struct Transport {
    thread: JoinHandle<()>,
    shared: Arc<Shared>,
}

struct Worker {
    links: Vec<Link>,
    bus: Bus,
    epoch: Epoch,
    shared: Arc<Shared>,
    woken: UnixStream,
    /// The bus is not read before; its descriptor may be ready all the time while it is broken.
    next_bus: Instant,
    next_status: Instant,
    status: Vec<Status>,
}

impl Transport {
    /// Reads the keys, joins the bus and starts the thread. `modules`: those of this computer.
    ///
    /// # Errors
    /// One line: a key cannot be read, or the bus cannot be joined, or the kernel refuses a thread.
    pub(crate) fn start(
        links: &[settings::Link],
        config_dir: &Path,
        lcm_url: &str,
        modules: &[String],
        passes: Passes,
    ) -> Result<Self, String> {
        let mut made = Vec::new();
        for link in links {
            let key = key_file::read(&config_dir.join(&link.key_file))?;
            made.push(Link::new(link.clone(), key, modules.to_vec()));
        }
        // What the host cannot subscribe to for the module: channels of programs that are not the robot's.
        let sent = links.iter().flat_map(settings::Link::sent);
        let foreign = sent.filter(|entry| entry.channel().is_none_or(|name| !is_of_the_host(name)));
        let mut patterns: Vec<String> = foreign.map(|entry: Entry| entry.pattern()).collect();
        patterns.sort();
        patterns.dedup();
        let patterns: Vec<&str> = patterns.iter().map(String::as_str).collect();
        let bus = Bus::open(lcm_url, &patterns)?;
        let (wake, woken) = pair().map_err(|error| format!("socket: {error}"))?;
        let shared = Arc::new(Shared::new(wake));
        shared.set_passes(passes);
        let status = vec![Status::default(); links.len()];
        shared.set_status(status.clone());
        let worker = Worker {
            links: made,
            bus,
            epoch: clock::epoch(),
            shared: shared.clone(),
            woken,
            next_bus: Instant::ZERO,
            next_status: Instant::ZERO,
            status,
        };
        let thread = std::thread::Builder::new().name("bridge".into()).spawn(move || worker.run());
        Ok(Self { thread: thread.map_err(|error| format!("thread: {error}"))?, shared })
    }

    /// State that the module shares with it.
    pub(crate) fn shared(&self) -> &Shared {
        &self.shared
    }

    /// Ends the thread; [`has_ended`](Self::has_ended) is true soon.
    pub(crate) fn end(&self) {
        self.shared.end.store(true, Relaxed);
        self.shared.wake();
    }

    /// True if it was asked to end.
    pub(crate) fn is_ending(&self) -> bool {
        self.shared.end.load(Relaxed)
    }

    /// True if it has ended.
    pub(crate) fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }
}

/// True if the host of the module subscribes to the channel: one whose name has a message type. Others are read here.
pub(crate) fn is_of_the_host(channel: &str) -> bool {
    Channel::from_name(channel).is_some_and(|known| known != Channel::LlDataRaw)
}

fn pair() -> std::io::Result<(UnixStream, UnixStream)> {
    let (near, far) = UnixStream::pair()?;
    near.set_nonblocking(true)?;
    far.set_nonblocking(true)?;
    Ok((near, far))
}

fn time() -> Time {
    Time { now: clock::now(), wall_ns: clock::wall() }
}

impl Worker {
    fn run(mut self) {
        while !self.shared.end.load(Relaxed) {
            self.shared.turns.fetch_add(1, Relaxed);
            let mut bytes = [0; 256];
            while self.woken.read(&mut bytes).is_ok_and(|count| count == bytes.len()) {}
            let turn = self.turn();
            for link in &mut self.links {
                let bus = &mut self.bus;
                link.serve(turn, &time, |channel, payload| bus.publish_raw(channel, payload).is_ok());
            }
            // Not before what was read.
            let turn = self.turn();
            let more = self.send(turn);
            self.report(turn.time.now);
            if self.wait(turn.time.now, more).is_err() {
                break;
            }
        }
    }

    fn turn(&self) -> Turn {
        Turn { time: time(), epoch: self.epoch, passes: self.shared.passes() }
    }

    /// Sends what waits on the bus and what the module passed; true if there may be more.
    fn send(&mut self, turn: Turn) -> bool {
        let (mut outgoing, lost) = self.shared.take_outgoing();
        let more = self.read_bus(turn.time.now, &mut outgoing);
        let modules = self.shared.modules();
        for link in &mut self.links {
            link.count_lost(lost);
            link.send_modules(turn.time.now, modules.as_ref());
            outgoing.iter().for_each(|message| link.send(turn, message));
            link.flush();
        }
        more
    }

    fn read_bus(&mut self, now: Instant, outgoing: &mut Vec<Outgoing>) -> bool {
        if now < self.next_bus {
            return false;
        }
        for _ in 0..BURST {
            let received = self.bus.receive_with(now, |at, raw| {
                if !is_of_the_host(raw.channel) {
                    let (channel, payload) = (raw.channel.to_owned(), raw.data.to_vec());
                    outgoing.push(Outgoing { at, channel, module: None, stops: false, payload });
                }
                false
            });
            match received {
                Received::Nothing => return false,
                Received::Broken(why) => {
                    self.next_bus = now + BUS_RETRY;
                    self.shared.note(Note::Warning(why));
                    return false;
                }
                Received::Message { .. } | Received::Foreign | Received::Malformed { .. } => {}
            }
        }
        true
    }

    fn report(&mut self, now: Instant) {
        for link in &mut self.links {
            link.take_notes().into_iter().for_each(|note| self.shared.note(note));
        }
        let is_changed = |(link, status): (&Link, &Status)| link.is_up(now) != status.up;
        if now >= self.next_status || self.links.iter().zip(&self.status).any(is_changed) {
            self.next_status = now + STATUS_PERIOD;
            self.status = self.links.iter().map(|link| link.status(now)).collect();
            self.shared.set_status(self.status.clone());
        }
    }

    fn wait(&self, now: Instant, more: bool) -> Result<(), Errno> {
        let due = self.links.iter().filter_map(|link| link.poll_timeout(now)).min();
        let wait = due.map_or(WAIT_MAX, |due| due.since(now)).min(WAIT_MAX);
        let wait = if more { Duration::ZERO } else { wait };
        let bus = (now >= self.next_bus).then(|| self.bus.as_fd());
        let fds = bus.into_iter().chain([self.woken.as_fd()]);
        let mut fds: Vec<PollFd<'_>> = fds.map(|fd| PollFd::new(fd, PollFlags::POLLIN)).collect();
        fds.extend(self.links.iter().flat_map(|link| link.fds(now)));
        // Rounded up: not to spin through the last millisecond.
        let millis = u16::try_from(wait.as_nanos().div_ceil(1_000_000)).unwrap_or(u16::MAX);
        match poll(&mut fds, PollTimeout::from(millis)) {
            Ok(_) | Err(Errno::EINTR) => Ok(()),
            Err(errno) => {
                self.shared.note(Note::Warning(format!("poll: {}", errno.desc())));
                Err(errno)
            }
        }
    }
}
