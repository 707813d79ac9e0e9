//! The server's thread: accepts connections, bounded in number, size and time, and passes them to the router.

use super::app::App;
use super::bus;
use super::guard::Guard;
use super::request::Reached;
use super::router::router;
use super::stats::{Refusal, Stats};
use axum::body::Body;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use nix::sys::socket::{setsockopt, sockopt};
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, watch};

/// Maximum number of connections other than viewers.
const CONNECTIONS_MAX: usize = 64;
/// Timeout of a request's line and headers, and their maximum length and number.
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
    let connections = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            // No descriptor left, or the peer has gone: retried a little later.
            Err(_) => {
                tokio::time::sleep(Duration::from_millis(50)).await;
                continue;
            }
        };
        let Ok(permit) = connections.clone().try_acquire_owned() else {
            stats.refuse(Refusal::Connections, "");
            continue;
        };
        let (router, stats) = (router.clone(), stats.clone());
        tokio::spawn(async move {
            serve(stream, router, &stats).await;
            drop(permit);
        });
    }
}

async fn serve(stream: TcpStream, router: TowerToHyperService<axum::Router>, stats: &Stats) {
    let Ok(reached) = stream.local_addr() else { return };
    // Small messages are sent at once.
    let _ = stream.set_nodelay(true);
    let service = service_fn(move |request: hyper::Request<Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Reached(reached));
        router.call(request)
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIMEOUT).max_buf_size(HEAD_MAX).max_headers(HEADERS_MAX);
    let served = http.serve_connection(TokioIo::new(stream), service).with_upgrades().await;
    if let Err(error) = served
        && (error.is_parse() || error.is_timeout())
    {
        stats.refuse(Refusal::Http, &error.to_string());
    }
}
