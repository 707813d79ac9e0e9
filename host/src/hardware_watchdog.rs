//! The computer's own watchdog (`/dev/watchdog`): it resets the computer unless it is fed.
//!
//! It is armed by being opened and disarmed by a `V` before it is closed; closed without, as by a kill, it goes on
//! counting (Documentation/watchdog/watchdog-api.rst).

use super::sys;
use base::{Duration, Instant};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// Limit is seconds: this is often enough.
const PERIOD: Duration = Duration::from_secs(1);

/// An armed one.
pub struct HardwareWatchdog {
    device: File,
    next: Instant,
}

impl HardwareWatchdog {
    /// Arms it: from now on it is to be fed. Returns a line for people, too: after how many seconds it resets.
    ///
    /// # Errors
    /// One line why it cannot be.
    pub fn open(path: &Path, timeout_s: u32) -> Result<(Self, String), String> {
        let flags = nix::libc::O_NONBLOCK | nix::libc::O_NOCTTY;
        let device = OpenOptions::new().write(true).custom_flags(flags).open(path);
        let device = device.map_err(|error| format!("hardware watchdog {}: {error}: there is none", path.display()))?;
        let told = match sys::set_watchdog_timeout(device.as_fd(), timeout_s) {
            Ok(seconds) => format!("hardware watchdog {}: resets after {seconds} s", path.display()),
            Err(error) => format!("hardware watchdog {}: its own time limit stands: {error}", path.display()),
        };
        Ok((Self { device, next: Instant::ZERO }, told))
    }

    /// Feeds it, when that is due.
    pub fn feed(&mut self, now: Instant) {
        if self.next <= now {
            self.next = now + PERIOD;
            // One that takes nothing will tell by itself.
            let _ = self.device.write_all(&[0]);
        }
    }

    /// A clean end: the computer stays on.
    pub fn disarm(mut self) {
        let _ = self.device.write_all(b"V");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn it_is_fed_each_second_and_disarmed_by_a_letter() {
        let path = std::env::temp_dir().join(format!("advee-watchdog-{}", std::process::id()));
        fs::write(&path, "").unwrap();
        let (mut device, told) = HardwareWatchdog::open(&path, 10).unwrap();
        assert!(told.contains("its own time limit stands"), "a file has no limit to set: {told}");
        for ms in (0..3000).step_by(100) {
            device.feed(Instant::from_millis(ms));
        }
        assert_eq!(fs::read(&path).unwrap(), [0; 3]);
        device.disarm();
        assert_eq!(fs::read(&path).unwrap(), [0, 0, 0, b'V']);
        fs::remove_file(&path).unwrap();
        let why = HardwareWatchdog::open(&path, 10).err().unwrap();
        assert!(why.contains("No such file"), "nothing is made: {why}");
    }
}
