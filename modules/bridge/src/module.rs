//! The bridge as a module: started, supervised, reported and ended here. Its host admits the messages that are sent, so
//! what a module of this computer would not accept does not reach the other computer either.

use crate::NAME;
use crate::allow::subject;
use crate::clocks::Comparison;
use crate::gate::Passes;
use crate::settings::Link;
use crate::shared::{Note, Outgoing, Shared, Status};
use crate::transport::{Transport, is_of_the_host};
use crate::wire::{CHANNEL_MAX, MODULES_MAX};
use base::{Duration, Fault, Instant, Level, Severity};
use messages::common::{DataBridge, DataProcesses, Process};
use messages::{Channel, Message};
use module::{Action, Actions, Event, Module, State, admission, exit};
use std::path::PathBuf;
use std::sync::atomic::Ordering::Relaxed;

/// Period of checks on the connections: with [`crate::connection::SILENCE_MAX`] a loss is reported within 0.5 s.
const CHECK_PERIOD: Duration = Duration::from_millis(40);
/// Period of `CM_DATA_BRIDGE`, and of retries without a key or a bus.
const PUBLISH_PERIOD: Duration = Duration::from_secs(1);
/// Time without a turn of the thread after which it counts as hung.
const TURN_MAX: Duration = Duration::from_secs(1);
/// Time after the start in which a missing connection is no fault: the other computer may be starting, too.
const START_MAX: Duration = Duration::from_secs(2);
/// Shortest time between two reports of refused connections.
const REFUSED_PERIOD: Duration = Duration::from_secs(10);

/// Parameters of the bridge.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The LCM bus.
    pub lcm_url: String,
    /// Configuration folder, from which key files are found.
    pub config_dir: PathBuf,
    /// Connections.
    pub links: Vec<Link>,
    /// Modules of this computer, as `modules.toml` lists them, with the watchdog.
    pub modules: Vec<String>,
}

/// The module.
#[derive(Debug)]
pub struct Bridge {
    settings: Settings,
    subscriptions: Vec<Channel>,
    transport: Option<Transport>,
    passes: Passes,
    started: Instant,
    next_check: Option<Instant>,
    next_publish: Instant,
    next_refused: Instant,
    /// Turns of the thread, and when they changed.
    turns: (u32, Instant),
    /// State of the connections at the last check.
    status: Vec<Status>,
    /// Condition that was reported last: true if all that is critical works.
    works: Option<bool>,
}

impl Bridge {
    /// Creates the module; no connection is opened yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let sent: Vec<_> = settings.links.iter().flat_map(Link::sent).collect();
        let is_sent = |channel: &Channel| sent.iter().any(|entry| entry.allows(channel.name()));
        let known = Channel::ALL.iter().copied().filter(|channel| is_of_the_host(channel.name()));
        let mut subscriptions: Vec<Channel> = known.filter(is_sent).collect();
        subscriptions.push(Channel::CmDataProcesses);
        Self {
            settings,
            subscriptions,
            transport: None,
            // Until the shell reports a state.
            passes: Passes::Nothing,
            started: Instant::ZERO,
            next_check: None,
            next_publish: Instant::ZERO,
            next_refused: Instant::ZERO,
            turns: (0, Instant::ZERO),
            status: Vec::new(),
            works: None,
        }
    }

    fn shared(&self) -> Option<&Shared> {
        self.transport.as_ref().map(Transport::shared)
    }

    fn open(&mut self, now: Instant, out: &mut Actions) {
        let Settings { lcm_url, config_dir, links, modules } = &self.settings;
        match Transport::start(links, config_dir, lcm_url, modules, self.passes) {
            Ok(transport) => {
                self.transport = Some(transport);
                (self.turns, self.next_check) = ((0, now), Some(now + CHECK_PERIOD));
                out.clear(Fault::PortDown, NAME, "the keys are read");
                if !links.iter().any(|link| link.critical) {
                    self.works = Some(true);
                    out.working();
                }
            }
            Err(why) => {
                self.next_check = Some(now + PUBLISH_PERIOD);
                out.raise(Severity::Error, Fault::PortDown, NAME, why);
                out.failed();
            }
        }
    }

    fn check(&mut self, now: Instant, out: &mut Actions) {
        let Some(transport) = &self.transport else { return self.open(now, out) };
        self.next_check = Some(now + CHECK_PERIOD);
        let turns = transport.shared().turns.load(Relaxed);
        if turns != self.turns.0 {
            self.turns = (turns, now);
        }
        if transport.has_ended() || now.since(self.turns.1) >= TURN_MAX {
            out.report(Severity::Error, Fault::PortDown, NAME, "the connections stand still: they are opened anew");
            out.push(Action::Exit(exit::RESOURCE));
            return;
        }
        let (status, notes) = (transport.shared().status(), transport.shared().take_notes());
        notes.into_iter().for_each(|note| self.note(now, note, out));
        self.judge(now, &status, out);
        let changed =
            status.iter().zip(&self.status).any(|(new, old)| (new.up, &new.missing) != (old.up, &old.missing));
        if changed || now >= self.next_publish {
            self.next_publish = now + PUBLISH_PERIOD;
            for (link, status) in self.settings.links.iter().zip(&status) {
                out.publish(message(out.timestamp(now), link, status));
            }
        }
        self.status = status;
    }

    fn note(&mut self, now: Instant, note: Note, out: &mut Actions) {
        match note {
            Note::Warning(text) => out.say(Level::Warning, text),
            Note::Refused(link, text) if now >= self.next_refused => {
                self.next_refused = now + REFUSED_PERIOD;
                out.report(Severity::Warning, Fault::BridgeRefused, link, text);
            }
            Note::Refused(..) => {}
        }
    }

    /// Raises and clears the faults of the connections. Nothing that passes here starts a motion: the stop that a
    /// missing critical module causes is released by the rules of the drives' driver.
    fn judge(&mut self, now: Instant, status: &[Status], out: &mut Actions) {
        let starting = now.since(self.started) < START_MAX;
        let mut works = true;
        for (link, status) in self.settings.links.iter().zip(status) {
            let fits = status.up && status.missing.is_empty();
            works &= fits || !link.critical;
            if starting && !fits {
                continue;
            }
            let severity = if link.critical { Severity::Error } else { Severity::Warning };
            let name = link.name.as_str();
            let effect = if link.critical { ": the robot stops" } else { "" };
            match status.up {
                true => out.clear(Fault::BridgeDown, name, format!("{name}: connected to {}", status.peer)),
                false => {
                    let message = format!("{name}: no connection to the other computer{effect}");
                    out.raise(severity, Fault::BridgeDown, name, message);
                }
            }
            for module in &link.modules {
                let subject = format!("{name} {module}");
                match status.missing.contains(module) {
                    // Without the connection one fault is enough.
                    true if status.up => {
                        let message = format!("{module} does not work on the computer {name}{effect}");
                        out.raise(severity, Fault::RemoteModule, subject, message);
                    }
                    true => out.clear(Fault::RemoteModule, subject, format!("{module}: not known")),
                    false => out.clear(Fault::RemoteModule, subject, format!("{module} works on the computer {name}")),
                }
            }
            match status.clocks {
                Some(clocks) if clocks.exceeds(link.clock_max) => {
                    let message = format!(
                        "the clock of the computer {name} differs from this one by more than {} s: set both by one \
                         time server",
                        link.clock_max.as_secs_f64()
                    );
                    out.raise(Severity::Warning, Fault::ClocksDiffer, name, message);
                }
                Some(Comparison { offset_s, .. }) if offset_s.abs() <= link.clock_max.as_secs_f64() => {
                    out.clear(Fault::ClocksDiffer, name, format!("the clock of the computer {name} agrees"));
                }
                _ => {}
            }
        }
        if (works || !starting) && self.works != Some(works) {
            self.works = Some(works);
            if works { out.working() } else { out.failed() }
        }
    }

    fn on_message(&mut self, at: Instant, message: &Message) {
        let Some(shared) = self.shared() else { return };
        if let Message::CmDataProcesses(list) = message {
            // Of when it was published: a module that was held up does not make an old list new.
            shared.set_modules(at, works(list));
            return;
        }
        let mut payload = Vec::new();
        if message.encode(&mut payload).is_ok() {
            let (channel, module) = (message.channel_name().into_owned(), subject(message).map(str::to_owned));
            shared.push(Outgoing { at, channel, module, stops: admission::stops(message), payload });
        }
    }

    fn on_state(&mut self, now: Instant, state: State) {
        self.passes = match state {
            State::Run | State::Error => Passes::All,
            State::Pause => Passes::Data,
            State::Unknown | State::Init | State::Stop | State::Terminate => Passes::Nothing,
        };
        let Some(transport) = &self.transport else { return };
        transport.shared().set_passes(self.passes);
        if state == State::Terminate {
            transport.end();
            self.next_check = Some(now + CHECK_PERIOD);
        }
    }
}

/// Modules of a list of the watchdog, and whether each does its work, by the rule of the drives' driver.
fn works(list: &DataProcesses) -> Vec<(String, bool)> {
    let states = [State::Run as i8, State::Pause as i8];
    let works = |process: &Process| process.phase == Process::RUNNING && states.contains(&process.state);
    let named = list.processes.iter().filter(|process| (1..=CHANNEL_MAX).contains(&process.module.len()));
    named.take(MODULES_MAX).map(|process| (process.module.clone(), works(process))).collect()
}

fn message(timestamp: i64, link: &Link, status: &Status) -> DataBridge {
    let count = |count: u64| i64::try_from(count).unwrap_or(i64::MAX);
    let clocks = status.clocks.unwrap_or(Comparison { offset_s: f64::NAN, round_trip_s: f64::NAN });
    DataBridge {
        timestamp,
        name: link.name.clone(),
        peer: status.peer.clone(),
        connected: status.up,
        clock_offset: clocks.offset_s,
        round_trip: clocks.round_trip_s,
        sent: count(status.counters.sent),
        received: count(status.counters.received),
        refused: count(status.counters.refused),
        late: count(status.counters.late),
        dropped: count(status.counters.dropped),
        missing: status.missing.join(","),
    }
}

impl Module for Bridge {
    fn subscriptions(&self) -> &[Channel] {
        &self.subscriptions
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.started = now;
                self.open(now, out);
            }
            Event::Message { at, message, .. } => self.on_message(at, message),
            Event::Timer if self.next_check.is_some_and(|next| next <= now) => match &self.transport {
                Some(transport) if transport.is_ending() => self.next_check = Some(now + CHECK_PERIOD),
                _ => self.check(now, out),
            },
            Event::State(state) => self.on_state(now, state),
            _ => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.next_check
    }

    fn finished(&self) -> bool {
        self.transport.as_ref().is_none_or(Transport::has_ended)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::Report;
    use module::bench::Bench;
    use module::{Condition, Shell, ShellConfig};
    use std::path::Path;

    fn bridge(critical: bool) -> Bridge {
        let node = ::settings::Node::parse(Path::new("robot.toml"), "connect = \"10.0.0.2:7667\"\nkey_file = \"k\"");
        let link = ::settings::read_as::<Link>(&node.unwrap()).unwrap();
        let (name, modules, send) = ("far".into(), vec!["camera".into()], vec!["LL_*".into(), "LL_CMD_MOTION".into()]);
        Bridge::new(Settings {
            lcm_url: "memq://".into(),
            config_dir: "/nowhere".into(),
            links: vec![Link { name, modules, send, critical, ..link }],
            modules: vec!["planner".into()],
        })
    }

    fn status(up: bool, missing: &[&str]) -> Status {
        let clocks = up.then_some(Comparison { offset_s: 0.001, round_trip_s: 0.001 });
        Status { up, clocks, missing: missing.iter().map(|name| (*name).into()).collect(), ..Status::default() }
    }

    /// Faults raised with their severities, and the condition reported, at this time.
    fn judged(bridge: &mut Bridge, ms: u64, status: Status) -> (Vec<(Fault, Severity)>, Option<Condition>) {
        let (mut raised, mut condition, mut out) = (Vec::new(), None, Actions::default());
        bridge.judge(Instant::from_millis(ms), &[status], &mut out);
        for action in out.drain() {
            match action {
                Action::Raise(Report { fault, severity, .. }) => raised.push((fault, severity)),
                Action::Condition(new) => condition = Some(new),
                _ => {}
            }
        }
        (raised, condition)
    }

    #[test]
    fn without_a_critical_connection_or_module_the_bridge_fails() {
        let mut bridge = bridge(true);
        let lost = || status(false, &["camera"]);
        assert_eq!(judged(&mut bridge, 1000, lost()), (vec![], None), "the other computer may be starting");
        let down = vec![(Fault::BridgeDown, Severity::Error)];
        assert_eq!(judged(&mut bridge, 2000, lost()), (down.clone(), Some(Condition::Failed)));
        assert_eq!(judged(&mut bridge, 2040, status(true, &[])), (vec![], Some(Condition::Working)));
        let remote = vec![(Fault::RemoteModule, Severity::Error)];
        assert_eq!(judged(&mut bridge, 2080, status(true, &["camera"])), (remote, Some(Condition::Failed)));
        assert_eq!(judged(&mut bridge, 2120, status(true, &[])), (vec![], Some(Condition::Working)));
        assert_eq!(judged(&mut bridge, 2160, lost()), (down, Some(Condition::Failed)));
    }

    #[test]
    fn another_connection_is_missing_with_a_warning() {
        let mut bridge = bridge(false);
        let down = vec![(Fault::BridgeDown, Severity::Warning)];
        assert_eq!(judged(&mut bridge, 2000, status(false, &["camera"])), (down, Some(Condition::Working)));
        let far = Status { clocks: Some(Comparison { offset_s: -0.2, round_trip_s: 0.01 }), ..status(true, &[]) };
        assert_eq!(judged(&mut bridge, 2040, far), (vec![(Fault::ClocksDiffer, Severity::Warning)], None));
    }

    #[test]
    fn it_subscribes_to_what_is_sent_and_without_a_key_it_is_in_error() {
        let bridge = bridge(true);
        let subscribed = |channel| bridge.subscriptions().contains(&channel);
        assert!(subscribed(Channel::LlDataOdo) && subscribed(Channel::LlCmdMotion));
        assert!(subscribed(Channel::CmDataProcesses));
        assert!(!subscribed(Channel::LlCmdPower) && !subscribed(Channel::LlEventStop));
        let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(bridge)));
        bench.start();
        let mut states = bench.published().into_iter().filter_map(|message| match message {
            Message::CmDataState(state) => State::from_value(state.state),
            _ => None,
        });
        assert_eq!(states.next_back(), Some(State::Error));
    }

    #[test]
    fn a_module_works_that_runs_in_run_or_pause() {
        let process = |module: &str, phase, state: State| Process {
            module: module.into(),
            phase,
            state: state as i8,
            ..Default::default()
        };
        let processes = vec![
            process("a", Process::RUNNING, State::Run),
            process("b", Process::RUNNING, State::Pause),
            process("c", Process::RUNNING, State::Error),
            process("d", Process::UNKNOWN, State::Run),
        ];
        let list = DataProcesses { processes, ..Default::default() };
        let names: Vec<_> = works(&list).into_iter().filter(|(_, works)| *works).map(|(name, _)| name).collect();
        assert_eq!(names, ["a", "b"]);
    }
}
