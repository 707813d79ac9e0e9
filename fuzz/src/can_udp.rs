//! Codec of the virtual CAN bus over UDP.

use base::can::{Frame, Id};
use host::ports::can_udp_codec::{DATAGRAM_MAX, decode, encode};

/// A datagram of the virtual CAN bus: arbitrary, or an encoded frame with bytes changed and cut off.
///
/// A frame that is decoded survives encoding and decoding.
pub fn can_udp(data: &[u8]) {
    let Some(input) = crate::input::<(Option<(u32, [u8; 8], u8)>, Vec<(u8, u8)>, u8, Vec<u8>)>(data) else { return };
    let (frame, changes, cut, mut datagram) = input;
    if let Some((id, data, len)) = frame {
        let id = if len & 0x80 == 0 { Id::Standard(id as u16 & 0x7FF) } else { Id::Extended(id & 0x1FFF_FFFF) };
        let frame = match len & 0x40 {
            0 => Frame::new(id, &data[..usize::from(len % 9)]),
            _ => Frame::remote(id, len % 9),
        };
        let frame = frame.expect("in range");
        encode(&frame, 0.0, &mut datagram);
        assert!(datagram.len() <= DATAGRAM_MAX);
        assert_eq!(decode(&datagram).expect("our own"), frame);
        for (at, byte) in changes {
            let at = usize::from(at) % datagram.len();
            datagram[at] = byte;
        }
        datagram.truncate(datagram.len() - usize::from(cut) % datagram.len());
    }
    if let Ok(frame) = decode(&datagram) {
        let mut again = Vec::new();
        encode(&frame, 0.0, &mut again);
        assert_eq!(decode(&again).expect("our own"), frame);
    }
}
