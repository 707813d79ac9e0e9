use super::*;
use core::net::Ipv4Addr;

fn publisher(port: u16) -> SocketAddrV4 {
    SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)
}

fn datagrams(sequence: u32, channel: &str, payload: &[u8]) -> Vec<Vec<u8>> {
    let message = udpm::Message::new(sequence, channel, payload, udpm::DATAGRAM_MAX).unwrap();
    let datagram = |number| {
        let (header, rest) = message.datagram(number);
        [&header[..], rest].concat()
    };
    (0..message.count()).map(datagram).collect()
}

/// Hands a datagram in; what came of it.
fn take(receiver: &mut Receiver, from: SocketAddrV4, bytes: &[u8]) -> Option<(String, Vec<u8>)> {
    let mut buffer = Buffer::default();
    buffer.room()[..bytes.len()].copy_from_slice(bytes);
    let place = receiver.handle_rx(5, from, &mut buffer, bytes.len())?;
    let (channel, payload) = receiver.message(place, &buffer);
    Some((channel.into(), payload.into()))
}

#[test]
fn only_subscribed_channels_are_handed_out() {
    let mut receiver = Receiver::default();
    let id = receiver.subscribe("A.", Queue::Transport).unwrap();
    let [wanted] = &datagrams(0, "AB", b"x")[..] else { panic!() };
    assert_eq!(take(&mut receiver, publisher(1), wanted), Some(("AB".into(), b"x".into())));
    assert_eq!(take(&mut receiver, publisher(1), &datagrams(1, "B", b"x")[0]), None);
    assert!(receiver.unsubscribe(id));
    assert_eq!(take(&mut receiver, publisher(1), wanted), None);
    let Stats { received, unwanted, malformed, lost, .. } = receiver.stats;
    assert_eq!((received, unwanted, malformed, lost), (1, 2, 0, 0));
}

#[test]
fn large_messages_are_put_together_where_they_are_wanted() {
    let mut receiver = Receiver::default();
    receiver.hears_all(0);
    receiver.subscribe("BIG", Queue::Transport).unwrap();
    let payload: Vec<u8> = (0..200_000).map(|i| i as u8).collect();
    let taken = |receiver: &mut Receiver, sequence, channel| {
        let datagrams = datagrams(sequence, channel, &payload);
        datagrams.iter().filter_map(|bytes| take(receiver, publisher(1), bytes)).collect::<Vec<_>>()
    };
    assert!(taken(&mut receiver, 0, "BIG") == [("BIG".to_string(), payload.clone())]);
    assert_eq!(taken(&mut receiver, 1, "OTHER"), []);
    let Stats { received, unwanted, incomplete, lost, .. } = receiver.stats;
    assert_eq!((received, unwanted, incomplete, lost), (1, 1, 0, 0));
}

#[test]
fn what_is_not_understood_is_counted_and_the_last_kept() {
    let mut receiver = Receiver::default();
    receiver.subscribe("BIG", Queue::Transport).unwrap();
    assert_eq!(take(&mut receiver, publisher(5), b"hello"), None);
    let line = "LCM datagram from 127.0.0.1:5 dropped: 5 bytes do not hold an LCM header";
    assert_eq!(receiver.stats.last_rejected.unwrap().to_string(), line);
    for _ in 0..9 {
        take(&mut receiver, publisher(5), b"hello you");
    }
    let by_kind: Vec<_> = receiver.rejections().iter().map(|kind| (kind.last.why.kind(), kind.count)).collect();
    assert_eq!((by_kind, receiver.stats.malformed), (vec![("TooShort", 1), ("Magic", 9)], 10));
}

#[test]
fn gaps_are_losses_only_where_all_datagrams_are_heard() {
    let mut receiver = Receiver::default();
    receiver.subscribe("A", Queue::Transport).unwrap();
    let hear = |receiver: &mut Receiver, sequence| {
        take(receiver, publisher(1), &datagrams(sequence, "A", b"")[0]);
        receiver.stats.lost
    };
    assert_eq!((hear(&mut receiver, 0), hear(&mut receiver, 5)), (0, 0), "the kernel may have filtered");
    receiver.hears_all(6);
    assert_eq!((hear(&mut receiver, 7), hear(&mut receiver, 9)), (0, 0), "received before");
    receiver.hears_all(5);
    assert_eq!((hear(&mut receiver, 9), hear(&mut receiver, 12)), (0, 2));
    assert_eq!(receiver.sources()[0].lost, 2);
    receiver.hears_some();
    assert_eq!((hear(&mut receiver, 20), receiver.sources().len()), (2, 0));
}

#[test]
fn a_subscription_takes_messages_up_to_its_size_and_counts_the_others() {
    let mut receiver = Receiver::default();
    let id = receiver.subscribe("A", Queue::Transport).unwrap();
    assert!(receiver.set_size_max(id, 100_000));
    let taken = |receiver: &mut Receiver, sequence, len| {
        let datagrams = datagrams(sequence, "A", &vec![1; len]);
        datagrams.iter().filter_map(|bytes| take(receiver, publisher(1), bytes)).count()
    };
    assert_eq!([5, 100_000, 100_001].map(|len| taken(&mut receiver, len as u32, len)), [1, 1, 0]);
    assert!(receiver.set_size_max(id, 10));
    assert_eq!([10, 11].map(|len| taken(&mut receiver, len as u32, len)), [1, 0]);
    let Stats { received, unwanted, too_large, incomplete, .. } = receiver.stats;
    assert_eq!((received, unwanted, too_large, incomplete), (3, 0, 2, 0));
}
