//! The diagnostic center in a browser; the protocol of page and server is `modules/web/page/src/protocol.ts`.

pub mod access;
pub mod authority;
pub mod command;
pub mod command_queue;
mod demo;
mod inspect;
pub mod objects;
pub mod operator;
pub mod pairing;
mod parts;
pub mod scene;
pub mod session_store;
mod view_publisher;
pub mod viewer;

pub use parts::ExtraState;
pub use scene::Scene;
pub use view_publisher::ViewPublisher;

use base::Instant;
use record::Header;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::Semaphore;

/// Maximum number of files downloaded at a time.
const DOWNLOADS_MAX: usize = 8;

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
    /// The folder of recorded runs.
    pub logs: Arc<Path>,
    /// Permits for recorded runs played at once.
    pub demos: Arc<Semaphore>,
    /// Permits for files downloaded at once.
    pub downloads: Arc<Semaphore>,
}

impl Center {
    /// Creates the center of a robot without any message yet.
    #[must_use]
    pub fn new(scene: Scene, recorded: fn(&Header) -> Option<Scene>, config: diagnostics::Config, logs: &Path) -> Self {
        Self {
            show: ViewPublisher::new(config.clone()),
            scene,
            recorded,
            config,
            logs: logs.into(),
            demos: Arc::new(Semaphore::new(demo::VIEWERS_MAX)),
            downloads: Arc::new(Semaphore::new(DOWNLOADS_MAX)),
        }
    }

    /// Name of the run that is being recorded.
    #[must_use]
    pub fn recording(&self, now: Instant) -> Option<String> {
        self.show.look(|model| model.log.fresh(now).filter(|log| log.recording).map(|log| log.run.clone()))
    }
}
