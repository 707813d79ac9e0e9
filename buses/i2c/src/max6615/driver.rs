//! The driver: gives the next transfer and decodes the answer. Knows no bus and no time: one round of reads on request,
//! about once a second.

use super::config::{Config, Invalid, Mode};
use super::fields::{FanStatus, channels_from_bits, duty, rpm, temperature_c};
use super::{DEVICE, MANUFACTURER, find, register};
use crate::smbus::{Answer, Command, Error as SmbusError};
use base::Queue;
use base::i2c::{self, Outcome, Transfer};
use core::fmt;

/// Attempts of a transfer before the chip counts as lost.
const TRIES: u8 = 3;

/// Registers read in a round, after two that show if the configuration is intact. Temperatures are read twice, as their
/// fraction has a register of its own and may belong to another conversion.
const POLLED: [u8; 14] = [
    register::DEVICE,
    register::OVER,
    register::TEMPERATURE,
    register::FRACTION,
    register::TEMPERATURE,
    register::TEMPERATURE_2,
    register::FRACTION_2,
    register::TEMPERATURE_2,
    register::DUTY,
    register::DUTY_2,
    register::TACH,
    register::TACH_2,
    register::FAN_STATUS,
    register::REVISION,
];

/// Result of a round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Temperatures of both channels, C: 0 to 255.875; what is below 0 C reads 0.
    pub temperature_c: [f64; 2],
    /// True if a channel was above its limit since the last round.
    pub over: [bool; 2],
    /// Present duty of the fans, fraction of full duty.
    pub duty: [f64; 2],
    /// Speed of the fans; 0 is also what is too slow for the counter (below 227 rpm).
    pub rpm: [f64; 2],
    /// True if the chip reports a failed fan.
    pub failed: [bool; 2],
}

/// Why there is no chip to work with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The transfers failed, the last one like this.
    Bus(i2c::Error),
    /// Each register reads FF: no chip pulls SDA low.
    AllOnes,
    /// Another chip has this address.
    Foreign {
        /// Manufacturer register.
        manufacturer: u8,
        /// Device register.
        device: u8,
    },
    /// A register does not keep what it is given.
    Forgets {
        /// Which.
        register: u8,
        /// Value written.
        wrote: u8,
        /// Value read back.
        read: u8,
    },
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => error.fmt(f),
            Self::AllOnes => f.write_str("the chip reads FF everywhere"),
            Self::Foreign { manufacturer, device } => {
                write!(f, "another chip is there: manufacturer {manufacturer:02x}, device {device:02x}")
            }
            Self::Forgets { register, wrote, read } => {
                write!(f, "register {register:02x} was given {wrote:02x} and reads {read:02x}")
            }
        }
    }
}

/// Events of the driver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The chip is there and configured: at the beginning, and when it is back.
    Found {
        /// Revision.
        revision: u8,
    },
    /// A round.
    Reading(Reading),
    /// Configuration lost, as after a loss of supply, and written again.
    Reset,
    /// Lost; reported again when the reason changes.
    Lost(Why),
}

/// The driver of one chip: [`begin`](Self::begin) a round, then [`poll_transfer`](Self::poll_transfer) and
/// [`handle_outcome`](Self::handle_outcome) in turn until there is no transfer; then [`poll_event`](Self::poll_event).
#[derive(Debug)]
pub struct Max6615 {
    config: Config,
    /// Another one, from the next round on.
    wanted: Option<Config>,
    /// Register values of the configuration.
    values: heapless::Vec<(u8, u8), 20>,
    step: Step,
    /// Attempts of the present or next transfer.
    tries: u8,
    waiting: bool,
    state: State,
    /// Answers of this round.
    read: [u8; POLLED.len()],
    /// Which value is compared this round, besides the witness.
    turn: usize,
    /// True if this round has already looked for the chip a second time.
    again: bool,
    events: Queue<Event, 4>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Idle,
    Manufacturer,
    Device {
        manufacturer: u8,
    },
    Write(usize),
    Verify(usize),
    /// A value that differs from power-on: a chip that was reset does not have it.
    Witness,
    /// Another value each round.
    Turn,
    Poll(usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Not seen yet.
    New,
    /// To be configured; true if because it lost its configuration.
    Found {
        forgot: bool,
    },
    /// Configured.
    Ready,
    Lost(Why),
}

impl Max6615 {
    /// A driver that has not seen its chip yet.
    pub fn new(config: Config) -> Result<Self, Invalid> {
        config.check()?;
        Ok(Self {
            config,
            wanted: None,
            values: config.registers(),
            step: Step::Idle,
            tries: 0,
            waiting: false,
            state: State::New,
            read: [0; POLLED.len()],
            turn: 0,
            again: false,
            events: Queue::new(),
        })
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Another configuration, written in the next round.
    pub fn configure(&mut self, config: Config) -> Result<(), Invalid> {
        config.check()?;
        self.wanted = Some(config);
        Ok(())
    }

    /// Sets the duty of a fan, 0 or 1, by hand: a fraction, 0 to 1.
    pub fn set_duty(&mut self, fan: usize, duty: f64) -> Result<(), Invalid> {
        let mut config = self.wanted.unwrap_or(self.config);
        config.fans.get_mut(fan).ok_or(Invalid::Duty)?.mode = Mode::Manual { duty };
        self.configure(config)
    }

    /// True if the chip was there when it was last asked.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.state == State::Ready
    }

    /// Why the last round brought no reading, if the chip is lost.
    #[must_use]
    pub fn lost_by(&self) -> Option<Why> {
        if let State::Lost(why) = self.state { Some(why) } else { None }
    }

    /// Begins a round: asks who is there, configures, or polls. Does nothing while one is under way.
    pub fn begin(&mut self) {
        if self.step != Step::Idle {
            return;
        }
        let wanted = self.wanted.take();
        if let Some(config) = wanted {
            (self.config, self.values, self.turn) = (config, config.registers(), 0);
        }
        (self.tries, self.again) = (0, false);
        self.step = match self.state {
            State::New | State::Lost(_) => Step::Manufacturer,
            State::Ready if wanted.is_none() => self.first_check(),
            State::Ready | State::Found { .. } => Step::Write(0),
        };
    }

    /// Next transfer of the round; `None` while one is under way, or after the round.
    pub fn poll_transfer(&mut self) -> Option<Transfer> {
        if self.waiting {
            return None;
        }
        let command = self.command()?;
        self.waiting = true;
        // Bytes always fit a transfer.
        command.transfer(self.config.address, false).ok()
    }

    /// Takes the outcome of the transfer; ignored if none is under way.
    pub fn handle_outcome(&mut self, outcome: &Outcome) {
        let Some(command) = self.command().filter(|_| self.waiting) else { return };
        self.waiting = false;
        let value = match command.answer(self.config.address, false, outcome) {
            Ok(Answer::Byte(value)) => value,
            Ok(_) => 0,
            Err(error) => return self.failed(error),
        };
        self.tries = 0;
        self.step = self.next(value);
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    fn command(&self) -> Option<Command<'static>> {
        let read = |code| Some(Command::ReadByte { code });
        match self.step {
            Step::Idle => None,
            Step::Manufacturer => read(register::MANUFACTURER),
            Step::Device { .. } => read(register::DEVICE),
            Step::Write(n) => self.values.get(n).map(|&(code, value)| Command::WriteByte { code, value }),
            Step::Verify(n) => read(self.values.get(n)?.0),
            Step::Witness => read(self.values.get(self.witness()?)?.0),
            Step::Turn => read(self.values.get(self.turn)?.0),
            Step::Poll(n) => read(POLLED[n]),
        }
    }

    /// Step after a value was read; a write gives 0.
    fn next(&mut self, value: u8) -> Step {
        match self.step {
            Step::Idle => Step::Idle,
            Step::Manufacturer => Step::Device { manufacturer: value },
            Step::Device { manufacturer } => match (manufacturer, value) {
                (MANUFACTURER, DEVICE) => {
                    self.state = State::Found { forgot: false };
                    Step::Write(0)
                }
                (manufacturer, device) => self.lost(foreign(manufacturer, device)),
            },
            Step::Write(n) if n + 1 < self.values.len() => Step::Write(n + 1),
            Step::Write(_) => Step::Verify(0),
            Step::Verify(n) => match self.differs(n, value) {
                Some((register, wrote)) => self.lost(Why::Forgets { register, wrote, read: value }),
                None if n + 1 < self.values.len() => Step::Verify(n + 1),
                None => Step::Poll(0),
            },
            Step::Witness => self.checked(self.witness().unwrap_or(0), value, Step::Turn),
            Step::Turn => {
                let n = self.turn;
                self.turn = (n + 1) % self.values.len();
                self.checked(n, value, Step::Poll(0))
            }
            Step::Poll(n) => self.polled(n, value),
        }
    }

    fn checked(&mut self, n: usize, value: u8, next: Step) -> Step {
        match self.differs(n, value) {
            // Perhaps it only went away: the identity decides.
            Some(_) if value == 0xFF => Step::Manufacturer,
            Some(_) => {
                self.state = State::Found { forgot: true };
                Step::Write(0)
            }
            None => next,
        }
    }

    fn polled(&mut self, n: usize, value: u8) -> Step {
        self.read[n] = value;
        match n {
            0 if value != DEVICE && self.again => self.lost(foreign(MANUFACTURER, value)),
            0 if value != DEVICE => {
                self.again = true;
                Step::Manufacturer
            }
            _ if n + 1 < POLLED.len() => Step::Poll(n + 1),
            _ => {
                let reading = self.reading();
                match core::mem::replace(&mut self.state, State::Ready) {
                    State::Found { forgot: true } => self.tell(Event::Reset),
                    State::Found { forgot: false } => self.tell(Event::Found { revision: value }),
                    State::New | State::Ready | State::Lost(_) => {}
                }
                self.tell(Event::Reading(reading));
                Step::Idle
            }
        }
    }

    fn reading(&self) -> Reading {
        let [_, over, whole, fraction, again, whole_2, fraction_2, again_2, duty_1, duty_2, tach_1, tach_2, status, _] =
            self.read;
        let temperature = |whole: u8, fraction, again| match whole == again {
            true => temperature_c(whole, fraction),
            // A conversion came between, near the boundary of two degrees: the boundary.
            false => temperature_c(whole.max(again), 0),
        };
        Reading {
            temperature_c: [temperature(whole, fraction, again), temperature(whole_2, fraction_2, again_2)],
            over: channels_from_bits(over),
            duty: [duty(duty_1), duty(duty_2)],
            rpm: [rpm(tach_1), rpm(tach_2)],
            failed: FanStatus::from_bits(status).failed,
        }
    }

    fn first_check(&self) -> Step {
        if self.witness().is_some() { Step::Witness } else { Step::Turn }
    }

    /// The first value that a chip that was reset does not have.
    fn witness(&self) -> Option<usize> {
        let power_on = |code| find(code).and_then(|register| register.power_on);
        self.values.iter().position(|&(code, value)| power_on(code).is_some_and(|before| before != value))
    }

    /// Register and value written, if what was read is another in the bits that are kept.
    fn differs(&self, n: usize, read: u8) -> Option<(u8, u8)> {
        let (code, wrote) = *self.values.get(n)?;
        let mask = match code {
            // The reset bit falls by itself.
            register::CONFIGURATION => 0xBF,
            // Failures are the chip's.
            register::FAN_STATUS => 0x3F,
            // Duties are rounded to 2 or 4.
            register::TARGET_DUTY | register::TARGET_DUTY_2 => 0xFC,
            _ => find(code)?.mask,
        };
        ((read ^ wrote) & mask != 0).then_some((code, wrote))
    }

    fn failed(&mut self, error: SmbusError) {
        self.tries += 1;
        if self.tries >= TRIES {
            let error = if let SmbusError::Bus(error) = error { error } else { i2c::Error::Other };
            self.step = self.lost(Why::Bus(error));
        }
    }

    fn lost(&mut self, why: Why) -> Step {
        if self.state != State::Lost(why) {
            self.state = State::Lost(why);
            self.tell(Event::Lost(why));
        }
        Step::Idle
    }

    fn tell(&mut self, event: Event) {
        // Two a round; an owner that never asks loses the newest.
        self.events.push(event);
    }
}

fn foreign(manufacturer: u8, device: u8) -> Why {
    if [manufacturer, device] == [0xFF; 2] { Why::AllOnes } else { Why::Foreign { manufacturer, device } }
}
