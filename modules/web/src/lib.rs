//! The robot's web server: what a browser, or Foxglove, is shown of the robot, from the robot itself.
//!
//! ```text
//!   LCM bus ──► bus ─┬► foxglove::hub ──► foxglove::endpoint ──► /foxglove     a queue for each viewer
//!                    └► center::show ───► center::viewer ──────► /ws/view      the newest for each viewer
//!                                         pages ───────────────► / /layout.json /health
//!                       module ──starts──► server ──► guard ──► router
//!   LCM bus ◄── center::desk ◄── center::operator ◄── /ws/command    who may: center::access, keeper, authority
//! ```
//!
//! It runs as a module, on the live host, like all others; the server has a thread of its own with a runtime for many
//! sockets, and its own place on the bus. Nobody waits for it: it is not critical, and a viewer that is slow, or lies,
//! costs nobody else anything. Only `center::desk` and `center::objects` publish on the bus, for who is paired.
//!
//! ```
//! use web::ROUTES;
//! use web::center::access::Role;
//! use web::settings::Web;
//!
//! // Without a token file only this machine may connect.
//! assert!(Web::default().listen.ip().is_loopback());
//!
//! // Each path needs a role; what changes something is for pages of the robot's own only.
//! let view = ROUTES.iter().find(|route| route.path == "/ws/view").expect("the page lives by it");
//! assert!(view.own && view.role == Role::Viewer);
//! let unpair = ROUTES.iter().find(|route| route.path == "/api/unpair").expect("an operator ends a pairing");
//! assert!(unpair.own && unpair.role == Role::Operator);
//! ```
#![forbid(unsafe_code)]

mod app;
mod assets;
mod bus;
pub mod center;
pub mod foxglove;
mod guard;
mod logs;
mod module;
mod pages;
mod request;
mod router;
mod server;
pub mod settings;
mod socket;
mod stats;

pub use module::{Settings, Web, token};
pub use router::{ROUTES, Route};

/// Name on the bus.
pub const NAME: &str = "web";
