//! What a participant is, what it may be made to keep, and what it counts.

use crate::guid::Prefix;
use alloc::string::String;
use alloc::vec::Vec;
use base::Duration;
use core::net::SocketAddrV4;

/// Longest user data of a writer or reader, bytes.
pub const USER_DATA_MAX: usize = 256;

/// What a participant is, and how it is found.
#[derive(Clone, Debug)]
pub struct Config {
    /// Number of the domain, 0..=232.
    pub domain: u32,
    /// Own identifier, which no other participant of the domain has.
    pub prefix: Prefix,
    /// Where it is reached.
    pub locators: Vec<SocketAddrV4>,
    /// Where its announcements go: to a multicast group, to peers.
    pub announce_to: Vec<SocketAddrV4>,
    /// Period of the announcements.
    pub announce_period: Duration,
    /// Time after the last announcement from which others take it for gone.
    pub lease: Duration,
    /// Name for people.
    pub name: String,
    /// What a user of DDS has others know; ROS 2 has its enclave there.
    pub user_data: Vec<u8>,
    /// The same of a writer or reader, by the name of its type in DDS: at most [`USER_DATA_MAX`] bytes, or none. ROS 2
    /// has the hash of the type there.
    pub endpoint_data: fn(&str) -> Vec<u8>,
    /// Bounds of memory.
    pub limits: Limits,
}

/// Bounds of what others can make a participant keep. What exceeds them is left out and counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Other participants.
    pub participants: usize,
    /// Endpoints of one of them.
    pub endpoints: usize,
    /// Endpoints of others that one own endpoint talks to.
    pub matches: usize,
    /// Longest received sample, bytes.
    pub sample: usize,
    /// Received samples that are not taken yet.
    pub events: usize,
    /// Datagrams that are not sent yet, bytes.
    pub outbox: usize,
    /// Longest time without a sign of life that another may ask for.
    pub lease: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            participants: 32,
            endpoints: 256,
            matches: 32,
            sample: 64 << 10,
            events: 256,
            outbox: 2 << 20,
            lease: Duration::from_secs(60),
        }
    }
}

/// Counters since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Datagrams that are no RTPS, or malformed from some place on.
    pub malformed: u64,
    /// Participants, endpoints or matches beyond the limits.
    pub refused: u64,
    /// Received samples that were dropped because nobody took the earlier ones, or because they were too long.
    pub dropped_in: u64,
    /// Datagrams that were dropped because the earlier ones were not sent yet.
    pub dropped_out: u64,
}
