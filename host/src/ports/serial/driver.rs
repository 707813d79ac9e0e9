//! Driver of a terminal: `tcsetattr` never fails, so its capabilities must be known. Tested on Linux 6.1:
//!
//! | driver | `PARENB \| CMSPAR` | effect | direction (`TIOCSRS485`) |
//! |---|---|---|---|
//! | pseudo-terminal | `PARENB` dropped silently | none; `PARMRK` only doubles `FF` | no |
//! | `serial8250` | kept | parity on the wire | no, unless the board's driver adds it |
//! | `ftdi_sio` | kept, even if refused (only in the kernel log) | parity on the wire; errors by USB packet | no |
//! | a UART of the serial core with a direction pin | kept | parity on the wire | yes |

use crate::sys;
use nix::sys::stat::{fstat, major, minor};
use std::fmt;
use std::fs;
use std::os::fd::BorrowedFd;
use std::path::Path;

/// Major number of terminals of USB adapters (`linux/usb/serial.h`).
const USB_SERIAL: u64 = 188;

/// Kernel driver of a terminal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Driver {
    /// Other end of a pseudo-terminal: no wire, no parity.
    Pseudo,
    /// `ftdi_sio`, `serial8250`, …
    Named(String),
    /// Not reported by the kernel.
    Unknown,
}

impl Driver {
    /// True for the terminal of a USB adapter, `ttyUSB0`, whatever its driver.
    pub fn is_usb_serial(terminal: BorrowedFd<'_>) -> bool {
        fstat(terminal).is_ok_and(|state| major(state.st_rdev) == USB_SERIAL)
    }

    /// Queries the kernel.
    pub fn of(terminal: BorrowedFd<'_>) -> Self {
        if sys::is_pseudo_terminal(terminal) {
            return Self::Pseudo;
        }
        let Ok(state) = fstat(terminal) else {
            return Self::Unknown;
        };
        let (major, minor) = (major(state.st_rdev), minor(state.st_rdev));
        let device = Path::new("/sys/dev/char").join(format!("{major}:{minor}")).join("device");
        Self::of_device(&device).map_or(Self::Unknown, Self::Named)
    }

    /// Nearest driver at or above a device. Newer kernels insert devices `port` and `ctrl` of the serial core between a
    /// UART and its terminal; their drivers are ignored.
    fn of_device(device: &Path) -> Option<String> {
        let mut device = fs::canonicalize(device).ok()?;
        while device.starts_with("/sys/devices") {
            let driver = fs::read_link(device.join("driver")).ok();
            let name = driver.as_deref().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
            if let Some(name) = name.filter(|name| !matches!(name.as_str(), "port" | "ctrl")) {
                return Some(name);
            }
            device = device.parent()?.into();
        }
        None
    }

    /// Limitations of its mark and space parity (see the table above), as a note for people.
    #[must_use]
    pub fn parity(&self) -> Option<String> {
        match self {
            Self::Named(name) if name == "ftdi_sio" => Some(
                "ftdi_sio tells of parity errors by USB packet, not by word: address marks may smear over their \
                 neighbours, which the CRC finds"
                    .into(),
            ),
            Self::Named(name) if matches!(name.as_str(), "serial8250" | "serial" | "lab_uart9") => None,
            Self::Pseudo => None,
            other => Some(format!("{other} was never tested with mark and space parity: try advee rs485 scan")),
        }
    }
}

impl fmt::Display for Driver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pseudo => f.write_str("the driver of pseudo-terminals (pty)"),
            Self::Named(name) => write!(f, "the driver {name}"),
            Self::Unknown => f.write_str("its driver"),
        }
    }
}
