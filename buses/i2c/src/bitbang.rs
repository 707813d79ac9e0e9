//! A bus master made of two open-drain lines. Reads no clock and owns no pin: the caller passes the time and, on
//! request, the levels of the lines, sets the levels it is given, and calls again at the given instant.
//!
//! UM10204 rev. 6, 3.1 and table 10; SMBus 3.2, 4.2 and 4.3. A bit is: pull SCL, after a while set SDA if it changes,
//! release SCL, look at both lines. The look sees a clock that is held low (stretching), a lost arbitration and what is
//! read, all at once; nothing is done that the bus does not need (`docs/i2c.md` has the count).

use base::i2c::{Error, MAX, Outcome, Read, Transfer};
use base::{Duration, Instant};

mod pins;
mod run;

pub use pins::{Pins, perform};
use run::{Next, Run, Symbol};

/// The two lines: true is high, or to be released; false is low, or to be pulled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels {
    /// The clock.
    pub scl: bool,
    /// The data.
    pub sda: bool,
}

impl Levels {
    /// Both high: a free bus, or both released.
    pub const HIGH: Self = Self { scl: true, sda: true };

    /// Wired AND: what the lines are when two drive them.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self { scl: self.scl && other.scl, sda: self.sda && other.sda }
    }
}

/// Timing of the master.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Clock frequency, 1 to 1 000 000 Hz. 55 % of a period is low, which keeps every minimum of UM10204 table 10 at
    /// 100 kHz (standard mode), 400 kHz (fast) and 1 MHz (fast mode plus).
    pub hz: u32,
    /// Longest time that a line may be held low: SCL within a transfer, and either line before one. SMBus: 25 to 35 ms.
    /// All stretching of a transfer together may take four times as long; SMBus permits 25 ms (`T_LOW:SEXT`).
    pub timeout: Duration,
    /// Time that both lines must be high before a START: zero for the only master, 50 us (SMBus `T_HIGH:MAX`) among
    /// several.
    pub idle: Duration,
}

impl Default for Config {
    /// SMBus with one master: 100 kHz, 35 ms.
    fn default() -> Self {
        Self { hz: 100_000, timeout: Duration::from_millis(35), idle: Duration::ZERO }
    }
}

/// Why a transfer was not begun. The lines are as they were.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestError {
    /// A transfer is under way, or its outcome has not been fetched.
    Busy,
    /// More is to be read than a transfer can bring.
    TooLong,
}

/// The master: one transfer at a time.
///
/// [`request`](Self::request), then [`handle_timeout`](Self::handle_timeout) whenever
/// [`poll_timeout`](Self::poll_timeout) says, until [`poll_event`](Self::poll_event) has the outcome. A late call
/// slows the bus; one that is 25 ms late while SCL is low ends the transfer with [`Error::Stretched`], as an SMBus
/// target may have given up.
#[derive(Debug)]
pub struct Master {
    timing: Timing,
    config: Config,
    /// Levels that this master drives.
    lines: Levels,
    state: State,
    /// The transfer under way, or the last one.
    run: Run,
    /// Time when SCL was last pulled.
    fell: Instant,
    /// Total time for which targets have stretched the clock of the transfer.
    stretched: Duration,
    done: Option<Outcome>,
}

/// Multiple of [`Config::timeout`] after which others have used the bus, or stretched the clock of a transfer, too
/// long.
const BUSY_TIMEOUTS: u32 = 4;
/// Targets of SMBus wait so long for a clock that is low (`T_TIMEOUT:MIN`).
const TARGETS_WAIT: Duration = Duration::from_millis(25);

#[derive(Clone, Copy, Debug)]
struct Timing {
    low: Duration,
    high: Duration,
    /// From SCL low to a change of SDA: the hold time that SMBus up to 2.0 asks for, 300 ns, and a margin.
    hold: Duration,
    /// From the release of SCL to the look. A stretched clock that rises within it is high for that much less, which
    /// 4.5 us at 100 kHz can spare; a line that rises more slowly is looked at again.
    rise: Duration,
}

#[derive(Clone, Copy, Debug)]
enum State {
    Idle,
    /// The transfer has ended; the bus stays free for a while before the outcome is reported.
    Free {
        until: Instant,
        result: Result<(), Error>,
    },
    /// Before START: waits for a free bus.
    Listen {
        at: Instant,
        seen: Listened,
    },
    /// A symbol of the transfer is being made.
    Symbol {
        at: Instant,
        phase: Phase,
        symbol: Symbol,
    },
}

/// Observation of a bus that this master has not taken yet.
#[derive(Clone, Copy, Debug)]
struct Listened {
    /// Time when it was first to be looked at.
    since: Instant,
    levels: Option<Levels>,
    /// These levels since.
    steady: Instant,
}

impl Listened {
    fn nothing(since: Instant) -> Self {
        Self { since, levels: None, steady: since }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// SDA falls while SCL is high: START.
    Begin,
    /// SCL falls.
    Fall,
    /// SDA changes.
    Data,
    /// SCL is released.
    Rise,
    /// SCL should be high. `since` it was released, `stretched` once it was seen low.
    Look { since: Instant, stretched: bool },
    /// An edge of SDA while SCL is high: of a repeated START or a STOP.
    Edge,
}

impl Master {
    /// A master that has both lines released. A frequency of zero counts as 1 Hz, one beyond 1 MHz as 1 MHz.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let period = 1_000_000_000 / u64::from(config.hz.clamp(1, 1_000_000));
        // Rounded up: a low time of 550 ns at 1 MHz has no room to lose.
        let low = (period * 11).div_ceil(20);
        let (low, high) = (Duration::from_nanos(low), Duration::from_nanos(period - low));
        let timing = Timing { low, high, hold: low / 4, rise: high / 9 };
        Self {
            timing,
            config,
            lines: Levels::HIGH,
            state: State::Idle,
            run: Run::default(),
            fell: Instant::ZERO,
            stretched: Duration::ZERO,
            done: None,
        }
    }

    /// Begins a transfer. Reads of more than [`MAX`] bytes are refused.
    pub fn request(&mut self, now: Instant, transfer: Transfer) -> Result<(), RequestError> {
        let too_long = match transfer.read {
            Read::None => false,
            Read::Exactly(count) => usize::from(count) > MAX,
            Read::Block { extra } => usize::from(extra) + 33 > MAX,
        };
        match self.state {
            _ if too_long => return Err(RequestError::TooLong),
            State::Idle if self.done.is_none() => {}
            _ => return Err(RequestError::Busy),
        }
        self.run = Run::new(transfer);
        self.stretched = Duration::ZERO;
        self.state = State::Listen { at: now, seen: Listened::nothing(now) };
        Ok(())
    }

    /// Instant of the next [`Self::handle_timeout`]; `None` while there is nothing to do. A past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Idle => None,
            State::Free { until: at, .. } | State::Listen { at, .. } | State::Symbol { at, .. } => Some(at),
        }
    }

    /// True if the next call of [`Self::handle_timeout`] uses the levels; else they need not be read.
    #[must_use]
    pub fn wants_levels(&self) -> bool {
        matches!(self.state, State::Listen { .. } | State::Symbol { phase: Phase::Look { .. }, .. })
    }

    /// Levels to set now, if they differ from those before: one line at a time.
    ///
    /// `levels` are those of the bus, which others pull too; used only after [`Self::wants_levels`] returned true.
    pub fn handle_timeout(&mut self, now: Instant, levels: Levels) -> Option<Levels> {
        let before = self.lines;
        self.state = match self.state {
            State::Free { until, result } if until <= now => {
                self.done = Some(result.map(|()| self.run.take_read()));
                State::Idle
            }
            State::Listen { at, seen } if at <= now => self.listen(now, levels, seen),
            State::Symbol { at, phase, symbol } if at <= now => self.step(now, levels, phase, symbol),
            early => early,
        };
        (self.lines != before).then_some(self.lines)
    }

    /// The outcome of the transfer, once.
    pub fn poll_event(&mut self) -> Option<Outcome> {
        self.done.take()
    }

    fn listen(&mut self, now: Instant, levels: Levels, seen: Listened) -> State {
        let steady = if seen.levels == Some(levels) { seen.steady } else { now };
        let held = now.since(steady);
        let held_low = held >= self.config.timeout;
        match levels {
            // At once: looking and pulling SDA are one moment, or another master has time to begin.
            Levels::HIGH if held >= self.config.idle => self.step(now, levels, Phase::Begin, Symbol::Start),
            // Others talk without end.
            levels
                if levels != Levels::HIGH
                    && now.since(seen.since) >= self.config.timeout.saturating_mul(BUSY_TIMEOUTS) =>
            {
                self.over(now, Error::Arbitration)
            }
            Levels { scl: false, .. } if held_low => self.over(now, Error::Stuck),
            // UM10204 3.1.16: a target that holds SDA waits for clocks. At most once in a transfer.
            Levels { scl: true, sda: false } if held_low && self.run.recovered() => self.over(now, Error::Stuck),
            Levels { scl: true, sda: false } if held_low => {
                self.step(now, levels, Phase::Fall, Symbol::Clock { left: 9 })
            }
            _ => {
                let seen = Listened { levels: Some(levels), steady, ..seen };
                State::Listen { at: now + self.timing.high, seen }
            }
        }
    }

    /// One phase of one symbol: sets one line, or reads both.
    fn step(&mut self, now: Instant, levels: Levels, phase: Phase, symbol: Symbol) -> State {
        let Timing { low, high, hold, rise } = self.timing;
        let (phase, wait) = match phase {
            Phase::Begin => {
                self.lines.sda = false;
                return Self::follow(now + high, self.run.next(Symbol::Start, true));
            }
            Phase::Fall => {
                self.lines.scl = false;
                self.fell = now;
                // SDA changes only if it has to.
                if symbol.sda() == self.lines.sda { (Phase::Rise, low) } else { (Phase::Data, hold) }
            }
            Phase::Data => {
                self.lines.sda = symbol.sda();
                (Phase::Rise, low - hold)
            }
            Phase::Rise => {
                self.lines.scl = true;
                (Phase::Look { since: now, stretched: false }, rise)
            }
            Phase::Look { since, .. } if !levels.scl => {
                if now.since(since) >= self.config.timeout {
                    let error = if matches!(symbol, Symbol::Clock { .. }) { Error::Stuck } else { Error::Stretched };
                    return self.over(now, error);
                }
                (Phase::Look { since, stretched: true }, rise)
            }
            // The call was late and the target may have timed out: its further bits are not valid.
            Phase::Look { since, .. } if since.since(self.fell) >= TARGETS_WAIT.max(low * 2) => {
                return self.over(now, Error::Stretched);
            }
            Phase::Look { .. } if symbol.contended(levels.sda) => return self.over(now, Error::Arbitration),
            Phase::Look { since, stretched } => {
                if stretched {
                    self.stretched += now.since(since);
                    if self.stretched >= self.config.timeout.saturating_mul(BUSY_TIMEOUTS) {
                        return self.over(now, Error::Stretched);
                    }
                }
                // The set-up time of a repeated START is that of a low clock. It counts from when SCL was seen high.
                let whole = if symbol == Symbol::Restart { low } else { high };
                let rest = if stretched { whole } else { whole - rise };
                if !symbol.has_edge() {
                    return Self::follow(now + rest, self.run.next(symbol, levels.sda));
                }
                (Phase::Edge, rest)
            }
            Phase::Edge => {
                self.lines.sda = !self.lines.sda;
                let wait = if self.lines.sda { low } else { high };
                return Self::follow(now + wait, self.run.next(symbol, self.lines.sda));
            }
        };
        State::Symbol { at: now + wait, phase, symbol }
    }

    fn follow(at: Instant, next: Next) -> State {
        match next {
            Next::Symbol(symbol) => State::Symbol { at, phase: Phase::Fall, symbol },
            // SDA came free while SCL is high: a START and a STOP put every target back (UM10204 3.1.10).
            Next::Begin => State::Symbol { at, phase: Phase::Begin, symbol: Symbol::Start },
            Next::Listen => State::Listen { at, seen: Listened::nothing(at) },
            Next::Done(result) => State::Free { until: at, result },
        }
    }

    /// Lets go of the bus without a STOP, which is another's or impossible.
    fn over(&mut self, now: Instant, error: Error) -> State {
        self.lines = Levels::HIGH;
        State::Free { until: now + self.timing.low, result: Err(error) }
    }
}

#[cfg(test)]
mod tests;
