//! Table of all routes with their required roles.

use super::app::App;
use super::center::access::Role;
use super::center::{operator, pairing, viewer};
use super::foxglove::endpoint;
use super::guard::{self, Guard, Needed};
use super::{assets, logs, pages, reports};
use axum::routing::{MethodRouter, any, get, post};
use axum::{Router, middleware};
use std::sync::Arc;

/// A route.
pub struct Route {
    /// Path; `{name}` is any one segment, as in axum.
    pub path: &'static str,
    /// Minimum role.
    pub role: Role,
    /// Foreign pages are refused, whether or not in `web.origins`, and requests other than GET must come from our own
    /// page.
    pub own: bool,
    answers: fn() -> MethodRouter<App>,
}

/// Route for all viewers, Foxglove's page included.
const fn look(path: &'static str, role: Role, answers: fn() -> MethodRouter<App>) -> Route {
    Route { path, role, own: false, answers }
}

/// Route for the robot's own page only.
const fn own(path: &'static str, role: Role, answers: fn() -> MethodRouter<App>) -> Route {
    Route { path, role, own: true, answers }
}

/// All routes except the files of the page, which are public: no route is defined elsewhere, and each has a role.
pub const ROUTES: &[Route] = &[
    look("/foxglove-help", Role::Viewer, || get(pages::index)),
    look("/layout.json", Role::Viewer, || get(pages::layout)),
    look("/health", Role::Viewer, || get(pages::health)),
    look("/foxglove", Role::Viewer, || any(endpoint::upgrade)),
    own("/ws/view", Role::Viewer, || any(viewer::upgrade)),
    own("/api/logs", Role::Viewer, || get(logs::list)),
    own("/api/logs/{run}/{*file}", Role::Viewer, || get(logs::download)),
    own("/api/runs/{run}/events", Role::Viewer, || get(reports::events)),
    own("/api/runs/{run}/summary", Role::Viewer, || get(reports::summary)),
    own("/api/runs/{run}/report.png", Role::Viewer, || get(reports::picture)),
    own("/api/me", Role::Nobody, || get(pairing::me)),
    own("/api/pair", Role::Nobody, || post(pairing::pair)),
    own("/api/unpair", Role::Operator, || post(pairing::unpair)),
    own("/api/devices", Role::Engineer, || get(pairing::devices)),
    own("/api/devices/forget", Role::Engineer, || post(pairing::forget)),
    own("/api/invite", Role::Engineer, || post(pairing::invite)),
    own("/api/stop", Role::Operator, || post(operator::stop)),
    own("/ws/command", Role::Viewer, || any(operator::upgrade)),
];

/// Creates the router: every route, preceded by the guard.
pub fn router(app: App, guard: Guard) -> Router {
    let guarded =
        middleware::from_fn_with_state((Arc::new(guard), app.stats.clone(), app.session_store.clone()), guard::guarded);
    let mut router = Router::new();
    for Route { path, role, own, answers } in ROUTES {
        let needed =
            middleware::from_fn_with_state((Needed { role: *role, own: *own }, app.stats.clone()), guard::needed);
        router = router.route(path, answers().layer(needed));
    }
    router.fallback(assets::serve).layer(guarded).with_state(app)
}
