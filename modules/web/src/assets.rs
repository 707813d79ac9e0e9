//! The page of the diagnostic center as embedded in the program.

use super::request::refused;
use axum::body::{Body, Bytes};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Method, Response, StatusCode, header};
use axum::response::{Html, IntoResponse};
use flate2::bufread::GzDecoder;
use std::io::Read;

/// A file of the page.
pub struct File {
    path: &'static str,
    content_type: &'static str,
    /// True if its name depends on its content: a browser may cache it for good.
    hashed: bool,
    /// Entity tag, which depends on the content.
    tag: &'static str,
    /// Content, compressed with gzip.
    packed: &'static [u8],
}

include!(concat!(env!("OUT_DIR"), "/page.rs"));

/// Maximum size of an unpacked file, bytes.
const UNPACKED_MAX: u64 = 16 << 20;

/// Answer where the page has not been built.
const UNBUILT: &str = "<!doctype html><meta charset=utf-8><title>Advee</title>\n\
    <h1>The page is missing</h1>\n\
    <p>This program was built without the page of the diagnostic center. Build that first, then the program:\n\
    <pre>make build</pre>\n\
    <p>The robot is served all the same: <a href=/foxglove-help>live in Foxglove</a>, <a href=/health>how the server is</a>, \
    and <code>advee diag</code> in a terminal.\n";

/// Answers all other paths: a file of the page, or not found.
pub async fn serve(request: Request) -> Response<Body> {
    let path = match request.uri().path() {
        "/" => "/index.html",
        path => path,
    };
    if ![Method::GET, Method::HEAD].contains(request.method()) {
        return StatusCode::METHOD_NOT_ALLOWED.into_response();
    }
    match FILES.iter().find(|file| file.path == path) {
        Some(file) => answer(file, request.headers()),
        None if path == "/index.html" => Html(UNBUILT).into_response(),
        None => refused(StatusCode::NOT_FOUND, "there is nothing here; / says what there is"),
    }
}

fn answer(file: &File, asked: &HeaderMap) -> Response<Body> {
    let header = |name| asked.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let keep = if file.hashed { "public, max-age=31536000, immutable" } else { "no-cache" };
    let mut headers = HeaderMap::new();
    let mut put = |name, value: &str| {
        if let Ok(value) = HeaderValue::from_str(value) {
            headers.insert(name, value);
        }
    };
    put(header::CACHE_CONTROL, keep);
    put(header::ETAG, file.tag);
    put(header::VARY, "accept-encoding");
    put(header::CONTENT_SECURITY_POLICY, &policy(header(header::HOST)));
    if header(header::IF_NONE_MATCH).split(',').any(|tag| tag.trim().trim_start_matches("W/") == file.tag) {
        return (StatusCode::NOT_MODIFIED, headers).into_response();
    }
    put(header::CONTENT_TYPE, file.content_type);
    if takes_gzip(header(header::ACCEPT_ENCODING)) {
        put(header::CONTENT_ENCODING, "gzip");
        return (headers, Bytes::from_static(file.packed)).into_response();
    }
    let mut bytes = Vec::new();
    match GzDecoder::new(file.packed).take(UNPACKED_MAX).read_to_end(&mut bytes) {
        Ok(_) => (headers, bytes).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// Content security policy: the page's own files and sockets only. Older browsers take a WebSocket for another origin;
/// the guard has checked `host`.
fn policy(host: &str) -> String {
    let named = host.chars().all(|c| c.is_ascii_alphanumeric() || ".-_:[]".contains(c)) && !host.is_empty();
    let sockets = if named { format!(" ws://{host} wss://{host}") } else { String::new() };
    format!(
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'{sockets}; \
        manifest-src 'self'; worker-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    )
}

/// True if gzip is acceptable (RFC 9110, 12.5.3), and not refused by a weight of zero.
fn takes_gzip(accepted: &str) -> bool {
    accepted.split(',').any(|coding| {
        let mut words = coding.split(';').map(str::trim);
        let named = words.next().is_some_and(|name| name.eq_ignore_ascii_case("gzip") || name == "*");
        let weight = words.find_map(|word| word.strip_prefix("q=")).map_or(Ok(1.0), str::parse::<f32>);
        named && weight.is_ok_and(|weight| weight > 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gzip_is_accepted_or_not() {
        for (accepted, takes) in [
            ("gzip, deflate, br", true),
            ("br;q=1.0, GZIP;q=0.5", true),
            ("*", true),
            ("", false),
            ("br", false),
            ("gzip;q=0", false),
            ("gzip;q=x", false),
        ] {
            assert_eq!(takes_gzip(accepted), takes, "{accepted}");
        }
    }

    #[test]
    fn a_host_name_cannot_end_a_part_of_the_policy() {
        assert!(policy("localhost:8080").contains("connect-src 'self' ws://localhost:8080 wss://localhost:8080;"));
        for host in ["", "x; script-src *", "x y", "a'b"] {
            assert!(policy(host).contains("connect-src 'self';"), "{host}");
        }
    }

    #[test]
    fn every_file_of_the_page_unpacks_and_has_its_own_tag() {
        for file in FILES {
            let mut bytes = Vec::new();
            GzDecoder::new(file.packed).take(UNPACKED_MAX).read_to_end(&mut bytes).unwrap();
            assert!((bytes.len() as u64) < UNPACKED_MAX && file.path.starts_with('/'), "{}", file.path);
            let same = FILES.iter().filter(|other| other.tag == file.tag && other.path != file.path);
            assert!(same.clone().all(|other| other.packed == file.packed), "{}", file.path);
        }
    }
}
