//! The LCM bus over UDP multicast. Every check is a function of the results of `network` and `probe`.

use super::entering::{Incoming, Unproven};
use super::finding::{Finding, bytes};
use super::network::Interface;
use super::probe::{Outgoing, Trip};
use lcm::url::{Interface as Choice, Udpm, Url};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

/// A bus that is a hub.
pub fn hub(hub: SocketAddrV4, connected: &Result<Duration, String>) -> Finding {
    match connected {
        Ok(after) => Finding::ok("hub", format!("{hub} answers after {:.2} ms", after.as_secs_f64() * 1e3)),
        Err(error) => Finding::fail("hub", format!("{hub}: {error}"))
            .why("No module starts without its bus.")
            .cure(format!("ss -ltnp 'sport = :{}'", hub.port())),
    }
}

/// A bus that ends at one process.
pub fn alone(url: &Url) -> Finding {
    Finding::fail("LCM URL", format!("{url} joins no processes"))
        .why("A robot is many processes: its bus is udpm:// or tcpq://.")
        .cure("unset LCM_DEFAULT_URL   # or --lcm-url")
}

/// Loopback interface.
pub fn loopback(lo: Option<&Interface>) -> Finding {
    let why = "Without a network, or when its cable is pulled, the robot's modules talk over lo.";
    let down = |what| Finding::fail("loopback", what).why(why);
    match lo {
        None => down("there is no loopback interface"),
        Some(lo) if !lo.up => down("lo is down").cure(format!("sudo ip link set {} up", lo.name)),
        Some(lo) if !lo.addresses.contains(&Ipv4Addr::LOCALHOST) => {
            down("lo has no address 127.0.0.1").cure(format!("sudo ip address add 127.0.0.1/8 dev {}", lo.name))
        }
        // Linux sends and receives multicast on lo without the flag; LCM's manual describes older kernels.
        Some(lo) => Finding::ok("loopback", format!("{} is up, MTU {}", lo.name, lo.mtu)),
    }
}

/// The interface that the URL names.
pub fn choice<'a>(choice: &Choice, interfaces: &'a [Interface]) -> Result<&'a Interface, Finding> {
    let (name, found) = match choice {
        Choice::Name(name) => (name.clone(), interfaces.iter().find(|interface| interface.name == *name)),
        Choice::Address(address) => {
            (address.to_string(), interfaces.iter().find(|interface| interface.addresses.contains(address)))
        }
    };
    let why = "The LCM URL names it: no module joins the bus without it.";
    match found {
        None => {
            Err(Finding::fail("interface", format!("there is no interface {name}")).why(why).cure("ip -br address"))
        }
        Some(interface) if !interface.up => Err(Finding::fail("interface", format!("{} is down", interface.name))
            .why(why)
            .cure(format!("sudo ip link set {} up", interface.name))),
        Some(interface) if interface.addresses.is_empty() => {
            Err(Finding::fail("interface", format!("{} has no IPv4 address", interface.name))
                .why(why)
                .cure(format!("sudo ip address add 10.0.0.1/24 dev {}", interface.name)))
        }
        Some(interface) => Ok(interface),
    }
}

/// Interface of datagrams to the group: ours, and those of programs on the official LCM, which always uses the routing
/// table.
pub fn route(url: &Udpm, routed: Option<&Interface>, chosen: Option<&Interface>) -> Finding {
    let named = |interface: &Interface| {
        let address = interface.addresses.first().map_or("no address".into(), ToString::to_string);
        format!("{} ({address}, MTU {})", interface.name, interface.mtu)
    };
    let by_route = |interface: &Interface| Finding::ok("route", format!("{} leads to {}", named(interface), url.group));
    match (chosen, routed) {
        (None, Some(routed)) if !routed.loopback && !routed.multicast => {
            Finding::warning("route", format!("{} leads to {} but does no multicast", routed.name, url.group))
                .why("Programs of other hosts are not heard there.")
                .cure(format!("sudo ip link set {} multicast on", routed.name))
        }
        (None, Some(routed)) => by_route(routed),
        (Some(chosen), Some(routed)) if chosen.index == routed.index => by_route(routed),
        (Some(chosen), Some(routed)) => Finding::warning(
            "route",
            format!("ours go by {}, as the URL says; the official LCM's by {}", named(chosen), routed.name),
        )
        .why("Programs on the official LCM ask the routing table. Other hosts hear either these or ours.")
        .cure(format!("sudo ip route add {}/32 dev {}", url.group, chosen.name)),
        (_, None) => {
            let ours = chosen.map_or("lo src 127.0.0.1", |chosen| &chosen.name);
            let alone = chosen.map_or("lo", |chosen| &chosen.name);
            Finding::warning("route", format!("none to {}: the bus is on {alone} alone", url.group))
                .why("The robot works so. Programs on the official LCM do not start without a route.")
                .cure(format!("sudo ip route add {}/32 dev {ours}", url.group))
        }
    }
}

/// Datagrams sent were received, interface by interface.
pub fn self_test(url: &Udpm, joined: &Result<(Duration, usize), String>, trips: &[Trip], nft: bool) -> Finding {
    let why = "Modules do not hear each other: a firewall, a socket limit or a broken interface is in the way.";
    let group = url.group;
    let cure = match nft {
        true => {
            format!("sudo nft insert rule inet filter input ip daddr {group} accept   # see: sudo nft list ruleset")
        }
        false => format!("sudo iptables -I INPUT -d {group} -j ACCEPT   # see: sudo iptables -S"),
    };
    let silent = trips.iter().find_map(|trip| trip.heard.as_ref().err().map(|error| (&trip.way, error)));
    match (joined, silent) {
        (Err(error), _) => Finding::fail("self test", format!("{url}: {error}")).why(why).cure(cure),
        (Ok(_), Some((way, error))) => Finding::fail("self test", format!("{way}: {error}")).why(why).cure(cure),
        (Ok((after, _)), None) => {
            let ways: Vec<&str> = trips.iter().map(|trip| trip.way.as_str()).collect();
            let took = after.as_secs_f64() * 1e3;
            Finding::ok("self test", format!("heard {} and on the bus itself, in {took:.2} ms", ways.join(", ")))
        }
    }
}

/// Programs on the official LCM, which join and send by the routing table, and ours receive each other. `astray`: the
/// interface of the routing table, if programs run and none of them has joined there.
pub fn official(url: &Udpm, trips: &[Trip], astray: Option<&Interface>) -> Finding {
    if let Some(interface) = astray {
        return Finding::warning(
            "official LCM",
            format!("{} leads to the group, no program joined there", interface.name),
        )
        .why(
            "The route has changed since they started. What programs on the official LCM send goes out there now, \
                 with a TTL of 0 too (Linux looks at it only where someone has joined). Start them anew.",
        )
        .cure(format!("sudo tcpdump -ni {} -Q out host {}", interface.name, url.group));
    }
    match trips.iter().find_map(|trip| trip.heard.as_ref().err().map(|error| (&trip.way, error))) {
        None => Finding::ok("official LCM", "its programs and ours hear each other, over lo too (IP_MULTICAST_ALL)"),
        Some((way, error)) => Finding::warning("official LCM", format!("{way}: {error}"))
            .why("Programs on the official LCM and ours do not hear each other.")
            .cure(format!("ip route get {}   # and compare with interface= in the LCM URL", url.group)),
    }
}

/// With TTL 0 nothing leaves this host. `control` was sent on `lo`, where the kernel's count must show it.
pub fn outgoing(
    url: &Udpm,
    by: Option<&Interface>,
    out: &Result<Outgoing, String>,
    control: &Result<Outgoing, String>,
) -> Finding {
    const CHECK: &str = "stays here";
    let unproven = |what: String| {
        Finding::warning(CHECK, format!("not proven: {what}"))
            .why("With TTL 0 no datagram should leave this host; seen on the wire it is certain.")
            .cure(format!("sudo tcpdump -ni any -Q out host {}", url.group))
    };
    let name = by.map_or("lo", |by| &by.name);
    match (url.ttl, by, out, control) {
        (1.., Some(by), _, _) if !by.loopback => {
            Finding::warning(CHECK, format!("no: TTL {} sends every message out on {}", url.ttl, by.name))
                .why("As the URL asks. Whoever is on that network can command the robot: LCM knows no passwords.")
                .cure("unset LCM_DEFAULT_URL   # or --lcm-url with ttl=0")
        }
        (_, None, _, _) => Finding::ok(CHECK, "the bus is on lo"),
        (_, Some(by), _, _) if by.loopback => Finding::ok(CHECK, "the bus is on lo"),
        (_, _, Err(error), _) | (_, _, _, Err(error)) => unproven(error.clone()),
        (_, _, Ok(out), _) if out.ttl != 0 => unproven(format!("the kernel made TTL 0 a TTL of {}", out.ttl)),
        (_, _, _, Ok(control)) if control.left < u64::from(control.sent) => {
            unproven("the kernel's count of multicast datagrams does not count".into())
        }
        (_, _, Ok(out), _) if out.left >= u64::from(out.sent) => Finding::fail(
            CHECK,
            format!("no: {} datagrams with TTL 0 went out on {name} when {} were sent", out.left, out.sent),
        )
        .why("The robot's bus, motion commands included, is seen on that network.")
        .cure(format!("sudo ip route add {}/32 dev lo", url.group)),
        // All or nothing: the few that were counted are other programs' (IGMP's own, mDNS).
        (_, _, Ok(out), Ok(control)) => Finding::ok(
            CHECK,
            format!(
                "TTL 0: none of {} datagrams left by {name} (control on lo: {} of {})",
                out.sent,
                control.left.min(control.sent.into()),
                control.sent
            ),
        ),
    }
}

/// With TTL 0 nothing from another computer enters.
pub fn incoming(url: &Udpm, proof: &Result<Incoming, Unproven>) -> Option<Finding> {
    const CHECK: &str = "nothing enters";
    let cure = "zgrep CONFIG_NET /proc/config.gz; sysctl net.core.optmem_max";
    let finding = match proof {
        _ if url.ttl > 0 => return None,
        Err(Unproven::NoFilter(why)) => Finding::fail(CHECK, why.clone())
            .why("Any computer of the network could command the robot, so no module starts.")
            .cure(cure),
        Err(Unproven::NoNetwork(why)) => {
            Finding::ok(CHECK, format!("a socket filter drops what comes from other computers (not tried here: {why})"))
        }
        Ok(Incoming { sent, control, .. }) if control < sent => Finding::ok(
            CHECK,
            format!(
                "a socket filter drops what comes from other computers \
                 (not proven: {control} of {sent} came without it)"
            ),
        ),
        Ok(Incoming { sent, passed: 0, .. }) => Finding::ok(
            CHECK,
            format!(
                "none of {sent} datagrams of another computer passed the socket filter (control without it: {sent})"
            ),
        ),
        Ok(Incoming { sent, passed, .. }) => {
            Finding::fail(CHECK, format!("{passed} of {sent} datagrams of another computer passed the socket filter"))
                .why("Any computer of the network can command the robot.")
                .cure(cure)
        }
    };
    Some(finding)
}

/// `net.ipv4.igmp_max_memberships`: a socket joins on the interface and on `lo`.
pub fn memberships(max: Option<u64>) -> Option<Finding> {
    const NEEDED: u64 = 2;
    let max = max.filter(|max| *max < NEEDED)?;
    Some(
        Finding::fail("memberships", format!("a socket may join {max} groups, it needs {NEEDED}"))
            .why("Modules cannot join the bus on the network's interface and on lo.")
            .cure("sudo sysctl -w net.ipv4.igmp_max_memberships=20"),
    )
}

/// Strict reverse path filtering drops datagrams of hosts that are reached by another interface.
pub fn reverse_path(url: &Udpm, by: Option<&Interface>, interfaces: &[Interface]) -> Option<Finding> {
    let by = by.filter(|by| url.ttl > 0 && by.rp_filter == 1)?;
    let others = interfaces.iter().filter(|other| other.up && !other.loopback && !other.addresses.is_empty());
    (others.count() > 1).then(|| {
        Finding::warning("rp_filter", format!("strict on {}, and there are other networks", by.name))
            .why("Messages of a host that the routing table has on another interface are dropped without a word.")
            .cure(format!("sudo sysctl -w net.ipv4.conf.{0}.rp_filter=2 net.ipv4.conf.all.rp_filter=2", by.name))
    })
}

/// Folder of shared memory.
#[derive(Clone, Copy, Debug)]
pub struct Shm {
    pub writable: bool,
    /// A file system in memory.
    pub memory: bool,
    pub free: u64,
}

/// `shm=auto` needs `/dev/shm`.
pub fn shm(wanted: bool, shm: Option<Shm>) -> Option<Finding> {
    const CHECK: &str = "shared memory";
    /// A publisher takes up to 1 MiB (facts/lcm.md C4); 16 of them.
    const NEEDED: u64 = 16 << 20;
    let bad = |what: String, cure: &str| {
        let why = "The URL says shm=auto; without it messages go as datagrams, at three times the time.";
        Some(Finding::warning(CHECK, what).why(why).cure(cure))
    };
    match shm {
        _ if !wanted => None,
        None => bad("there is no /dev/shm".into(), "sudo mkdir -p /dev/shm && sudo mount -t tmpfs tmpfs /dev/shm"),
        Some(shm) if !shm.writable => bad("/dev/shm is not writable".into(), "sudo chmod 1777 /dev/shm"),
        Some(shm) if !shm.memory => {
            bad("/dev/shm is not in memory but on a disk".into(), "sudo mount -t tmpfs tmpfs /dev/shm")
        }
        Some(shm) if shm.free < NEEDED => {
            bad(format!("/dev/shm has {} left", bytes(shm.free)), "sudo mount -o remount,size=64M /dev/shm")
        }
        Some(shm) => Some(Finding::ok(CHECK, format!("/dev/shm, {} free", bytes(shm.free)))),
    }
}
