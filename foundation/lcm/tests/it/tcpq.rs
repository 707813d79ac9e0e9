//! TCPQ on real sockets: our hub and our client, together, against hostile ends, and each against the official ones.
#![cfg(feature = "live")]
#![allow(clippy::disallowed_methods, reason = "real sockets, threads and processes")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

mod hostile;
mod official;
mod ours;

use lcm::live::{Event, Hub, Lcm};
use lcm::tcpq::hub::{Limits, Stats};
use lcm::url::Url;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Whatever has not happened by then does not happen.
const PATIENCE: Duration = Duration::from_secs(20);

/// A hub in a thread of its own, ended with the test.
struct Relay {
    address: SocketAddrV4,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<(Stats, Vec<Event>)>>,
}

impl Relay {
    fn start(limits: Limits) -> Self {
        Self::start_at(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0), limits)
    }

    fn start_at(address: SocketAddrV4, limits: Limits) -> Self {
        let mut hub = Hub::with_limits(address, limits).unwrap();
        let SocketAddr::V4(address) = hub.address().unwrap() else { panic!("an IPv4 address") };
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            let mut events = Vec::new();
            while !stopped.load(Ordering::Relaxed) {
                hub.wait(Duration::from_millis(20)).unwrap();
                hub.serve_once().unwrap();
                events.extend(std::iter::from_fn(|| hub.poll_event()));
            }
            (hub.stats(), events)
        });
        Self { address, stop, thread: Some(thread) }
    }

    fn url(&self) -> Url {
        Url::Tcpq(self.address)
    }

    fn client(&self) -> Lcm {
        Lcm::new(&self.url()).unwrap()
    }

    /// Ends it: what it counted, and who came and went.
    fn end(mut self) -> (Stats, Vec<String>) {
        self.stop.store(true, Ordering::Relaxed);
        let (stats, events) = self.thread.take().unwrap().join().unwrap();
        (stats, events.iter().map(ToString::to_string).collect())
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The next message.
fn receive(lcm: &mut Lcm) -> (String, Vec<u8>) {
    let until = Instant::now() + PATIENCE;
    loop {
        if let Some(message) = lcm.recv_timeout(Duration::from_millis(100)).unwrap() {
            return (message.channel.into(), message.payload.into());
        }
        assert!(Instant::now() < until, "no message: {:?}", lcm.stats());
    }
}

/// Waits until the hub has taken in all that this client has told it, which must be subscribed to what it sends.
fn settle(lcm: &mut Lcm, channel: &str) {
    let until = Instant::now() + PATIENCE;
    // Refused until the connection is there.
    while let Err(error) = lcm.publish(channel, b"settle") {
        assert!(Instant::now() < until, "{error}");
        lcm.wait(Duration::from_millis(100)).unwrap();
        assert_eq!(lcm.recv().unwrap(), None);
    }
    assert_eq!(receive(lcm), (channel.into(), b"settle".to_vec()));
}

/// Bytes that show where they are.
fn payload(size: usize) -> Vec<u8> {
    (0..size).map(|i| (7 * i + (i >> 8)) as u8).collect()
}
