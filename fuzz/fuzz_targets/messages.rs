//! A payload on every channel. What decodes must encode to the same bytes.
#![no_main]
use messages::{Channel, Message};

libfuzzer_sys::fuzz_target!(|input: (usize, Vec<u8>)| {
    let channel = Channel::ALL[input.0 % Channel::ALL.len()];
    // The fingerprint is right, or nothing behind it would ever be reached.
    let mut bytes = channel.fingerprint().to_be_bytes().to_vec();
    bytes.extend(input.1);
    if let Ok(message) = Message::decode(channel, &bytes) {
        let mut again = Vec::new();
        message.encode(&mut again).expect("what was decoded can be encoded");
        // A boolean may come as any byte that is not zero, and leaves as one.
        assert_eq!(again.len(), bytes.len());
    }
});
