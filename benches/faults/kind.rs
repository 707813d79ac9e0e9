//! Kinds of faults.

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// SIGSTOP: every thread is stopped.
    Stopped,
    /// SIGKILL.
    Killed,
    /// The main loop computes without end.
    Busy,
    /// A thread deadlocks beside a working main loop.
    Worker,
    /// The main loop waits for a bus that does not answer.
    Bus,
    /// The main loop waits for a file that does not open.
    Disk,
    /// Memory is allocated until the limit.
    Memory,
    /// All file descriptors are in use for two seconds.
    Descriptors,
    /// The log is flooded with lines for two seconds.
    Log,
}

impl Kind {
    pub const ALL: [Self; 9] = [
        Self::Stopped,
        Self::Killed,
        Self::Busy,
        Self::Worker,
        Self::Bus,
        Self::Disk,
        Self::Memory,
        Self::Descriptors,
        Self::Log,
    ];

    /// Name in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stopped => "SIGSTOP",
            Self::Killed => "SIGKILL",
            Self::Busy => "busy loop",
            Self::Worker => "deadlocked worker",
            Self::Bus => "blocked on a bus",
            Self::Disk => "blocked on the disk",
            Self::Memory => "memory hog",
            Self::Descriptors => "fd leak",
            Self::Log => "log flood",
        }
    }

    /// Signal that causes it: for the process itself, or for `saboteur.c` in it.
    fn signal(self) -> Signal {
        match self {
            Self::Stopped => Signal::SIGSTOP,
            Self::Killed => Signal::SIGKILL,
            Self::Busy => Signal::SIGUSR1,
            Self::Worker => Signal::SIGUSR2,
            Self::Bus => Signal::SIGURG,
            Self::Disk => Signal::SIGVTALRM,
            Self::Memory => Signal::SIGPROF,
            Self::Descriptors => Signal::SIGWINCH,
            Self::Log => Signal::SIGIO,
        }
    }

    /// True if the module continues to work; the robot must then obey its operator.
    pub fn is_burden(self) -> bool {
        matches!(self, Self::Descriptors | Self::Log)
    }

    pub fn inject(self, pid: i32) {
        assert!(pid > 1, "no such process");
        kill(Pid::from_raw(pid), self.signal()).expect("the process is there");
    }
}
