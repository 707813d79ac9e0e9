//! The server's thread: accepts connections, bounded in number, size and time, and passes them to the router.

use super::app::App;
use super::bus;
use super::connections::{Connections, Place, Seat};
use super::guard::Guard;
use super::request::{Peer, Reached};
use super::router::router;
use super::stats::{Refusal, Stats};
use axum::body::Body;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use nix::sys::socket::{setsockopt, sockopt};
use std::io::{self, IoSlice};
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::task::{Context, Poll};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::watch;

/// Timeout of a request's line and headers, and their maximum length and number. Browsers open connections before they
/// need them; where places are scarce, a silent connection gives way at once (`connections`).
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
const HEAD_MAX: usize = 16 << 10;
const HEADERS_MAX: usize = 64;
/// Send buffer in the kernel for a viewer, bytes: beyond it only the newest message counts.
const SEND_BUFFER: usize = 128 << 10;
/// Time without acknowledgements after which the kernel closes a connection, ms.
const UNACKNOWLEDGED_MAX_MS: u32 = 30_000;
/// Time for closing messages to viewers at the end.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(300);

/// The running server.
pub struct Server {
    thread: JoinHandle<()>,
    end: watch::Sender<bool>,
    /// Counters of refusals.
    pub stats: Arc<Stats>,
    /// Counts the turns of its loop, which shows that it is alive.
    pub bus: Arc<super::app::BusCounts>,
}

/// Parts of a server.
pub struct Parts {
    /// Listening socket.
    pub listener: TcpListener,
    /// Access rules.
    pub guard: Guard,
    /// Reader of the bus.
    pub bus: bus::BusReader,
    /// State shared by all routes; its `end` is replaced.
    pub app: App,
}

/// Listens at an address.
///
/// # Errors
/// The address is in use, or not one of this machine.
pub fn listen(at: SocketAddr) -> io::Result<TcpListener> {
    let listener = TcpListener::bind(at)?;
    listener.set_nonblocking(true)?;
    // Inherited by the connections.
    setsockopt(&listener, sockopt::SndBuf, &SEND_BUFFER)?;
    setsockopt(&listener, sockopt::TcpUserTimeout, &UNACKNOWLEDGED_MAX_MS)?;
    Ok(listener)
}

impl Server {
    /// Starts the server.
    ///
    /// # Errors
    /// No thread or runtime can be created.
    pub fn start(parts: Parts) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        let (end, ended) = watch::channel(false);
        let Parts { listener, guard, bus, mut app } = parts;
        app.end = ended.clone();
        let (stats, counts, command_queue) = (app.stats.clone(), app.bus.clone(), app.command_queue.clone());
        let work = async move {
            let listener = match tokio::net::TcpListener::from_std(listener) {
                Ok(listener) => listener,
                Err(error) => return app.stats.refuse(Refusal::Http, &error.to_string()),
            };
            let mut ended = ended;
            tokio::select! {
                () = bus.hear(app.clone()) => {}
                () = accept(listener, app, guard) => {}
                _ = ended.changed() => tokio::time::sleep(CLOSE_TIMEOUT).await,
            }
        };
        let thread = std::thread::Builder::new().name("web".into()).spawn(move || {
            runtime.block_on(work);
            // Closing the sockets releases their holds.
            drop(runtime);
            command_queue.close();
        })?;
        Ok(Self { thread, end, stats, bus: counts })
    }

    /// Ends the server; [`Self::has_ended`] returns true afterwards.
    pub fn end(&self) {
        self.end.send_replace(true);
    }

    /// True if it was asked to end.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        *self.end.borrow()
    }

    /// True if it has ended.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }
}

async fn accept(listener: tokio::net::TcpListener, app: App, guard: Guard) {
    let stats = app.stats.clone();
    let router = TowerToHyperService::new(router(app, guard));
    let connections = Connections::default();
    loop {
        let (stream, peer) = match listener.accept().await {
            Ok(accepted) => accepted,
            // No descriptor left, or the peer has gone: retried a little later.
            Err(_) => {
                tokio::time::sleep(Duration::from_millis(50)).await;
                continue;
            }
        };
        let Some(place) = connections.admit(peer.ip()) else {
            stats.refuse(Refusal::Connections, "");
            continue;
        };
        let (router, stats) = (router.clone(), stats.clone());
        tokio::spawn(async move { serve(stream, peer.ip(), router, &Arc::new(place), &stats).await });
    }
}

async fn serve(
    stream: TcpStream,
    peer: IpAddr,
    router: TowerToHyperService<axum::Router>,
    place: &Arc<Place>,
    stats: &Stats,
) {
    let Ok(reached) = stream.local_addr() else { return };
    // Small messages are sent at once.
    let _ = stream.set_nodelay(true);
    let seat = Seat(Arc::downgrade(place));
    // Browsers connect before they need it, and keep connections: only a request that has begun can be refused.
    let began = Arc::new(AtomicBool::new(false));
    let stream = Heard { stream, began: began.clone() };
    let heard = began.clone();
    let service = service_fn(move |request: hyper::Request<Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Reached(reached));
        request.extensions_mut().insert(Peer(peer));
        // Who is refused has said nothing that keeps the place: the guard decides.
        request.extensions_mut().insert(seat.clone());
        let (answer, heard) = (router.call(request), heard.clone());
        async move {
            let answer = answer.await;
            heard.store(false, Relaxed);
            answer
        }
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIMEOUT).max_buf_size(HEAD_MAX).max_headers(HEADERS_MAX);
    tokio::select! {
        served = http.serve_connection(TokioIo::new(stream), service).with_upgrades() => {
            if let Err(error) = served
                && (error.is_parse() || error.is_timeout() && began.load(Relaxed))
            {
                stats.refuse(Refusal::Http, &error.to_string());
            }
        }
        () = place.evicted() => stats.refuse(Refusal::Connections, ""),
    }
}

/// A connection that notes whether anything was read from it since the last answer.
struct Heard {
    stream: TcpStream,
    began: Arc<AtomicBool>,
}

impl AsyncRead for Heard {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = into.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(cx, into);
        if into.filled().len() > before {
            self.began.store(true, Relaxed);
        }
        read
    }
}

impl AsyncWrite for Heard {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(cx, parts)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use super::super::center::access::Role;
    use super::super::center::session_store::SessionStore;
    use super::super::guard::{self, Needed};
    use super::*;
    use axum::http::StatusCode;
    use axum::routing::{get, post};
    use axum::{Router, middleware};
    use std::future::Future;

    const TOKEN: &str = "Authorization: Bearer 0123456789abcdef\r\n";

    /// As viewers send it, who cannot set headers.
    const AS_VIEWER: &str = "/view?token=0123456789abcdef";

    /// A server with one route for viewers, one for operators, and a file for everybody.
    struct Bench {
        connections: Connections,
        router: TowerToHyperService<Router>,
        stats: Arc<Stats>,
    }

    impl Bench {
        fn new(name: &str) -> Self {
            let run = std::env::temp_dir().join(format!("advee-server-{name}-{}", std::process::id()));
            let (store, _) = SessionStore::open(&run, "127.0.0.1:8080".parse().unwrap(), &[]).unwrap();
            let stats = Arc::new(Stats::default());
            let guard = Guard { token: Some("0123456789abcdef".into()), ..Guard::default() };
            let needed = |role| (Needed { role, own: false }, stats.clone());
            let [viewer, operator] = [Role::Viewer, Role::Operator].map(needed);
            let stop = post(|| async { StatusCode::NO_CONTENT });
            let all = (Arc::new(guard), stats.clone(), Arc::new(store));
            let router = Router::new()
                .route("/view", get(|| async { "seen" }).layer(middleware::from_fn_with_state(viewer, guard::needed)))
                .route("/api/stop", stop.layer(middleware::from_fn_with_state(operator, guard::needed)))
                .fallback(|| async { "page" })
                .layer(middleware::from_fn_with_state(all, guard::guarded));
            Self { connections: Connections::default(), router: TowerToHyperService::new(router), stats }
        }

        /// A connection from `peer`, and what is answered to a request; `None`: there is no place for it.
        async fn ask(&self, peer: u8, path: &str, headers: &str) -> Option<(TcpStream, String)> {
            self.send("GET", peer, path, headers).await
        }

        async fn send(&self, method: &str, peer: u8, path: &str, headers: &str) -> Option<(TcpStream, String)> {
            let client = self.connect(peer).await?;
            let request = format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n");
            write(&client, &request).await;
            let answer = read(&client).await;
            Some((client, answer))
        }

        async fn connect(&self, peer: u8) -> Option<TcpStream> {
            let place = Arc::new(self.connections.admit(IpAddr::from([10, 0, 0, peer]))?);
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
            let client = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
            let (stream, from) = listener.accept().await.unwrap();
            let (router, stats) = (self.router.clone(), self.stats.clone());
            tokio::spawn(async move { serve(stream, from.ip(), router, &place, &stats).await });
            Some(client)
        }
    }

    async fn write(client: &TcpStream, text: &str) {
        client.writable().await.unwrap();
        assert_eq!(client.try_write(text.as_bytes()).unwrap(), text.len());
    }

    /// What comes next; empty at the end.
    async fn read(client: &TcpStream) -> String {
        let mut buffer = vec![0; 4096];
        loop {
            client.readable().await.unwrap();
            match client.try_read(&mut buffer) {
                Ok(count) => return String::from_utf8_lossy(&buffer[..count]).into(),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => panic!("{error}"),
            }
        }
    }

    fn run(work: impl Future<Output = ()>) {
        tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build().unwrap().block_on(work);
    }

    #[test]
    fn a_refused_request_ends_its_connection() {
        run(async {
            let bench = Bench::new("refused");
            for (headers, code) in [("", 401), ("Origin: http://evil.example\r\n", 403)] {
                let (client, answer) = bench.ask(1, "/view", headers).await.unwrap();
                assert!(answer.starts_with(&format!("HTTP/1.1 {code} ")), "{answer}");
                assert!(answer.contains("connection: close\r\n"), "{answer}");
                assert_eq!(read(&client).await, "", "it is closed");
            }
            let (_client, answer) = bench.ask(1, "/view", TOKEN).await.unwrap();
            assert!(answer.starts_with("HTTP/1.1 200 ") && !answer.contains("connection: close"), "{answer}");
        });
    }

    #[test]
    fn a_connection_that_says_nothing_is_closed_and_one_that_says_half_is_refused() {
        run(async {
            let bench = Bench::new("silent");
            let silent = bench.connect(1).await.unwrap();
            let (idle, answer) = bench.ask(1, "/", "").await.unwrap();
            assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
            let half = bench.connect(1).await.unwrap();
            write(&half, "GET / HTT").await;
            for client in [silent, idle, half] {
                assert_eq!(read(&client).await, "", "it is closed");
            }
            assert_eq!(bench.stats.counts().http, 1);
        });
    }

    #[test]
    fn who_is_refused_or_has_no_role_shuts_nobody_out() {
        run(async {
            let bench = Bench::new("shut");
            let mut held = Vec::new();
            // Eight addresses with all the places that each may have: what is refused, and what anybody may see.
            for n in 0..64 {
                let (_client, answer) = bench.ask(1 + n / 8, "/view", "").await.expect("a place");
                assert!(answer.starts_with("HTTP/1.1 401 "), "{answer}");
                held.push(bench.ask(1 + n / 8, "/", "").await.expect("a place"));
            }
            for _ in 0..super::super::connections::SHARE {
                let (client, answer) = bench.ask(100, "/view", TOKEN).await.expect("a place for who has a role");
                assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
                held.push((client, answer));
            }
            assert!(bench.connections.admit(IpAddr::from([10, 0, 0, 100])).is_none(), "these keep their places");
            held.push(bench.ask(1, "/", "").await.expect("the others do not"));
            // What the page consists of keeps the place of who has a role.
            for _ in 0..super::super::connections::SHARE {
                held.push(bench.ask(101, "/", TOKEN).await.expect("a place"));
            }
            assert!(bench.connections.admit(IpAddr::from([10, 0, 0, 101])).is_none());
        });
    }

    #[test]
    fn sixty_four_viewers_do_not_shut_out_the_operator_who_presses_stop() {
        run(async {
            let bench = Bench::new("stop");
            let mut held = Vec::new();
            // Eight addresses, eight viewers each, and all their requests are granted.
            for n in 0..64 {
                let (client, answer) = bench.ask(1 + n / 8, AS_VIEWER, "").await.expect("a place");
                assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
                held.push((client, answer));
            }
            // By an operator at an address of his own, and at one of theirs, as in a network behind one address.
            for address in [100, 1, 8] {
                let stop = bench.send("POST", address, "/api/stop", TOKEN).await;
                let (client, answer) = stop.expect("a place for who may stop the robot");
                assert!(answer.starts_with("HTTP/1.1 204 "), "{answer}");
                held.push((client, answer));
            }
            // Viewers may not.
            let (_client, answer) =
                bench.send("POST", 101, &AS_VIEWER.replace("/view", "/api/stop"), "").await.unwrap();
            assert!(answer.starts_with("HTTP/1.1 403 "), "{answer}");
        });
    }
}
