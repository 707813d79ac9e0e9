//! A bus of its own for every test.

use lcm::url::Udpm;
use std::net::Ipv4Addr;
use std::sync::atomic::{AtomicU32, Ordering};

/// A group and port that no other test, and no other run on this host, uses at the same time; TTL 0.
pub fn url() -> Udpm {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let [_, high, middle, low] = std::process::id().to_be_bytes();
    let counter = COUNTER.fetch_add(1, Ordering::Relaxed) as u16;
    let group = Ipv4Addr::new(239, 192 + (high & 0x3F), middle, low);
    Udpm { group, port: 20_000 + counter, ..Udpm::default() }
}
