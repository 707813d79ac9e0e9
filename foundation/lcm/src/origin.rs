//! Where a message came from, as far as the transport reveals it.

/// A process of this computer that has a place on the shared-memory bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Process {
    /// Process id, as stated by its owner: a process could claim the id of another process of its user, but not of
    /// another user.
    pub pid: u32,
    /// User id, as reported by the kernel.
    pub uid: u32,
}

/// Where a message came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Origin {
    /// Memory that only the users of the shared-memory bus can write, or this process itself.
    Memory(Process),
    /// A socket of this computer: any user's. The process, if the socket belongs to one with a place in shared memory.
    Host(Option<Process>),
    /// A socket of another computer.
    Network,
}

impl Origin {
    /// The process, where it is known.
    #[must_use]
    pub fn process(self) -> Option<Process> {
        match self {
            Self::Memory(process) => Some(process),
            Self::Host(process) => process,
            Self::Network => None,
        }
    }
}

/// When and from where a message came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Provenance {
    /// Time of reception, in shared memory of publication; ns since 1970.
    pub at: i64,
    /// Time of publication in shared memory, ns of this machine's monotonic clock, as the publisher says.
    pub published: Option<i64>,
    /// Where it came from.
    pub origin: Origin,
}
