//! State of the machine's network. Only reads.

use super::tables::{self, UdpSocket};
use nix::ifaddrs::getifaddrs;
use nix::net::if_::{InterfaceFlags, if_nametoindex};
use std::collections::BTreeMap;
use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket as Socket};

/// A network interface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    pub name: String,
    pub index: u32,
    pub up: bool,
    pub loopback: bool,
    pub multicast: bool,
    /// MTU, bytes; 0 if the kernel does not report it.
    pub mtu: u32,
    pub addresses: Vec<Ipv4Addr>,
    /// `rp_filter` as it acts: 0 off, 1 strict, 2 loose.
    pub rp_filter: u32,
}

/// All interfaces in the kernel's order.
pub fn interfaces() -> Vec<Interface> {
    let mut interfaces: Vec<Interface> = Vec::new();
    for entry in getifaddrs().into_iter().flatten() {
        let name = entry.interface_name;
        let at = interfaces.iter().position(|interface| interface.name == name).unwrap_or_else(|| {
            let flag = |flag| entry.flags.contains(flag);
            interfaces.push(Interface {
                index: if_nametoindex(name.as_str()).unwrap_or(0),
                up: flag(InterfaceFlags::IFF_UP),
                loopback: flag(InterfaceFlags::IFF_LOOPBACK),
                multicast: flag(InterfaceFlags::IFF_MULTICAST),
                mtu: number(&format!("/sys/class/net/{name}/mtu")).unwrap_or(0) as u32,
                addresses: Vec::new(),
                rp_filter: rp_filter(&name),
                name: name.clone(),
            });
            interfaces.len() - 1
        });
        let address = entry.address.as_ref().and_then(|address| address.as_sockaddr_in());
        interfaces[at].addresses.extend(address.map(nix::sys::socket::SockaddrIn::ip));
    }
    interfaces
}

/// The kernel takes the greater of the two (Documentation/networking/ip-sysctl.rst).
fn rp_filter(interface: &str) -> u32 {
    let of = |name: &str| sysctl(&format!("net.ipv4.conf.{name}.rp_filter")).unwrap_or(0);
    of("all").max(of(interface)) as u32
}

/// A number in `/proc/sys`.
pub fn sysctl(name: &str) -> Option<u64> {
    number(&format!("/proc/sys/{}", name.replace('.', "/")))
}

fn number(path: &str) -> Option<u64> {
    fs::read_to_string(path).ok()?.trim().parse().ok()
}

/// Source address of a datagram to `to`, which gives the interface that the official LCM would use; an error where
/// there is no route. Sends nothing.
pub fn source_towards(to: SocketAddrV4) -> std::io::Result<Ipv4Addr> {
    let socket = Socket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    socket.connect(to)?;
    match socket.local_addr()? {
        std::net::SocketAddr::V4(address) => Ok(*address.ip()),
        std::net::SocketAddr::V6(_) => Err(std::io::ErrorKind::AddrNotAvailable.into()),
    }
}

/// A socket of some program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listener {
    pub uid: u32,
    /// Name and process id; none: another user's, which only root may see.
    pub program: Option<(String, u32)>,
    /// True if its process runs this executable, whose sockets filter: see [`UdpSocket::drops`].
    pub ours: bool,
    pub drops: u64,
}

/// Sockets on the bus: bound to the group or, as LCM before 1.4 and Java, to any address.
pub fn listeners(bus: SocketAddrV4) -> Vec<Listener> {
    let mut sockets = udp_sockets();
    sockets.retain(|socket| {
        socket.local.port() == bus.port() && (socket.local.ip() == bus.ip() || socket.local.ip().is_unspecified())
    });
    if sockets.is_empty() {
        return Vec::new();
    }
    let programs = programs();
    let this = fs::read_link("/proc/self/exe").ok();
    let listener = |socket: &UdpSocket| {
        let program = programs.get(&socket.inode).cloned();
        let exe = program.as_ref().and_then(|(_, pid)| fs::read_link(format!("/proc/{pid}/exe")).ok());
        Listener { uid: socket.uid, ours: exe.is_some() && exe == this, program, drops: socket.drops }
    };
    sockets.iter().map(listener).collect()
}

/// True if any program of this host has joined `group` on an interface.
pub fn joined(interface: &Interface, group: Ipv4Addr) -> bool {
    tables::joined(&fs::read_to_string("/proc/net/igmp").unwrap_or_default(), interface.index, group)
}

/// All UDP sockets of this network name space.
pub fn udp_sockets() -> Vec<UdpSocket> {
    tables::udp_sockets(&fs::read_to_string("/proc/net/udp").unwrap_or_default())
}

/// Which program holds a socket, by the socket's inode.
fn programs() -> BTreeMap<u64, (String, u32)> {
    let mut programs = BTreeMap::new();
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    for process in processes {
        let Some(pid) = process.file_name().to_str().and_then(|name| name.parse().ok()) else { continue };
        let mut name = None;
        for fd in fs::read_dir(process.path().join("fd")).into_iter().flatten().flatten() {
            let Ok(target) = fs::read_link(fd.path()) else { continue };
            let inode = target.to_str().and_then(|link| link.strip_prefix("socket:[")?.strip_suffix(']')?.parse().ok());
            let Some(inode) = inode else { continue };
            let name: &String = name.get_or_insert_with(|| program(pid));
            programs.insert(inode, (name.clone(), pid));
        }
    }
    programs
}

/// `advee run watchdog`, `python3 square.py`: the executable and the arguments that are no options.
fn program(pid: u32) -> String {
    let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let line = String::from_utf8_lossy(&line).into_owned();
    let words = line.split('\0').take(3).take_while(|word| !word.is_empty() && !word.starts_with('-'));
    words.map(|word| word.rsplit('/').next().unwrap_or(word)).collect::<Vec<_>>().join(" ")
}

/// A counter of the whole name space since it began.
pub fn counter(file: &str, table: &str, name: &str) -> Option<u64> {
    tables::counter(&fs::read_to_string(file).ok()?, table, name)
}
