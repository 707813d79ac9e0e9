//! Power controller and beacon scanner of the whole robot: an engaged PAUSE line stops the robot, and it stays stopped.

use super::{Robot, at};
use base::{Duration, Fault, Instant};
use messages::{Hold, Message, StopSource, common, lowlevel, simulation};
use sim::host::News;
use std::cell::RefCell;
use std::rc::Rc;

#[derive(Default)]
struct Observed {
    stops: Vec<(Instant, lowlevel::EventStop)>,
    power: Vec<(Instant, lowlevel::DataPower)>,
    beacons: Vec<lowlevel::DataBeacons>,
    buses: Vec<lowlevel::DataBus>,
    scanner: Vec<lowlevel::DataScanner>,
    axes: Vec<lowlevel::DataAxes>,
    wheels: Vec<lowlevel::DataWheels>,
    truth: Vec<(Instant, simulation::DataTruth)>,
    reports: Vec<(Instant, base::Report)>,
    notes: Vec<String>,
    processes: Option<common::DataProcesses>,
}

impl Observed {
    fn take(&mut self, now: Instant, news: &News<'_>) {
        match news {
            News::Message { message: Message::LlEventStop(stop), .. } => self.stops.push((now, stop.clone())),
            News::Message { message: Message::LlDataPower(power), .. } => self.power.push((now, power.clone())),
            News::Message { message: Message::LlDataBeacons(beacons), .. } => self.beacons.push(beacons.clone()),
            News::Message { message: Message::LlDataBus(bus), .. } => self.buses.push(bus.clone()),
            News::Message { message: Message::LlDataScanner(scanner), .. } => self.scanner.push(scanner.clone()),
            News::Message { message: Message::LlDataAxes(axes), .. } => self.axes.push(axes.clone()),
            News::Message { message: Message::LlDataWheels(wheels), .. } => self.wheels.push(wheels.clone()),
            News::Message { message: Message::SimDataTruth(truth), .. } => self.truth.push((now, truth.clone())),
            News::Message { message: Message::CmDataProcesses(list), .. } => self.processes = Some(list.clone()),
            News::Report { report, .. } => self.reports.push((now, (*report).clone())),
            News::Note { line, .. } => self.notes.push((*line).to_owned()),
            _ => {}
        }
    }

    fn reported(&self, fault: Fault) -> bool {
        self.reports.iter().any(|(_, report)| report.fault == fault)
    }
}

/// All modules run, the steering is homed; and everything received from now on.
fn ready(seed: u64) -> (Robot, Rc<RefCell<Observed>>) {
    let mut robot = Robot::ready(seed);
    let observed = Rc::new(RefCell::new(Observed::default()));
    let keep = observed.clone();
    robot.machine.observe(move |now, news| keep.borrow_mut().take(now, news));
    (robot, observed)
}

fn say(robot: &mut Robot, message: impl Into<Message>) {
    let now = robot.machine.now();
    robot.machine.inject(now, message);
}

fn fault(robot: &mut Robot, target: &str, fault: &str, value: f64, duration: f64) {
    let (target, fault) = (target.into(), fault.into());
    say(robot, simulation::CmdFault { timestamp: 0, target, fault, value, duration });
}

fn switch(robot: &mut Robot, device: i8, action: i8) {
    say(robot, lowlevel::CmdPower { timestamp: 0, device, action });
}

/// The robot stays stopped in spite of continuous commands; after a new command it drives.
fn is_latched_until_commanded_anew(robot: &mut Robot) {
    robot.drive(0.4, 0.0, 3.0);
    robot.pass(3.0);
    assert!(robot.speed().abs() < 0.001, "it resumed by itself");
    let latched = [Some(Hold::NotReleased), Some(Hold::PauseLatched)];
    assert!(latched.contains(&robot.hold()), "{}", robot.motion().reason);
    robot.pass(1.0);
    robot.drive_anew(-0.4, 0.0, 2.0);
    robot.pass(1.9);
    assert!(robot.speed() < -0.35, "{}: {}", robot.speed(), robot.motion().reason);
}

#[test]
fn a_bumper_stops_the_robot_until_a_new_command() {
    let (mut robot, observed) = ready(1);
    // From x = 3 through the hall, past its columns, to a stand's wall at x = 15.
    robot.drive(0.6, -0.02, 60.0);
    let before = robot.machine.now();
    while observed.borrow().truth.last().is_none_or(|(_, truth)| truth.collisions == 0) {
        robot.pass(0.05);
        assert!(robot.machine.now().since(before) < Duration::from_secs(40), "it runs into nothing");
    }
    robot.pass(0.3);
    assert!(robot.speed().abs() < 0.001);
    let stands = [Some(Hold::PauseBumper), Some(Hold::DriveFault)];
    assert!(stands.contains(&robot.hold()), "{}", robot.motion().reason);
    let stops = observed.borrow().stops.clone();
    let (told, stop) = stops.iter().find(|(_, stop)| stop.engaged).expect("the line is engaged");
    assert_eq!(StopSource::from_name(&stop.source).is_front(), Some(true), "{stop:?}");
    let hit = observed.borrow().truth.iter().find(|(_, truth)| truth.collisions > 0).expect("it ran into it").0;
    // The truth is published every 50 ms; the board's 7 words take 0.67 ms.
    assert!(
        told.since(hit) < Duration::from_millis(1) && hit.since(*told) < Duration::from_millis(51),
        "{told:?} {hit:?}"
    );
    // Its foam pushes the robot off after 500 ms; the supply is back, the drive is reset.
    robot.pass(3.0);
    assert!(observed.borrow().stops.last().is_some_and(|(_, stop)| !stop.engaged));
    let left = at(12.0 + 60.0).since(robot.machine.now()).as_secs_f64();
    robot.pass(left + 1.0);
    assert!(robot.speed().abs() < 0.001, "whoever drove went on commanding for {left} s");
    robot.drive_anew(-0.4, 0.0, 2.0);
    robot.pass(1.9);
    assert!(robot.speed() < -0.35, "{}: {}", robot.speed(), robot.motion().reason);
}

#[test]
fn the_corner_that_sees_no_floor_is_reported_until_a_person_releases_the_board() {
    let hall = super::place();
    let world = hall.world.as_ref().map(|file| file.with_file_name("warehouse.toml"));
    let place = robot::place::RobotLocation { world, ..hall };
    let mut robot = Robot::at(&place, sim::host::Config { seed: 1, ..sim::host::Config::default() });
    let observed = Rc::new(RefCell::new(Observed::default()));
    let keep = observed.clone();
    robot.machine.observe(move |now, news| keep.borrow_mut().take(now, news));
    robot.pass(12.0);
    // Along the left end of the loading dock: only the right floor sensor comes over it.
    fault(&mut robot, "robot", "put:27.0,19.1,0", 0.0, 0.0);
    robot.pass(0.5);
    robot.drive_anew(0.3, 0.0, 6.0);
    robot.pass(8.0);
    let told = |observed: &Observed| {
        let of = observed.reports.iter().filter(|(_, report)| report.fault == Fault::FloorMissing);
        of.map(|(_, report)| (report.subject.clone(), report.message.clone())).collect::<Vec<_>>()
    };
    let stops = observed.borrow().stops.last().cloned().expect("each 500 ms").1;
    assert_eq!((stops.engaged, stops.source.as_str()), (true, "sd1_front"), "{}", robot.motion().reason);
    let first = told(&observed.borrow());
    assert!(first.len() == 1 && first[0].0 == "sd1_front", "{first:?}");
    assert!(first[0].1.starts_with("no floor at the front right corner"), "{first:?}");
    // Pushed back, and released by a person.
    fault(&mut robot, "robot", "put:24.0,19.1,0", 0.0, 0.0);
    robot.pass(1.0);
    let (module, state) = ("driver_rs485a".into(), common::DataState::RUN);
    say(&mut robot, common::CmdState { timestamp: 0, module, state, manual: true, source: "test".into() });
    robot.pass(2.0);
    let all = told(&observed.borrow());
    assert!(all.len() == 2 && all[1].1.contains("does not engage PAUSE any more"), "{all:?}");
}

#[test]
fn the_stop_button_stops_the_robot_until_a_new_command() {
    let (mut robot, observed) = ready(1);
    robot.drive(0.4, 0.0, 6.0);
    robot.pass(2.0);
    let pressed = robot.machine.now();
    fault(&mut robot, "psc1", "stop_button", 0.0, 2.5);
    robot.pass(0.2);
    // Before the report, the line has already cut the motors' supply, and their brake acts.
    let motion = robot.motion();
    assert!(!motion.enabled && robot.speed() < 0.2, "{motion:?}");
    let (told, stop) = observed.borrow().stops.iter().find(|(_, stop)| stop.engaged).cloned().expect("it is told");
    assert_eq!(stop.source, "button");
    // Through LCM to the simulator 50 to 250 us, 7 words of 95.5 us.
    assert!(told.since(pressed) < Duration::from_millis(1), "{told:?}");
    robot.pass(2.2);
    assert!(robot.speed().abs() < 0.001, "{}", robot.speed());
    robot.pass(1.6);
    assert!(observed.borrow().stops.last().is_some_and(|(_, stop)| !stop.engaged));
    is_latched_until_commanded_anew(&mut robot);
}

#[test]
fn a_silent_power_controller_stops_the_robot_1200_ms_after_its_last_message() {
    let (mut robot, observed) = ready(1);
    robot.drive(0.4, 0.0, 10.0);
    robot.pass(2.0);
    let silent = robot.machine.now();
    fault(&mut robot, "psc1", "silent", 0.0, 5.0);
    robot.pass(1.5);
    let stopped = robot.quick_stop_after(silent);
    assert!(stopped.since(silent) <= Duration::from_millis(1205), "{:?}", stopped.since(silent));
    let last = observed.borrow().stops.iter().map(|(at, _)| *at).filter(|at| *at < stopped).max().expect("told before");
    let took = stopped.since(last);
    assert!((1200..=1202).contains(&took.as_millis()), "{took:?} after the last word");
    assert_eq!(robot.hold(), Some(Hold::PauseUnknown));
    assert!(observed.borrow().reported(Fault::PauseUnknown));
    robot.pass(4.5);
    is_latched_until_commanded_anew(&mut robot);
}

#[test]
fn a_power_driver_that_dies_stops_the_robot_at_once_and_is_back_within_a_second() {
    let (mut robot, _) = ready(1);
    robot.drive(0.4, 0.0, 4.0);
    robot.pass(2.0);
    let died = robot.machine.now();
    let pid = robot.machine.pid("driver_power").expect("it runs");
    robot.machine.kill(pid);
    robot.pass(1.0);
    let took = robot.quick_stop_after(died).since(died);
    assert!(took < Duration::from_millis(5), "{took:?}");
    assert_eq!(robot.hold(), Some(Hold::NotReleased));
}

#[test]
fn channels_stop_and_start_at_the_board_s_pace() {
    let (mut robot, observed) = ready(1);
    let begin = robot.machine.now();
    for channel in [4, 5] {
        switch(&mut robot, channel, lowlevel::CmdPower::OFF);
    }
    switch(&mut robot, 2, lowlevel::CmdPower::REBOOT);
    robot.pass(12.0);
    let power = observed.borrow().power.clone();
    let on = |power: &lowlevel::DataPower, name: &str| {
        power.channels.iter().find(|channel| channel.name == name).expect("all are there").on
    };
    // The first command is executed at once; of the others the computer precedes audio. Polled once a second.
    let off = |name: &str| power.iter().find(|(_, power)| !on(power, name)).expect("it went off").0.since(begin);
    let (computer, monitor, audio) = (off("computer2"), off("monitor"), off("audio"));
    assert!(
        monitor < computer && computer < audio && audio < Duration::from_secs(4),
        "{computer:?} {monitor:?} {audio:?}"
    );
    let (_, last) = power.last().expect("once a second");
    assert!(on(last, "computer2") && !on(last, "monitor") && !on(last, "audio"), "{last:?}");
    assert!(last.channels[4].current < 0.05 && last.channels[2].current > 0.5, "{last:?}");
    assert!(observed.borrow().notes.iter().any(|note| note == "power channel computer2 is on"));
}

#[test]
fn without_the_motors_channel_it_does_not_drive_and_without_sensors_their_boards_are_lost() {
    let (mut robot, observed) = ready(1);
    switch(&mut robot, 3, lowlevel::CmdPower::OFF);
    robot.pass(2.0);
    robot.drive(0.4, 0.0, 1.0);
    robot.pass(1.5);
    assert!(robot.speed().abs() < 0.001 && robot.hold() == Some(Hold::FeedOff), "{}", robot.motion().reason);
    switch(&mut robot, 3, lowlevel::CmdPower::ON);
    robot.pass(4.0);
    robot.drive_anew(0.4, 0.0, 1.0);
    robot.pass(0.9);
    assert!(robot.speed() > 0.3, "{}", robot.motion().reason);
    robot.pass(3.0);
    switch(&mut robot, 6, lowlevel::CmdPower::OFF);
    robot.pass(8.0);
    assert!(observed.borrow().reported(Fault::BoardLost));
}

#[test]
fn a_channel_that_trips_is_reported_and_the_robot_goes_on_where_it_can() {
    let (mut robot, observed) = ready(1);
    fault(&mut robot, "psc1", "trip", 5.0, 0.0);
    robot.pass(3.0);
    let told = |observed: &Observed, fault: Fault| {
        let of = observed.reports.iter().filter(|(_, report)| report.fault == fault);
        of.map(|(_, report)| (report.severity, report.subject.clone())).collect::<Vec<_>>()
    };
    use base::Severity::{Error, Notice};
    assert_eq!(told(&observed.borrow(), Fault::ChannelTripped), [(Error, "audio".into())]);
    robot.drive_anew(0.4, 0.0, 2.0);
    robot.pass(1.9);
    assert!(robot.speed() > 0.35, "{}", robot.motion().reason);
    switch(&mut robot, 5, lowlevel::CmdPower::ON);
    robot.pass(4.0);
    assert_eq!(told(&observed.borrow(), Fault::ChannelTripped), [(Error, "audio".into()), (Notice, "audio".into())]);
    // The motors' channel: the robot stops, and says why.
    robot.drive_anew(0.4, 0.0, 6.0);
    robot.pass(2.0);
    fault(&mut robot, "psc1", "trip", 3.0, 0.0);
    robot.pass(4.0);
    assert!(robot.speed().abs() < 0.001, "{}", robot.speed());
    assert_eq!(told(&observed.borrow(), Fault::ChannelTripped).last(), Some(&(Error, "motors".into())));
}

/// The controller's start-up sequence from nothing: sensors first, the host at last, half a second apart; the modules
/// run already, and see boards and drives come up.
#[test]
fn a_robot_that_starts_cold_comes_up_by_the_controller_s_sequence() {
    let mut robot = Robot::new(1);
    let observed = Rc::new(RefCell::new(Observed::default()));
    let keep = observed.clone();
    robot.machine.observe(move |now, news| keep.borrow_mut().take(now, news));
    // Before the driver of the controller has asked it for anything.
    let runs = |robot: &Robot| {
        let pid = robot.machine.pid("simulator");
        pid.is_some_and(|pid| robot.machine.state(pid) == Some(module::State::Run))
    };
    while !runs(&robot) {
        robot.pass(0.001);
    }
    fault(&mut robot, "psc1", "cold", 0.0, 0.0);
    robot.pass(0.4);
    robot.drive(0.4, 0.0, 3.0);
    robot.pass(3.5);
    assert!(robot.speed().abs() < 0.001, "it moved before it was up");
    robot.pass(20.0);
    {
        let observed = observed.borrow();
        let on = |power: &lowlevel::DataPower| power.channels.iter().filter(|channel| channel.on).count();
        let counts: Vec<usize> = observed.power.iter().map(|(_, power)| on(power)).collect();
        assert!(counts[0] < 4 && counts.is_sorted() && counts.last() == Some(&8), "{counts:?}");
        assert!(!observed.reported(Fault::ChannelTripped) && !observed.reported(Fault::ChannelStuck));
    }
    // Homing waits for an operator, as after every start.
    robot.drive_anew(0.4, 0.0, 12.0);
    robot.pass(11.9);
    assert!(robot.speed() > 0.35, "{}", robot.motion().reason);
}

#[test]
fn the_current_of_the_propulsion_is_measured_and_rises_with_the_load() {
    let (mut robot, observed) = ready(1);
    robot.drive(0.6, 0.0, 4.0);
    robot.pass(4.0);
    let observed = observed.borrow();
    let row = |axes: &lowlevel::DataAxes, name: &str| axes.axes.iter().find(|axis| axis.name == name).cloned();
    let currents: Vec<f64> = observed.axes.iter().filter_map(|axes| Some(row(axes, "propulsion")?.current)).collect();
    assert!(currents.len() >= 20 && currents.iter().all(|current| current.is_finite()), "{currents:?}");
    let greatest = currents.iter().copied().fold(0.0, f64::max);
    assert!(greatest > 3.0 * currents[0].abs().max(0.05), "{currents:?}");
    let wheel = observed.wheels.last().and_then(|wheels| wheels.wheels.first()).expect("with the axes");
    assert!(wheel.load >= 0.0 && wheel.speed.is_finite() && wheel.temperature.is_nan(), "{wheel:?}");
    assert!(row(observed.axes.last().expect("5 Hz"), "steering").expect("there").current.is_nan());
}

#[test]
fn the_scanner_s_supply_and_rejected_pulses_are_published_and_a_low_supply_is_reported() {
    let (mut robot, observed) = ready(1);
    fault(&mut robot, "sbs1", "supply", 4.2, 25.0);
    fault(&mut robot, "sbs1", "glare", 200.0, 60.0);
    robot.pass(20.0);
    let last = observed.borrow().scanner.last().cloned().expect("each 10 s");
    assert!(last.supply == 4.2 && (last.rejected_rate - 200.0).abs() < 25.0, "{last:?}");
    assert!(observed.borrow().reported(Fault::BoardSupply));
    robot.pass(25.0);
    let told: Vec<_> = observed
        .borrow()
        .reports
        .iter()
        .filter(|(_, report)| report.fault == Fault::BoardSupply)
        .map(|(_, report)| report.severity)
        .collect();
    assert_eq!(told, [base::Severity::Warning, base::Severity::Notice]);
}

#[test]
fn the_battery_is_counted_down_and_a_low_charge_is_reported() {
    let (mut robot, observed) = ready(1);
    robot.pass(600.0);
    let power = observed.borrow().power.clone();
    assert!((599..=601).contains(&power.len()), "{}", power.len());
    let (first, last) = (&power[0].1, &power[power.len() - 1].1);
    // 150 W at 26.6 V for ten minutes, of 40 Ah.
    let drawn = 150.0 / 26.6 / 6.0 / 40.0;
    assert!((first.charge - last.charge - drawn).abs() < 0.1 * drawn, "{} to {}", first.charge, last.charge);
    let hours = last.remaining / 3600.0;
    assert!((hours - last.charge * 40.0 * 26.6 / 150.0).abs() < 0.3, "{hours} h");
    assert!(!observed.borrow().reported(Fault::BatteryLow));
    fault(&mut robot, "psc1", "battery", 23.0, 0.0);
    robot.pass(180.0);
    assert!(observed.borrow().reported(Fault::BatteryLow), "2.87 V a cell");
}

#[test]
fn before_its_supply_is_cut_the_robot_is_shut_down_in_order_without_halting_this_computer() {
    let (mut robot, observed) = ready(1);
    robot.drive(0.4, 0.0, 5.0);
    robot.pass(1.5);
    fault(&mut robot, "psc1", "power_off", 30.0, 0.0);
    robot.pass(6.0);
    assert!(robot.speed().abs() < 0.001);
    let list = observed.borrow().processes.clone().expect("the watchdog lives");
    let phase = |name: &str| list.processes.iter().find(|process| process.module == name).expect("listed").phase;
    for name in ["driver_canbus", "driver_rs485a", "driver_rs485b"] {
        assert_eq!(phase(name), common::Process::TERMINATED, "{name}");
    }
    assert_eq!(phase("driver_power"), common::Process::RUNNING);
    let observed = observed.borrow();
    let told: Vec<&str> = observed
        .reports
        .iter()
        .filter(|(_, report)| report.fault == Fault::PowerOff)
        .map(|(_, report)| report.message.as_str())
        .collect();
    let expected = [
        "the supply is cut in 30 s: the modules are ended, then the computer",
        "a simulated robot: its computer would be halted now by: /sbin/poweroff",
    ];
    assert_eq!(told, expected);
}

#[test]
fn beacons_are_seen_where_they_are_each_at_its_own_instant() {
    let (mut robot, observed) = ready(1);
    robot.pass(60.0);
    let (x, y, theta) = {
        let truth = observed.borrow().truth.last().expect("20 Hz").1.clone();
        (truth.x, truth.y, truth.theta)
    };
    let observed = observed.borrow();
    assert!((59..=61).contains(&observed.beacons.len()), "{}", observed.beacons.len());
    let mut far = 0;
    for message in &observed.beacons {
        for beacon in &message.beacons {
            let (bx, by) =
                [(0.1, 0.1), (10.0, 0.1), (19.9, 0.1), (19.9, 11.9), (8.0, 11.9), (0.1, 11.9)][beacon.id as usize - 1];
            let error = (by - y).atan2(bx - x - 0.25) - theta - beacon.bearing;
            let error = navitools::wrap(error).abs();
            // The scanner may be rotated by 3 degrees.
            far += u32::from(error > 5.5f64.to_radians());
            let age = message.timestamp - beacon.timestamp;
            assert!((0..1_100_000).contains(&age), "{age} us");
        }
    }
    let seen: usize = observed.beacons.iter().map(|message| message.beacons.len()).sum();
    assert!(seen > 120, "{seen}: two in sight at least");
    assert!(f64::from(far) < 0.06 * seen as f64, "{far} of {seen} are of something else");
    // Each sighting once: a second apart.
    let times: Vec<i64> =
        observed.beacons.iter().flat_map(|m| &m.beacons).filter(|b| b.id == 6).map(|b| b.timestamp).collect();
    assert!(times.windows(2).all(|pair| pair[1] - pair[0] > 900_000), "{times:?}");
}

#[test]
fn only_commanded_beacons_are_sighted() {
    let (mut robot, observed) = ready(1);
    // The estimator chooses them while it runs.
    let (module, state) = ("estimator".into(), common::DataState::TERMINATE);
    say(&mut robot, common::CmdState { timestamp: 0, module, state, manual: true, source: "test".into() });
    robot.pass(2.0);
    say(&mut robot, lowlevel::DataActiveBeacons { timestamp: 0, ids: vec![6, 1] });
    robot.pass(3.0);
    observed.borrow_mut().beacons.clear();
    robot.pass(10.0);
    let observed = observed.borrow();
    assert!(observed.beacons.iter().flat_map(|message| &message.beacons).all(|beacon| [1, 6].contains(&beacon.id)));
    assert!(observed.beacons.iter().any(|message| message.beacons.len() == 2));
}

#[test]
fn all_buses_publish_their_state_once_a_second() {
    let (mut robot, observed) = ready(1);
    robot.pass(10.0);
    let observed = observed.borrow();
    for (bus, boards) in [("rs485.a", 3), ("rs485.b", 1), ("rs485.power", 1)] {
        let told: Vec<_> = observed.buses.iter().filter(|told| told.bus == bus).collect();
        assert!((9..=11).contains(&told.len()), "{bus}: {}", told.len());
        let last = told[told.len() - 1];
        assert!(last.state == lowlevel::DataBus::ACTIVE && last.errors == 0 && last.load > 0.0, "{last:?}");
        assert!(last.frames > 0 && last.nodes.len() == boards, "{last:?}");
        for node in &last.nodes {
            let trip = (node.round_trip_min, node.round_trip_mean, node.round_trip_max);
            assert!(trip.0 > 0.001 && trip.0 <= trip.1 && trip.1 <= trip.2 && trip.2 < 0.02, "{node:?}");
            assert_eq!((node.state, node.retries, node.timeouts, node.crc_errors), (0, 0, 0, 0), "{node:?}");
        }
    }
}

/// Injects a fault into a board of bus A for a while; returns the reports about it, and checks that the robot drives
/// afterwards.
fn ailing(board: &str, name: &str, value: f64, seconds: f64) -> Vec<(Fault, String)> {
    let (mut robot, observed) = ready(1);
    fault(&mut robot, board, name, value, seconds);
    robot.pass(seconds + 3.0);
    robot.drive(0.4, 0.0, 1.5);
    robot.pass(1.4);
    assert!(robot.speed() > 0.3, "{name}: {}", robot.motion().reason);
    let observed = observed.borrow();
    let warned = observed.reports.iter().filter(|(_, report)| report.severity != base::Severity::Notice);
    warned.map(|(_, report)| (report.fault, report.message.clone())).collect()
}

#[test]
fn each_fault_of_a_board_is_reported_with_its_board() {
    for (name, value, seconds, fault, words) in [
        ("silent", 0.0, 8.0, Fault::BoardLost, "does not answer"),
        ("slow", 0.05, 8.0, Fault::BoardLost, "does not answer"),
        ("garbled", 0.5, 12.0, Fault::BoardLost, "sd1_front"),
        ("bad_crc", 0.0, 12.0, Fault::BoardLost, "a wrong CRC"),
        ("bad_length", 0.0, 12.0, Fault::BoardLost, "a wrong length"),
        ("babble", 0.0, 5.0, Fault::BusBabble, "sd1_front"),
    ] {
        let told = ailing("sd1_front", name, value, seconds);
        let of_it = told.iter().find(|(told, message)| *told == fault && message.contains(words));
        assert!(of_it.is_some(), "{name}: {told:?}");
        assert!(told.iter().all(|(_, message)| !message.contains("sd1_rear")), "{name}: {told:?}");
    }
    let told = ailing("so1", "clash", 0.0, 12.0);
    assert!(told.iter().any(|(fault, message)| *fault == Fault::AddressClash && message.contains("so1")), "{told:?}");
    assert_eq!(ailing("sd1_front", "reset", 0.0, 1.0), [], "100 ms are bridged");
}

#[test]
fn the_power_controller_s_own_faults_stop_the_robot_or_are_reported() {
    let (mut robot, observed) = ready(1);
    fault(&mut robot, "psc1", "bad_crc", 0.0, 20.0);
    robot.pass(20.0);
    assert!(observed.borrow().reported(Fault::PauseUnknown) && observed.borrow().reported(Fault::BoardLost));
    assert_eq!(robot.hold(), Some(Hold::PauseUnknown));
    robot.pass(3.0);
    robot.drive(0.4, 0.0, 1.5);
    robot.pass(1.4);
    assert!(robot.speed() > 0.3, "{}", robot.motion().reason);
}
