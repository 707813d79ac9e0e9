use super::*;

fn unhex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().chunks(2).map(|pair| str::from_utf8(pair).unwrap());
    digits.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect()
}

/// What a stream says that comes in pieces of `size` bytes, with payloads of at most 100.
fn said(from: Peer, stream: &[u8], size: usize) -> Vec<String> {
    let mut decoder = Decoder::new(from, 100);
    let mut said = Vec::new();
    for piece in stream.chunks(size) {
        decoder.push(piece);
        loop {
            let ready = decoder.is_ready();
            let message = decoder.next_message();
            assert_eq!(ready, message != Ok(None));
            match message {
                Ok(Some(Message::Publish { channel, payload, .. })) => said.push(format!("{channel} {payload:x?}")),
                Ok(Some(message)) => said.push(format!("{message:?}")),
                Ok(None) => break,
                Err(error) => {
                    assert_eq!(decoder.next_message(), Err(error), "said again");
                    said.push(error.to_string());
                    return said;
                }
            }
        }
    }
    said
}

/// What the official client wrote (`client`), or what it took (`hub`, `delivery`).
fn captured(name: &str) -> Vec<u8> {
    let lines = include_str!("../../tests/tcpq_vectors.txt").lines();
    let mut found = lines.filter_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    unhex(found.next().unwrap())
}

#[test]
fn a_stream_says_the_same_whatever_pieces_it_comes_in() {
    let stream = captured("client");
    for size in 1..=stream.len() {
        assert_eq!(
            said(Peer::Client, &stream, size),
            ["Hello { version: 256 }", "Subscribe(\"POSE.*\")", "POSE_A [de, ad, be, ef]", "Unsubscribe(\"POSE.*\")"]
        );
    }
    let stream = [captured("hub"), captured("delivery")].concat();
    for size in 1..=stream.len() {
        assert_eq!(said(Peer::Hub, &stream, size), ["Hello { version: 256 }", "POSE_A [1, 2, 3, 4]"]);
    }
}

#[test]
fn what_is_written_is_what_the_official_client_writes() {
    let publish = [publish_header("POSE_A", 4), unhex("deadbeef")].concat();
    let written = [hello(Peer::Client).to_vec(), subscribe("POSE.*"), publish, unsubscribe("POSE.*")].concat();
    assert_eq!(written, captured("client"));
    assert_eq!(hello(Peer::Hub), *captured("hub"));
}

#[test]
fn a_client_need_not_say_hello_but_a_hub_must() {
    assert_eq!(said(Peer::Client, &subscribe("A"), 5), ["Subscribe(\"A\")"]);
    let stream = [publish_header("A", 0), hello(Peer::Client).to_vec()].concat();
    assert_eq!(said(Peer::Client, &stream, 5), ["A []", "0x287617fb where a message must begin"]);
    assert_eq!(said(Peer::Hub, &publish_header("A", 0), 5), ["it begins with 0x00000001, not as an LCM hub"]);
    assert_eq!(said(Peer::Hub, b"HTTP/1.1 400", 5), ["it begins with 0x48545450, not as an LCM hub"]);
    let stream = [hello(Peer::Hub).to_vec(), subscribe("A")].concat();
    assert_eq!(said(Peer::Hub, &stream, 5)[1], "0x00000002 where a message must begin");
}

#[test]
fn a_name_that_nobody_can_use_is_skipped() {
    let long = "x".repeat(CHANNEL_MAX + 1);
    let stream = [
        publish_header(&long, 0),
        unhex("0000000100000001ff00000000"),
        unhex("0000000200000001ff"),
        publish_header(&long[1..], 0),
    ];
    assert_eq!(
        said(Peer::Client, &stream.concat(), 7),
        [
            "Unusable(ChannelTooLong { len: 64 })",
            "Unusable(NotUtf8)",
            "Unusable(NotUtf8)",
            &format!("{} []", &long[1..])
        ]
    );
}

#[test]
fn an_impossible_length_ends_the_stream_before_anything_is_kept_for_it() {
    assert_eq!(
        said(Peer::Client, &unhex("00000001ffffffff"), 1),
        ["a channel or pattern of 4294967295 bytes; at most 1024"]
    );
    assert_eq!(
        said(Peer::Client, &unhex("000000010000000141ffffffff"), 1),
        ["a message of 4294967295 bytes; at most 100"]
    );
    let mut decoder = Decoder::new(Peer::Client, 1 << 28);
    decoder.push(&publish_header("A", 1 << 28));
    assert_eq!(decoder.next_message(), Ok(None));
    assert!(decoder.buffer.capacity() < 1000);
}

#[test]
fn what_was_published_last_can_be_had_again() {
    let mut decoder = Decoder::new(Peer::Hub, 100);
    decoder.push(&captured("hub"));
    decoder.push(&captured("delivery"));
    assert_eq!(decoder.published(), None);
    while let Ok(Some(_)) = decoder.next_message() {}
    assert_eq!(decoder.published(), Some(("POSE_A", &[1, 2, 3, 4][..])));
    assert_eq!(decoder.waiting(), 0);
}
