//! Requests and answers: what identifies a sample, and what it belongs to.

use super::{Net, TOPIC, address, config, payload};
use crate::guid::{Entity, Guid, Prefix, SampleIdentity};
use crate::wire::{Builder, FRAGMENT, Submessage, parse};
use crate::{Participant, Qos, Sample};
use alloc::vec;
use alloc::vec::Vec;
use base::Instant;
use testing::Random;

const REQUEST: (&str, &str) = ("rq/askRequest", "pkg::srv::dds_::Ask_Request_");

fn identity(number: i64) -> SampleIdentity {
    SampleIdentity { writer: Guid { prefix: Prefix([7; 12]), entity: Entity([0, 0, 1, 3]) }, number }
}

/// What the reader of a datagram gets: number, and what the sample belongs to.
fn read(datagram: &[u8]) -> Vec<Option<SampleIdentity>> {
    let (_, submessages) = parse(datagram).unwrap();
    let related = submessages.map(|submessage| match submessage.unwrap() {
        Submessage::Data(data) => data.related,
        Submessage::DataFrag(frag) => frag.related,
        other => panic!("{other:?}"),
    });
    related.collect()
}

#[test]
fn an_answer_names_its_request_whole_or_in_fragments_and_is_found_by_it() {
    let mut net = Net::new(2);
    let asks = net.all[1].add_writer(net.now, REQUEST.0, REQUEST.1, Qos::RELIABLE).unwrap();
    let asked = net.all[0].add_reader(net.now, REQUEST.0, REQUEST.1, Qos::RELIABLE).unwrap();
    let answers = net.all[0].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    let reader = net.all[1].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    let reader_guid = net.all[1].reader_guid(reader);
    assert!(!net.all[0].reaches(answers, reader_guid));
    net.run(300);
    assert!(net.all[0].reaches(answers, reader_guid) && net.all[0].reaches(answers, net.all[1].guid()));
    for (number, length) in [(1, 4), (2, 20_000)] {
        let now = net.now;
        let belongs = SampleIdentity { writer: reader_guid, number: SampleIdentity::UNKNOWN_NUMBER };
        net.all[1].write_related(now, asks, 0, Some(belongs), &payload(1, length));
        net.run(50);
        let Sample { writer, number: got, related, reader, .. } = net.all[0].poll_event().unwrap();
        assert_eq!((reader, got, related), (asked, number, Some(belongs)));
        assert_eq!(writer, net.all[1].writer_guid(asks));
        let now = net.now;
        let request = SampleIdentity { writer: reader_guid, number: got };
        net.all[0].write_related(now, answers, 0, Some(request), &payload(9, length));
        net.run(50);
        let Sample { related, payload: bytes, .. } = net.all[1].poll_event().unwrap();
        assert_eq!((related, bytes), (Some(request), payload(9, length)));
    }
}

#[test]
fn a_request_that_is_sent_before_its_writer_is_known_is_not_lost_and_older_ones_are_not_meant() {
    for is_request in [true, false] {
        let mut net = Net::new(2);
        net.run(300);
        let asks = net.all[1].add_writer(net.now, REQUEST.0, REQUEST.1, Qos::RELIABLE).unwrap();
        // Before there is a reader.
        let now = net.now;
        net.all[1].write(now, asks, 0, &payload(1, 4));
        let server = &mut net.all[0];
        let reader = match is_request {
            true => server.add_request_reader(now, REQUEST.0, REQUEST.1, Qos::RELIABLE),
            false => server.add_reader(now, REQUEST.0, REQUEST.1, Qos::RELIABLE),
        };
        // The client hears of the reader; the server does not hear of the writer: its datagrams are lost.
        while let Some(sent) = net.all[0].poll_tx() {
            net.all[1].handle_rx(now, address(0), &sent.datagram);
        }
        assert_eq!((net.all[1].matched(asks), net.all[0].matched_writers(reader.unwrap())), (1, 0));
        net.all[1].write(now, asks, 0, &payload(2, 4));
        while net.all[1].poll_tx().is_some() {}
        net.run(1000);
        assert_eq!(net.taken(0), if is_request { vec![payload(2, 4)] } else { vec![] });
    }
}

#[test]
fn both_numbers_of_the_parameter_are_written_and_either_is_read() {
    let mut message = Builder::new(Prefix([1; 12]));
    message.data(Entity::UNKNOWN, Entity::writer(1), 5, Some(identity(3)), &[0, 1, 0, 0]);
    let both = message.build();
    // As Fast DDS 3.2 writes it: 0x0083, then 0x800f, then the end of the list; GUID, high half, low half.
    let list = &both[20 + 24..];
    let mut value = Vec::from([7; 12]);
    value.extend([0, 0, 1, 3, 0, 0, 0, 0, 3, 0, 0, 0]);
    assert_eq!((&list[..4], &list[4..28]), (&[0x83, 0, 24, 0][..], &value[..]));
    assert_eq!((&list[28..32], &list[32..56]), (&[0x0f, 0x80, 24, 0][..], &value[..]));
    assert_eq!(list[56..60], [1, 0, 0, 0]);
    assert_eq!(read(&both), [Some(identity(3))]);
    // Another number in place of one of them: the other one is read.
    for at in [44, 44 + 28] {
        let mut one = both.clone();
        one[at..at + 2].copy_from_slice(&[0xff, 0x7f]);
        assert_eq!(read(&one), [Some(identity(3))], "{at}");
    }
    let mut fragment = Builder::new(Prefix([1; 12]));
    fragment.fragment(Entity::UNKNOWN, Entity::writer(1), (5, 1), Some(identity(3)), &[0; 2 * FRAGMENT as usize]);
    assert_eq!(read(&fragment.build()), [Some(identity(3))]);
}

#[test]
fn an_identity_that_is_cut_off_says_nothing_and_a_list_without_an_end_is_malformed() {
    let mut message = Builder::new(Prefix([1; 12]));
    message.data(Entity::UNKNOWN, Entity::writer(1), 5, Some(identity(3)), &[0, 1, 0, 0]);
    let whole = message.build();
    // Both parameters too short: their rest reads as parameters of no meaning, or as no list.
    for length in [0, 4, 8, 20, 23, 25, 255] {
        let mut short = whole.clone();
        short[46] = length;
        short[46 + 28] = length;
        let (_, mut submessages) = parse(&short).unwrap();
        if let Some(Ok(Submessage::Data(data))) = submessages.next() {
            assert!(data.related.is_none_or(|related| related.writer.prefix == Prefix([7; 12])), "{length}");
        }
    }
    let mut endless = whole.clone();
    endless[44 + 56] = 2;
    let (_, mut submessages) = parse(&endless).unwrap();
    assert!(submessages.next().unwrap().is_err());
}

#[test]
fn altered_lists_of_parameters_are_survived_and_bounded() {
    let mut random = Random::new(17);
    let mut net = Net::new(2);
    let reader = net.all[0].add_reader(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    let writer = net.all[1].add_writer(net.now, TOPIC.0, TOPIC.1, Qos::RELIABLE).unwrap();
    net.run(300);
    assert_eq!(net.all[0].matched_writers(reader), 1);
    let (prefix, entity) = (net.all[1].guid().prefix, net.all[1].writer_guid(writer).entity);
    for number in 1..5000 {
        let mut message = Builder::new(prefix);
        message.data(Entity::UNKNOWN, entity, number, Some(identity(number)), &payload(1, 4));
        let mut datagram = message.build();
        for _ in 0..=random.below(3) {
            let at = 20 + random.index(datagram.len() - 20);
            datagram[at] = random.edge_byte();
        }
        let now = net.now;
        net.all[0].handle_rx(now, address(1), &datagram);
        while net.all[0].poll_event().is_some() {}
        while net.all[0].poll_tx().is_some() {}
    }
}

#[test]
fn the_vendor_of_another_participant_is_what_it_announces() {
    let mut net = Net::new(2);
    net.run(300);
    let prefix = net.all[1].guid().prefix;
    assert_eq!(net.all[0].vendor(prefix), Some([0, 0]));
    assert_eq!(net.all[0].vendor(Prefix([99; 12])), None);
    let alone = Participant::new(config(0, 1));
    assert_eq!((alone.vendor(prefix), Instant::ZERO < net.now), (None, true));
}
