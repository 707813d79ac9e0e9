//! Chips that are known by their registers, and what the values in them mean.

use super::bus::Bus;
use super::target::Known;
use crate::Failed;
use ::i2c::max6615::fields::{
    Configuration, FanConfiguration, FanStatus, Frequency, Offsets, Rates, STOPPED, Steps, channels_from_bits, duty,
    rpm,
};
use ::i2c::max6615::{ADDRESSES, DEVICE, MANUFACTURER, REGISTERS, Register, find, register};

/// True if the chip identifies itself as a MAX6615.
pub fn is_max6615(bus: &mut Bus, chip: &Known) -> Result<bool, Failed> {
    if !ADDRESSES.contains(&chip.address.get()) {
        return Ok(false);
    }
    let maker = bus.byte(chip, register::MANUFACTURER)?;
    Ok(maker == Ok(MANUFACTURER) && bus.byte(chip, register::DEVICE)? == Ok(DEVICE))
}

/// The MAX6615's register of this name; words may be parted by `_` or `-`.
pub fn named(text: &str) -> Option<&'static Register> {
    let plain = |text: &str| text.replace(['_', '-', ',', ' '], "").to_ascii_lowercase();
    REGISTERS.iter().find(|register| plain(register.name) == plain(text))
}

/// Meaning of a value in a MAX6615's register; `None` if there is nothing to add.
pub fn meaning(register: u8, value: u8) -> Option<String> {
    let percent = |value| format!("{:.0} %", duty(value) * 100.0);
    Some(match register {
        register::TEMPERATURE | register::TEMPERATURE_2 | register::LIMIT | register::LIMIT_2 => format!("{value} °C"),
        register::START_TEMPERATURE | register::START_TEMPERATURE_2 => format!("{value} °C"),
        register::FRACTION | register::FRACTION_2 => format!("{:.3} °C", f64::from(value >> 5) / 8.0),
        register::OVER | register::OVER_MASK => match channels_from_bits(value) {
            [false, false] => "no channel".into(),
            [true, true] => "channels 1 and 2".into(),
            [first, _] => format!("channel {}", if first { 1 } else { 2 }),
        },
        register::START_DUTY
        | register::START_DUTY_2
        | register::MAXIMUM_DUTY
        | register::MAXIMUM_DUTY_2
        | register::TARGET_DUTY
        | register::TARGET_DUTY_2
        | register::DUTY
        | register::DUTY_2 => percent(value),
        register::TACH | register::TACH_2 if value == STOPPED => "stands".into(),
        register::TACH_LIMIT | register::TACH_LIMIT_2 if value == STOPPED => "not watched".into(),
        register::TACH | register::TACH_2 | register::TACH_LIMIT | register::TACH_LIMIT_2 => {
            format!("{:.0} rpm", rpm(value))
        }
        register::CONFIGURATION => configuration(Configuration::from_bits(value)),
        register::FAN_CONFIGURATION => fan_configuration(FanConfiguration::from_bits(value)),
        register::FAN_STATUS => fan_status(FanStatus::from_bits(value)),
        register::RATE => {
            let Rates(codes) = Rates::from_bits(value);
            let [one, two] = codes.map(|code| Rates::interval(code).as_secs_f64() * 1e3);
            format!("a step each {one} ms, {two} ms")
        }
        register::STEP => {
            let Steps([one, two]) = Steps::from_bits(value);
            format!("{one}/240, {two}/240 a degree step")
        }
        register::FREQUENCY => match Frequency::from_bits(value) {
            Frequency::Hz33 => "33 Hz".into(),
            Frequency::Khz35 => "35 kHz".into(),
            Frequency::Code(code) => format!("code {code}"),
        },
        register::OFFSET => {
            let Offsets([one, two]) = Offsets::from_bits(value);
            format!("{:+} °C, {:+} °C", 2 * one, 2 * two)
        }
        register::DEVICE if value == DEVICE => "MAX6615".into(),
        register::MANUFACTURER if value == MANUFACTURER => "Maxim".into(),
        _ => return None,
    })
}

/// Words of the flags that are set.
fn list(words: &[(bool, &str)]) -> String {
    words.iter().filter(|(is, _)| *is).map(|(_, word)| *word).collect::<Vec<_>>().join(", ")
}

fn configuration(is: Configuration) -> String {
    list(&[
        (is.standby, "standby"),
        (is.reset, "reset"),
        (is.timeout_off, "no SMBus timeout"),
        (is.invert[0], "PWM 1 inverted"),
        (is.invert[1], "PWM 2 inverted"),
        (is.minimum_duty, "start duty when cool"),
        (is.internal, "channel 2 internal"),
        (!is.internal, "channel 2 thermistor"),
        (is.spin_up_off, "no spin-up"),
    ])
}

fn fan_configuration(is: FanConfiguration) -> String {
    let follows = |follows: [bool; 2]| match follows {
        [false, false] => "manual",
        [true, false] => "follows 1",
        [false, true] => "follows 2",
        [true, true] => "follows 1 and 2",
    };
    let [one, two] = is.follows.map(follows);
    format!("fan 1 {one}, fan 2 {two}, hysteresis {} °C, step {} °C", is.hysteresis_c(), is.step_c())
}

fn fan_status(is: FanStatus) -> String {
    list(&[
        (is.failed == [false; 2], "no fan failed"),
        (is.failed[0], "fan 1 FAILED"),
        (is.failed[1], "fan 2 FAILED"),
        (is.tach_off[0], "tachometer 1 off"),
        (is.tach_off[1], "tachometer 2 off"),
        (is.full_only[0], "fan 1 measured at full speed"),
        (is.full_only[1], "fan 2 measured at full speed"),
        (is.pin_masked, "pin masked"),
        (is.alone, "a failed fan leaves the other alone"),
    ])
}

/// The name of a MAX6615's register, for people.
pub fn name(register: u8) -> &'static str {
    find(register).map_or("?", |register| register.name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_register_is_found_by_its_name_however_its_words_are_parted() {
        let address = |text| named(text).map(|register| register.address);
        assert_eq!(address("temperature 1"), Some(0x00));
        assert_eq!(address("target-duty-2"), Some(0x0C));
        assert_eq!(address("Fan_Status"), Some(0x1C));
        assert_eq!(address("temperature_1_fraction"), Some(0x1E));
        assert_eq!(address("temperature 3"), None);
    }

    #[test]
    fn every_value_of_every_register_has_a_meaning_or_none_and_no_panic() {
        for register in 0..=255 {
            (0..=255).for_each(|value| drop(meaning(register, value)));
        }
        assert_eq!(
            meaning(register::CONFIGURATION, 0x1E).unwrap(),
            "PWM 1 inverted, PWM 2 inverted, start duty when cool, channel 2 internal"
        );
        assert_eq!(
            meaning(register::FAN_CONFIGURATION, 0x2C).unwrap(),
            "fan 1 follows 1, fan 2 follows 1 and 2, hysteresis 5 °C, step 1 °C"
        );
        assert_eq!(meaning(register::FAN_STATUS, 0x40).unwrap(), "fan 2 FAILED");
        assert_eq!(meaning(register::DUTY, 0x60).unwrap(), "40 %");
        assert_eq!(meaning(register::TACH, 0x20).unwrap(), "1800 rpm");
        assert_eq!(meaning(register::OFFSET, 0x1F).unwrap(), "+2 °C, -2 °C");
        assert_eq!(meaning(0x1D, 0), None);
    }
}
