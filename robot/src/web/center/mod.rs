//! The diagnostic center in a browser: what page and server say to each other stands in `web/src/protocol.ts`.

pub mod access;
pub mod authority;
pub mod command;
mod demo;
pub mod desk;
mod inspect;
pub mod keeper;
pub mod objects;
pub mod operator;
pub mod pairing;
mod parts;
mod scene;
mod show;
pub mod viewer;

pub use parts::Beside;
pub use scene::Scene;
pub use show::Show;

use base::Instant;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::Semaphore;

/// Files that are downloaded at once.
const DOWNLOADS_MAX: usize = 8;

/// What all of its viewers share.
pub struct Center {
    /// The robot.
    pub show: Show,
    /// What stays as it is.
    pub scene: Scene,
    /// What its model begins with.
    pub config: diagnostics::Config,
    /// The folder of recorded runs.
    pub logs: Arc<Path>,
    /// One for each recorded run that may be played at once.
    pub demos: Arc<Semaphore>,
    /// One for each file that may be downloaded at once.
    pub downloads: Arc<Semaphore>,
}

impl Center {
    /// Of a robot of which nothing is known yet.
    #[must_use]
    pub fn new(scene: Scene, config: diagnostics::Config, logs: &Path) -> Self {
        Self {
            show: Show::new(config.clone()),
            scene,
            config,
            logs: logs.into(),
            demos: Arc::new(Semaphore::new(demo::VIEWERS_MAX)),
            downloads: Arc::new(Semaphore::new(DOWNLOADS_MAX)),
        }
    }

    /// The run that is being recorded now.
    #[must_use]
    pub fn recording(&self, now: Instant) -> Option<String> {
        self.show.look(|model| model.log.fresh(now).filter(|log| log.recording).map(|log| log.run.clone()))
    }
}
