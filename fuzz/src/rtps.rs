//! A participant of RTPS on a network that sends anything. Input: datagrams, each after its length in two bytes, the
//! lower one first. The kept ones are of ROS 2 and of Cyclone DDS.

use base::{Duration, Instant};
use rtps::{Config, Limits, Participant, Prefix, Qos, Sample, SampleIdentity};
use std::net::SocketAddrV4;

/// Identifier to which the kept inputs are addressed.
const OWN: Prefix = Prefix([1; 12]);
const TYPE: &str = "std_msgs::msg::dds_::String_";

/// Checks that what arrives is survived, that nothing is due after it was done, and that all limits hold.
pub fn rtps(data: &[u8]) {
    let address = |n: u8| SocketAddrV4::new([127, 0, 0, n].into(), 7410);
    let usual = Limits::default();
    let limits = Limits { participants: 4, endpoints: 8, matches: 4, events: 16, outbox: 64 << 10, ..usual };
    let mut participant = Participant::new(Config {
        domain: 77,
        prefix: OWN,
        locators: vec![address(1)],
        announce_to: vec![address(2)],
        announce_period: Duration::from_secs(3),
        lease: Duration::from_secs(20),
        name: "fuzz".into(),
        user_data: Vec::new(),
        endpoint_data: |_| Vec::new(),
        limits,
    });
    let mut now = Instant::from_millis(1);
    let chatter = participant.add_writer(now, "rt/chatter", TYPE, Qos::RELIABLE).unwrap();
    let big = participant.add_writer(now, "rt/big", TYPE, Qos::LATCHED).unwrap();
    let back = participant.add_reader(now, "rt/back", TYPE, Qos::RELIABLE).unwrap();
    let requests = participant.add_request_reader(now, "rq/askRequest", TYPE, Qos::RELIABLE).unwrap();
    let answers = participant.add_writer(now, "rr/askReply", TYPE, Qos::RELIABLE).unwrap();
    participant.write(now, big, 0, &[7; 20_000]);
    let mut rest = data;
    while let Some((length, more)) = rest.split_first_chunk() {
        let (datagram, more) = more.split_at(usize::from(u16::from_le_bytes(*length)).min(more.len()));
        rest = more;
        now += Duration::from_millis(10);
        participant.handle_rx(now, address(2), datagram);
        participant.write(now, chatter, 0, &[0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
        participant.handle_timeout(now);
        assert!(participant.poll_timeout().is_some_and(|due| due > now), "due after it was done");
        let waiting: usize = std::iter::from_fn(|| participant.poll_tx()).map(|sent| sent.datagram.len()).sum();
        assert!(waiting <= limits.outbox, "{waiting} bytes");
        assert!(participant.participants() <= limits.participants);
        assert!(participant.matched(chatter) <= limits.matches && participant.matched_writers(back) <= limits.matches);
        let samples: Vec<Sample> = std::iter::from_fn(|| participant.poll_event()).collect();
        assert!(samples.len() <= limits.events);
        for Sample { reader, writer, number, related, payload, .. } in samples {
            assert!(payload.len() <= limits.sample && number > 0);
            if reader == requests {
                let request = related.unwrap_or(SampleIdentity { writer, number });
                participant.write_related(now, answers, 0, Some(request), &payload);
            }
        }
    }
}
