//! The master on real pins, step by step, for who may wait.

use super::{Levels, Master};
use base::Instant;
use base::i2c::{Error, Outcome, Transfer};
use embedded_hal::delay::DelayNs;

/// Two open-drain lines with pull-ups: GPIO of a kernel, of a microcontroller, or of the simulator.
pub trait Pins {
    /// Releases (true) or pulls (false) each line. Only one of them differs from the call before; both are released at
    /// the beginning. An error ends the transfer.
    fn set(&mut self, lines: Levels) -> Result<(), Error>;
    /// The levels that the lines have.
    fn get(&mut self) -> Result<Levels, Error>;
}

/// Runs a transfer to its end. Time is the sum of the requested delays: the duration of the calls themselves slows the
/// bus and lengthens time limits. If the pins fail, both lines are released as far as possible.
pub fn perform(master: &mut Master, transfer: Transfer, pins: &mut impl Pins, delay: &mut impl DelayNs) -> Outcome {
    let mut now = Instant::ZERO;
    // Drops an outcome of an earlier transfer.
    master.poll_event();
    master.request(now, transfer).map_err(|_| Error::Other)?;
    while let Some(at) = master.poll_timeout() {
        let wait = at.since(now).as_nanos();
        delay.delay_ns(u32::try_from(wait).unwrap_or(u32::MAX));
        now = now.max(at);
        let stepped = step(master, now, pins);
        if let Err(error) = stepped {
            *master = Master::new(master.config);
            // It failed already: there is nothing more to be done about it.
            let _ = pins.set(Levels::HIGH);
            return Err(error);
        }
    }
    master.poll_event().unwrap_or(Err(Error::Other))
}

fn step(master: &mut Master, now: Instant, pins: &mut impl Pins) -> Result<(), Error> {
    let levels = if master.wants_levels() { pins.get()? } else { Levels::HIGH };
    master.handle_timeout(now, levels).map_or(Ok(()), |lines| pins.set(lines))
}
