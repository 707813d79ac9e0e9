//! Option codes: how a drive ends a motion, and when (CiA 402-2, 6.4: 0x6007, 0x605A to 0x605E).

use crate::Dictionary;

/// Way to end a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The power stage is switched off: it rolls on.
    Coast,
    /// By the deceleration ramp (0x6084).
    SlowDown,
    /// By the quick stop ramp (0x6085).
    QuickStop,
    /// Stop at the current limit.
    CurrentLimit,
    /// Stop at the voltage limit.
    VoltageLimit,
}

impl Stop {
    fn of(code: i16) -> Option<Self> {
        Some(match code {
            0 => Self::Coast,
            1 => Self::SlowDown,
            2 => Self::QuickStop,
            3 => Self::CurrentLimit,
            4 => Self::VoltageLimit,
            _ => return None,
        })
    }
}

/// Values of the six option code objects. A code that the standard lacks counts as the default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// 0x605A: 0 to 4, then Switch On Disabled; 5 to 8 as 1 to 4, and it stays in Quick Stop Active. Default 2.
    pub quick_stop: i16,
    /// 0x605B: 0 at once (default), 1 by the slow down ramp.
    pub shutdown: i16,
    /// 0x605C: 0 at once, 1 by the slow down ramp (default).
    pub disable_operation: i16,
    /// 0x605D: 1 to 4; default 1.
    pub halt: i16,
    /// 0x605E: 0 to 4; default 2.
    pub fault: i16,
    /// 0x6007: 0 nothing, 1 fault (default), 2 disable voltage, 3 quick stop.
    pub abort_connection: i16,
}

impl Default for Options {
    fn default() -> Self {
        Self { quick_stop: 2, shutdown: 0, disable_operation: 1, halt: 1, fault: 2, abort_connection: 1 }
    }
}

impl Options {
    /// maxon EPOS, first generation: it has none of the objects; quick stop is kept.
    pub const EPOS: Self =
        Self { quick_stop: 6, shutdown: 0, disable_operation: 0, halt: 1, fault: 2, abort_connection: 1 };

    /// Options from `objects`, and from `absent` where an object is missing.
    #[must_use]
    pub fn read(objects: &Dictionary, absent: Self) -> Self {
        let code = |index, absent| objects.get(index, 0).map_or(absent, |code| code as i16);
        Self {
            quick_stop: code(0x605A, absent.quick_stop),
            shutdown: code(0x605B, absent.shutdown),
            disable_operation: code(0x605C, absent.disable_operation),
            halt: code(0x605D, absent.halt),
            fault: code(0x605E, absent.fault),
            abort_connection: code(0x6007, absent.abort_connection),
        }
    }

    /// Stop of a quick stop, and true if Quick Stop Active is kept after it.
    #[must_use]
    pub fn quick_stop(&self) -> (Stop, bool) {
        match self.quick_stop {
            code @ 5..=8 => (Stop::of(code - 4).unwrap_or(Stop::QuickStop), true),
            code => (Stop::of(code).unwrap_or(Stop::QuickStop), false),
        }
    }

    /// Stop by controlword bit 8: always under power.
    #[must_use]
    pub fn halt(&self) -> Stop {
        Stop::of(self.halt).filter(|stop| *stop != Stop::Coast).unwrap_or(Stop::SlowDown)
    }

    /// Stop after a fault.
    #[must_use]
    pub fn fault(&self) -> Stop {
        Stop::of(self.fault).unwrap_or(Stop::QuickStop)
    }

    /// True if Shutdown (T8) waits for the end of a ramp.
    #[must_use]
    pub fn shuts_down_by_ramp(&self) -> bool {
        self.shutdown == 1
    }

    /// True if Disable Operation (T5) waits for the end of a ramp.
    #[must_use]
    pub fn disables_by_ramp(&self) -> bool {
        self.disable_operation != 0
    }
}
