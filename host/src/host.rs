//! One module as a process: one thread, one `epoll`, one timer.
//!
//! Each turn of the loop serves what is due, then a bounded number of inputs of every source, so that a flood on one
//! source delays the others by at most one turn.

use super::bad_input::{self, BadInput};
use super::beats::{Heartbeat, HeartbeatPage};
use super::bus::{Bus, Received as FromBus};
use super::bus_health::{BusHealth, LOSS_END, Losses};
use super::clock;
use super::keepers;
use super::limits;
use super::log::{Log, OneLine};
use super::notify::ToParent;
use super::ports::{Port, PortConfig, PortState, Received};
use super::processes::{self, Launch, Line, Processes};
use super::raw::Tap;
use super::recorder::{Inputs, Recording};
use super::sys;
use base::{Duration, Fault, Instant, Level, Report, Severity, earliest};
use messages::common::CmdLevel;
use messages::{Channel, Message, Raw};
use module::admission::{Admission, Policy, RELEASES, Refusal, SECOND_ROBOT_END, Sender, Way};
use module::texts::Texts;
use module::{Action, Actions, Event, Input, Output, PortId, PortSpec, ProcessCommand, Shell, exit};
use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::sys::time::TimeSpec;
use nix::sys::timerfd::{ClockId, Expiration, TimerFd, TimerFlags, TimerSetTimeFlags};
use nix::unistd::alarm;
use std::collections::BTreeMap;
use std::mem;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Maximum number of inputs taken from one source in one turn.
const BURST: usize = 64;
/// Socket buffer of a module that receives the whole bus, bytes: a third of a second at 50 MB/s.
const RAW_RECEIVE_BUFFER: usize = 16 << 20;
/// Time that the last output of a module has to leave the process.
const FLUSH_TIMEOUT: Duration = Duration::from_millis(100);

/// A module that a watchdog started ends after this time without a sign of any watchdog.
const UNSUPERVISED_MAX: Duration = Duration::from_secs(3);
/// SIGALRM deadlines, s: while waiting for a watchdog, and while exiting. They end the process in case it hangs.
const ALARM_S: (u32, u32) = (4, 3);

const TIMER: u64 = 0;
const SIGNALS: u64 = 1;
const BUS: u64 = 2;
const PROCESSES: u64 = 3;
const PORTS: u64 = 4;

/// Resources of a module.
pub struct HostConfig {
    /// The LCM bus.
    pub lcm_url: String,
    /// Ports, in the order of [`module::Module::ports`].
    pub ports: Vec<PortConfig>,
    /// For each port in order the `<BUS>` of `LL_DATA_RAW_<BUS>` on which its traffic is published; missing entries
    /// count as `None`.
    pub raw: Vec<Option<String>>,
    /// Which senders are accepted.
    pub policy: Policy,
    /// Start of modules; watchdog only.
    pub launch: Option<Launch>,
    /// Folder of the heartbeat pages; watchdog only.
    pub beats: Option<PathBuf>,
    /// Recording of the module's inputs, if enabled.
    pub inputs: Option<Inputs>,
}

/// Why a module's process ends by failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Exit code of the process: one of [`module::exit`].
    pub code: u8,
    /// Reason, in one line.
    pub why: String,
}

/// Runs a module until it ends and returns its exit code.
///
/// # Errors
/// A resource that the machine refused, at the start or later.
pub fn run(shell: Shell, config: HostConfig) -> Result<u8, Failure> {
    Host::open(shell, config).map_err(|why| Failure { code: exit::START, why })?.run()
}

struct Host {
    shell: Shell,
    /// Declared after `shell`, so dropped after it.
    recording: Option<Recording>,
    out: Actions,
    /// Swapped with `out` while the actions of `out` are executed.
    spare: Actions,
    log: Log,
    /// Warnings about refused resources, published after the module's start.
    lines: Vec<String>,
    /// Notices about the configuration and about the accepted senders, published after the module's start.
    notices: Vec<String>,
    /// Rate limiters for the lines of foreign modules; used by the watchdog only.
    foreign: BTreeMap<String, Texts>,
    bus: Bus,
    admission: Admission,
    /// Time of the last message of another watchdog, while that is a fault.
    second_robot: Option<Instant>,
    health: BusHealth,
    bad: BadInput,
    ports: Vec<Port>,
    /// Last note of each port; repeated notes are not printed.
    notes: Vec<String>,
    /// Taps of the ports whose traffic is published, with the bus name.
    taps: Vec<Option<(String, Tap)>>,
    processes: Option<Processes>,
    /// Connection to the process that supervises the watchdog; watchdog only.
    parent: Option<ToParent>,
    /// Time of the last sign of any watchdog; `None` if no watchdog supervises this process.
    watchdog_seen: Option<Instant>,
    /// Last value of the watchdog's counter in the heartbeat page.
    reader: u32,
    epoll: Epoll,
    timer: TimerFd,
    armed: Option<Instant>,
    /// Use the exact wait of a real-time thread; see [`Host::wait_exactly`].
    real_time: bool,
    signals: SignalFd,
    /// Heartbeat of this loop.
    beat: Option<Heartbeat>,
    end: Option<(u8, Instant)>,
}

impl Host {
    fn open(mut shell: Shell, mut config: HostConfig) -> Result<Self, String> {
        let (mut notices, launch_is_none) = (Vec::<String>::new(), config.launch.is_none());
        // Before any thread can start, because threads inherit the signal mask.
        let signals = signals().map_err(|errno| format!("signalfd: {}", errno.desc()))?;
        let watchdog_seen = std::env::var_os(processes::VARIABLE).map(|_| clock::now());
        if watchdog_seen.is_some() {
            alarm::set(ALARM_S.0);
        }
        let beats = HeartbeatPage::open().map_err(|error| format!("heartbeat page: {error}"))?;
        let mut channels: Vec<Channel> = shell.subscriptions().collect();
        // The heartbeat page shows the watchdog too, at lower cost.
        channels.extend(watchdog_seen.filter(|_| beats.is_none()).map(|_| Channel::CmDataProcesses));
        // The watchdog lists the processes that may report that nothing engages PAUSE, or that the way is free.
        let believes = channels.iter().any(|channel| RELEASES.contains(channel));
        channels.extend(believes.then_some(Channel::CmDataProcesses));
        let wants_raw_bus = shell.module().wants_raw_bus();
        channels.sort_unstable_by_key(|channel| channel.name());
        channels.dedup();
        let channels: Vec<&str> = match wants_raw_bus {
            true => vec![".*"],
            false => channels.into_iter().map(Channel::name).collect(),
        };
        let bus =
            Bus::open_with_buffer(&config.lcm_url, &channels, if wants_raw_bus { RAW_RECEIVE_BUFFER } else { 0 })?;
        // The page of heartbeats follows when another watchdog takes over; without one, and without places in shared
        // memory, senders cannot be told from each other.
        let page = beats.as_ref().and_then(HeartbeatPage::watchdog);
        let watchdog = page.filter(|_| watchdog_seen.is_some() && bus.knows_senders());
        if believes && watchdog.is_none() && launch_is_none {
            notices.push(
                "the sender of a message cannot be identified here: every program that may command may also report \
                 that PAUSE is released, or that the way is free"
                    .into(),
            );
        }
        let specs = shell.module().ports();
        assert_eq!(specs.len(), config.ports.len(), "a place for each port");
        let taps = taps(config.raw, specs.len());
        let port = |((spec, config), tap): ((&PortSpec, PortConfig), &Option<_>)| {
            Port::new(spec.bus.clone(), config).expecting(spec.line, tap.is_some())
        };
        let ports: Vec<Port> = specs.iter().zip(config.ports).zip(&taps).map(port).collect();
        let polled = |errno: Errno| format!("epoll: {}", errno.desc());
        let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC).map_err(polled)?;
        let timer = TimerFd::new(ClockId::CLOCK_MONOTONIC, TimerFlags::TFD_NONBLOCK | TimerFlags::TFD_CLOEXEC)
            .map_err(|errno| format!("timerfd: {}", errno.desc()))?;
        epoll.add(&timer, EpollEvent::new(EpollFlags::EPOLLIN, TIMER)).map_err(polled)?;
        epoll.add(&signals, EpollEvent::new(EpollFlags::EPOLLIN, SIGNALS)).map_err(polled)?;
        epoll.add(&bus, EpollEvent::new(EpollFlags::EPOLLIN, BUS)).map_err(polled)?;
        let log = Log::new(shell.name());
        notices.extend(config.launch.as_mut().map(|launch| mem::take(&mut launch.notices)).unwrap_or_default());
        let processes = config.launch.map(|launch| Processes::new(clock::now(), launch, config.beats)).transpose()?;
        let mut lines: Vec<String> = limits::lock_memory().err().into_iter().map(|why| why.to_string()).collect();
        if let Some(processes) = &processes {
            epoll.add(processes, EpollEvent::new(EpollFlags::EPOLLIN, PROCESSES)).map_err(polled)?;
        }
        let parent = processes.is_some().then(|| ToParent::open(clock::now())).transpose();
        let recording = config.inputs.and_then(|inputs| {
            let refused = |error| lines.push(format!("inputs are not recorded: {}: {error}", inputs.run.display()));
            Recording::start(&mut shell, &inputs).map_err(refused).ok()
        });
        // A module that runs as another user is not told from other processes of that user.
        let kept = keepers::Place::all()?;
        config.policy.announcing.retain(|module| kept.iter().all(|place| place.module != *module));
        let epoch = clock::epoch();
        let beat = beats.map(|mut beats| beats.thread(clock::now(), "main")).transpose();
        Ok(Self {
            log,
            lines,
            notices,
            foreign: BTreeMap::new(),
            shell,
            recording,
            out: Actions::new(epoch),
            spare: Actions::new(epoch),
            bus,
            admission: Admission::new(config.policy, watchdog),
            second_robot: None,
            health: BusHealth::new(),
            bad: BadInput::default(),
            notes: vec![String::new(); ports.len()],
            taps,
            ports,
            processes,
            parent: parent.map_err(|error| format!("the parent's socket: {error}"))?.flatten(),
            watchdog_seen,
            reader: 0,
            epoll,
            timer,
            armed: None,
            real_time: sys::is_fifo(),
            signals,
            beat: beat.map_err(|error| format!("heartbeat page: {error}"))?,
            end: None,
        })
    }

    fn run(mut self) -> Result<u8, Failure> {
        // Processes that an earlier watchdog left come before everything else.
        self.report_processes();
        self.feed(Event::Start);
        for line in mem::take(&mut self.lines) {
            self.say(Level::Warning, &line);
        }
        for line in mem::take(&mut self.notices) {
            self.say(Level::Info, &format!("NOTICE: {line}"));
        }
        let mut ready = [EpollEvent::empty(); 16];
        loop {
            self.serve_time();
            // After what is due: the bus is polled although it did not become readable.
            if self.health.is_due(clock::now()) {
                self.serve_bus();
            }
            let now = clock::now();
            if let Some((code, until)) = self.end
                && (until <= now || self.ports.iter().all(|port| port.flushed(now)))
            {
                return Ok(code);
            }
            let count = self.wait(now, &mut ready).map_err(|errno| {
                let why = format!("epoll: {}", errno.desc());
                Failure { code: exit::WAIT, why }
            })?;
            for event in &ready[..count] {
                match event.data() {
                    // Setting the timer again clears its readiness.
                    TIMER => self.armed = None,
                    SIGNALS => self.serve_signals(),
                    BUS => self.health.more = true,
                    PROCESSES => self.serve_processes(),
                    port => self.port_ready((port - PORTS) as usize, event.events()),
                }
            }
            if self.health.more {
                self.serve_bus();
            }
            for index in 0..self.ports.len() {
                self.serve_port(index);
            }
            self.end_unsupervised();
            if self.bus.is_cut_off() {
                let name = self.shell.name();
                let why = format!("{name}: its file in shared memory was truncated: it ends, to be started again");
                return Err(Failure { code: exit::BUS_LOST, why });
            }
        }
    }

    /// Waits for any event; returns at once if unserved input is known.
    fn wait(&mut self, now: Instant, ready: &mut [EpollEvent]) -> nix::Result<usize> {
        let more = self.health.more || self.ports.iter().any(|port| port.more);
        let due = self.due();
        let timeout = match () {
            () if more => EpollTimeout::ZERO,
            () if self.real_time => match self.wait_exactly(due, ready) {
                // The kernel is older than 5.11.
                Err(Errno::ENOSYS | Errno::EPERM) => {
                    self.real_time = false;
                    return Ok(0);
                }
                result => return result,
            },
            () => {
                self.arm(now, due)?;
                EpollTimeout::NONE
            }
        };
        match self.epoll.wait(ready, timeout) {
            Err(Errno::EINTR) => Ok(0),
            result => result,
        }
    }

    /// Waits for any event until `due`, in a real-time thread. The timer interrupt itself ends the timeout of a system
    /// call of a real-time thread, exactly; with PREEMPT_RT a timerfd is served by a thread of low priority
    /// (docs/real-time.md).
    fn wait_exactly(&self, due: Option<Instant>, ready: &mut [EpollEvent]) -> nix::Result<usize> {
        let limit = due.map(|due| due.since(clock::now()));
        match sys::epoll_wait_exactly(&self.epoll, ready, limit) {
            Err(Errno::EINTR) => Ok(0),
            result => result,
        }
    }

    /// Next deadline of everything that this loop serves.
    fn due(&self) -> Option<Instant> {
        let shell = self.shell.poll_timeout();
        let ports = self.ports.iter().filter_map(Port::poll_timeout).min();
        let processes = self.processes.as_ref().and_then(Processes::poll_timeout);
        let taps = self.taps.iter().flatten().filter_map(|(_, tap)| tap.poll_timeout()).min();
        let end = self.end.map(|(_, until)| until);
        let beat = self.beat.as_ref().map(Heartbeat::next);
        let parent = self.parent.as_ref().map(ToParent::next);
        let unsupervised = self.watchdog_seen.map(|sign| sign + UNSUPERVISED_MAX);
        let second_robot = self.second_robot.map(|at| at + SECOND_ROBOT_END);
        earliest([shell, ports, taps, processes, end, beat, parent, unsupervised, second_robot])
    }

    fn arm(&mut self, now: Instant, due: Option<Instant>) -> nix::Result<()> {
        if due == self.armed && due.is_none_or(|due| due > now) {
            return Ok(());
        }
        self.armed = due;
        match due {
            // Zero would disarm the timer.
            Some(due) => {
                let at = TimeSpec::from_duration(std::time::Duration::from_nanos(due.as_nanos().max(1)));
                self.timer.set(Expiration::OneShot(at), TimerSetTimeFlags::TFD_TIMER_ABSTIME)
            }
            None => self.timer.unset(),
        }
    }

    /// Serves all deadlines that have passed.
    fn serve_time(&mut self) {
        let now = clock::now();
        if self.shell.poll_timeout().is_some_and(|due| due <= now) {
            self.feed(Event::Timer);
        }
        if self.beat.as_mut().is_some_and(|beat| beat.beat(now)) {
            self.check_watchdog(now);
        }
        self.end_second_robot(now);
        if let Some(trouble) = self.recording.as_mut().and_then(Recording::trouble) {
            self.raise(Fault::InputsLost, "inputs", trouble);
        }
        for index in 0..self.ports.len() {
            self.port_time(index);
            self.tap(index, |tap| tap.handle_timeout(now));
        }
        if let Some(processes) = &mut self.processes {
            processes.handle_timeout(now);
            self.report_processes();
        }
        // Last, after all the work whose progress it confirms.
        if let Some(parent) = &mut self.parent {
            parent.handle_timeout(now);
        }
    }

    fn serve_signals(&mut self) {
        while let Ok(Some(_)) = self.signals.read_signal() {
            self.shell.terminate(clock::now(), &mut self.out);
            self.act();
        }
    }

    fn serve_processes(&mut self) {
        // Messages sent before the end come first: a module that announced its end has not crashed.
        self.serve_bus();
        if let Some(processes) = &mut self.processes {
            processes.on_ends();
        }
        self.report_processes();
    }

    /// Reads the watchdog's counter in the heartbeat page.
    fn check_watchdog(&mut self, now: Instant) {
        if let (Some(beat), Some(_)) = (&self.beat, self.watchdog_seen) {
            let (reader, watchdog) = beat.reader();
            if mem::replace(&mut self.reader, reader) != reader {
                if let Some(watchdog) = watchdog {
                    self.admission.set_watchdog(watchdog);
                }
                self.on_watchdog_sign(now);
            }
        }
    }

    fn on_watchdog_sign(&mut self, now: Instant) {
        if let Some(sign) = &mut self.watchdog_seen {
            *sign = now;
            alarm::set(ALARM_S.0);
        }
    }

    /// Ends a module whose watchdog died and was not replaced. Decided only when all input has been read: after a delay
    /// of this process itself, the sign of a watchdog may still wait there.
    fn end_unsupervised(&mut self) {
        if self.health.more || self.watchdog_seen.is_none() {
            return;
        }
        let now = clock::now();
        let is_unsupervised =
            |watchdog_seen: Option<Instant>| watchdog_seen.is_some_and(|sign| now.since(sign) >= UNSUPERVISED_MAX);
        if !is_unsupervised(self.watchdog_seen) {
            return;
        }
        self.check_watchdog(now);
        if is_unsupervised(self.watchdog_seen) {
            self.watchdog_seen = None;
            alarm::set(ALARM_S.1);
            self.say(
                Level::Warning,
                &format!("no sign of a watchdog for {} s: the module ends", UNSUPERVISED_MAX.as_secs()),
            );
            self.shell.terminate(now, &mut self.out);
            self.act();
        }
    }

    fn serve_bus(&mut self) {
        for _ in 0..BURST {
            let now = clock::now();
            match self.receive(now) {
                FromBus::Nothing => {
                    self.on_bus_served(now);
                    self.report_datagrams(now);
                    self.report_ended_causes(now);
                    return;
                }
                FromBus::Message { at, message } => match self.judge(&message) {
                    Ok(()) => {
                        if let Channel::CmDataProcesses = message.channel() {
                            self.on_watchdog_sign(now);
                        }
                        if let Message::CmCmdLevel(command) = &message {
                            self.set_levels(now, command);
                        }
                        if self.shell.wants(message.channel()) {
                            let from = self.admission.origin(&message, self.bus.sender());
                            self.feed(Event::Message { at, from, message: &message });
                        }
                    }
                    Err(refusal) => self.refuse(now, &message, refusal),
                },
                FromBus::Foreign => {}
                FromBus::Malformed { subject, why } => {
                    self.reject_input(now, Fault::MessageMalformed, subject, why, 1);
                }
                FromBus::Broken(why) => {
                    self.health.more = false;
                    self.raise(Fault::PortDown, "lcm", why);
                    return;
                }
            }
        }
    }

    /// Decides whether a message is accepted. Another watchdog may have taken over a moment ago: the page shows it.
    /// A module may announce itself before the news of its start were read.
    fn judge(&mut self, message: &Message) -> Result<(), Refusal> {
        if let Some(processes) = self.processes.as_mut().filter(|_| self.admission.is_early(message)) {
            processes.on_starts();
            self.report_processes();
        }
        let sender = self.bus.sender();
        match (self.admission.judge(message, sender), self.beat.as_ref()) {
            (Err(Refusal::SecondRobot), Some(beat)) => match beat.reader().1 {
                Some(watchdog) if sender.process == Some(watchdog) => {
                    self.admission.set_watchdog(watchdog);
                    self.admission.judge(message, sender)
                }
                _ => Err(Refusal::SecondRobot),
            },
            (judged, _) => judged,
        }
    }

    /// Counts and reports a message that is not accepted.
    fn refuse(&mut self, now: Instant, message: &Message, refusal: Refusal) {
        let Sender { way, process } = self.bus.sender();
        let whom = match (way, process) {
            (Way::Network, _) => "another computer".to_string(),
            (_, Some(process)) => format!("process {}", process.pid),
            (_, None) => "a process of this computer that is not known".to_string(),
        };
        let channel = message.channel_name();
        match refusal {
            Refusal::SecondRobot => {
                self.second_robot = Some(now);
                let why = format!(
                    "{whom} publishes {channel}, too: two robots, or a robot and a simulated one, are on this bus. The \
                     robot stops; end one of them, or give it another --lcm-url"
                );
                let report = Report::new(Severity::Error, Fault::SecondRobot, "", why);
                self.shell.raise(now, report, &mut self.out);
                self.act();
            }
            Refusal::NotYet => {}
            Refusal::Command | Refusal::Release => {
                let why = match refusal {
                    Refusal::Command => "may not command this robot ([bus] commands in robot.toml)",
                    _ => "is not the process that is due to publish it",
                };
                let cause = format!("{channel} {way:?}").to_lowercase();
                self.reject_input(now, Fault::SenderRefused, cause, format!("{channel} dropped: {whom} {why}"), 1);
            }
        }
    }

    /// Clears the fault once the other watchdog is silent.
    fn end_second_robot(&mut self, now: Instant) {
        if self.second_robot.is_some_and(|at| now.since(at) >= SECOND_ROBOT_END) {
            self.second_robot = None;
            let report = Report::new(Severity::Notice, Fault::SecondRobot, "", "one robot is on this bus");
            self.shell.clear(now, report, &mut self.out);
            self.act();
        }
    }

    /// Receives a message. A module that wants the raw bus has received its bytes before; only the channels that it
    /// subscribes to are decoded.
    fn receive(&mut self, now: Instant) -> FromBus {
        if !self.shell.module().wants_raw_bus() {
            return self.bus.receive(now);
        }
        let follows_watchdog = self.watchdog_seen.is_some() && self.beat.is_none();
        let (shell, out) = (&mut self.shell, &mut self.out);
        let received = self.bus.receive_with(now, |at, raw| {
            shell.handle(now, Event::RawMessage { at, channel: raw.channel, data: raw.data }, out);
            let wanted = |channel| shell.wants(channel) || (channel == Channel::CmDataProcesses && follows_watchdog);
            Channel::from_name(raw.channel).is_some_and(wanted)
        });
        self.act();
        received
    }

    /// Passes an event to the module and executes the resulting actions.
    fn feed(&mut self, event: Event<'_>) {
        self.shell.handle(clock::now(), event, &mut self.out);
        self.act();
    }

    fn raise(&mut self, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        let report = Report::new(Severity::Warning, fault, subject, message);
        self.shell.raise(clock::now(), report, &mut self.out);
        self.act();
    }

    /// Prints and publishes a text for people in the module's name.
    fn say(&mut self, level: Level, text: &str) {
        self.shell.say(clock::now(), level, text, &mut self.out);
        self.act();
    }

    /// Executes all pending actions, including those that they cause.
    fn act(&mut self) {
        while !self.out.as_slice().is_empty() {
            // Each list has the epoch: an action may call this function again, which takes the spare list.
            let another = Actions::new(self.out.epoch());
            let mut actions = mem::replace(&mut self.out, mem::replace(&mut self.spare, another));
            for action in actions.drain() {
                self.act_on(action);
            }
            self.spare = actions;
        }
    }

    fn act_on(&mut self, action: Action) {
        match action {
            Action::Publish(message) => self.publish(&message),
            Action::Send(PortId(index), output) => self.send(usize::from(index), &output),
            Action::Report(report) => self.log.report(&report, self.shell.prints_places()),
            Action::Note(level, line) => self.log.text(level, line),
            Action::Process(ProcessCommand::Health { healthy, status }) => {
                if let Some(parent) = &mut self.parent {
                    parent.set(healthy, status);
                }
            }
            Action::Process(command) => {
                if let Some(processes) = &mut self.processes {
                    processes.command(command);
                }
                self.queue_news();
            }
            Action::Exit(code) => self.end = Some((code, clock::now() + FLUSH_TIMEOUT)),
            Action::Run(command) => self.run_command(&command),
            // Handled within the shell; the state is announced on the bus.
            Action::Raise(_) | Action::Clear(_) | Action::Condition(_) | Action::State(_) => {}
        }
    }

    /// Starts the program that halts the computer in its own process group, so that it outlives this process.
    fn run_command(&mut self, command: &[String]) {
        let Some((program, args)) = command.split_first() else { return };
        let started = Command::new(program).args(args).stdin(Stdio::null()).process_group(0).spawn();
        if let Err(error) = started {
            let text = format!("{program} cannot be run: {error}");
            self.shell.say(clock::now(), Level::Error, &text, &mut self.out);
        }
    }

    fn publish(&mut self, message: &Message) {
        // Without places in shared memory senders cannot be told from each other.
        if let Message::CmDataProcesses(list) = message
            && self.bus.knows_senders()
        {
            self.admission.on_own_list(list, keepers::own_user());
        }
        let (now, sent) = (clock::now(), self.bus.publish(message));
        let again = self.health.on_published(sent.is_ok());
        match sent {
            Ok(()) if again => {
                let report =
                    Report::new(Severity::Notice, Fault::PortDown, "lcm", "the LCM bus accepts messages again");
                self.shell.clear(now, report, &mut self.out);
            }
            Ok(()) => {}
            Err(why) => {
                let report = Report::new(Severity::Warning, Fault::PortDown, "lcm", why);
                self.shell.raise(now, report, &mut self.out);
            }
        }
    }

    /// All messages have been read. Reports lost messages once, and once the end of the loss.
    fn on_bus_served(&mut self, now: Instant) {
        let wants_raw_bus = self.shell.module().wants_raw_bus();
        let count = if wants_raw_bus { self.bus.missed() } else { self.bus.kernel_dropped() };
        match self.health.on_served(now, count) {
            None => {}
            Some(Losses::Growing) => {
                let why = "LCM bus: messages are lost, because they arrive faster than they are processed";
                self.raise(Fault::PortOverrun, "lcm", why);
            }
            Some(Losses::Ended) => {
                let message = format!("LCM bus: no message lost for {} s; {count} in all", LOSS_END.as_secs());
                let report = Report::new(Severity::Notice, Fault::PortOverrun, "lcm", message);
                self.shell.clear(now, report, &mut self.out);
                self.act();
            }
        }
    }

    /// Reports datagrams that are not LCM's. Every process receives them, so only the watchdog's process reports them.
    fn report_datagrams(&mut self, now: Instant) {
        if self.processes.is_none() {
            return;
        }
        let mut rejected = Vec::new();
        self.bus.rejected(|cause, why, count| rejected.push((cause, why, count)));
        for (cause, why, count) in rejected {
            self.reject_input(now, Fault::MessageMalformed, cause, why, count);
        }
    }

    /// Counts rejected input and reports each cause once.
    fn reject_input(&mut self, now: Instant, fault: Fault, cause: String, why: String, count: u64) {
        if self.bad.count(now, fault, &cause, count) {
            self.raise(fault, cause, why);
        }
    }

    fn report_ended_causes(&mut self, now: Instant) {
        while let Some((fault, cause, count)) = self.bad.take_ended(now) {
            let message =
                format!("{cause}: no further occurrence for {} s, {count} in all", bad_input::CAUSE_END.as_secs());
            let report = Report::new(Severity::Notice, fault, cause, message);
            self.shell.clear(now, report, &mut self.out);
            self.act();
        }
    }

    /// Passes news of the processes to the watchdog.
    fn report_processes(&mut self) {
        self.queue_news();
        self.act();
    }

    fn queue_news(&mut self) {
        let Some(processes) = &mut self.processes else {
            return;
        };
        let (shell, out) = (&mut self.shell, &mut self.out);
        while processes.poll_event(|news| shell.handle(clock::now(), Event::Process(news), out)) {}
        while let Some(note) = processes.poll_note() {
            shell.say(clock::now(), Level::Warning, &note, out);
        }
        while let Some(line) = self.processes.as_mut().and_then(Processes::poll_line) {
            self.relay(line);
        }
        self.publish_omitted();
    }

    /// Prints and publishes a line of a foreign module in that module's name.
    fn relay(&mut self, line: Line) {
        let Line { module, level, text, from } = line;
        if level >= from.print {
            Log::new(&module).text(level, OneLine(&text));
        }
        if level >= from.send {
            let now = clock::now();
            let timestamp = self.out.epoch().timestamp(now);
            let texts = self.foreign.entry(module.clone()).or_default();
            if let Some(message) = texts.take(now, timestamp, &module, level, &text) {
                self.publish(&message.into());
            }
        }
    }

    /// Changes the thresholds of the lines of foreign modules, and answers in their names; only in the watchdog.
    fn set_levels(&mut self, now: Instant, command: &CmdLevel) {
        let Some(processes) = &mut self.processes else {
            return;
        };
        let timestamp = self.out.epoch().timestamp(now);
        for (module, levels) in processes.set_levels(command) {
            self.publish(&levels.answer(timestamp, &module).into());
        }
        self.act();
    }

    /// Publishes the numbers of omitted lines of foreign modules.
    fn publish_omitted(&mut self) {
        let (now, epoch) = (clock::now(), self.out.epoch());
        let count = |(module, texts): (&String, &mut Texts)| texts.left_out(now, epoch.timestamp(now), module);
        let messages: Vec<Message> = self.foreign.iter_mut().filter_map(count).map(Message::from).collect();
        messages.iter().for_each(|message| self.publish(message));
    }

    fn send(&mut self, index: usize, output: &Output) {
        let Some(port) = self.ports.get_mut(index) else {
            return;
        };
        if port.state != PortState::Up {
            return;
        }
        let now = clock::now();
        match port.device.send(now, output) {
            Ok(true) => {
                if port.overrun && !port.device.wants_to_write() {
                    port.overrun = false;
                    let report = Report::new(
                        Severity::Notice,
                        Fault::PortOverrun,
                        &*port.name,
                        format!("{}: output is sent again", port.name),
                    );
                    self.shell.clear(now, report, &mut self.out);
                }
                self.watch_writing(index);
                self.tap(index, |tap| tap.sent(now, output));
            }
            Ok(false) => {
                port.overrun = true;
                let why = format!("{}: output is dropped, because the queue is full", port.name);
                let report = Report::new(Severity::Warning, Fault::PortOverrun, &*port.name, why);
                self.shell.raise(now, report, &mut self.out);
            }
            Err(reason) => self.lose(index, &reason),
        }
    }

    /// Watches for space in the send queue while output waits for it.
    fn watch_writing(&mut self, index: usize) {
        let port = &mut self.ports[index];
        let wants = port.device.wants_to_write();
        // Edge-triggered devices are always watched for writing.
        if wants == port.polls_write || port.device.by_edge() {
            return;
        }
        let mut flags = EpollFlags::EPOLLIN;
        flags.set(EpollFlags::EPOLLOUT, wants);
        let mut event = EpollEvent::new(flags, PORTS + index as u64);
        if let Some(fd) = port.device.fd()
            && self.epoll.modify(fd, &mut event).is_ok()
        {
            port.polls_write = wants;
        }
    }

    /// Closes a failed device. The module is informed at once; its actions are executed by `act`.
    fn lose(&mut self, index: usize, reason: &str) {
        let now = clock::now();
        // Closing the descriptor removes it from the epoll.
        self.ports[index].lose(now);
        let event = Event::Port { port: PortId(index as u8), input: Input::Down(reason) };
        self.shell.handle(now, event, &mut self.out);
    }

    /// Passes an event to the tap of a port and publishes the completed frames.
    fn tap(&mut self, index: usize, look: impl FnOnce(&mut Tap)) {
        let Some((bus, tap)) = self.taps.get_mut(index).and_then(Option::as_mut) else {
            return;
        };
        look(tap);
        let epoch = self.out.epoch();
        while let Some((at, mut frame)) = tap.take() {
            frame.timestamp = epoch.timestamp(at);
            // A failure is reported by the publication of the module's own messages.
            let _ = self.bus.publish(&Raw { bus: bus.clone(), frame }.into());
        }
    }

    fn port_time(&mut self, index: usize) {
        let now = clock::now();
        let id = PortId(index as u8);
        let reported = matches!(self.ports[index].state, PortState::Down { reported: true, .. });
        match self.ports[index].try_open(now) {
            Some(Ok(())) => match self.watch(index) {
                Ok(()) => self.feed(Event::Port { port: id, input: Input::Up }),
                Err(errno) => self.lose(index, errno.desc()),
            },
            // The port stays down, but the reason changed since the module was informed.
            Some(Err(reason)) if reported => {
                let text = format!("{}: {reason}", self.ports[index].name);
                self.say(Level::Warning, &text);
            }
            Some(Err(reason)) => self.feed(Event::Port { port: id, input: Input::Down(&reason) }),
            None => {}
        }
        while self.ports[index].device.take_sent(now) {
            self.feed(Event::Port { port: id, input: Input::Sent });
        }
    }

    fn watch(&mut self, index: usize) -> nix::Result<()> {
        let port = &self.ports[index];
        let flags = match port.device.by_edge() {
            true => EpollFlags::EPOLLIN | EpollFlags::EPOLLOUT | EpollFlags::EPOLLET,
            false => EpollFlags::EPOLLIN,
        };
        let event = EpollEvent::new(flags, PORTS + index as u64);
        port.device.fd().map_or(Ok(()), |fd| self.epoll.add(fd, event))
    }

    fn port_ready(&mut self, index: usize, flags: EpollFlags) {
        let Some(port) = self.ports.get_mut(index) else {
            return;
        };
        // An error or a hang-up is found by reading.
        port.more |= flags.intersects(EpollFlags::EPOLLIN | EpollFlags::EPOLLHUP | EpollFlags::EPOLLERR);
        if flags.contains(EpollFlags::EPOLLOUT) && port.state == PortState::Up {
            match port.device.on_writable(clock::now()) {
                Ok(()) => self.watch_writing(index),
                Err(reason) => self.lose(index, &reason),
            }
            self.act();
        }
    }

    fn serve_port(&mut self, index: usize) {
        let id = PortId(index as u8);
        for _ in 0..BURST {
            let port = &mut self.ports[index];
            if !port.more || port.state != PortState::Up {
                return;
            }
            let now = clock::now();
            match port.device.receive(now) {
                Ok(Received::Nothing) => port.more = false,
                Ok(Received::Input { input, at, .. }) => {
                    // The tap keeps the time of reception; the module's time is monotonic.
                    if let Some((_, tap)) = &mut self.taps[index] {
                        tap.received(at, &input);
                    }
                    self.shell.handle(now, Event::Port { port: id, input }, &mut self.out);
                }
                Ok(Received::Fault(fault, why)) => {
                    let name = port.name.clone();
                    let why = format!("{name}: {why}");
                    // Separate from faults of the output.
                    self.reject_input(now, fault, format!("{name} input"), why, 1);
                }
                Ok(Received::Note(text)) => {
                    if self.notes[index] != text {
                        let line = format!("{}: {text}", port.name);
                        self.shell.say(now, Level::Info, &line, &mut self.out);
                        self.notes[index] = text;
                    }
                }
                Err(reason) => self.lose(index, &reason),
            }
            self.act();
            // The module's reaction goes first.
            self.tap(index, |_| {});
        }
    }
}

fn taps(raw: Vec<Option<String>>, ports: usize) -> Vec<Option<(String, Tap)>> {
    let names = raw.into_iter().chain(std::iter::repeat(None)).take(ports);
    names.map(|name| name.map(|name| (name, Tap::default()))).collect()
}

/// Signals that are read from a descriptor instead of a handler.
fn signals() -> nix::Result<SignalFd> {
    let mut set = SigSet::empty();
    for signal in [Signal::SIGTERM, Signal::SIGINT] {
        set.add(signal);
    }
    set.thread_block()?;
    SignalFd::with_flags(&set, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC)
}
