//! The map and the fields against `docs/facts/robot.md` 2.3, typed from there.

mod chip;
mod driver;

use super::fields::*;
use super::{Access, REGISTERS, find};
use base::Duration;

/// Register, access, power-on value; `--` where the page names none. MAX6616 only: 15, 16.
const MAP: &str = "
    00 R --  01 R --  02 RW 18  03 RW 6E  04 RW 50  05 R --  06 RW 00  07 RW 60  08 RW 60  09 RW F0  0A RW F0
    0B RW 00  0C RW 00  0D R 00  0E R 00  0F RW 00  10 RW 00  11 RW 00  12 RW B4  13 RW 55  14 RW 40  15 RW --
    16 RW --  17 RW 00  18 R FF  19 R FF  1A RW FF  1B RW FF  1C RW 00  1E R --  1F R --  FD R 01  FE R 68  FF R 4D";

#[test]
fn the_register_map_is_that_of_the_facts() {
    let words: std::vec::Vec<&str> = MAP.split_whitespace().collect();
    assert_eq!(words.len(), REGISTERS.len() * 3);
    for (row, register) in words.chunks(3).zip(REGISTERS) {
        assert_eq!(u8::from_str_radix(row[0], 16), Ok(register.address));
        assert_eq!(row[1] == "RW", register.access == Access::ReadWrite, "{register:?}");
        assert_eq!(u8::from_str_radix(row[2], 16).ok(), register.power_on, "{register:?}");
        assert_eq!(find(register.address), Some(register));
        assert_eq!(register.power_on.unwrap_or(0) & !register.mask, 0, "{register:?}");
    }
    assert!([0x1D, 0x20, 0xFC].map(find).iter().all(Option::is_none));
}

#[test]
fn fields_are_the_bits_of_the_facts() {
    let bits = |text| u8::from_str_radix(text, 2).unwrap();
    let power_on = Configuration::from_bits(0x18);
    assert_eq!((power_on.invert, power_on.standby, power_on.spin_up_off), ([true, true], false, false));
    let off = Configuration::from_bits(0);
    let one = |text, configuration: Configuration| assert_eq!(configuration.bits(), bits(text), "{configuration:?}");
    one("10000000", Configuration { standby: true, ..off });
    one("01000000", Configuration { reset: true, ..off });
    one("00100000", Configuration { timeout_off: true, ..off });
    one("00010000", Configuration { invert: [true, false], ..off });
    one("00001000", Configuration { invert: [false, true], ..off });
    one("00000100", Configuration { minimum_duty: true, ..off });
    one("00000010", Configuration { internal: true, ..off });
    one("00000001", Configuration { spin_up_off: true, ..off });
    let fan = FanConfiguration::default();
    let one = |text, configuration: FanConfiguration| assert_eq!(configuration.bits(), bits(text), "{configuration:?}");
    one("10000000", FanConfiguration { hysteresis_10_c: true, ..fan });
    one("01000000", FanConfiguration { step_2_c: true, ..fan });
    one("00100000", FanConfiguration { follows: [[true, false], [false; 2]], ..fan });
    one("00010000", FanConfiguration { follows: [[false, true], [false; 2]], ..fan });
    one("00001000", FanConfiguration { follows: [[false; 2], [true, false]], ..fan });
    one("00000100", FanConfiguration { follows: [[false; 2], [false, true]], ..fan });
    let status = FanStatus::default();
    let one = |text, status: FanStatus| assert_eq!(status.bits(), bits(text), "{status:?}");
    one("10000000", FanStatus { failed: [true, false], ..status });
    one("01000000", FanStatus { failed: [false, true], ..status });
    one("00100000", FanStatus { tach_off: [true, false], ..status });
    one("00010000", FanStatus { tach_off: [false, true], ..status });
    one("00001000", FanStatus { full_only: [true, false], ..status });
    one("00000100", FanStatus { full_only: [false, true], ..status });
    one("00000010", FanStatus { pin_masked: true, ..status });
    one("00000001", FanStatus { alone: true, ..status });
    assert_eq!(Rates::from_bits(0xB4), Rates([5, 5]));
    assert_eq!(Rates([1, 7]).bits(), bits("00111100"));
    assert_eq!(Steps::from_bits(0x5A), Steps([5, 10]));
    assert_eq!(Frequency::from_bits(0x40), Frequency::Hz33);
    assert_eq!(Frequency::from_bits(0xE0), Frequency::Khz35);
    assert_eq!(Offsets::from_bits(0x7F), Offsets([7, -1]));
    assert_eq!(Offsets::from_bits(0x81), Offsets([-8, 1]));
}

#[test]
fn every_value_of_every_field_is_the_same_written_and_read_again() {
    for bits in 0..=255u8 {
        assert_eq!(Configuration::from_bits(bits).bits(), bits);
        assert_eq!(FanConfiguration::from_bits(bits).bits(), bits & 0xFC);
        assert_eq!(Rates::from_bits(bits).bits(), bits & 0xFC);
        assert_eq!(Steps::from_bits(bits).bits(), bits);
        assert_eq!(Frequency::from_bits(bits).bits(), bits & 0xE0);
        assert_eq!(Offsets::from_bits(bits).bits(), bits);
        assert_eq!(FanStatus::from_bits(bits).bits(), bits);
        assert_eq!(channels_bits(channels_from_bits(bits)), bits & 0xC0);
        assert_eq!(duty_bits(duty(bits)), bits.min(240));
        let eighths = temperature_c(bits, 0xA0);
        assert_eq!(temperature_bits(eighths), (bits, 0xA0));
    }
    // What is out of range is cut off, not wrapped.
    assert_eq!((Rates([9, 200]).bits(), Steps([16, 255]).bits(), Frequency::Code(9).bits()), (0xFC, 0xFF, 0xE0));
}

#[test]
fn quantities_are_those_of_the_facts() {
    assert_eq!([temperature_c(0x19, 0x80), temperature_c(0, 0x20), temperature_c(255, 0xE0)], [25.5, 0.125, 255.875]);
    assert_eq!(temperature_bits(-5.0), (0, 0));
    assert_eq!(temperature_bits(f64::NAN), (0, 0));
    assert_eq!(temperature_bits(1e9), (255, 0xE0));
    assert_eq!((duty_bits(0.2), duty_bits(0.4), duty_bits(1.0)), (48, 0x60, 0xF0));
    assert_eq!((duty_bits(-1.0), duty_bits(9.0), duty_bits(f64::NAN)), (0, 240, 0));
    assert_eq!((rpm(24), rpm(0xFF), rpm(0)), (2400.0, 0.0, 0.0));
    assert_eq!((count(2400.0), count(100.0), count(0.0), count(1e9)), (24, 255, 255, 1));
    // B4h: a second between steps; from 33 % to full in 5 s at the fastest rate, 320 s at the slowest.
    assert_eq!(Rates::interval(5), Duration::from_secs(1));
    assert_eq!(Rates::interval(1) * 80, Duration::from_secs(5));
    assert_eq!(Rates::interval(7) * 80, Duration::from_secs(320));
    assert_eq!(Rates::interval(0), Duration::ZERO);
}
