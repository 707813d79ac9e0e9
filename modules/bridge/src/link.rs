//! A connection of the configuration with its sockets: the listener or the attempts to connect, the peers that identify
//! themselves, and the one that did.

use crate::auth::Key;
use crate::connection::{Connection, Event, Refusal, Time};
use crate::gate::{Arrival, Dropped, Gate, Passes, Rules};
use crate::key_file;
use crate::settings;
use crate::shared::{Counters, Note, Outgoing, Status};
use base::{Duration, Epoch, Instant};
use host::ports::begin_tcp;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, OwnedFd};

/// Time between two attempts to connect or to listen, and after a peer without the key.
const RETRY: Duration = Duration::from_millis(250);
const RETRY_REFUSED: Duration = Duration::from_secs(2);
/// Time limit of an attempt to connect.
const ATTEMPT_MAX: Duration = Duration::from_secs(1);
/// Maximum number of peers that have not identified themselves yet; for a further one see [`displaced`].
const PENDING_MAX: usize = 4;
/// Shortest time between two turns in which connections are accepted, and the number of a turn: more than a stranger
/// should fill the kernel's queue with, in which the other computer would wait.
const ACCEPT_PERIOD: Duration = Duration::from_millis(50);
const ACCEPTS: usize = 64;
/// Period of the list of modules, and the age from which one does not count any more: of this computer's watchdog as
/// for `driver_canbus`, of the other computer with the time under way.
const MODULES_PERIOD: Duration = Duration::from_millis(100);
const OWN_MODULES_AGE_MAX: Duration = Duration::from_millis(250);
const MODULES_AGE_MAX: Duration = Duration::from_millis(400);
/// Maximum number of notes of a turn, and of different warnings about dropped messages in their period.
const NOTES_MAX: usize = 16;
const WARNING_PERIOD: Duration = Duration::from_secs(10);
/// Bytes that are read from a peer at once, and reads in a turn.
const READ: usize = 16 << 10;
const READS: usize = 8;

struct Peer {
    socket: TcpStream,
    from: SocketAddr,
    connection: Connection,
    /// The other end closed the connection, or the kernel did.
    gone: Option<String>,
}

/// A connection to one other computer.
pub(crate) struct Link {
    settings: settings::Link,
    key: Key,
    gate: Gate,
    listener: Option<TcpListener>,
    attempt: Option<(OwnedFd, Instant)>,
    next_attempt: Instant,
    next_accept: Instant,
    next_modules: Instant,
    /// Address from which the other computer last connected with the key.
    known: Option<IpAddr>,
    /// At most one is open: the one that opened last.
    peers: Vec<Peer>,
    modules: Option<(Instant, Vec<(String, bool)>)>,
    counters: Counters,
    notes: Vec<Note>,
    /// Warnings about dropped messages, and their times, of the last [`WARNING_PERIOD`].
    warned: Vec<(Instant, String)>,
    /// Last reason for which there is no connection.
    why: String,
}

/// What the thread knows when it serves a link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turn {
    pub(crate) time: Time,
    pub(crate) epoch: Epoch,
    pub(crate) passes: Passes,
}

impl Link {
    pub(crate) fn new(settings: settings::Link, key: Key, modules: Vec<String>) -> Self {
        let gate = Gate::new(Rules {
            send: settings.sent(),
            receive: settings.received(),
            modules,
            age_max: settings.age_max,
            future_max: settings.clock_max,
            rate_max: settings.rate_max_hz,
        });
        Self {
            settings,
            key,
            gate,
            listener: None,
            attempt: None,
            next_attempt: Instant::ZERO,
            next_accept: Instant::ZERO,
            next_modules: Instant::ZERO,
            known: None,
            peers: Vec::new(),
            modules: None,
            counters: Counters::default(),
            notes: Vec::new(),
            warned: Vec::new(),
            why: String::new(),
        }
    }

    /// Serves sockets and deadlines; each message that is accepted is passed to `publish`, which is true if the bus
    /// took it. `clock` is read after the sockets: a process that was held up in between does not take what it reads
    /// for newer than it is.
    pub(crate) fn serve(&mut self, turn: Turn, clock: &dyn Fn() -> Time, mut publish: impl FnMut(&str, &[u8]) -> bool) {
        let served = match (self.settings.listen, self.settings.connect) {
            (Some(address), _) => self.accept(turn.time, address),
            (None, Some(address)) => self.connect(turn.time, address),
            (None, None) => Ok(()),
        };
        if let Err(why) = served
            && why != self.why
        {
            self.notes.push(Note::Warning(format!("{}: {why}", self.settings.name)));
            self.why = why;
        }
        for index in 0..self.peers.len() {
            let mut result = Ok(());
            for _ in 0..READS {
                let was_open = self.peers[index].connection.is_open();
                let (read, more) = self.peers[index].receive(clock);
                if !was_open && self.peers[index].connection.is_open() {
                    self.on_opened(index);
                }
                while let Some(event) = self.peers[index].connection.poll_event() {
                    let time = clock();
                    let waited = read.map_or(Duration::ZERO, |at| time.now.since(at));
                    self.on_event(Turn { time, ..turn }, waited, event, &mut publish);
                }
                result = more.map(|_| ());
                if more != Ok(true) {
                    break;
                }
            }
            let result = result.and_then(|()| self.peers[index].connection.handle_timeout(clock()));
            if let Err(refusal) = result {
                self.on_refusal(turn.time.now, index, refusal);
            }
            self.peers[index].transmit();
        }
        self.remove_gone(turn.time.now);
    }

    fn accept(&mut self, time: Time, address: SocketAddr) -> Result<(), String> {
        if self.listener.is_none() {
            if time.now >= self.next_attempt {
                self.next_attempt = time.now + RETRY;
                let bound = TcpListener::bind(address).and_then(|bound| bound.set_nonblocking(true).map(|()| bound));
                self.listener = Some(bound.map_err(|error| format!("{address}: {error}"))?);
            }
            return Ok(());
        }
        if time.now < self.next_accept {
            return Ok(());
        }
        for _ in 0..ACCEPTS {
            let Some(listener) = &self.listener else { return Ok(()) };
            match listener.accept() {
                Ok((socket, from)) => {
                    self.next_accept = time.now + ACCEPT_PERIOD;
                    let pending = self.peers.iter().enumerate().filter(|(_, peer)| !peer.connection.is_open());
                    let pending: Vec<_> = pending.map(|(place, peer)| (place, peer.from.ip())).collect();
                    if let Some(place) = displaced(&pending, from.ip(), self.known) {
                        self.peers.remove(place);
                    }
                    let connection = Connection::listen(self.key.clone(), key_file::nonce()?, time);
                    self.peers.push(Peer::new(socket, from, connection).map_err(|error| format!("{from}: {error}"))?);
                }
                Err(error) if [ErrorKind::WouldBlock, ErrorKind::Interrupted].contains(&error.kind()) => return Ok(()),
                Err(error) => {
                    // Out of descriptors, for instance.
                    self.next_accept = time.now + RETRY;
                    return Err(format!("{address}: {error}"));
                }
            }
        }
        Ok(())
    }

    fn connect(&mut self, time: Time, address: SocketAddr) -> Result<(), String> {
        if !self.peers.is_empty() || (self.attempt.is_none() && time.now < self.next_attempt) {
            return Ok(());
        }
        self.next_attempt = time.now + RETRY;
        let (socket, until) = match self.attempt.take() {
            Some(attempt) => attempt,
            None => (begin_tcp(address).map_err(|why| format!("{address}: {why}"))?.0, time.now + ATTEMPT_MAX),
        };
        let mut ready = [PollFd::new(socket.as_fd(), PollFlags::POLLOUT)];
        if poll(&mut ready, PollTimeout::ZERO).map_err(|errno| errno.desc().to_owned())? == 0 {
            if time.now >= until {
                return Err(format!("{address}: not answered"));
            }
            self.attempt = Some((socket, until));
            return Ok(());
        }
        let socket = TcpStream::from(socket);
        if let Some(error) = socket.take_error().unwrap_or_else(Some) {
            return Err(format!("{address}: {error}"));
        }
        let connection = Connection::connect(self.key.clone(), key_file::nonce()?, time);
        self.peers.push(Peer::new(socket, address, connection).map_err(|error| format!("{address}: {error}"))?);
        Ok(())
    }

    /// A peer has identified itself: it takes the place of an earlier connection, which the cable may have lost.
    fn on_opened(&mut self, index: usize) {
        for (n, other) in self.peers.iter_mut().enumerate() {
            if n != index && other.connection.is_open() {
                other.gone = Some("the other computer connected anew".into());
            }
        }
        self.known = Some(self.peers[index].from.ip());
        self.modules = None;
        self.why.clear();
    }

    /// `waited`: time since the event was received.
    fn on_event(&mut self, turn: Turn, waited: Duration, event: Event, publish: &mut impl FnMut(&str, &[u8]) -> bool) {
        match event {
            Event::Opened => {}
            Event::Modules(modules) => self.modules = Some((turn.time.now, modules)),
            Event::Message { age, channel, payload } => {
                let Turn { time: Time { now, .. }, epoch, passes } = turn;
                let age = age.map(|age| age + waited);
                let arrival = Arrival { now, timestamp: epoch.timestamp(now), age, passes };
                match self.gate.receives(arrival, &channel, &payload) {
                    Ok(()) if publish(&channel, &payload) => self.counters.received += 1,
                    Ok(()) => self.counters.dropped += 1,
                    Err(why) => self.count(now, why, &channel),
                }
            }
        }
    }

    fn count(&mut self, now: Instant, why: Dropped, channel: &str) {
        let words = match why {
            Dropped::Late | Dropped::Future => {
                self.counters.late += 1;
                return;
            }
            Dropped::State => return,
            Dropped::TooOften => "comes too often",
            Dropped::Forbidden => "is not accepted from the other computer",
            Dropped::Malformed => "is no message of its channel",
        };
        self.counters.dropped += 1;
        self.warned.retain(|(at, _)| now.since(*at) < WARNING_PERIOD);
        let text = format!("{}: {channel} {words}: dropped", self.settings.name);
        if self.warned.len() < NOTES_MAX && self.warned.iter().all(|(_, known)| *known != text) {
            self.warned.push((now, text.clone()));
            self.notes.push(Note::Warning(text));
        }
    }

    fn on_refusal(&mut self, now: Instant, index: usize, refusal: Refusal) {
        let Some(peer) = self.peers.get_mut(index) else { return };
        let words = refusal.words();
        // A cable that was pulled during the handshake is no stranger.
        let is_cable = refusal == Refusal::Unfinished && self.settings.connect.is_some();
        if refusal.is_foreign() && !is_cable {
            self.counters.refused += 1;
            let text = format!("{} {words}: refused", peer.from.ip());
            self.notes.push(Note::Refused(self.settings.name.clone(), text));
            self.next_attempt = now + RETRY_REFUSED;
        }
        peer.gone = Some(words.into());
    }

    fn remove_gone(&mut self, now: Instant) {
        let lost_open = self.peers.iter().any(|peer| peer.gone.is_some() && peer.connection.is_open());
        self.peers.retain(|peer| peer.gone.is_none());
        if lost_open && !self.peers.iter().any(|peer| peer.connection.is_open()) {
            self.modules = None;
            self.next_attempt = self.next_attempt.max(now + RETRY);
        }
    }

    fn open_peer(&self) -> Option<&Peer> {
        self.peers.iter().find(|peer| peer.connection.is_open() && peer.gone.is_none())
    }

    fn open_mut(&mut self) -> Option<&mut Peer> {
        self.peers.iter_mut().find(|peer| peer.connection.is_open() && peer.gone.is_none())
    }

    /// Sends a message of this computer's bus, if the list allows it.
    pub(crate) fn send(&mut self, turn: Turn, message: &Outgoing) {
        let Outgoing { at, channel, module, stops, payload } = message;
        if self.open_peer().is_none() {
            return;
        }
        let judged = match stops {
            true => self.gate.sends_stop(turn.passes, channel),
            false => self.gate.sends(turn.time.now, turn.passes, channel, module.as_deref()),
        };
        if judged.is_err() {
            return;
        }
        let sent = self.open_mut().is_some_and(|peer| match stops {
            true => peer.connection.send_stop(*at, channel, payload),
            false => peer.connection.send(*at, channel, payload),
        });
        let count = if sent { &mut self.counters.sent } else { &mut self.counters.dropped };
        *count += 1;
    }

    /// Counts messages that were left out before they came here.
    pub(crate) fn count_lost(&mut self, count: u64) {
        self.counters.dropped += count;
    }

    /// Sends the list of this computer's modules, if that is due and the list is fresh.
    pub(crate) fn send_modules(&mut self, now: Instant, own: Option<&(Instant, Vec<(String, bool)>)>) {
        if now < self.next_modules {
            return;
        }
        self.next_modules = now + MODULES_PERIOD;
        if let Some((at, modules)) = own
            && now.since(*at) <= OWN_MODULES_AGE_MAX
            && let Some(peer) = self.open_mut()
        {
            peer.connection.send_modules(modules);
        }
    }

    /// Sends what waits.
    pub(crate) fn flush(&mut self) {
        self.peers.iter_mut().for_each(Peer::transmit);
    }

    pub(crate) fn take_notes(&mut self) -> Vec<Note> {
        std::mem::take(&mut self.notes)
    }

    /// True if messages cross.
    pub(crate) fn is_up(&self, now: Instant) -> bool {
        self.open_peer().is_some_and(|peer| peer.connection.clocks().compare(now).is_some())
    }

    pub(crate) fn status(&self, now: Instant) -> Status {
        let peer = self.open_peer();
        let clocks = peer.and_then(|peer| peer.connection.clocks().compare(now));
        let fresh = self.modules.as_ref().filter(|(at, _)| now.since(*at) <= MODULES_AGE_MAX && peer.is_some());
        let works =
            |name: &String| fresh.is_some_and(|(_, list)| list.iter().any(|(other, works)| other == name && *works));
        Status {
            peer: peer.map_or_else(String::new, |peer| peer.from.to_string()),
            up: clocks.is_some(),
            clocks,
            missing: self.settings.modules.iter().filter(|name| !works(name)).cloned().collect(),
            counters: self.counters,
        }
    }

    /// Descriptors to wait for.
    pub(crate) fn fds(&self, now: Instant) -> Vec<PollFd<'_>> {
        let listener = self.listener.as_ref().filter(|_| now >= self.next_accept);
        let listener = listener.map(|listener| PollFd::new(listener.as_fd(), PollFlags::POLLIN));
        let attempt = self.attempt.as_ref().map(|(socket, _)| PollFd::new(socket.as_fd(), PollFlags::POLLOUT));
        let peers = self.peers.iter().map(|peer| {
            let waits = !peer.connection.poll_tx().is_empty();
            let writes = if waits { PollFlags::POLLOUT } else { PollFlags::empty() };
            PollFd::new(peer.socket.as_fd(), PollFlags::POLLIN | writes)
        });
        listener.into_iter().chain(attempt).chain(peers).collect()
    }

    /// Next deadline.
    pub(crate) fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        let peers = self.peers.iter().map(|peer| peer.connection.poll_timeout()).min();
        let accept = self.listener.as_ref().map(|_| self.next_accept).filter(|at| *at > now);
        let modules = self.open_peer().map(|_| self.next_modules);
        let idle = self.listener.is_none() && self.peers.is_empty();
        let attempt = idle.then(|| self.attempt.as_ref().map_or(self.next_attempt, |(_, until)| *until));
        [peers, accept, modules, attempt].into_iter().flatten().min()
    }
}

/// Place of the peer, of those that have not identified themselves, that makes room for a newcomer from this address:
/// the oldest from the same address, else the oldest that is not from the address of the `known` computer. A stranger,
/// however often he connects, thus displaces himself, and never the computer that was connected last.
fn displaced(pending: &[(usize, IpAddr)], newcomer: IpAddr, known: Option<IpAddr>) -> Option<usize> {
    if pending.len() < PENDING_MAX {
        return None;
    }
    let same = pending.iter().find(|(_, from)| *from == newcomer);
    let strange = || pending.iter().find(|(_, from)| Some(*from) != known);
    same.or_else(strange).or(pending.first()).map(|(place, _)| *place)
}

impl Peer {
    fn new(socket: TcpStream, from: SocketAddr, connection: Connection) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        socket.set_nodelay(true)?;
        Ok(Self { socket, from, connection, gone: None })
    }

    /// Receives what one read takes: its time, and whether there may be more.
    fn receive(&mut self, clock: &dyn Fn() -> Time) -> (Option<Instant>, Result<bool, Refusal>) {
        let mut bytes = [0; READ];
        match self.socket.read(&mut bytes) {
            Ok(0) => self.gone = Some("closed the connection".into()),
            Ok(count) => {
                let time = clock();
                return (Some(time.now), self.connection.handle_rx(time, &bytes[..count]).map(|()| true));
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) if error.kind() == ErrorKind::Interrupted => return (None, Ok(true)),
            Err(error) => self.gone = Some(error.to_string()),
        }
        (None, Ok(false))
    }

    fn transmit(&mut self) {
        while !self.connection.poll_tx().is_empty() && self.gone.is_none() {
            match self.socket.write(self.connection.poll_tx()) {
                Ok(count) => self.connection.handle_tx(count),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => self.gone = Some(error.to_string()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    #[test]
    fn strangers_who_connect_again_and_again_do_not_displace_the_other_computer() {
        let address = |last| IpAddr::from(Ipv4Addr::new(192, 168, 7, last));
        let robot = address(2);
        // Whether the robot waits after each of these connections.
        let waits = |known, from: &[IpAddr]| {
            let (mut pending, mut waits) = (Vec::<IpAddr>::new(), Vec::new());
            for from in from {
                let listed: Vec<(usize, IpAddr)> = pending.iter().copied().enumerate().collect();
                if let Some(place) = displaced(&listed, *from, known) {
                    pending.remove(place);
                }
                pending.push(*from);
                assert!(pending.len() <= PENDING_MAX);
                waits.push(pending.contains(&robot));
            }
            waits
        };
        let one = [vec![address(66); 10], vec![robot], vec![address(66); 100]].concat();
        let expected = [vec![false; 10], vec![true; 101]].concat();
        assert_eq!(waits(None, &one), expected);
        // Of many addresses, to a computer that was connected before.
        let many = [vec![robot], (66..86).map(address).collect()].concat();
        assert_eq!(waits(Some(robot), &many), [true; 21]);
        assert_eq!(waits(None, &[robot; 9]), [true; 9]);
    }

    fn link(end: &str, send: &str, receive: &str) -> Link {
        let text = format!("{end}\nkey_file = \"k\"\nsend = [{send}]\nreceive = [{receive}]");
        let node = ::settings::Node::parse(std::path::Path::new("robot.toml"), &text).unwrap();
        Link::new(::settings::read_as(&node).unwrap(), Key::new([1; 32]), Vec::new())
    }

    /// Time of a test, ms.
    fn at(ms: u64) -> Time {
        Time { now: Instant::from_millis(ms), wall_ns: 1_700_000_000_000_000_000 + ms * 1_000_000 }
    }

    #[test]
    fn a_message_that_is_read_by_a_process_that_was_held_up_is_late() {
        let address = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap();
        let mut near = link(&format!("listen = \"{address}\""), "", "\"HL_DATA_FACES\"");
        let mut far = link(&format!("connect = \"{address}\""), "\"HL_DATA_FACES\"", "");
        let turn = |ms| Turn { time: at(ms), epoch: Epoch::default(), passes: Passes::All };
        let faces = |ms| Outgoing {
            at: at(ms).now,
            channel: "HL_DATA_FACES".into(),
            module: None,
            stops: false,
            payload: b"faces".to_vec(),
        };
        let (mut ms, mut published) = (1000, 0);
        let end = std::time::Instant::now() + std::time::Duration::from_secs(20);
        while published < 5 {
            assert!(std::time::Instant::now() < end, "not within 20 s: messages cross");
            std::thread::sleep(std::time::Duration::from_millis(1));
            ms += 1;
            far.serve(turn(ms), &|| at(ms), |_, _| false);
            far.send(turn(ms), &faces(ms));
            far.flush();
            near.serve(turn(ms), &|| at(ms), |_, _| {
                published += 1;
                true
            });
        }
        // What has just been sent is read 0.3 s after the turn began.
        far.send(turn(ms), &faces(ms));
        far.flush();
        let late = near.counters.late;
        while near.counters.late == late {
            assert!(std::time::Instant::now() < end, "not within 20 s: the message arrives");
            near.serve(turn(ms), &|| at(ms + 300), |channel, _| panic!("{channel} passed"));
        }
    }

    #[test]
    fn warnings_about_dropped_messages_are_few() {
        let mut link = link("connect = \"10.0.0.2:1\"", "", "");
        let mut notes = 0;
        for ms in 0..5000 {
            link.count(Instant::from_millis(ms), Dropped::Forbidden, "HL_DATA_FACES");
            link.count(Instant::from_millis(ms), Dropped::Forbidden, &format!("HL_DATA_{ms}"));
            notes += link.take_notes().len();
        }
        assert_eq!((notes, link.counters.dropped), (NOTES_MAX, 10_000));
        link.count(Instant::from_millis(11_000), Dropped::Forbidden, "HL_DATA_FACES");
        assert_eq!(link.take_notes().len(), 1, "again after a while");
    }
}
