//! `PROVIDER://NETWORK?key=value&key=value`: where the bus is. Nothing at all is LCM's default,
//! `udpm://239.255.76.67:7667?ttl=0`.
//!
//! | provider | network | is |
//! |---|---|---|
//! | `udpm` | multicast group and port | UDP multicast, no server; [`Udpm`] |
//! | `tcpq` | address and port of a hub, `127.0.0.1:7700` | a TCP connection to a hub |
//! | `memq` | nothing | within one context, for tests |
//! | `file` | the path of an event log | playback and recording; [`File`] |
//!
//! | option | of | default | meaning |
//! |---|---|---|---|
//! | `ttl` | `udpm` | 0 | multicast time to live, 0..=255; 0 stays on this host, 1 on its subnet |
//! | `recv_buf_size` | `udpm` | 0 | receive buffer in bytes; 0: [`RECV_BUF_SIZE`] |
//! | `interface` | `udpm` | | name or IPv4 address of the network interface to use instead of what the routing table says |
//! | `shm` | `udpm` | `off` | `auto`: shared memory of this user; a user id: of that user's group |
//! | `mode` | `file` | `r` | `r` plays, `w` records anew, `a` records at the end |
//! | `speed` | `file` | 1 | of playback, against the recorded pace; 0: as fast as possible |
//! | `start_timestamp` | `file` | | where playback starts, µs since 1970 |
//!
//! Any other option is a warning, as in `liblcm`; a later one wins. Unlike there a group without a port gets 7667
//! (`liblcm`: port 0, which cannot publish), the group must be a multicast address, and numbers must be numbers.
//!
//! ```
//! use lcm::url::{Udpm, Url};
//!
//! let (url, warnings) = Url::parse("udpm://239.255.76.67?ttl=1&speed=2")?;
//! assert_eq!(url, Udpm { ttl: 1, ..Udpm::default() }.into());
//! assert!(warnings[0].to_string().starts_with("LCM URL: unknown option `speed=2` ignored"));
//! # Ok::<(), lcm::url::UrlError>(())
//! ```

mod error;

use core::fmt;
use core::net::{Ipv4Addr, SocketAddrV4};
use core::str::FromStr;
pub use error::{UrlError, Warning};

/// LCM's default group.
pub const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 76, 67);
/// LCM's default port.
pub const PORT: u16 = 7667;
/// The default port of a TCPQ hub.
pub const TCPQ_PORT: u16 = 7700;
/// Default receive buffer, bytes. The kernel's default of 208 KiB overflows while a process waits for its turn on a
/// busy processor.
pub const RECV_BUF_SIZE: usize = 2 << 20;

/// A bus, and how to join it.
#[derive(Clone, Debug, PartialEq)]
pub enum Url {
    /// UDP multicast.
    Udpm(Udpm),
    /// A hub that is reached by TCP.
    Tcpq(SocketAddrV4),
    /// Within this context only.
    Memq,
    /// An event log.
    File(File),
}

/// UDP multicast.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Udpm {
    /// An IPv4 multicast address.
    pub group: Ipv4Addr,
    /// UDP port, not 0.
    pub port: u16,
    /// Multicast time to live; 0 stays on this host.
    pub ttl: u8,
    /// Bytes to ask the kernel for as receive buffer.
    pub recv_buf_size: usize,
    /// Network interface to use; `None`: by the routing table, and `lo`.
    pub interface: Option<Interface>,
    /// The shared-memory bus beside it.
    pub shm: Shm,
}

/// A network interface.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Interface {
    /// By its name, `eth0`.
    Name(String),
    /// By its address.
    Address(Ipv4Addr),
}

/// Exchange of messages through shared memory between programs of one host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shm {
    /// Never.
    #[default]
    Off,
    /// With those that do, too; datagrams go out where others may listen.
    Auto,
    /// In the folder of this user, which that user shares with its group.
    Of(u32),
}

/// An event log.
#[derive(Clone, Debug, PartialEq)]
pub struct File {
    /// Path; not empty.
    pub path: String,
    /// Playback or recording.
    pub mode: Mode,
}

/// Use of an event log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// Events are received.
    Play {
        /// Against the recorded pace; 0 is as fast as possible. Finite, not negative.
        speed: f64,
        /// Events before this one are skipped, µs since 1970.
        start: Option<i64>,
    },
    /// Records published messages; earlier content is lost.
    Write,
    /// Records published messages at the end.
    Append,
}

impl Default for Url {
    fn default() -> Self {
        Self::Udpm(Udpm::default())
    }
}

impl From<Udpm> for Url {
    fn from(udpm: Udpm) -> Self {
        Self::Udpm(udpm)
    }
}

impl Default for Udpm {
    fn default() -> Self {
        Self { group: GROUP, port: PORT, ttl: 0, recv_buf_size: RECV_BUF_SIZE, interface: None, shm: Shm::Off }
    }
}

impl Url {
    /// Reads a URL; the empty text is the default.
    ///
    /// # Errors
    /// The provider is unknown, or network or the value of an option are out of range.
    pub fn parse(text: &str) -> Result<(Self, Vec<Warning>), UrlError> {
        if text.is_empty() {
            return Ok((Self::default(), Vec::new()));
        }
        let (provider, rest) = text.split_once("://").ok_or_else(|| UrlError::Provider(text.into()))?;
        let (network, options) = rest.split_once('?').unwrap_or((rest, ""));
        let mut warnings = Vec::new();
        // Split at further `?` too, as liblcm does.
        let options = options.split(['&', '?']).filter(|option| !option.is_empty());
        let options = options.map(|option| Opt { text: option, pair: option.split_once('=').unwrap_or((option, "")) });
        let url = match provider {
            "udpm" => Self::Udpm(Udpm::parse(network, options, &mut warnings)?),
            "tcpq" => {
                warnings.extend(options.map(|option| option.unknown("")));
                Self::Tcpq(hub(network)?)
            }
            "memq" if network.is_empty() => {
                warnings.extend(options.map(|option| option.unknown("")));
                Self::Memq
            }
            "memq" => return Err(UrlError::Network { network: network.into(), allowed: "nothing" }),
            "file" => Self::File(File::parse(network, options, &mut warnings)?),
            _ => return Err(UrlError::Provider(text.into())),
        };
        Ok((url, warnings))
    }
}

/// An option `key=value`.
struct Opt<'a> {
    text: &'a str,
    pair: (&'a str, &'a str),
}

impl Opt<'_> {
    fn unknown(&self, known: &'static str) -> Warning {
        Warning::Unknown { option: self.text.into(), known }
    }

    fn wrong(&self, key: &'static str, allowed: &'static str) -> UrlError {
        UrlError::Value { key, value: self.pair.1.into(), allowed }
    }
}

impl Udpm {
    const OPTIONS: &'static str = "ttl, recv_buf_size, interface, shm";

    /// Group and port together.
    #[must_use]
    pub fn address(&self) -> SocketAddrV4 {
        SocketAddrV4::new(self.group, self.port)
    }

    fn parse<'a>(
        network: &str,
        options: impl Iterator<Item = Opt<'a>>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, UrlError> {
        let mut url = Self::default();
        (url.group, url.port) = address(network, (GROUP, PORT), UrlError::Group)?;
        if !url.group.is_multicast() {
            return Err(UrlError::Group(url.group.to_string()));
        }
        for option in options {
            warnings.extend(url.set(&option)?);
        }
        Ok(url)
    }

    fn set(&mut self, option: &Opt<'_>) -> Result<Option<Warning>, UrlError> {
        let (key, value) = option.pair;
        match key {
            "ttl" => {
                let ttl = number(value).and_then(|n| u8::try_from(n).ok());
                self.ttl = ttl.ok_or_else(|| option.wrong("ttl", "0 to 255"))?;
            }
            "recv_buf_size" => {
                // The kernel takes an int and doubles it.
                let size = number(value).filter(|&n| n <= i32::MAX as u32 / 2);
                self.recv_buf_size = match size.ok_or_else(|| option.wrong("recv_buf_size", "0 to 1073741823"))? {
                    0 => RECV_BUF_SIZE,
                    size => size as usize,
                };
            }
            "interface" => {
                let name = |name: &str| (1..16).contains(&name.len()) && !name.contains(['/', ' ']);
                self.interface = Some(match value.parse() {
                    Ok(address) => Interface::Address(address),
                    Err(_) if name(value) => Interface::Name(value.into()),
                    Err(_) => {
                        return Err(option.wrong("interface", "the name of a network interface or its IPv4 address"));
                    }
                });
            }
            "shm" => {
                self.shm = match value {
                    "off" => Shm::Off,
                    "auto" => Shm::Auto,
                    user => Shm::Of(user.parse().map_err(|_| option.wrong("shm", "off, auto or a user id"))?),
                };
            }
            "transmit_only" => return Ok(Some(Warning::Obsolete(key.into()))),
            _ => return Ok(Some(option.unknown(Self::OPTIONS))),
        }
        Ok(None)
    }
}

impl File {
    fn parse<'a>(
        network: &str,
        options: impl Iterator<Item = Opt<'a>>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, UrlError> {
        if network.is_empty() {
            return Err(UrlError::Network { network: String::new(), allowed: "the path of an event log" });
        }
        let (mut speed, mut start, mut mode) = (1.0, None, "r");
        for option in options {
            match option.pair {
                ("mode", value @ ("r" | "w" | "a")) => mode = value,
                ("mode", _) => return Err(option.wrong("mode", "r, w or a")),
                ("speed", value) => {
                    let in_range = f64::from_str(value).ok().filter(|speed| speed.is_finite());
                    // liblcm: 0 or less is as fast as possible.
                    speed = in_range.ok_or_else(|| option.wrong("speed", "a number"))?.max(0.0);
                }
                ("start_timestamp", value) => {
                    let utime = i64::from_str(value).map_err(|_| option.wrong("start_timestamp", "µs since 1970"))?;
                    start = Some(utime);
                }
                _ => warnings.push(option.unknown("mode, speed, start_timestamp")),
            }
        }
        let mode = match mode {
            "w" => Mode::Write,
            "a" => Mode::Append,
            _ => Mode::Play { speed, start },
        };
        Ok(Self { path: network.into(), mode })
    }
}

fn hub(network: &str) -> Result<SocketAddrV4, UrlError> {
    let (address, port) = address(network, (Ipv4Addr::LOCALHOST, TCPQ_PORT), UrlError::Address)?;
    Ok(SocketAddrV4::new(address, port))
}

/// `ADDRESS:PORT`, either of which may be left out.
fn address(
    network: &str,
    default: (Ipv4Addr, u16),
    wrong: impl FnOnce(String) -> UrlError,
) -> Result<(Ipv4Addr, u16), UrlError> {
    let (address, port) = network.split_once(':').map_or((network, None), |(address, port)| (address, Some(port)));
    let address = match address {
        "" => default.0,
        _ => address.parse().map_err(|_| wrong(address.into()))?,
    };
    let port = match port {
        None => default.1,
        Some(port) => {
            let in_range = number(port).and_then(|n| u16::try_from(n).ok()).filter(|&n| n > 0);
            in_range.ok_or_else(|| UrlError::Port(port.into()))?
        }
    };
    Ok((address, port))
}

impl fmt::Display for Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udpm(url) => url.fmt(f),
            Self::Tcpq(hub) => write!(f, "tcpq://{hub}"),
            Self::Memq => write!(f, "memq://"),
            Self::File(File { path, mode }) => match mode {
                Mode::Write => write!(f, "file://{path}?mode=w"),
                Mode::Append => write!(f, "file://{path}?mode=a"),
                Mode::Play { speed, start } => {
                    write!(f, "file://{path}?speed={speed}")?;
                    start.map_or(Ok(()), |start| write!(f, "&start_timestamp={start}"))
                }
            },
        }
    }
}

impl fmt::Display for Udpm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "udpm://{}:{}?ttl={}", self.group, self.port, self.ttl)?;
        if self.recv_buf_size != RECV_BUF_SIZE {
            write!(f, "&recv_buf_size={}", self.recv_buf_size)?;
        }
        match &self.interface {
            Some(Interface::Name(name)) => write!(f, "&interface={name}")?,
            Some(Interface::Address(address)) => write!(f, "&interface={address}")?,
            None => {}
        }
        match self.shm {
            Shm::Off => Ok(()),
            Shm::Auto => write!(f, "&shm=auto"),
            Shm::Of(user) => write!(f, "&shm={user}"),
        }
    }
}

/// Decimal, or hexadecimal after `0x`. A leading zero, octal to `liblcm` and decimal to people, is refused.
fn number(text: &str) -> Option<u32> {
    let digits = |text: &str, radix| {
        let plain = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        plain.then(|| u32::from_str_radix(text, radix).ok()).flatten()
    };
    match text.strip_prefix("0x") {
        Some(hex) => digits(hex, 16),
        None if text.len() > 1 && text.starts_with('0') => None,
        None => digits(text, 10),
    }
}

#[cfg(test)]
mod tests;
