//! The kernel's text tables, read. What is not as expected is left out: a table of a newer kernel is no error.

use std::net::{Ipv4Addr, SocketAddrV4};

/// A row of `/proc/net/udp`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UdpSocket {
    pub local: SocketAddrV4,
    /// Bytes of kernel memory that waiting datagrams take.
    pub queued: u64,
    pub uid: u32,
    pub inode: u64,
    /// Datagrams it did not get: its buffer was full, or a filter of its own refused them.
    pub drops: u64,
}

/// `/proc/net/udp`.
pub fn udp_sockets(text: &str) -> Vec<UdpSocket> {
    text.lines().filter_map(udp_socket).collect()
}

fn udp_socket(line: &str) -> Option<UdpSocket> {
    let columns: Vec<&str> = line.split_whitespace().collect();
    // sl local remote st tx:rx tr:when retransmits uid timeout inode ref pointer drops
    let &[_, local, _, _, queues, _, _, uid, _, inode, _, _, drops, ..] = &columns[..] else { return None };
    let (address, port) = local.split_once(':')?;
    // The address is printed as the machine reads its four bytes, the port as a number.
    let address = Ipv4Addr::from(u32::from_str_radix(address, 16).ok()?.to_ne_bytes());
    Some(UdpSocket {
        local: SocketAddrV4::new(address, u16::from_str_radix(port, 16).ok()?),
        queued: u64::from_str_radix(queues.split_once(':')?.1, 16).ok()?,
        uid: uid.parse().ok()?,
        inode: inode.parse().ok()?,
        drops: drops.parse().ok()?,
    })
}

/// True if any socket has joined `group` on the interface with this index, from `/proc/net/igmp`: a line for each
/// interface, under it one for each group.
pub fn joined(text: &str, index: u32, group: Ipv4Addr) -> bool {
    let wanted = format!("{:08X}", u32::from_ne_bytes(group.octets()));
    let mut at = None;
    text.lines().skip(1).any(|line| {
        let first = line.split_whitespace().next().unwrap_or_default();
        if !line.starts_with(char::is_whitespace) {
            at = first.parse::<u32>().ok();
        }
        at == Some(index) && first == wanted
    })
}

/// A counter of `/proc/net/snmp` or `/proc/net/netstat`: a line of names, then a line of values.
pub fn counter(text: &str, table: &str, name: &str) -> Option<u64> {
    let mut lines = text.lines().filter(|line| line.split_once(':').is_some_and(|(head, _)| head == table));
    let (names, values) = (lines.next()?, lines.next()?);
    let at = names.split_whitespace().position(|word| word == name)?;
    values.split_whitespace().nth(at)?.parse().ok()
}

/// True if the capability of this number (linux/capability.h) is effective, from `/proc/self/status`.
pub fn capable(status: &str, capability: u32) -> bool {
    let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    line.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> capability & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const UDP: &str = "   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref pointer drops
  435: 434CFFEF:1DF3 00000000:0000 07 00000000:0001B000 00:00000000 00000000  1000        0 67254 2 00000000a5e1c2d4 17
  436: 0100007F:0035
 nonsense
";

    #[test]
    #[cfg(target_endian = "little")]
    fn a_socket_is_a_row_and_what_is_broken_is_none() {
        let local = SocketAddrV4::new(Ipv4Addr::new(239, 255, 76, 67), 7667);
        let row = UdpSocket { local, queued: 110_592, uid: 1000, inode: 67_254, drops: 17 };
        assert_eq!(udp_sockets(UDP), [row]);
    }

    #[test]
    #[cfg(target_endian = "little")]
    fn a_group_is_joined_on_the_interface_above_it() {
        let text = "Idx\tDevice    : Count Querier\tGroup    Users Timer\tReporter
1\tlo        :     2      V3
\t\t\t\t434CFFEF     3 0:00000000\t\t0
\t\t\t\t010000E0     1 0:00000000\t\t0
2\teth0      :     1      V3
\t\t\t\t010000E0     1 0:00000000\t\t0
";
        let group = Ipv4Addr::new(239, 255, 76, 67);
        assert!(joined(text, 1, group) && !joined(text, 2, group) && !joined(text, 3, group));
        assert!(joined(text, 2, Ipv4Addr::new(224, 0, 0, 1)) && !joined("", 1, group));
    }

    #[test]
    fn a_counter_is_found_by_the_name_above_it() {
        let text = "TcpExt: A B\nTcpExt: 1 2\nIpExt: A OutMcastPkts\nIpExt: 3 4\n";
        assert_eq!(counter(text, "IpExt", "OutMcastPkts"), Some(4));
        assert_eq!(counter(text, "IpExt", "B"), None);
        assert_eq!(counter(text, "Udp", "A"), None);
        assert_eq!(counter("", "IpExt", "A"), None);
    }

    #[test]
    fn a_capability_is_a_bit() {
        let status = "Name:\tx\nCapEff:\t0000000000001000\n";
        assert!(capable(status, 12) && !capable(status, 13) && !capable("", 0));
    }
}
