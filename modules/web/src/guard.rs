//! Access control, applied first to each request and each WebSocket.
//!
//! - `Host` must be a name of the robot or the address of the connection: a foreign page whose name suddenly resolves
//!   to this robot (DNS rebinding) sends its own name.
//! - `Origin`, if sent by a browser, must be the robot's own page or listed: browsers do not keep foreign pages from
//!   opening WebSockets. Programs send none. Changes are reserved to the robot's own page.
//! - Then the user is identified, and each route requires a role. The credentials of `web.token_file` are an engineer's
//!   as `Authorization: Bearer TOKEN`, and a viewer's, for clients that cannot set headers, as `?token=TOKEN`, because
//!   addresses are written to logs.

use super::center::access::{Role, Who, is_same};
use super::center::session_store::SessionStore;
use super::connections::Seat;
use super::request::{Reached, Unpaired, cookie_name, refused, single, without_port};
use super::stats::{Refusal, Stats};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::Response;
use host::clock;
use std::net::IpAddr;
use std::sync::Arc;

/// Access rules.
#[derive(Clone, Debug, Default)]
pub struct Guard {
    /// Names of the robot besides `localhost` and its address, in lower case.
    pub hosts: Vec<String>,
    /// Foreign pages that may connect.
    pub origins: Vec<String>,
    /// Credentials; `None`: any client on a loopback address is a viewer.
    pub token: Option<String>,
}

/// Origin of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// No origin: a program, or a browser opening the page.
    None,
    /// The robot's own page.
    Own,
    /// Listed in `web.origins`.
    Listed,
}

impl Guard {
    /// Origin of a request to this address, and the role that it has without pairing.
    ///
    /// # Errors
    /// Reason for refusing every user.
    pub fn check(&self, reached: IpAddr, uri: &Uri, headers: &HeaderMap) -> Result<(Origin, Role), Refusal> {
        let host = single(headers, header::HOST.as_str()).ok().flatten();
        let host = host.filter(|host| self.is_ours(reached, host)).ok_or(Refusal::Host)?;
        let origin = match single(headers, header::ORIGIN.as_str()).map_err(|()| Refusal::Origin)? {
            None => Origin::None,
            Some(origin) => self.origin(origin, host).ok_or(Refusal::Origin)?,
        };
        if self.token.is_none() && headers.keys().any(|name| is_of_a_proxy(name.as_str())) {
            return Err(Refusal::Proxy);
        }
        Ok((origin, self.role(reached, uri, headers)))
    }

    /// True if `host`, with or without a port, is this robot. The port may be that of a tunnel.
    fn is_ours(&self, reached: IpAddr, host: &str) -> bool {
        let name = without_port(host).to_ascii_lowercase();
        let address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
        match address {
            Ok(address) => address == reached || address.is_loopback() && reached.is_loopback(),
            Err(_) => name == "localhost" && reached.is_loopback() || self.hosts.contains(&name),
        }
    }

    /// Origin of a page that this very `host` served, or that is listed.
    fn origin(&self, origin: &str, host: &str) -> Option<Origin> {
        let own = ["http://", "https://"]
            .iter()
            .any(|scheme| origin.strip_prefix(scheme).is_some_and(|authority| authority.eq_ignore_ascii_case(host)));
        let listed = || self.origins.iter().any(|welcome| welcome.eq_ignore_ascii_case(origin));
        if own { Some(Origin::Own) } else { listed().then_some(Origin::Listed) }
    }

    /// Role by credentials, or by the address.
    fn role(&self, reached: IpAddr, uri: &Uri, headers: &HeaderMap) -> Role {
        let Some(token) = &self.token else {
            return if reached.is_loopback() { Role::Viewer } else { Role::Nobody };
        };
        let authorization = single(headers, header::AUTHORIZATION.as_str()).ok().flatten();
        let bearer = authorization.and_then(|value| value.strip_prefix("Bearer "));
        let query = uri.query().unwrap_or_default();
        let asked = query.split('&').find_map(|pair| pair.strip_prefix("token="));
        let is = |given: Option<&str>| given.is_some_and(|given| is_same(given.as_bytes(), token.as_bytes()));
        match (is(bearer), is(asked)) {
            (true, _) => Role::Engineer,
            (false, true) => Role::Viewer,
            (false, false) => Role::Nobody,
        }
    }
}

/// True for a header by which a proxy says on whose behalf it sends the request (RFC 7239, and those used before it).
/// The client of a proxy on this computer may be anywhere, though the connection comes from a loopback address.
fn is_of_a_proxy(header: &str) -> bool {
    ["forwarded", "via", "x-real-ip", "x-client-ip", "cf-connecting-ip"].contains(&header)
        || header.starts_with("x-forwarded-")
}

/// Session key of a request.
fn key<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = cookies.flat_map(|cookies| cookies.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(key, _)| *key == name).map(|(_, value)| value)
}

/// Guards every route, including unknown ones.
pub async fn guarded(
    State((guard, stats, session_store)): State<(Arc<Guard>, Arc<Stats>, Arc<SessionStore>)>,
    mut request: Request,
    next: Next,
) -> Response {
    let reached = request.extensions().get::<Reached>().copied();
    let seat = request.extensions().get::<Seat>().cloned();
    // A connection without this information does not come from the server.
    let checked = reached
        .map_or(Err(Refusal::Host), |Reached(address)| guard.check(address.ip(), request.uri(), request.headers()));
    let mut response = match checked {
        Ok((origin, unpaired)) => {
            let port = reached.map_or(0, |Reached(address)| address.port());
            let key = key(request.headers(), &cookie_name(request.headers(), port));
            let paired = key.and_then(|key| session_store.access().who(clock::now(), key)).unwrap_or_default();
            let who = Who { role: paired.role.max(unpaired), ..paired };
            request.extensions_mut().insert(origin);
            request.extensions_mut().insert(Unpaired(unpaired));
            let role = who.role;
            request.extensions_mut().insert(who);
            let response = next.run(request).await;
            // Files of the page, too, keep the place of who has a role.
            if role >= Role::Viewer && !is_refused(response.status()) {
                seat.iter().for_each(|seat| seat.grant(role));
            }
            response
        }
        Err(refusal) => refuse(&stats, refusal, request.headers(), StatusCode::FORBIDDEN),
    };
    // Who is refused has no use for the connection, and keeps nobody else out of it.
    let closes = is_refused(response.status());
    let headers = response.headers_mut();
    if closes {
        headers.insert(header::CONNECTION, header::HeaderValue::from_static("close"));
    }
    for (name, value) in HEADERS {
        headers.entry(name).or_insert(header::HeaderValue::from_static(value));
    }
    response
}

fn is_refused(status: StatusCode) -> bool {
    [StatusCode::UNAUTHORIZED, StatusCode::FORBIDDEN].contains(&status)
}

/// Role required by a route.
#[derive(Clone, Copy, Debug)]
pub struct Needed {
    /// Minimum role.
    pub role: Role,
    /// Reserved to the robot's own page, and to programs that only read.
    pub own: bool,
}

/// Guards one route, after [`guarded`].
pub async fn needed(State((needed, stats)): State<(Needed, Arc<Stats>)>, request: Request, next: Next) -> Response {
    let origin = request.extensions().get().copied().unwrap_or(Origin::Listed);
    let role = request.extensions().get().map_or(Role::Nobody, |who: &Who| who.role);
    let looks = [Method::GET, Method::HEAD].contains(request.method());
    let refusal = match origin {
        Origin::Listed if needed.own => Some(Refusal::Origin),
        Origin::None if needed.own && !looks => Some(Refusal::Origin),
        _ if role < needed.role => Some(Refusal::Credentials),
        _ => None,
    };
    match refusal {
        None => {
            // At once: the answer may take a while, and the place must not be taken meanwhile.
            if let Some(seat) = request.extensions().get::<Seat>().filter(|_| role >= Role::Viewer) {
                seat.grant(role);
            }
            next.run(request).await
        }
        Some(Refusal::Credentials) if role == Role::Nobody => {
            refuse(&stats, Refusal::Credentials, request.headers(), StatusCode::UNAUTHORIZED)
        }
        Some(refusal) => refuse(&stats, refusal, request.headers(), StatusCode::FORBIDDEN),
    }
}

fn refuse(stats: &Stats, refusal: Refusal, headers: &HeaderMap, code: StatusCode) -> Response {
    let shown = match refusal {
        Refusal::Host => headers.get(header::HOST),
        Refusal::Origin => headers.get(header::ORIGIN),
        // Credentials are never shown.
        _ => None,
    };
    stats.refuse(refusal, shown.and_then(|value| value.to_str().ok()).unwrap_or_default());
    refused(code, refusal.name())
}

/// Headers of every answer that does not set its own: no foreign content, no framing, no caching, no referrer.
const HEADERS: [(header::HeaderName, &str); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
];

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    const LOOPBACK: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

    fn ask(guard: &Guard, reached: IpAddr, uri: &str, headers: &[(&'static str, &str)]) -> Option<Refusal> {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, HeaderValue::from_str(value).unwrap());
        }
        guard.check(reached, &uri.parse().unwrap(), &map).err()
    }

    fn role(guard: &Guard, reached: IpAddr, uri: &str, headers: &[(&'static str, &str)]) -> Role {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, HeaderValue::from_str(value).unwrap());
        }
        guard.check(reached, &uri.parse().unwrap(), &map).unwrap().1
    }

    #[test]
    fn only_the_robot_s_own_host_names_are_accepted() {
        let guard = Guard { hosts: vec!["advee.local".into()], ..Guard::default() };
        let ask = |reached: &str, host: &str| ask(&guard, reached.parse().unwrap(), "/", &[("host", host)]);
        for host in ["localhost", "LocalHost:8080", "127.0.0.1:8080", "127.0.0.1", "[::1]:9000", "advee.local:80"] {
            assert_eq!(ask("127.0.0.1", host), None, "{host}");
        }
        for host in ["evil.example", "advee.local.evil.example", "10.0.0.5", "", "localhost.", ":8080", "advee.local:x"]
        {
            assert_eq!(ask("127.0.0.1", host), Some(Refusal::Host), "{host}");
        }
        assert_eq!(ask("10.0.0.5", "10.0.0.5:8080"), None);
        assert_eq!(ask("10.0.0.5", "localhost:8080"), Some(Refusal::Host), "reached from outside");
        assert_eq!(ask("10.0.0.5", "10.0.0.6"), Some(Refusal::Host));
        let twice = [("host", "localhost"), ("host", "evil.example")];
        assert_eq!(super::tests::ask(&guard, LOOPBACK, "/", &twice), Some(Refusal::Host));
        assert_eq!(super::tests::ask(&guard, LOOPBACK, "/", &[]), Some(Refusal::Host));
    }

    #[test]
    fn only_own_and_listed_origins_are_accepted() {
        let origins = vec!["https://app.foxglove.dev".into(), "file://".into()];
        let guard = Guard { origins, ..Guard::default() };
        let ask = |origin: &str| ask(&guard, LOOPBACK, "/", &[("host", "localhost:8080"), ("origin", origin)]);
        for origin in ["http://localhost:8080", "https://localhost:8080", "https://app.foxglove.dev", "file://"] {
            assert_eq!(ask(origin), None, "{origin}");
        }
        let strange =
            ["http://localhost:3000", "https://app.foxglove.dev.evil.example", "null", "", "https://evil.example"];
        for origin in strange {
            assert_eq!(ask(origin), Some(Refusal::Origin), "{origin}");
        }
        let headers = [("host", "localhost"), ("origin", "file://"), ("origin", "https://evil.example")];
        assert_eq!(super::tests::ask(&guard, LOOPBACK, "/", &headers), Some(Refusal::Origin));
    }

    #[test]
    fn a_proxy_needs_credentials() {
        let open = Guard::default();
        let closed = Guard { token: Some("0123456789abcdef".into()), ..Guard::default() };
        for name in ["forwarded", "x-forwarded-for", "x-forwarded-proto", "x-forwarded-host", "x-real-ip", "via"] {
            let headers = [("host", "localhost:8080"), (name, "for=192.0.2.1")];
            assert_eq!(ask(&open, LOOPBACK, "/api/logs", &headers), Some(Refusal::Proxy), "{name}");
            assert_eq!(ask(&closed, LOOPBACK, "/api/logs", &headers), None, "{name}");
            assert_eq!(role(&closed, LOOPBACK, "/", &headers), Role::Nobody, "{name}");
        }
    }

    #[test]
    fn credentials_make_an_engineer_and_in_an_address_a_viewer() {
        let guard = Guard { token: Some("0123456789abcdef".into()), ..Guard::default() };
        let host = ("host", "localhost");
        let role = |uri: &str, headers: &[(&'static str, &str)]| role(&guard, LOOPBACK, uri, headers);
        assert_eq!(role("/", &[host]), Role::Nobody);
        assert_eq!(role("/?token=0123456789abcdef", &[host]), Role::Viewer);
        assert_eq!(role("/?a=b&token=0123456789abcdef&c", &[host]), Role::Viewer);
        assert_eq!(role("/?token=0123456789abcdeg", &[host]), Role::Nobody);
        assert_eq!(role("/?token=", &[host]), Role::Nobody);
        assert_eq!(role("/", &[host, ("authorization", "Bearer 0123456789abcdef")]), Role::Engineer);
        assert_eq!(role("/", &[host, ("authorization", "Basic 0123456789abcdef")]), Role::Nobody);
    }

    #[test]
    fn the_cookie_is_named_by_the_requested_port() {
        let mut headers = HeaderMap::new();
        headers.insert("host", HeaderValue::from_static("localhost:9000"));
        assert_eq!(cookie_name(&headers, 8080), "advee-9000");
        for host in ["localhost", "[::1]", "localhost:99999"] {
            headers.insert("host", HeaderValue::try_from(host).unwrap());
            assert_eq!(cookie_name(&headers, 8080), "advee-8080", "{host}");
        }
        headers.append("cookie", HeaderValue::from_static("a=b; advee-80=x"));
        headers.append("cookie", HeaderValue::from_static("advee-8080=abc; advee-8080=def"));
        assert_eq!(key(&headers, "advee-8080"), Some("abc"));
        assert_eq!(key(&headers, "advee-808"), None);
    }

    #[test]
    fn without_credentials_only_local_clients_may_view() {
        let guard = Guard { hosts: vec!["advee.local".into()], ..Guard::default() };
        assert_eq!(role(&guard, LOOPBACK, "/?token=x", &[("host", "localhost")]), Role::Viewer);
        assert_eq!(role(&guard, "10.0.0.5".parse().unwrap(), "/", &[("host", "advee.local")]), Role::Nobody);
    }
}
