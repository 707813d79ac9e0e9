//! The live transport on this host's real sockets. Each test has a group and port of its own, TTL 0.
#![cfg(feature = "live")]
#![allow(clippy::disallowed_methods, reason = "real sockets in real time")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::common;
use lcm::live::SelfTest;
use lcm::live::{Lcm, PublishError, RealtimeNanos, SubscribeError};
use lcm::subscription::Queue;
use lcm::udpm::{DecodeError, EncodeError};
use lcm::url::Udpm;
use nix::sys::resource::{Resource, setrlimit};
use std::net::UdpSocket;
use std::os::fd::{AsFd, AsRawFd};
use std::process::Command;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Long enough for a loaded machine; on a healthy one nothing waits that long.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long to listen for what must not come.
const SILENCE: Duration = Duration::from_millis(100);

fn subscribed(url: &Udpm, pattern: &str) -> Lcm {
    let mut lcm = Lcm::new(&url.clone().into()).unwrap();
    lcm.subscribe(pattern).unwrap();
    lcm
}

/// The next message; `None` when none comes within `patience`.
fn next(lcm: &mut Lcm, patience: Duration) -> Option<(String, Vec<u8>, RealtimeNanos)> {
    loop {
        if let Some(received) = lcm.recv().unwrap() {
            return Some((received.channel.into(), received.payload.into(), received.at));
        }
        if !lcm.wait(patience).unwrap() {
            return None;
        }
    }
}

fn expect(lcm: &mut Lcm, channel: &str, payload: &[u8]) {
    let (got_channel, got_payload, _) = next(lcm, PATIENCE).expect("a message");
    assert_eq!(got_channel, channel);
    assert!(got_payload == payload, "{} bytes, not {}", got_payload.len(), payload.len());
}

fn now() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as i64
}

/// A plain socket that sends to the group whatever it is told.
fn stranger(url: &Udpm) -> UdpSocket {
    let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
    socket.set_multicast_ttl_v4(0).unwrap();
    socket.connect(url.address()).unwrap();
    socket
}

#[test]
fn a_message_goes_there_and_back() {
    let url = common::url();
    let (mut a, mut b) = (subscribed(&url, "PONG"), subscribed(&url, "PING"));
    for size in [0, 1, 1000, 65_494] {
        let payload: Vec<u8> = (0..size).map(|i| i as u8).collect();
        a.publish("PING", &payload).unwrap();
        expect(&mut b, "PING", &payload);
        b.publish("PONG", &payload).unwrap();
        expect(&mut a, "PONG", &payload);
    }
    assert_eq!((a.stats().sent, a.stats().received, a.stats().lost), (4, 4, 0));
    assert!(a.udpm().unwrap().filtered());
    assert_eq!(a.stats().unwanted, 0, "its own messages, which it did not subscribe to, stay in the kernel");
}

#[test]
fn a_datagram_is_received_once_on_whatever_interfaces_we_joined() {
    for ttl in [0, 1] {
        let url = Udpm { ttl, ..common::url() };
        let mut lcm = subscribed(&url, "A");
        lcm.subscribe(".*").unwrap();
        for number in 0..10 {
            lcm.publish("A", &[number]).unwrap();
        }
        for number in 0..10 {
            expect(&mut lcm, "A", &[number]);
        }
        assert_eq!(next(&mut lcm, SILENCE), None);
        if ttl == 0 && std::env::var_os(NO_ROUTE).is_none() {
            break; // a TTL of 1 would leave this host
        }
    }
}

#[test]
fn a_process_hears_its_own_messages_once_it_subscribes() {
    let url = common::url();
    let mut lcm = Lcm::new(&url.clone().into()).unwrap();
    let watched = lcm.as_fd().as_raw_fd();
    lcm.publish("A", b"before").unwrap();
    assert!(!lcm.wait(SILENCE).unwrap(), "nothing joined the group yet");
    let id = lcm.subscribe("A").unwrap();
    assert_eq!(lcm.as_fd().as_raw_fd(), watched, "an event loop may watch it from the start");
    lcm.publish("A", b"after").unwrap();
    expect(&mut lcm, "A", b"after");
    assert!(lcm.unsubscribe(id));
    lcm.publish("A", b"unheard").unwrap();
    assert_eq!(next(&mut lcm, SILENCE), None);
}

#[test]
fn a_pattern_subscribes_to_all_channels_it_matches_as_a_whole() {
    let url = common::url();
    let mut listener = subscribed(&url, "LL_DATA_.*|CM_CMD_STATE");
    let mut publisher = Lcm::new(&url.clone().into()).unwrap();
    for channel in ["LL_DATA_ODO", "XLL_DATA_ODO", "CM_CMD_STATE", "CM_CMD_STATE2", "LL_DATA_"] {
        publisher.publish(channel, channel.as_bytes()).unwrap();
    }
    for channel in ["LL_DATA_ODO", "CM_CMD_STATE", "LL_DATA_"] {
        expect(&mut listener, channel, channel.as_bytes());
    }
    assert_eq!(next(&mut listener, SILENCE), None);
    assert_eq!(listener.stats().unwanted, 2);
    assert!(matches!(listener.subscribe("("), Err(SubscribeError::Pattern(_))));
}

#[test]
fn garbage_is_counted_and_survived() {
    let url = common::url();
    let mut lcm = subscribed(&url, ".*");
    let stranger = stranger(&url);
    for garbage in [&b""[..], b"LC02", b"LC09\0\0\0\0A\0", b"LC02\0\0\0\0ABC", b"LC02\0\0\0\0\xff\xff\0", &[0; 65_507]]
    {
        stranger.send(garbage).unwrap();
    }
    lcm.publish("A", b"still here").unwrap();
    expect(&mut lcm, "A", b"still here");
    let stats = lcm.stats();
    assert_eq!((stats.malformed, stats.received), (6, 1));
    let rejected = stats.last_rejected.unwrap();
    assert_eq!(rejected.why, DecodeError::Magic(0));
    assert_eq!(rejected.from.port(), stranger.local_addr().unwrap().port());
    stranger.send(b"LC02\0\0\0\0").unwrap();
    assert_eq!(next(&mut lcm, SILENCE), None);
    assert_eq!(lcm.stats().last_rejected.unwrap().why, DecodeError::ChannelUnterminated);
}

#[test]
fn what_is_not_lcms_is_counted_behind_the_kernels_filter_too() {
    let url = common::url();
    let mut lcm = subscribed(&url, "A");
    assert!(lcm.udpm().unwrap().filtered());
    let stranger = stranger(&url);
    for garbage in [&b""[..], b"LC02", b"LC09\0\0\0\0A\0", b"LC02\0\0\0\0", &[0; 65_507]] {
        stranger.send(garbage).unwrap();
    }
    lcm.publish("A", b"still here").unwrap();
    expect(&mut lcm, "A", b"still here");
    assert_eq!((lcm.stats().malformed, lcm.stats().received), (5, 1));
}

#[test]
fn the_kernel_keeps_unwanted_channels_away() {
    let url = common::url();
    let (mut lcm, mut publisher) = (subscribed(&url, "WANTED"), Lcm::new(&url.clone().into()).unwrap());
    lcm.subscribe("WANTED_TOO").unwrap();
    for channel in ["UNWANTED", "WANTED", "WANTED_", "WANTE", "WANTED_TOO", "WANTED_TOO2"] {
        for size in [0, 1, 1000] {
            publisher.publish(channel, &vec![7; size]).unwrap();
        }
    }
    for channel in ["WANTED", "WANTED_TOO"] {
        for size in [0, 1, 1000] {
            expect(&mut lcm, channel, &vec![7; size]);
        }
    }
    assert_eq!(next(&mut lcm, SILENCE), None);
    // Those that the filter dropped are in the kernel's counter, and are not lost.
    assert_eq!((lcm.stats().unwanted, lcm.stats().lost, lcm.stats().kernel_dropped), (0, 0, 0));
    let all = lcm.subscribe(".*").unwrap();
    assert!(!lcm.udpm().unwrap().filtered());
    publisher.publish("UNWANTED", b"now").unwrap();
    expect(&mut lcm, "UNWANTED", b"now");
    assert!(lcm.unsubscribe(all) && lcm.udpm().unwrap().filtered());
    publisher.publish("UNWANTED", b"no more").unwrap();
    assert_eq!(next(&mut lcm, SILENCE), None);
}

#[test]
fn large_messages_come_whole() {
    let url = Udpm { recv_buf_size: 32 << 20, ..common::url() };
    let (mut a, mut b) = (subscribed(&url, "PONG"), subscribed(&url, ".*"));
    for size in [65_494, 65_495, 65_536, 100_000, 1_000_000, 10_000_000] {
        let payload: Vec<u8> = (0..size).map(|i| (7 * i + (i >> 8)) as u8).collect();
        a.publish("PING", &payload).unwrap();
        expect(&mut b, "PING", &payload);
        b.publish("PONG", &payload).unwrap();
        expect(&mut a, "PONG", &payload);
        expect(&mut b, "PONG", &payload);
    }
    for lcm in [&a, &b] {
        assert_eq!((lcm.stats().lost, lcm.stats().incomplete), (0, 0));
    }
    // Our own large messages are not even received where they are not wanted.
    assert_eq!((a.stats().received, a.stats().unwanted), (6, 0));
    a.subscribe("PING").unwrap();
    let payload = vec![1; 200_000];
    a.publish("PING", &payload).unwrap();
    expect(&mut a, "PING", &payload);
}

#[test]
fn a_subscriptions_limit_is_kept_and_what_it_cost_is_counted() {
    let url = common::url();
    let mut publisher = Lcm::new(&url.clone().into()).unwrap();
    let mut lcm = Lcm::new(&url.clone().into()).unwrap();
    let last = lcm.subscribe_with("STATE", Queue::Last).unwrap();
    let first = lcm.subscribe_with("EVENT.*", Queue::Oldest(2)).unwrap();
    let newest = lcm.subscribe_with("DATA", Queue::Newest(2)).unwrap();
    for number in 0..5 {
        for channel in ["STATE", "EVENT_A", "DATA", "OTHER"] {
            publisher.publish(channel, &[number]).unwrap();
        }
    }
    let mut got = Vec::new();
    while let Some((channel, payload, _)) = next(&mut lcm, SILENCE) {
        got.push(format!("{channel} {}", payload[0]));
    }
    assert_eq!(got, ["EVENT_A 0", "EVENT_A 1", "DATA 3", "STATE 4", "DATA 4"]);
    assert_eq!([last, first, newest].map(|id| lcm.dropped(id)), [Some(4), Some(3), Some(3)]);
    assert_eq!(lcm.stats().queue_dropped, 10);
    publisher.publish("EVENT_A", b"x").unwrap();
    assert_eq!(lcm.recv_timeout(PATIENCE).unwrap().map(|message| message.channel.to_owned()), Some("EVENT_A".into()));
}

#[test]
fn waiting_for_a_message_ends_when_it_comes_or_the_time_is_over() {
    let url = common::url();
    let (mut lcm, mut publisher) = (subscribed(&url, "A|B"), Lcm::new(&url.clone().into()).unwrap());
    assert_eq!(lcm.recv_timeout(SILENCE).unwrap(), None);
    publisher.publish("UNWANTED", b"").unwrap();
    publisher.publish("B", b"x").unwrap();
    assert_eq!(lcm.recv_timeout(PATIENCE).unwrap().unwrap().payload, b"x");
    publisher.publish("UNWANTED", b"").unwrap();
    assert_eq!(lcm.recv_timeout(SILENCE).unwrap(), None);
    assert_eq!(lcm.recv_timeout(Duration::ZERO).unwrap(), None);
}

#[test]
fn a_subscriber_hears_itself_once_and_nobody_else_is_bothered() {
    let url = common::url();
    let mut listener = subscribed(&url, ".*");
    let mut official = Lcm::new(&url.clone().into()).unwrap();
    official.subscribe("LCM_SELF_TEST").unwrap();
    assert_eq!(listener.udpm().unwrap().self_test(), SelfTest::Waiting);
    expect(&mut official, "LCM_SELF_TEST", b"lcm self test");
    assert_eq!(next(&mut listener, SILENCE), None, "`.*` is every channel of the users");
    assert_eq!(listener.udpm().unwrap().self_test(), SelfTest::Passed);
    assert_eq!((listener.stats().sent, listener.stats().lost), (0, 0));
}

#[test]
fn a_flood_that_nobody_wants_does_not_hold_the_caller() {
    let url = common::url();
    let mut lcm = subscribed(&url, "WANTED|ALSO"); // an expression, which the kernel cannot filter
    for _ in 0..100 {
        lcm.publish("UNWANTED", b"").unwrap();
    }
    lcm.publish("WANTED", b"").unwrap();
    assert!(lcm.wait(PATIENCE).unwrap());
    assert_eq!(lcm.recv().unwrap(), None, "it gave up for now");
    assert!(lcm.wait(Duration::ZERO).unwrap(), "and is still readable");
    expect(&mut lcm, "WANTED", b"");
}

#[test]
fn every_message_has_the_time_the_kernel_received_it() {
    let url = common::url();
    let mut lcm = subscribed(&url, "A");
    let before = now();
    for number in 0..100 {
        lcm.publish("A", &[number]).unwrap();
    }
    let after = now();
    std::thread::sleep(SILENCE);
    let times: Vec<i64> = (0..100).map(|_| next(&mut lcm, PATIENCE).unwrap().2.0).collect();
    assert!(times.is_sorted());
    // Not when we came to read it. A millisecond for clocks that tick coarsely.
    assert!(times[0] >= before - 1_000_000 && times[99] <= after + 1_000_000, "{before} {times:?} {after}");
}

fn overflow(pattern: &str, filtered: bool) {
    let url = Udpm { recv_buf_size: 4096, ..common::url() };
    let mut lcm = subscribed(&url, pattern);
    assert_eq!(lcm.udpm().unwrap().filtered(), filtered);
    assert_eq!(lcm.udpm().unwrap().granted_recv_buf_size().unwrap(), 4096);
    let mut publisher = Lcm::new(&url.clone().into()).unwrap();
    let rounds = [200_u8, 1];
    for messages in rounds {
        for number in 0..messages {
            publisher.publish("A", &[number; 100]).unwrap();
        }
        while next(&mut lcm, SILENCE).is_some() {}
    }
    // The kernel tells with the next datagram that found room.
    let stats = *lcm.stats();
    assert!(stats.kernel_dropped > 0 && stats.received > 0, "{stats:?}");
    assert_eq!(stats.kernel_dropped + stats.received, 201);
    assert!(filtered || stats.lost == stats.kernel_dropped);
}

#[test]
fn an_overflow_of_the_receive_buffer_is_counted() {
    overflow("A|B", false);
}

/// Of a large buffer the kernel's count of drops is looked at only where the buffer may be full.
#[test]
fn an_overflow_of_a_large_buffer_is_counted_after_many_messages_that_the_filter_drops() {
    let url = Udpm { recv_buf_size: 1 << 20, ..common::url() };
    let mut lcm = subscribed(&url, "A");
    assert!(lcm.udpm().unwrap().filtered());
    let mut publisher = Lcm::new(&url.clone().into()).unwrap();
    let mut sent = 0;
    for number in 0..3000_u32 {
        publisher.publish("B", &[0; 100]).unwrap();
        publisher.publish("A", &[0; 100]).unwrap();
        sent += 1;
        if number % 100 == 99 {
            (0..100).for_each(|_| assert!(next(&mut lcm, PATIENCE).is_some()));
        }
    }
    assert_eq!((lcm.stats().received, lcm.stats().kernel_dropped), (sent, 0));
    for burst in [10_000, 1] {
        for _ in 0..burst {
            publisher.publish("A", &[0; 100]).unwrap();
            sent += 1;
        }
        while next(&mut lcm, SILENCE).is_some() {}
    }
    let stats = *lcm.stats();
    assert!(stats.kernel_dropped > 0, "{stats:?}");
    assert_eq!(stats.kernel_dropped + stats.received, sent);
}

#[test]
fn an_overflow_is_told_from_what_the_kernels_filter_drops() {
    overflow("A", true);
}

#[test]
fn what_cannot_be_sent_is_refused_and_takes_no_number() {
    let url = common::url();
    let mut lcm = subscribed(&url, ".*");
    lcm.publish("A", b"1").unwrap();
    let too_long = lcm.publish("A", &vec![0; (1 << 28) + 1]).unwrap_err();
    assert!(matches!(too_long, PublishError::Encode(EncodeError::MessageTooLong { len: 268_435_457, .. })));
    assert_eq!(
        lcm.publish(&"C".repeat(64), b"").unwrap_err().to_string(),
        "LCM publish: a channel name of 64 bytes; at most 63"
    );
    lcm.publish("A", b"2").unwrap();
    expect(&mut lcm, "A", b"1");
    expect(&mut lcm, "A", b"2");
    assert_eq!((lcm.stats().lost, lcm.stats().sent), (0, 2));
}

/// Set in a copy of this program that runs in a network name space of its own.
const NO_ROUTE: &str = "LCM_TEST_NO_ROUTE";

/// Runs `body` in a network name space prepared by the shell commands `prepare`; skips where that is not permitted.
fn in_name_space(test: &str, prepare: &str, body: impl FnOnce()) {
    if std::env::var_os(NO_ROUTE).is_some() {
        return body();
    }
    let may = Command::new("unshare").args(["-rn", "sh", "-c", prepare]).output();
    let permitted = may.is_ok_and(|output| output.status.success());
    let found = if permitted { Ok(()) } else { Err(format!("no network name space with `{prepare}`")) };
    if testing::peer_or_skip(testing::tool("ip", "-V")).is_none() || testing::machine_or_skip(found).is_none() {
        return;
    }
    let this = std::env::current_exe().unwrap();
    let command = format!("{prepare} && exec '{}' {test}", this.display());
    let mut child = Command::new("unshare");
    child.args(["-rn", "sh", "-c", &command]).env(NO_ROUTE, "1");
    let output = child.output().unwrap();
    let out = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && out.contains("1 passed"), "{out}");
}

#[test]
fn without_a_route_the_bus_is_on_loopback() {
    in_name_space("without_a_route_the_bus_is_on_loopback", "ip link set lo up", || {
        let url = common::url();
        let (mut a, mut b) = (Lcm::new(&url.clone().into()).unwrap(), subscribed(&url, "A"));
        assert!(a.udpm().unwrap().on_loopback());
        a.publish("A", b"x").unwrap();
        expect(&mut b, "A", b"x");
        a_datagram_is_received_once_on_whatever_interfaces_we_joined();
    });
}

#[test]
fn without_any_interface_the_error_says_so() {
    in_name_space("without_any_interface_the_error_says_so", "true", || {
        let error = Lcm::new(&common::url().into()).unwrap_err().to_string();
        assert!(error.starts_with("cannot "), "{error}");
    });
}

/// Runs the `ip` command.
fn ip(arguments: &str) {
    let status = Command::new("ip").args(arguments.split(' ')).status();
    assert!(status.unwrap().success(), "ip {arguments}");
}

#[test]
fn when_an_interface_comes_later_old_and_new_hear_each_other() {
    let prepare = "ip link set lo up && ip link add eth7 type veth peer name eth8";
    in_name_space("when_an_interface_comes_later_old_and_new_hear_each_other", prepare, || {
        let url = common::url();
        let mut old = subscribed(&url, "A");
        for command in
            ["addr add 10.1.2.3/24 dev eth7", "link set eth7 up", "link set eth8 up", "route add default via 10.1.2.1"]
        {
            ip(command);
        }
        // First a pure publisher: no receive socket has joined on its interface.
        let mut publisher = Lcm::new(&url.clone().into()).unwrap();
        assert!(old.udpm().unwrap().on_loopback() && !publisher.udpm().unwrap().on_loopback());
        publisher.publish("A", b"new").unwrap();
        expect(&mut old, "A", b"new");
        let mut new = subscribed(&url, "A");
        old.publish("A", b"old").unwrap();
        expect(&mut new, "A", b"old");
    });
}

#[test]
fn when_the_interface_goes_the_bus_goes_on() {
    let prepare = "ip link set lo up && ip link add eth7 type veth peer name eth8 && ip addr add 10.1.2.3/24 dev eth7 \
                   && ip link set eth7 up && ip link set eth8 up && ip route add default via 10.1.2.1";
    in_name_space("when_the_interface_goes_the_bus_goes_on", prepare, || {
        let url = common::url();
        let (mut a, mut b) = (Lcm::new(&url.clone().into()).unwrap(), subscribed(&url, "A"));
        a.publish("A", b"routed").unwrap();
        expect(&mut b, "A", b"routed");
        ip("route del default");
        a.publish("A", b"route lost").unwrap();
        expect(&mut b, "A", b"route lost");
        assert!(!a.udpm().unwrap().on_loopback());
        // Who starts now sends on lo and is heard by all, and hears all.
        let mut late = subscribed(&url, "A");
        late.publish("A", b"late").unwrap();
        expect(&mut b, "A", b"late");
        expect(&mut late, "A", b"late");
        a.publish("A", b"to late").unwrap();
        expect(&mut late, "A", b"to late");
        expect(&mut b, "A", b"to late");
        ip("addr del 10.1.2.3/24 dev eth7");
        a.publish("A", b"address lost").unwrap();
        expect(&mut b, "A", b"address lost");
        ip("link del eth7");
        a.publish("A", b"interface lost").unwrap();
        expect(&mut b, "A", b"interface lost");
        assert!(a.udpm().unwrap().on_loopback());
        assert_eq!(next(&mut b, SILENCE), None);
        assert_eq!(b.stats().lost, 0);
    });
}

/// Set in a copy of this program that may not use more data than [`DATA_MAX`].
const LIMITED: &str = "ADVEE_TEST_DATA_LIMITED";
/// Limit of a process with `memory_max`, bytes: less than the message that is announced.
const DATA_MAX: u64 = 64 << 20;

#[test]
fn a_far_fragment_of_an_announced_message_does_not_end_a_process_of_limited_memory() {
    if std::env::var_os(LIMITED).is_none() {
        let name = "live::a_far_fragment_of_an_announced_message_does_not_end_a_process_of_limited_memory";
        let mut child = Command::new(std::env::current_exe().unwrap());
        let output = child.args([name, "--exact", "--nocapture"]).env(LIMITED, "1").output().unwrap();
        let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success() && out.contains("1 passed"), "{}: {out}{err}", output.status);
        return;
    }
    setrlimit(Resource::RLIMIT_DATA, DATA_MAX, DATA_MAX).unwrap();
    assert!(Vec::<u8>::new().try_reserve_exact(1 << 28).is_err(), "the limit does not hold");
    let url = common::url();
    let (mut lcm, stranger) = (subscribed(&url, ".*"), stranger(&url));
    // The second of two fragments: the last bytes of a message of 256 MiB.
    let (magic, sequence, size) = (0x4c43_3033_u32, 4242_u32, 1_u32 << 28);
    for sequence in sequence..sequence + 100 {
        let words = [magic, sequence, size, size - 10].map(u32::to_be_bytes).concat();
        let fragment = [words, [1_u16, 2].map(u16::to_be_bytes).concat(), vec![0; 8]].concat();
        stranger.send(&fragment).unwrap();
    }
    // It goes on: by one datagram, and by a message of several.
    for payload in [vec![1; 100], vec![2; 1 << 20]] {
        lcm.publish("A", &payload).unwrap();
        expect(&mut lcm, "A", &payload);
    }
}
