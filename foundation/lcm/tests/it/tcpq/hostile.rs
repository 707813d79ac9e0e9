//! Ends that mean no good.

use super::{PATIENCE, Relay, receive, settle};
use lcm::live::Lcm;
use lcm::tcpq::hub::Limits;
use lcm::tcpq::{Peer, hello, publish_header, subscribe};
use lcm::url::Url;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

/// Sends the hub what it likes, until it is closed or has sent all; what it was told.
fn attack(relay: &Relay, what: &[u8], times: usize) -> bool {
    let mut stream = TcpStream::connect(relay.address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    for _ in 0..times {
        if stream.write_all(what).is_err() {
            return true;
        }
    }
    // Closed with bytes unread is a reset.
    let mut rest = Vec::new();
    match stream.read_to_end(&mut rest) {
        Ok(_) => true,
        Err(error) => error.kind() == std::io::ErrorKind::ConnectionReset,
    }
}

#[test]
fn whoever_sends_nonsense_is_closed_and_the_others_are_served() {
    let relay = Relay::start(Limits { message: 1 << 20, ..Limits::default() });
    let mut good = relay.client();
    good.subscribe("GOOD").unwrap();
    settle(&mut good, "GOOD");
    assert!(attack(&relay, &[0xa5; 65_536], 1000), "endless garbage");
    assert!(attack(&relay, b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n", 1));
    assert!(attack(&relay, &[&hello(Peer::Client)[..], &[0, 0, 0, 1, 0xff, 0xff, 0xff, 0xff]].concat(), 1));
    assert!(attack(&relay, &publish_header("A", (1 << 20) + 1), 1));
    assert!(attack(&relay, &publish_header("A", u32::MAX as usize), 1));
    settle(&mut good, "GOOD");
    let (stats, events) = relay.end();
    assert_eq!((stats.malformed, stats.clients), (5, 1));
    assert!(events.iter().any(|event| event.ends_with("closed: 0xa5a5a5a5 where a message must begin")), "{events:?}");
    assert!(events.iter().any(|event| event.ends_with("closed: a message of 4294967295 bytes; at most 1048576")));
}

#[test]
fn bytes_that_come_one_by_one_are_messages_in_the_end() {
    let relay = Relay::start(Limits::default());
    let mut lcm = relay.client();
    lcm.subscribe("SLOW").unwrap();
    settle(&mut lcm, "SLOW");
    let mut stream = TcpStream::connect(relay.address).unwrap();
    stream.set_nodelay(true).unwrap();
    let bytes = [&hello(Peer::Client)[..], &subscribe("X"), &publish_header("SLOW", 3), b"now"].concat();
    let (last, bytes) = bytes.split_last().unwrap();
    for byte in bytes {
        stream.write_all(&[*byte]).unwrap();
        // So that each is read alone.
        settle(&mut lcm, "SLOW");
    }
    stream.write_all(&[*last]).unwrap();
    assert_eq!(receive(&mut lcm), ("SLOW".into(), b"now".to_vec()));
}

#[test]
fn one_connection_too_many_is_closed_at_once() {
    let relay = Relay::start(Limits { clients: 2, ..Limits::default() });
    let mut lcm = relay.client();
    lcm.subscribe("A").unwrap();
    settle(&mut lcm, "A");
    let mut second = TcpStream::connect(relay.address).unwrap();
    second.read_exact(&mut [0; 8]).unwrap();
    let mut third = TcpStream::connect(relay.address).unwrap();
    third.set_read_timeout(Some(PATIENCE)).unwrap();
    assert_eq!(third.read(&mut [0; 8]).unwrap(), 0);
    // When the relay has closed its end, the place is free.
    second.shutdown(Shutdown::Write).unwrap();
    second.set_read_timeout(Some(PATIENCE)).unwrap();
    assert_eq!(second.read(&mut [0; 8]).unwrap(), 0);
    let mut fourth = TcpStream::connect(relay.address).unwrap();
    fourth.read_exact(&mut [0; 8]).unwrap();
    let (stats, _) = relay.end();
    assert_eq!((stats.accepted, stats.refused), (3, 1));
}

#[test]
fn a_storm_of_connections_that_say_nothing_leaves_nothing_behind() {
    let relay = Relay::start(Limits::default());
    for _ in 0..500 {
        let mut stream = TcpStream::connect(relay.address).unwrap();
        stream.read_exact(&mut [0; 8]).unwrap();
    }
    let mut lcm = relay.client();
    lcm.subscribe("A").unwrap();
    settle(&mut lcm, "A");
    // The last of them may not have gone when the message came.
    let (stats, _) = relay.end();
    assert!(stats.accepted == 501 && stats.clients <= 2, "{stats:?}");
}

/// A hub that sends what it likes to each client, of which there are `lives`; then a good one.
fn survives(what: &[u8], lives: u64) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let SocketAddr::V4(address) = listener.local_addr().unwrap() else { panic!("an IPv4 address") };
    let what = what.to_vec();
    let bad = std::thread::spawn(move || {
        for _ in 0..lives {
            let (mut stream, _) = listener.accept().unwrap();
            while stream.write_all(&what).is_ok() {}
        }
    });
    let mut lcm = Lcm::new(&Url::Tcpq(address)).unwrap();
    lcm.subscribe(".*").unwrap();
    while !bad.is_finished() {
        assert_eq!(lcm.recv_timeout(Duration::from_millis(20)).unwrap(), None);
    }
    bad.join().unwrap();
    assert!(lcm.stats().malformed >= lives, "{:?}", lcm.stats());
    let relay = Relay::start_at(address, Limits::default());
    settle(&mut lcm, "A");
    drop(relay);
}

#[test]
fn a_hub_that_is_none_is_left_and_tried_again_later() {
    survives(b"220 mail.example ESMTP\r\n", 2);
}

#[test]
fn a_hub_that_sends_nonsense_after_its_hello_is_left_too() {
    survives(&[&hello(Peer::Hub)[..], &[0, 0, 0, 1, 0, 0, 0, 1, b'A', 0xff, 0xff, 0xff, 0xff]].concat(), 1);
    survives(&[&hello(Peer::Hub)[..], &subscribe("A")].concat(), 1);
}
