use super::*;
use std::io::Cursor;

/// A log of events `(timestamp, channel, payload)`.
fn log(events: &[(i64, &str, &[u8])]) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new());
    for &(timestamp_us, channel, payload) in events {
        writer.write(timestamp_us, channel, payload).unwrap();
    }
    writer.into_inner()
}

const THREE: &[(i64, &str, &[u8])] = &[(10, "A", b"one"), (20, "BB", b""), (30, "A", b"three")];

/// What a log says, a word an event, and its counters `(events, skipped, unusable, truncated)`.
fn read(bytes: &[u8]) -> (Vec<String>, (u64, u64, u64, u64)) {
    let mut reader = Reader::new(bytes);
    let mut said = Vec::new();
    while let Some(Event { number, timestamp_us, channel, payload }) = reader.next_event().unwrap() {
        said.push(format!("{number} {timestamp_us} {channel} {}", String::from_utf8_lossy(payload)));
    }
    assert_eq!(reader.next_event().unwrap(), None, "the end stays the end");
    assert_eq!(reader.position(), bytes.len() as u64);
    let Stats { events, skipped, unusable, truncated } = *reader.stats();
    (said, (events, skipped, unusable, truncated))
}

#[test]
fn what_is_written_is_read() {
    let (said, stats) = read(&log(THREE));
    assert_eq!(said, ["0 10 A one", "1 20 BB ", "2 30 A three"]);
    assert_eq!(stats, (3, 0, 0, 0));
    assert_eq!(read(b""), (vec![], (0, 0, 0, 0)));
}

#[test]
fn garbage_before_between_and_after_is_skipped_and_counted() {
    let whole = log(THREE);
    let first = &whole[..HEADER + 4];
    let garbage = b"\xed\xa1\xda garbage \xed\xa1\xda\x01 with a sync word and impossible lengths";
    let damaged = [garbage, first, garbage, first, garbage].concat();
    let (said, (events, skipped, _, truncated)) = read(&damaged);
    assert_eq!((said.len(), events), (0, 0), "an event that is not followed by another is not believed: {said:?}");
    assert_eq!(skipped + truncated, damaged.len() as u64);
    let damaged = [&whole[..], garbage].concat();
    assert_eq!(read(&damaged).0, ["0 10 A one", "1 20 BB "]);
    let damaged = [garbage, &whole[..]].concat();
    assert_eq!(read(&damaged), (read(&whole).0, (3, garbage.len() as u64, 0, 0)));
}

#[test]
fn a_last_event_cut_short_is_the_end() {
    let whole = log(THREE);
    let last = HEADER + 6;
    for cut in 1..last {
        let (said, stats) = read(&whole[..whole.len() - cut]);
        assert_eq!(said, ["0 10 A one", "1 20 BB "]);
        assert_eq!(stats, (2, 0, 0, (last - cut) as u64));
    }
}

#[test]
fn what_is_cut_short_behind_garbage_is_told_from_it() {
    let whole = log(THREE);
    let damaged = [&whole[..], &whole[..5]].concat();
    assert_eq!(read(&damaged).1, (3, 0, 0, 5));
    let damaged = [b"garbage", &whole[..5]].concat();
    assert_eq!(read(&damaged).1, (0, 7, 0, 5));
}

#[test]
fn after_an_event_cut_short_in_the_middle_the_next_one_is_found() {
    let whole = log(THREE);
    for cut in 1..HEADER + 4 {
        let crashed = [&whole[..cut], &whole[HEADER + 4..]].concat();
        let (said, stats) = read(&crashed);
        assert_eq!(said, ["1 20 BB ", "2 30 A three"], "{cut}");
        assert_eq!(stats, (2, cut as u64, 0, 0));
    }
}

#[test]
fn a_log_in_the_data_of_a_log_is_data() {
    let inner = log(THREE);
    let outer = log(&[(1, "LOG", &inner), (2, "LOG", &inner)]);
    let mut reader = Reader::new(&outer[..]);
    for _ in 0..2 {
        assert_eq!(reader.next_event().unwrap().unwrap().payload, inner);
    }
    assert_eq!(reader.next_event().unwrap(), None);
    assert_eq!(reader.stats().skipped, 0);
}

#[test]
fn lengths_that_cannot_be_take_no_memory() {
    let mut hostile = Vec::new();
    for (channel, data) in [(0, 0), (1000, 0), (u32::MAX, 0), (1, u32::MAX), (1, 1 << 31), (1, (1 << 28) + 1)] {
        hostile.extend_from_slice(&SYNC.to_be_bytes());
        hostile.extend_from_slice(&[0; 16]);
        hostile.extend_from_slice(&u32::to_be_bytes(channel));
        hostile.extend_from_slice(&u32::to_be_bytes(data));
    }
    let len = hostile.len() as u64;
    assert_eq!(read(&hostile), (vec![], (0, len, 0, 0)));
    let mut reader = Reader::new(&hostile[..]);
    assert_eq!(reader.next_event().unwrap(), None);
    assert!(reader.buffer.capacity() <= 2 * CHUNK);
    let mut reader = Reader::with_limit(&log(&[(1, "A", &[0; 101]), (2, "A", &[0; 100])])[..], 100)
        .next_event()
        .map(|event| event.map(|event| event.timestamp_us));
    assert_eq!(reader.as_mut().unwrap(), &mut Some(2));
}

#[test]
fn many_sync_words_that_each_claim_the_rest_are_read_in_linear_time() {
    // 50 000 headers, each with data up to 16 MiB away, where no sync word is: moving 16 MiB for each would take hours.
    let mut hostile = Vec::new();
    for _ in 0..50_000 {
        hostile.extend_from_slice(&SYNC.to_be_bytes());
        hostile.extend_from_slice(&[0; 16]);
        hostile.extend_from_slice(&1u32.to_be_bytes());
        hostile.extend_from_slice(&(16u32 << 20).to_be_bytes());
    }
    hostile.resize(hostile.len() + (17 << 20), 0);
    assert_eq!(read(&hostile).1, (0, hostile.len() as u64, 0, 0));
}

#[test]
fn a_channel_that_is_not_utf_8_is_skipped_alone() {
    let mut bytes = log(THREE);
    bytes[HEADER] = 0xff;
    let (said, stats) = read(&bytes);
    assert_eq!((said.len(), stats), (2, (2, 0, 1, 0)));
}

#[test]
fn events_come_whole_from_a_reader_that_gives_them_in_pieces() {
    struct Drip(Cursor<Vec<u8>>, bool);
    impl Read for Drip {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.1 = !self.1;
            if self.1 { Err(io::ErrorKind::Interrupted.into()) } else { self.0.read(&mut buffer[..1]) }
        }
    }
    let mut reader = Reader::new(Drip(Cursor::new(log(THREE)), false));
    let mut count = 0;
    while let Some(event) = reader.peek().unwrap().map(|event| event.number) {
        assert_eq!(reader.next_event().unwrap().map(|event| event.number), Some(event));
        count += 1;
    }
    assert_eq!(count, 3);
}

#[test]
fn seeking_finds_the_first_event_that_is_not_earlier() {
    let events: Vec<_> = (0..1000).map(|n| (n / 3 * 10, "A", &[0u8; 300][..(n % 300) as usize])).collect();
    let bytes = log(&events);
    let mut reader = Reader::new(Cursor::new(&bytes));
    for timestamp in -1..3340 {
        reader.seek_to_timestamp(timestamp).unwrap();
        let found = reader.next_event().unwrap().map(|event| event.number);
        let expected = events.iter().position(|event| event.0 >= timestamp).map(|n| n as i64);
        assert_eq!(found, expected, "{timestamp}");
    }
    assert_eq!(reader.stats().skipped, 0, "looking around is not counted");
}

#[test]
fn appending_goes_on_with_the_numbers_and_over_what_was_cut_short() {
    let whole = log(THREE);
    for cut in [0, 1, HEADER, HEADER + 5] {
        let file = Cursor::new(whole[..whole.len() - cut].to_vec());
        let mut writer = Writer::append(file).unwrap();
        let number = if cut == 0 { 3 } else { 2 };
        assert_eq!(writer.write(40, "C", b"a long enough payload").unwrap(), number);
        let bytes = writer.into_inner().into_inner();
        let (said, stats) = read(&bytes);
        assert_eq!(said.last().unwrap(), &format!("{number} 40 C a long enough payload"));
        assert_eq!((said.len() as i64, stats.1, stats.3), (number + 1, 0, 0));
    }
    for empty in [&b""[..], b"\xed", b"\xed\xa1\xda\x01\0\0"] {
        assert_eq!(Writer::append(Cursor::new(empty.to_vec())).unwrap().write(1, "A", b"").unwrap(), 0);
    }
    assert!(Writer::append(Cursor::new(b"a letter to someone".to_vec())).is_err());
}

#[test]
fn the_last_event_is_found_from_behind_also_if_it_is_large() {
    let large = vec![7; 3 << 20];
    let bytes = log(&[(1, "A", b""), (2, "A", &large)]);
    let tail = Reader::new(Cursor::new(&bytes)).tail().unwrap();
    assert_eq!(tail, Tail { end: bytes.len() as u64, number: Some(1) });
}

#[test]
fn what_a_log_cannot_hold_is_refused() {
    let mut writer = Writer::new(Vec::new());
    assert!(matches!(writer.write(0, "", b""), Err(WriteError::Channel { len: 0 })));
    assert!(matches!(writer.write(0, &"x".repeat(1000), b""), Err(WriteError::Channel { len: 1000 })));
    assert_eq!(writer.write(0, &"x".repeat(999), b"").unwrap(), 0);
}
