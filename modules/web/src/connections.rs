//! Share of the server's connections for each address.
//!
//! Silent connections, and those whose requests are refused, shut nobody out: a new connection takes the place of the
//! oldest one without a granted request; of one from its own address if that address has used up its share, of one from
//! any address if all places are taken. Requests that need no role, for the page itself and for pairing, keep no place.
//!
//! Nor do viewers shut out who may stop the robot: of the places of an address, and of all places, their granted
//! requests keep at most seven eighths. The others are kept by requests of operators and engineers alone.

use super::center::access::Role;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use tokio::sync::Notify;

/// Maximum number of connections other than viewers.
pub const CONNECTIONS_MAX: usize = 64;
/// Maximum number of them from one address: a browser opens six for requests, and two for its WebSockets.
pub const SHARE: usize = 8;
/// Maximum number from this computer, where tunnels and proxies bring many users.
pub const LOOPBACK_SHARE: usize = 32;

/// All connections other than viewers.
#[derive(Clone, Debug, Default)]
pub struct Connections(Arc<Mutex<Inner>>);

#[derive(Debug, Default)]
struct Inner {
    next: u64,
    /// Oldest first.
    entries: Vec<Entry>,
}

#[derive(Debug)]
struct Entry {
    number: u64,
    peer: IpAddr,
    /// Role of whoever's granted request keeps the place; [`Role::Nobody`]: it gives way to a new connection.
    kept_by: Role,
    evicted: Arc<Notify>,
}

/// Place of the connection of a request, as the guard finds it. It does not keep the place: a WebSocket outlives it.
#[derive(Clone, Debug)]
pub struct Seat(pub Weak<Place>);

impl Seat {
    /// The request is granted to somebody with this role: the place is kept, if it is one that the role may keep.
    pub fn grant(&self, role: Role) {
        if let Some(place) = self.0.upgrade() {
            place.grant(role);
        }
    }
}

/// Place of a connection; given back when it is dropped.
#[derive(Debug)]
pub struct Place {
    connections: Connections,
    number: u64,
    evicted: Arc<Notify>,
}

impl Connections {
    /// Gives a connection from `peer` a place; `None` if every place that it could take belongs to a connection with a
    /// granted request.
    pub fn admit(&self, peer: IpAddr) -> Option<Place> {
        let peer = network(peer);
        let share = share(peer);
        let mut inner = self.lock();
        if inner.entries.iter().filter(|entry| entry.peer == peer).count() >= share {
            inner.evict(|entry| entry.peer == peer)?;
        } else if inner.entries.len() >= CONNECTIONS_MAX {
            inner.evict(|_| true)?;
        }
        let (number, evicted) = (inner.next, Arc::new(Notify::new()));
        inner.next += 1;
        inner.entries.push(Entry { number, peer, kept_by: Role::Nobody, evicted: evicted.clone() });
        drop(inner);
        Some(Place { connections: self.clone(), number, evicted })
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    fn evict(&mut self, of: impl Fn(&Entry) -> bool) -> Option<()> {
        let silent = self.entries.iter().position(|entry| entry.kept_by == Role::Nobody && of(entry))?;
        self.entries.remove(silent).evicted.notify_one();
        Some(())
    }

    /// Number of places that viewers keep.
    fn viewers(&self, of: impl Fn(&Entry) -> bool) -> usize {
        self.entries.iter().filter(|entry| entry.kept_by == Role::Viewer && of(entry)).count()
    }
}

impl Place {
    /// A request was granted to somebody with this role: the place is kept, if it is one that the role may keep.
    pub fn grant(&self, role: Role) {
        let mut inner = self.connections.lock();
        let Some(at) = inner.entries.iter().position(|entry| entry.number == self.number) else { return };
        let Entry { peer, kept_by, .. } = inner.entries[at];
        let is_free = || {
            inner.viewers(|entry| entry.peer == peer) < for_viewers(share(peer))
                && inner.viewers(|_| true) < for_viewers(CONNECTIONS_MAX)
        };
        if role > kept_by && (role >= Role::Operator || is_free()) {
            inner.entries[at].kept_by = role;
        }
    }

    /// Waits until another connection takes the place.
    pub async fn evicted(&self) {
        self.evicted.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.connections.lock().entries.retain(|entry| entry.number != self.number);
    }
}

/// Maximum number of connections from an address.
fn share(peer: IpAddr) -> usize {
    if peer.is_loopback() { LOOPBACK_SHARE } else { SHARE }
}

/// Number of these places that viewers may keep.
const fn for_viewers(places: usize) -> usize {
    places - places / 8
}

/// Address that counts as one client: for IPv6 the network of 64 bits, in which a client may choose any address.
pub fn network(peer: IpAddr) -> IpAddr {
    match peer.to_canonical() {
        IpAddr::V6(address) if !address.is_loopback() => {
            IpAddr::V6(Ipv6Addr::from(u128::from(address) & !u128::from(u64::MAX)))
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peer(number: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, number])
    }

    #[test]
    fn silent_connections_give_way_to_new_ones() {
        let connections = Connections::default();
        let mut silent: Vec<Place> = (0..SHARE).map(|_| connections.admit(peer(1)).unwrap()).collect();
        let new = connections.admit(peer(1)).unwrap();
        new.grant(Role::Operator);
        let alive = |place: &Place| connections.lock().entries.iter().any(|entry| entry.number == place.number);
        assert!(!alive(&silent[0]) && silent[1..].iter().all(alive), "the oldest gave way");
        silent.iter().for_each(|place| place.grant(Role::Operator));
        assert!(connections.admit(peer(1)).is_none(), "all have requests");
        assert!(connections.admit(peer(2)).is_some(), "another address");
        silent.pop();
        assert!(connections.admit(peer(1)).is_some());
    }

    #[test]
    fn one_address_does_not_take_all_places() {
        let connections = Connections::default();
        let loopback: Vec<Place> =
            (0..2 * CONNECTIONS_MAX).filter_map(|_| connections.admit(IpAddr::from([127, 0, 0, 1]))).collect();
        let alive = connections.lock().entries.len();
        assert_eq!((alive, loopback.len()), (LOOPBACK_SHARE, 2 * CONNECTIONS_MAX));
        let others: Vec<Place> = (0..10)
            .flat_map(|number| (0..SHARE).map(move |_| number))
            .collect::<Vec<u8>>()
            .into_iter()
            .map(|number| connections.admit(peer(number)).unwrap())
            .collect();
        assert_eq!(connections.lock().entries.len(), CONNECTIONS_MAX);
        others.iter().for_each(|place| place.grant(Role::Operator));
        drop(others);
        assert!(connections.lock().entries.len() <= LOOPBACK_SHARE);
    }

    #[test]
    fn viewers_leave_places_for_who_may_stop_the_robot() {
        let connections = Connections::default();
        let viewers: Vec<Place> = (0..CONNECTIONS_MAX)
            .map(|n| {
                let place = connections.admit(peer((n / SHARE) as u8)).unwrap();
                place.grant(Role::Viewer);
                place
            })
            .collect();
        assert_eq!(connections.lock().entries.len(), CONNECTIONS_MAX);
        assert_eq!(connections.lock().viewers(|_| true), CONNECTIONS_MAX - 8);
        // From another address, and from each of theirs.
        let mut operators = Vec::new();
        for address in [100, 0, 1, 2, 3, 4, 5, 6] {
            let place = connections.admit(peer(address)).expect("a place for an operator");
            place.grant(Role::Operator);
            operators.push(place);
        }
        // These are kept: neither a new viewer nor a flood of connections takes one.
        let flood: Vec<Option<Place>> = (0..100).map(|n| connections.admit(peer(n))).collect();
        drop(flood);
        let kept = |place: &Place| connections.lock().entries.iter().any(|entry| entry.number == place.number);
        assert!(operators.iter().all(kept));
        assert_eq!(
            viewers.iter().filter(|place| kept(place)).count(),
            CONNECTIONS_MAX - 8,
            "nobody loses a kept place"
        );
        assert!(connections.admit(peer(100)).is_none(), "all places are kept");
        // A viewer who becomes an operator keeps the place as one, and is no viewer any more.
        drop(operators);
        viewers[0].grant(Role::Engineer);
        assert_eq!(connections.lock().viewers(|_| true), CONNECTIONS_MAX - 9);
    }

    #[test]
    fn a_network_of_ipv6_is_one_client() {
        let [one, other, third] =
            ["2001:db8::1", "2001:db8::ffff:2", "2001:db8:0:1::1"].map(|text| network(text.parse().unwrap()));
        assert!(one == other && one != third);
        assert_eq!(network("::ffff:10.0.0.1".parse().unwrap()), peer(1));
        assert!(network("::1".parse().unwrap()).is_loopback());
    }
}
