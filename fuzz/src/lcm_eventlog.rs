//! LCM event logs.

use lcm::eventlog::{Event, HEADER, Reader, SYNC, Stats, Writer};
use std::io::{Cursor, Read};

type Owned = (i64, i64, String, Vec<u8>);

/// Gives a few bytes at a time.
struct Drip<'a>(&'a [u8]);

impl Read for Drip<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let len = buffer.len().min(self.0.len()).min(7);
        self.0.read(&mut buffer[..len])
    }
}

fn owned(Event { number, timestamp_us, channel, payload }: Event<'_>) -> Owned {
    (number, timestamp_us, channel.into(), payload.into())
}

fn events(from: impl Read) -> (Vec<Owned>, Stats, u64) {
    let mut reader = Reader::with_limit(from, 5000);
    let mut events = Vec::new();
    while let Some(event) = reader.next_event().expect("memory does not fail") {
        events.push(owned(event));
    }
    (events, *reader.stats(), reader.position())
}

/// An LCM event log: a whole file, or whole and damaged events with arbitrary bytes between them.
///
/// Each byte belongs to an event or is counted. Events that were read are the same after they were written again. A log
/// can be continued, and one in order can be searched by time.
pub fn lcm_eventlog(data: &[u8]) {
    if data.starts_with(&SYNC.to_be_bytes()) {
        return check(data.to_vec(), 0);
    }
    let Some(input) = crate::input::<(Vec<(u8, i64, &[u8])>, i64)>(data) else { return };
    let (pieces, wanted) = input;
    let mut log = Writer::new(Vec::new());
    for &(what, timestamp_us, data) in &pieces {
        match what % 4 {
            0 => log.get_mut().extend(data),
            1 => {
                log.get_mut().extend(SYNC.to_be_bytes());
                log.get_mut().extend(data);
            }
            2 => {
                // Cut short.
                log.write(timestamp_us, "CUT", data).expect("memory does not fail");
                let len = log.get_mut().len();
                log.get_mut().truncate(len - usize::from(what) % (HEADER + data.len()));
            }
            _ => drop(log.write(timestamp_us, "A", data)),
        }
    }
    check(log.into_inner(), wanted);
}

fn check(bytes: Vec<u8>, wanted: i64) {
    let (all, stats, position) = events(&bytes[..]);
    assert_eq!(events(Drip(&bytes)), (all.clone(), stats, position));
    assert_eq!((position, stats.events), (bytes.len() as u64, all.len() as u64));
    let in_events: usize = all.iter().map(|(_, _, channel, payload)| HEADER + channel.len() + payload.len()).sum();
    let accounted = in_events as u64 + stats.skipped + stats.truncated;
    assert!(accounted == position || (accounted < position && stats.unusable > 0));

    let mut again = Writer::new(Vec::new());
    for (number, timestamp_us, channel, payload) in &all {
        let event = Event { number: *number, timestamp_us: *timestamp_us, channel, payload };
        again.write_event(&event).expect("what was read can be written");
    }
    let again = again.into_inner();
    let (read_again, stats, _) = events(&again[..]);
    assert!(read_again == all && stats.skipped + stats.truncated + stats.unusable == 0);

    // As the provider does: what is behind the last event is cut off. A sync word that belongs to no event may claim
    // what is then written as its own data; nobody can tell that from an event.
    if let Ok(log) = Writer::append(Cursor::new(bytes)) {
        let mut file = log.into_inner();
        let end = file.position() as usize;
        file.get_mut().truncate(end);
        let orderly = syncs(file.get_ref()) == all.len();
        if orderly {
            let mut log = Writer::append(file).expect("as before");
            let number = log.write(7, "NEXT", b"").expect("memory does not fail");
            let (longer, ..) = events(&log.into_inner().into_inner()[..]);
            let (last, before) = longer.split_last().expect("one at least");
            assert_eq!((last.0, before), (number, &all[..]));
            assert_eq!(number, all.last().map_or(0, |event| event.0.wrapping_add(1)));
        }
    }

    let mut reader = Reader::with_limit(Cursor::new(&again), 5000);
    reader.seek_to_timestamp(wanted).expect("memory does not fail");
    let found = reader.next_event().expect("memory does not fail").map(owned);
    if syncs(&again) == all.len() && all.is_sorted_by_key(|event| event.1) {
        assert_eq!(found, all.into_iter().find(|event| event.1 >= wanted));
    }
}

fn syncs(log: &[u8]) -> usize {
    log.windows(4).filter(|word| **word == SYNC.to_be_bytes()).count()
}
