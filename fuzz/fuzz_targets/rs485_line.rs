//! Bytes of a two-byte line, through the master and a slave.
#![no_main]
use base::{Duration, Instant};
use rs485::crc::Crc8;
use rs485::reader::Reader;
use rs485::transport::TwoByte;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let mut transport = TwoByte::default();
    let mut master = Reader::new(Crc8::SAE_J1850, None);
    let mut slave = Reader::new(Crc8::SAE_J1850, Some(Duration::from_millis(5)));
    for (n, byte) in bytes.iter().enumerate() {
        if let Some(word) = transport.decode(*byte) {
            let at = Instant::from_millis(n as u64);
            let _ = master.push(at, word);
            let _ = slave.push(at, word);
        }
    }
});
