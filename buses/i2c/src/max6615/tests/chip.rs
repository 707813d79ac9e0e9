//! The emulated chip against what `docs/facts/robot.md` 2.3 and the data sheet say, as transcripts.

use crate::max6615::chip::Chip;
use crate::max6615::{ADDRESS, Access, REGISTERS};
use crate::testing::{Random, address};
use base::{Duration, Instant};

/// Lines of time in s and what is done: `w REG VALUE`, `r REG VALUE` (expected), `c CHANNEL C`, `stall FAN`, `free
/// FAN`, `pins OVER FAIL`, `off` (loss of supply). Channels and fans are 1 and 2, registers hexadecimal.
fn check(script: &str) {
    let mut chip = Chip::new(address(ADDRESS), [2400.0; 2]);
    for line in script.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let line = line.split('#').next().unwrap();
        let words: std::vec::Vec<&str> = line.split_whitespace().collect();
        let at: f64 = words[0].parse().unwrap();
        chip.advance(Instant::ZERO + Duration::from_secs_f64(at));
        let hex = |n: usize| u8::from_str_radix(words[n], 16).unwrap();
        let which = |n: usize| words[n].parse::<usize>().unwrap() - 1;
        match words[1] {
            "w" => chip.write_register(hex(2), hex(3)),
            "r" => assert_eq!(chip.read_register(hex(2)), hex(3), "{line}"),
            "c" => chip.set_temperature(which(2), words[3].parse().unwrap()),
            "stall" => chip.set_stalled(which(2), true),
            "free" => chip.set_stalled(which(2), false),
            "pins" => assert_eq!((chip.over(), chip.fan_fail()), (words[2] == "1", words[3] == "1"), "{line}"),
            "off" => chip.reset(),
            other => panic!("{other}"),
        }
    }
}

#[test]
fn at_power_on_registers_have_their_values_and_the_fans_stand() {
    let mut chip = Chip::new(address(ADDRESS), [2400.0; 2]);
    for register in REGISTERS {
        let expected = match register.address {
            0x00 | 0x01 => 20,
            _ => register.power_on.unwrap_or(0),
        };
        assert_eq!(chip.read_register(register.address), expected, "{register:?}");
    }
    check("5 r 0D 00\n 5 r 18 FF\n 5 r 1C 00\n 5 pins 0 0");
}

#[test]
fn read_only_registers_and_bits_that_there_are_not_cannot_be_written() {
    for register in REGISTERS {
        for value in [0x00, 0xFF, 0xA5] {
            let mut chip = Chip::new(address(ADDRESS), [2400.0; 2]);
            let before = chip.read_register(register.address);
            chip.write_register(register.address, value);
            let expected = match (register.address, register.access) {
                (_, Access::Read) => before,
                // A MAX6615 has no GPIO; a reset brings the power-on value; full duty is 240; failures are the chip's.
                (0x15 | 0x16, _) => 0,
                (0x02, _) if value & 0x40 != 0 => 0x18,
                (0x0B | 0x0C, _) => value.min(240),
                (0x1C, _) => value & 0x3F,
                _ => value & register.mask,
            };
            assert_eq!(chip.read_register(register.address), expected, "{register:?} {value:02x}");
        }
    }
}

#[test]
fn temperatures_have_eighths_and_end_at_zero() {
    check(
        "0 c 1 25.5
         0 c 2 -3
         0.4 r 00 14      # not converted yet
         0.5 r 00 19
         0.5 r 1E 80
         0.5 r 01 00
         0.5 r 1F 00
         1 c 2 36.875
         1.5 r 01 24
         1.5 r 1F E0",
    );
}

#[test]
fn an_offset_moves_a_thermistor_and_not_the_chip_itself() {
    check(
        "0 c 1 30
         0 c 2 30
         0 w 17 3F        # +6 C, -2 C
         0.5 r 00 24
         0.5 r 01 1C
         0.5 w 02 1A      # channel 2: the chip itself
         1 r 01 1E",
    );
}

#[test]
fn a_fan_starts_with_two_seconds_of_full_drive_and_comes_down_at_its_rate() {
    check(
        "0 w 12 24         # 62.5 ms a step
         0 w 0B 30         # 20 %
         0.0625 r 0D F0
         1.9375 r 0D F0
         2 r 0D F0
         2.0625 r 0D EE
         2.125 r 0D EC
         5 r 0D 90
         8 r 0D 30
         20 r 0D 30
         20 r 18 78        # 480 rpm
         20 r 0E 00
         20 r 1C 00",
    );
}

#[test]
fn without_spin_up_a_fan_climbs_from_zero() {
    check(
        "0 w 02 19
         0 w 12 B4         # a second a step
         0 w 0B 30
         0.9375 r 0D 00
         1 r 0D 02
         2 r 0D 04
         24 r 0D 30
         30 r 0D 30",
    );
    check(
        "0 w 02 19
         0 w 12 00         # at once
         0 w 0C 31         # an odd duty rounds down
         0.0625 r 0E 30
         1 w 0C FF
         1 r 0C F0         # full is 240
         1.0625 r 0E F0
         2 w 14 E0         # 35 kHz: fourths
         2 w 0C 36
         2.0625 r 0E 34",
    );
}

#[test]
fn a_stalled_fan_gets_full_drive_once_and_then_counts_as_failed() {
    check(
        "0 w 02 19
         0 w 12 00
         0 w 0B 60
         0 w 0C 60
         0 w 1A 80         # below 450 rpm
         0 w 1B 80
         5 r 18 3C         # 960 rpm
         5 r 1C 00
         5 pins 0 0
         5.5 stall 1
         7 r 0D F0         # measured slow at 6 s: full drive
         7 r 1C 00
         7.9375 r 1C 00
         8.0625 r 1C 80
         12 r 18 FF
         12 r 1C 80
         12 pins 0 1
         12 r 0D 60
         12 r 0E F0        # the other helps
         13 free 1
         17 r 1C 00
         17 r 18 3C
         17 r 0E 60
         17 pins 0 0",
    );
}

#[test]
fn fan_status_bits_do_what_they_say() {
    // The other is left alone; the pin is masked.
    check(
        "0 w 02 19\n 0 w 12 00\n 0 w 0B 60\n 0 w 0C 60\n 0 w 1A 80\n 0 w 1C 03\n 1 stall 1\n 9 r 1C 83\n 9 r 0E 60\n 9 pins 0 0",
    );
    // The tachometer is off.
    check("0 w 02 19\n 0 w 12 00\n 0 w 0B 60\n 0 w 1A 80\n 0 w 1C 20\n 1 stall 1\n 9 r 1C 20\n 9 r 18 FF");
    // Measured at full duty only.
    check("0 w 02 19\n 0 w 12 00\n 0 w 0B 60\n 0 w 1A 80\n 0 w 1C 08\n 1 stall 1\n 9 r 1C 08\n 9 w 0B F0\n 16 r 1C 88");
    // A fan that is not to turn has not failed.
    check("0 w 1A 80\n 0 stall 1\n 9 r 1C 00");
}

#[test]
fn the_limit_status_stays_until_status_and_temperature_were_read() {
    check(
        "0 w 03 1E         # 30 C
         0 c 1 30
         1 r 05 00         # not above it
         1 c 1 31
         1.5 pins 1 0
         1.5 r 05 80
         1.5 r 05 80       # the temperature was not read
         1.5 r 00 1F
         1.5 r 05 00
         1.5 pins 0 0
         2 r 05 80         # still too warm at the next conversion
         2 c 1 20
         3 r 05 80
         3 r 00 14
         3 r 05 00
         4 r 05 00
         4 w 06 80         # masked: the status is set, the pin is quiet
         4 c 1 99
         5 pins 0 0
         5 r 05 80",
    );
}

#[test]
fn an_automatic_fan_follows_its_channel_with_hysteresis() {
    check(
        "0 w 02 19
         0 w 12 00
         0 w 0F 1E         # from 30 C
         0 w 07 60         # 40 %
         0 w 13 55         # 5/240 a degree
         0 w 11 20         # fan 1 follows channel 1
         0 w 0B F0         # is the chip's now
         0 c 1 29.9
         1 r 0B 00
         1 r 0D 00
         1 c 1 30
         2 r 0B 60
         2 c 1 37
         3 r 0B 83         # 96 + 7 x 5
         3 r 0D 82
         3 c 1 33
         4 r 0B 83         # 4 C less
         4 c 1 32
         5 r 0B 6A         # 5 C less
         5 c 1 90
         6 r 0B F0
         6 w 09 B4         # at most 75 %
         7 r 0B B4
         7 w 11 60         # 2 C a step
         8 c 1 20
         9 r 0B 00
         9 c 1 40
         10 r 0B 79        # 96 + 5 x 5
         10 w 02 1D        # minimum duty
         10 c 1 10
         11 r 0B 60
         11 w 11 00        # manual again
         11 w 0B 30
         12 r 0D 30",
    );
}

#[test]
fn of_two_channels_the_one_that_wants_more_wins() {
    check(
        "0 w 02 19
         0 w 12 00
         0 w 0F 1E
         0 w 10 1E
         0 w 11 0C         # fan 2 follows both
         0 c 1 35
         0 c 2 40
         1 r 0C 92         # 96 + 10 x 5
         1 r 0B 00
         1 c 1 45
         2 r 0C AB",
    );
}

#[test]
fn reset_and_loss_of_supply_bring_everything_to_power_on() {
    let set = "0 w 02 19\n 0 w 0B 60\n 0 w 03 20\n 5 r 0B 60\n";
    for reset in ["5 w 02 58", "5 off"] {
        check(&std::format!("{set}{reset}\n 5 r 02 18\n 5 r 0B 00\n 5 r 03 6E\n 6 r 0D 00\n 9 r 18 FF"));
    }
}

#[test]
fn standby_stops_conversions_and_fans() {
    check(
        "0 w 02 19\n 0 w 12 00\n 0 w 0B 60\n 3 w 02 99\n 3 c 1 77\n 6 r 00 14\n 6 r 0D 00\n 9 r 18 FF\n 9 w 02 19\n 11 r 00 4D\n 11 r 0D 60",
    );
}

#[test]
fn whatever_is_written_and_read_whenever_a_duty_is_a_duty() {
    let mut random = Random::new(3);
    let (mut chip, mut now) = (Chip::new(address(ADDRESS), [2400.0, 0.0]), Instant::ZERO);
    for _ in 0..20_000 {
        match random.below(6) {
            0 => chip.set_temperature(random.below(2) as usize, random.next() as f64 / 1e12 - 50.0),
            1 => chip.set_stalled(random.below(2) as usize, random.below(2) == 0),
            2 => {
                let longest = if random.below(100) == 0 { 10_000_000 } else { 3000 };
                now += Duration::from_millis(random.below(longest));
            }
            _ => chip.write_register(random.next() as u8, random.next() as u8),
        }
        chip.advance(now);
        assert!(chip.poll_timeout() > now);
        for fan in 0..2 {
            assert!(chip.read_register(0x0D + fan) <= 240);
            assert!((0.0..=2400.0).contains(&chip.rpm(usize::from(fan))));
        }
        chip.read_register(random.next() as u8);
    }
}
