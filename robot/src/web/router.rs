//! What there is to ask for; what all who answer share.

use super::center::access::Role;
use super::center::desk::Desk;
use super::center::keeper::Keeper;
use super::center::{Center, operator, pairing, viewer};
use super::foxglove::{endpoint, hub::Hub};
use super::guard::{self, Guard, Needed};
use super::stats::Stats;
use super::{assets, bus, logs, pages};
use axum::routing::{MethodRouter, any, get, post};
use axum::{Router, middleware};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::{Semaphore, watch};

/// What all who answer share.
#[derive(Clone)]
pub struct App {
    pub hub: Arc<Mutex<Hub>>,
    /// What pages are shown.
    pub center: Arc<Center>,
    pub bus: Arc<bus::Counts>,
    pub stats: Arc<Stats>,
    /// Who is paired.
    pub keeper: Arc<Keeper>,
    /// Who moves the robot.
    pub desk: Arc<Desk>,
    /// One for each command socket that may be.
    pub commanders: Arc<Semaphore>,
    /// One for each object that may be asked for at a time.
    pub objects: Arc<Semaphore>,
    /// The bus.
    pub lcm_url: Arc<str>,
    /// The robot's name.
    pub robot: Arc<str>,
    /// Another one after each start of the server.
    pub session: Arc<str>,
    /// One for each viewer that may be.
    pub seats: Arc<Semaphore>,
    /// How many those are.
    pub seats_max: usize,
    /// The longest message to a viewer, bytes.
    pub message_max: usize,
    /// True: the server ends.
    pub end: watch::Receiver<bool>,
    /// When it was started.
    pub started: Instant,
}

impl App {
    /// How many look, by whatever socket.
    pub fn viewers(&self) -> usize {
        self.seats_max.saturating_sub(self.seats.available_permits())
    }

    /// The hub, for a moment.
    pub fn hub(&self) -> MutexGuard<'_, Hub> {
        self.hub.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A place to ask at.
pub struct Route {
    /// Where; `{name}` is any one part, as axum has it.
    pub path: &'static str,
    /// Whom it answers at least.
    pub role: Role,
    /// Pages that others have served get no answer, `web.origins` or not, and what is no GET must come from a page of ours.
    pub own: bool,
    answers: fn() -> MethodRouter<App>,
}

/// Where everybody may look who may at all, Foxglove's page too.
const fn look(path: &'static str, role: Role, answers: fn() -> MethodRouter<App>) -> Route {
    Route { path, role, own: false, answers }
}

/// What the robot's own page alone asks for.
const fn own(path: &'static str, role: Role, answers: fn() -> MethodRouter<App>) -> Route {
    Route { path, role, own: true, answers }
}

/// All there is but the files of the page, which are everybody's: no route is anywhere else, and none without a role.
pub const ROUTES: &[Route] = &[
    look("/foxglove-help", Role::Viewer, || get(pages::index)),
    look("/layout.json", Role::Viewer, || get(pages::layout)),
    look("/health", Role::Viewer, || get(pages::health)),
    look("/foxglove", Role::Viewer, || any(endpoint::upgrade)),
    own("/ws/view", Role::Viewer, || any(viewer::upgrade)),
    own("/api/logs", Role::Viewer, || get(logs::list)),
    own("/api/logs/{run}/{*file}", Role::Viewer, || get(logs::download)),
    own("/api/me", Role::Nobody, || get(pairing::me)),
    own("/api/pair", Role::Nobody, || post(pairing::pair)),
    own("/api/unpair", Role::Operator, || post(pairing::unpair)),
    own("/api/devices", Role::Engineer, || get(pairing::devices)),
    own("/api/devices/forget", Role::Engineer, || post(pairing::forget)),
    own("/ws/command", Role::Viewer, || any(operator::upgrade)),
];

/// Every route, and the guard before it.
pub fn router(app: App, guard: Guard) -> Router {
    let guarded =
        middleware::from_fn_with_state((Arc::new(guard), app.stats.clone(), app.keeper.clone()), guard::guarded);
    let mut router = Router::new();
    for Route { path, role, own, answers } in ROUTES {
        let needed =
            middleware::from_fn_with_state((Needed { role: *role, own: *own }, app.stats.clone()), guard::needed);
        router = router.route(path, answers().layer(needed));
    }
    router.fallback(assets::serve).layer(guarded).with_state(app)
}
