//! The diagnostic center in a browser. Its protocol is two WebSockets, so that pictures never delay commands:
//!
//! - `/ws/view`, server to page: the parts of the view, each at its own rate; a slow page gets the newest only;
//! - `/ws/command`, both ways: commands, answers, round-trip time, the holder of the motion authority.
//!
//! Text frames carry one JSON object each. Messages have the fields of `docs/messages.md`, in SI units and radians,
//! counter-clockwise; NaN is `null`. A frame of more than 4 KiB (48 KiB for a `scenario`), or more than 100 frames a
//! second, closes the command socket.

// `make generate` writes modules/web/page/src/protocol.ts from the comment above and the types of this folder.

pub mod access;
pub mod authority;
pub mod command;
pub mod command_queue;
mod demo;
pub mod events;
mod inspect;
pub mod objects;
pub mod operator;
pub mod pairing;
mod parts;
pub mod publish;
mod recent;
pub mod recorded;
pub mod scene;
pub mod session_store;
mod sha256;
pub mod summaries;
mod view_publisher;
pub mod viewer;

pub use parts::ExtraState;
pub use scene::Scene;
pub use view_publisher::ViewPublisher;

use base::Instant;
use record::Header;
use std::path::Path;
use std::sync::Arc;
use summaries::Summaries;
use tokio::sync::Semaphore;

/// Maximum number of files downloaded at a time.
const DOWNLOADS_MAX: usize = 8;
/// Maximum number of runs that are read as a whole at a time.
const READS_MAX: usize = 1;

/// State shared by all of its viewers.
pub struct Center {
    /// The robot.
    pub show: ViewPublisher,
    /// Constant part of the view.
    pub scene: Scene,
    /// Configuration of its model.
    pub config: diagnostics::Config,
    /// Scene of a recorded run, from the configuration in its log.
    pub recorded: fn(&Header) -> Option<Scene>,
    /// PNG of a recorded run, from the log in its folder.
    pub picture: fn(&Path) -> Result<Vec<u8>, String>,
    /// The folder of recorded runs.
    pub logs: Arc<Path>,
    /// Permits for recorded runs played at once.
    pub demos: Arc<Semaphore>,
    /// Permits for files downloaded at once.
    pub downloads: Arc<Semaphore>,
    /// Permits for runs read as a whole at once.
    pub reads: Arc<Semaphore>,
    /// Summaries of runs that were read.
    pub summaries: Summaries,
}

impl Center {
    /// Creates the center of a robot without any message yet.
    #[must_use]
    pub fn new(
        scene: Scene,
        recorded: fn(&Header) -> Option<Scene>,
        picture: fn(&Path) -> Result<Vec<u8>, String>,
        config: diagnostics::Config,
        logs: &Path,
    ) -> Self {
        Self {
            show: ViewPublisher::new(config.clone()),
            scene,
            recorded,
            picture,
            config,
            logs: logs.into(),
            demos: Arc::new(Semaphore::new(demo::VIEWERS_MAX)),
            downloads: Arc::new(Semaphore::new(DOWNLOADS_MAX)),
            reads: Arc::new(Semaphore::new(READS_MAX)),
            summaries: Summaries::default(),
        }
    }

    /// Name of the run that is being recorded.
    #[must_use]
    pub fn recording(&self, now: Instant) -> Option<String> {
        self.show.look(|model| model.log.fresh(model.at(now)).filter(|log| log.recording).map(|log| log.run.clone()))
    }
}
