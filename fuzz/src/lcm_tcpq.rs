//! TCPQ hub and its clients.

use lcm::tcpq::hub::{ClientId, Hub, Limits, Overflow};
use lcm::tcpq::{Decoder, Message, Peer, hello};
use std::collections::BTreeMap;

const LIMITS: Limits =
    Limits { clients: 4, subscriptions: 8, message: 1000, queue: 3000, overflow: Overflow::DropOldest };

/// A message of this type with these bytes as text, and as many more as payload if it is published.
fn message(kind: u32, data: &[u8]) -> Vec<u8> {
    let (text, payload) = data.split_at(data.len().min(if kind == 1 { 2 } else { 1000 }));
    let mut bytes = kind.to_be_bytes().to_vec();
    for part in [text, payload].into_iter().take(if kind == 1 { 2 } else { 1 }) {
        bytes.extend((part.len() as u32).to_be_bytes());
        bytes.extend(part);
    }
    bytes
}

fn said(from: Peer, pieces: &[&[u8]]) -> Vec<String> {
    let mut decoder = Decoder::new(from, LIMITS.message);
    let mut said = Vec::new();
    for piece in pieces {
        decoder.push(piece);
        loop {
            match decoder.next_message() {
                Ok(Some(message)) => said.push(format!("{message:?}")),
                Ok(None) => break,
                Err(error) => {
                    said.push(format!("{error:?}"));
                    return said;
                }
            }
        }
    }
    said
}

/// Clients of a TCPQ hub that connect, leave, send and read arbitrarily.
///
/// A stream decodes the same in any chunks; the queue of a client is bounded; what it receives are whole messages, each
/// counted.
pub fn lcm_tcpq(data: &[u8]) {
    let Some(steps) = crate::input::<Vec<(u8, u8, &[u8])>>(data) else { return };
    let pieces: Vec<&[u8]> = steps.iter().map(|step| step.2).collect();
    for from in [Peer::Client, Peer::Hub] {
        assert_eq!(said(from, &pieces), said(from, &[&pieces.concat()]));
    }

    let mut hub = Hub::new(LIMITS);
    // What each client makes of what it read, and how many messages all of them read.
    let mut clients: BTreeMap<ClientId, Decoder> = BTreeMap::new();
    let mut read = 0;
    for (who, what, data) in steps {
        let id = clients.keys().nth(usize::from(who) % clients.len().max(1)).copied();
        let bytes = match what % 8 {
            0 => {
                let id = hub.connect();
                assert_eq!(id.is_none(), clients.len() == LIMITS.clients);
                clients.extend(id.map(|id| (id, Decoder::new(Peer::Hub, LIMITS.message))));
                continue;
            }
            1 => hello(Peer::Client).to_vec(),
            2 => data.to_vec(),
            3 | 4 => message(1, data),
            5 => message(2, data),
            6 => message(3, data),
            _ => {
                let Some(id) = id else { continue };
                read += take(&mut hub, id, &mut clients, data.len());
                continue;
            }
        };
        let Some(id) = id else { continue };
        if hub.handle_rx(id, &bytes).is_err() {
            clients.remove(&id);
        }
        while hub.poll_pending().is_some() {}
        for &id in clients.keys() {
            let waiting: usize = hub.poll_tx(id).map(<[u8]>::len).sum();
            assert!(waiting <= LIMITS.queue + LIMITS.message + 100, "{waiting}");
        }
        assert_eq!(hub.stats().clients, clients.len());
        assert_eq!(hub.stats().delivered, read);
    }
    for id in clients.keys().copied().collect::<Vec<_>>() {
        read += take(&mut hub, id, &mut clients, usize::MAX);
        assert_eq!(clients[&id].waiting(), 0, "nothing but whole messages");
        hub.disconnect(id);
    }
    assert_eq!((hub.stats().clients, hub.stats().delivered), (0, read));
}

/// A client reads at most so many bytes; returns how many messages ended with them.
fn take(hub: &mut Hub, id: ClientId, clients: &mut BTreeMap<ClientId, Decoder>, at_most: usize) -> u64 {
    let mut bytes = hub.poll_tx(id).collect::<Vec<_>>().concat();
    bytes.truncate(at_most);
    hub.handle_tx(id, bytes.len());
    let stream = clients.get_mut(&id).expect("it is connected");
    stream.push(&bytes);
    let mut read = 0;
    while let Some(message) = stream.next_message().expect("a hub says nothing wrong") {
        read += u64::from(matches!(message, Message::Publish { .. }));
    }
    read
}
