//! Connections to the other computers of the robot.

use super::finding::Finding;
use ::bridge::key_file;
use ::bridge::settings::Link;
use host::bus::{Bus, Received};
use host::clock;
use messages::common::DataBridge;
use messages::{Channel, Message};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use robot::config::Config;
use std::collections::BTreeMap;
use std::net::{TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// Time to wait for the state of each connection, which a running bridge publishes each second.
const PATIENCE: Duration = Duration::from_millis(1500);
/// Time limit of the connection to a computer.
const CONNECT_MAX: Duration = Duration::from_secs(1);

/// Key, the other computer, and the clocks, for each connection.
pub fn check(config: &Config, dir: &Path, lcm_url: &str) -> Vec<Finding> {
    let links = &config.robot.bridge;
    if links.is_empty() {
        return Vec::new();
    }
    let states = listen(links.len(), lcm_url);
    let of = |link: &Link| {
        let path = dir.join(&link.key_file);
        let state = states.get(&link.name);
        [key(link, key_file::read(&path).map(drop), &path), reach(link, state, probe), clocks(link, state)]
    };
    links.iter().flat_map(of).collect()
}

/// Last state of each connection that a bridge of this computer publishes.
fn listen(count: usize, lcm_url: &str) -> BTreeMap<String, DataBridge> {
    let mut states = BTreeMap::new();
    let Ok(mut bus) = Bus::open(lcm_url, &[Channel::CmDataBridge.name()]) else { return states };
    let end = Instant::now() + PATIENCE;
    while let Some(left) = end.checked_duration_since(Instant::now()).filter(|_| states.len() < count) {
        match bus.receive(clock::now()) {
            Received::Message { message: Message::CmDataBridge(state), .. } => {
                states.insert(state.name.clone(), state);
            }
            Received::Broken(_) => break,
            Received::Nothing => {
                let millis = u16::try_from(left.as_millis() + 1).unwrap_or(u16::MAX);
                let _ = poll(&mut [PollFd::new(bus.as_fd(), PollFlags::POLLIN)], PollTimeout::from(millis));
            }
            _ => {}
        }
    }
    states
}

/// Whether this computer reaches the other one, or has the address at which it listens.
fn probe(link: &Link) -> Result<(), String> {
    let tried = match (link.listen, link.connect) {
        (Some(address), _) => TcpListener::bind(address).map(drop),
        (None, Some(address)) => TcpStream::connect_timeout(&address, CONNECT_MAX).map(drop),
        (None, None) => return Ok(()),
    };
    tried.map_err(|error| error.to_string())
}

fn check_name(link: &Link, what: &str) -> String {
    format!("bridge {} {what}", link.name)
}

fn key(link: &Link, read: Result<(), String>, path: &Path) -> Finding {
    match read {
        Ok(()) => Finding::ok(check_name(link, "key"), format!("{}: only its owner may read it", path.display())),
        Err(why) => {
            let cure = match path.metadata() {
                Ok(about) if about.mode() & 0o077 != 0 => format!("chmod 600 {}", path.display()),
                // Of another user, or no key.
                Ok(_) => String::new(),
                Err(_) => format!("advee bridge key {}", path.display()),
            };
            let matters = "Without its key the bridge does not connect. The same key belongs on both computers, in a \
                           file of the robot's user.";
            Finding::fail(check_name(link, "key"), why).why(matters).cure(cure)
        }
    }
}

fn reach(link: &Link, state: Option<&DataBridge>, probe: impl FnOnce(&Link) -> Result<(), String>) -> Finding {
    let check = check_name(link, "computer");
    match state {
        Some(state) if state.connected => return Finding::ok(check, format!("connected to {}", state.peer)),
        Some(_) => {
            let why = "The bridge runs and has no connection: see the reports of the module bridge on both computers.";
            return Finding::fail(check, "not connected").why(why);
        }
        None => {}
    }
    let (address, there) = match (link.listen, link.connect) {
        (Some(address), _) => (address, "this computer has the address"),
        (None, Some(address)) => (address, "answers"),
        (None, None) => return Finding::warning(check, "no address"),
    };
    match probe(link) {
        Ok(()) => Finding::ok(check, format!("{address}: {there}; no bridge runs here")),
        Err(why) => {
            let matters = "The bridge cannot connect: check cable, addresses, and that the other computer is on.";
            Finding::warning(check, format!("{address}: {why}")).why(matters)
        }
    }
}

fn clocks(link: &Link, state: Option<&DataBridge>) -> Finding {
    let check = check_name(link, "clocks");
    let Some(state) = state.filter(|state| state.clock_offset.is_finite()) else {
        return Finding::warning(check, "not compared: no connection of a running bridge");
    };
    let DataBridge { clock_offset, round_trip, .. } = *state;
    let what = format!("{:+.1} ms, round trip {:.1} ms", clock_offset * 1e3, round_trip * 1e3);
    if clock_offset.abs() <= link.clock_max.as_secs_f64() {
        return Finding::ok(check, what);
    }
    let why = "Messages with a time stamp in the future are dropped, and the times in logs do not agree.";
    Finding::warning(check, what).why(why).cure("timedatectl set-ntp true   # on both computers, with one server")
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;
    use std::path::PathBuf;

    fn link() -> Link {
        let node = settings::Node::parse(Path::new("robot.toml"), "connect = \"10.0.0.2:7667\"\nkey_file = \"k\"");
        Link { name: "far".into(), ..settings::read_as(&node.unwrap()).unwrap() }
    }

    fn state(connected: bool, clock_offset: f64) -> DataBridge {
        let (name, peer) = ("far".into(), "10.0.0.2:7667".into());
        DataBridge { name, peer, connected, clock_offset, round_trip: 0.001, ..Default::default() }
    }

    #[test]
    fn a_key_that_others_may_read_is_a_failure() {
        let path = PathBuf::from("/nowhere/bridge.key");
        assert_eq!(key(&link(), Ok(()), &path).level, Level::Ok);
        let bad = key(&link(), Err("/nowhere/bridge.key: No such file".into()), &path);
        assert_eq!((bad.level, bad.cure.as_str()), (Level::Fail, "advee bridge key /nowhere/bridge.key"));

        let path = std::env::temp_dir().join(format!("advee-doctor-bridge-{}", std::process::id()));
        std::fs::write(&path, "no key").unwrap();
        let cure = |mode| {
            std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(mode)).unwrap();
            key(&link(), key_file::read(&path).map(drop), &path).cure
        };
        assert_eq!([cure(0o644), cure(0o600)], [format!("chmod 600 {}", path.display()), String::new()]);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn the_bridge_that_runs_knows_better_than_a_probe() {
        let reach = |state: Option<DataBridge>, probed: Result<(), &str>| {
            reach(&link(), state.as_ref(), |_| probed.map_err(String::from)).level
        };
        assert_eq!(reach(Some(state(true, 0.0)), Err("no route")), Level::Ok);
        assert_eq!(reach(Some(state(false, f64::NAN)), Ok(())), Level::Fail);
        assert_eq!(reach(None, Ok(())), Level::Ok);
        assert_eq!(reach(None, Err("no route")), Level::Warning);
    }

    #[test]
    fn clocks_that_differ_are_a_warning() {
        assert_eq!(clocks(&link(), Some(&state(true, -0.02))).level, Level::Ok);
        assert_eq!(clocks(&link(), Some(&state(true, 0.2))).level, Level::Warning);
        assert_eq!(clocks(&link(), Some(&state(false, f64::NAN))).level, Level::Warning);
        assert_eq!(clocks(&link(), None).level, Level::Warning);
    }
}
