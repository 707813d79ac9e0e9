//! What there is to ask for; what all who answer share.

use super::foxglove::{endpoint, hub::Hub};
use super::guard::{self, Guard};
use super::stats::Stats;
use super::{bus, pages};
use axum::http::StatusCode;
use axum::routing::{any, get};
use axum::{Router, middleware};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::{Semaphore, watch};

/// What all who answer share.
#[derive(Clone)]
pub struct App {
    pub hub: Arc<Mutex<Hub>>,
    pub bus: Arc<bus::Counts>,
    pub stats: Arc<Stats>,
    /// The robot's name.
    pub robot: Arc<str>,
    /// Another one after each start of the server.
    pub session: Arc<str>,
    /// One for each viewer that may be.
    pub seats: Arc<Semaphore>,
    /// The longest message to a viewer, bytes.
    pub message_max: usize,
    /// True: the server ends.
    pub end: watch::Receiver<bool>,
    /// When it was started.
    pub started: Instant,
}

impl App {
    /// The hub, for a moment.
    pub fn hub(&self) -> MutexGuard<'_, Hub> {
        self.hub.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Every route, and the guard before it.
pub fn router(app: App, guard: Guard) -> Router {
    let guarded = middleware::from_fn_with_state((Arc::new(guard), app.stats.clone()), guard::guarded);
    Router::new()
        .route("/", get(pages::index))
        .route("/layout.json", get(pages::layout))
        .route("/health", get(pages::health))
        .route("/foxglove", any(endpoint::upgrade))
        .fallback(|| async { (StatusCode::NOT_FOUND, "there is nothing here; / says what there is\n") })
        .layer(guarded)
        .with_state(app)
}
