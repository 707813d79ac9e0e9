//! State of a CAN interface in the kernel, and the restart of its controller: two messages of rtnetlink
//! (linux/rtnetlink.h, if_link.h, can/netlink.h). Crates for that contain all of netlink.

use base::can::{BusState, Health};
use nix::errno::Errno;
use nix::net::if_::if_nametoindex;
use nix::sys::socket::{AddressFamily, MsgFlags, NetlinkAddr, SockFlag, SockProtocol, SockType, recv, sendto, socket};
use std::os::fd::AsRawFd;
use std::path::Path;
use std::{fs, io};

const INTERFACES: &str = "/sys/class/net";
const NLMSG_ERROR: u16 = 2;
const RTM_NEWLINK: u16 = 16;
const RTM_GETLINK: u16 = 18;
const NLM_F_REQUEST: u16 = 1;
const NLM_F_ACK: u16 = 4;
/// Sizes of `struct nlmsghdr` and `struct ifinfomsg`.
const HEADER: usize = 16;
const INFO: usize = 16;
const IFLA_TXQLEN: u16 = 13;
const IFLA_LINKINFO: u16 = 18;
const IFLA_INFO_KIND: u16 = 1;
const IFLA_INFO_DATA: u16 = 2;
const IFLA_CAN_BITTIMING: u16 = 1;
const IFLA_CAN_STATE: u16 = 4;
const IFLA_CAN_RESTART_MS: u16 = 6;
const IFLA_CAN_RESTART: u16 = 7;
const IFLA_CAN_BERR_COUNTER: u16 = 8;
/// Mask of an attribute's type without its flag bits.
const KIND: u16 = 0x3FFF;
/// Size of the receive buffer; an interface's description takes one or two KiB.
const ANSWER: usize = 16 * 1024;

/// State of an interface; a virtual one has no bit timing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Link {
    /// Bit rate, bit/s.
    pub bitrate: Option<u32>,
    /// State and error counters of the controller (0 if the driver does not report them).
    pub health: Option<Health>,
    /// Delay after which the kernel restarts a controller that is bus-off, ms; 0: never.
    pub restart_ms: Option<u32>,
    /// Length of the transmit queue for frames of all processes.
    pub queue: Option<u32>,
}

impl Link {
    /// Queries the kernel.
    pub fn ask(interface: &str) -> io::Result<Self> {
        let answer = transact(&request(RTM_GETLINK, NLM_F_REQUEST, index(interface)?, &[]))?;
        Ok(Self::parse(answer.get(HEADER + INFO..).unwrap_or_default()))
    }

    fn parse(attributes: &[u8]) -> Self {
        let mut link = Self::default();
        for (kind, value) in Attributes(attributes) {
            match kind {
                IFLA_TXQLEN => link.queue = number(value),
                IFLA_LINKINFO => {
                    let data = Attributes(value).find(|(kind, _)| *kind == IFLA_INFO_DATA);
                    data.into_iter().flat_map(|(_, value)| Attributes(value)).for_each(|one| link.take(one));
                }
                _ => {}
            }
        }
        // Some drivers report every error state as a warning but count correctly: the worse of state and counters
        // applies.
        if let Some(health) = &mut link.health {
            health.state = health.state.max(BusState::of(health.transmit_errors, health.receive_errors));
        }
        link
    }

    fn take(&mut self, (kind, value): (u16, &[u8])) {
        match kind {
            // An interface that was never set up has bit rate 0.
            IFLA_CAN_BITTIMING => self.bitrate = number(value).filter(|rate| *rate > 0),
            IFLA_CAN_RESTART_MS => self.restart_ms = number(value),
            IFLA_CAN_STATE => {
                let state = match number(value) {
                    Some(0) => BusState::Active,
                    Some(1) => BusState::Warning,
                    Some(2) => BusState::Passive,
                    Some(3) => BusState::Off,
                    // Stopped or sleeping.
                    _ => return,
                };
                self.health.get_or_insert_default().state = state;
            }
            IFLA_CAN_BERR_COUNTER => {
                let shown = |at: usize| {
                    let count = value.get(at..at + 2).map_or(0, |two| u16::from_ne_bytes([two[0], two[1]]));
                    count.min(255) as u8
                };
                let health = self.health.get_or_insert_default();
                (health.transmit_errors, health.receive_errors) = (shown(0), shown(2));
            }
            _ => {}
        }
    }
}

/// Restarts a controller that is bus-off; requires CAP_NET_ADMIN (else `PermissionDenied`) and a driver that supports
/// it.
pub fn restart(interface: &str) -> io::Result<()> {
    transact(&restart_request(index(interface)?)).map(drop)
}

fn restart_request(index: u32) -> Vec<u8> {
    let data = attribute(IFLA_CAN_RESTART, &1u32.to_ne_bytes());
    let info = [attribute(IFLA_INFO_KIND, b"can"), attribute(IFLA_INFO_DATA, &data)].concat();
    request(RTM_NEWLINK, NLM_F_REQUEST | NLM_F_ACK, index, &attribute(IFLA_LINKINFO, &info))
}

/// Index of the interface, read from sysfs. The ioctl (`if_nametoindex`) would, for an absent interface, run modprobe
/// for a module of that name and block the caller: longer than the hang detection permits when an adapter is unplugged.
pub fn index(interface: &str) -> io::Result<u32> {
    let number = match fs::read_to_string(format!("{INTERFACES}/{interface}/ifindex")) {
        Ok(number) => number,
        Err(_) if !Path::new(INTERFACES).is_dir() => return Ok(if_nametoindex(interface)?),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Err(Errno::ENODEV.into()),
        Err(error) => return Err(error),
    };
    number.trim().parse().map_err(|_| io::ErrorKind::InvalidData.into())
}

/// Sends a request and returns the kernel's answer.
fn transact(request: &[u8]) -> io::Result<Vec<u8>> {
    let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
    let socket = socket(AddressFamily::Netlink, SockType::Raw, flags, SockProtocol::NetlinkRoute)?;
    sendto(socket.as_raw_fd(), request, &NetlinkAddr::new(0, 0), MsgFlags::empty())?;
    let mut answer = vec![0; ANSWER];
    let length = recv(socket.as_raw_fd(), &mut answer, MsgFlags::empty())?;
    answer.truncate(length);
    check(answer)
}

/// Returns the answer unless it is an error.
fn check(answer: Vec<u8>) -> io::Result<Vec<u8>> {
    let kind = answer.get(4..6).map(|kind| u16::from_ne_bytes([kind[0], kind[1]]));
    if kind != Some(NLMSG_ERROR) {
        return Ok(answer);
    }
    match answer.get(HEADER..).and_then(number).map(u32::cast_signed) {
        Some(0) => Ok(answer),
        Some(errno) => Err(io::Error::from_raw_os_error(errno.saturating_neg())),
        None => Err(io::ErrorKind::InvalidData.into()),
    }
}

fn request(kind: u16, flags: u16, index: u32, attributes: &[u8]) -> Vec<u8> {
    let length = (HEADER + INFO + attributes.len()) as u32;
    let mut request = Vec::with_capacity(length as usize);
    request.extend_from_slice(&length.to_ne_bytes());
    request.extend_from_slice(&kind.to_ne_bytes());
    request.extend_from_slice(&flags.to_ne_bytes());
    request.extend_from_slice(&[0; 8]); // Sequence and port: ours, by the kernel.
    request.extend_from_slice(&[0; 4]); // Family, device type.
    request.extend_from_slice(&index.to_ne_bytes());
    request.extend_from_slice(&[0; 8]); // Flags, and which of them change.
    request.extend_from_slice(attributes);
    request
}

/// Attribute with its value, padded to a multiple of four.
fn attribute(kind: u16, value: &[u8]) -> Vec<u8> {
    let length = 4 + value.len();
    let mut attribute = Vec::with_capacity(length.next_multiple_of(4));
    attribute.extend_from_slice(&(length as u16).to_ne_bytes());
    attribute.extend_from_slice(&kind.to_ne_bytes());
    attribute.extend_from_slice(value);
    attribute.resize(length.next_multiple_of(4), 0);
    attribute
}

/// Number at the start of a value.
fn number(value: &[u8]) -> Option<u32> {
    value.first_chunk().map(|bytes| u32::from_ne_bytes(*bytes))
}

/// Iterator over complete attributes.
struct Attributes<'a>(&'a [u8]);

impl<'a> Iterator for Attributes<'a> {
    type Item = (u16, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let length = usize::from(u16::from_ne_bytes(*self.0.first_chunk()?));
        let kind = u16::from_ne_bytes(*self.0.get(2..4)?.first_chunk()?) & KIND;
        let value = self.0.get(4..length)?;
        self.0 = self.0.get(length.next_multiple_of(4)..).unwrap_or_default();
        Some((kind, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An interface as linux/can/netlink.h describes it: 500 kbit/s, this state, 128 and 5 errors, no automatic
    /// restart.
    fn can(state: u32) -> Vec<u8> {
        let bittiming = [500_000u32, 875, 125, 6, 7, 2, 1, 1].map(u32::to_ne_bytes).concat();
        let data = [
            attribute(IFLA_CAN_BITTIMING, &bittiming),
            attribute(IFLA_CAN_STATE, &state.to_ne_bytes()),
            attribute(IFLA_CAN_RESTART_MS, &0u32.to_ne_bytes()),
            attribute(IFLA_CAN_BERR_COUNTER, &[128u16, 5].map(u16::to_ne_bytes).concat()),
        ];
        // The kernel flags nested attributes; the length of a name is no multiple of four.
        let nested = |kind: u16, value: &[u8]| attribute(kind | 0x8000, value);
        let info = [attribute(IFLA_INFO_KIND, b"can\0"), nested(IFLA_INFO_DATA, &data.concat())].concat();
        let name = attribute(3, b"can0\0");
        [name, attribute(IFLA_TXQLEN, &10u32.to_ne_bytes()), nested(IFLA_LINKINFO, &info)].concat()
    }

    #[test]
    fn attributes_of_an_interface_are_parsed() {
        let health = Health { state: BusState::Passive, transmit_errors: 128, receive_errors: 5 };
        let expected = Link { bitrate: Some(500_000), health: Some(health), restart_ms: Some(0), queue: Some(10) };
        assert_eq!(Link::parse(&can(2)), expected);
        // The driver reports a warning, as usb_8dev does at each error; no counter shows bus-off.
        assert_eq!(Link::parse(&can(1)), expected);
        let off = Health { state: BusState::Off, ..health };
        assert_eq!(Link::parse(&can(3)), Link { health: Some(off), ..expected });
    }

    #[test]
    fn no_damage_to_an_answer_does_harm() {
        let good = can(2);
        for end in 0..good.len() {
            Link::parse(&good[..end]);
        }
        for at in 0..good.len() {
            for byte in 0..=255 {
                let mut bad = good.clone();
                bad[at] = byte;
                Link::parse(&bad);
            }
        }
        for length in 0..HEADER + 4 {
            let _ = check(vec![2; length]);
        }
    }

    #[test]
    fn an_interface_without_bit_timing_is_queried_and_not_restarted() {
        let link = Link::ask("lo").unwrap();
        assert_eq!((link.bitrate, link.health, link.restart_ms), (None, None, None));
        assert!(link.queue.is_some());
        assert!(restart("lo").is_err());
        assert_eq!(Link::ask("can_not_here").unwrap_err().raw_os_error(), Some(Errno::ENODEV as i32));
        assert_eq!(index("lo").unwrap(), if_nametoindex("lo").unwrap());
    }

    #[test]
    fn the_restart_request_equals_that_of_ip() {
        // Header: length, RTM_NEWLINK, request and acknowledge; interface 7; link info: kind "can", data: restart, 1.
        let mut expected = vec![56, 0, 0, 0, 16, 0, 5, 0];
        expected.extend([0; 12]);
        expected.extend([7, 0, 0, 0]);
        expected.extend([0; 8]);
        expected.extend([24, 0, 18, 0, 7, 0, 1, 0, b'c', b'a', b'n', 0, 12, 0, 2, 0, 8, 0, 7, 0, 1, 0, 0, 0]);
        let made = restart_request(7);
        if cfg!(target_endian = "little") {
            assert_eq!(made, expected);
        }
    }
}
