//! Which interfaces the bus uses, proven on the wire: two hosts, two cables, a capture at the far end.
#![cfg(feature = "live")]
#![allow(clippy::disallowed_methods, reason = "real sockets in real time")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::common;
use crate::hosts::{Host, on_a_host};
use lcm::live::Lcm;
use lcm::origin::Origin;
use lcm::url::{Interface, Udpm};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::AsFd;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(5);

/// This host's ends of both cables, and the other's.
const ENDS: [(&str, &str); 2] = [("eth7", "10.1.2.1"), ("eth9", "10.1.3.1")];
const FAR_ENDS: [(&str, &str); 2] = [("eth8", "10.1.2.2"), ("eth10", "10.1.3.2")];

/// Two hosts with two cables between them; both have their default route by the first.
fn two_cables(here: &Host) -> Host {
    let there = Host::new();
    for (end, far_end) in ENDS.into_iter().zip(FAR_ENDS) {
        here.cable(end, &there, far_end);
    }
    here.ip("route add default dev eth7");
    there.ip("route add default dev eth8");
    there
}

fn subscribed(url: &Udpm) -> Lcm {
    let mut lcm = Lcm::new(&url.clone().into()).unwrap();
    lcm.subscribe(".*").unwrap();
    lcm
}

/// The next message.
fn next(lcm: &mut Lcm) -> Option<Vec<u8>> {
    loop {
        if let Some(received) = lcm.recv().unwrap() {
            return Some(received.payload.into());
        }
        if !lcm.wait(PATIENCE).unwrap() {
            return None;
        }
    }
}

#[track_caller]
fn expect(lcm: &mut Lcm, payload: &[u8]) {
    let got = next(lcm).expect("a message");
    assert_eq!(String::from_utf8_lossy(&got), String::from_utf8_lossy(payload));
}

/// The index of an interface of `host`.
fn index(host: &Host, name: &str) -> usize {
    host.run(|| nix::net::if_::if_nametoindex(name).unwrap() as usize)
}

/// One of them says something that both hear.
fn say(speaker: &mut Lcm, listener: &mut Lcm, what: &str) {
    speaker.publish("A", what.as_bytes()).unwrap_or_else(|error| panic!("{what}: {error}"));
    expect(speaker, what.as_bytes());
    expect(listener, what.as_bytes());
}

#[test]
fn with_ttl_0_nothing_leaves_whatever_becomes_of_the_interfaces() {
    on_a_host("with_ttl_0_nothing_leaves_whatever_becomes_of_the_interfaces", |here| {
        let there = two_cables(&here);
        let url = common::url();
        let wire = there.tap();
        let on_the_wire = |up: &[&str]| here.seen(up, &wire, url.group);

        // That the capture can see what leaves.
        assert_eq!(on_the_wire(&["eth7", "eth9"]), []);
        let mut loud = Lcm::new(&Udpm { ttl: 1, ..url.clone() }.into()).unwrap();
        loud.publish("A", b"loud").unwrap();
        let both: &[&str] = &["eth7", "eth9"];
        let seen: Vec<_> = on_the_wire(both).into_iter().map(|seen| (seen.by, seen.ttl)).collect();
        assert_eq!(seen, [(index(&there, "eth8"), 1)]);
        drop(loud);

        let (mut old, mut listener) = (subscribed(&url), subscribed(&url));
        let changes: [(&[&str], &[&str]); 8] = [
            (&[], both),
            (&["link set eth7 down"], &["eth9"]),
            (&["link set eth7 up", "route add default dev eth7"], both),
            (&["route replace default dev eth9"], both),
            (&["route del default"], both),
            (&["addr del 10.1.2.1/24 dev eth7", "addr add 10.1.2.1/24 dev eth9"], both),
            (&["addr flush dev eth9"], both),
            (&["link del eth7"], &["eth9"]),
        ];
        for (commands, up) in changes {
            commands.iter().for_each(|command| here.ip(command));
            let what = format!("after {commands:?}");
            assert_eq!(on_the_wire(up), [], "seen at the far end at once {what}");
            say(&mut old, &mut listener, &what);
            say(&mut listener, &mut old, &what);
            // Who starts after the change.
            let mut new = subscribed(&url);
            new.publish("A", what.as_bytes()).unwrap();
            for lcm in [&mut new, &mut old, &mut listener] {
                expect(lcm, what.as_bytes());
            }
            say(&mut old, &mut listener, &what);
            expect(&mut new, what.as_bytes());
            assert_eq!(on_the_wire(up), [], "seen at the far end {what}");
        }
    });
}

/// A datagram of another host, by each of its cables, with a TTL that would carry it far.
fn shout(there: &Host, url: &Udpm, channel: &str, payload: &[u8]) {
    there.run(|| {
        for (_, address) in FAR_ENDS {
            let socket = UdpSocket::bind(SocketAddrV4::new(address.parse().unwrap(), 0)).unwrap();
            socket.set_multicast_ttl_v4(32).unwrap();
            for datagram in datagrams(channel, payload) {
                socket.send_to(&datagram, url.address()).unwrap();
            }
        }
    });
}

/// A message as one datagram, and as fragments.
fn datagrams(channel: &str, payload: &[u8]) -> Vec<Vec<u8>> {
    let small = [b"LC02\0\0\0\0", channel.as_bytes(), b"\0", payload].concat();
    let large = [payload, &vec![0; 70_000]].concat();
    let message = lcm::udpm::Message::new(1, channel, &large, 9000).unwrap();
    let fragment = |number| {
        let (header, rest) = message.datagram(number);
        [&header[..], rest].concat()
    };
    [vec![small], (0..message.count()).map(fragment).collect()].concat()
}

#[test]
fn with_ttl_0_nothing_enters_by_patterns_or_by_names() {
    on_a_host("with_ttl_0_nothing_enters_by_patterns_or_by_names", |here| {
        let there = two_cables(&here);
        let url = common::url();
        let by_names = |url: &Udpm| {
            let mut lcm = Lcm::new(&url.clone().into()).unwrap();
            lcm.subscribe("A").unwrap();
            assert!(lcm.udpm().unwrap().filtered());
            lcm
        };
        let changed = |url: &Udpm| {
            let mut lcm = by_names(url);
            let all = lcm.subscribe(".*").unwrap();
            assert!(!lcm.udpm().unwrap().filtered());
            assert!(lcm.unsubscribe(all) && lcm.udpm().unwrap().filtered());
            let id = lcm.subscribe("B.*").unwrap();
            assert!(lcm.dropped(id).is_some() && !lcm.udpm().unwrap().filtered());
            lcm
        };
        let mut ours = [subscribed(&url), by_names(&url), changed(&url)];
        // That what is sent from there arrives where it may.
        let open = Udpm { ttl: 1, ..url.clone() };
        let mut controls = [subscribed(&open), by_names(&open)];
        shout(&there, &url, "A", b"from there");
        for lcm in &mut controls {
            assert!(!lcm.udpm().unwrap().is_local());
            let received = loop {
                if let Some(received) = lcm.recv().unwrap() {
                    break (received.payload.to_vec(), received.origin);
                }
                assert!(lcm.wait(PATIENCE).unwrap(), "the cables are plugged in");
            };
            assert_eq!(received, (b"from there".to_vec(), Origin::Network));
        }
        // Datagrams of this host by the routed interface, by the other one and by `lo`, after those from there.
        for (name, address) in ENDS.into_iter().chain([("lo", "127.0.0.1")]) {
            let interface = Interface::Address(address.parse().unwrap());
            let mut speaker = Lcm::new(&Udpm { interface: Some(interface), ..url.clone() }.into()).unwrap();
            speaker.publish("A", name.as_bytes()).unwrap();
            for lcm in &mut ours {
                assert!(lcm.udpm().unwrap().is_local());
                let received = loop {
                    if let Some(received) = lcm.recv().unwrap() {
                        break (String::from_utf8_lossy(received.payload).into_owned(), received.origin);
                    }
                    assert!(lcm.wait(PATIENCE).unwrap(), "{name}");
                };
                assert_eq!(received, (name.to_string(), Origin::Host(None)));
            }
        }
        for lcm in &mut ours {
            assert!(lcm.recv().unwrap().is_none());
            assert_eq!((lcm.stats().received, lcm.stats().incomplete, lcm.stats().kernel_dropped), (3, 0, 0));
        }
    });
}

#[test]
fn the_url_chooses_the_interface() {
    on_a_host("the_url_chooses_the_interface", |here| {
        let there = two_cables(&here);
        let default = Udpm { ttl: 1, ..common::url() };
        let by_name = Udpm { interface: Some(Interface::Name("eth9".into())), ..default.clone() };
        let by_address = Udpm { interface: Some(Interface::Address(Ipv4Addr::new(10, 1, 3, 1))), ..default.clone() };
        let wire = there.tap();
        for (url, (near, far)) in
            [(&default, ("eth7", "eth8")), (&by_name, ("eth9", "eth10")), (&by_address, ("eth9", "eth10"))]
        {
            // Alone: what others joined is heard, too.
            here.seen(&["eth7", "eth9"], &wire, url.group);
            let mut lcm = subscribed(url);
            lcm.publish("A", b"from here").unwrap();
            expect(&mut lcm, b"from here");
            let seen = here.seen(&["eth7", "eth9"], &wire, url.group);
            let ours = seen.iter().filter(|seen| seen.payload.ends_with(b"from here"));
            let seen: Vec<usize> = ours.map(|seen| seen.by).collect();
            assert_eq!(seen, [index(&there, far)], "{url}");

            // From there by both cables; the wanted one last.
            let mut ends: Vec<_> = ENDS.into_iter().zip(FAR_ENDS).collect();
            ends.sort_by_key(|((name, _), _)| *name == near);
            there.run(|| {
                for (_, (name, address)) in ends {
                    let socket = UdpSocket::bind(SocketAddrV4::new(address.parse().unwrap(), 0)).unwrap();
                    socket.set_multicast_ttl_v4(1).unwrap();
                    let datagram = [b"LC02\0\0\0\0A\0", name.as_bytes()].concat();
                    socket.send_to(&datagram, url.address()).unwrap();
                }
            });
            expect(&mut lcm, far.as_bytes());
        }
    });
}

#[test]
fn programs_with_different_interfaces_hear_each_other_on_one_host() {
    on_a_host("programs_with_different_interfaces_hear_each_other_on_one_host", |here| {
        let _there = two_cables(&here);
        let url = common::url();
        let on = |name: &str| Udpm { interface: Some(Interface::Name(name.into())), ..url.clone() };
        let mut all = [url.clone(), on("eth7"), on("eth9"), on("lo")].map(|url| subscribed(&url));
        for speaker in 0..all.len() {
            let what = [b'0' + speaker as u8];
            all[speaker].publish("A", &what).unwrap();
            for lcm in &mut all {
                expect(lcm, &what);
            }
        }
    });
}

#[test]
fn an_interface_that_is_not_there_is_named() {
    let name = Interface::Name("nosuch0".into());
    let error = Lcm::new(&Udpm { interface: Some(name), ..common::url() }.into()).unwrap_err().to_string();
    assert!(error.contains("nosuch0") && !error.contains('\n'), "{error}");
    // TEST-NET-1 (RFC 5737): no host has it.
    let address = Interface::Address(Ipv4Addr::new(192, 0, 2, 254));
    let error = Lcm::new(&Udpm { interface: Some(address), ..common::url() }.into()).unwrap_err().to_string();
    assert!(error.contains("192.0.2.254") && !error.contains('\n'), "{error}");
}

#[test]
fn lo_needs_no_multicast_flag() {
    on_a_host("lo_needs_no_multicast_flag", |here| {
        let url = common::url();
        for flag in ["off", "on"] {
            here.ip(&format!("link set lo multicast {flag}"));
            let (mut a, mut b) = (subscribed(&url), subscribed(&url));
            say(&mut a, &mut b, flag);
        }
    });
}

#[test]
fn a_hub_or_a_client_beyond_a_cable_that_was_pulled_is_given_up() {
    on_a_host("a_hub_or_a_client_beyond_a_cable_that_was_pulled_is_given_up", |here| {
        let there = two_cables(&here);
        let mut hub = there.run(|| lcm::live::Hub::bind("10.1.2.2:0".parse().unwrap()).unwrap());
        let (url, _) = lcm::Url::parse(&format!("tcpq://{}", hub.address().unwrap())).unwrap();
        let mut lcm = Lcm::new(&url).unwrap();
        lcm.subscribe(".*").unwrap();
        let deadline = std::time::Instant::now() + 12 * PATIENCE;
        let mut until = |wanted: (bool, usize)| loop {
            hub.serve_once().unwrap();
            lcm.recv().unwrap();
            let found = (lcm.tcpq().unwrap().is_connected(), hub.stats().clients);
            if found == wanted {
                return;
            }
            assert!(std::time::Instant::now() < deadline, "{found:?}");
            let fds = [lcm.as_fd(), hub.as_fd()];
            let mut fds = fds.map(|fd| nix::poll::PollFd::new(fd, nix::poll::PollFlags::POLLIN));
            nix::poll::poll(&mut fds, 1000_u16).unwrap();
        };
        until((true, 1));
        // Neither end says anything, and nothing comes back.
        there.ip("link set eth8 down");
        until((false, 0));
    });
}
