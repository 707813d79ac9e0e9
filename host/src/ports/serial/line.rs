//! Opening and configuration of a serial device: the settings are read back, and unsupported ones are reported.

use super::driver::Driver;
use super::{ByteParity, Direction, TerminalConfig, Transport};
use crate::ports::Lost;
use crate::sys::{self, CMSPAR, Rs485Direction};
use nix::errno::Errno;
use nix::fcntl::{OFlag, open};
use nix::libc::{self, termios2};
use nix::sys::stat::{FileStat, Mode, fstat, lstat};
use nix::sys::termios::{FlushArg, tcflush};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Maximum relative error of the bit rate: half a bit over the 11 bits of a word, shared by both ends.
const BAUD_TOLERANCE: f64 = 0.02;
/// Maximum number of links that are followed, as by the kernel.
const LINKS_MAX: u32 = 40;

/// An open device.
pub struct Opened {
    pub file: OwnedFd,
    /// Notes for people: differences from the requested settings that are tolerable.
    pub notes: Vec<String>,
}

/// Opens a device in raw mode, 8 data bits, 1 stop bit, no parity or space parity, and locks it exclusively.
pub fn open_terminal(config: &TerminalConfig) -> Result<Opened, Lost> {
    let named = |why: &dyn std::fmt::Display| format!("{}: {why}", config.path.display());
    let flags = OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC;
    let file = open(&config.path, flags, Mode::empty()).map_err(|errno| match errno {
        Errno::EBUSY => named(&"another process holds it"),
        errno => named(&errno.desc()),
    })?;
    let settings = sys::line_settings(file.as_fd()).map_err(|_| named(&"is no terminal"))?;
    sys::take_exclusively(file.as_fd()).map_err(|error| match error.kind() {
        io::ErrorKind::WouldBlock => named(&"another process holds it"),
        _ => named(&error),
    })?;
    if Driver::of(file.as_fd()) == Driver::Pseudo && is_stale(&config.path, file.as_fd()) {
        return Err(named(&"leads to a pseudo-terminal that has ended; its number is of another one now"));
    }
    let mut notes = Vec::new();
    set_up(file.as_fd(), settings, config, &mut notes).map_err(|why| named(&why))?;
    tcflush(&file, FlushArg::TCIOFLUSH).map_err(|errno| named(&errno.desc()))?;
    Ok(Opened { file, notes })
}

/// True if the last link on the way to a pseudo-terminal is older than the terminal: the process that made the link was
/// killed, and the number of its terminal was given to the next one, of whatever line.
fn is_stale(path: &Path, terminal: BorrowedFd<'_>) -> bool {
    let changed = |stat: FileStat| (stat.st_ctime, stat.st_ctime_nsec);
    let link = last_link(path).and_then(|link| lstat(&link).ok());
    link.zip(fstat(terminal).ok()).is_some_and(|(link, terminal)| changed(link) < changed(terminal))
}

/// Last of the links that lead from a path to a file; `None` if the path is the file.
fn last_link(path: &Path) -> Option<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..LINKS_MAX {
        let target = path.parent()?.join(fs::read_link(&path).ok()?);
        if !target.is_symlink() {
            return Some(path);
        }
        path = target;
    }
    None
}

fn set_up(
    file: BorrowedFd<'_>,
    settings: termios2,
    config: &TerminalConfig,
    notes: &mut Vec<String>,
) -> Result<(), String> {
    let driver = Driver::of(file);
    if config.bytes.is_none() && config.transport == Transport::Parity {
        if driver == Driver::Pseudo {
            return Err("transport \"parity\" needs a real port: this is a pseudo-terminal, whose driver (pty) drops \
                        PARENB without a word; there \"two-byte\" is what works"
                .into());
        }
        notes.extend(driver.parity());
    }
    let asked = match config.bytes {
        // The simulator's has no parity.
        Some(_) if driver == Driver::Pseudo => raw_bytes(settings, ByteParity::None, config.baud),
        Some(parity) => raw_bytes(settings, parity, config.baud),
        None => raw(settings, config),
    };
    let told = |error: io::Error| format!("its settings: {error}");
    sys::set_line_settings(file, &asked, false).map_err(told)?;
    compare(&asked, &sys::line_settings(file).map_err(told)?).map_err(|what| format!("{what}: {driver} cannot"))?;
    if let Some(direction) = config.direction {
        switch_direction(file, direction).map_err(|why| format!("rs485_direction: {why}; {driver}"))?;
    }
    if config.low_latency
        && driver != Driver::Pseudo
        && let Err(error) = sys::set_low_latency(file)
    {
        notes.push(format!("low_latency: {driver} does not support it: {error}"));
    }
    if config.dtr_low
        && driver != Driver::Pseudo
        && let Err(error) = sys::lower_dtr(file)
    {
        notes.push(format!("DTR stays high, so that a motor that it switches stands: {driver}: {error}"));
    }
    Ok(())
}

/// Settings for nine bits at the rate of `config`, based on the device's.
fn raw(settings: termios2, config: &TerminalConfig) -> termios2 {
    let parity = config.transport == Transport::Parity;
    let mut raw = plain(settings, config.baud);
    // A break is not ignored: it reads as an address word and so ends the frame that it interrupted.
    raw.c_iflag = if parity { libc::INPCK | libc::PARMRK } else { 0 };
    if parity {
        raw.c_cflag |= libc::PARENB | CMSPAR;
    }
    raw
}

/// Settings for characters of 11 bits with eight data bits. One with wrong parity reads as 0, and fails a checksum.
fn raw_bytes(settings: termios2, parity: ByteParity, baud: u32) -> termios2 {
    let mut raw = plain(settings, baud);
    raw.c_cflag |= match parity {
        ByteParity::None => libc::CSTOPB,
        ByteParity::Even => libc::PARENB,
        ByteParity::Odd => libc::PARENB | libc::PARODD,
    };
    raw.c_iflag = if parity == ByteParity::None { 0 } else { libc::INPCK };
    raw
}

/// Eight data bits without any processing.
fn plain(settings: termios2, baud: u32) -> termios2 {
    let mut raw = settings;
    raw.c_iflag = 0;
    raw.c_oflag = 0;
    raw.c_lflag = 0;
    // Without CIBAUD bits the input speed equals the output speed.
    raw.c_cflag = libc::CS8 | libc::CREAD | libc::CLOCAL | libc::BOTHER;
    raw.c_ispeed = baud;
    raw.c_ospeed = baud;
    raw.c_cc[libc::VMIN] = 1;
    raw.c_cc[libc::VTIME] = 0;
    raw
}

/// The same settings in mark or space parity.
pub fn with_parity(settings: &termios2, mark: bool) -> termios2 {
    let mut settings = *settings;
    settings.c_cflag = settings.c_cflag & !libc::PARODD | if mark { libc::PARODD } else { 0 };
    settings
}

/// Compares the requested settings with those in effect; the error names the first unsupported one.
fn compare(asked: &termios2, got: &termios2) -> Result<(), String> {
    let differs = |flags: libc::tcflag_t| (asked.c_cflag ^ got.c_cflag) & flags != 0;
    let wants_parity = asked.c_cflag & libc::PARENB != 0;
    if differs(libc::PARENB) && wants_parity {
        return Err("parity".into());
    }
    if wants_parity && differs(CMSPAR | libc::PARODD) {
        return Err("mark and space parity (CMSPAR)".into());
    }
    if differs(libc::CSIZE | libc::CSTOPB | libc::PARENB) {
        let stop_bits = if asked.c_cflag & libc::CSTOPB == 0 { "1 stop bit" } else { "2 stop bits" };
        return Err(format!("8 data bits, {stop_bits}, no parity"));
    }
    let (wanted, runs_at) = (f64::from(asked.c_ospeed), f64::from(got.c_ospeed));
    if (runs_at - wanted).abs() > BAUD_TOLERANCE * wanted {
        return Err(format!("{wanted} Bd (it stays at {runs_at})"));
    }
    Ok(())
}

fn switch_direction(file: BorrowedFd<'_>, direction: Direction) -> Result<(), String> {
    let Direction { rts_on_send, rts_after_send, delay_before_ms, delay_after_ms } = direction;
    let flags = 1 | u32::from(rts_on_send) << 1 | u32::from(rts_after_send) << 2;
    let asked = Rs485Direction::new(flags, delay_before_ms, delay_after_ms);
    match sys::set_rs485_direction(file, asked) {
        Ok(got) if got == asked => Ok(()),
        Ok(got) => Err(format!("the port uses other settings: requested {asked}, in effect {got}")),
        Err(error) if error.raw_os_error() == Some(libc::ENOTTY) => {
            Err("the port does not support direction control (TIOCSRS485): leave the key out where the adapter does"
                .into())
        }
        Err(error) => Err(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(transport: Transport) -> TerminalConfig {
        TerminalConfig { transport, ..TerminalConfig::new("/dev/ttyS0".into(), 250_000) }
    }

    fn blank() -> termios2 {
        termios2 {
            c_iflag: 0x7FF,
            c_oflag: 5,
            c_cflag: 0xBF,
            c_lflag: 0x8A3B,
            c_line: 0,
            c_cc: [3; 19],
            c_ispeed: 9600,
            c_ospeed: 9600,
        }
    }

    #[test]
    fn parity_is_eight_bits_with_space_parity_and_marked_errors_at_any_rate() {
        let asked = raw(blank(), &config(Transport::Parity));
        assert_eq!(asked.c_iflag, libc::INPCK | libc::PARMRK);
        assert_eq!(asked.c_cflag & (libc::PARENB | libc::PARODD | CMSPAR), libc::PARENB | CMSPAR);
        assert_eq!((asked.c_cflag & libc::CBAUD, asked.c_ospeed, asked.c_lflag), (libc::BOTHER, 250_000, 0));
        assert_eq!(with_parity(&asked, true).c_cflag ^ asked.c_cflag, libc::PARODD);
        assert_eq!(with_parity(&with_parity(&asked, true), false), asked);
        assert_eq!(raw(blank(), &config(Transport::TwoByte)).c_iflag, 0);
    }

    #[test]
    fn bytes_are_eight_bits_with_parity_or_a_second_stop_bit() {
        let flags = libc::CSIZE | libc::PARENB | libc::PARODD | libc::CSTOPB | CMSPAR;
        let of = |parity| {
            let raw = raw_bytes(blank(), parity, 19_200);
            (raw.c_cflag & flags, raw.c_iflag, raw.c_ospeed)
        };
        assert_eq!(of(ByteParity::None), (libc::CS8 | libc::CSTOPB, 0, 19_200));
        assert_eq!(of(ByteParity::Even), (libc::CS8 | libc::PARENB, libc::INPCK, 19_200));
        assert_eq!(of(ByteParity::Odd), (libc::CS8 | libc::PARENB | libc::PARODD, libc::INPCK, 19_200));
    }

    #[test]
    fn settings_that_a_driver_drops_are_named() {
        let asked = raw(blank(), &config(Transport::Parity));
        let made = |change: fn(&mut termios2)| {
            let mut got = asked;
            change(&mut got);
            compare(&asked, &got)
        };
        assert_eq!(made(|_| {}), Ok(()));
        assert_eq!(made(|got| got.c_cflag &= !libc::PARENB), Err("parity".into()));
        assert_eq!(made(|got| got.c_cflag &= !CMSPAR), Err("mark and space parity (CMSPAR)".into()));
        assert_eq!(made(|got| got.c_cflag &= !libc::CSIZE), Err("8 data bits, 1 stop bit, no parity".into()));
        assert_eq!(made(|got| got.c_ospeed = 9600), Err("250000 Bd (it stays at 9600)".into()));
        assert_eq!(made(|got| got.c_ospeed = 249_000), Ok(()), "within the tolerance of a divisor");
    }
}
