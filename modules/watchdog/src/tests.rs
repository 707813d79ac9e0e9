//! The watchdog with simulated processes.

use crate::{Config, ModuleConfig, NAME, Watchdog};
use base::{Duration, Epoch, Instant, Severity};
use messages::{Message, common};
use module::bench::Bench;
use module::{Action, Actions, Event, ExitStatus, ProcessCommand, ProcessEvent, Shell, ShellConfig, State};
use std::fmt::Write;

/// Two modules: `eyes` depends on `nerves`.
fn bench() -> Bench {
    let module = |name: &str, depends: &[&str]| ModuleConfig {
        name: name.into(),
        depends: depends.iter().map(ToString::to_string).collect(),
        beat_timeout: Duration::from_millis(200),
        restart: true,
        critical: name == "nerves",
    };
    let modules = vec![module("nerves", &[]), module("eyes", &["nerves"])];
    let config = ShellConfig { obeys_all: false, end_within: Duration::from_secs(6), ..ShellConfig::new(NAME) };
    Bench::new(Shell::new(config, Box::new(Watchdog::new(Config { modules, ..Config::default() }))))
}

#[test]
fn its_periods_begin_with_those_of_the_machines_clock() {
    use module::Module;
    let mut watchdog = Watchdog::new(Config::default());
    watchdog.handle(Instant::from_millis(5007), Event::Start, &mut Actions::default());
    assert_eq!(watchdog.poll_timeout(), Some(Instant::from_millis(5100)));
}

/// Runs a transcript: `>` is an input, `<` an action or report of the watchdog; the number is milliseconds.
#[track_caller]
fn check(transcript: &str) {
    let mut bench = bench();
    let mut seen = String::new();
    let lines: Vec<&str> = transcript.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    for line in lines.iter().filter(|line| line.contains("ms >")) {
        let (at, input) = line.split_once("ms > ").unwrap();
        let at = Instant::from_millis(at.parse().unwrap());
        while bench.step(at) {
            log(&mut bench, &mut seen);
        }
        bench.pass(at.since(bench.now()));
        log(&mut bench, &mut seen);
        writeln!(seen, "{line}").unwrap();
        feed(&mut bench, &input.split(' ').collect::<Vec<_>>());
        log(&mut bench, &mut seen);
    }
    let expected: String = lines.iter().map(|line| format!("{line}\n")).collect();
    assert_eq!(seen, expected);
}

fn feed(bench: &mut Bench, words: &[&str]) {
    match *words {
        ["start"] => bench.event(Event::Start),
        ["pid", module, pid] => {
            let pid = pid.parse().unwrap();
            bench.event(Event::Process(ProcessEvent::Started { module, pid }));
        }
        ["earlier", module, wanted, ref pid @ ..] => {
            let (wanted, held) = (State::from_name(wanted).unwrap(), pid.contains(&"held"));
            let pid = pid.first().and_then(|pid| pid.parse().ok());
            bench.event(Event::Process(ProcessEvent::Earlier { module, wanted, held, pid }));
        }
        ["unstartable", module] => {
            bench.event(Event::Process(ProcessEvent::Unstartable { module, reason: "no such file" }));
        }
        ["says", module, state] => {
            let state = State::from_name(state).unwrap() as i8;
            bench.message(common::DataState { timestamp: 0, module: module.into(), state });
        }
        ["exit", pid, code] => {
            let status = ExitStatus::Code(code.parse().unwrap());
            bench.event(Event::Process(ProcessEvent::Exited { pid: pid.parse().unwrap(), status }));
        }
        ["killed", pid] => {
            let status = ExitStatus::Signal(9);
            bench.event(Event::Process(ProcessEvent::Exited { pid: pid.parse().unwrap(), status }));
        }
        ["silent", pid, thread, ms] => {
            let last = bench.now() - Duration::from_millis(ms.parse().unwrap());
            bench.event(Event::Process(ProcessEvent::HeartbeatLate { pid: pid.parse().unwrap(), thread, last }));
        }
        ["late", ms] => {
            let by = Duration::from_millis(ms.parse().unwrap());
            bench.event(Event::Process(ProcessEvent::CheckLate { by }));
        }
        ["bad-beats", pid] => {
            bench.event(Event::Process(ProcessEvent::BadHeartbeat { pid: pid.parse().unwrap(), why: "is torn" }));
        }
        ["command", module, state, ref manual @ ..] => {
            let (module, source) = (module.into(), "test".into());
            let (state, manual) = (State::from_name(state).unwrap() as i8, manual == ["manual"]);
            bench.message(common::CmdState { timestamp: 0, module, state, manual, source });
        }
        ["sigterm"] => bench.event(Event::State(State::Terminate)),
        ["end"] => {}
        _ => panic!("{words:?}"),
    }
}

fn log(bench: &mut Bench, seen: &mut String) {
    for (at, action) in bench.done() {
        let line = match action {
            Action::Process(ProcessCommand::Spawn { module, wanted }) => {
                format!("spawn {module} {wanted}")
            }
            Action::Process(ProcessCommand::Terminate { pid }) => format!("sigterm {pid}"),
            Action::Process(ProcessCommand::Kill { pid }) => format!("sigkill {pid}"),
            Action::Report(report) if report.severity == Severity::Notice => {
                format!("notice {}", report.subject)
            }
            Action::Report(report) => format!("report {:?} {}", report.fault, report.subject),
            Action::Publish(Message::CmCmdState(command)) => {
                let state = State::from_value(command.state).unwrap();
                format!("command {} {state}{}", command.module, if command.manual { " manual" } else { "" })
            }
            Action::Exit(code) => format!("exit {code}"),
            _ => continue,
        };
        writeln!(seen, "{}ms < {line}", at.as_nanos() / 1_000_000).unwrap();
    }
}

#[test]
fn a_thread_without_heartbeat_is_a_hang_despite_announcements() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         50ms > says nerves RUN
         50ms < spawn eyes RUN
         51ms > pid eyes 8
         90ms > says eyes RUN
         300ms > silent 7 worker 199
         320ms > silent 9 nobody 900
         340ms > says nerves RUN
         340ms > silent 7 worker 200
         340ms < report ModuleHung nerves
         340ms < sigterm 7
         360ms > silent 7 worker 220
         540ms < sigkill 7
         540ms > end
         541ms > killed 7
         541ms < spawn nerves RUN
         542ms > pid nerves 10
         590ms > says nerves RUN
         590ms < notice nerves",
    );
}

#[test]
fn an_invalid_heartbeat_page_is_reported_without_harm() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         50ms > says nerves RUN
         50ms < spawn eyes RUN
         60ms > bad-beats 7
         60ms < report BeatsBad nerves
         70ms > bad-beats 99",
    );
}

#[test]
fn modules_start_in_the_order_of_their_dependencies() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         30ms > says nerves INIT
         50ms > says nerves RUN
         50ms < spawn eyes RUN
         51ms > pid eyes 8",
    );
}

#[test]
fn a_dependency_in_init_delays_others_for_two_seconds_only() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         1001ms > says nerves INIT
         2001ms > says nerves INIT
         2100ms < spawn eyes RUN
         2201ms > end",
    );
}

#[test]
fn a_dead_module_is_restarted_at_once_then_with_back_off() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         50ms > killed 7
         50ms < report ModuleDied nerves
         50ms < spawn nerves RUN
         51ms > pid nerves 8
         52ms > says nerves RUN
         52ms < notice nerves
         52ms < spawn eyes RUN
         53ms > pid eyes 9
         60ms > exit 8 64
         60ms < report ModuleDied nerves
         160ms < spawn nerves RUN
         161ms > pid nerves 10
         162ms > exit 10 64
         362ms < spawn nerves RUN
         363ms > pid nerves 11
         400ms > end",
    );
}

#[test]
fn a_hung_module_gets_sigterm_then_sigkill_then_a_restart() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         11ms > pid eyes 8
         1900ms > says eyes RUN
         2200ms < report ModuleHung nerves
         2200ms < sigterm 7
         2400ms < sigkill 7
         2401ms > killed 7
         2401ms < spawn nerves RUN
         2402ms > pid nerves 9
         2500ms > says nerves RUN
         2500ms < notice nerves",
    );
}

#[test]
fn the_wanted_state_survives_a_crash_and_only_a_permitted_command_changes_it() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         11ms > command nerves STOP
         12ms > command nerves STOP manual
         13ms > says nerves STOP
         14ms > command nerves RUN
         20ms > killed 7
         20ms < report ModuleDied nerves
         20ms < spawn nerves STOP
         21ms > pid nerves 8
         22ms > command nerves PAUSE
         30ms > killed 8
         130ms < spawn nerves STOP
         131ms > command nerves RUN manual
         132ms > end",
    );
}

#[test]
fn terminate_keeps_a_module_down_until_run_is_commanded() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         11ms > pid eyes 8
         12ms > says eyes RUN
         20ms > command * TERMINATE
         25ms > exit 7 0
         26ms > exit 8 0
         900ms > command eyes PAUSE manual
         900ms < report CommandForbidden eyes
         1000ms > command * RUN
         1000ms < spawn nerves RUN
         1001ms > pid nerves 9
         1002ms > says nerves RUN
         1002ms < spawn eyes RUN",
    );
}

/// `driver_canbus` takes no restarts for the robot's start, which may release homing.
#[test]
fn a_start_by_command_counts_as_a_restart() {
    let mut bench = bench();
    for input in ["start", "pid nerves 7", "command nerves TERMINATE", "exit 7 0", "command nerves RUN", "pid nerves 8"]
    {
        feed(&mut bench, &input.split(' ').collect::<Vec<_>>());
    }
    bench.pass(Duration::from_millis(200));
    let lists = bench.done().into_iter().filter_map(|(_, action)| match action {
        Action::Publish(Message::CmDataProcesses(list)) => Some(list.processes[0].restarts),
        _ => None,
    });
    assert_eq!(lists.last(), Some(1));
}

#[test]
fn a_module_that_does_not_obey_terminate_is_killed() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         20ms > command nerves TERMINATE
         1520ms < sigkill 7
         1521ms > killed 7
         1600ms > end",
    );
}

#[test]
fn a_module_that_cannot_be_started_is_tried_again() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > unstartable nerves
         1ms < report ModuleUnstartable nerves
         1ms < spawn nerves RUN
         2ms > unstartable nerves
         102ms < spawn nerves RUN
         103ms > end",
    );
}

#[test]
fn the_end_takes_dependents_first_and_waits_for_all() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         11ms > pid eyes 8
         20ms > sigterm
         20ms < sigterm 8
         30ms > exit 8 0
         30ms < sigterm 7
         1530ms < sigkill 7
         1531ms > killed 7",
    );
}

#[test]
fn processes_are_shown_ten_times_a_second_and_at_every_change() {
    let mut bench = bench();
    bench.event(Event::Start);
    bench.published();
    bench.pass(Duration::from_secs(1));
    let shown = |message: &Message| matches!(message, Message::CmDataProcesses(_));
    assert_eq!(bench.published().iter().filter(|message| shown(message)).count(), 10);
    bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid: 7 }));
    let published = bench.published();
    let Message::CmDataProcesses(processes) = &published[0] else { panic!("{published:?}") };
    let nerves = &processes.processes[0];
    assert_eq!((nerves.module.as_str(), nerves.pid, nerves.phase), ("nerves", 7, common::Process::RUNNING));
}

#[test]
fn a_command_to_a_process_that_is_being_started_is_not_lost() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > command nerves STOP manual
         2ms > pid nerves 7
         10ms > says nerves RUN
         10ms < command nerves STOP manual
         10ms < spawn eyes RUN
         11ms > says nerves STOP
         20ms > command eyes TERMINATE
         21ms > pid eyes 8
         21ms < sigterm 8
         30ms > exit 8 0
         40ms > end",
    );
}

#[test]
fn a_second_process_of_a_module_is_killed() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         5000ms < report ModuleUnstartable nerves
         5000ms < spawn nerves RUN
         5001ms > pid nerves 8
         5002ms > pid nerves 7
         5002ms < sigkill 7
         5003ms > exit 7 137
         5004ms > end",
    );
}

#[test]
fn only_an_operator_leads_out_of_stop_by_terminate() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         11ms > command nerves STOP manual
         12ms > says nerves STOP
         20ms > command nerves TERMINATE
         25ms > exit 7 0
         30ms > command nerves RUN
         30ms < spawn nerves STOP
         31ms > pid nerves 8
         32ms > says nerves STOP
         40ms > command nerves TERMINATE
         45ms > exit 8 0
         50ms > command nerves RUN manual
         50ms < spawn nerves RUN",
    );
}

#[test]
fn a_delayed_watchdog_ends_no_module_for_that() {
    let mut bench = bench();
    bench.event(Event::Start);
    bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid: 7 }));
    bench.message(common::DataState { timestamp: 0, module: "nerves".into(), state: State::Run as i8 });
    bench.pass(Duration::from_millis(500));
    let frozen = bench.now() + Duration::from_secs(3);
    let mut out = Actions::new(Epoch::default());
    bench.shell.handle(frozen, Event::Timer, &mut out);
    let ended = |action: &Action| matches!(action, Action::Process(ProcessCommand::Terminate { .. }));
    assert!(!out.drain().any(|action| ended(&action)));
    // Modules that stay silent from then on are ended as usual.
    for ms in (100..=2200).step_by(100) {
        bench.shell.handle(frozen + Duration::from_millis(ms), Event::Timer, &mut out);
    }
    assert_eq!(out.drain().filter(ended).count(), 1);
}

#[test]
fn modules_of_an_earlier_watchdog_are_adopted_with_their_wanted_states() {
    check(
        "0ms > earlier nerves STOP 7
         0ms > earlier eyes RUN 8
         0ms > start
         300ms > says nerves STOP
         400ms > says eyes RUN
         500ms > killed 7
         500ms < report ModuleDied nerves
         500ms < spawn nerves STOP
         501ms > pid nerves 9
         510ms > says nerves STOP
         510ms < notice nerves
         600ms > command nerves RUN
         700ms > killed 9
         700ms < report ModuleDied nerves
         800ms < spawn nerves STOP
         801ms > end",
    );
}

#[test]
fn a_restrictive_command_without_a_watchdog_is_kept() {
    check(
        "0ms > earlier nerves RUN 7
         0ms > earlier eyes STOP 8
         0ms > start
         300ms > says nerves STOP
         400ms > says eyes RUN
         400ms < command eyes STOP manual
         500ms > killed 7
         500ms < report ModuleDied nerves
         500ms < spawn nerves STOP
         501ms > end",
    );
}

#[test]
fn a_module_that_died_unseen_is_restarted_and_an_ended_one_is_not() {
    check(
        "0ms > earlier nerves RUN
         0ms > earlier eyes TERMINATE held
         0ms > start
         0ms < report ModuleDied nerves
         0ms < spawn nerves RUN
         1ms > pid nerves 9
         5ms > says nerves RUN
         5ms < notice nerves
         10ms > command eyes RUN
         10ms < spawn eyes STOP",
    );
}

#[test]
fn a_module_that_is_no_longer_configured_is_ended() {
    check(
        "0ms > earlier ears RUN 6
         0ms < sigterm 6
         0ms > earlier tail RUN
         0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         1500ms < sigkill 6
         1501ms > killed 6
         1502ms > end",
    );
}

#[test]
fn an_adopted_process_that_was_being_ended_is_ended() {
    check(
        "0ms > earlier nerves TERMINATE 7
         0ms < sigterm 7
         0ms > start
         20ms > exit 7 0
         1502ms > end",
    );
}

#[test]
fn a_missed_command_counts_if_it_is_more_restrictive() {
    let mut bench = bench();
    bench.event(Event::Start);
    feed(&mut bench, &["pid", "nerves", "7"]);
    // Commands of the watchdog when `nerves` announces itself a second later, and its wanted state then.
    let says = |bench: &mut Bench, state: &str| {
        bench.pass(Duration::from_secs(1));
        feed(bench, &["says", "nerves", state]);
        let commands = bench.published().into_iter().filter_map(|message| match message {
            Message::CmCmdState(command) => Some((command.module, command.state, command.manual)),
            _ => None,
        });
        commands.collect::<Vec<_>>()
    };
    let wanted = |bench: &mut Bench| {
        bench.pass(Duration::from_millis(100));
        bench.published().into_iter().rev().find_map(|message| match message {
            Message::CmDataProcesses(list) => State::from_value(list.processes[0].wanted),
            _ => None,
        })
    };
    assert_eq!(says(&mut bench, "RUN"), []);
    // The module has missed it.
    feed(&mut bench, &["command", "nerves", "PAUSE"]);
    assert_eq!([says(&mut bench, "RUN"), says(&mut bench, "RUN")], [[], []]);
    assert_eq!(says(&mut bench, "RUN"), [("nerves".into(), State::Pause as i8, true)]);
    assert_eq!(says(&mut bench, "PAUSE"), []);
    // The watchdog has missed it.
    for _ in 0..3 {
        assert_eq!(says(&mut bench, "STOP"), []);
    }
    assert_eq!(wanted(&mut bench), Some(State::Stop));
    // Another sender announces in its name.
    for _ in 0..10 {
        feed(&mut bench, &["says", "nerves", "RUN"]);
        assert_eq!(says(&mut bench, "STOP"), []);
    }
}

#[test]
fn a_restart_storm_is_reported_once_and_cleared_at_its_end() {
    let mut bench = bench();
    bench.event(Event::Start);
    let mut told = Vec::new();
    let mut hear = |bench: &mut Bench| {
        let mut spawned = false;
        for (_, action) in bench.done() {
            match action {
                Action::Process(ProcessCommand::Spawn { module, .. }) => spawned |= module == "nerves",
                Action::Report(report) if report.subject == "nerves" => told.push((report.fault, report.severity)),
                _ => {}
            }
        }
        spawned
    };
    for pid in 2..32 {
        while !hear(&mut bench) {
            bench.pass(Duration::from_millis(50));
        }
        bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid }));
        bench.message(common::DataState { timestamp: 0, module: "nerves".into(), state: State::Run as i8 });
        bench.event(Event::Process(ProcessEvent::Exited { pid, status: ExitStatus::Code(64) }));
    }
    while !hear(&mut bench) {
        bench.pass(Duration::from_millis(50));
    }
    bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid: 99 }));
    for _ in 0..12 {
        bench.message(common::DataState { timestamp: 0, module: "nerves".into(), state: State::Run as i8 });
        bench.pass(Duration::from_secs(1));
    }
    hear(&mut bench);
    use base::Fault::{ModuleDied, RestartStorm};
    let once = [(ModuleDied, Severity::Error), (ModuleDied, Severity::Notice)];
    let storm = [(ModuleDied, Severity::Error), (RestartStorm, Severity::Error)];
    let calm = [(ModuleDied, Severity::Notice), (RestartStorm, Severity::Notice)];
    assert_eq!(told, [&once[..], &once, &once, &once, &storm, &calm].concat());
}

#[test]
fn an_announcement_in_another_name_is_reported_and_ignored() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         11ms > pid eyes 8
         12ms > command eyes TERMINATE
         20ms > exit 8 0
         30ms > says eyes RUN
         1020ms > says eyes RUN
         1020ms < report NameClaimed eyes
         1200ms > says eyes RUN",
    );
}

#[test]
fn two_senders_of_one_name_are_reported() {
    let mut bench = bench();
    bench.event(Event::Start);
    bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid: 7 }));
    let mut told = Vec::new();
    for second in 0..60 {
        let senders = if (20..40).contains(&second) { 2 } else { 1 };
        for _ in 0..senders {
            bench.message(common::DataState { timestamp: 0, module: "nerves".into(), state: State::Run as i8 });
            bench.pass(Duration::from_secs(1) / senders);
        }
        let told = &mut told;
        bench.done().into_iter().for_each(|(_, action)| match action {
            Action::Report(report) if report.fault == base::Fault::NameClaimed => told.push((second, report.severity)),
            _ => {}
        });
    }
    assert!(
        matches!(told[..], [(20..=39, Severity::Warning), (40..=59, Severity::Notice)]),
        "one with two, and one when there is one again: {told:?}"
    );
}

#[test]
fn a_command_without_a_receiver_is_reported() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         2ms > command tail RUN
         2ms < report CommandForbidden tail
         3ms > says tail RUN
         4ms > command tail RUN
         5ms > command * PAUSE
         6ms > command watchdog PAUSE",
    );
}

#[test]
fn the_host_stores_wanted_states_and_gets_the_health() {
    let mut bench = bench();
    let told = |bench: &mut Bench| {
        let told = bench.done().into_iter().filter_map(|(_, action)| match action {
            Action::Process(ProcessCommand::Remember { module, wanted, held }) => {
                Some(format!("{module} {wanted}{}", if held { " held" } else { "" }))
            }
            Action::Process(ProcessCommand::Health { healthy, status }) => Some(format!("{healthy}: {status}")),
            _ => None,
        });
        told.collect::<Vec<_>>()
    };
    let command = |state: State| {
        let (module, source) = ("nerves".into(), "test".into());
        common::CmdState { timestamp: 0, module, state: state as i8, manual: true, source }
    };
    let says = |state: State| common::DataState { timestamp: 0, module: "nerves".into(), state: state as i8 };
    bench.event(Event::Start);
    assert_eq!(told(&mut bench), ["false: nerves does not run"]);
    bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid: 7 }));
    assert_eq!(told(&mut bench), ["true: 0 of 2 modules RUN"]);
    bench.message(says(State::Run));
    assert_eq!(told(&mut bench), ["true: 1 of 2 modules RUN"]);
    bench.event(Event::Process(ProcessEvent::HeartbeatLate { pid: 7, thread: "main", last: Instant::ZERO }));
    assert_eq!(told(&mut bench), [""; 0], "its heartbeat is recent");
    bench.message(says(State::Error));
    assert_eq!(told(&mut bench), ["true: nerves is in ERROR"], "a new start would not bring its device back");
    bench.message(says(State::Run));
    assert_eq!(told(&mut bench), ["true: 1 of 2 modules RUN"]);
    bench.message(command(State::Stop));
    bench.message(says(State::Stop));
    assert_eq!(told(&mut bench), ["nerves STOP", "true: 0 of 2 modules RUN"]);
    bench.message(command(State::Terminate));
    assert_eq!(told(&mut bench), ["nerves TERMINATE held"], "an operator wants it down: healthy");
    bench.event(Event::Process(ProcessEvent::Exited { pid: 7, status: ExitStatus::Code(0) }));
    bench.message(command(State::Run));
    assert_eq!(told(&mut bench), ["nerves RUN", "false: nerves does not run"]);
    bench.event(Event::State(State::Terminate));
    assert_eq!(told(&mut bench), ["true: ending"]);
}

/// Lists in a module's name since the last call: time, severity, begin.
fn lists(bench: &mut Bench, module: &str) -> Vec<(u64, i8, i64)> {
    let list = |(at, action): (Instant, Action)| match action {
        Action::Publish(Message::CmDataFaults(list)) if list.module == module => {
            let [fault] = &list.faults[..] else { panic!("{list:?}") };
            assert_eq!((fault.number, fault.subject.as_str()), (0x0307, module));
            Some((at.as_nanos() / 1_000_000, fault.severity, fault.since / 1000))
        }
        _ => None,
    };
    bench.done().into_iter().filter_map(list).collect()
}

#[test]
fn faults_of_modules_without_a_process_are_published_as_unknown() {
    let mut bench = bench();
    let run = |bench: &mut Bench, ms: u64| bench.pass(Instant::from_millis(ms).since(bench.now()));
    bench.event(Event::Start);
    for (module, pid) in [("nerves", "7"), ("eyes", "8")] {
        feed(&mut bench, &["pid", module, pid]);
        feed(&mut bench, &["says", module, "RUN"]);
    }
    run(&mut bench, 1500);
    assert_eq!(lists(&mut bench, "nerves"), [], "it lives and publishes its own faults");
    feed(&mut bench, &["exit", "7", "64"]);
    let error = Severity::Error as i8;
    assert_eq!(lists(&mut bench, "nerves"), [(1500, error, 1500)], "at once");
    // The next process takes long to appear.
    for ms in [2500, 3600] {
        feed(&mut bench, &["says", "eyes", "RUN"]);
        run(&mut bench, ms);
    }
    assert_eq!(lists(&mut bench, "nerves"), [(2000, error, 1500), (3000, error, 1500)]);
    feed(&mut bench, &["pid", "nerves", "9"]);
    feed(&mut bench, &["says", "nerves", "INIT"]);
    feed(&mut bench, &["says", "eyes", "RUN"]);
    run(&mut bench, 5000);
    assert_eq!(lists(&mut bench, "nerves"), []);
    // A module that an operator wants down is down, and its faults are unknown too.
    feed(&mut bench, &["command", "eyes", "TERMINATE"]);
    feed(&mut bench, &["exit", "8", "0"]);
    let notice = Severity::Notice as i8;
    assert_eq!(lists(&mut bench, "eyes"), [(5000, notice, 5000)]);
    feed(&mut bench, &["says", "nerves", "INIT"]);
    run(&mut bench, 6500);
    assert_eq!(lists(&mut bench, "eyes"), [(6000, notice, 5000)]);
}

/// Phases in the lists of processes published since the last call.
fn phases(bench: &mut Bench) -> Vec<i8> {
    let published = bench.published();
    let list = published.iter().filter_map(|message| match message {
        Message::CmDataProcesses(list) => Some(list.processes[0].phase),
        _ => None,
    });
    list.collect()
}

#[test]
fn a_watchdog_that_is_late_twice_a_second_judges_nobody_until_it_is_on_time() {
    let mut bench = bench();
    bench.event(Event::Start);
    bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid: 7 }));
    bench.message(common::DataState { timestamp: 0, module: "nerves".into(), state: State::Run as i8 });
    let late = |bench: &mut Bench| {
        bench.message(common::DataState { timestamp: 0, module: "nerves".into(), state: State::Run as i8 });
        bench.event(Event::Process(ProcessEvent::CheckLate { by: Duration::from_millis(100) }));
    };
    let ms = Duration::from_millis;
    bench.published();
    late(&mut bench);
    bench.pass(ms(1000));
    late(&mut bench);
    bench.pass(ms(980));
    assert!(phases(&mut bench).iter().all(|phase| *phase == common::Process::RUNNING), "not twice in a second");
    late(&mut bench);
    assert_eq!(phases(&mut bench), [common::Process::UNKNOWN], "at once");
    bench.pass(ms(600));
    late(&mut bench);
    bench.pass(ms(999));
    assert!(phases(&mut bench).iter().all(|phase| *phase == common::Process::UNKNOWN));
    bench.pass(ms(1));
    assert_eq!(phases(&mut bench), [common::Process::RUNNING]);
}

#[test]
fn the_watchdog_s_own_delay_is_a_fault() {
    check(
        "0ms > start
         0ms < spawn nerves RUN
         1ms > pid nerves 7
         10ms > says nerves RUN
         10ms < spawn eyes RUN
         100ms > late 100
         800ms > late 150
         800ms < report WatchdogLate watchdog
         900ms > late 200
         1000ms > says nerves RUN
         1900ms < notice watchdog
         1900ms > end",
    );
}

#[test]
fn a_watchdog_that_is_always_held_up_finds_a_silent_module() {
    let mut bench = bench();
    bench.event(Event::Start);
    bench.event(Event::Process(ProcessEvent::Started { module: "nerves", pid: 7 }));
    bench.message(common::DataState { timestamp: 0, module: "nerves".into(), state: State::Run as i8 });
    let mut out = Actions::new(Epoch::default());
    for ms in (0..=3600).step_by(600) {
        bench.shell.handle(bench.now() + Duration::from_millis(ms), Event::Timer, &mut out);
    }
    let ended = |action: &Action| matches!(action, Action::Process(ProcessCommand::Terminate { .. }));
    assert_eq!(out.drain().filter(ended).count(), 1);
}
