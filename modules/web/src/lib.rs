//! The robot's web server: its state for browsers and Foxglove, served by the robot itself.
//!
//! ```text
//!   LCM bus ──► bus ─┬► foxglove::hub ──► foxglove::endpoint ──► /foxglove      a queue for each viewer
//!                    └► center::view_publisher ──► center::viewer ──► /ws/view  the newest for each viewer
//!                                         pages ───────────────► / /layout.json /health
//!                       module ──starts──► server ──► guard ──► router
//!   LCM bus ◄── center::command_queue ◄── center::operator ◄── /ws/command
//!                       permissions: center::access, session_store, authority
//! ```
//!
//! It runs as a module on the live host, like all others; the server has its own thread with a runtime for many
//! sockets, and its own connection to the bus. It is not critical, and a slow or malicious viewer does not affect
//! anybody else. Only `center::command_queue` and `center::objects` publish on the bus, for paired users.
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
mod connections;
pub mod foxglove;
mod guard;
mod logs;
mod module;
mod pages;
mod reports;
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
