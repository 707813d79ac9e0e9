//! The driver on any `embedded-hal` 1.0 bus, for who may wait.

use super::config::{Config, Invalid};
use super::driver::{Event, Max6615, Reading, Why};
use crate::hal::transfer;
use base::i2c::Error;
use embedded_hal::i2c::I2c;

/// A chip on a bus.
///
/// ```
/// # fn example(bus: impl embedded_hal::i2c::I2c) -> Result<(), Box<dyn std::error::Error>> {
/// use i2c::max6615::{ADDRESS, Config, hal::FanController};
/// let address = i2c::Address::new(ADDRESS).ok_or("seven bits")?;
/// let mut fans = FanController::new(bus, Config::new(address))?;
/// fans.set_duty(0, 0.5)?;
/// let reading = fans.poll().map_err(|why| why.to_string())?;
/// println!("{} C, {} rpm", reading.temperature_c[0], reading.rpm[0]);
/// # Ok(()) }
/// ```
#[derive(Debug)]
pub struct FanController<I> {
    bus: I,
    driver: Max6615,
}

impl<I: I2c> FanController<I> {
    /// A chip that is to be configured like this.
    pub fn new(bus: I, config: Config) -> Result<Self, Invalid> {
        Ok(Self { bus, driver: Max6615::new(config)? })
    }

    /// Sets the duty of a fan, 0 or 1, by hand: a fraction, 0 to 1; written with the next [`Self::poll`].
    pub fn set_duty(&mut self, fan: usize, duty: f64) -> Result<(), Invalid> {
        self.driver.set_duty(fan, duty)
    }

    /// Another configuration, written with the next [`Self::poll`].
    pub fn configure(&mut self, config: Config) -> Result<(), Invalid> {
        self.driver.configure(config)
    }

    /// Finds and configures the chip where needed, then reads all its values.
    pub fn poll(&mut self) -> Result<Reading, Why> {
        self.driver.begin();
        while let Some(next) = self.driver.poll_transfer() {
            let outcome = transfer(&mut self.bus, &next);
            self.driver.handle_outcome(&outcome);
        }
        let mut found = None;
        while let Some(event) = self.driver.poll_event() {
            match event {
                Event::Reading(reading) => found = Some(reading),
                Event::Lost(_) | Event::Found { .. } | Event::Reset => {}
            }
        }
        // A round ends with a reading or with a chip that is lost.
        found.ok_or(self.driver.lost_by().unwrap_or(Why::Bus(Error::Other)))
    }

    /// The bus, for another use.
    pub fn release(self) -> I {
        self.bus
    }
}
