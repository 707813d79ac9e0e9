//! State of the server that all routes share.

use super::center::Center;
use super::center::access::Role;
use super::center::command_queue::CommandQueue;
use super::center::publish::Publisher;
use super::center::session_store::SessionStore;
use super::foxglove::hub::Hub;
use super::stats::Stats;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

/// State that all routes share.
#[derive(Clone)]
pub struct App {
    pub hub: Arc<Mutex<Hub>>,
    /// View of the robot for pages.
    pub center: Arc<Center>,
    pub bus: Arc<BusCounts>,
    pub stats: Arc<Stats>,
    /// Paired devices.
    pub session_store: Arc<SessionStore>,
    /// Motion authority.
    pub command_queue: Arc<CommandQueue>,
    /// Messages that engineers publish.
    pub publisher: Arc<Publisher>,
    /// Permits for command sockets.
    pub commanders: Seats,
    /// Permits for requested objects.
    pub objects: Arc<Semaphore>,
    /// The bus.
    pub lcm_url: Arc<str>,
    /// The robot's name.
    pub robot: Arc<str>,
    /// Identifier of this start of the server.
    pub session: Arc<str>,
    /// Permits for viewers.
    pub seats: Seats,
    /// Maximum length of a message to a viewer, bytes.
    pub message_max: usize,
    /// True when the server ends.
    pub end: watch::Receiver<bool>,
    /// Time of its start.
    pub started: Instant,
}

impl App {
    /// Number of viewers, on any socket.
    pub fn viewers(&self) -> usize {
        self.seats.taken()
    }

    /// Locks the hub.
    pub fn hub(&self) -> MutexGuard<'_, Hub> {
        self.hub.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Number of seats that only operators and engineers get.
const RESERVE: usize = 8;

/// Seats of sockets: those for everybody, and a reserve for clients that may stop the robot.
#[derive(Clone, Debug)]
pub struct Seats {
    common: Arc<Semaphore>,
    reserve: Arc<Semaphore>,
    max: usize,
}

impl Seats {
    /// Creates `common` seats for everybody, and the reserve.
    #[must_use]
    pub fn new(common: usize) -> Self {
        let [open, reserve] = [common, RESERVE].map(|seats| Arc::new(Semaphore::new(seats)));
        Self { common: open, reserve, max: common + RESERVE }
    }

    /// Takes a seat, if there is one for this role.
    #[must_use]
    pub fn take(&self, role: Role) -> Option<OwnedSemaphorePermit> {
        let common = self.common.clone().try_acquire_owned().ok();
        common.or_else(|| self.reserve.clone().try_acquire_owned().ok().filter(|_| role >= Role::Operator))
    }

    /// Number of taken seats.
    #[must_use]
    pub fn taken(&self) -> usize {
        self.max.saturating_sub(self.common.available_permits() + self.reserve.available_permits())
    }
}

/// Counters of the server's bus connection.
#[derive(Debug, Default)]
pub struct BusCounts {
    pub(super) turns: AtomicU32,
    pub(super) lost: AtomicU32,
    pub(super) broken: AtomicU32,
    pub(super) untranslated: AtomicU32,
}

impl BusCounts {
    /// Number of turns of the loop.
    pub fn turns(&self) -> u32 {
        self.turns.load(Relaxed)
    }

    /// Number of messages lost for lack of buffer space.
    pub fn lost(&self) -> u32 {
        self.lost.load(Relaxed)
    }

    /// Number of failed reads from the bus.
    pub fn broken(&self) -> u32 {
        self.broken.load(Relaxed)
    }

    /// Number of messages without a ROS 2 form.
    pub fn untranslated(&self) -> u32 {
        self.untranslated.load(Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viewers_leave_seats_for_who_may_stop_the_robot() {
        let seats = Seats::new(2);
        let mut taken: Vec<_> =
            [Role::Operator, Role::Viewer].into_iter().filter_map(|role| seats.take(role)).collect();
        assert_eq!(taken.len(), 2);
        assert!(seats.take(Role::Viewer).is_none() && seats.take(Role::Nobody).is_none());
        taken.extend((0..RESERVE).filter_map(|_| seats.take(Role::Operator)));
        assert_eq!((taken.len(), seats.taken()), (2 + RESERVE, 2 + RESERVE));
        assert!(seats.take(Role::Engineer).is_none());
        taken.clear();
        assert_eq!(seats.taken(), 0);
    }
}
