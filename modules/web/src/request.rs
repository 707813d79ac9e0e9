//! Common parts of requests and refusals, for the guard and the routes.

use super::center::access::Role;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use std::net::{IpAddr, SocketAddr};

/// Local address of the connection of a request.
#[derive(Clone, Copy, Debug)]
pub struct Reached(pub SocketAddr);

/// Address from which a request came.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub IpAddr);

/// Role of a request without its session.
#[derive(Clone, Copy, Debug)]
pub struct Unpaired(pub Role);

/// Value of a header that may occur at most once.
///
/// # Errors
/// It occurs twice, or is not text.
#[allow(clippy::result_unit_err, reason = "the guard has one answer to it")]
pub fn single<'a>(headers: &'a HeaderMap, name: &str) -> Result<Option<&'a str>, ()> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| ()),
        (Some(_), Some(_)) => Err(()),
    }
}

/// A `Host` without its port.
pub fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        // Without brackets the last colon of an IPv6 address starts no port; such a Host is invalid.
        Some((name, port)) if !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

/// Name of the session cookie, with the port that the page was requested at, so that two robots behind two ports of one
/// name do not overwrite each other's.
pub fn cookie_name(headers: &HeaderMap, port: u16) -> String {
    let host = single(headers, header::HOST.as_str()).ok().flatten().unwrap_or_default();
    let asked = host.strip_prefix(without_port(host)).and_then(|port| port.strip_prefix(':'));
    format!("advee-{}", asked.and_then(|asked| asked.parse().ok()).unwrap_or(port))
}

/// Body of every answer that reports no success.
#[derive(Serialize)]
struct Refused<'a> {
    /// Reason, for people.
    why: &'a str,
}

/// Answer to a refused request, with the reason.
pub fn refused(code: StatusCode, why: &str) -> Response {
    let body = serde_json::to_string(&Refused { why }).unwrap_or_default();
    (code, [(header::CONTENT_TYPE, "application/json")], body).into_response()
}
