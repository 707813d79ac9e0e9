//! Texts of kernel interfaces: I2C bridges and 1-Wire slaves.

use base::i2c::codec;
use host::ports::w1_read;

/// Datagrams of the simulator's I2C socket, and files of 1-Wire thermometers.
///
/// What is parsed encodes to the same bytes; a temperature is within the thermometer's range.
pub fn auxiliary(bytes: &[u8]) {
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
}
