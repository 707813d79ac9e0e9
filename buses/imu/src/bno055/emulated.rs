//! A BNO055 on its bus.

use super::register::*;
use super::*;
use crate::emulated::{Body, Faults, digits};
use base::Instant;
use base::i2c::{Address, Bytes, Error, Outcome, Read, Transfer};

/// Time from the supply to the first answer (data sheet, table 0-2).
const POWER_ON: Duration = Duration::from_millis(400);
/// Registers of page 0.
const REGISTERS: usize = 0x80;
/// Value of the error register of an emulated error: 3, "self test result failed" (data sheet, 4.3.59).
const ERROR: u8 = 3;

#[derive(Debug)]
pub(crate) struct Chip {
    address: Address,
    registers: [u8; REGISTERS],
    /// Answers from then on; `None`: it has no supply.
    awake: Option<Instant>,
    /// Measures from then on; whether it has.
    measures: Instant,
    has_measured: bool,
    /// It is another chip.
    stranger: bool,
}

impl Chip {
    /// A chip that has had its supply for long.
    pub fn new(address: Address) -> Self {
        let registers = [0; REGISTERS];
        let measures = Instant::NEVER;
        let mut chip = Self { address, registers, awake: None, measures, has_measured: false, stranger: false };
        chip.power_on(Instant::ZERO);
        chip
    }

    fn power_on(&mut self, awake: Instant) {
        self.registers = [0; REGISTERS];
        // Identifiers, firmware 3.17, boot loader 0x15.
        self.registers[..7].copy_from_slice(&[CHIP, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15]);
        // Power-on value of the units: Android orientation.
        self.registers[usize::from(UNIT_SEL)] = 0x80;
        (self.awake, self.measures, self.has_measured) = (Some(awake), Instant::NEVER, false);
    }

    pub fn handle_timeout(&mut self, now: Instant, due: bool, body: &mut Body) {
        if body.faults.unpowered {
            self.awake = None;
            return;
        }
        // Another chip is put in its place without a supply.
        let other = core::mem::replace(&mut self.stranger, body.faults.stranger) != body.faults.stranger;
        if self.awake.is_none() || other {
            self.power_on(now + POWER_ON);
        } else if body.faults.reset {
            self.power_on(now);
        }
        if due && self.measures <= now {
            self.has_measured = true;
            let truth = body.measure();
            let [x, y, z, w] = truth.orientation;
            let values = |has, values: [f64; 3], digit| values.map(|value| if has { digits(value, digit) } else { 0 });
            let Faults { without_acceleration, without_rotation, .. } = body.faults;
            self.store(ACC_DATA, &values(!without_acceleration, truth.acceleration_mps2, ACCELERATION_MPS2));
            self.store(GYR_DATA, &values(!without_rotation, truth.rotation_radps, ROTATION_RADPS));
            self.store(QUA_DATA, &[w, x, y, z].map(|value| digits(value, QUATERNION)));
            self.registers[usize::from(TEMP)] = (libm::round(truth.temperature_c) as i8).cast_unsigned();
        }
        let running = self.has_measured;
        let faults = &body.faults;
        let mut set = |register: u8, value| self.registers[usize::from(register)] = value;
        set(SYS_STATUS, if faults.error { STATUS_ERROR } else { u8::from(running) * STATUS_FUSION });
        set(SYS_ERR, if faults.error { ERROR } else { 0 });
        set(CALIB_STAT, if faults.uncalibrated || !running { 0x00 } else { 0x3C });
        set(CHIP_ID, if faults.stranger { 0x55 } else { CHIP });
    }

    fn store(&mut self, register: u8, values: &[i16]) {
        for (n, value) in values.iter().enumerate() {
            let at = usize::from(register) + 2 * n;
            self.registers[at..at + 2].copy_from_slice(&value.to_le_bytes());
        }
    }

    pub fn answer(&mut self, now: Instant, transfer: &Transfer, body: &mut Body) -> Outcome {
        self.handle_timeout(now, false, body);
        if let Some(error) = body.faults.bus {
            return Err(error);
        }
        let awake = self.awake.is_some_and(|awake| awake <= now);
        if transfer.address != self.address || body.faults.cut || !awake {
            return Err(Error::NoAddress);
        }
        let (start, values) = transfer.write.split_first().map_or((0, &[][..]), |(start, values)| (*start, values));
        for (n, value) in values.iter().enumerate() {
            if body.chance(body.faults.noise_ppm) {
                return Err(Error::NoData { at: n as u8 });
            }
            self.write(now, start.wrapping_add(n as u8), *value);
        }
        let mut read = Bytes::new();
        let Read::Exactly(count) = transfer.read else { return Ok(read) };
        let count = if body.faults.halves { count / 2 } else { count };
        for n in 0..count {
            if body.chance(body.faults.noise_ppm) {
                return Err(Error::Arbitration);
            }
            let value = self.registers.get(usize::from(start.wrapping_add(n))).copied().unwrap_or(0);
            if read.push(body.faults.received(value)).is_err() {
                return Err(Error::Other);
            }
        }
        Ok(read)
    }

    fn write(&mut self, now: Instant, register: u8, value: u8) {
        let mode = self.registers[usize::from(OPR_MODE)];
        let place = usize::from(register);
        match register {
            OPR_MODE => {
                self.registers[place] = value;
                self.measures = if value == MODE_IMU { now + MODE_CHANGE } else { Instant::NEVER };
                self.has_measured = false;
            }
            // The other registers can be written in the mode CONFIG only (data sheet, 3.3.1).
            UNIT_SEL | PWR_MODE if mode == MODE_CONFIG => self.registers[place] = value,
            PAGE_ID => self.registers[place] = value,
            _ => {}
        }
    }
}
