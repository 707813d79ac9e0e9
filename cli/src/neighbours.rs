//! Whether a robot is on the bus already: asked before another one starts there, and before messages are published that
//! a robot's own modules publish and others act on.

use super::Failed;
use base::Duration;
use host::bus::{Bus, Received};
use host::clock;
use lcm::Url;
use messages::{Channel, Message};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::fs;
use std::os::fd::AsFd;
use std::path::Path;

/// Time to listen: three periods of `CM_DATA_PROCESSES`.
const LISTEN: Duration = Duration::from_millis(300);
/// Channels that tell of a robot: of its watchdog (10 Hz), of its drives (20 Hz).
const SIGNS: [Channel; 2] = [Channel::CmDataProcesses, Channel::LlDataMotion];

/// Channels of a robot's own modules by which its other modules decide whether it may move, and where. Commands are not
/// among them: who may command is configured (`[bus] commands`).
const SAFETY: [Channel; 20] = [
    Channel::CmDataProcesses,
    Channel::CmDataState,
    Channel::LlEventStop,
    Channel::LlDataMotion,
    Channel::LlDataVelocity,
    Channel::LlDataGuard,
    Channel::LlDataHold,
    Channel::LlDataAxes,
    Channel::LlDataOdo,
    Channel::LlDataSrfs,
    Channel::LlDataIrs,
    Channel::LlDataRanges,
    Channel::LlDataScan,
    Channel::LlDataImu,
    Channel::LlDataNodeIo,
    Channel::LlDataBeacons,
    Channel::LlDataActiveBeacons,
    Channel::LlDataPower,
    Channel::LlDataJoydev,
    Channel::MlDataEstimate,
];

/// True for such a channel.
pub fn is_safety(channel: &str) -> bool {
    Channel::from_name(channel).is_some_and(|channel| SAFETY.contains(&channel))
}

/// True for a channel of commands: one with `_CMD_` in its name, and that of the active beacons, which keeps its name
/// of 2011.
pub fn is_command(channel: &str) -> bool {
    channel.contains("_CMD_") || channel == Channel::LlDataActiveBeacons.name()
}

/// Refuses `what` where a robot is on the bus. A watchdog of the run folder `own` is not another robot.
pub fn refuse(lcm_url: &str, what: &str, own: Option<&Path>) -> Result<(), Failed> {
    match find(lcm_url, own)? {
        None => Ok(()),
        Some(robot) => {
            let cure = "end it, choose another bus by --lcm-url, or insist by --force";
            Err(format!("{what}: a robot is on the bus {lcm_url}: {robot}; {cure}").into())
        }
    }
}

/// Describes the robot on the bus; `None` if nothing from one arrives within a third of a second.
pub fn find(lcm_url: &str, own: Option<&Path>) -> Result<Option<String>, Failed> {
    let (url, _) = Url::parse(lcm_url).map_err(|error| Failed::from(error.to_string()))?;
    if is_alone(&url) {
        return Ok(None);
    }
    let mut bus = Bus::open(lcm_url, &SIGNS.map(Channel::name))?;
    let until = clock::now() + LISTEN;
    loop {
        let now = clock::now();
        match bus.receive(now) {
            Received::Message { message, .. } => {
                let sender = bus.sender().process.map(|process| process.pid);
                if !sender.is_some_and(|pid| own.is_some_and(|own| is_of(pid, own))) {
                    return Ok(Some(told(&message, sender)));
                }
            }
            Received::Foreign | Received::Malformed { .. } => {}
            Received::Broken(why) => return Err(why.into()),
            Received::Nothing if now >= until => return Ok(None),
            Received::Nothing => {
                let left = u16::try_from(until.since(now).as_millis() + 1).unwrap_or(u16::MAX);
                // Whatever ends the wait, the loop checks again.
                let _ = poll(&mut [PollFd::new(bus.as_fd(), PollFlags::POLLIN)], PollTimeout::from(left));
            }
        }
    }
}

fn told(message: &Message, sender: Option<u32>) -> String {
    let process = sender.map(|pid| format!(" (process {pid})")).unwrap_or_default();
    match message {
        Message::CmDataProcesses(list) => {
            let running = list.processes.iter().filter(|process| process.pid > 0).count();
            format!("its watchdog{process} publishes CM_DATA_PROCESSES, of {running} running modules")
        }
        other => format!("a module{process} publishes {}", other.channel_name()),
    }
}

/// True if no program can be on the bus: it ends at this computer, and no socket is bound to its port.
fn is_alone(url: &Url) -> bool {
    match url {
        Url::Udpm(udpm) if udpm.ttl == 0 => {
            let bound = |table: &str| {
                let table = fs::read_to_string(format!("/proc/net/{table}"));
                table.is_ok_and(|table| is_bound(&table, udpm.port))
            };
            !bound("udp") && !bound("udp6")
        }
        Url::Udpm(_) | Url::Tcpq(_) => false,
        Url::Memq | Url::File(_) => true,
    }
}

/// True if `/proc/net/udp` has a socket on this port.
fn is_bound(table: &str, port: u16) -> bool {
    let end = format!(":{port:04X}");
    table.lines().skip(1).any(|line| line.split_ascii_whitespace().nth(1).is_some_and(|local| local.ends_with(&end)))
}

/// True if a process is a module of the robot that has this run folder, as its command line says.
fn is_of(pid: u32, run_dir: &Path) -> bool {
    let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let mut words = line.split(|byte| *byte == 0);
    words.any(|word| word == b"--run-dir") && words.next() == Some(run_dir.as_os_str().as_encoded_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{common, lowlevel};
    use std::thread;

    /// A bus of this test alone.
    fn url(port: u16) -> String {
        format!("udpm://239.255.77.{}:{}?ttl=0&shm=off", std::process::id() % 200 + 1, 24_000 + port)
    }

    /// What is found while `message` is published.
    fn found_beside(url: &str, message: impl Into<Message>) -> Option<String> {
        let (message, open) = (message.into(), std::sync::Barrier::new(2));
        let end = std::sync::atomic::AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                // A program that receives, too: its socket is bound.
                let mut bus = Bus::open(url, &["CM_CMD_STATE"]).unwrap();
                open.wait();
                while !end.load(std::sync::atomic::Ordering::Relaxed) {
                    bus.publish(&message).unwrap();
                    thread::sleep(std::time::Duration::from_millis(20));
                }
            });
            open.wait();
            let found = find(url, None);
            end.store(true, std::sync::atomic::Ordering::Relaxed);
            found.unwrap_or_else(|error| panic!("{}", error.why))
        })
    }

    #[test]
    fn a_robot_on_the_bus_is_found_and_named() {
        let process = |pid| common::Process { pid, ..Default::default() };
        let list = common::DataProcesses { timestamp: 0, processes: vec![process(7), process(0), process(8)] };
        let found = found_beside(&url(1), list).unwrap();
        assert_eq!(found, "its watchdog publishes CM_DATA_PROCESSES, of 2 running modules");
        assert_eq!(
            found_beside(&url(2), lowlevel::DataMotion::default()).unwrap(),
            "a module publishes LL_DATA_MOTION"
        );
        assert_eq!(found_beside(&url(3), common::DataState::default()), None, "a program that is no robot");
    }

    #[test]
    fn what_modules_decide_by_is_not_published_beside_a_robot() {
        // By what is believed from a witness alone, and by what the modules subscribe to of each other.
        for channel in module::admission::RELEASES {
            assert!(is_safety(channel.name()), "{}", channel.name());
        }
        for name in ["CM_DATA_STATE", "LL_DATA_ACTIVE_BEACONS", "LL_DATA_HOLD", "ML_DATA_ESTIMATE"] {
            assert!(is_safety(name), "{name}");
        }
        assert!(!is_safety("ML_DATA_PLAN") && !is_safety("LL_CMD_MOTION") && !is_safety("MINE"));
    }

    #[test]
    fn the_active_beacons_are_a_command() {
        for (name, expected) in [
            ("LL_DATA_ACTIVE_BEACONS", true),
            ("LL_CMD_MOTION", true),
            ("SIM_CMD_FAULT", true),
            ("LL_DATA_BEACONS", false),
            ("LL_DATA_ACTIVE_BEACONS_OLD", false),
        ] {
            assert_eq!(is_command(name), expected, "{name}");
        }
    }

    #[test]
    fn a_bus_where_no_socket_is_bound_is_not_listened_to() {
        assert_eq!(find(&url(4), None).unwrap_or_else(|error| panic!("{}", error.why)), None);
        assert!(is_alone(&Url::parse(&url(4)).unwrap().0));
        assert!(!is_alone(&Url::parse("udpm://239.255.76.67:7667?ttl=1").unwrap().0));
        let table = "  sl  local_address\n  101: 434CFFEF:1DF3 00000000:0000 07\n";
        assert!(is_bound(table, 7667) && !is_bound(table, 7668));
    }

    #[test]
    fn a_watchdog_of_the_same_run_folder_is_no_other_robot() {
        assert!(!is_of(std::process::id(), Path::new("/run/advee")));
        let mut command = std::process::Command::new("sh");
        command.args(["-c", "read x", "sh", "--run-dir", "/run/x"]).stdin(std::process::Stdio::piped());
        let mut child = command.spawn().unwrap();
        // Its command line is that of the shell once it is executed.
        while fs::read(format!("/proc/{}/cmdline", child.id())).unwrap().len() < 20 {
            thread::yield_now();
        }
        let of = |path| is_of(child.id(), Path::new(path));
        assert_eq!([of("/run/x"), of("/run")], [true, false]);
        child.kill().unwrap();
        child.wait().unwrap();
    }
}
