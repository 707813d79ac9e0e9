//! What is done to a module.

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// SIGSTOP: every thread stands still.
    Stopped,
    /// SIGKILL.
    Killed,
    /// The main loop computes for ever.
    Busy,
    /// A thread deadlocks behind a main loop that works.
    Worker,
    /// The main loop waits for a bus that does not answer.
    Bus,
    /// The main loop waits for a file that does not open.
    Disk,
    /// Memory is taken until none is given.
    Memory,
    /// All file descriptors are in use for two seconds.
    Descriptors,
    /// Lines are written as fast as they go, for two seconds.
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

    /// What it is called in the table.
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

    /// What makes it: of the process itself, or of `saboteur.c` in it.
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

    /// Whether the module works on, and is judged by whether the robot obeys.
    pub fn is_burden(self) -> bool {
        matches!(self, Self::Descriptors | Self::Log)
    }

    pub fn inject(self, pid: i32) {
        assert!(pid > 1, "no such process");
        kill(Pid::from_raw(pid), self.signal()).expect("the process is there");
    }
}
