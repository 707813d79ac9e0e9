//! `udpm://GROUP:PORT?key=value&key=value`: where the bus is. Defaults are LCM's:
//! `udpm://239.255.76.67:7667?ttl=0`.
//!
//! | option | default | meaning |
//! |---|---|---|
//! | `ttl` | 0 | multicast time to live, 0..=255; 0 stays on this host, 1 on its subnet |
//! | `recv_buf_size` | 0 | receive buffer in bytes; 0: [`RECV_BUF_SIZE`] |
//! | `shm` | `off` | the local shared-memory bus, not built yet: `off` and `auto` (use it where it is) are the same |
//!
//! Any other option is a warning, as in `liblcm`; a later one wins. Unlike there a group without a port gets 7667
//! (`liblcm`: port 0, which cannot publish), the group must be a multicast address, and numbers must be numbers.

use core::fmt;
use core::net::{AddrParseError, Ipv4Addr, SocketAddrV4};

/// LCM's default group.
pub const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 76, 67);
/// LCM's default port.
pub const PORT: u16 = 7667;
/// The receive buffer asked for when the URL names none, in bytes. The kernel's default of 208 KiB overflows while a
/// process waits for its turn on a busy processor.
pub const RECV_BUF_SIZE: usize = 2 << 20;

/// Where the bus is and how to join it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Url {
    /// An IPv4 multicast address.
    pub group: Ipv4Addr,
    /// UDP port, not 0.
    pub port: u16,
    /// Multicast time to live; 0 stays on this host.
    pub ttl: u8,
    /// Bytes to ask the kernel for as receive buffer.
    pub recv_buf_size: usize,
}

impl Default for Url {
    fn default() -> Self {
        Self { group: GROUP, port: PORT, ttl: 0, recv_buf_size: RECV_BUF_SIZE }
    }
}

/// An option that changes nothing. One line for people by `Display`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Warning {
    /// Nobody knows this option.
    Unknown(String),
    /// LCM once had this option.
    Obsolete(String),
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(option) => {
                write!(f, "LCM URL: unknown option `{option}` ignored; known are ttl, recv_buf_size, shm")
            }
            Self::Obsolete(option) => {
                write!(f, "LCM URL: option `{option}` is obsolete and ignored")
            }
        }
    }
}

/// Why a URL was refused. One line for people by `Display`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UrlError {
    /// It does not start with `udpm://`.
    Provider(String),
    /// The group is not an IPv4 multicast address. Host names are not resolved.
    Group(String),
    /// The port is not 1..=65535.
    Port(String),
    /// The value of an option is not in its range.
    Value {
        /// The option.
        key: &'static str,
        /// What stands there.
        value: String,
        /// What may stand there.
        allowed: &'static str,
    },
}

impl fmt::Display for UrlError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Provider(url) => write!(f, "LCM URL `{url}`: only udpm://GROUP:PORT?ttl=N is supported"),
            Self::Group(group) => {
                write!(f, "LCM URL: `{group}` is not an IPv4 multicast address (224.0.0.0 to 239.255.255.255)")
            }
            Self::Port(port) => write!(f, "LCM URL: port `{port}` is not within 1 to 65535"),
            Self::Value { key, value, allowed } => write!(f, "LCM URL: {key}=`{value}`; allowed is {allowed}"),
        }
    }
}

impl core::error::Error for UrlError {}

impl Url {
    /// Reads a URL; the empty text is the default.
    ///
    /// # Errors
    /// It is not a `udpm` URL, or group, port or the value of an option are out of range.
    pub fn parse(text: &str) -> Result<(Self, Vec<Warning>), UrlError> {
        let mut url = Self::default();
        let mut warnings = Vec::new();
        if text.is_empty() {
            return Ok((url, warnings));
        }
        let rest = text.strip_prefix("udpm://").ok_or_else(|| UrlError::Provider(text.into()))?;
        let (network, options) = rest.split_once('?').unwrap_or((rest, ""));
        url.set_network(network)?;
        // Split at further `?` too, as liblcm does.
        for option in options.split(['&', '?']).filter(|option| !option.is_empty()) {
            warnings.extend(url.set_option(option)?);
        }
        Ok((url, warnings))
    }

    /// Group and port together.
    #[must_use]
    pub fn address(&self) -> SocketAddrV4 {
        SocketAddrV4::new(self.group, self.port)
    }

    fn set_network(&mut self, network: &str) -> Result<(), UrlError> {
        let (group, port) = network.split_once(':').map_or((network, None), |(group, port)| (group, Some(port)));
        if !group.is_empty() {
            let wrong = |_: AddrParseError| UrlError::Group(group.into());
            self.group = group.parse().map_err(wrong)?;
        }
        if !self.group.is_multicast() {
            return Err(UrlError::Group(group.into()));
        }
        if let Some(port) = port {
            let in_range = number(port).and_then(|n| u16::try_from(n).ok()).filter(|&n| n > 0);
            self.port = in_range.ok_or_else(|| UrlError::Port(port.into()))?;
        }
        Ok(())
    }

    fn set_option(&mut self, option: &str) -> Result<Option<Warning>, UrlError> {
        let (key, value) = option.split_once('=').unwrap_or((option, ""));
        let wrong = |key, allowed| UrlError::Value { key, value: value.into(), allowed };
        match key {
            "ttl" => {
                let ttl = number(value).and_then(|n| u8::try_from(n).ok());
                self.ttl = ttl.ok_or_else(|| wrong("ttl", "0 to 255"))?;
            }
            "recv_buf_size" => {
                // The kernel takes an int and doubles it.
                let size = number(value).filter(|&n| n <= i32::MAX as u32 / 2);
                self.recv_buf_size = match size.ok_or_else(|| wrong("recv_buf_size", "0 to 1073741823"))? {
                    0 => RECV_BUF_SIZE,
                    size => size as usize,
                };
            }
            "shm" if matches!(value, "off" | "auto") => {}
            "shm" => return Err(wrong("shm", "off or auto")),
            "transmit_only" => return Ok(Some(Warning::Obsolete(key.into()))),
            _ => return Ok(Some(Warning::Unknown(option.into()))),
        }
        Ok(None)
    }
}

impl fmt::Display for Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "udpm://{}:{}?ttl={}", self.group, self.port, self.ttl)?;
        if self.recv_buf_size != RECV_BUF_SIZE {
            write!(f, "&recv_buf_size={}", self.recv_buf_size)?;
        }
        Ok(())
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
mod tests {
    use super::*;

    fn parsed(text: &str) -> Url {
        let (url, warnings) = Url::parse(text).expect(text);
        assert_eq!(warnings, [], "{text}");
        url
    }

    #[test]
    fn what_is_left_out_has_lcms_default() {
        let default = parsed("udpm://239.255.76.67:7667?ttl=0");
        for text in ["", "udpm://", "udpm://?", "udpm://239.255.76.67", "udpm://:7667", "udpm://?recv_buf_size=0"] {
            assert_eq!(parsed(text), default, "{text}");
        }
        assert_eq!(default, Url::default());
        assert_eq!(parsed("udpm://224.1.2.3"), Url { group: Ipv4Addr::new(224, 1, 2, 3), ..default });
    }

    #[test]
    fn options_are_read_and_a_later_one_wins() {
        let url = parsed("udpm://239.1.2.3:1?ttl=1&recv_buf_size=0x10000&shm=auto?ttl=255&");
        let wanted = Url { group: Ipv4Addr::new(239, 1, 2, 3), port: 1, ttl: 255, recv_buf_size: 65536 };
        assert_eq!(url, wanted);
        assert_eq!(url.to_string(), "udpm://239.1.2.3:1?ttl=255&recv_buf_size=65536");
        assert_eq!(parsed(&url.to_string()), url);
        assert_eq!(Url::default().to_string(), "udpm://239.255.76.67:7667?ttl=0");
    }

    #[test]
    fn an_unknown_option_is_a_warning() {
        let (url, warnings) = Url::parse("udpm://?TTL=1&transmit_only=true&flag").unwrap();
        assert_eq!(url, Url::default());
        let wanted = [
            Warning::Unknown("TTL=1".into()),
            Warning::Obsolete("transmit_only".into()),
            Warning::Unknown("flag".into()),
        ];
        assert_eq!(warnings, wanted);
    }

    #[test]
    fn a_wrong_url_is_one_clear_line() {
        for (text, line) in [
            ("tcpq://127.0.0.1", "LCM URL `tcpq://127.0.0.1`: only udpm://GROUP:PORT?ttl=N is supported"),
            ("udpm:/", "LCM URL `udpm:/`: only udpm://GROUP:PORT?ttl=N is supported"),
            (
                "udpm://10.0.0.1:7667",
                "LCM URL: `10.0.0.1` is not an IPv4 multicast address (224.0.0.0 to 239.255.255.255)",
            ),
            ("udpm://robot", "LCM URL: `robot` is not an IPv4 multicast address (224.0.0.0 to 239.255.255.255)"),
            ("udpm://239.1.1.1:0", "LCM URL: port `0` is not within 1 to 65535"),
            ("udpm://239.1.1.1:", "LCM URL: port `` is not within 1 to 65535"),
            ("udpm://239.1.1.1:65536", "LCM URL: port `65536` is not within 1 to 65535"),
            ("udpm://?ttl=256", "LCM URL: ttl=`256`; allowed is 0 to 255"),
            ("udpm://?ttl", "LCM URL: ttl=``; allowed is 0 to 255"),
            ("udpm://?ttl=+1", "LCM URL: ttl=`+1`; allowed is 0 to 255"),
            ("udpm://?ttl=010", "LCM URL: ttl=`010`; allowed is 0 to 255"),
            ("udpm://?recv_buf_size=-1", "LCM URL: recv_buf_size=`-1`; allowed is 0 to 1073741823"),
            ("udpm://?shm=on", "LCM URL: shm=`on`; allowed is off or auto"),
        ] {
            assert_eq!(Url::parse(text).unwrap_err().to_string(), line);
        }
    }
}
