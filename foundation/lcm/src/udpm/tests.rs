use super::*;

fn fragment(total: u32, offset: u32, number: u16, count: u16, rest: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::from(FRAGMENT_MAGIC.to_be_bytes());
    for word in [7, total, offset] {
        bytes.extend(word.to_be_bytes());
    }
    bytes.extend(number.to_be_bytes());
    bytes.extend(count.to_be_bytes());
    bytes.extend(rest);
    bytes
}

fn short(rest: &[u8]) -> Vec<u8> {
    [b"LC02\0\0\0\x07", rest].concat()
}

#[test]
fn what_is_too_short_for_a_header_is_refused() {
    for len in 0..8 {
        assert_eq!(decode(&short(b"")[..len]), Err(DecodeError::TooShort { len }));
    }
    let whole = fragment(1, 0, 1, 2, b"");
    for len in 8..20 {
        assert_eq!(decode(&whole[..len]), Err(DecodeError::TooShort { len }));
    }
    assert!(decode(&whole).is_ok());
}

#[test]
fn what_does_not_start_with_the_magic_is_refused() {
    assert_eq!(decode(b"LC04\0\0\0\0A\0"), Err(DecodeError::Magic(0x4c43_3034)));
}

#[test]
fn a_channel_name_ends_within_64_bytes_and_is_utf_8() {
    assert_eq!(decode(&short(b"")), Err(DecodeError::ChannelUnterminated));
    assert_eq!(decode(&short(&[b'c'; 63])), Err(DecodeError::ChannelUnterminated));
    assert_eq!(decode(&short(&[b'c'; 64])), Err(DecodeError::ChannelTooLong));
    assert_eq!(decode(&short(&[&[b'c'; 64][..], b"\0"].concat())), Err(DecodeError::ChannelTooLong));
    assert_eq!(decode(&short(b"\xff\0")), Err(DecodeError::ChannelNotUtf8));
    let name = "c".repeat(63);
    let longest = Short { sequence: 7, channel: &name, payload: b"" };
    assert_eq!(decode(&short(&[name.as_bytes(), b"\0"].concat())), Ok(Datagram::Short(longest)));
    let empty = Short { sequence: 7, channel: "", payload: b"x" };
    assert_eq!(decode(&short(b"\0x")), Ok(Datagram::Short(empty)));
}

#[test]
fn the_first_fragment_carries_the_channel_and_the_others_do_not() {
    let bytes = fragment(5, 0, 0, 2, b"BIG\0abc");
    let first = Fragment { sequence: 7, total: 5, offset: 0, number: 0, count: 2, channel: Some("BIG"), data: b"abc" };
    assert_eq!(decode(&bytes), Ok(Datagram::Fragment(first)));
    let bytes = fragment(5, 3, 1, 2, b"de");
    let second = Fragment { offset: 3, number: 1, channel: None, data: b"de", ..first };
    assert_eq!(decode(&bytes), Ok(Datagram::Fragment(second)));
    assert_eq!(decode(&fragment(5, 0, 0, 2, b"BIG")), Err(DecodeError::ChannelUnterminated));
}

#[test]
fn a_fragment_lies_within_its_message() {
    let beyond = |end, total| Err(DecodeError::BeyondEnd { end, total });
    assert_eq!(decode(&fragment(5, 3, 1, 2, b"def")), beyond(6, 5));
    // The datagram that kills liblcm 1.3.1: offset and length wrap in 32 bits.
    assert_eq!(decode(&fragment(100, u32::MAX - 1, 1, 2, b"abcd")), beyond(0x1_0000_0002, 100));
    assert_eq!(
        decode(&fragment(MESSAGE_MAX + 1, 0, 1, 2, b"")),
        Err(DecodeError::MessageTooLong { total: MESSAGE_MAX + 1 })
    );
    assert!(decode(&fragment(MESSAGE_MAX, 0, 1, 2, b"")).is_ok());
}

#[test]
fn a_fragment_is_one_of_those_announced() {
    let refused = |number, count| Err(DecodeError::FragmentNumber { number, count });
    assert_eq!(decode(&fragment(5, 0, 0, 0, b"A\0")), refused(0, 0));
    assert_eq!(decode(&fragment(5, 0, 2, 2, b"")), refused(2, 2));
}
