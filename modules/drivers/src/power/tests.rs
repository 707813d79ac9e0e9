//! The driver with an emulated controller on a simulated wire in virtual time.

use super::*;
use crate::rs485_bus::{Kind, Node};
use crate::testing::Rig;
use messages::common::{CmdState, DataProcesses, Process};
use rs485::boards::psc1::{ADDRESS, build_currents, build_status, parse_set};
use rs485::crc::Crc8;
use rs485::frame::Status;
use rs485::slave::Asked;
use settings::Section as _;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn config() -> Config {
    Config {
        bus: "rs485.power".into(),
        baud: 115_200,
        crc: Crc8::SAE_J1850,
        node: Node {
            name: "psc1".into(),
            address: ADDRESS,
            kind: Kind::Psc1,
            rate_hz: 1.0,
            timeout: ms(20),
            ..Node::usual()
        },
        capacity_ah: 40.0,
        cells: 8,
        reserve: 0.2,
        channels: Vec::new(),
        computers: Vec::new(),
        modules: vec!["eyes".into(), "legs".into()],
        halt: vec!["poweroff".into(), "-f".into()],
        reboot: Vec::new(),
        simulated: false,
    }
}

/// A controller that switches without delay.
struct Board {
    on: u8,
    stuck: u8,
    leaks: u8,
    told: Vec<(u8, u8)>,
    currents: Currents,
}

fn answer(board: &mut Board, _: Instant, asked: &Asked) -> (Status, Vec<u8>) {
    match asked.instruction {
        code if code == GET_PWR_STATUS.code => (Status::Ok, build_status(board.on).to_vec()),
        code if code == SET_PWR_STATUS.code => {
            let (mask, states) = parse_set(&asked.data).unwrap();
            board.told.push((mask, states));
            let target = board.on & !mask | states & mask;
            board.on = board.on & (!mask | board.stuck) | states & mask & !board.stuck;
            (Status::Ok, build_status(target).to_vec())
        }
        code if code == GET_CURRENTS.code => {
            let mut currents = board.currents;
            for (channel, milliamps) in currents.milliamps.iter_mut().enumerate() {
                *milliamps *= u16::from((board.on | board.leaks) >> channel & 1);
            }
            (Status::Ok, build_currents(&currents).to_vec())
        }
        _ => (Status::UnknownInstruction, Vec::new()),
    }
}

fn rig_of(config: Config) -> Rig<Board> {
    let currents = Currents { milliamps: [200, 1000, 1000, 100, 2000, 400, 800, 300], battery_mv: 26_300 };
    let board = Board { on: 0xFF, stuck: 0, leaks: 0, told: Vec::new(), currents };
    let mut rig = Rig::new(NAME, Box::new(Power::new(config).unwrap()), ADDRESS, board, answer);
    rig.run(ms(100));
    rig.news();
    rig
}

fn rig() -> Rig<Board> {
    rig_of(config())
}

/// Lets time pass while the board reports the PAUSE line as it should.
fn pass(rig: &mut Rig<Board>, mut millis: u64) {
    while millis > 0 {
        rig.says(0x80, &[0, 0]);
        let part = millis.min(500);
        rig.run(ms(part));
        millis -= part;
    }
}

fn stops(rig: &mut Rig<Board>) -> Vec<(Instant, EventStop)> {
    rig.take(|message| if let Message::LlEventStop(stop) = message { Some(stop) } else { None })
}

fn power(rig: &mut Rig<Board>) -> Vec<(Instant, DataPower)> {
    rig.take(|message| if let Message::LlDataPower(power) = message { Some(power) } else { None })
}

fn ended(rig: &mut Rig<Board>) -> Vec<(u64, String)> {
    let ordered = rig.take(|message| if let Message::CmCmdState(order) = message { Some(order) } else { None });
    assert!(ordered.iter().all(|(_, CmdState { state, manual, .. })| *state == State::Terminate as i8 && *manual));
    ordered.into_iter().map(|(at, order)| (at.as_nanos() / 1_000_000, order.module)).collect()
}

fn runs(rig: &Rig<Board>) -> Vec<Vec<String>> {
    let runs =
        rig.log.iter().filter_map(|(_, action)| if let Action::Run(line) = action { Some(line.clone()) } else { None });
    runs.collect()
}

fn order(rig: &mut Rig<Board>, device: i8, action: i8) {
    rig.message(CmdPower { timestamp: 0, device, action });
}

fn processes(rig: &mut Rig<Board>, running: &[&str]) {
    let process = |name: &&str| Process { module: (*name).into(), phase: Process::RUNNING, ..Process::default() };
    rig.message(DataProcesses { timestamp: 0, processes: running.iter().map(process).collect() });
}

#[test]
fn a_report_on_the_pause_line_is_an_event_at_once() {
    let mut rig = rig();
    rig.says(0x80, &[0, 0]);
    rig.run(ms(500));
    rig.says(0x80, &[1, 3]);
    rig.run(ms(500));
    rig.says(0x80, &[1, 0x11]);
    rig.run(ms(100));
    let stops = stops(&mut rig);
    let said: Vec<(bool, &str)> = stops.iter().map(|(_, stop)| (stop.engaged, stop.source.as_str())).collect();
    assert_eq!(said, [(false, ""), (true, "bumper3"), (true, "sd1_rear")]);
    // 7 words of 95.487 us after 600 ms.
    assert_eq!((stops[1].0.as_nanos(), stops[1].1.timestamp), (600_668_409, 600_668));
    assert_eq!(rig.news(), "PAUSE: engaged by bumper3");
}

#[test]
fn a_silent_board_is_reported_and_nothing_is_invented() {
    let mut rig = rig();
    rig.says(0x80, &[0, 0]);
    rig.run(ms(1100));
    assert_eq!((stops(&mut rig).len(), rig.news().as_str()), (1, ""));
    rig.run(ms(200));
    assert_eq!(rig.news(), "Error PauseUnknown psc1");
    rig.run(ms(5000));
    assert!(stops(&mut rig).is_empty());
    rig.says(0x80, &[0, 0]);
    rig.run(ms(10));
    assert_eq!((stops(&mut rig).len(), rig.news().as_str()), (1, "Notice PauseUnknown psc1"));
}

#[test]
fn the_pause_line_is_published_in_stop_too() {
    let mut rig = rig();
    rig.command(State::Stop);
    rig.run(ms(2000));
    rig.says(0x80, &[1, 0x20]);
    rig.run(ms(1000));
    let stops = stops(&mut rig);
    assert_eq!((stops.len(), stops[0].1.source.as_str()), (1, "button"));
    assert!(power(&mut rig).len() <= 1, "nothing is polled");
}

#[test]
fn an_implausible_report_on_the_line_is_dropped() {
    let mut rig = rig();
    rig.says(0x80, &[2, 1]);
    rig.run(ms(10));
    assert_eq!((stops(&mut rig).len(), rig.news().as_str()), (0, "Warning BoardImplausible psc1"));
}

#[test]
fn power_is_published_once_a_second_with_names_and_charge() {
    let mut rig = rig();
    rig.board.on = 0b1110_1111;
    (rig.board.leaks, rig.board.currents.milliamps[4]) = (0x10, 20);
    rig.run(ms(5000));
    let power = power(&mut rig);
    assert_eq!(power.len(), 6);
    let (_, last) = power.last().unwrap();
    let channels: Vec<(&str, bool)> = last.channels.iter().map(|channel| (channel.name.as_str(), channel.on)).collect();
    assert_eq!((channels[0], channels[4], channels[7]), (("host", true), ("monitor", false), ("switch", true)));
    assert_eq!((last.voltage, last.channels[4].current), (26.3, 0.02));
    // 5.8 A at first: 26.3 V + 5.8 A x 17.6 mohm are 3.3003 V per cell.
    assert!((last.charge - 0.70).abs() < 0.01, "{}", last.charge);
    assert!(last.remaining > 4.5 * 3600.0 && last.remaining < 8.0 * 3600.0, "{}", last.remaining);
}

#[test]
fn a_low_battery_and_its_recovery_are_reported_once() {
    let mut rig = rig_of(Config { reserve: 0.69, ..config() });
    pass(&mut rig, 200_000);
    assert_eq!(rig.news(), "", "70 % by its voltage, 5.8 A");
    pass(&mut rig, 200_000);
    assert_eq!(rig.news(), "Warning BatteryLow psc1");
    rig.board.currents = Currents { milliamps: [0; 8], battery_mv: 27_200 };
    pass(&mut rig, 120_000);
    assert_eq!(rig.news(), "Notice BatteryLow psc1");
}

#[test]
fn channels_are_switched_and_restarted() {
    let mut rig = rig();
    order(&mut rig, 4, CmdPower::OFF);
    order(&mut rig, 5, CmdPower::OFF);
    pass(&mut rig, 1500);
    // The first order was sent at once.
    assert_eq!(rig.board.told, [(0x10, 0), (0x20, 0)]);
    assert_eq!(rig.news(), "power channel monitor is off\npower channel audio is off");
    order(&mut rig, 4, CmdPower::ON);
    pass(&mut rig, 1500);
    assert_eq!(rig.news(), "power channel monitor is on");
    order(&mut rig, 1, CmdPower::REBOOT);
    pass(&mut rig, 1500);
    assert_eq!((rig.board.on & 2, rig.news().as_str()), (0, "power channel computer1 is off"));
    pass(&mut rig, 4000);
    assert_eq!((rig.board.on & 2, rig.news().as_str()), (2, "power channel computer1 is on"));
}

#[test]
fn a_channel_that_does_not_obey_is_reported() {
    let mut rig = rig();
    rig.board.stuck = 0x10;
    order(&mut rig, 4, CmdPower::OFF);
    pass(&mut rig, 10_000);
    assert_eq!(rig.news(), "");
    pass(&mut rig, 3000);
    assert_eq!(rig.news(), "Error ChannelStuck monitor");
    rig.board.stuck = 0;
    order(&mut rig, 4, CmdPower::OFF);
    pass(&mut rig, 1500);
    assert_eq!(rig.news(), "power channel monitor is off\nNotice ChannelStuck monitor");
    rig.board.leaks = 0x10;
    pass(&mut rig, 1500);
    assert_eq!(rig.news(), "Error ChannelStuck monitor", "off, and draws 2 A");
}

#[test]
fn commands_that_cannot_be_obeyed_are_refused() {
    let mut rig = rig();
    for (device, action) in [(8, CmdPower::ON), (-1, CmdPower::ON), (4, 3), (0, CmdPower::REBOOT)] {
        order(&mut rig, device, action);
        pass(&mut rig, 10);
        assert_eq!(rig.news(), "Warning CommandForbidden power", "{device} {action}");
    }
    rig.command(State::Pause);
    rig.news();
    order(&mut rig, 4, CmdPower::OFF);
    pass(&mut rig, 2000);
    assert_eq!((rig.news().as_str(), rig.board.told.len()), ("Warning CommandForbidden power", 0));
}

#[test]
fn in_pause_the_motors_can_be_switched_off_and_not_on() {
    let mut rig = rig();
    rig.command(State::Pause);
    rig.news();
    order(&mut rig, 3, CmdPower::OFF);
    pass(&mut rig, 2000);
    assert_eq!((rig.news().as_str(), rig.board.on & 0x08), ("power channel motors is off", 0));
    order(&mut rig, 3, CmdPower::ON);
    pass(&mut rig, 2000);
    assert_eq!((rig.news().as_str(), rig.board.on & 0x08), ("Warning CommandForbidden power", 0));
}

#[test]
fn before_the_supply_is_cut_the_modules_are_ended_last_first_and_the_computer_is_halted() {
    let mut rig = rig();
    processes(&mut rig, &["eyes", "legs"]);
    rig.says(0x81, &[30]);
    pass(&mut rig, 300);
    processes(&mut rig, &["eyes", "legs"]);
    pass(&mut rig, 900);
    assert_eq!(ended(&mut rig), [(100, "legs".into()), (600, "legs".into()), (1100, "legs".into())]);
    processes(&mut rig, &["eyes"]);
    pass(&mut rig, 100);
    assert_eq!(ended(&mut rig), [(1300, "eyes".into())]);
    assert!(runs(&rig).is_empty());
    rig.says(0x81, &[28]);
    processes(&mut rig, &[]);
    pass(&mut rig, 10);
    assert_eq!(runs(&rig), [["poweroff", "-f"]]);
    assert!(rig.board.told.is_empty(), "the board cuts by itself");
    assert_eq!(rig.news(), "Warning PowerOff psc1\nNotice PowerOff psc1");
}

#[test]
fn modules_that_do_not_end_delay_the_halt_for_a_limited_time() {
    let mut rig = rig();
    rig.says(0x81, &[12]);
    for _ in 0..30 {
        processes(&mut rig, &["eyes", "legs"]);
        rig.run(ms(100));
    }
    let modules: Vec<String> = ended(&mut rig).into_iter().map(|(_, module)| module).collect();
    assert!(modules.iter().all(|module| module == "legs") && modules.len() >= 4, "{modules:?}");
    assert_eq!(runs(&rig).len(), 1, "10 s before the supply is cut");
}

#[test]
fn without_a_watchdog_each_module_has_half_a_second() {
    let mut rig = rig();
    rig.says(0x81, &[60]);
    rig.run(ms(1500));
    let modules: Vec<String> = ended(&mut rig).into_iter().map(|(_, module)| module).collect();
    assert_eq!(modules, ["legs", "eyes"]);
    assert_eq!(runs(&rig).len(), 1);
}

#[test]
fn switching_the_host_off_ends_everything_and_releases_the_supply() {
    let mut rig = rig();
    order(&mut rig, 0, CmdPower::OFF);
    processes(&mut rig, &[]);
    rig.run(ms(100));
    assert_eq!(rig.board.told, [(0xFF, 0)]);
    assert_eq!(runs(&rig), [["poweroff", "-f"]]);
    order(&mut rig, 4, CmdPower::ON);
    rig.run(ms(100));
    assert_eq!(runs(&rig).len(), 1);
}

#[test]
fn a_restart_runs_its_own_command_and_leaves_the_supply() {
    let mut rig = rig_of(Config { reboot: vec!["reboot".into()], ..config() });
    order(&mut rig, 0, CmdPower::REBOOT);
    processes(&mut rig, &[]);
    rig.run(ms(100));
    assert_eq!((runs(&rig), rig.board.told.len()), (vec![vec!["reboot".to_owned()]], 0));
}

#[test]
fn a_simulated_robot_halts_no_computer() {
    let mut rig = rig_of(Config { simulated: true, ..config() });
    rig.says(0x81, &[30]);
    rig.run(ms(10));
    processes(&mut rig, &[]);
    rig.run(ms(10));
    assert!(runs(&rig).is_empty());
    assert_eq!(rig.news(), "Warning PowerOff psc1\nNotice PowerOff psc1");
    rig.run(ms(61_000));
    assert_eq!(rig.news(), "Error PauseUnknown psc1\nNotice PowerOff psc1", "the computer still runs");
}

#[test]
fn an_invalid_configuration_is_rejected() {
    let refused = |change: fn(&mut Config)| {
        let mut config = config();
        change(&mut config);
        Power::new(config).unwrap_err()
    };
    assert_eq!(refused(|config| config.node.rate_hz = f64::NAN), ConfigError::Rate);
    assert_eq!(refused(|config| config.capacity_ah = 0.0), ConfigError::Battery);
    assert_eq!(refused(|config| config.cells = 0), ConfigError::Battery);
    assert_eq!(refused(|config| config.reserve = 1.1), ConfigError::Battery);
}

#[test]
fn a_channel_that_switches_itself_off_has_tripped_until_it_is_switched_on_again() {
    let audio = ChannelConfig { name: "audio".into(), current_max_a: 1.0, warning_share: 0.8 };
    let mut rig = rig_of(Config { channels: vec![audio], ..config() });
    pass(&mut rig, 3000);
    rig.news();
    rig.board.on &= !(1 << 5);
    pass(&mut rig, 2000);
    let told = "power channel audio switched itself off; it last drew 0.4 A of at most 1.0 A";
    let is_told = |action: &Action| matches!(action, Action::Report(report) if report.message.starts_with(told));
    assert!(rig.log.iter().any(|(_, action)| is_told(action)));
    assert_eq!(rig.news(), "Error ChannelTripped audio");
    order(&mut rig, 5, CmdPower::ON);
    pass(&mut rig, 3000);
    assert_eq!(rig.news(), "Notice ChannelTripped audio\npower channel audio is on");
}

#[test]
fn a_tripped_channel_that_is_ordered_off_is_off_on_purpose() {
    let mut rig = rig();
    pass(&mut rig, 1500);
    rig.board.on &= !(1 << 4);
    pass(&mut rig, 2000);
    assert_eq!(rig.news(), "Error ChannelTripped monitor");
    order(&mut rig, 4, CmdPower::OFF);
    pass(&mut rig, 3000);
    assert_eq!(rig.news(), "Notice ChannelTripped monitor\npower channel monitor is off");
}

#[test]
fn channels_that_are_switched_off_restarted_or_were_off_at_the_start_have_not_tripped() {
    let mut rig = rig();
    rig.board.on = 0b1101_1111;
    pass(&mut rig, 3000);
    rig.news();
    order(&mut rig, 4, CmdPower::OFF);
    order(&mut rig, 2, CmdPower::REBOOT);
    pass(&mut rig, 10_000);
    let news = rig.news();
    assert!(!news.contains("ChannelTripped") && news.contains("power channel computer2 is on"), "{news}");

    // Off before the driver has seen it on.
    let board = Board { on: 0b1101_1111, stuck: 0, leaks: 0, told: Vec::new(), currents: rig.board.currents };
    let mut rig = Rig::new(NAME, Box::new(Power::new(config()).unwrap()), ADDRESS, board, answer);
    pass(&mut rig, 3000);
    assert!(!rig.news().contains("ChannelTripped"));
    // The controller ends the supply, and has said so.
    rig.says(0x81, &[5]);
    rig.run(ms(1000));
    rig.board.on = 0;
    pass(&mut rig, 3000);
    assert!(!rig.news().contains("ChannelTripped"));
}

#[test]
fn a_channel_near_its_greatest_current_is_reported_before_it_trips() {
    let audio = ChannelConfig { name: "audio".into(), current_max_a: 1.0, warning_share: 0.8 };
    let mut rig = rig_of(Config { channels: vec![audio], ..config() });
    pass(&mut rig, 2000);
    rig.news();
    rig.board.currents.milliamps[5] = 850;
    pass(&mut rig, 3000);
    assert_eq!(rig.news(), "Warning ChannelCurrent audio");
    // Neither above the warning nor below its end.
    rig.board.currents.milliamps[5] = 780;
    pass(&mut rig, 3000);
    assert_eq!(rig.news(), "");
    rig.board.currents.milliamps[5] = 500;
    pass(&mut rig, 3000);
    assert_eq!(rig.news(), "Notice ChannelCurrent audio");
}

fn computer() -> ComputerConfig {
    ComputerConfig {
        channel: "computer1".into(),
        button: "button".into(),
        alive: Some("led".into()),
        press: ms(300),
        shutdown: ms(20_000),
        press_on: false,
    }
}

/// A robot with this computer, which runs.
fn rig_with(computer: ComputerConfig) -> Rig<Board> {
    let mut rig = rig_of(Config { computers: vec![computer], ..config() });
    pass(&mut rig, 1500);
    led(&mut rig, true);
    rig.news();
    rig
}

/// `driver_io` publishes the power LED.
fn led(rig: &mut Rig<Board>, on: bool) {
    let value = f64::from(u8::from(on));
    let signal = lowlevel::Signal { name: "led".into(), value, output: false, valid: true };
    rig.message(lowlevel::DataIo { timestamp: 0, signals: vec![signal] });
}

/// Commands for the button.
fn presses(rig: &mut Rig<Board>) -> Vec<f64> {
    let all = rig.take(|message| if let Message::LlCmdOutput(output) = message { Some(output) } else { None });
    assert!(all.iter().all(|(_, output)| output.name == "button" && output.source == NAME));
    all.into_iter().map(|(_, output)| output.value).collect()
}

#[test]
fn a_computer_is_asked_to_shut_down_before_its_channel_is_switched_off() {
    let mut rig = rig_with(computer());
    order(&mut rig, 1, CmdPower::OFF);
    pass(&mut rig, 1000);
    assert_eq!(presses(&mut rig), [1.0, 1.0, 1.0, 0.0], "each 100 ms, and released");
    for on in [true, false, true, false] {
        led(&mut rig, on);
        pass(&mut rig, 1000);
        assert!(rig.board.told.is_empty(), "the LED blinks");
    }
    pass(&mut rig, 2000);
    assert_eq!(rig.board.told, [(0x02, 0)]);
    let expected = "computer1 is asked to shut down by its button button\ncomputer1 has shut down\n\
                    power channel computer1 is off";
    assert_eq!(rig.news(), expected);
    // Off already: it is cut at once.
    order(&mut rig, 1, CmdPower::ON);
    for _ in 0..3 {
        led(&mut rig, false);
        pass(&mut rig, 1000);
    }
    order(&mut rig, 1, CmdPower::OFF);
    pass(&mut rig, 10);
    assert_eq!((rig.board.told.len(), presses(&mut rig).len()), (3, 0));
}

#[test]
fn a_computer_that_does_not_shut_down_is_reported_and_cut() {
    let mut rig = rig_with(computer());
    order(&mut rig, 1, CmdPower::OFF);
    for _ in 0..19 {
        pass(&mut rig, 1000);
        led(&mut rig, true);
    }
    rig.news();
    assert!(rig.board.told.is_empty());
    pass(&mut rig, 2500);
    assert_eq!(rig.news(), "Warning ComputerStuck computer1\npower channel computer1 is off");
    order(&mut rig, 1, CmdPower::ON);
    pass(&mut rig, 1500);
    assert_eq!(rig.news(), "power channel computer1 is on\nNotice ComputerStuck computer1");
    // Nothing is known of it: it gets its time, and is not reported as stuck.
    let mut rig = rig_with(ComputerConfig { alive: None, ..computer() });
    order(&mut rig, 1, CmdPower::OFF);
    pass(&mut rig, 19_500);
    assert!(rig.board.told.is_empty());
    pass(&mut rig, 2000);
    assert!(!rig.news().contains("ComputerStuck") && rig.board.told == [(0x02, 0)]);
}

#[test]
fn a_computer_that_is_to_run_again_is_cut_first_and_started_by_its_button_if_it_must() {
    for (press_on, action) in [(false, CmdPower::REBOOT), (true, CmdPower::REBOOT), (true, CmdPower::OFF)] {
        let mut rig = rig_with(ComputerConfig { press_on, ..computer() });
        order(&mut rig, 1, action);
        pass(&mut rig, 500);
        if action == CmdPower::OFF {
            // Ordered on before it is down.
            order(&mut rig, 1, CmdPower::ON);
        }
        presses(&mut rig);
        led(&mut rig, false);
        pass(&mut rig, 3000);
        assert_eq!(rig.board.told, [(0x02, 0)], "{action}");
        led(&mut rig, false);
        pass(&mut rig, 3000);
        assert_eq!(rig.board.told, [(0x02, 0), (0x02, 0x02)], "{action}");
        pass(&mut rig, 4000);
        let expected: &[f64] = if press_on { &[1.0, 1.0, 1.0, 0.0] } else { &[] };
        assert_eq!(presses(&mut rig), expected, "{action}");
        // On, and ordered on: its button is left alone.
        order(&mut rig, 1, CmdPower::ON);
        pass(&mut rig, 6000);
        assert!(presses(&mut rig).is_empty(), "{action}");
    }
}

#[test]
fn the_outputs_are_kept_until_all_computers_are_down() {
    let modules = vec!["driver_io".into(), "eyes".into(), "legs".into()];
    let mut rig = rig_of(Config { computers: vec![computer()], modules, ..config() });
    pass(&mut rig, 1500);
    led(&mut rig, true);
    order(&mut rig, 0, CmdPower::OFF);
    for _ in 0..10 {
        pass(&mut rig, 500);
        led(&mut rig, true);
    }
    let modules = |rig: &mut Rig<Board>| ended(rig).into_iter().map(|(_, module)| module).collect::<Vec<_>>();
    assert_eq!(modules(&mut rig), ["legs", "eyes"], "the robot stands meanwhile");
    assert_eq!((presses(&mut rig), rig.board.told.len()), (vec![1.0, 1.0, 1.0, 0.0], 0));
    led(&mut rig, false);
    pass(&mut rig, 1700);
    assert_eq!(modules(&mut rig), ["driver_io"]);
    pass(&mut rig, 1000);
    assert_eq!((runs(&rig).len(), rig.board.told.last()), (1, Some(&(0xFF, 0))));
    // The supply ends in 12 s, whether it is down or not: the robot's computer is halted in time.
    let modules = vec!["driver_io".into()];
    let mut rig = rig_of(Config { computers: vec![computer()], modules, ..config() });
    rig.says(0x81, &[12]);
    pass(&mut rig, 1500);
    assert!(runs(&rig).is_empty());
    pass(&mut rig, 1000);
    assert_eq!((runs(&rig).len(), presses(&mut rig).len()), (1, 4));
}

#[test]
fn without_the_module_of_outputs_the_supply_is_kept_for_the_time_that_the_computers_have() {
    let modules = vec!["driver_io".into(), "eyes".into()];
    let mut rig = rig_of(Config { computers: vec![computer()], modules, ..config() });
    pass(&mut rig, 1500);
    led(&mut rig, true);
    order(&mut rig, 0, CmdPower::OFF);
    pass(&mut rig, 500);
    assert!(presses(&mut rig).contains(&1.0));
    // It died after the press.
    processes(&mut rig, &[]);
    pass(&mut rig, 18_000);
    assert!(rig.board.told.is_empty() && runs(&rig).is_empty(), "the computer shuts down");
    pass(&mut rig, 4000);
    assert_eq!((runs(&rig).len(), rig.board.told.last()), (1, Some(&(0xFF, 0))));
}

#[test]
fn a_supply_that_ends_soon_cuts_an_ordered_shutdown_short_and_replaces_a_restart() {
    let modules = vec!["driver_io".into()];
    let mut rig = rig_of(Config { computers: vec![computer()], modules, ..config() });
    pass(&mut rig, 1500);
    led(&mut rig, true);
    order(&mut rig, 0, CmdPower::OFF);
    pass(&mut rig, 1000);
    rig.says(0x81, &[12]);
    pass(&mut rig, 1500);
    assert!(runs(&rig).is_empty());
    // 10 s before the end, and not after the 20 s of the computer.
    pass(&mut rig, 2000);
    assert_eq!(runs(&rig), [["poweroff", "-f"]]);
    let mut rig = rig_of(Config { reboot: vec!["reboot".into()], ..config() });
    pass(&mut rig, 1500);
    order(&mut rig, 0, CmdPower::REBOOT);
    rig.says(0x81, &[30]);
    pass(&mut rig, 5000);
    assert_eq!(runs(&rig), [["poweroff", "-f"]]);
}
