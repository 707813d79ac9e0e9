//! State of the server that all routes share.

use super::center::Center;
use super::center::command_queue::CommandQueue;
use super::center::session_store::SessionStore;
use super::foxglove::hub::Hub;
use super::stats::Stats;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::{Semaphore, watch};

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
    /// Permits for command sockets.
    pub commanders: Arc<Semaphore>,
    /// Permits for requested objects.
    pub objects: Arc<Semaphore>,
    /// The bus.
    pub lcm_url: Arc<str>,
    /// The robot's name.
    pub robot: Arc<str>,
    /// Identifier of this start of the server.
    pub session: Arc<str>,
    /// Permits for viewers.
    pub seats: Arc<Semaphore>,
    /// Maximum number of viewers.
    pub seats_max: usize,
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
        self.seats_max.saturating_sub(self.seats.available_permits())
    }

    /// Locks the hub.
    pub fn hub(&self) -> MutexGuard<'_, Hub> {
        self.hub.lock().unwrap_or_else(PoisonError::into_inner)
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
