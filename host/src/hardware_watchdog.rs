//! Hardware watchdog of the computer (`/dev/watchdog`), which resets the computer unless it is fed.
//!
//! Opening the device arms it; writing `V` before closing disarms it. Closed without that, as after a kill, it keeps
//! counting (Documentation/watchdog/watchdog-api.rst).

use super::sys;
use base::{Duration, Instant};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// Feeding period; its timeout is in seconds.
const PERIOD: Duration = Duration::from_secs(1);

/// An armed hardware watchdog.
pub struct HardwareWatchdog {
    device: File,
    next: Instant,
}

impl HardwareWatchdog {
    /// Arms it: from now on it must be fed. Also returns a line for people with the timeout.
    ///
    /// # Errors
    /// The reason in one line.
    pub fn open(path: &Path, timeout_s: u32) -> Result<(Self, String), String> {
        let flags = nix::libc::O_NONBLOCK | nix::libc::O_NOCTTY;
        let device = OpenOptions::new().write(true).custom_flags(flags).open(path);
        let device = device
            .map_err(|error| format!("hardware watchdog {}: {error}; the robot runs without it", path.display()))?;
        let note = match sys::set_watchdog_timeout(device.as_fd(), timeout_s) {
            Ok(seconds) => format!("hardware watchdog {}: resets after {seconds} s", path.display()),
            Err(error) => format!("hardware watchdog {}: its default timeout is in effect: {error}", path.display()),
        };
        Ok((Self { device, next: Instant::ZERO }, note))
    }

    /// Feeds it if that is due.
    pub fn feed(&mut self, now: Instant) {
        if self.next <= now {
            self.next = now + PERIOD;
            // A device that rejects the write resets the computer by itself.
            let _ = self.device.write_all(&[0]);
        }
    }

    /// Disarms it: the computer keeps running.
    pub fn disarm(mut self) {
        let _ = self.device.write_all(b"V");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_watchdog_is_fed_each_second_and_disarmed_on_close() {
        let path = std::env::temp_dir().join(format!("advee-watchdog-{}", std::process::id()));
        fs::write(&path, "").unwrap();
        let (mut device, note) = HardwareWatchdog::open(&path, 10).unwrap();
        assert!(note.contains("its default timeout is in effect"), "a file has no limit to set: {note}");
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
