//! BR-FAN1: a MAX6615 with two fans in the robot's box, and what can ail it.

use super::climate::Climate;
use crate::faults::InjectedFault;
use base::Instant;
use base::i2c::{Address, Bytes, Error, Outcome, Transfer};
use i2c::max6615::chip::Chip;
use i2c::target::{Target, answer, expected};

/// Speed of a 92 mm fan at full duty.
const FULL_RPM: f64 = 2600.0;

/// The board.
#[derive(Debug)]
pub(crate) struct Fan1 {
    pub name: String,
    address: Address,
    chip: Chip,
    silent: Instant,
    wrong: Instant,
    hold: Instant,
    stalls: [Instant; 2],
    hot: (Instant, f64),
}

impl Fan1 {
    pub fn new(name: &str, address: Address) -> Self {
        let never = Instant::ZERO;
        Self {
            name: name.into(),
            address,
            chip: Chip::new(address, [FULL_RPM; 2]),
            silent: never,
            wrong: never,
            hold: never,
            stalls: [never; 2],
            hot: (never, 0.0),
        }
    }

    /// Injects a fault; false if it is none of its kind.
    pub fn inject(&mut self, now: Instant, injected: InjectedFault, until: Instant) -> bool {
        match injected {
            InjectedFault::Silent => self.silent = until,
            InjectedFault::Wrong => self.wrong = until,
            InjectedFault::Hold => self.hold = until,
            InjectedFault::Stall(fan) => self.stalls[usize::from(fan - 1)] = until,
            InjectedFault::Hot(celsius) => self.hot = (until, celsius),
            InjectedFault::Reset => self.chip.reset(),
            InjectedFault::None => {
                (self.silent, self.wrong, self.hold, self.stalls) = (now, now, now, [now; 2]);
                self.hot.0 = now;
            }
            _ => return false,
        }
        true
    }

    /// Time goes on, in what climate there is.
    pub fn advance(&mut self, now: Instant, climate: &Climate) {
        let (until, celsius) = self.hot;
        self.chip.set_temperature(0, if now < until { celsius } else { climate.box_c });
        self.chip.set_temperature(1, climate.drives_c);
        for fan in 0..2 {
            self.chip.set_stalled(fan, now < self.stalls[fan]);
        }
        self.chip.advance(now);
    }

    /// Fraction of full air flow of its fans, 0..1.
    pub fn flow(&self) -> f64 {
        (self.chip.rpm(0) + self.chip.rpm(1)) / (2.0 * FULL_RPM)
    }

    /// True if it holds SDA, which blocks the bus.
    pub fn holds(&self, now: Instant) -> bool {
        now < self.hold
    }

    /// Answer to a transfer; `None` while it does not receive.
    pub fn answer(&mut self, now: Instant, transfer: &Transfer) -> Option<Outcome> {
        if transfer.address != self.address || now < self.silent {
            return None;
        }
        if now < self.wrong {
            let read = Bytes::from_slice(&[0xFF; base::i2c::MAX][..expected(transfer.read, Some(0xFF))]);
            return Some(read.map_err(|_| Error::Other));
        }
        let chip: &mut dyn Target = &mut self.chip;
        Some(answer(&mut [chip], transfer))
    }
}
