//! Supervision of the watchdog: its process reports to `advee up`, which reports to the system's service manager.
//!
//! Both use datagrams. Those to systemd are the ones of sd_notify(3), few enough to need no library.

use base::{Duration, Instant};
use std::io;
use std::os::fd::AsFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// Environment variable of the watchdog's process, set if its standard input is a socket to its parent.
pub const VARIABLE: &str = "ADVEE_UP";
/// Period of the reports to the parent; up to [`SLACK`] later if the process is awake then anyway.
const PERIOD: Duration = Duration::from_millis(100);
const SLACK: Duration = Duration::from_millis(50);
/// Maximum length of a status, bytes; the rest is cut off.
const STATUS_MAX: usize = 200;

/// Report of the watchdog to its parent, ten times a second: it is alive, the critical modules are healthy or not, and
/// a short text for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HealthReport {
    /// True if all critical modules are healthy.
    pub healthy: bool,
    /// Summary of all modules.
    pub status: String,
}

impl HealthReport {
    fn encode(&self) -> String {
        let status: String = self.status.chars().filter(|c| !c.is_control()).take(STATUS_MAX).collect();
        format!("{}{status}", if self.healthy { '+' } else { '-' })
    }

    /// `None` if the datagram is not a report.
    fn decode(datagram: &[u8]) -> Option<Self> {
        let (first, status) = datagram.split_first()?;
        let status = String::from_utf8_lossy(status).chars().filter(|c| !c.is_control()).collect();
        matches!(first, b'+' | b'-').then(|| Self { healthy: *first == b'+', status })
    }
}

/// The watchdog's side.
pub struct ToParent {
    socket: UnixDatagram,
    pulse: HealthReport,
    next: Instant,
}

impl ToParent {
    /// `None` if the parent set up no socket.
    ///
    /// # Errors
    /// Standard input cannot be used.
    pub fn open(now: Instant) -> io::Result<Option<Self>> {
        if std::env::var_os(VARIABLE).is_none() {
            return Ok(None);
        }
        let socket = UnixDatagram::from(io::stdin().as_fd().try_clone_to_owned()?);
        socket.set_nonblocking(true)?;
        Ok(Some(Self { socket, pulse: HealthReport { healthy: false, status: "starting".into() }, next: now }))
    }

    /// Sets the content of the following reports.
    pub fn set(&mut self, healthy: bool, status: String) {
        self.pulse = HealthReport { healthy, status };
    }

    /// Sends a report if that is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.next <= now {
            self.next = now + PERIOD;
            // A failure to send concerns the parent, which supervises this process.
            let _ = self.socket.send(self.pulse.encode().as_bytes());
        }
    }

    /// Deadline of the next report.
    #[must_use]
    pub fn next(&self) -> Instant {
        self.next + SLACK
    }
}

/// The parent's side.
pub struct FromWatchdog(UnixDatagram);

impl FromWatchdog {
    /// Creates both sides: this one, and the watchdog's standard input.
    ///
    /// # Errors
    /// No descriptor is left.
    pub fn pair() -> io::Result<(Self, UnixDatagram)> {
        let (here, there) = UnixDatagram::pair()?;
        here.set_nonblocking(true)?;
        Ok((Self(here), there))
    }

    /// Receives a report.
    pub fn poll(&self) -> Option<HealthReport> {
        let mut datagram = [0; 1 + 4 * STATUS_MAX];
        loop {
            let length = self.0.recv(&mut datagram).ok()?;
            if let Some(pulse) = HealthReport::decode(&datagram[..length]) {
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

/// Connection to the service manager.
pub struct Manager {
    socket: UnixDatagram,
    address: SocketAddr,
    /// It expects `WATCHDOG=1` at least this often; `None`: never.
    watchdog: Option<Duration>,
    fed: Option<Instant>,
    ready: bool,
    status: String,
}

impl Manager {
    /// Opens the connection to the service manager that started this process, if it requested notifications.
    ///
    /// # Errors
    /// One line: they were requested, but the socket cannot be used.
    pub fn open() -> Result<Option<Self>, String> {
        let variable = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
        let Some(path) = variable("NOTIFY_SOCKET") else { return Ok(None) };
        // The variable may be meant for another process.
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

    /// Forwards the state of the robot: `READY=1` when it is healthy for the first time, `STATUS=` when that changed,
    /// and `WATCHDOG=1` only while it is healthy.
    pub fn pulse(&mut self, now: Instant, pulse: &HealthReport) {
        let mut text = String::new();
        if pulse.healthy && !self.ready {
            self.ready = true;
            text += "READY=1\n";
        }
        if self.status != pulse.status {
            self.status.clone_from(&pulse.status);
            text += &format!("STATUS={}\n", pulse.status);
        }
        // Four times as often as required, so that a late or lost message causes no reset.
        let due = |every: Duration| self.fed.is_none_or(|fed| now.since(fed) >= every / 4);
        if pulse.healthy && self.watchdog.is_some_and(due) {
            self.fed = Some(now);
            text += "WATCHDOG=1\n";
        }
        self.send(&text);
    }

    /// Reports that the shutdown begins.
    pub fn stopping(&mut self) {
        self.send("STOPPING=1\n");
    }

    fn send(&self, text: &str) {
        if !text.is_empty() {
            // The manager may be restarting.
            let _ = self.socket.send_to_addr(text.as_bytes(), &self.address);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_arrives_and_invalid_datagrams_are_ignored() {
        let (here, there) = FromWatchdog::pair().unwrap();
        let told = [true, false].map(|healthy| HealthReport { healthy, status: "5 of 5 modules RUN".into() });
        for pulse in &told {
            there.send(pulse.encode().as_bytes()).unwrap();
            there.send(b"").unwrap();
            there.send(&[0xFF; 2000]).unwrap();
        }
        assert_eq!([here.poll(), here.poll(), here.poll()], [Some(told[0].clone()), Some(told[1].clone()), None]);
        let long = HealthReport { healthy: true, status: "x\n".repeat(999) }.encode();
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
            notify.pulse(Instant::from_millis(ms), &HealthReport { healthy, status: status.into() });
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
