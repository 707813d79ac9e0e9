//! LCM receiver: datagrams, reassembly.

use arbitrary::Arbitrary;
use lcm::reassembly::{Buffer, Limits};
use lcm::receiver::Receiver;
use lcm::subscription::Queue;
use lcm::udpm::{DATAGRAM_MAX, Message};
use std::net::{Ipv4Addr, SocketAddrV4};

#[derive(Arbitrary, Debug)]
enum Step<'a> {
    /// Any bytes.
    Noise { port: u8, bytes: &'a [u8] },
    /// A datagram of a good message, a byte of it changed.
    Piece { port: u8, sequence: u8, channel: u8, len: u16, size: u16, number: u8, damage: Option<(u16, u8)> },
    /// Time passes, ms.
    Wait(u16),
}

/// Datagrams, whole or damaged, through LCM's receiver.
///
/// Each datagram is counted once, what is delivered was sent whole, and incomplete messages have bounded memory.
pub fn lcm_datagram(data: &[u8]) {
    let Some(steps) = crate::input::<Vec<Step<'_>>>(data) else { return };
    let mut receiver = Receiver::default();
    receiver.hears_all(0);
    receiver.subscribe("LL_.*", Queue::Transport).expect("a good pattern");
    let mut buffer = Buffer::default();
    let (mut now, mut taken, mut all) = (0, 0, 0);
    for step in steps {
        let (port, bytes, damaged) = match step {
            Step::Wait(ms) => {
                now += i64::from(ms) * 1_000_000;
                continue;
            }
            Step::Noise { port, bytes } => (port, bytes[..bytes.len().min(DATAGRAM_MAX)].to_vec(), true),
            Step::Piece { port, sequence, channel, len, size, number, damage } => {
                let payload = payload(len.into());
                let channel = ["LL_A", "LL_B", "OTHER"][usize::from(channel % 3)];
                let message = Message::new(sequence.into(), channel, &payload, size.into()).expect("it can be sent");
                let (header, rest) = message.datagram(usize::from(number) % message.count());
                let mut bytes = [&header[..], rest].concat();
                if let Some((at, change)) = damage {
                    let at = usize::from(at) % bytes.len();
                    bytes[at] ^= change;
                }
                (port, bytes, damage.is_some())
            }
        };
        all += 1;
        let malformed = receiver.stats.malformed;
        buffer.room()[..bytes.len()].copy_from_slice(&bytes);
        let from = SocketAddrV4::new(Ipv4Addr::LOCALHOST, port.into());
        if let Some(place) = receiver.handle_rx(now, from, &mut buffer, bytes.len()) {
            taken += 1;
            let (channel, _) = receiver.message(place, &buffer);
            assert!(channel.starts_with("LL_"));
        }
        assert!(damaged || receiver.stats.malformed == malformed, "a good datagram was refused");
        assert!(receiver.incomplete_bytes() <= Limits::default().bytes);
    }
    let stats = receiver.stats;
    assert_eq!(stats.received, taken);
    assert!(stats.received + stats.unwanted + stats.malformed <= all);
    assert!(receiver.rejections().len() <= 8);
    assert_eq!(receiver.rejections().is_empty(), stats.last_rejected.is_none());
}

fn payload(len: usize) -> Vec<u8> {
    (0..len).map(|i| (7 * i + (i >> 8)) as u8).collect()
}
