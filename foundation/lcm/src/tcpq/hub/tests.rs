use super::*;
use crate::tcpq::{TEXT_MAX, publish_header, subscribe, unsubscribe};

/// A hub with clients `0..clients`, which have said hello and been greeted.
fn hub(clients: u64, limits: Limits) -> Hub {
    let mut hub = Hub::new(limits);
    for client in 0..clients {
        assert_eq!(hub.connect(), Some(ClientId(client)));
        send(&mut hub, client, &hello(Peer::Client));
        assert_eq!(take(&mut hub, client), ["Hello { version: 256 }"]);
    }
    hub
}

fn send(hub: &mut Hub, client: u64, bytes: &[u8]) {
    hub.handle_rx(ClientId(client), bytes).unwrap();
}

fn publish(hub: &mut Hub, client: u64, channel: &str, payload: &str) {
    send(hub, client, &[&publish_header(channel, payload.len()), payload.as_bytes()].concat());
}

/// Takes all that waits for a client: `A text` is a message on channel A.
fn take(hub: &mut Hub, client: u64) -> Vec<String> {
    let waiting = hub.poll_tx(ClientId(client)).collect::<Vec<_>>().concat();
    hub.handle_tx(ClientId(client), waiting.len());
    assert_eq!(hub.poll_tx(ClientId(client)).count(), 0);
    let mut stream = Decoder::new(Peer::Hub, usize::MAX);
    let greeted = waiting.starts_with(&hello(Peer::Hub));
    if !greeted {
        stream.push(&hello(Peer::Hub));
        stream.next_message().unwrap();
    }
    stream.push(&waiting);
    let mut said = Vec::new();
    while let Some(message) = stream.next_message().unwrap() {
        said.push(match message {
            Message::Publish { channel, payload, .. } => format!("{channel} {}", str::from_utf8(payload).unwrap()),
            other => format!("{other:?}"),
        });
    }
    said
}

#[test]
fn a_message_goes_once_to_everyone_who_wants_it_and_back_too() {
    let mut hub = hub(4, Limits::default());
    send(&mut hub, 0, &subscribe("LL_.*"));
    send(&mut hub, 1, &[subscribe("LL_.*"), subscribe("LL_A"), subscribe(".*")].concat());
    send(&mut hub, 2, &subscribe("LL"));
    while hub.poll_pending().is_some() {}
    publish(&mut hub, 0, "LL_A", "one");
    assert_eq!(
        [hub.poll_pending(), hub.poll_pending(), hub.poll_pending()],
        [Some(ClientId(0)), Some(ClientId(1)), None]
    );
    publish(&mut hub, 3, "LL_A", "two");
    assert_eq!(take(&mut hub, 0), ["LL_A one", "LL_A two"]);
    assert_eq!(take(&mut hub, 1), ["LL_A one", "LL_A two"]);
    assert!(take(&mut hub, 2).is_empty() && take(&mut hub, 3).is_empty());
    let Stats { clients, published, delivered, dropped, unusable, .. } = hub.stats();
    assert_eq!((clients, published, delivered, dropped, unusable), (4, 2, 4, 0, 0));
}

#[test]
fn who_wants_a_channel_is_asked_anew_after_every_change() {
    let mut hub = hub(2, Limits::default());
    let heard = |hub: &mut Hub, now: &[u8]| {
        send(hub, 0, now);
        publish(hub, 1, "A", "");
        take(hub, 0).len()
    };
    assert_eq!(heard(&mut hub, b""), 0);
    assert_eq!(heard(&mut hub, &subscribe("A")), 1);
    assert_eq!(heard(&mut hub, &subscribe("A")), 1);
    assert_eq!(heard(&mut hub, &unsubscribe("A")), 1, "one of two equal ones is left");
    assert_eq!(heard(&mut hub, &unsubscribe("A")), 0);
    assert_eq!(heard(&mut hub, &unsubscribe("A")), 0);
    assert_eq!(heard(&mut hub, &subscribe(".*")), 1);
    hub.disconnect(ClientId(0));
    publish(&mut hub, 1, "A", "");
    assert_eq!((hub.poll_tx(ClientId(0)).count(), hub.stats().delivered, hub.stats().clients), (0, 4, 1));
}

#[test]
fn a_client_that_does_not_read_loses_its_oldest_messages_and_nobody_else_any() {
    // Each message costs 64 + 13 + 1000: three fit.
    let mut hub = hub(3, Limits { queue: 3500, ..Limits::default() });
    send(&mut hub, 0, &subscribe("A"));
    send(&mut hub, 1, &subscribe("A"));
    let payload = |n: usize| format!("{n:01000}");
    for n in 0..10 {
        publish(&mut hub, 2, "A", &payload(n));
        assert_eq!(take(&mut hub, 1), [format!("A {}", payload(n))]);
        if n == 2 {
            // Has begun, so it is not dropped.
            hub.handle_tx(ClientId(0), 1);
        }
    }
    assert_eq!(hub.client(ClientId(0)).map(|client| (client.dropped, client.waiting)), Some((7, 3)));
    let mut waiting = hub.poll_tx(ClientId(0)).collect::<Vec<_>>().concat();
    hub.handle_tx(ClientId(0), waiting.len());
    waiting.insert(0, 0);
    let messages: Vec<_> = waiting.chunks(1013).map(|message| message[13..].to_vec()).collect();
    assert_eq!(messages, [payload(0), payload(8), payload(9)].map(String::into_bytes));
    assert_eq!((hub.stats().dropped, hub.stats().delivered), (7, 13));
}

#[test]
fn a_hub_that_waits_drops_nothing_and_is_full_until_the_client_takes_some() {
    let mut hub = hub(3, Limits { queue: 3500, overflow: Overflow::Wait, ..Limits::default() });
    send(&mut hub, 0, &subscribe("A"));
    send(&mut hub, 1, &subscribe("A"));
    let payload = |n: usize| format!("{n:01000}");
    for n in 0..5 {
        assert_eq!(hub.is_full(), n > 3, "each message costs 1077 bytes, the fourth is more than the limit");
        publish(&mut hub, 2, "A", &payload(n));
        take(&mut hub, 1);
    }
    assert!(hub.blocks(ClientId(0)) && !hub.blocks(ClientId(1)));
    // The length of two messages.
    hub.handle_tx(ClientId(0), 2 * 1013);
    assert!(!hub.is_full());
    assert_eq!(take(&mut hub, 0), [2, 3, 4].map(|n| format!("A {}", payload(n))));
    assert_eq!((hub.stats().dropped, hub.stats().delivered), (0, 10));
    for n in 0..9 {
        publish(&mut hub, 2, "A", &payload(n));
    }
    assert!(hub.is_full());
    hub.disconnect(ClientId(0));
    take(&mut hub, 1);
    assert!(!hub.is_full(), "who is gone stalls nobody");
}

#[test]
fn one_message_waits_whatever_its_size() {
    let mut hub = hub(2, Limits { queue: 10, ..Limits::default() });
    send(&mut hub, 0, &subscribe("A"));
    publish(&mut hub, 1, "A", &"x".repeat(1000));
    publish(&mut hub, 1, "A", "y");
    assert_eq!(take(&mut hub, 0), ["A y"]);
}

#[test]
fn what_makes_no_sense_is_the_end_of_that_client_alone() {
    let mut hub = hub(2, Limits { message: 100, ..Limits::default() });
    send(&mut hub, 1, &subscribe("A"));
    assert!(hub.handle_rx(ClientId(0), b"GET / HTTP/1.1\r\n").is_err());
    assert_eq!(hub.client(ClientId(0)), None);
    assert_eq!(hub.handle_rx(ClientId(0), b"and on"), Ok(()), "of one that has gone, nothing is heard");
    publish(&mut hub, 1, "A", "still here");
    assert_eq!(take(&mut hub, 1), ["A still here"]);
    assert!(hub.handle_rx(ClientId(1), &publish_header("A", 101)).is_err());
    assert_eq!((hub.stats().clients, hub.stats().malformed), (0, 2));
}

#[test]
fn clients_and_subscriptions_are_limited() {
    let mut hub = hub(2, Limits { clients: 2, subscriptions: 2, ..Limits::default() });
    assert_eq!((hub.connect(), hub.stats().refused), (None, 1));
    for (pattern, unusable) in [("(", 1), ("(a?b?){999}", 2), ("A", 2), ("B.*", 2), ("C", 3)] {
        send(&mut hub, 0, &subscribe(pattern));
        assert_eq!(hub.stats().unusable, unusable, "{pattern}");
    }
    publish(&mut hub, 1, "C", "");
    publish(&mut hub, 1, "BC", "");
    publish(&mut hub, 1, &"x".repeat(64), "");
    assert_eq!(take(&mut hub, 0), ["BC "]);
    assert_eq!(hub.stats().unusable, 4);
    hub.disconnect(ClientId(0));
    assert!(hub.connect().is_some());
}

#[test]
fn many_costly_expressions_are_too_many_but_many_names_are_not() {
    let mut hub = hub(2, Limits::default());
    send(&mut hub, 0, &subscribe(&"x".repeat(TEXT_MAX)));
    for n in 0..100 {
        send(&mut hub, 0, &subscribe(&format!("(a?b?){{100}}{n}")));
        send(&mut hub, 1, &subscribe(&format!("LL_DATA_(ONE|OTHER)_{n}")));
    }
    assert_eq!(hub.client(ClientId(1)).unwrap().subscriptions, 100);
    assert_eq!(hub.client(ClientId(0)).unwrap().subscriptions, 8);
}

#[test]
fn channels_that_never_end_are_not_all_remembered() {
    let mut hub = hub(1, Limits::default());
    send(&mut hub, 0, &subscribe("7777"));
    for n in 0..10_000 {
        publish(&mut hub, 0, &n.to_string(), "");
    }
    assert!(hub.relay.routes.len() <= ROUTES_MAX);
    assert_eq!(take(&mut hub, 0), ["7777 "]);
}
