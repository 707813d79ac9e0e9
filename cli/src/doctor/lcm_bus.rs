//! The LCM bus: what is gathered for which check of [`bus`] and [`buffer`], in the order of the report.

use super::finding::Finding;
use super::network::{Interface, Listener};
use super::probe::Trip;
use super::{buffer, bus, devices, entering, machine, network, probe};
use lcm::url::{Shm, Udpm, Url};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::Path;
use std::time::Duration;

/// Everything about the bus at a URL.
pub fn check(text: &str) -> Vec<Finding> {
    match Url::parse(text) {
        Err(error) => {
            let why = "No module starts without a bus.";
            vec![Finding::fail("LCM URL", error.to_string()).why(why).cure("unset LCM_DEFAULT_URL   # or --lcm-url")]
        }
        Ok((Url::Udpm(url), _)) => multicast(&url),
        Ok((Url::Tcpq(hub), _)) => vec![bus::hub(hub, &probe::connect(hub))],
        Ok((other, _)) => vec![bus::alone(&other)],
    }
}

/// Network of the machine as the checks of UDP multicast see it.
struct Network<'a> {
    url: &'a Udpm,
    /// The loopback interface.
    lo: Option<&'a Interface>,
    /// A bus without other users, in the group of the URL.
    free: SocketAddrV4,
    /// The interface that the routing table chooses.
    routed: Option<&'a Interface>,
    /// The interface that the URL names.
    chosen: Option<&'a Interface>,
}

/// Everything about UDP multicast.
fn multicast(url: &Udpm) -> Vec<Finding> {
    let interfaces = network::interfaces();
    // Before there are sockets of ours.
    let listeners = network::listeners(url.address());
    let overflows = network::counter("/proc/net/snmp", "Udp", "RcvbufErrors").unwrap_or(0);
    let lo = interfaces.iter().find(|interface| interface.loopback);

    let mut findings = vec![bus::loopback(lo)];
    let net = match Network::gather(url, &interfaces, lo) {
        Ok(net) => net,
        Err(finding) => {
            findings.extend(finding);
            return findings;
        }
    };
    let joined = probe::join_bus(url);
    findings.push(bus::route(url, net.routed, net.chosen));
    findings.push(net.self_test(&joined));
    findings.extend(net.official(&listeners));
    findings.push(net.outgoing());
    findings.extend(bus::incoming(url, &entering::prove()));
    findings.extend(joined.ok().and_then(|(_, granted)| net.buffer(granted)));
    findings.extend(bus::memberships(network::sysctl("net.ipv4.igmp_max_memberships")));
    findings.extend(bus::reverse_path(url, net.ours(), &interfaces));
    findings.push(buffer::listeners(&listeners, overflows));
    findings.extend(bus::shm(url.shm != Shm::Off, gather_shm()));
    findings
}

impl<'a> Network<'a> {
    /// Finds a free bus and the interfaces. `Err` if nothing can be probed, without a finding if the loopback's finding
    /// says why.
    fn gather(url: &'a Udpm, interfaces: &'a [Interface], lo: Option<&'a Interface>) -> Result<Self, Option<Finding>> {
        let free = probe::free_bus(url.group).map_err(|error| {
            let why = "Nothing can be sent, and nothing is heard.";
            Finding::fail("sockets", error).why(why).cure("ulimit -n; cat /proc/net/sockstat")
        })?;
        if !interfaces.iter().any(|interface| interface.up) {
            return Err(None);
        }
        let with = |address: Ipv4Addr| interfaces.iter().find(|interface| interface.addresses.contains(&address));
        let routed = probe::route(free, with, lo);
        let chosen = url.interface.as_ref().map(|choice| bus::choice(choice, interfaces)).transpose()?;
        Ok(Self { url, lo, free, routed, chosen })
    }

    /// Interface that our LCM uses.
    fn ours(&self) -> Option<&'a Interface> {
        self.chosen.or(self.routed).or(self.lo)
    }

    /// Address of that interface.
    fn address(&self) -> Ipv4Addr {
        self.ours().and_then(probe::address).unwrap_or(Ipv4Addr::LOCALHOST)
    }

    fn trip(&self, way: String, from: Ipv4Addr, to: &[Ipv4Addr]) -> Trip {
        probe::trip(way, self.free, from, to)
    }

    /// Datagrams of our own, on the bus's interface and on the loopback.
    fn self_test(&self, joined: &Result<(Duration, usize), String>) -> Finding {
        let mut own = vec![self.trip("on lo".into(), Ipv4Addr::LOCALHOST, &[Ipv4Addr::LOCALHOST])];
        if let Some(ours) = self.ours().filter(|ours| !ours.loopback) {
            own.insert(0, self.trip(format!("on {}", ours.name), self.address(), &[self.address()]));
        }
        let nft = devices::executable("nft") || Path::new("/usr/sbin/nft").exists();
        bus::self_test(self.url, joined, &own, nft)
    }

    /// Datagrams to and from programs with the official LCM, which follow the routing table.
    fn official(&self, listeners: &[Listener]) -> Option<Finding> {
        let routed = self.routed?;
        let astray = !routed.loopback && !listeners.is_empty() && !network::joined(routed, self.url.group);
        let (any, on) = (Ipv4Addr::UNSPECIFIED, self.address());
        let trips = [
            self.trip("from the official LCM to ours".into(), any, &[on, Ipv4Addr::LOCALHOST]),
            self.trip("from ours to the official LCM".into(), on, &[any]),
            self.trip("over lo to the official LCM".into(), Ipv4Addr::LOCALHOST, &[any]),
        ];
        Some(bus::official(self.url, &trips, astray.then_some(routed)))
    }

    /// Datagrams that leave the machine.
    fn outgoing(&self) -> Finding {
        let control = probe::outgoing(self.free, Ipv4Addr::LOCALHOST);
        bus::outgoing(self.url, self.ours(), &probe::outgoing(self.free, self.address()), &control)
    }

    /// The receive buffer, of which the kernel has granted `granted` bytes.
    fn buffer(&self, granted: usize) -> Option<Finding> {
        let taken = |len| probe::buffer_taken(self.free, self.address(), len).ok();
        Some(buffer::buffer(&buffer::Buffer {
            asked: self.url.recv_buf_size,
            granted,
            taken: (taken(buffer::HEAVY_SIZE)?, taken(buffer::DATAGRAM)?),
            max: network::sysctl("net.core.rmem_max"),
        }))
    }
}

fn gather_shm() -> Option<bus::Shm> {
    use nix::sys::statfs::{TMPFS_MAGIC, statfs};
    let path = Path::new("/dev/shm");
    let memory = statfs(path).ok()?.filesystem_type() == TMPFS_MAGIC;
    let machine::Folder { writable, free, .. } = machine::Folder::gather(path);
    Some(bus::Shm { writable, memory, free })
}
