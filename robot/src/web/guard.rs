//! Who may ask: looked at before anything else, for each request and each WebSocket.
//!
//! - `Host` must be a name that the robot has, or the address that was reached: a page of somebody else whose name suddenly
//!   means this robot (DNS rebinding) names itself there.
//! - `Origin`, where a browser sends one, must be the robot's own page or one on the list: a WebSocket is not kept from other
//!   pages by the browser. Programs send none.
//! - The credentials, where some are configured, as `Authorization: Bearer TOKEN` or, for those who cannot set headers, as
//!   `?token=TOKEN`.

use super::server::Reached;
use super::stats::{Refusal, Stats};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;
use std::sync::Arc;

/// Who may.
#[derive(Clone, Debug, Default)]
pub struct Guard {
    /// Names of the robot besides `localhost` and its address, in lower case.
    pub hosts: Vec<String>,
    /// Whose pages may connect besides its own.
    pub origins: Vec<String>,
    /// The credentials; none: whoever reaches it.
    pub token: Option<String>,
}

impl Guard {
    /// Whether a request may be served that reached this address of ours.
    ///
    /// # Errors
    /// Why not.
    pub fn check(&self, reached: IpAddr, uri: &Uri, headers: &HeaderMap) -> Result<(), Refusal> {
        let host = single(headers, header::HOST.as_str()).ok().flatten();
        let host = host.filter(|host| self.is_ours(reached, host)).ok_or(Refusal::Host)?;
        let origin = single(headers, header::ORIGIN.as_str()).map_err(|()| Refusal::Origin)?;
        if origin.is_some_and(|origin| !self.is_welcome(origin, host)) {
            return Err(Refusal::Origin);
        }
        match &self.token {
            Some(token) if !brings(token, uri, headers) => Err(Refusal::Credentials),
            _ => Ok(()),
        }
    }

    /// Whether `host`, with or without a port, is us. The port may be another one: that of a tunnel.
    fn is_ours(&self, reached: IpAddr, host: &str) -> bool {
        let name = without_port(host).to_ascii_lowercase();
        let address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
        match address {
            Ok(address) => address == reached || address.is_loopback() && reached.is_loopback(),
            Err(_) => name == "localhost" && reached.is_loopback() || self.hosts.contains(&name),
        }
    }

    /// Whether `origin` is on the list, or the page that this very `host` has served.
    fn is_welcome(&self, origin: &str, host: &str) -> bool {
        let own = ["http://", "https://"]
            .iter()
            .any(|scheme| origin.strip_prefix(scheme).is_some_and(|authority| authority.eq_ignore_ascii_case(host)));
        own || self.origins.iter().any(|welcome| welcome.eq_ignore_ascii_case(origin))
    }
}

/// The value of a header that stands there once or not at all.
fn single<'a>(headers: &'a HeaderMap, name: &str) -> Result<Option<&'a str>, ()> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| ()),
        (Some(_), Some(_)) => Err(()),
    }
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        // Without brackets the last colon of an IPv6 address is no port's; such a Host is none.
        Some((name, port)) if !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

fn brings(token: &str, uri: &Uri, headers: &HeaderMap) -> bool {
    let authorization = single(headers, header::AUTHORIZATION.as_str()).ok().flatten();
    let bearer = authorization.and_then(|value| value.strip_prefix("Bearer "));
    let query = uri.query().unwrap_or_default();
    let asked = query.split('&').find_map(|pair| pair.strip_prefix("token="));
    [bearer, asked].into_iter().flatten().any(|given| is_same(given.as_bytes(), token.as_bytes()))
}

/// Takes as long whatever the first difference is.
fn is_same(given: &[u8], token: &[u8]) -> bool {
    given.len() == token.len() && given.iter().zip(token).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// Guards every route, those too that are not there.
pub async fn guarded(State((guard, stats)): State<(Arc<Guard>, Arc<Stats>)>, request: Request, next: Next) -> Response {
    let reached = request.extensions().get::<Reached>().copied();
    // A connection of which that is not known is none of the server's.
    let checked = reached
        .map_or(Err(Refusal::Host), |Reached(address)| guard.check(address.ip(), request.uri(), request.headers()));
    let mut response = match checked {
        Ok(()) => next.run(request).await,
        Err(refusal) => {
            let name = match refusal {
                Refusal::Host => header::HOST,
                Refusal::Origin => header::ORIGIN,
                _ => header::AUTHORIZATION,
            };
            // Credentials are nobody's business.
            let shown = request.headers().get(&name).filter(|_| refusal != Refusal::Credentials);
            stats.refuse(refusal, shown.and_then(|value| value.to_str().ok()).unwrap_or_default());
            let code = match refusal {
                Refusal::Credentials => StatusCode::UNAUTHORIZED,
                _ => StatusCode::FORBIDDEN,
            };
            (code, format!("refused: {}\n", refusal.why())).into_response()
        }
    };
    let headers = response.headers_mut();
    for (name, value) in HEADERS {
        headers.insert(name, header::HeaderValue::from_static(value));
    }
    response
}

/// With every answer: nothing from elsewhere, in nobody's frame, nothing kept, no credentials told to whoever is linked to.
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

    #[test]
    fn hosts_are_the_robots_own() {
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
    fn origins_are_ones_own_or_listed() {
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
    fn credentials_are_asked_for_where_there_are_some() {
        let guard = Guard { token: Some("0123456789abcdef".into()), ..Guard::default() };
        let host = ("host", "localhost");
        let refused = Some(Refusal::Credentials);
        assert_eq!(ask(&guard, LOOPBACK, "/", &[host]), refused);
        assert_eq!(ask(&guard, LOOPBACK, "/?token=0123456789abcdef", &[host]), None);
        assert_eq!(ask(&guard, LOOPBACK, "/?a=b&token=0123456789abcdef&c", &[host]), None);
        assert_eq!(ask(&guard, LOOPBACK, "/?token=0123456789abcdeg", &[host]), refused);
        assert_eq!(ask(&guard, LOOPBACK, "/?token=", &[host]), refused);
        assert_eq!(ask(&guard, LOOPBACK, "/", &[host, ("authorization", "Bearer 0123456789abcdef")]), None);
        assert_eq!(ask(&guard, LOOPBACK, "/", &[host, ("authorization", "Basic 0123456789abcdef")]), refused);
    }
}
