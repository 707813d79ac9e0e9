//! Detection of programs on this host that listen without the shared-memory bus, by `/proc/net/udp`.

use std::io::{self, Read};
use std::net::{Ipv4Addr, SocketAddrV4};

/// Presence of listeners by datagrams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Listeners {
    /// Not checked yet.
    Unknown,
    /// None at the last check and since.
    None,
    /// At least one.
    Some,
}

/// Checks all sockets of this network name space; `ours` is true for the inodes of the bus. If `/proc` cannot be read,
/// a listener is assumed.
pub fn look(bus: SocketAddrV4, ours: impl Fn(u32) -> bool) -> Listeners {
    listeners(read("udp"), read("udp6"), bus, ours)
}

/// Table of this thread: threads may have network name spaces of their own.
fn read(table: &str) -> io::Result<String> {
    #[expect(clippy::disallowed_methods, reason = "part of the live transport")]
    let mut file = std::fs::File::open(format!("/proc/thread-self/net/{table}"))?;
    // With each read the kernel walks the whole table from its beginning: a few large ones.
    let mut text = String::with_capacity(1 << 14);
    file.read_to_string(&mut text)?;
    Ok(text)
}

fn listeners(
    udp: io::Result<String>,
    udp6: io::Result<String>,
    bus: SocketAddrV4,
    ours: impl Fn(u32) -> bool,
) -> Listeners {
    let Ok(udp) = udp else { return Listeners::Some };
    // A kernel without IPv6 has no udp6. Java listens by IPv6 sockets.
    let lines = [udp, udp6.unwrap_or_default()];
    let mut sockets = lines.iter().flat_map(|table| table.lines().skip(1)).filter_map(|line| socket(line, bus));
    if sockets.any(|inode| !ours(inode)) { Listeners::Some } else { Listeners::None }
}

/// Inode of a socket that receives the bus: bound to its port, and to its group or to any address.
fn socket(line: &str, bus: SocketAddrV4) -> Option<u32> {
    let mut fields = line.split_ascii_whitespace();
    let (address, port) = fields.nth(1)?.split_once(':')?;
    // Addresses are printed as words of the machine's byte order; the last word of an IPv6 address that holds an IPv4
    // one is that address.
    let word = u32::from_str_radix(address.get(address.len().checked_sub(8)?..)?, 16).ok()?;
    let address = Ipv4Addr::from(word.to_ne_bytes());
    let hears = u16::from_str_radix(port, 16) == Ok(bus.port()) && (address.is_unspecified() || address == *bus.ip());
    let inode = fields.nth(7)?.parse().ok()?;
    (hears && inode != 0).then_some(inode)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode \
                        ref pointer drops\n";

    fn line(address: &str, port: u16, inode: u32) -> String {
        let rest = "07 00000000:00000000 00:00000000 00000000  1000        0";
        format!("  101: {address}:{port:04X} 00000000:0000 {rest} {inode} 2 0000000000000000 0\n")
    }

    fn on(udp: &[String], udp6: &[String]) -> Listeners {
        let bus = SocketAddrV4::new(Ipv4Addr::new(239, 255, 76, 67), 7667);
        let [udp, udp6] = [udp, udp6].map(|lines| Ok(HEAD.to_string() + &lines.concat()));
        listeners(udp, udp6, bus, |inode| inode < 100)
    }

    fn hex(address: [u8; 4]) -> String {
        format!("{:08X}", u32::from_ne_bytes(address))
    }

    #[test]
    fn a_socket_on_the_port_that_is_not_ours_listens() {
        let group = hex([239, 255, 76, 67]);
        assert_eq!(on(&[], &[]), Listeners::None);
        assert_eq!(on(&[line(&group, 7667, 7), line(&group, 7667, 8)], &[]), Listeners::None, "ours");
        assert_eq!(on(&[line(&group, 7667, 7), line(&group, 7667, 800)], &[]), Listeners::Some);
        assert_eq!(on(&[line("00000000", 7667, 800)], &[]), Listeners::Some, "LCM 1.3.1 binds to any address");
    }

    #[test]
    fn other_ports_and_addresses_do_not_count() {
        let group = hex([239, 255, 76, 67]);
        assert_eq!(on(&[line(&group, 7668, 800)], &[]), Listeners::None);
        assert_eq!(on(&[line(&hex([127, 0, 0, 1]), 7667, 800)], &[]), Listeners::None);
        assert_eq!(on(&[line(&hex([239, 255, 76, 68]), 7667, 800)], &[]), Listeners::None);
        assert_eq!(on(&[line(&group, 7667, 0)], &[]), Listeners::None, "a socket that is being closed");
    }

    #[test]
    fn sockets_of_ipv6_listen_too() {
        let any = "0".repeat(32);
        assert_eq!(on(&[], &[line(&any, 7667, 800)]), Listeners::Some);
        let mapped = format!("0000000000000000{}{}", hex([0, 0, 255, 255]), hex([239, 255, 76, 67]));
        assert_eq!(on(&[], &[line(&mapped, 7667, 800)]), Listeners::Some);
    }

    #[test]
    fn without_the_table_somebody_listens() {
        let bus = SocketAddrV4::new(Ipv4Addr::new(239, 255, 76, 67), 7667);
        let missing = || Err(io::ErrorKind::NotFound.into());
        assert_eq!(listeners(missing(), missing(), bus, |_| true), Listeners::Some);
        assert_eq!(listeners(Ok(HEAD.into()), missing(), bus, |_| true), Listeners::None);
        let garbage = "\n\n 0: \n 1: x\n 2: €uro:1df3 0 0 0 0 0 0 0 0 0\n : : : : : : : : : : : :\n".to_string();
        assert_eq!(listeners(Ok(garbage), missing(), bus, |_| false), Listeners::None);
    }
}
