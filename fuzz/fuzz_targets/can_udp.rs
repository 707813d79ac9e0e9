//! A datagram on the virtual CAN bus.
#![no_main]
use robot::live::ports::can_udp_codec::{decode, encode};

libfuzzer_sys::fuzz_target!(|datagram: &[u8]| {
    if let Ok(frame) = decode(datagram) {
        let mut again = Vec::new();
        encode(&frame, 0.0, &mut again);
        assert_eq!(decode(&again).expect("our own"), frame);
    }
});
