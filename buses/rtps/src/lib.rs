//! RTPS 2.3 (OMG DDSI-RTPS), the wire protocol of DDS and so of ROS 2: a [`Participant`] discovers others, its writers
//! and readers exchange samples with theirs. Clauses in comments are those of version 2.5.
//!
//! Everything here is sans-IO: it reads no clock and owns no port. Whatever arrives is survived; what others can make a
//! participant keep is bounded by [`Limits`], and what exceeds them is counted.
//!
//! There are: discovery of participants and endpoints, by multicast and by peers; writers and readers, best effort and
//! reliable, volatile and transient local, for topics without keys; fragments, both ways; identities of samples, by
//! which an answer names its request. There are not: IPv6, shared memory, security, topics with keys, content filters,
//! deadlines, liveliness by hand, exclusive ownership, type information. Samples are bytes: what they mean is the
//! users' matter.
//!
//! Two participants, and a network between them that is a loop:
//!
//! ```
//! use base::{Duration, Instant};
//! use rtps::{Config, Limits, Participant, Prefix, Qos};
//!
//! let address = |n: u8| std::net::SocketAddrV4::new([127, 0, 0, n].into(), 7410);
//! let make = |n: u8, peer: u8| {
//!     Participant::new(Config {
//!         domain: 0,
//!         prefix: Prefix([n; 12]),
//!         locators: vec![address(n)],
//!         announce_to: vec![address(peer)],
//!         announce_period: Duration::from_secs(3),
//!         lease: Duration::from_secs(20),
//!         name: "example".into(),
//!         user_data: Vec::new(),
//!         endpoint_data: |_| Vec::new(),
//!         limits: Limits::default(),
//!     })
//! };
//! let (mut robot, mut viewer) = (make(1, 2), make(2, 1));
//! let start = Instant::from_millis(1);
//! let odom = robot.add_writer(start, "rt/odom", "nav_msgs::msg::dds_::Odometry_", Qos::SENSOR).unwrap();
//! viewer.add_reader(start, "rt/odom", "nav_msgs::msg::dds_::Odometry_", Qos::SENSOR).unwrap();
//!
//! for now in (1..100).map(Instant::from_millis) {
//!     robot.handle_timeout(now);
//!     viewer.handle_timeout(now);
//!     while let Some(sent) = robot.poll_tx() {
//!         viewer.handle_rx(now, address(1), &sent.datagram);
//!     }
//!     while let Some(sent) = viewer.poll_tx() {
//!         robot.handle_rx(now, address(2), &sent.datagram);
//!     }
//!     if robot.matched(odom) > 0 {
//!         robot.write(now, odom, 0, &[0, 1, 0, 0, 42]);
//!     }
//! }
//! assert_eq!(viewer.poll_event().unwrap().payload[4], 42);
//! ```
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;
#[cfg(test)]
extern crate std;

mod bytes;
mod config;
mod guid;
mod outbox;
mod parameters;
mod participant;
mod qos;
mod reader;
#[cfg(test)]
mod tests;
mod wire;
mod writer;

pub use config::{Config, Counters, Limits, USER_DATA_MAX};
pub use guid::{Entity, Guid, Prefix, SampleIdentity};
pub use outbox::Transmit;
pub use participant::{Participant, ReaderId, Sample, WriterId};
pub use qos::{Qos, Reliability};

use core::net::Ipv4Addr;

/// Group of the announcements (9.6.2.4.1).
pub const MULTICAST: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Highest number of a domain.
pub const DOMAIN_MAX: u32 = 232;

/// Port of the announcements by multicast in a domain, 0..=232 (9.6.2.3).
#[must_use]
pub fn multicast_port(domain: u32) -> Option<u16> {
    (domain <= DOMAIN_MAX).then_some(())?;
    u16::try_from(7400 + 250 * domain).ok()
}

/// Port at which the participant number `n` of a computer is found in a domain.
#[must_use]
pub fn unicast_port(domain: u32, n: u32) -> Option<u16> {
    let base = multicast_port(domain)?;
    u16::try_from(n.checked_mul(2)?.checked_add(u32::from(base) + 10)?).ok()
}
