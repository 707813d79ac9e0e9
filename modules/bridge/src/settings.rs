//! `[bridge.<name>]`: connections to the other computers of the robot.

use crate::allow::{Entry, both_ways};
use ::settings::{Parsed, Table, settings};
use base::Duration;
use std::net::SocketAddr;
use std::path::PathBuf;

settings! {
    /// `[bridge.<name>]`: a connection to another computer of the robot (docs/two-computers.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct Link {
        name: String = key;
        /// Address and port of this computer at which the other one connects, `"192.168.7.1:7667"`. One of the two
        /// computers has this key, the other one `connect`.
        listen: Option<SocketAddr> = optional, Parsed(address, ADDRESS, "192.168.7.1:7667");
        /// Address and port of the other computer.
        connect: Option<SocketAddr> = optional, Parsed(address, ADDRESS, "192.168.7.1:7667");
        /// File with the key that both computers have, from the configuration folder on; `advee bridge key FILE` makes
        /// it. Nobody but its owner, the robot's user, may read it.
        key_file: PathBuf = required;
        /// Channels that this computer sends: names, or prefixes of data and events as `"HL_*"`; with `@` and a
        /// number: at most this often, Hz, as `"LL_DATA_SCAN@5"`. A command is named in full.
        send: Vec<String> = Vec::<String>::new();
        /// Channels that this computer accepts, likewise. No channel is in both lists, but those on which each module
        /// publishes about itself: `CM_DATA_STATE`, `CM_DATA_FAULTS`, `CM_EVENT_ERROR`, `CM_EVENT_TEXT` and
        /// `LL_DATA_HOLD`.
        receive: Vec<String> = Vec::<String>::new();
        /// The robot does not move without this connection, and without the modules of `modules`.
        critical: bool = false;
        /// Modules of the other computer that have to work.
        modules: Vec<String> = Vec::<String>::new();
        /// Maximum age of a received message since its publication on the other computer; an older one is dropped,
        /// unless it stops the robot.
        age_max_s as age_max: Duration = 0.25, 0.02..=5.0;
        /// Maximum difference of the wall clocks; beyond it is a fault. A message whose time stamp is further in the
        /// future is dropped.
        clock_max_s as clock_max: Duration = 0.05, 0.001..=10.0;
        /// Maximum number of messages that are accepted in a second; further ones are dropped.
        rate_max_hz: u32 = 2000, 1..=20_000;
    }
    check Link::check;
}

/// What an address has to be.
const ADDRESS: &str = "the address and port of one computer, as \"192.168.7.1:7667\"";

fn address(text: &str) -> Option<SocketAddr> {
    let address: SocketAddr = text.parse().ok()?;
    let is_one = !address.ip().is_unspecified() && !address.ip().is_multicast() && address.port() != 0;
    is_one.then_some(address)
}

impl Link {
    fn check(&self, table: &Table<'_>) {
        match (self.listen, self.connect) {
            (None, None) if !table.has("listen") && !table.has("connect") => {
                table.refuse_missing("listen", "an address of this computer, or connect");
            }
            (Some(_), Some(_)) => table.refuse("connect", "nothing beside listen"),
            _ => {}
        }
        for (key, texts) in [("send", &self.send), ("receive", &self.receive)] {
            if texts.iter().any(|text| Entry::parse(text).is_none()) {
                table.refuse(
                    key,
                    "names of channels, prefixes of three characters or more as \"HL_*\", each with a rate as \"@5\" \
                     where it is limited (0.01 to 1000 Hz); not CM_DATA_PROCESSES or CM_DATA_BRIDGE, which are about \
                     one computer",
                );
            }
        }
        if self.modules.iter().any(|name| name.is_empty() || name.len() > crate::wire::CHANNEL_MAX) {
            table.refuse("modules", "names of modules of the other computer");
        }
    }

    /// Channels that this computer sends. Those that are none were refused when this was read.
    #[must_use]
    pub fn sent(&self) -> Vec<Entry> {
        entries(&self.send)
    }

    /// Channels that this computer accepts.
    #[must_use]
    pub fn received(&self) -> Vec<Entry> {
        entries(&self.receive)
    }
}

fn entries(texts: &[String]) -> Vec<Entry> {
    texts.iter().filter_map(|text| Entry::parse(text)).collect()
}

/// Connection and entry of its `send` that sends a channel which a connection of this computer receives: it would go
/// back, or on to a third computer. `None`: there is none.
#[must_use]
pub fn forwarded(links: &[Link]) -> Option<(&Link, String)> {
    let received: Vec<Entry> = links.iter().flat_map(Link::received).collect();
    links.iter().find_map(|link| Some((link, both_ways(&link.sent(), &received)?.to_owned())))
}

/// Connection that has the key file of an earlier one. A key does not say which connection it is for: with the key of
/// both, one computer could take the place of the other, and a stranger could join the ends of both. `None`: there is
/// none.
#[must_use]
pub fn sharing_a_key(links: &[Link]) -> Option<&Link> {
    let has_its_key = |n: usize, link: &Link| links[..n].iter().any(|earlier| earlier.key_file == link.key_file);
    links.iter().enumerate().find_map(|(n, link)| has_its_key(n, link).then_some(link))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::settings::{Node, read_as};
    use std::path::Path;

    fn read(text: &str) -> Result<Link, Vec<String>> {
        let node = Node::parse(Path::new("robot.toml"), text).unwrap();
        read_as(&node).map_err(|errors| errors.0)
    }

    #[test]
    fn a_connection_has_one_end_at_each_computer() {
        let link = read("listen = \"192.168.7.1:7667\"\nkey_file = \"bridge.key\"\nsend = [\"LL_DATA_*@5\"]").unwrap();
        assert_eq!((link.critical, link.age_max, link.sent().len()), (false, Duration::from_millis(250), 1));
        for wrong in ["0.0.0.0:7667", "239.255.76.67:7667", "192.168.7.1:0", "192.168.7.1"] {
            let refused = read(&format!("listen = \"{wrong}\"\nkey_file = \"bridge.key\"")).unwrap_err();
            assert!(refused[0].contains("the address and port of one computer"), "{refused:?}");
        }
        assert!(read("key_file = \"k\"").unwrap_err()[0].contains("listen: missing"));
        let both = "listen = \"10.0.0.1:1\"\nconnect = \"10.0.0.2:1\"\nkey_file = \"k\"";
        assert!(read(both).unwrap_err()[0].contains("nothing beside listen"));
        let wild = "listen = \"10.0.0.1:1\"\nkey_file = \"k\"\nreceive = [\"*\"]";
        assert!(read(wild).unwrap_err()[0].contains("names of channels"));
    }

    #[test]
    fn nothing_is_sent_on_that_came_from_another_computer() {
        let link = |name: &str, send: &[&str], receive: &[&str]| {
            let list = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
            let one = read("listen = \"10.0.0.1:1\"\nkey_file = \"k\"").unwrap();
            Link { name: name.into(), send: list(send), receive: list(receive), ..one }
        };
        let near = link("near", &["LL_DATA_*"], &["LL_CMD_MOTION"]);
        assert_eq!(forwarded(std::slice::from_ref(&near)), None);
        let far = link("far", &["HL_DATA_*", "LL_CMD_MOTION"], &[]);
        let links = [near, far];
        let found = forwarded(&links).map(|(link, channel)| (link.name.as_str(), channel));
        assert_eq!(found, Some(("far", "LL_CMD_MOTION".into())));
    }
    #[test]
    fn each_connection_has_a_key_of_its_own() {
        let link = |name: &str, key: &str| {
            let one = read(&format!("listen = \"10.0.0.1:1\"\nkey_file = \"{key}\"")).unwrap();
            Link { name: name.into(), ..one }
        };
        let shared = |links: &[Link]| sharing_a_key(links).map(|link| link.name.clone());
        assert_eq!(shared(&[link("near", "a.key"), link("far", "b.key")]), None);
        let links = [link("near", "a.key"), link("far", "b.key"), link("third", "a.key")];
        assert_eq!(shared(&links), Some("third".into()));
    }
}
