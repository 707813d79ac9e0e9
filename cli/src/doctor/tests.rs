//! The checks over made-up facts: what each says when all is well, and when it is not.

use super::buffer::{self, Buffer};
use super::bus::{self, Shm};
use super::devices::{self, Can, Device};
use super::entering::{Incoming, Unproven};
use super::finding::{Finding, Level};
use super::guard;
use super::machine::{self, Folder, RealTime};
use super::network::{Interface, Listener};
use super::probe::{Outgoing, Trip};
use super::real_time::{self, Interrupt};
use crate::style::Style;
use ::guard::Ranging;
use base::gpio::LineId;
use drivers::canbus::PauseStop;
use drivers::{canbus, joydev, rs485_bus};
use host::ports::settings::{CanInterface, CanPort, GamepadPort, SerialPort};
use host::ports::{GamepadPlace, GpioConfig, Transport};
use host::sys::ClockState;
use lcm::url::{Interface as Choice, Udpm};
use robot::config::{CanBus, ConfigError, Gamepad, Rs485Bus};
use settings::Section;
use settings::robot::{DrivenAxle, Geometry, Limits, Steered};
use std::collections::BTreeSet;
use std::fs;
use std::net::Ipv4Addr;
use std::path::{Path, PathBuf};
use std::time::Duration;

const HERE: Ipv4Addr = Ipv4Addr::new(10, 1, 2, 3);

fn lo() -> Interface {
    let addresses = vec![Ipv4Addr::LOCALHOST];
    Interface { name: "lo".into(), index: 1, up: true, loopback: true, mtu: 65_536, addresses, ..Interface::default() }
}

fn eth(name: &str, index: u32) -> Interface {
    let addresses = vec![HERE];
    Interface { name: name.into(), index, up: true, multicast: true, mtu: 1500, addresses, ..Interface::default() }
}

/// Level, and a word that must be in what it says or in its cure.
#[track_caller]
fn says(finding: &Finding, level: Level, what: &str, cure: &str) {
    assert_eq!(finding.level, level, "{finding:?}");
    assert!(finding.what.contains(what), "{finding:?}");
    assert!(finding.cure.contains(cure), "{finding:?}");
    assert_eq!(level == Level::Ok, finding.why.is_empty() && finding.cure.is_empty(), "{finding:?}");
}

#[test]
fn loopback_must_be_there_and_up_and_needs_no_multicast_flag() {
    says(&bus::loopback(Some(&lo())), Level::Ok, "lo is up", "");
    says(&bus::loopback(Some(&Interface { up: false, ..lo() })), Level::Fail, "down", "ip link set lo up");
    let bare = Interface { addresses: Vec::new(), ..lo() };
    says(&bus::loopback(Some(&bare)), Level::Fail, "127.0.0.1", "ip address add 127.0.0.1/8 dev lo");
    assert_eq!(bus::loopback(None).level, Level::Fail);
}

#[test]
fn the_interface_of_the_url_must_be_there_up_and_have_an_address() {
    let all = [lo(), eth("eth0", 2), Interface { up: false, ..eth("eth1", 3) }];
    let by = |choice: Choice| bus::choice(&choice, &all).map(|interface| interface.index);
    assert_eq!(by(Choice::Name("eth0".into())), Ok(2));
    assert_eq!(by(Choice::Address(HERE)), Ok(2));
    says(&by(Choice::Name("eth1".into())).unwrap_err(), Level::Fail, "eth1 is down", "ip link set eth1 up");
    says(&by(Choice::Name("eth9".into())).unwrap_err(), Level::Fail, "no interface eth9", "ip -br");
    let bare = [Interface { addresses: Vec::new(), ..eth("eth0", 2) }];
    says(&bus::choice(&Choice::Name("eth0".into()), &bare).unwrap_err(), Level::Fail, "no IPv4", "dev eth0");
}

#[test]
fn the_route_says_where_ours_and_the_official_lcms_messages_go() {
    let url = Udpm::default();
    let (eth0, eth1) = (eth("eth0", 2), eth("eth1", 3));
    says(&bus::route(&url, Some(&eth0), None), Level::Ok, "eth0 (10.1.2.3, MTU 1500)", "");
    says(&bus::route(&url, Some(&eth0), Some(&eth0)), Level::Ok, "eth0", "");
    says(&bus::route(&url, Some(&lo()), None), Level::Ok, "lo (127.0.0.1", "");
    says(&bus::route(&url, None, None), Level::Warning, "on lo alone", "route add 239.255.76.67/32 dev lo src");
    says(&bus::route(&url, None, Some(&eth1)), Level::Warning, "on eth1 alone", "dev eth1");
    says(&bus::route(&url, Some(&eth0), Some(&eth1)), Level::Warning, "official LCM's by eth0", "dev eth1");
    let deaf = Interface { multicast: false, ..eth("tun0", 4) };
    says(&bus::route(&url, Some(&deaf), None), Level::Warning, "no multicast", "link set tun0 multicast on");
}

fn trip(heard: Result<(u32, Duration), String>) -> Trip {
    Trip { way: "on eth0".into(), heard }
}

#[test]
fn what_is_not_heard_is_a_failure_of_ours_and_a_warning_for_others() {
    let url = Udpm::default();
    let (well, deaf) = (trip(Ok((2, Duration::ZERO))), trip(Err("not heard".into())));
    let joined = Ok((Duration::from_micros(20), 2 << 20));
    let ways = [well.clone(), deaf.clone()];
    says(&bus::self_test(&url, &joined, &ways[..1], true), Level::Ok, "on eth0", "");
    says(&bus::self_test(&url, &joined, &ways, true), Level::Fail, "on eth0: not heard", "nft insert rule");
    says(&bus::self_test(&url, &joined, &ways, false), Level::Fail, "on eth0: not heard", "iptables -I INPUT");
    let refused = Err("cannot join".to_string());
    says(&bus::self_test(&url, &refused, &ways[..1], true), Level::Fail, "7667?ttl=0: cannot join", "nft");
    says(&bus::official(&url, &ways[..1], None), Level::Ok, "hear each other", "");
    says(&bus::official(&url, &ways, None), Level::Warning, "not heard", "ip route get 239.255.76.67");
    let eth1 = eth("eth1", 3);
    says(
        &bus::official(&url, &ways[..1], Some(&eth1)),
        Level::Warning,
        "eth1 leads to the group, no",
        "tcpdump -ni eth1",
    );
}

#[test]
fn other_buses_than_multicast_must_join_processes() {
    let hub = "127.0.0.1:7700".parse().unwrap();
    says(&bus::hub(hub, &Ok(Duration::from_micros(50))), Level::Ok, "127.0.0.1:7700 answers after 0.05 ms", "");
    says(&bus::hub(hub, &Err("refused".into())), Level::Fail, "127.0.0.1:7700: refused", "sport = :7700");
    says(&bus::alone(&lcm::Url::Memq), Level::Fail, "memq:// joins no processes", "LCM_DEFAULT_URL");
}

#[test]
fn that_nothing_leaves_is_proven_by_a_count_that_counts() {
    let url = Udpm::default();
    let eth0 = eth("eth0", 2);
    let of = |left| Ok(Outgoing { ttl: 0, sent: 16, left });
    let check = |out, control| bus::outgoing(&url, Some(&eth0), &out, &control);
    says(&check(of(0), of(16)), Level::Ok, "none of 16 datagrams left by eth0", "");
    says(&check(of(3), of(20)), Level::Ok, "none of 16", "");
    says(&check(of(16), of(16)), Level::Fail, "16 datagrams with TTL 0 went out on eth0", "dev lo");
    says(&check(of(0), of(0)), Level::Warning, "does not count", "tcpdump");
    says(&check(Err("no table".into()), of(16)), Level::Warning, "no table", "tcpdump");
    says(&check(Ok(Outgoing { ttl: 1, sent: 16, left: 0 }), of(16)), Level::Warning, "TTL of 1", "tcpdump");
    says(&bus::outgoing(&url, Some(&lo()), &of(16), &of(16)), Level::Ok, "on lo", "");
    says(&bus::outgoing(&url, None, &of(16), &of(16)), Level::Ok, "on lo", "");
    let wide = Udpm { ttl: 1, ..url.clone() };
    says(&bus::outgoing(&wide, Some(&eth0), &of(0), &of(16)), Level::Warning, "TTL 1 sends", "ttl=0");
    says(&bus::outgoing(&wide, Some(&lo()), &of(0), &of(16)), Level::Ok, "on lo", "");
}

#[test]
fn that_nothing_enters_is_proven_by_datagrams_that_could() {
    let url = Udpm::default();
    let check = |proof| bus::incoming(&url, &proof).unwrap();
    let of = |control, passed| Ok(Incoming { sent: 16, control, passed });
    says(&check(of(16, 0)), Level::Ok, "none of 16 datagrams of another computer passed", "");
    says(&check(of(16, 1)), Level::Fail, "1 of 16 datagrams", "optmem_max");
    says(&check(of(3, 0)), Level::Ok, "not proven: 3 of 16", "");
    says(&check(Err(Unproven::NoNetwork("not permitted".into()))), Level::Ok, "not tried here: not permitted", "");
    says(&check(Err(Unproven::NoFilter("no memory".into()))), Level::Fail, "no memory", "optmem_max");
    assert!(bus::incoming(&Udpm { ttl: 1, ..url.clone() }, &of(16, 0)).is_none(), "said with what leaves");
    // The result on this machine: a proof, or the reason why it cannot be given.
    match super::entering::prove() {
        Ok(Incoming { sent, control, passed }) => assert_eq!((control, passed), (sent, 0)),
        Err(why) => assert!(matches!(why, Unproven::NoNetwork(_)), "{why:?}"),
    }
}

#[test]
fn the_receive_buffer_is_judged_by_what_datagrams_really_take() {
    // As measured on an interface with an MTU of 1400.
    let usual = Buffer { asked: 2 << 20, granted: 2 << 20, max: Some(4 << 20), taken: (4608, 110_592) };
    let what = "2 MiB as usual: 13 ms of heavy traffic, or a message of 2.4 MB; \
                for more: recv_buf_size=9437184, net.core.rmem_max=9437184";
    assert_eq!(buffer::buffer(&usual), Finding::ok("receive buffer", what));
    let roomy = Buffer { max: Some(16 << 20), ..usual };
    assert!(!buffer::buffer(&roomy).what.contains("rmem_max"), "the limit does: {:?}", buffer::buffer(&roomy));
    let debian = Buffer { granted: 212_992, max: Some(212_992), ..usual };
    says(&buffer::buffer(&debian), Level::Warning, "208 KiB instead of 2 MiB", "net.core.rmem_max=9437184 ");
    // A privileged doctor is granted more than the robot's modules will be.
    says(&buffer::buffer(&Buffer { granted: 2 << 20, ..debian }), Level::Warning, "208 KiB instead", "rmem_max");
    // A name space that does not show the limit.
    says(&buffer::buffer(&Buffer { max: None, ..debian }), Level::Warning, "208 KiB instead", "rmem_max");
    let as_recommended = Buffer { asked: 9 << 20, granted: 9 << 20, max: Some(9 << 20), ..usual };
    let what = "9 MiB as asked: 60 ms of heavy traffic, or a message of 11.1 MB";
    assert_eq!(buffer::buffer(&as_recommended), Finding::ok("receive buffer", what));
    let nothing = Buffer { taken: (0, 0), ..usual };
    assert_eq!(buffer::buffer(&nothing).level, Level::Ok);
}

#[test]
fn a_socket_must_be_able_to_join_twice() {
    assert_eq!(bus::memberships(Some(20)), None);
    assert_eq!(bus::memberships(None), None);
    says(&bus::memberships(Some(1)).unwrap(), Level::Fail, "join 1 groups", "igmp_max_memberships=20");
}

#[test]
fn strict_reverse_paths_matter_between_hosts_with_several_networks() {
    let near = Udpm::default();
    let far = Udpm { ttl: 1, ..near.clone() };
    let strict = Interface { rp_filter: 1, ..eth("eth0", 2) };
    let all = [lo(), strict.clone(), eth("eth1", 3)];
    let found = bus::reverse_path(&far, Some(&strict), &all).unwrap();
    says(&found, Level::Warning, "strict on eth0", "net.ipv4.conf.eth0.rp_filter=2");
    assert_eq!(bus::reverse_path(&near, Some(&strict), &all), None);
    assert_eq!(bus::reverse_path(&far, Some(&strict), &all[..2]), None);
    assert_eq!(bus::reverse_path(&far, Some(&eth("eth0", 2)), &all), None);
}

#[test]
fn programs_on_the_bus_are_named_and_their_losses_told() {
    let of = |name: &str, pid, drops| {
        let ours = name.starts_with("advee");
        Listener { uid: 1000, program: Some((name.into(), pid)), ours, drops }
    };
    says(&buffer::listeners(&[], 9), Level::Ok, "none is on the bus", "");
    let calm = [of("advee run watchdog", 7, 0), of("lcm-spy", 8, 0), of("lcm-spy", 9, 0)];
    says(&buffer::listeners(&calm, 0), Level::Ok, "3: advee run watchdog, 2 x lcm-spy; none lost", "");
    let full = [of("advee run watchdog", 7, 900), of("lcm-logger", 8, 500)];
    says(&buffer::listeners(&full, 300), Level::Warning, "lcm-logger, process 8 lost up to 300", "top -Hp 8");
    // What a socket's own filter refuses is counted there, too: no loss where the host knows of none, or of ours.
    says(&buffer::listeners(&full, 0), Level::Ok, "none lost", "");
    assert_eq!(buffer::listeners(&full[..1], 300), Finding::ok("programs", "1: advee run watchdog"));
    let hidden = [Listener { uid: 0, program: None, ours: false, drops: 5 }];
    says(&buffer::listeners(&hidden, 5), Level::Warning, "user 0's lost up to 5", "sudo advee doctor");
    let mixed = [of("advee", 7, 0), hidden[0].clone()];
    says(&buffer::listeners(&mixed, 0), Level::Warning, "users 0, 1000", "ps ");
}

#[test]
fn shared_memory_is_looked_at_where_it_is_wanted() {
    let good = Shm { writable: true, memory: true, free: 1 << 30 };
    assert_eq!(bus::shm(false, None), None);
    says(&bus::shm(true, Some(good)).unwrap(), Level::Ok, "1 GiB free", "");
    says(&bus::shm(true, None).unwrap(), Level::Warning, "no /dev/shm", "mount");
    let small = Shm { free: 1 << 20, ..good };
    says(&bus::shm(true, Some(small)).unwrap(), Level::Warning, "1 MiB left", "size=64M");
    let closed = Shm { writable: false, ..good };
    says(&bus::shm(true, Some(closed)).unwrap(), Level::Warning, "not writable", "chmod 1777");
    let disk = Shm { memory: false, ..good };
    says(&bus::shm(true, Some(disk)).unwrap(), Level::Warning, "on a disk", "tmpfs");
}

#[test]
fn every_line_that_is_wrong_in_the_configuration_is_a_failure() {
    let lines = ["conf/robot.toml:12: speed = 9: expected less".to_string(), "conf/modules.toml: not found".into()];
    let found = devices::configuration(&Err(ConfigError(lines.into())), Path::new("conf"));
    says(&found[0], Level::Fail, "robot.toml:12", "+12 conf/robot.toml");
    says(&found[1], Level::Fail, "not found", "ls -l conf");
    let set = ConfigError(vec!["--set: x: unknown key".into()]);
    assert_eq!(devices::configuration(&Err(set), Path::new("conf"))[0].cure, "");
}

fn rs485() -> Rs485Bus {
    Rs485Bus {
        name: "a".into(),
        line: SerialPort { port: "/dev/ttyUSB0".into(), transport: Transport::TwoByte, ..SerialPort::usual() },
        driver: rs485_bus::BusConfig::usual(),
    }
}

#[test]
fn a_serial_port_must_be_a_device_that_may_be_opened() {
    let mut bus = rs485();
    let good = Device { there: true, character: true, access: true, readable: true, group: Some("dialout".into()) };
    let check = |bus: &Rs485Bus, device: Device| devices::serial(bus, &device, "robo");
    says(&check(&bus, good.clone()).unwrap(), Level::Ok, "/dev/ttyUSB0", "");
    says(&check(&bus, Device::default()).unwrap(), Level::Fail, "is not there", "ls -l /dev/serial/by-id/");
    let file = Device { character: false, ..good.clone() };
    says(&check(&bus, file).unwrap(), Level::Fail, "is no device", "ls -lL /dev/ttyUSB0");
    let closed = Device { access: false, ..good };
    says(&check(&bus, closed.clone()).unwrap(), Level::Fail, "robo may not open", "usermod -aG dialout robo");
    let owned = Device { group: Some("root".into()), ..closed };
    says(&check(&bus, owned).unwrap(), Level::Fail, "robo may not open", "usermod -aG dialout robo");
    bus.line.port = "rs485-a".into();
    assert_eq!(check(&bus, Device::default()), None);
}

#[test]
fn the_ports_of_drives_and_lidars_are_checked_and_those_of_the_simulator_are_not() {
    let conf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/courier");
    let load = |port: &str| {
        let motor = "driver=\"vesc\",id=1,gear=8,pole_pairs=7,erpm_min=60";
        let line = |axis: &str| format!("serial.{axis}={{port=\"{port}{axis}\",axis=\"{axis}\",{motor}}}");
        let sets = ["can.main.nodes=[]".into(), line("left"), line("right")];
        robot::config::Config::load(&conf, false, &sets).unwrap().robot
    };
    let good = Device { there: true, character: true, access: true, readable: true, group: Some("dialout".into()) };
    let device = |path: &Path| if path.ends_with("tty-left") { Device::default() } else { good.clone() };
    let found = devices::streams(&load("/dev/tty-"), device, "robo");
    let checks: Vec<&str> = found.iter().map(|finding| finding.check.as_str()).collect();
    assert_eq!(checks, ["serial.left", "serial.right", "lidar.top"]);
    says(&found[0], Level::Fail, "/dev/tty-left is not there", "ls -l /dev/serial/by-id/");
    says(&found[1], Level::Ok, "/dev/tty-right, 115200 bit/s asked", "");
    says(&found[2], Level::Ok, "/dev/ttyUSB0", "");
    let simulated = devices::streams(&load("serial-"), device, "robo");
    assert_eq!(simulated.iter().map(|finding| finding.check.as_str()).collect::<Vec<_>>(), ["lidar.top"]);
}

#[test]
fn a_gamepad_that_is_not_there_is_well_and_one_that_may_not_be_heard_is_not() {
    let gamepad = |place| Gamepad { port: GamepadPort { place, grab: false }, driver: joydev::Config::usual() };
    let there =
        Device { there: true, character: true, readable: true, group: Some("input".into()), ..Device::default() };
    let check = |place: GamepadPlace, device: &Device| devices::gamepad(&gamepad(place), |_| device.clone(), "robo");
    let own = || GamepadPlace::Device("/dev/input/event5".into());
    says(&check(own(), &there).unwrap(), Level::Ok, "event5 is connected", "");
    says(&check(own(), &Device::default()).unwrap(), Level::Ok, "event5 is not there: not connected", "");
    let closed = Device { readable: false, ..there.clone() };
    says(&check(own(), &closed).unwrap(), Level::Fail, "robo may not open /dev/input/event5", "usermod -aG input robo");
    says(&check(GamepadPlace::Auto, &there).unwrap(), Level::Ok, "any gamepad in /dev/input", "");
    assert_eq!(check(GamepadPlace::Stream("gamepad".into()), &there), None);
}

#[test]
fn a_can_interface_must_be_up_at_the_bit_rate_asked() {
    let interface = CanInterface::Socket("can0".into());
    let driver = canbus::BusConfig::usual();
    let bus = CanBus { name: "main".into(), port: CanPort { interface, raw: false }, driver };
    let state = Some("ERROR-ACTIVE".into());
    let good = Can { there: true, can: true, up: true, bitrate: Some(500_000), state };
    let check = |can: Can| devices::can(&bus, &can).unwrap();
    says(&check(good.clone()), Level::Ok, "500000 bit/s, ERROR-ACTIVE", "");
    says(&check(Can { bitrate: None, state: None, ..good.clone() }), Level::Ok, "virtual", "");
    says(&check(Can::default()), Level::Fail, "no interface can0", "type can");
    says(&check(Can { can: false, ..good.clone() }), Level::Fail, "no CAN interface", "type can");
    says(&check(Can { up: false, ..good.clone() }), Level::Fail, "can0 is down", "bitrate 500000");
    let slow = Can { bitrate: Some(250_000), ..good.clone() };
    says(&check(slow), Level::Fail, "runs at 250000 bit/s", "ip link set can0 down");
    says(&check(Can { state: Some("BUS-OFF".into()), ..good }), Level::Fail, "BUS-OFF", "restart-ms");
    let virtual_bus = CanInterface::Udp { group: HERE, port: None };
    let virtual_bus = CanBus { port: CanPort { interface: virtual_bus, raw: false }, ..bus.clone() };
    assert_eq!(devices::can(&virtual_bus, &Can::default()), None);
}

#[test]
fn real_time_is_had_by_limits_or_by_rights() {
    let limits = |priority, locked| RealTime { wanted: Some(50), priority, locked, ..RealTime::default() };
    let check = |facts: RealTime| machine::real_time(&facts, "robo");
    says(&check(RealTime::default()), Level::Ok, "no module asks", "");
    says(&check(limits(0, 0)), Level::Fail, "rt_priority 50 is asked for, robo may 0", "robo - rtprio 50");
    says(&check(limits(50, 8 << 20)), Level::Warning, "8 MiB", "memlock unlimited");
    says(&check(limits(99, u64::MAX)), Level::Ok, "priority 50 and all of the memory", "");
    says(&check(RealTime { may_nice: true, may_lock: true, ..limits(0, 0) }), Level::Ok, "50", "");
}

/// The same finding: a warning that names the cure where a module asks for real time, a note elsewhere.
#[track_caller]
fn warns(check: impl Fn(Option<u8>) -> Finding, what: &str, cure: &str) {
    says(&check(Some(50)), Level::Warning, what, cure);
    says(&check(None), Level::Ok, what, "");
}

#[test]
fn an_ordinary_kernel_is_a_warning_where_real_time_is_wanted() {
    let of = |preempt_rt, architecture: &'static str| {
        move |wanted| real_time::kernel(wanted, "6.1.0-56", preempt_rt, architecture)
    };
    warns(of(false, "x86_64"), "6.1.0-56, not PREEMPT_RT", "install linux-image-rt-amd64 ");
    warns(of(false, "aarch64"), "not PREEMPT_RT", "linux-image-rt-arm64");
    warns(of(false, "arm"), "not PREEMPT_RT", "linux-image-rt-armmp");
    warns(of(false, "riscv64"), "not PREEMPT_RT", "linux-image-rt ");
    says(&of(true, "x86_64")(Some(50)), Level::Ok, "PREEMPT_RT", "");
}

#[test]
fn throttling_is_well_as_linux_sets_it_and_without() {
    let of = |runtime, period| move |wanted| real_time::throttling(wanted, runtime, period);
    says(&of(Some(950_000), 1_000_000)(Some(50)), Level::Ok, "rest after 950000", "");
    says(&of(Some(-1), 1_000_000)(Some(50)), Level::Ok, "none", "");
    says(&of(None, 1_000_000)(Some(50)), Level::Ok, "does not say", "");
    warns(of(Some(949_999), 1_000_000), "949999 of each 1000000 us", "sched_rt_runtime_us=950000");
    warns(of(Some(0), 1_000_000), "may run 0", "sysctl");
}

#[test]
fn deep_sleep_costs_a_wake_up() {
    let of = |deepest| move |wanted| real_time::sleep(wanted, deepest);
    says(&of(None)(Some(50)), Level::Ok, "do not sleep", "");
    says(&of(Some(100))(Some(50)), Level::Ok, "within 100 us", "");
    warns(of(Some(101)), "takes 101 us", "cpupower idle-set -D 100");
}

#[test]
fn an_adapter_that_collects_bytes_is_told_unless_its_module_changes_that() {
    let of = |bus: Rs485Bus, timer| move |wanted| real_time::latency_timer(wanted, &bus, "ttyUSB0", timer).unwrap();
    assert_eq!(real_time::latency_timer(Some(50), &rs485(), "ttyS0", None), None);
    says(&of(rs485(), Some(1))(Some(50)), Level::Ok, "after 1 ms", "");
    let low = Rs485Bus { line: SerialPort { low_latency: true, ..rs485().line }, ..rs485() };
    says(&of(low, Some(16))(Some(50)), Level::Ok, "until its module opens it", "");
    warns(of(rs485(), Some(16)), "collects bytes for 16 ms", "/ttyUSB0/latency_timer");
    warns(of(rs485(), Some(2)), "for 2 ms", "low_latency = true in [rs485.a]");
}

#[test]
fn a_long_queue_before_a_can_controller_is_told_in_ms() {
    let of = |frames| move |wanted| real_time::transmit_queue(wanted, "main", "can0", frames, 500_000).unwrap();
    assert_eq!(real_time::transmit_queue(Some(50), "main", "can0", None, 500_000), None);
    says(&of(Some(10))(Some(50)), Level::Ok, "10 frames", "");
    says(&of(Some(100))(Some(50)), Level::Ok, "100 frames", "");
    warns(of(Some(1000)), "1000 frames may wait in the queue of can0: 270 ms", "can0 txqueuelen 10");
    assert!(real_time::transmit_queue(None, "main", "can0", Some(1000), 0).is_some(), "no bit rate is no panic");
}

#[test]
fn what_brings_the_input_must_come_before_who_takes_it() {
    let of = |priority| Interrupt { bus: "can.main".into(), thread: "irq/17-can0".into(), pid: 61, priority };
    says(&real_time::interrupt(Some(40), &of(50)), Level::Ok, "irq/17-can0 has priority 50", "");
    says(&real_time::interrupt(None, &of(50)), Level::Ok, "priority 50", "");
    says(&real_time::interrupt(Some(50), &of(50)), Level::Warning, "modules up to 50", "chrt -f -p 51 61");
    says(&real_time::interrupt(Some(99), &of(50)), Level::Warning, "up to 99", "chrt -f -p 99 61");
}

/// A folder of files as `/proc` and `/sys` have them.
struct Tree(PathBuf);

impl Tree {
    fn new(name: &str, files: &[(&str, &str)]) -> Self {
        let root = std::env::temp_dir().join(format!("advee-doctor-{name}-{}", std::process::id()));
        for (path, text) in files {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        Self(root)
    }
}

impl Drop for Tree {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn the_deepest_sleep_that_is_not_disabled_counts() {
    let cpus = Tree::new(
        "sleep",
        &[
            ("cpu0/cpuidle/state0/latency", "0\n"),
            ("cpu0/cpuidle/state1/latency", "133\n"),
            ("cpu0/cpuidle/state2/latency", "890\n"),
            ("cpu0/cpuidle/state2/disable", "1\n"),
            ("cpu1/cpuidle/state1/latency", "85\n"),
            ("cpu1/cpuidle/state1/disable", "0\n"),
            ("cpu1/cpuidle/state2/latency", "garbage"),
            ("cpufreq/policy0", "x"),
        ],
    );
    assert_eq!(real_time::gather_sleep(&cpus.0), Some(133));
    assert_eq!(real_time::gather_sleep(&cpus.0.join("cpufreq")), None);
    assert_eq!(real_time::gather_sleep(Path::new("/nowhere")), None);
}

#[test]
fn threads_of_interrupts_are_found_by_name_and_priority() {
    let stat = |pid: u32, name: &str, priority: u8| {
        format!("{pid} ({name}) S 2 0 0 0 -1 2129984 {} {priority} 1 0\n", ["0"; 30].join(" "))
    };
    let (ours, other) = (stat(61, "irq/17-can0 (x)", 50), stat(7, "advee", 60));
    let files =
        [("61/stat", &*ours), ("7/stat", &*other), ("8/stat", "8 (irq/9-x) S"), ("9/stat", ""), ("self/stat", &*ours)];
    let proc = Tree::new("threads", &files);
    assert_eq!(real_time::gather_threads(&proc.0), [(61, "irq/17-can0 (x)".to_string(), 50)]);
}

#[test]
fn the_interrupt_of_a_device_is_its_own_or_that_of_what_it_hangs_on() {
    let sys = Tree::new(
        "interrupt",
        &[("pci/irq", "17\n"), ("pci/usb1/1-1/x", ""), ("pci/usb1/1-2/irq", "0\n"), ("pci/uart/irq", "4\n")],
    );
    let of = |path: &str| real_time::gather_interrupt(&sys.0.join(path));
    assert_eq!((of("pci/usb1/1-1"), of("pci/usb1/1-2"), of("pci/uart")), (Some(17), Some(17), Some(4)));
    assert_eq!(of("nowhere"), None);
}

const GEOMETRY: Geometry = Geometry {
    wheelbase_m: 0.6,
    track_m: 0.5,
    wheel_radius_m: 0.1,
    length_m: Some(0.9),
    width_m: Some(0.6),
    rear_overhang_m: Some(0.15),
    footprint_m: None,
    ticks_per_turn: 4000,
    driven: DrivenAxle::Fixed,
    steered: Steered::FRONT,
};

const LIMITS: Limits = Limits {
    speed_mps: 1.2,
    speed_manual_mps: 0.6,
    speed_autonomous_mps: 0.8,
    steering_rad: 0.61,
    acceleration_mps2: 0.5,
    deceleration_mps2: 0.8,
    quick_stop_mps2: 1.5,
    lateral_acceleration_mps2: 0.8,
    steering_rate_radps: 0.7,
    rotation_radps: 1.0,
    command_ttl: base::Duration::from_millis(250),
};

/// A guard with these sensors: x and direction of each, on the middle line; its beam covers the robot's width 0.5 m
/// ahead.
fn guarded(ranging: Ranging, sensors: &[(f64, f64)]) -> ::guard::Config {
    let at = |x| navitools::Point { x, y: 0.0 };
    let sensor = |&(x, theta): &(f64, f64)| ::guard::Sonar { id: 0, at: at(x), theta, beam: 1.2 };
    let settings = ::guard::Settings { ranging, ..::guard::Settings::usual() };
    ::guard::Config::of(settings, &GEOMETRY, &LIMITS, 0.25, sensors.iter().map(sensor).collect())
}

#[test]
fn a_robot_that_senses_nothing_says_so_in_large_letters() {
    let blind = guarded(Ranging::None, &[]);
    says(&guard::ranging(&blind), Level::Warning, "NOTHING SENSES WHAT IS IN THE WAY: AT MOST 0.3 m/s", "");
    says(&guard::ranging(&guarded(Ranging::Sonar, &[])), Level::Ok, "by the sonars", "");
    says(&guard::ranging(&guarded(Ranging::SonarAndLidar, &[])), Level::Ok, "by the sonars and lidars", "");
}

#[test]
fn the_guard_must_not_count_on_more_than_the_weakest_stop() {
    let stop = |pause| canbus::Stop { pause, brake_mps2: 1.5, coasting_mps2: 0.15, ..canbus::Stop::usual() };
    let mut config = guarded(Ranging::Sonar, &[]);
    let check = |config: &::guard::Config, limits: &Limits, pause| guard::deceleration(config, limits, &stop(pause));
    let brake = check(&config, &LIMITS, PauseStop::Brake);
    says(&brake, Level::Ok, "counts on 0.25 m/s², the least of all stops is 0.8", "");
    // Without a brake it rolls when its motors lose their feed, a delayed opening or not.
    for pause in [PauseStop::Coast, PauseStop::Delayed] {
        let rolls = check(&config, &LIMITS, pause);
        says(&rolls, Level::Warning, "counts on 0.25 m/s², and stop.coasting_mps2 is 0.15", "");
    }
    let weak = Limits { quick_stop_mps2: 0.2, ..LIMITS };
    says(&check(&config, &weak, PauseStop::Brake), Level::Warning, "limits.quick_stop_mps2 is 0.2", "");
    config.braking = 0.15;
    says(&check(&config, &LIMITS, PauseStop::Coast), Level::Ok, "0.15", "");
}

#[test]
fn a_direction_that_no_sensor_covers_is_named() {
    let (front, rear) = ((0.75, 0.0), (-0.15, std::f64::consts::PI));
    let check = |sensors: &[(f64, f64)]| guard::coverage(&guarded(Ranging::Sonar, sensors));
    says(&check(&[front, rear]).unwrap(), Level::Ok, "in every direction of travel", "");
    says(&check(&[front]).unwrap(), Level::Warning, "the width of the robot backward", "");
    says(&check(&[]).unwrap(), Level::Warning, "the width of the robot forward, backward", "");
    assert!(check(&[]).unwrap().why.contains("at most at 0.3 m/s"));
    // A lidar on the front sees 270°: not what is right behind.
    let mount = navitools::Pose::new(0.75, 0.0, 0.0);
    let lidars = |view| vec![::guard::Lidar { name: "front".into(), mount, view }];
    let scanned = |view| ::guard::Config { lidars: lidars(view), ..guarded(Ranging::Lidar, &[]) };
    says(&guard::coverage(&scanned(4.7)).unwrap(), Level::Warning, "the width of the robot backward", "");
    says(&guard::coverage(&scanned(6.3)).unwrap(), Level::Ok, "in every direction of travel", "");
    assert_eq!(guard::coverage(&guarded(Ranging::None, &[front])), None, "it is said that nothing senses");
    let flat = ::guard::Config { footprint: Vec::new(), ..guarded(Ranging::Sonar, &[front]) };
    for finding in [guard::coverage(&flat).unwrap(), guard::deceleration(&flat, &LIMITS, &canbus::Stop::usual())] {
        says(&finding, Level::Fail, "has no area", "");
    }
}

#[test]
fn a_field_of_the_guard_that_no_sensor_looks_at_is_named() {
    let field = |polygon: [[f64; 2]; 3]| ::guard::FieldKeys {
        kind: ::guard::FieldKind::Protective,
        from: 0.0,
        polygon: polygon.into(),
    };
    let ahead = field([[1.2, -0.1], [2.0, 0.0], [1.2, 0.1]]);
    let behind = field([[-1.0, -0.1], [-0.5, 0.0], [-1.0, 0.1]]);
    let check = |fields: Vec<::guard::FieldKeys>| {
        let mut config = guarded(Ranging::Sonar, &[(0.75, 0.0)]);
        config.settings.fields = fields;
        guard::fields(&config)
    };
    assert_eq!(check(vec![]), None);
    says(&check(vec![ahead.clone()]).unwrap(), Level::Ok, "1 beside those that are computed", "");
    says(&check(vec![ahead, behind]).unwrap(), Level::Warning, "no sensor looks at 100 % of 1", "");
}

#[test]
fn a_clock_that_nobody_sets_is_a_warning() {
    let state = |synchronized| Ok(ClockState { synchronized, error_us: 12_345 });
    says(&machine::clock(&state(true), 2026), Level::Ok, "to 12 ms", "");
    says(&machine::clock(&state(false), 2026), Level::Warning, "not synchronised", "set-ntp true");
    says(&machine::clock(&state(true), 1970), Level::Warning, "year 1970", "set-ntp true");
    says(&machine::clock(&Err("denied".into()), 2026), Level::Warning, "denied", "timedatectl");
}

#[test]
fn a_sleepy_governor_is_a_warning() {
    let of = |names: &[&str]| machine::governors(&names.iter().map(ToString::to_string).collect::<BTreeSet<_>>());
    says(&of(&[]), Level::Ok, "fixed", "");
    says(&of(&["performance", "schedutil"]), Level::Ok, "performance, schedutil", "");
    says(&of(&["performance", "powersave"]), Level::Warning, "governor powersave", "scaling_governor");
}

#[test]
fn the_run_folder_must_be_writable_and_have_room() {
    let of = |writable, free| machine::run_folder(&Folder { path: "/run/advee".into(), writable, free }, "robo");
    says(&of(true, 1 << 30), Level::Ok, "/run/advee, 1 GiB free", "");
    says(&of(false, 1 << 30), Level::Fail, "cannot be written to by robo", "install -d -o robo /run/advee");
    says(&of(true, 100 << 20), Level::Warning, "100 MiB left", "df -h");
    says(&of(true, 1 << 20), Level::Fail, "1 MiB left", "df -h");
}

#[test]
fn a_report_is_lines_that_a_terminal_holds_and_commands_in_one_piece() {
    let long = "word ".repeat(40);
    let cure = "command ".repeat(20);
    let findings = vec![Finding::ok("one", "well"), Finding::fail("two", &long).why(&long).cure(cure.trim_end())];
    let counts = [(Level::Fail, 1), (Level::Warning, 0), (Level::Ok, 1)];
    let text = Style { colour: false }.text(&[("bus", findings.clone())], &counts);
    assert!(text.starts_with("bus\n  OK       one            well\n  FAIL     two            word word"), "{text}");
    assert!(text.contains(&format!("\n{:26}$ {}\n", "", cure.trim_end())), "{text}");
    assert!(text.ends_with("\n\n1 FAIL, 1 OK\n"), "{text}");
    assert!(text.lines().filter(|line| !line.contains('$')).all(|line| line.len() <= 100), "{text}");
    let coloured = Style { colour: true }.text(&[("bus", findings)], &counts);
    assert!(coloured.contains("\x1b[1;31mFAIL    \x1b[0m two"), "{coloured}");
}

#[test]
fn what_reads_the_emergency_stop_is_named_or_said_to_be_missing() {
    let found = |folder: &str, sets: &[&str]| {
        let conf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf").join(folder);
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        super::emergency_stop(&robot::config::Config::load(&conf, true, &sets).unwrap().robot)
    };
    says(&found("advee", &[]), Level::Ok, "read: the PAUSE line of the power controller", "");
    let input = ["stop.inputs=[{axis=\"left\",bit=3}]"];
    says(&found("courier", &input), Level::Ok, "read: digital input 3 of the left drive", "");
    says(&found("courier", &[]), Level::Warning, "not read", "");
}

#[test]
fn the_second_way_to_stop_is_named_or_said_to_be_missing() {
    let conf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee");
    let found = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        super::second_way(&robot::config::Config::load(&conf, true, &sets).unwrap().robot)
    };
    says(&found(&["stop.second_way=power"]), Level::Ok, "power controller", "");
    let output = ["stop.second_way=canopen", "stop.output.node=5", "stop.output.index=0x6200"];
    says(&found(&output), Level::Ok, "node 5 cuts the motors' feed by its object 0x6200:1", "");
    let line = ["stop.second_way=gpio", "stop.gpio.chip=/dev/gpiochip0", "stop.gpio.line=17"];
    says(&found(&line), Level::Ok, "line 17 of /dev/gpiochip0 cuts the motors' feed at its low level", "");
    says(&found(&["stop.second_way=none"]), Level::Warning, "none", "");
}

#[test]
fn the_gpio_line_that_cuts_the_feed_must_be_there_and_free() {
    let line = |chip: &str| GpioConfig { chip: chip.into(), line: LineId::Number(17), active_low: false };
    let good = Device { there: true, character: true, access: true, readable: true, group: Some("gpio".into()) };
    let check = |device: &Device, holder: Result<Option<&str>, &str>| {
        let holder = holder.map(|name| name.map(str::to_owned)).map_err(str::to_owned);
        devices::feed_line(&line("/dev/gpiochip0"), |_| device.clone(), |_| holder.clone(), "robo").unwrap()
    };
    says(&check(&good, Ok(None)), Level::Ok, "line 17 of /dev/gpiochip0 can be requested", "");
    says(&check(&good, Ok(Some("lamp"))), Level::Fail, "line 17 of /dev/gpiochip0 is held by \"lamp\"", "gpioinfo");
    says(&check(&good, Err("line 17: Invalid argument")), Level::Fail, "chip0: line 17: Invalid argument", "gpioinfo");
    says(&check(&Device::default(), Ok(None)), Level::Fail, "/dev/gpiochip0 is not there", "ls -l /dev/gpiochip*");
    let closed = Device { access: false, ..good };
    says(&check(&closed, Ok(None)), Level::Fail, "robo may not open /dev/gpiochip0", "usermod -aG gpio robo");
    assert_eq!(devices::feed_line(&line("gpio-motors"), |_| closed.clone(), |_| Ok(None), "robo"), None);
}

#[test]
fn temperatures_are_shown_and_a_computer_that_slows_itself_down_is_a_warning() {
    use base::thermal::{State, Throttle};
    let heat = |throttle, events| {
        let mut state = State::default();
        state.throttle = throttle;
        assert!(state.push("x86_pkg_temp", 45_400) && state.push("nvme/Composite", 38_000));
        machine::Heat { state, events }
    };
    let told = |slowed, under_voltage| Some(Throttle { slowed, under_voltage });
    let cool = machine::temperatures(&heat(told(false, false), Some(0)));
    assert_eq!((cool.level, cool.what.as_str()), (Level::Ok, "x86_pkg_temp 45 °C, nvme/Composite 38 °C"));
    let before = machine::temperatures(&heat(None, Some(3)));
    assert!(before.level == Level::Ok && before.what.ends_with(", slowed down 3 times since the start"));
    for (throttle, why) in [(told(true, false), "slows itself down"), (told(true, true), "supply voltage")] {
        let found = machine::temperatures(&heat(throttle, None));
        assert!(found.level == Level::Warning && found.what.contains(why), "{}", found.what);
    }
    assert_eq!(machine::temperatures(&machine::Heat::default()).what, "the kernel shows none");
}
