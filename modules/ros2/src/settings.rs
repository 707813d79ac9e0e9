//! `[ros2]`: where the robot is found by ROS 2, and what ROS 2 may do.

use ::settings::{Parsed, Section, Table, settings};
use base::Duration;
use std::net::{Ipv4Addr, SocketAddrV4};

settings! {
    /// `[ros2]`: the robot as a node of ROS 2, without ROS on it (docs/ros2.md).
    #[derive(Clone, Debug, PartialEq)]
    pub struct Ros2 {
        /// The robot starts it.
        enabled: bool = false;
        /// Domain: `ROS_DOMAIN_ID` of the others.
        domain: u32 = 0, 0..=232;
        /// Address of this computer by which others reach it. A loopback address: programs on this computer only.
        address: Ipv4Addr = Ipv4Addr::LOCALHOST, Parsed(
            |text| text.parse().ok().filter(is_own), "an IPv4 address of this computer", "127.0.0.1"
        );
        /// Find others, and be found, by multicast on the network of `address`.
        multicast: bool = true;
        /// Computers that multicast does not reach, by IPv4 address; with a port: one program there.
        peers: Vec<String> = Vec::<String>::new();
        /// Prefix of the names of topics, as `/robot1`; empty: none.
        namespace: String = "";
        /// ROS may command: move the robot by `/cmd_vel`, send it to a goal, and set its pose. Otherwise it only sees.
        commands: bool = false;
        /// A lifecycle manager of ROS activates the node: until then, and when it deactivates it, ROS commands nothing.
        managed: bool = false;
        /// Priority of `/cmd_vel` among the sources of motion: 1 as a remote operator, 2 as a gamepad, 3 maintenance.
        priority: i8 = 1, 1..=3;
        /// The robot stops when `/cmd_vel` has been silent for this long; at least `limits.command_ttl_s` is granted.
        command_ttl_s as command_ttl: Duration = 0.25, 0.05..=2.0;
    }
    check Ros2::check;
}

impl Default for Ros2 {
    fn default() -> Self {
        Self::usual()
    }
}

impl Ros2 {
    fn check(&self, table: &Table<'_>) {
        if !self.peers.iter().all(|peer| Peer::parse(peer).is_some()) {
            table.refuse("peers", "IPv4 addresses as \"192.168.1.7\" or \"192.168.1.7:7410\"");
        }
        if !is_namespace(&self.namespace) {
            table.refuse("namespace", "empty, or names as \"/robot1\" or \"/hall/robot1\"");
        }
    }

    /// The peers; those that are none were refused when this was read.
    #[must_use]
    pub fn peers(&self) -> Vec<Peer> {
        self.peers.iter().filter_map(|peer| Peer::parse(peer)).collect()
    }
}

/// Another computer, or a program there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Peer {
    /// All programs at the usual ports.
    Computer(Ipv4Addr),
    /// The program at a port.
    Program(SocketAddrV4),
}

impl Peer {
    fn parse(text: &str) -> Option<Self> {
        let peer = match text.parse() {
            Ok(address) => Self::Computer(address),
            Err(_) => Self::Program(text.parse().ok()?),
        };
        let (address, has_port) = match &peer {
            Self::Computer(address) => (address, true),
            Self::Program(program) => (program.ip(), program.port() != 0),
        };
        (is_own(address) && has_port).then_some(peer)
    }
}

/// True if a computer may have it.
fn is_own(address: &Ipv4Addr) -> bool {
    !(address.is_unspecified() || address.is_multicast() || address.is_broadcast())
}

/// True if ROS takes it for a namespace: words of letters, digits and `_`, none of which begins with a digit.
fn is_namespace(text: &str) -> bool {
    let is_word = |word: &str| {
        word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    text.is_empty() || (text.len() <= 64 && text.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_word)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peers_are_computers_or_programs() {
        let computer = Peer::Computer([10, 0, 0, 7].into());
        let program = Peer::Program(SocketAddrV4::new([10, 0, 0, 7].into(), 7412));
        assert_eq!([Peer::parse("10.0.0.7"), Peer::parse("10.0.0.7:7412")], [Some(computer), Some(program)]);
        for none in ["", "robot", "::1", "10.0.0.7:0x", "224.0.0.1", "0.0.0.0", "10.0.0.7:0"] {
            assert_eq!(Peer::parse(none), None, "{none}");
        }
    }

    #[test]
    fn namespaces_are_those_of_ros() {
        for good in ["", "/robot1", "/hall/robot_1", "/_x"] {
            assert!(is_namespace(good), "{good}");
        }
        for bad in ["/", "robot1", "/1robot", "/a//b", "/a/", "/a-b"] {
            assert!(!is_namespace(bad), "{bad}");
        }
    }
}
