//! The LCM bus: what is gathered for which check of [`bus`] and [`buffer`], in the order of the report.

use super::finding::Finding;
use super::{buffer, bus, devices, machine, network, probe};
use lcm::url::{Shm, Udpm, Url};
use std::net::Ipv4Addr;
use std::path::Path;

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

/// Everything about UDP multicast.
fn multicast(url: &Udpm) -> Vec<Finding> {
    let interfaces = network::interfaces();
    let with = |address: Ipv4Addr| interfaces.iter().find(|interface| interface.addresses.contains(&address));
    // Before there are sockets of ours.
    let listeners = network::listeners(url.address());
    let overflows = network::counter("/proc/net/snmp", "Udp", "RcvbufErrors").unwrap_or(0);
    let lo = interfaces.iter().find(|interface| interface.loopback);

    let mut findings = vec![bus::loopback(lo)];
    let free = match probe::free_bus(url.group) {
        Ok(free) if interfaces.iter().any(|interface| interface.up) => free,
        Ok(_) => return findings,
        Err(error) => {
            let why = "Nothing can be sent, and nothing is heard.";
            findings.push(Finding::fail("sockets", error).why(why).cure("ulimit -n; cat /proc/net/sockstat"));
            return findings;
        }
    };
    let routed = probe::route(free, with, lo);
    let astray = routed.filter(|by| !by.loopback && !listeners.is_empty() && !network::joined(by, url.group));
    let chosen = match url.interface.as_ref().map(|choice| bus::choice(choice, &interfaces)).transpose() {
        Ok(chosen) => chosen,
        Err(finding) => {
            findings.push(finding);
            return findings;
        }
    };
    let ours = chosen.or(routed).or(lo);
    findings.push(bus::route(url, routed, chosen));
    let on = ours.and_then(probe::address).unwrap_or(Ipv4Addr::LOCALHOST);
    let trip = |way: String, from, to: &[Ipv4Addr]| probe::trip(way, free, from, to);
    let mut own = vec![trip("on lo".into(), Ipv4Addr::LOCALHOST, &[Ipv4Addr::LOCALHOST])];
    if let Some(ours) = ours.filter(|ours| !ours.loopback) {
        own.insert(0, trip(format!("on {}", ours.name), on, &[on]));
    }
    let nft = devices::executable("nft") || Path::new("/usr/sbin/nft").exists();
    let joined = probe::join_bus(url);
    findings.push(bus::self_test(url, &joined, &own, nft));
    if routed.is_some() {
        let any = Ipv4Addr::UNSPECIFIED;
        let both = [on, Ipv4Addr::LOCALHOST];
        findings.push(bus::official(
            url,
            &[
                trip("from the official LCM to ours".into(), any, &both),
                trip("from ours to the official LCM".into(), on, &[any]),
                trip("over lo to the official LCM".into(), Ipv4Addr::LOCALHOST, &[any]),
            ],
            astray,
        ));
    }
    let control = probe::outgoing(free, Ipv4Addr::LOCALHOST);
    findings.push(bus::outgoing(url, ours, &probe::outgoing(free, on), &control));
    let taken = |len| probe::buffer_taken(free, on, len);
    if let (Ok((_, granted)), Ok(heavy), Ok(large)) = (joined, taken(buffer::HEAVY_SIZE), taken(buffer::DATAGRAM)) {
        let max = network::sysctl("net.core.rmem_max");
        findings.push(buffer::buffer(&buffer::Buffer {
            asked: url.recv_buf_size,
            granted,
            max,
            taken: (heavy, large),
        }));
    }
    findings.extend(bus::memberships(network::sysctl("net.ipv4.igmp_max_memberships")));
    findings.extend(bus::reverse_path(url, ours, &interfaces));
    findings.push(buffer::listeners(&listeners, overflows));
    findings.extend(bus::shm(url.shm == Shm::Auto, gather_shm()));
    findings
}

fn gather_shm() -> Option<bus::Shm> {
    use nix::sys::statfs::{TMPFS_MAGIC, statfs};
    let path = Path::new("/dev/shm");
    let memory = statfs(path).ok()?.filesystem_type() == TMPFS_MAGIC;
    let machine::Folder { writable, free, .. } = machine::Folder::gather(path);
    Some(bus::Shm { writable, memory, free })
}
