//! `/api/me`, `/api/pair`, `/api/unpair`, `/api/devices`, `/api/devices/forget`, `/api/invite`: identity and pairing of
//! devices.

use super::access::{Refused, Role, Who};
use crate::app::App;
use crate::connections::network;
use crate::request::{Peer, Reached, Unpaired, cookie_name, refused};
use crate::stats::Refusal;
use axum::Extension;
use axum::body::{Body, to_bytes};
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use host::clock;
use qrcode::{Color, QrCode};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::time::Duration;
use tokio::time::timeout;

/// Maximum length of a body, bytes.
const BODY_MAX: usize = 4 << 10;
/// Time limit for a request's body.
const BODY_TIME: Duration = Duration::from_secs(5);
/// Lifetime of the cookie in the browser, s; on the server a session ends after 12 h without use.
const COOKIE_AGE: u32 = 400 * 24 * 3600;

/// `GET /api/me`, for everybody.
#[derive(Serialize)]
struct Me<'a> {
    robot: &'a str,
    version: &'static str,
    role: Role,
    /// Name given when pairing; empty for a device that is not paired.
    name: &'a str,
}

/// `POST /api/pair`, with a code that `advee web code` shows on the robot's computer. Answers [`Me`] and sets the
/// session's cookie (HttpOnly, SameSite=Strict); 403 for a wrong code, 429 after too many. `POST /api/unpair` ends the
/// session.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pair {
    /// Eight digits; blanks are ignored.
    code: String,
    /// Name shown to others: 1 to 40 characters.
    name: String,
}

/// `POST /api/devices/forget` (engineer): ends the session of a device.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Forget {
    id: u32,
}

/// `POST /api/invite` (engineer): a code that pairs one further device as an operator's.
#[derive(Serialize)]
struct Invite {
    /// Eight digits.
    code: String,
    /// Time for which it pairs, s.
    valid_s: u64,
    /// Link that pairs at once; `None` if other devices do not reach the server.
    link: Option<String>,
    /// The link as a QR code: one text for each row of modules, `1` for dark; without a margin. Empty without a link.
    picture: Vec<String>,
}

/// `GET /api/me`
pub async fn me(State(app): State<App>, Extension(who): Extension<Who>) -> Response {
    introduce(&app, &who)
}

/// `POST /api/pair`
pub async fn pair(
    State(app): State<App>,
    Extension(Reached(reached)): Extension<Reached>,
    Extension(Peer(peer)): Extension<Peer>,
    Extension(before): Extension<Who>,
    request: Request,
) -> Response {
    let (headers, body) = split(request);
    let Pair { code, name } = match read(&headers, body).await {
        Ok(pair) => pair,
        Err(refusal) => return refusal,
    };
    let Ok(chance) = app.session_store.chance() else {
        return refused(StatusCode::SERVICE_UNAVAILABLE, "the robot's kernel gives no chance to make a key of");
    };
    let paired = app.session_store.access().pair(clock::now(), network(peer), &code, &name, &chance);
    let (key, who) = match paired {
        Ok(paired) => paired,
        Err(why) => {
            let status = match why {
                Refused::Name => StatusCode::BAD_REQUEST,
                Refused::Wrong => StatusCode::FORBIDDEN,
                Refused::TooMany => StatusCode::TOO_MANY_REQUESTS,
            };
            app.stats.refuse(Refusal::Code, "");
            return refused(status, why.why());
        }
    };
    // A device that pairs again stays one device.
    if let Some(device) = before.device {
        app.session_store.forget(device);
    }
    let mut response = introduce(&app, &who);
    set_cookie(&mut response, &headers, reached.port(), &key, COOKIE_AGE);
    response
}

/// `POST /api/unpair`
pub async fn unpair(
    State(app): State<App>,
    Extension(Reached(reached)): Extension<Reached>,
    Extension(who): Extension<Who>,
    Extension(Unpaired(role)): Extension<Unpaired>,
    request: Request,
) -> Response {
    let (headers, body) = split(request);
    if let Err(refusal) = read::<serde::de::IgnoredAny>(&headers, body).await {
        return refusal;
    }
    let Some(device) = who.device else {
        return refused(StatusCode::CONFLICT, "this device is not paired");
    };
    app.session_store.forget(device);
    let mut response = introduce(&app, &Who { role, ..Who::default() });
    set_cookie(&mut response, &headers, reached.port(), "", 0);
    response
}

/// `GET /api/devices`
pub async fn devices(State(app): State<App>, Extension(who): Extension<Who>) -> Response {
    json(&app.session_store.access().devices(clock::now(), who.device))
}

/// `POST /api/devices/forget`
pub async fn forget(State(app): State<App>, Extension(who): Extension<Who>, request: Request) -> Response {
    let (headers, body) = split(request);
    match read(&headers, body).await {
        Ok(Forget { id }) if app.session_store.forget(id) => {
            json(&app.session_store.access().devices(clock::now(), who.device))
        }
        Ok(_) => refused(StatusCode::NOT_FOUND, "no such device is paired"),
        Err(refusal) => refusal,
    }
}

/// `POST /api/invite`
pub async fn invite(State(app): State<App>, request: Request) -> Response {
    let (headers, body) = split(request);
    if let Err(refusal) = read::<serde::de::IgnoredAny>(&headers, body).await {
        return refusal;
    }
    let Ok(chance) = app.session_store.chance() else {
        return refused(StatusCode::SERVICE_UNAVAILABLE, "the robot's kernel gives no chance to make a code of");
    };
    let (code, valid) = app.session_store.access().operator_code(clock::now(), &chance);
    let page = headers.get(header::ORIGIN).and_then(|origin| origin.to_str().ok());
    let link = app.session_store.link(page, &code);
    let picture = link.as_deref().map(picture).unwrap_or_default();
    json(&Invite { code, valid_s: valid.as_secs(), link, picture })
}

/// Rows of a QR code; none if the text is too long for one.
fn picture(text: &str) -> Vec<String> {
    let Ok(code) = QrCode::new(text) else { return Vec::new() };
    let row = |row: &[Color]| row.iter().map(|module| module.select('1', '0')).collect();
    code.to_colors().chunks(code.width()).map(row).collect()
}

fn introduce(app: &App, who: &Who) -> Response {
    json(&Me { robot: &app.robot, version: env!("CARGO_PKG_VERSION"), role: who.role, name: &who.name })
}

fn json(what: &impl Serialize) -> Response {
    let text = serde_json::to_string(what).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json")], text).into_response()
}

fn split(request: Request) -> (HeaderMap, Body) {
    let (parts, body) = request.into_parts();
    (parts.headers, body)
}

/// Reads a body that is declared as JSON; a form of a foreign page cannot declare it.
async fn read<T: DeserializeOwned>(headers: &HeaderMap, body: Body) -> Result<T, Response> {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    let kind = kind.split(';').next().unwrap_or_default().trim();
    if !kind.eq_ignore_ascii_case("application/json") {
        return Err(refused(StatusCode::UNSUPPORTED_MEDIA_TYPE, "the body must be application/json"));
    }
    let Ok(Ok(bytes)) = timeout(BODY_TIME, to_bytes(body, BODY_MAX)).await else {
        return Err(refused(StatusCode::PAYLOAD_TOO_LARGE, "the body is longer than 4 KiB, or did not come"));
    };
    serde_json::from_slice(&bytes)
        .map_err(|_| refused(StatusCode::BAD_REQUEST, "the body is not what is expected here"))
}

fn set_cookie(response: &mut Response, headers: &HeaderMap, port: u16, key: &str, age: u32) {
    let encrypted = headers
        .get(header::ORIGIN)
        .and_then(|origin| origin.to_str().ok())
        .is_some_and(|origin| origin.starts_with("https://"));
    let secure = if encrypted { "; Secure" } else { "" };
    let name = cookie_name(headers, port);
    let cookie = format!("{name}={key}; Path=/; Max-Age={age}; HttpOnly; SameSite=Strict{secure}");
    if let Ok(value) = HeaderValue::try_from(cookie) {
        response.headers_mut().insert(header::SET_COOKIE, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_is_a_square_of_modules_with_three_corners() {
        let rows = picture("http://192.168.100.100:8080/#12345678");
        let size = rows.len();
        assert!((21..=41).contains(&size) && rows.iter().all(|row| row.len() == size), "{rows:?}");
        for (x, y) in [(0, 0), (size - 7, 0), (0, size - 7)] {
            let corner: Vec<&str> = rows[y..y + 7].iter().map(|row| &row[x..x + 7]).collect();
            assert_eq!(corner, ["1111111", "1000001", "1011101", "1011101", "1011101", "1000001", "1111111"]);
        }
        assert!(picture(&"x".repeat(4000)).is_empty());
    }
}
