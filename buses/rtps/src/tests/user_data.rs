//! What writers and readers have others know.

use super::{Net, TOPIC, config};
use crate::guid::Entity;
use crate::wire::{Submessage, parse};
use crate::{Config, Participant, Qos, USER_DATA_MAX};
use alloc::vec;
use alloc::vec::Vec;
use base::Instant;

/// Announcements of endpoints among the datagrams of a participant: their parameters.
fn announced(endpoint_data: fn(&str) -> Vec<u8>) -> Vec<Vec<u8>> {
    let mut net = Net::new(2);
    net.all[0] = Participant::new(Config { endpoint_data, ..config(0, 2) });
    net.run(300);
    let now = net.now;
    net.all[0].add_writer(now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.all[0].add_reader(now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    let mut found = Vec::new();
    while let Some(sent) = net.all[0].poll_tx() {
        for submessage in parse(&sent.datagram).unwrap().1 {
            if let Submessage::Data(data) = submessage.unwrap() {
                assert!([Entity::PUBLICATIONS_WRITER, Entity::SUBSCRIPTIONS_WRITER].contains(&data.writer));
                found.push(data.payload.to_vec());
            }
        }
    }
    found
}

#[test]
fn a_writer_and_a_reader_announce_the_data_of_their_type_as_octets_with_their_count() {
    let with = announced(|type_name| type_name.as_bytes()[..5].to_vec());
    let without = announced(|_| Vec::new());
    assert_eq!((with.len(), without.len()), (2, 2));
    // Number, length, count of octets; filled up to four bytes.
    let parameter = [0x2c, 0, 12, 0, 5, 0, 0, 0, b'p', b'k', b'g', b':', b':', 0, 0, 0];
    const END: [u8; 4] = [1, 0, 0, 0];
    for (with, without) in with.iter().zip(&without) {
        let rest = without.strip_suffix(&END).unwrap();
        assert_eq!(*with, [rest, &parameter, &END].concat());
    }
}

#[test]
fn an_endpoint_with_data_is_matched_as_any_other() {
    let mut net = Net::new(2);
    for n in [0, 1] {
        net.all[n] = Participant::new(Config { endpoint_data: |_| vec![7; USER_DATA_MAX], ..config(n, 2) });
    }
    let writer = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.run(300);
    assert_eq!((net.all[0].matched(writer), net.all[1].counters().malformed), (1, 0));
}

#[test]
fn an_endpoint_with_too_much_data_is_not_made() {
    let mut one = Participant::new(Config { endpoint_data: |_| vec![7; USER_DATA_MAX + 1], ..config(0, 1) });
    let now = Instant::from_millis(1);
    assert_eq!(one.add_writer(now, TOPIC.0, TOPIC.1, Qos::RELIABLE), None);
    assert_eq!(one.add_reader(now, TOPIC.0, TOPIC.1, Qos::RELIABLE), None);
}
