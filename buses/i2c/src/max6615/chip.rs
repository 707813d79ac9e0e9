//! The other end: a MAX6615 with two fans, by `docs/facts/robot.md` 2.3 and the data sheet. For the simulator and for
//! tests.
//!
//! Assumed, where no source exists: conversions every 500 ms, fan measurements every second, a fan follows its duty
//! with a lag of half a second; a register that is not in the map reads 00, and so does the GPIO of the MAX6616.

use super::fields::{
    Configuration, DUTY_FULL, FanConfiguration, FanStatus, Frequency, Offsets, Rates, STOPPED, Steps, channels_bits,
    channels_from_bits, count, temperature_bits,
};
use super::{Access, find, register};
use crate::target::Target;
use base::i2c::Address;
use base::{Duration, Instant};

/// The finest rate of change of a duty.
const TICK: Duration = Duration::from_micros(62_500);
const CONVERSION: u8 = 8;
const MEASUREMENT: u8 = 16;
/// Full drive at a start from zero, and after a failed measurement: 2 s.
const FULL_DRIVE: u8 = 32;
/// After ten minutes without a call everything has settled.
const CATCH_UP: Duration = Duration::from_secs(600);

/// The chip. Time is handed to [`advance`](Self::advance); transfers come by [`Target`].
#[derive(Clone, Debug)]
pub struct Chip {
    address: Address,
    registers: [u8; 0x20],
    /// The register that is read, and whether this write named one yet.
    pointer: u8,
    pointed: bool,
    next: Instant,
    /// Ticks of this second.
    ticks: u8,
    /// True temperatures of both channels, °C.
    temperature_c: [f64; 2],
    /// The temperature at which an automatic duty was last computed, in whole degrees.
    peak: [u8; 2],
    /// True if status and temperature were read since a limit was passed; both clear the status.
    seen: [[bool; 2]; 2],
    fans: [Turning; 2],
}

/// A fan and what drives it.
#[derive(Clone, Copy, Debug)]
struct Turning {
    maximum_rpm: f64,
    rpm: f64,
    stalled: bool,
    /// Driven with, in 240ths.
    duty: u8,
    /// Ticks since its last step.
    waited: u8,
    /// Ticks of full drive that are left.
    full: u8,
    /// The full drive that is left is to be followed by a measurement that decides.
    suspect: bool,
}

impl Chip {
    /// A chip at power-on, at 20 C, with fans of this speed at full duty.
    #[must_use]
    pub fn new(address: Address, maximum_rpm: [f64; 2]) -> Self {
        let fan = |maximum_rpm| Turning {
            maximum_rpm,
            rpm: 0.0,
            stalled: false,
            duty: 0,
            waited: 0,
            full: 0,
            suspect: false,
        };
        let mut chip = Self {
            address,
            registers: [0; 0x20],
            pointer: 0,
            pointed: false,
            next: Instant::ZERO + TICK,
            ticks: 0,
            temperature_c: [20.0; 2],
            peak: [0; 2],
            seen: [[false; 2]; 2],
            fans: maximum_rpm.map(fan),
        };
        chip.reset();
        chip
    }

    /// Loss of supply and its return, or the reset bit: registers are at power-on, the fans run down.
    pub fn reset(&mut self) {
        for (address, value) in (0u8..).zip(&mut self.registers) {
            *value = find(address).and_then(|register| register.power_on).unwrap_or(0);
        }
        (self.pointer, self.peak, self.seen) = (0, [0; 2], [[false; 2]; 2]);
        for fan in &mut self.fans {
            (fan.duty, fan.waited, fan.full, fan.suspect) = (0, 0, 0, false);
        }
        self.convert();
    }

    /// Sets the true temperature of channel 0 or 1, °C.
    pub fn set_temperature(&mut self, channel: usize, c: f64) {
        self.temperature_c[channel] = c;
    }

    /// Fan 0 or 1 is held, or let go.
    pub fn set_stalled(&mut self, fan: usize, stalled: bool) {
        self.fans[fan].stalled = stalled;
    }

    /// Speed of fan 0 or 1.
    #[must_use]
    pub fn rpm(&self, fan: usize) -> f64 {
        self.fans[fan].rpm
    }

    /// Over-temperature pin: true while it is asserted.
    #[must_use]
    pub fn over(&self) -> bool {
        self.at(register::OVER) & !self.at(register::OVER_MASK) != 0
    }

    /// Level of the fan-failure pin: true while it is asserted.
    #[must_use]
    pub fn fan_fail(&self) -> bool {
        let status = self.fan_status();
        status.failed != [false; 2] && !status.pin_masked
    }

    /// Instant of its next action.
    #[must_use]
    pub fn poll_timeout(&self) -> Instant {
        self.next
    }

    /// Time goes on.
    pub fn advance(&mut self, now: Instant) {
        if now.since(self.next) > CATCH_UP {
            self.next = now - CATCH_UP;
        }
        while self.next <= now {
            self.next += TICK;
            self.tick();
        }
    }

    /// A register, as a master reads it; reading status and temperature clears what it does in the chip.
    pub fn read_register(&mut self, address: u8) -> u8 {
        match address {
            register::REVISION | register::DEVICE | register::MANUFACTURER => {
                find(address).and_then(|register| register.power_on).unwrap_or(0)
            }
            register::GPIO_FUNCTION | register::GPIO_VALUE => 0,
            0..0x20 => {
                let value = self.at(address);
                self.note_read(address);
                value
            }
            _ => 0,
        }
    }

    /// A register, as a master writes it: read-only ones and bits that there are not keep what they have.
    pub fn write_register(&mut self, address: u8, value: u8) {
        let Some(row) = find(address).filter(|row| row.access == Access::ReadWrite) else { return };
        let value = value & row.mask;
        match address {
            register::GPIO_FUNCTION | register::GPIO_VALUE => {}
            register::CONFIGURATION if Configuration::from_bits(value).reset => self.reset(),
            register::TARGET_DUTY | register::TARGET_DUTY_2 => {
                let fan = usize::from(address - register::TARGET_DUTY);
                // In automatic control the register is the chip's own.
                if self.fan_configuration().follows[fan] == [false; 2] {
                    self.put(address, value.min(DUTY_FULL));
                    self.drive(fan);
                }
            }
            // Failures follow from the last measurement; a fan that is not measured has not failed.
            register::FAN_STATUS => {
                let failed = self.fan_status().failed;
                let written = FanStatus::from_bits(value);
                let failed = [0, 1].map(|fan| failed[fan] && !written.tach_off[fan]);
                self.put(address, FanStatus { failed, ..written }.bits());
            }
            _ => self.put(address, value),
        }
        if matches!(address, register::FAN_CONFIGURATION | register::START_TEMPERATURE | register::START_TEMPERATURE_2)
        {
            self.peak = [0; 2];
        }
    }

    fn note_read(&mut self, address: u8) {
        let over = channels_from_bits(self.at(register::OVER));
        for channel in 0..2 {
            let seen = &mut self.seen[channel];
            seen[0] |= address == register::OVER && over[channel];
            seen[1] |= usize::from(address) == channel && over[channel];
            if *seen == [true; 2] {
                *seen = [false; 2];
                let left = [0, 1].map(|other| over[other] && other != channel);
                self.put(register::OVER, self.at(register::OVER) & channels_bits(left));
            }
        }
    }

    fn at(&self, address: u8) -> u8 {
        self.registers[usize::from(address)]
    }

    fn put(&mut self, address: u8, value: u8) {
        self.registers[usize::from(address)] = value;
    }

    fn configuration(&self) -> Configuration {
        Configuration::from_bits(self.at(register::CONFIGURATION))
    }

    fn fan_configuration(&self) -> FanConfiguration {
        FanConfiguration::from_bits(self.at(register::FAN_CONFIGURATION))
    }

    fn fan_status(&self) -> FanStatus {
        FanStatus::from_bits(self.at(register::FAN_STATUS))
    }

    fn tick(&mut self) {
        self.ticks = (self.ticks + 1) % MEASUREMENT;
        let standby = self.configuration().standby;
        if !standby && self.ticks.is_multiple_of(CONVERSION) {
            self.convert();
        }
        for fan in 0..2 {
            self.slew(fan);
            let duty = if standby { 0 } else { self.fans[fan].duty };
            self.put(register::DUTY + fan as u8, duty);
            self.fans[fan].turn(duty);
        }
        for fan in 0..2 {
            self.measure(fan);
        }
    }

    /// Converts both temperatures, and updates limits and automatic duties.
    fn convert(&mut self) {
        let offsets = Offsets::from_bits(self.at(register::OFFSET)).0;
        let internal = self.configuration().internal;
        let mut over = channels_from_bits(self.at(register::OVER));
        for channel in 0..2u8 {
            let n = usize::from(channel);
            // An offset belongs to a thermistor.
            let offset = if channel == 1 && internal { 0 } else { offsets[n] };
            let (whole, fraction) = temperature_bits(self.temperature_c[n] + 2.0 * f64::from(offset));
            self.put(register::TEMPERATURE + channel, whole);
            self.put(register::FRACTION + channel, fraction);
            over[n] |= whole > self.at(register::LIMIT + channel);
        }
        self.put(register::OVER, channels_bits(over));
        let hysteresis = self.fan_configuration().hysteresis_c();
        for channel in 0..2u8 {
            let (peak, now) = (&mut self.peak[usize::from(channel)], self.registers[usize::from(channel)]);
            // A small fall changes nothing.
            if now > *peak || now <= peak.saturating_sub(hysteresis) {
                *peak = now;
            }
        }
        for fan in 0..2 {
            let wanted = (0..2).filter(|channel| self.fan_configuration().follows[fan][*channel]);
            if let Some(duty) = wanted.map(|channel| self.automatic(fan, channel)).max() {
                self.put(register::TARGET_DUTY + fan as u8, duty);
                self.drive(fan);
            }
        }
    }

    /// Duty that a channel demands of a fan.
    fn automatic(&self, fan: usize, channel: usize) -> u8 {
        let n = fan as u8;
        let start = self.at(register::START_DUTY + n).min(DUTY_FULL);
        let maximum = self.at(register::MAXIMUM_DUTY + n).min(DUTY_FULL);
        let above = self.peak[channel].checked_sub(self.at(register::START_TEMPERATURE + channel as u8));
        let step = Steps::from_bits(self.at(register::STEP)).0[fan];
        let duty = match above {
            None if self.configuration().minimum_duty => u16::from(start),
            None => 0,
            Some(above) => u16::from(start) + u16::from(above / self.fan_configuration().step_c()) * u16::from(step),
        };
        duty.min(u16::from(maximum)) as u8
    }

    /// A fan that is to start from zero gets full drive first.
    fn drive(&mut self, fan: usize) {
        let target = self.target(fan);
        let spin_up_off = self.configuration().spin_up_off;
        let turning = &mut self.fans[fan];
        if turning.duty == 0 && target > 0 && !spin_up_off {
            (turning.full, turning.duty) = (FULL_DRIVE, DUTY_FULL);
        }
    }

    /// Target of the duty, in steps of the frequency.
    fn target(&self, fan: usize) -> u8 {
        let resolution = match Frequency::from_bits(self.at(register::FREQUENCY)) {
            Frequency::Khz35 => 4,
            Frequency::Hz33 | Frequency::Code(_) => 2,
        };
        let target = self.at(register::TARGET_DUTY + fan as u8);
        target - target % resolution
    }

    fn slew(&mut self, fan: usize) {
        let status = self.fan_status();
        let helps = !status.alone && status.failed[1 - fan];
        let target = if helps { DUTY_FULL } else { self.target(fan) };
        let code = Rates::from_bits(self.at(register::RATE)).0[fan];
        let ticks = if code == 0 { 0 } else { 1u8 << (code - 1) };
        let turning = &mut self.fans[fan];
        if turning.full > 0 {
            turning.duty = DUTY_FULL;
            turning.full -= 1;
            turning.waited = 0;
            return;
        }
        turning.waited = turning.waited.saturating_add(1);
        match () {
            () if helps || ticks == 0 => turning.duty = target,
            () if turning.duty == target => turning.waited = 0,
            () if turning.waited < ticks => {}
            () => {
                turning.waited = 0;
                let step = turning.duty.abs_diff(target).min(2);
                turning.duty = if turning.duty < target { turning.duty + step } else { turning.duty - step };
            }
        }
    }

    fn measure(&mut self, fan: usize) {
        let (n, status) = (fan as u8, self.fan_status());
        let turning = &mut self.fans[fan];
        let decides = turning.suspect && turning.full == 0;
        let due = self.ticks == 0 && turning.full == 0;
        // A fan that is not to turn has not failed.
        let off = status.tach_off[fan] || self.registers[usize::from(register::DUTY + n)] == 0;
        if off {
            turning.suspect = false;
            if due {
                self.put(register::TACH + n, STOPPED);
                self.set_failed(fan, false);
            }
            return;
        }
        if !(due || decides) || status.full_only[fan] && turning.duty < DUTY_FULL && !decides {
            return;
        }
        let counted = count(turning.rpm);
        let slow = counted > self.registers[usize::from(register::TACH_LIMIT + n)];
        // Slow once: two seconds of full drive, then another look.
        let drive = slow && !turning.suspect && !status.failed[fan];
        if drive {
            turning.full = FULL_DRIVE;
        }
        turning.suspect = drive;
        self.put(register::TACH + n, counted);
        if !drive {
            self.set_failed(fan, slow);
        }
    }

    fn set_failed(&mut self, fan: usize, failed: bool) {
        let mut status = self.fan_status();
        status.failed[fan] = failed;
        self.put(register::FAN_STATUS, status.bits());
    }
}

impl Turning {
    /// One tick with this duty: the speed approaches its proportional value by an eighth, and finally reaches it.
    fn turn(&mut self, duty: u8) {
        let wanted = if self.stalled { 0.0 } else { self.maximum_rpm * f64::from(duty) / f64::from(DUTY_FULL) };
        let way = wanted - self.rpm;
        self.rpm = if way.abs() < 1.0 { wanted } else { self.rpm + way / 8.0 };
    }
}

impl Target for Chip {
    fn start(&mut self, address: Address, read: bool) -> bool {
        self.pointed = read;
        address == self.address
    }

    /// Write byte, send byte: a register's address, then one value.
    fn write(&mut self, byte: u8) -> bool {
        if self.pointed {
            self.write_register(self.pointer, byte);
        } else {
            (self.pointer, self.pointed) = (byte, true);
        }
        true
    }

    /// Read byte, receive byte: always the register that was last named.
    fn read(&mut self) -> u8 {
        self.read_register(self.pointer)
    }

    fn stop(&mut self) {}
}
