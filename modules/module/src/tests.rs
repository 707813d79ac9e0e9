//! The shell around a module that the test plays.

use crate::bench::Bench;
use crate::{Action, Actions, Channel, Event, Input, Message, Module, PortId, PortSpec, Shell, ShellConfig, State};
use base::{Duration, Fault, Instant, Severity};
use messages::common;

/// Does what its port tells it: `Up` is working, `Down` is failed; the reason says which fault to raise or clear.
struct Toy {
    ports: [PortSpec; 1],
    finished: bool,
}

impl Module for Toy {
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
fn a_module_that_is_ready_goes_to_the_wanted_state() {
    for wanted in [State::Run, State::Pause, State::Stop] {
        let mut bench = bench(wanted);
        bench.start();
        assert_eq!(bench.shell.state(), wanted);
    }
}

#[test]
fn error_returns_only_to_where_it_came_from() {
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
fn a_lost_device_is_not_forgotten_by_way_of_stop() {
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
fn the_end_waits_for_the_module_but_not_for_ever() {
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
fn only_what_is_wanted_reaches_the_module() {
    let bench = bench(State::Run);
    assert!(bench.shell.wants(Channel::CmCmdState));
    assert!(!bench.shell.wants(Channel::LlCmdMotion));
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
    assert_eq!(errors(&mut bench), [(Fault::PortDown as i32, Severity::Notice as i8)], "the end of what was told");
}
