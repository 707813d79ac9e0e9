//! Who guards the guard: what the watchdog's process tells `advee up`, and what that tells the system's service
//! manager.
//!
//! Both are datagrams. To systemd they are those of sd_notify(3), in the few lines that need no library.

use base::{Duration, Instant};
use std::io;
use std::os::fd::AsFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Set for the watchdog's process where its standard input is a socket to its parent.
pub const VARIABLE: &str = "ADVEE_UP";
/// The watchdog tells its parent this often, or a little later when it is awake anyway.
const PERIOD: Duration = Duration::from_millis(100);
const LATER: Duration = Duration::from_millis(50);
/// More than this of a status is not told.
const STATUS_MAX: usize = 200;

/// What the watchdog says of itself, ten times a second: that it goes round, whether the critical modules are healthy,
/// and a few words for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// True if they are.
    pub healthy: bool,
    /// How all are.
    pub status: String,
}

impl Pulse {
    fn encode(&self) -> String {
        let status: String = self.status.chars().filter(|c| !c.is_control()).take(STATUS_MAX).collect();
        format!("{}{status}", if self.healthy { '+' } else { '-' })
    }

    /// None: nothing of ours.
    fn decode(datagram: &[u8]) -> Option<Self> {
        let (first, status) = datagram.split_first()?;
        let status = String::from_utf8_lossy(status).chars().filter(|c| !c.is_control()).collect();
        matches!(first, b'+' | b'-').then(|| Self { healthy: *first == b'+', status })
    }
}

/// The watchdog's side.
pub struct ToParent {
    socket: UnixDatagram,
    pulse: Pulse,
    next: Instant,
}

impl ToParent {
    /// None where the parent does not want to hear.
    ///
    /// # Errors
    /// Standard input cannot be had.
    pub fn open(now: Instant) -> io::Result<Option<Self>> {
        if std::env::var_os(VARIABLE).is_none() {
            return Ok(None);
        }
        let socket = UnixDatagram::from(io::stdin().as_fd().try_clone_to_owned()?);
        socket.set_nonblocking(true)?;
        Ok(Some(Self { socket, pulse: Pulse { healthy: false, status: "starting".into() }, next: now }))
    }

    /// From now on so.
    pub fn set(&mut self, healthy: bool, status: String) {
        self.pulse = Pulse { healthy, status };
    }

    /// Tells when that is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.next <= now {
            self.next = now + PERIOD;
            // A parent that does not read has troubles of its own.
            let _ = self.socket.send(self.pulse.encode().as_bytes());
        }
    }

    /// When it must be called.
    #[must_use]
    pub fn next(&self) -> Instant {
        self.next + LATER
    }
}

/// The parent's side.
pub struct FromWatchdog(UnixDatagram);

impl FromWatchdog {
    /// A pair: this side, and what is to be the watchdog's standard input.
    ///
    /// # Errors
    /// There is no descriptor left.
    pub fn pair() -> io::Result<(Self, UnixDatagram)> {
        let (here, there) = UnixDatagram::pair()?;
        here.set_nonblocking(true)?;
        Ok((Self(here), there))
    }

    /// Takes what has come.
    pub fn poll(&self) -> Option<Pulse> {
        let mut datagram = [0; 1 + 4 * STATUS_MAX];
        loop {
            let length = self.0.recv(&mut datagram).ok()?;
            if let Some(pulse) = Pulse::decode(&datagram[..length]) {
                return Some(pulse);
            }
        }
    }
}

impl AsFd for FromWatchdog {
    fn as_fd(&self) -> std::os::fd::BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// The service manager.
pub struct Manager {
    socket: UnixDatagram,
    address: SocketAddr,
    /// It wants to hear `WATCHDOG=1` at least this often; none: never.
    watchdog: Option<Duration>,
    fed: Option<Instant>,
    ready: bool,
    status: String,
}

impl Manager {
    /// The one that started this process, if one did and wants to hear.
    ///
    /// # Errors
    /// One line: it wants to, and cannot.
    pub fn open() -> Result<Option<Self>, String> {
        let variable = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
        let Some(path) = variable("NOTIFY_SOCKET") else { return Ok(None) };
        // Another process may be meant.
        let mine = variable("WATCHDOG_PID").is_none_or(|pid| pid == std::process::id().to_string());
        let usec = variable("WATCHDOG_USEC").filter(|_| mine).and_then(|usec| usec.parse().ok());
        let watchdog = usec.filter(|usec| *usec > 0).map(Duration::from_micros);
        Self::at(&path, watchdog).map(Some).map_err(|error| format!("NOTIFY_SOCKET {path}: {error}"))
    }

    fn at(path: &str, watchdog: Option<Duration>) -> io::Result<Self> {
        let address = match path.strip_prefix('@') {
            Some(name) => SocketAddr::from_abstract_name(name)?,
            None => SocketAddr::from_pathname(path)?,
        };
        let socket = UnixDatagram::unbound()?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, address, watchdog, fed: None, ready: false, status: String::new() })
    }

    /// Passes on how the robot is: `READY=1` once it is healthy for the first time, `STATUS=` where that changed, and
    /// `WATCHDOG=1` only while it is healthy.
    pub fn pulse(&mut self, now: Instant, pulse: &Pulse) {
        let mut text = String::new();
        if pulse.healthy && !self.ready {
            self.ready = true;
            text += "READY=1\n";
        }
        if self.status != pulse.status {
            self.status.clone_from(&pulse.status);
            text += &format!("STATUS={}\n", pulse.status);
        }
        // Four times as often as it must be: what is late or lost is no reset.
        let due = |every: Duration| self.fed.is_none_or(|fed| now.since(fed) >= every / 4);
        if pulse.healthy && self.watchdog.is_some_and(due) {
            self.fed = Some(now);
            text += "WATCHDOG=1\n";
        }
        self.send(&text);
    }

    /// The end begins.
    pub fn stopping(&mut self) {
        self.send("STOPPING=1\n");
    }

    fn send(&self, text: &str) {
        if !text.is_empty() {
            // It may be starting anew itself.
            let _ = self.socket.send_to_addr(text.as_bytes(), &self.address);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_arrives_and_nonsense_is_none() {
        let (here, there) = FromWatchdog::pair().unwrap();
        let told = [true, false].map(|healthy| Pulse { healthy, status: "5 of 5 modules RUN".into() });
        for pulse in &told {
            there.send(pulse.encode().as_bytes()).unwrap();
            there.send(b"").unwrap();
            there.send(&[0xFF; 2000]).unwrap();
        }
        assert_eq!([here.poll(), here.poll(), here.poll()], [Some(told[0].clone()), Some(told[1].clone()), None]);
        let long = Pulse { healthy: true, status: "x\n".repeat(999) }.encode();
        assert_eq!(long, format!("+{}", "x".repeat(STATUS_MAX)));
    }

    #[test]
    fn the_manager_is_fed_only_while_the_robot_is_healthy() {
        let name = format!("advee-notify-{}", std::process::id());
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let manager = UnixDatagram::bind_addr(&address).unwrap();
        manager.set_nonblocking(true).unwrap();
        let mut notify = Manager::at(&format!("@{name}"), Some(Duration::from_secs(2))).unwrap();
        let mut said = |ms: u64, healthy: bool, status: &str| {
            notify.pulse(Instant::from_millis(ms), &Pulse { healthy, status: status.into() });
            let mut text = [0; 200];
            let length = manager.recv(&mut text).unwrap_or(0);
            String::from_utf8(text[..length].to_vec()).unwrap()
        };
        assert_eq!(said(0, false, "starting"), "STATUS=starting\n");
        assert_eq!(said(100, false, "starting"), "");
        assert_eq!(said(200, true, "well"), "READY=1\nSTATUS=well\nWATCHDOG=1\n");
        assert_eq!(said(600, true, "well"), "");
        assert_eq!(said(700, true, "well"), "WATCHDOG=1\n");
        assert_eq!(said(9000, false, "ill"), "STATUS=ill\n");
        assert_eq!(said(20_000, true, "well"), "STATUS=well\nWATCHDOG=1\n");
    }
}
