//! The shell around test modules.

use crate::bench::Bench;
use crate::{Action, Actions, Channel, Event, Input, Message, Module, PortId, PortSpec, Shell, ShellConfig, State};
use base::{Duration, Fault, Instant, Level, Report, Severity};
use messages::common::{self, DataFaults, EventText};
use messages::lowlevel::{CmdHoming, CmdMotion};

/// Acts on its port's input: `Up` is working, `Down` is failed; the reason names the fault to raise or clear.
struct Toy {
    ports: [PortSpec; 1],
    finished: bool,
}

impl Module for Toy {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::LlCmdHoming]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Port { input: Input::Up, .. } => {
                out.clear(Fault::PortDown, "toy", "it is back");
                out.working();
            }
            Event::Port { input: Input::Down(reason), .. } => {
                out.raise(Severity::Error, Fault::PortDown, "toy", reason);
                out.failed();
            }
            Event::Port { input: Input::Sent, .. } => self.finished = true,
            Event::State(state) => {
                out.note(format!("{state} at {} ms", now.as_nanos() / 1_000_000));
            }
            Event::Message { .. } => out.note("message"),
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }

    fn finished(&self) -> bool {
        self.finished
    }
}

fn bench(wanted: State) -> Bench {
    let line = crate::Line::Can { bitrate: 1 };
    let toy = Toy { ports: [PortSpec { bus: "toy".into(), line }], finished: false };
    Bench::new(Shell::new(ShellConfig { wanted, ..ShellConfig::new("toy") }, Box::new(toy)))
}

fn command(module: &str, state: State, manual: bool) -> common::CmdState {
    common::CmdState { timestamp: 0, module: module.into(), state: state as i8, manual, source: "test".into() }
}

fn down(bench: &mut Bench) {
    bench.event(Event::Port { port: PortId(0), input: Input::Down("no carrier") });
}

fn up(bench: &mut Bench) {
    bench.event(Event::Port { port: PortId(0), input: Input::Up });
}

fn errors(bench: &mut Bench) -> Vec<(i32, i8)> {
    let error = |message| match message {
        Message::CmEventError(error) => Some((error.number, error.severity)),
        _ => None,
    };
    bench.published().into_iter().filter_map(error).collect()
}

#[test]
fn the_state_is_announced_each_second_and_at_every_change() {
    let mut bench = bench(State::Run);
    bench.start();
    bench.pass(Duration::from_millis(2500));
    let announced: Vec<(u64, i8)> = bench
        .done()
        .into_iter()
        .filter_map(|(at, action)| match action {
            Action::Publish(Message::CmDataState(state)) => Some((at.as_nanos() / 1_000_000, state.state)),
            _ => None,
        })
        .collect();
    assert_eq!(announced, [(0, State::Init as i8), (0, State::Run as i8), (1000, 3), (2000, 3)]);
}

#[test]
fn modules_announce_themselves_together_whenever_they_started() {
    for start in [0, 300, 999, 1000] {
        let mut shell = bench(State::Run).shell;
        let mut out = Actions::default();
        shell.handle(Instant::from_millis(5000 + start), Event::Start, &mut out);
        let next = shell.poll_timeout().unwrap();
        assert_eq!(next, Instant::from_millis(if start < 1000 { 6000 } else { 7000 }), "started at {start} ms");
        shell.handle(next, Event::Timer, &mut out);
        assert_eq!(shell.poll_timeout(), Some(next + Duration::from_secs(1)));
    }
}

#[test]
fn a_module_that_is_ready_goes_to_the_wanted_state() {
    for wanted in [State::Run, State::Pause, State::Stop] {
        let mut bench = bench(wanted);
        bench.start();
        assert_eq!(bench.shell.state(), wanted);
    }
}

#[test]
fn error_returns_only_to_the_previous_state() {
    for wanted in [State::Run, State::Pause, State::Stop] {
        let mut bench = bench(wanted);
        bench.start();
        down(&mut bench);
        assert_eq!(bench.shell.state(), State::Error);
        bench.message(command("toy", State::Run, true));
        assert_eq!(bench.shell.state(), State::Error, "no command leads out but STOP and TERMINATE");
        up(&mut bench);
        assert_eq!(bench.shell.state(), wanted);
    }
    let mut bench = bench(State::Stop);
    bench.event(Event::Start);
    down(&mut bench);
    up(&mut bench);
    assert_eq!(bench.shell.state(), State::Stop, "an error during the start does not lead out of STOP either");
}

#[test]
fn a_lost_device_is_remembered_through_stop() {
    let mut bench = bench(State::Run);
    bench.start();
    down(&mut bench);
    bench.message(command("toy", State::Stop, true));
    assert_eq!(bench.shell.state(), State::Stop);
    bench.message(command("toy", State::Run, true));
    assert_eq!(bench.shell.state(), State::Error, "RUN without its device");
    up(&mut bench);
    assert_eq!(bench.shell.state(), State::Run);
}

#[test]
fn nothing_leads_out_of_terminate() {
    let mut bench = bench(State::Run);
    bench.start();
    bench.message(command("toy", State::Terminate, false));
    down(&mut bench);
    up(&mut bench);
    for state in [State::Run, State::Pause, State::Stop] {
        bench.message(command("toy", state, true));
    }
    assert_eq!(bench.shell.state(), State::Terminate);
}

#[test]
fn a_forbidden_command_changes_nothing_and_is_reported() {
    let mut bench = bench(State::Run);
    bench.start();
    bench.published();
    bench.message(command("toy", State::Stop, false));
    assert_eq!(bench.shell.state(), State::Run);
    assert_eq!(errors(&mut bench), [(Fault::CommandForbidden as i32, Severity::Warning as i8)]);
    bench.message(command("toy", State::Stop, true));
    assert_eq!(bench.shell.state(), State::Stop);
    bench.message(command("toy", State::Run, false));
    assert_eq!(bench.shell.state(), State::Stop);
    bench.message(command("other", State::Run, true));
    assert_eq!(bench.shell.state(), State::Stop);
    bench.message(command("*", State::Run, true));
    assert_eq!(bench.shell.state(), State::Run);
    bench.published();
    bench.message(common::CmdState { state: 9, ..command("toy", State::Run, true) });
    assert_eq!(errors(&mut bench).len(), 1);
}

#[test]
fn a_fault_is_reported_once_and_cleared_once() {
    let mut bench = bench(State::Run);
    bench.start();
    up(&mut bench);
    assert_eq!(errors(&mut bench), []);
    down(&mut bench);
    down(&mut bench);
    assert_eq!(errors(&mut bench), [(Fault::PortDown as i32, Severity::Error as i8)]);
    up(&mut bench);
    up(&mut bench);
    assert_eq!(errors(&mut bench), [(Fault::PortDown as i32, Severity::Notice as i8)]);
}

#[test]
fn the_end_waits_for_the_module_for_a_limited_time() {
    let mut bench = bench(State::Run);
    bench.start();
    bench.message(command("toy", State::Terminate, false));
    bench.pass(Duration::from_millis(100));
    let exits = |bench: &mut Bench| bench.done().iter().filter(|(_, action)| matches!(action, Action::Exit(0))).count();
    assert_eq!(exits(&mut bench), 0);
    bench.event(Event::Port { port: PortId(0), input: Input::Sent });
    assert_eq!(exits(&mut bench), 1);
    assert_eq!(bench.shell.poll_timeout(), None);

    let mut bench = self::bench(State::Run);
    bench.start();
    bench.message(command("toy", State::Terminate, false));
    bench.pass(Duration::from_secs(2));
    assert_eq!(exits(&mut bench), 1);
}

#[test]
fn only_subscribed_messages_reach_the_module() {
    let mut bench = bench(State::Run);
    let subscribed = [Channel::CmCmdState, Channel::CmCmdLevel, Channel::LlCmdHoming];
    assert_eq!(bench.shell.subscriptions().collect::<Vec<_>>(), subscribed);
    assert!(bench.shell.wants(Channel::CmCmdState) && bench.shell.wants(Channel::LlCmdHoming));
    assert!(!bench.shell.wants(Channel::LlCmdMotion));
    bench.start();
    bench.message(command("toy", State::Pause, false));
    assert_eq!(bench.shell.state(), State::Pause);
    bench.message(CmdMotion::default());
    bench.message(CmdHoming::default());
    let heard = |(_, action): &(Instant, Action)| matches!(action, Action::Note(_, text) if text == "message");
    assert_eq!(bench.done().iter().filter(|done| heard(done)).count(), 1);
}

#[test]
fn reports_begin_at_the_chosen_severity() {
    let line = crate::Line::Can { bitrate: 1 };
    let toy = Toy { ports: [PortSpec { bus: "toy".into(), line }], finished: false };
    let config = ShellConfig { report_from: Severity::Error, ..ShellConfig::new("toy") };
    let mut bench = Bench::new(Shell::new(config, Box::new(toy)));
    bench.start();
    bench.message(command("toy", State::Stop, false));
    assert_eq!(errors(&mut bench), [], "a warning");
    down(&mut bench);
    assert_eq!(errors(&mut bench), [(Fault::PortDown as i32, Severity::Error as i8)]);
    up(&mut bench);
    assert_eq!(errors(&mut bench), [(Fault::PortDown as i32, Severity::Notice as i8)], "the end of the reported fault");
}

/// Lists of active faults published since the last call, with their times.
fn lists(bench: &mut Bench) -> Vec<(u64, DataFaults)> {
    let list = |(at, action): (Instant, Action)| match action {
        Action::Publish(Message::CmDataFaults(list)) => Some((at.as_nanos() / 1_000_000, list)),
        _ => None,
    };
    bench.done().into_iter().filter_map(list).collect()
}

fn subjects(list: &DataFaults) -> Vec<(i32, &str)> {
    list.faults.iter().map(|fault| (fault.number, fault.subject.as_str())).collect()
}

/// Raises and clears faults by text: `raise SUBJECT SEVERITY MESSAGE` and `clear SUBJECT`; other lines are notes.
struct Boards;

impl Module for Boards {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::CmCmdLog]
    }

    fn handle(&mut self, _: Instant, event: Event<'_>, out: &mut Actions) {
        let Event::Message { message: Message::CmCmdLog(order), .. } = event else { return };
        for line in order.text.lines() {
            match line.splitn(4, ' ').collect::<Vec<_>>()[..] {
                ["raise", subject, severity, message] => {
                    let severity = if severity == "error" { Severity::Error } else { Severity::Warning };
                    out.raise(severity, Fault::BoardLost, subject, message);
                }
                ["clear", subject] => out.clear(Fault::BoardLost, subject, "it answers"),
                ["debug", text] => out.say(Level::Debug, text),
                ["note", text] => out.note(text),
                ["warning", text] => out.say(Level::Warning, text),
                _ => panic!("{line}"),
            }
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

fn boards(config: ShellConfig) -> Bench {
    let mut bench = Bench::new(Shell::new(config, Box::new(Boards)));
    bench.start();
    bench
}

fn order(bench: &mut Bench, text: &str) {
    bench.message(common::CmdLog { timestamp: 0, action: 0, text: text.into() });
}

#[test]
fn when_one_of_two_lost_boards_returns_the_other_stays_in_the_list() {
    let mut bench = boards(ShellConfig::new("driver"));
    bench.pass(Duration::from_millis(300));
    order(&mut bench, "raise front warning front is silent\nraise rear warning rear is silent");
    bench.pass(Duration::from_millis(300));
    order(&mut bench, "clear front");
    bench.pass(Duration::from_millis(500));
    let lists = lists(&mut bench);
    let lost = Fault::BoardLost as i32;
    let seen: Vec<_> = lists.iter().map(|(ms, list)| (*ms, subjects(list))).collect();
    let rear = vec![(lost, "rear")];
    assert_eq!(seen, [(0, vec![]), (300, vec![(lost, "front"), (lost, "rear")]), (600, rear.clone()), (1000, rear)]);
    let fault = common::Fault {
        number: lost,
        subject: "rear".into(),
        severity: Severity::Warning as i8,
        since: 300_000,
        message: "rear is silent".into(),
    };
    let list = DataFaults { timestamp: 1_000_000, module: "driver".into(), faults: vec![fault] };
    assert_eq!(lists.last().unwrap().1, list);
}

#[test]
fn the_list_comes_before_the_reports_that_it_explains_and_has_their_time() {
    let mut bench = boards(ShellConfig::new("driver"));
    bench.pass(Duration::from_millis(10));
    bench.done();
    order(&mut bench, "raise front error silent");
    let published = bench.published();
    let [Message::CmDataFaults(list), Message::CmEventError(error)] = &published[..] else { panic!("{published:?}") };
    assert_eq!((list.timestamp, list.faults[0].since), (error.timestamp, error.timestamp));
    // Raised and cleared in the same call it was never active.
    order(&mut bench, "clear front\nraise front error silent\nclear front");
    let [(_, list)] = &lists(&mut bench)[..] else { panic!("one list") };
    assert_eq!(list.faults, []);
}

#[test]
fn a_fault_raised_again_is_reported_only_if_its_severity_changed() {
    let mut bench = boards(ShellConfig::new("driver"));
    order(&mut bench, "raise front warning one");
    bench.pass(Duration::from_millis(400));
    bench.done();
    order(&mut bench, "raise front warning two");
    assert_eq!(bench.published(), [], "a message alone waits");
    order(&mut bench, "raise front error three");
    let published = bench.published();
    let [Message::CmDataFaults(list)] = &published[..] else { panic!("{published:?}") };
    let fault = &list.faults[0];
    assert_eq!((fault.severity, fault.since, fault.message.as_str()), (Severity::Error as i8, 0, "three"));
    order(&mut bench, "raise front error four");
    bench.pass(Duration::from_secs(1));
    assert_eq!(lists(&mut bench)[0].1.faults[0].message, "four");
}

#[test]
fn the_list_includes_unreported_faults_and_is_bounded() {
    let config = ShellConfig { report_from: Severity::Error, ..ShellConfig::new("driver") };
    let mut bench = boards(config);
    bench.done();
    order(&mut bench, "raise front warning silent");
    let published = bench.published();
    let [Message::CmDataFaults(list)] = &published[..] else { panic!("{published:?}") };
    assert_eq!(list.faults.len(), 1);
    let long = "x".repeat(2000);
    for n in 0..300 {
        order(&mut bench, &format!("raise {n} warning {long}\0"));
    }
    bench.done();
    bench.pass(Duration::from_secs(1));
    let (_, list) = lists(&mut bench).remove(0);
    assert_eq!(list.faults.len(), 256);
    assert!(list.faults.iter().all(|fault| fault.message.len() <= 512 && !fault.message.contains('\0')));
    assert!(Message::from(list).encode(&mut Vec::new()).is_ok());
}

#[test]
fn faults_of_the_host_are_in_the_list() {
    let mut bench = boards(ShellConfig::new("driver"));
    bench.done();
    let mut out = Actions::default();
    let report = Report::new(Severity::Warning, Fault::PortDown, "lcm", "refuses");
    bench.shell.raise(bench.now(), report.clone(), &mut out);
    let Some(Action::Publish(Message::CmDataFaults(list))) = out.as_slice().first() else { panic!("{out:?}") };
    assert_eq!(subjects(list), [(Fault::PortDown as i32, "lcm")]);
    out.drain().for_each(drop);
    bench.shell.clear(bench.now(), report, &mut out);
    let Some(Action::Publish(Message::CmDataFaults(list))) = out.as_slice().first() else { panic!("{out:?}") };
    assert_eq!(list.faults, []);
}

/// Texts published, and texts printed, since the last call.
fn texts(bench: &mut Bench) -> [Vec<(i8, String)>; 2] {
    let (mut sent, mut printed) = (Vec::new(), Vec::new());
    for (_, action) in bench.done() {
        match action {
            Action::Publish(Message::CmEventText(EventText { module, level, text, .. })) => {
                assert_eq!(module, "driver");
                sent.push((level, text));
            }
            Action::Note(level, text) => printed.push((level as i8, text)),
            _ => {}
        }
    }
    [sent, printed]
}

#[test]
fn texts_are_sent_and_printed_from_separate_levels() {
    let lines = |levels: &[i8]| levels.iter().map(|level| (*level, format!("L{level}"))).collect::<Vec<_>>();
    let usual = ShellConfig::new("driver");
    let quiet = ShellConfig { report_from: Severity::Error, ..usual.clone() };
    let bus = ShellConfig { print_from: Some(Level::Error), send_from: Some(Level::Debug), ..usual.clone() };
    let terminal = ShellConfig { print_from: Some(Level::Debug), send_from: Some(Level::Warning), ..usual.clone() };
    for (config, sent, printed) in [
        (usual, &[1, 2][..], &[1, 2][..]),
        // The older key applies to reports only.
        (quiet, &[1, 2], &[1, 2]),
        (bus, &[0, 1, 2], &[]),
        (terminal, &[2], &[0, 1, 2]),
    ] {
        let mut bench = boards(config);
        bench.done();
        order(&mut bench, "debug L0\nnote L1\nwarning L2");
        assert_eq!(texts(&mut bench), [lines(sent), lines(printed)]);
    }
}

fn level(module: &str, print_from: i8, send_from: i8) -> common::CmdLevel {
    common::CmdLevel { timestamp: 0, module: module.into(), print_from, send_from, source: "test".into() }
}

/// Answers to commands for the levels since the last call: printed from, sent from, commanded.
fn answers(bench: &mut Bench) -> Vec<(i8, i8, bool)> {
    let answer = |(_, action)| match action {
        Action::Publish(Message::CmDataLevel(level)) => {
            assert_eq!(level.module, "driver");
            Some((level.print_from, level.send_from, level.commanded))
        }
        _ => None,
    };
    bench.done().into_iter().filter_map(answer).collect()
}

#[test]
fn levels_are_changed_while_it_runs_and_answered() {
    const KEEP: i8 = common::CmdLevel::UNCHANGED;
    const RESET: i8 = common::CmdLevel::CONFIGURED;
    let config = ShellConfig { print_from: Some(Level::Error), ..ShellConfig::new("driver") };
    let lines = |levels: &[i8]| levels.iter().map(|level| (*level, format!("L{level}"))).collect::<Vec<_>>();
    let mut bench = boards(config);
    bench.done();
    // A question changes nothing; commands to others are not obeyed.
    for (module, answered) in [("driver", 1), ("*", 1), ("other", 0), ("", 0)] {
        bench.message(level(module, KEEP, KEEP));
        assert_eq!(answers(&mut bench), [(3, 1, false)].repeat(answered), "{module:?}");
    }
    for (module, [print, send], answer, sent, printed) in [
        ("driver", [KEEP, 0], (3, 0, true), &[0, 1, 2][..], &[][..]),
        ("*", [0, 2], (0, 2, true), &[2], &[0, 1, 2]),
        ("driver", [RESET, KEEP], (3, 2, true), &[2], &[]),
        ("driver", [RESET, RESET], (3, 1, false), &[1, 2], &[]),
    ] {
        bench.message(level(module, print, send));
        assert_eq!(answers(&mut bench), [answer]);
        bench.pass(Duration::from_secs(1));
        bench.done();
        order(&mut bench, "debug L0\nnote L1\nwarning L2");
        assert_eq!(texts(&mut bench), [lines(sent), lines(printed)], "{print} {send}");
    }
}

#[test]
fn a_changed_level_applies_to_reports_and_the_list_has_all_faults() {
    let mut bench = boards(ShellConfig::new("driver"));
    bench.message(level("driver", 3, 3));
    bench.done();
    order(&mut bench, "raise front warning silent");
    let done = bench.done();
    let reported = |action: &Action| matches!(action, Action::Publish(Message::CmEventError(_)) | Action::Report(_));
    assert!(!done.iter().any(|(_, action)| reported(action)), "{done:?}");
    let listed = done.iter().find_map(|(_, action)| match action {
        Action::Publish(Message::CmDataFaults(list)) => Some(list.faults.len()),
        _ => None,
    });
    assert_eq!(listed, Some(1));
    order(&mut bench, "raise rear error silent");
    assert_eq!(bench.done().iter().filter(|(_, action)| reported(action)).count(), 2, "published and printed");
}

#[test]
fn what_is_no_level_is_refused_and_a_flood_of_it_is_counted_in_one_report_a_second() {
    let mut bench = boards(ShellConfig::new("driver"));
    bench.done();
    let reports = |bench: &mut Bench| {
        let report = |(_, action)| match action {
            Action::Publish(Message::CmEventError(error)) => Some(error.message),
            Action::Publish(Message::CmDataLevel(_)) => panic!("a refused command is not answered"),
            _ => None,
        };
        bench.done().into_iter().filter_map(report).collect::<Vec<_>>()
    };
    for _ in 0..100 {
        bench.message(level("driver", 4, 0));
    }
    assert_eq!(reports(&mut bench), ["command from test refused: 4 is not a level"]);
    bench.pass(Duration::from_secs(1));
    bench.message(level("*", 0, -128));
    let more = "command from test refused: -128 is not a level; 100 refused since the last report";
    assert_eq!(reports(&mut bench), [more]);
    bench.message(level("driver", common::CmdLevel::UNCHANGED, common::CmdLevel::UNCHANGED));
    assert_eq!(answers(&mut bench), [(1, 1, false)]);
}

#[test]
fn reports_and_their_ends_are_sent_and_printed_from_separate_levels() {
    let reports = |bench: &mut Bench| {
        let (mut sent, mut printed) = (0, 0);
        for (_, action) in bench.done() {
            match action {
                Action::Publish(Message::CmEventError(_)) => sent += 1,
                Action::Report(_) => printed += 1,
                _ => {}
            }
        }
        (sent, printed)
    };
    let config = |print_from, send_from| ShellConfig { print_from, send_from, ..ShellConfig::new("driver") };
    let (warning, error) = (Some(Level::Warning), Some(Level::Error));
    for (config, expected) in
        [(config(None, None), (1, 1)), (config(error, warning), (1, 0)), (config(warning, error), (0, 1))]
    {
        let mut bench = boards(config);
        bench.done();
        order(&mut bench, "raise front warning silent");
        assert_eq!(reports(&mut bench), expected);
        // A later raise with higher severity does not matter: its begin was not reported.
        order(&mut bench, "raise front error silent");
        order(&mut bench, "clear front");
        assert_eq!(reports(&mut bench), expected);
    }
}

#[test]
fn the_rate_of_texts_is_limited_on_the_bus_only() {
    let mut bench = boards(ShellConfig::new("driver"));
    bench.pass(Duration::from_millis(100));
    bench.done();
    order(&mut bench, &"note x\n".repeat(120));
    let [sent, printed] = texts(&mut bench);
    assert_eq!((sent.len(), printed.len()), (49, 120));
    bench.pass(Duration::from_millis(900));
    let [sent, _] = texts(&mut bench);
    assert_eq!(sent, [(EventText::WARNING, "71 texts left out: more than 49 in a second".into())]);
    bench.pass(Duration::from_millis(500));
    order(&mut bench, "note y");
    assert_eq!(texts(&mut bench)[0], [(EventText::INFO, "y".into())]);
}
