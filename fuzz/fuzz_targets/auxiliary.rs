//! What comes to the auxiliary modules' ports from outside: datagrams on the simulator's I2C socket, the files of 1-Wire
//! thermometers. What is understood is the same when it is written again, and no number is out of a thermometer's range.
#![no_main]
use base::i2c::codec;
use host::ports::w1_read;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Some(transfer) = codec::parse_transfer(bytes) {
        assert_eq!(codec::transfer(&transfer), bytes);
    }
    if let Some(outcome) = codec::parse_outcome(bytes) {
        assert_eq!(codec::outcome(&outcome), bytes);
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        for said in [w1_read::slave(text), w1_read::number(text)].into_iter().flatten() {
            assert!((-55_000..=125_000).contains(&said));
        }
    }
});
