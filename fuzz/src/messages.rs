//! Messages of the robot: decoding and encoding.

use messages::{Channel, Message};

/// A payload on one of the robot's channels; the first byte selects the channel.
///
/// What decodes encodes to the same number of bytes.
pub fn messages(data: &[u8]) {
    let Some(input) = crate::input::<(u8, &[u8])>(data) else { return };
    let channel = Channel::ALL[usize::from(input.0) % Channel::ALL.len()];
    // The fingerprint is right, or nothing behind it would ever be reached.
    let mut bytes = channel.fingerprint().to_be_bytes().to_vec();
    bytes.extend(input.1);
    if let Ok(message) = Message::decode(channel, &bytes) {
        let mut again = Vec::new();
        message.encode(&mut again).expect("what was decoded can be encoded");
        // A boolean may come as any byte that is not zero, and leaves as one.
        assert_eq!(again.len(), bytes.len());
    }
}
