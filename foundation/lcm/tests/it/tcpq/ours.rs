//! Our client and our hub.

use super::{PATIENCE, Relay, payload, receive, settle};
use lcm::live::{Hub, Lcm, PublishError};
use lcm::subscription::Queue;
use lcm::tcpq::hub::{Limits, Overflow};
use lcm::url::Url;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, TcpStream};
use std::os::fd::{AsFd, AsRawFd};
use std::time::{Duration, Instant};

#[test]
fn two_clients_hear_each_other_and_themselves() {
    let relay = Relay::start(Limits::default());
    let (mut one, mut other) = (relay.client(), relay.client());
    one.subscribe("TO_ONE|ALL").unwrap();
    other.subscribe("TO_OTHER").unwrap();
    other.subscribe("A.*").unwrap();
    settle(&mut one, "TO_ONE");
    settle(&mut other, "TO_OTHER");
    for size in [0, 1, 65_535, 65_536, 10 << 20] {
        one.publish("TO_OTHER", &payload(size)).unwrap();
        // What the kernel did not take at once goes out while we receive.
        let (sender, receiver) = (&mut one, &mut other);
        let got = std::thread::scope(|scope| {
            let got = scope.spawn(|| receive(receiver));
            while !got.is_finished() {
                sender.recv_timeout(Duration::from_millis(10)).unwrap();
            }
            got.join().unwrap()
        });
        assert!(got == ("TO_OTHER".into(), payload(size)), "{size}");
    }
    other.publish("ALL", b"both").unwrap();
    assert_eq!(receive(&mut one), ("ALL".into(), b"both".to_vec()));
    assert_eq!(receive(&mut other), ("ALL".into(), b"both".to_vec()));
    assert_eq!((one.stats().sent, one.stats().received, one.stats().malformed), (6, 2, 0));
    drop(one);
    settle(&mut other, "TO_OTHER");
    let (stats, events) = relay.end();
    assert_eq!((stats.published, stats.delivered, stats.dropped, stats.malformed), (9, 10, 0, 0));
    assert!(events[2].ends_with("gone; 6 messages from it, 2 to it, 0 dropped"), "{events:?}");
}

#[test]
fn what_is_unsubscribed_no_longer_comes_but_an_equal_subscription_goes_on() {
    let relay = Relay::start(Limits::default());
    let mut lcm = relay.client();
    lcm.subscribe("MARK").unwrap();
    let ids = [lcm.subscribe("A").unwrap(), lcm.subscribe("A").unwrap()];
    for (left, id) in ids.into_iter().enumerate().rev() {
        settle(&mut lcm, "A");
        assert!(lcm.unsubscribe(id) && !lcm.unsubscribe(id));
        lcm.publish("A", b"").unwrap();
        lcm.publish("MARK", b"").unwrap();
        let came = if left > 0 { "A" } else { "MARK" };
        assert_eq!(receive(&mut lcm).0, came);
        if left > 0 {
            assert_eq!(receive(&mut lcm).0, "MARK");
        }
    }
    assert_eq!(lcm.stats().unwanted, 0, "the hub was told");
}

/// An address at which nobody listens now.
fn nowhere() -> SocketAddrV4 {
    let hub = Hub::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    match hub.address().unwrap() {
        SocketAddr::V4(address) => address,
        SocketAddr::V6(_) => panic!("an IPv4 address"),
    }
}

#[test]
fn a_client_finds_its_hub_whenever_it_comes_and_comes_again() {
    let address = nowhere();
    let mut lcm = Lcm::new(&Url::Tcpq(address)).unwrap();
    let descriptor = lcm.as_fd().as_raw_fd();
    lcm.subscribe("A").unwrap();
    match lcm.publish("A", b"lost") {
        Err(PublishError::Io(error)) => assert_eq!(error.kind(), ErrorKind::NotConnected, "{error}"),
        other => panic!("{other:?}"),
    }
    assert_eq!((lcm.stats().send_refused, lcm.stats().sent), (1, 0));
    for life in 0..3 {
        let relay = Relay::start_at(address, Limits::default());
        settle(&mut lcm, "A");
        assert!(lcm.tcpq().unwrap().is_connected());
        drop(relay);
        let until = Instant::now() + PATIENCE;
        while lcm.tcpq().unwrap().is_connected() {
            assert!(lcm.wait(PATIENCE).unwrap(), "life {life}: the end of the connection is something to do");
            assert_eq!(lcm.recv().unwrap(), None);
            assert!(Instant::now() < until);
        }
    }
    assert_eq!(lcm.as_fd().as_raw_fd(), descriptor);
}

#[test]
fn a_client_without_a_hub_sleeps_between_its_tries() {
    let mut lcm = Lcm::new(&Url::Tcpq(nowhere())).unwrap();
    let (start, mut woken) = (Instant::now(), 0);
    while start.elapsed() < Duration::from_millis(400) {
        woken += u32::from(lcm.wait(Duration::from_millis(50)).unwrap());
        assert_eq!(lcm.recv().unwrap(), None);
    }
    // Tries at about 0, 50, 150 and 350 ms, each of which is refused at once or a wake-up later.
    assert!(woken <= 10, "{woken}");
}

#[test]
fn a_client_that_takes_nothing_stalls_a_hub_that_waits_for_a_moment_only() {
    let relay = Relay::start(Limits { queue: 64 << 10, overflow: Overflow::Wait, ..Limits::default() });
    let (mut asleep, mut other) = (relay.client(), relay.client());
    asleep.subscribe("A").unwrap();
    settle(&mut asleep, "A");
    other.subscribe("END").unwrap();
    settle(&mut other, "END");
    let message = payload(1 << 20);
    let until = Instant::now() + PATIENCE;
    // More than all buffers on the way hold: the last ones are taken after the one who sleeps was cut off.
    let mut publish = |channel: &str, payload: &[u8]| {
        while let Err(error) = other.publish(channel, payload) {
            assert!(matches!(error, PublishError::Busy), "{error:?}");
            assert!(Instant::now() < until, "the hub waits for ever");
            other.wait(Duration::from_millis(10)).unwrap();
        }
    };
    for _ in 0..100 {
        publish("A", &message);
    }
    publish("END", b"");
    assert_eq!(receive(&mut other).0, "END");
    let (stats, events) = relay.end();
    assert_eq!(stats.dropped, 0);
    assert!(
        events.iter().any(|event| event.ends_with("took nothing for 4 s, and all others waited for it")),
        "{events:?}"
    );
}

#[test]
fn one_who_only_publishes_stays_connected() {
    let relay = Relay::start(Limits::default());
    let mut lcm = relay.client();
    let until = Instant::now() + PATIENCE;
    while !lcm.tcpq().unwrap().is_connected() {
        let _ = lcm.publish("A", b"");
        assert!(Instant::now() < until);
        std::thread::yield_now();
    }
}

#[test]
fn limits_of_subscriptions_hold_here_too() {
    let relay = Relay::start(Limits::default());
    let mut lcm = relay.client();
    let newest = lcm.subscribe_with("NEWEST", Queue::Newest(2)).unwrap();
    let oldest = lcm.subscribe_with("OLDEST", Queue::Oldest(2)).unwrap();
    lcm.subscribe_with("LAST_.*", Queue::Last).unwrap();
    settle(&mut lcm, "LAST_0");
    for n in 0..5u8 {
        for channel in ["NEWEST", "OLDEST", "LAST_1", "LAST_2"] {
            lcm.publish(channel, &[n]).unwrap();
        }
    }
    lcm.publish("LAST_END", b"").unwrap();
    // All of it has to be here before the first is taken.
    let mut other = relay.client();
    other.subscribe("LAST_END").unwrap();
    settle(&mut other, "LAST_END");
    assert_eq!(
        receive_until_settled(&mut lcm),
        ["OLDEST 0", "OLDEST 1", "NEWEST 3", "NEWEST 4", "LAST_1 4", "LAST_2 4"]
    );
    assert_eq!([lcm.dropped(newest), lcm.dropped(oldest)], [Some(3), Some(3)]);
}

/// What comes before the end: one that another client sent after all of it was relayed.
fn receive_until_settled(lcm: &mut Lcm) -> Vec<String> {
    let mut received = Vec::new();
    loop {
        match receive(lcm) {
            (channel, _) if channel == "LAST_END" => return received,
            (channel, payload) => received.push(format!("{channel} {}", payload[0])),
        }
    }
}

#[test]
fn a_client_that_does_not_read_stalls_nobody() {
    let relay = Relay::start(Limits { queue: 1 << 20, ..Limits::default() });
    let mut slow = TcpStream::connect(relay.address).unwrap();
    slow.write_all(&[&lcm::tcpq::hello(lcm::tcpq::Peer::Client)[..], &lcm::tcpq::subscribe("A")].concat()).unwrap();
    // Its hello is there: the hub serves it.
    slow.read_exact(&mut [0; 8]).unwrap();
    let mut fast = relay.client();
    fast.subscribe("A").unwrap();
    settle(&mut fast, "A");
    let large = payload(64 << 10);
    for _ in 0..400 {
        fast.publish("A", &large).unwrap();
        assert!(receive(&mut fast) == ("A".into(), large.clone()));
    }
    assert_eq!(fast.stats().received, 401);
    let (stats, _) = relay.end();
    assert!(stats.dropped > 0 && stats.dropped < 401, "{stats:?}");
    // It gets whole messages: what waited, less the hub's part of the queue, which ended with the hub.
    let mut stream = lcm::tcpq::Decoder::new(lcm::tcpq::Peer::Hub, 1 << 20);
    stream.push(&lcm::tcpq::hello(lcm::tcpq::Peer::Hub));
    let mut bytes = Vec::new();
    let _ = slow.read_to_end(&mut bytes);
    stream.push(&bytes);
    let mut whole = 0;
    while let Some(message) = stream.next_message().unwrap() {
        if let lcm::tcpq::Message::Publish { payload, .. } = message {
            assert!(payload == large || payload == b"settle");
            whole += 1;
        }
    }
    assert!(whole > 0, "{whole}");
}

#[test]
fn a_hub_that_reads_nothing_blocks_no_publisher_and_costs_a_fixed_amount() {
    let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let SocketAddr::V4(address) = listener.local_addr().unwrap() else { panic!("an IPv4 address") };
    let mut lcm = Lcm::new(&Url::Tcpq(address)).unwrap();
    let _connection = listener.accept().unwrap();
    let large = payload(64 << 10);
    let refused = (0..100_000).find_map(|_| lcm.publish("A", &large).err());
    assert!(matches!(refused, Some(PublishError::Busy)), "{refused:?}");
    let sent = lcm.stats().sent;
    assert!(sent > 0);
    assert!(matches!(lcm.publish("A", &large), Err(PublishError::Busy)));
    assert_eq!((lcm.stats().sent, lcm.stats().send_refused), (sent, 2));
}
