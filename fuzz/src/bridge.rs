//! Connection of the bridge to another computer: bytes before and after the session is open. Input: steps, each a kind
//! and bytes.

use ::bridge::allow::Entry;
use ::bridge::auth::{Key, Role, Transcript};
use ::bridge::connection::{Connection, Event, TX_MAX, Time};
use ::bridge::gate::{Arrival, Gate, Passes, Rules};
use ::bridge::wire::{BODY_MAX, Body, Decoder, record};
use base::{Duration, Instant};

const NONCES: [[u8; 32]; 2] = [[1; 32], [2; 32]];

fn time(ms: u64) -> Time {
    Time { now: Instant::from_millis(ms), wall_ns: 1_700_000_000_000_000_000 + ms * 1_000_000 }
}

fn key() -> Key {
    Key::new([7; 32])
}

/// Records of a stream in these pieces, until the first that is not one.
fn records(pieces: &[&[u8]]) -> Vec<Vec<u8>> {
    let (mut decoder, mut records) = (Decoder::default(), Vec::new());
    for piece in pieces {
        decoder.push(piece);
        loop {
            match decoder.next_record(1000, 32) {
                Ok(Some(record)) => records.push(record),
                Ok(None) => break,
                Err(_) => return records,
            }
        }
        assert!(decoder.waiting() < 4 + 1000 + 32);
    }
    records
}

/// A stream is divided the same in any pieces; a body that is read is written with the same bytes; without the key
/// nothing opens and no message arrives; with it, what is received and what waits is bounded, and only what the list
/// allows passes.
pub fn bridge(data: &[u8]) {
    let Some(steps) = crate::input::<Vec<(u8, &[u8])>>(data) else { return };
    let pieces: Vec<&[u8]> = steps.iter().map(|(_, bytes)| *bytes).collect();
    assert_eq!(records(&pieces), records(&[&pieces.concat()]));

    let mut stranger = Connection::listen(key(), NONCES[1], time(0));
    for bytes in &pieces {
        if let Ok(body) = Body::decode(bytes) {
            let mut again = Vec::new();
            body.encode(&mut again);
            assert_eq!(again, *bytes);
        }
        if stranger.handle_rx(time(1), bytes).is_err() {
            break;
        }
        assert!(!stranger.is_open() && stranger.poll_event().is_none());
    }

    // The other computer has the key, and sends anything.
    let mut far = Connection::connect(key(), NONCES[0], time(0));
    let mut near = Connection::listen(key(), NONCES[1], time(0));
    let mut seal = Transcript { connector: NONCES[0], listener: NONCES[1] }.session(&key(), Role::Connector);
    near.handle_rx(time(0), &far.take_tx()).unwrap();
    far.handle_rx(time(0), &near.take_tx()).unwrap();
    near.handle_rx(time(0), &far.take_tx()).unwrap();
    assert!(near.is_open());
    let allowed = ["HL_*", "LL_CMD_MOTION", "CM_DATA_STATE"];
    let mut gate = Gate::new(Rules {
        send: Vec::new(),
        receive: allowed.iter().map(|text| Entry::parse(text).unwrap()).collect(),
        modules: vec!["driver_canbus".into()],
        age_max: Duration::from_millis(250),
        future_max: Duration::from_millis(50),
        rate_max: 100,
    });
    let mut passed = 0;
    for (ms, (kind, bytes)) in steps.iter().enumerate() {
        let time = time(1 + ms as u64 / 4);
        let mut bytes = bytes.to_vec();
        bytes.truncate(BODY_MAX);
        let mut wire = Vec::new();
        if *kind == 0 {
            wire.extend_from_slice(&bytes);
        } else if !bytes.is_empty() {
            record(&mut wire, &bytes, &seal.seal(&bytes));
        }
        let ended = near.handle_rx(time, &wire).is_err() || near.handle_timeout(time).is_err();
        while let Some(event) = near.poll_event() {
            let Event::Message { age, channel, payload } = event else { continue };
            let arrival = Arrival { now: time.now, timestamp: 0, age, passes: Passes::All };
            if gate.receives(arrival, &channel, &payload).is_ok() {
                passed += 1;
                let named = ["LL_CMD_MOTION", "CM_DATA_STATE"].contains(&channel.as_str());
                assert!(named || channel.starts_with("HL_DATA_") || channel.starts_with("HL_EVENT_"), "{channel}");
            }
        }
        assert!(near.poll_tx().len() <= TX_MAX);
        if ended {
            break;
        }
    }
    assert!(passed <= 100 * (2 + steps.len() / 4000));
}
