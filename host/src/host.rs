//! One module as a process: one thread, one `epoll`, one timer.
//!
//! Each turn of the loop serves what is due, then every source a bounded number of times, so that a flood on one of
//! them delays the others by a turn at most.

use super::bad_input::{self, BadInput};
use super::beats::{Beat, Beats};
use super::bus::{Bus, Received as FromBus};
use super::bus_health::{BusHealth, LOSSES_OVER, Losses};
use super::clock;
use super::limits;
use super::log::{Log, OneLine};
use super::notify::ToParent;
use super::ports::{Port, PortConfig, PortState, Received};
use super::processes::{self, Launch, Line, Processes};
use super::raw::Tap;
use super::recorder::{Inputs, Recording};
use super::sys;
use base::{Duration, Fault, Instant, Level, Report, Severity, earliest};
use messages::{Channel, Message, Raw};
use module::texts::Texts;
use module::{Action, Actions, Event, Input, Output, PortId, PortSpec, ProcessCommand, Shell};
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

/// Inputs taken from one source in one turn.
const BURST: usize = 64;
/// A module that overhears has so many bytes of datagrams wait for it while it has no turn: a third of a second at
/// 50 MB/s.
const ROOM: usize = 16 << 20;
/// What a module sent last has this long to leave.
const FLUSH: Duration = Duration::from_millis(100);

/// A module that a watchdog started ends when it hears of none for this long.
const UNGUARDED: Duration = Duration::from_secs(3);
/// The kernel ends it after so many seconds, were it to hang meanwhile; and after so many more once it is ending.
const ALARM: (u32, u32) = (4, 3);

const TIMER: u64 = 0;
const SIGNALS: u64 = 1;
const BUS: u64 = 2;
const ENDS: u64 = 3;
const PORTS: u64 = 4;

/// Where a module finds what it needs.
pub struct HostConfig {
    /// The LCM bus.
    pub lcm_url: String,
    /// Ports, in the order of [`module::Module::ports`].
    pub ports: Vec<PortConfig>,
    /// For each port in turn the `<BUS>` of `LL_DATA_RAW_<BUS>`, where what crosses it is to be sent; what is missing
    /// is none.
    pub raw: Vec<Option<String>>,
    /// For the watchdog: how a module is started.
    pub launch: Option<Launch>,
    /// For the watchdog: the folder of the pages that modules beat in.
    pub beats: Option<PathBuf>,
    /// Where what the module is told is to be written down.
    pub inputs: Option<Inputs>,
}

/// Runs a module until it ends; its exit code. An error says what the machine refused at the start, in one line.
pub fn run(shell: Shell, config: HostConfig) -> Result<u8, String> {
    Host::open(shell, config)?.run()
}

struct Host {
    shell: Shell,
    /// Of the shell, and so dropped after it.
    recording: Option<Recording>,
    out: Actions,
    /// What `out` is swapped with while its actions are done.
    spare: Actions,
    log: Log,
    /// Lines about refused resources, published after the module's start.
    lines: Vec<String>,
    /// Notices about the configuration, published after the module's start; only the watchdog has any.
    notices: Vec<String>,
    /// Rate limiters for the lines of foreign modules; only the watchdog has any.
    foreign: BTreeMap<String, Texts>,
    bus: Bus,
    health: BusHealth,
    bad: BadInput,
    ports: Vec<Port>,
    /// The last note of each port: one that repeats itself is not printed again.
    notes: Vec<String>,
    /// The taps on those ports that are to be heard on the bus, and the bus's name there.
    taps: Vec<Option<(String, Tap)>>,
    processes: Option<Processes>,
    /// For the watchdog: whom it tells how it is.
    parent: Option<ToParent>,
    /// When the watchdog that started this process, or another one, was last heard; none: nobody guards it.
    guarded: Option<Instant>,
    /// What a watchdog has counted in the page of beats.
    reader: u32,
    epoll: Epoll,
    timer: TimerFd,
    armed: Option<Instant>,
    /// In real time it waits in another way; see [`Host::wait_exactly`].
    real_time: bool,
    signals: SignalFd,
    /// What tells the watchdog that this loop goes round.
    beat: Option<Beat>,
    end: Option<(u8, Instant)>,
}

impl Host {
    fn open(mut shell: Shell, mut config: HostConfig) -> Result<Self, String> {
        // Before anything else may start a thread: all of them inherit the mask.
        let signals = signals().map_err(|errno| format!("signalfd: {}", errno.desc()))?;
        let guarded = std::env::var_os(processes::VARIABLE).map(|_| clock::now());
        if guarded.is_some() {
            alarm::set(ALARM.0);
        }
        let beats = Beats::open().map_err(|error| format!("the page of beats: {error}"))?;
        let mut channels: Vec<Channel> = shell.subscriptions().collect();
        // The page of beats shows the watchdog too, at lower cost.
        channels.extend(guarded.filter(|_| beats.is_none()).map(|_| Channel::CmDataProcesses));
        let overhears = shell.module().overhears();
        channels.sort_unstable_by_key(|channel| channel.name());
        channels.dedup();
        let channels: Vec<&str> = match overhears {
            true => vec![".*"],
            false => channels.into_iter().map(Channel::name).collect(),
        };
        let bus = Bus::open_roomy(&config.lcm_url, &channels, if overhears { ROOM } else { 0 })?;
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
        let notices = config.launch.as_mut().map(|launch| mem::take(&mut launch.notices)).unwrap_or_default();
        let processes = config.launch.map(|launch| Processes::new(clock::now(), launch, config.beats)).transpose()?;
        let mut lines: Vec<String> = limits::lock_memory().err().into_iter().map(|why| why.to_string()).collect();
        if let Some(processes) = &processes {
            epoll.add(processes, EpollEvent::new(EpollFlags::EPOLLIN, ENDS)).map_err(polled)?;
        }
        let parent = processes.is_some().then(|| ToParent::open(clock::now())).transpose();
        let recording = config.inputs.and_then(|inputs| {
            let refused = |error| lines.push(format!("inputs are not recorded: {}: {error}", inputs.run.display()));
            Recording::start(&mut shell, &inputs).map_err(refused).ok()
        });
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
            health: BusHealth::new(),
            bad: BadInput::default(),
            notes: vec![String::new(); ports.len()],
            taps,
            ports,
            processes,
            parent: parent.map_err(|error| format!("the parent's socket: {error}"))?.flatten(),
            guarded,
            reader: 0,
            epoll,
            timer,
            armed: None,
            real_time: sys::is_fifo(),
            signals,
            beat: beat.map_err(|error| format!("the page of beats: {error}"))?,
            end: None,
        })
    }

    fn run(mut self) -> Result<u8, String> {
        // What an earlier life left comes before anything else.
        self.tell_of_processes();
        self.feed(Event::Start);
        for line in mem::take(&mut self.lines) {
            self.say(Level::Warning, &line);
        }
        for line in mem::take(&mut self.notices) {
            self.say(Level::Info, &format!("NOTICE: {line}"));
        }
        if let (Some(processes), Some(due)) = (&mut self.processes, self.shell.poll_timeout()) {
            processes.align(clock::now(), due);
        }
        let mut ready = [EpollEvent::empty(); 16];
        loop {
            self.serve_time();
            // After what is due: nothing has come there, it is only looked after.
            if self.health.is_due(clock::now()) {
                self.serve_bus();
            }
            let now = clock::now();
            if let Some((code, until)) = self.end
                && (until <= now || self.ports.iter().all(|port| port.flushed(now)))
            {
                return Ok(code);
            }
            let count = self.wait(now, &mut ready).map_err(|errno| format!("epoll: {}", errno.desc()))?;
            for event in &ready[..count] {
                match event.data() {
                    // Setting it anew is what makes it quiet.
                    TIMER => self.armed = None,
                    SIGNALS => self.serve_signals(),
                    BUS => self.health.more = true,
                    ENDS => self.serve_ends(),
                    port => self.port_ready((port - PORTS) as usize, event.events()),
                }
            }
            if self.health.more {
                self.serve_bus();
            }
            for index in 0..self.ports.len() {
                self.serve_port(index);
            }
            self.end_unguarded();
        }
    }

    /// Waits for anything, unless more is known to be there.
    fn wait(&mut self, now: Instant, ready: &mut [EpollEvent]) -> nix::Result<usize> {
        let more = self.health.more || self.ports.iter().any(|port| port.more);
        let due = self.due();
        let timeout = match () {
            () if more => EpollTimeout::ZERO,
            () if self.real_time => match self.wait_exactly(due, ready) {
                // A kernel before 5.11.
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

    /// Waits for anything until `due`, in real time. The time limit of a real-time thread's own system call is kept by
    /// the clock's interrupt itself, and exactly; what a timerfd tells is on a kernel with PREEMPT_RT told by a thread
    /// of low priority (docs/real-time.md).
    fn wait_exactly(&self, due: Option<Instant>, ready: &mut [EpollEvent]) -> nix::Result<usize> {
        let limit = due.map(|due| due.since(clock::now()));
        match sys::epoll_wait_exactly(&self.epoll, ready, limit) {
            Err(Errno::EINTR) => Ok(0),
            result => result,
        }
    }

    /// When something is due next.
    fn due(&self) -> Option<Instant> {
        let shell = self.shell.poll_timeout();
        let ports = self.ports.iter().filter_map(Port::poll_timeout).min();
        let processes = self.processes.as_ref().and_then(Processes::poll_timeout);
        let taps = self.taps.iter().flatten().filter_map(|(_, tap)| tap.poll_timeout()).min();
        let end = self.end.map(|(_, until)| until);
        let beat = self.beat.as_ref().map(Beat::next);
        let parent = self.parent.as_ref().map(ToParent::next);
        let unguarded = self.guarded.map(|heard| heard + UNGUARDED);
        earliest([shell, ports, taps, processes, end, beat, parent, unguarded])
    }

    fn arm(&mut self, now: Instant, due: Option<Instant>) -> nix::Result<()> {
        if due == self.armed && due.is_none_or(|due| due > now) {
            return Ok(());
        }
        self.armed = due;
        match due {
            // Zero would disarm it.
            Some(due) => {
                let at = TimeSpec::from_duration(std::time::Duration::from_nanos(due.as_nanos().max(1)));
                self.timer.set(Expiration::OneShot(at), TimerSetTimeFlags::TFD_TIMER_ABSTIME)
            }
            None => self.timer.unset(),
        }
    }

    /// Whatever is due by the clock.
    fn serve_time(&mut self) {
        let now = clock::now();
        if self.shell.poll_timeout().is_some_and(|due| due <= now) {
            self.feed(Event::Timer);
        }
        if self.beat.as_mut().is_some_and(|beat| beat.beat(now)) {
            self.look_for_watchdog(now);
        }
        if let Some(trouble) = self.recording.as_mut().and_then(Recording::trouble) {
            self.raise(Fault::InputsLost, "inputs", trouble);
        }
        for index in 0..self.ports.len() {
            self.port_time(index);
            self.tap(index, |tap| tap.handle_timeout(now));
        }
        if let Some(processes) = &mut self.processes {
            processes.handle_timeout(now);
            self.tell_of_processes();
        }
        // After all that it is to vouch for.
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

    fn serve_ends(&mut self) {
        // What it was told before it ended comes first: one that was told to end has not died.
        self.serve_bus();
        if let Some(processes) = &mut self.processes {
            processes.on_ends();
        }
        self.tell_of_processes();
    }

    /// It counts in the page of beats.
    fn look_for_watchdog(&mut self, now: Instant) {
        if let (Some(beat), Some(_)) = (&self.beat, self.guarded) {
            let reader = beat.reader();
            if mem::replace(&mut self.reader, reader) != reader {
                self.hear_watchdog(now);
            }
        }
    }

    fn hear_watchdog(&mut self, now: Instant) {
        if let Some(heard) = &mut self.guarded {
            *heard = now;
            alarm::set(ALARM.0);
        }
    }

    /// Ends a module whose watchdog was not replaced. Asked when all that has come is read: after having been held up
    /// itself it finds there whether one was heard.
    fn end_unguarded(&mut self) {
        if self.health.more || self.guarded.is_none() {
            return;
        }
        let now = clock::now();
        let unheard = |guarded: Option<Instant>| guarded.is_some_and(|heard| now.since(heard) >= UNGUARDED);
        if !unheard(self.guarded) {
            return;
        }
        self.look_for_watchdog(now);
        if unheard(self.guarded) {
            self.guarded = None;
            alarm::set(ALARM.1);
            self.say(Level::Warning, &format!("no watchdog was heard for {} s: it ends", UNGUARDED.as_secs()));
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
                    self.watch_datagrams(now);
                    self.tell_what_is_over(now);
                    return;
                }
                FromBus::Message { at, message } => {
                    if let Channel::CmDataProcesses = message.channel() {
                        self.hear_watchdog(now);
                    }
                    self.feed(Event::Message { at, message: &message });
                }
                FromBus::Foreign => {}
                FromBus::Malformed { subject, why } => {
                    self.drop_bad(now, Fault::MessageMalformed, subject, why, 1);
                }
                FromBus::Broken(why) => {
                    self.health.more = false;
                    self.raise(Fault::PortDown, "lcm", why);
                    return;
                }
            }
        }
    }

    /// Takes a message; a module that overhears has been told of it as bytes, and decoded is what it wants besides.
    fn receive(&mut self, now: Instant) -> FromBus {
        if !self.shell.module().overhears() {
            return self.bus.receive(now);
        }
        let follows_watchdog = self.guarded.is_some() && self.beat.is_none();
        let (shell, out) = (&mut self.shell, &mut self.out);
        let received = self.bus.overhear(now, |at, raw| {
            shell.handle(now, Event::Heard { at, channel: raw.channel, data: raw.data }, out);
            let wanted = |channel| shell.wants(channel) || (channel == Channel::CmDataProcesses && follows_watchdog);
            Channel::from_name(raw.channel).is_some_and(wanted)
        });
        self.act();
        received
    }

    /// Hands the module an event, and does what follows from it.
    fn feed(&mut self, event: Event<'_>) {
        self.shell.handle(clock::now(), event, &mut self.out);
        self.act();
    }

    fn raise(&mut self, fault: Fault, subject: impl Into<String>, message: impl Into<String>) {
        let report = Report::new(Severity::Warning, fault, subject, message);
        self.shell.raise(clock::now(), report, &mut self.out);
        self.act();
    }

    /// Prints and publishes a line for people in the module's name.
    fn say(&mut self, level: Level, text: &str) {
        self.shell.say(clock::now(), level, text, &mut self.out);
        self.act();
    }

    /// Does all that was asked for, and what follows from that.
    fn act(&mut self) {
        while !self.out.as_slice().is_empty() {
            // Each list has the epoch: what an action leads to may come here again, and take the spare one.
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
            Action::Report(report) => self.log.report(&report),
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
            Action::Exit(code) => self.end = Some((code, clock::now() + FLUSH)),
            Action::Run(command) => self.run_command(&command),
            // The shell keeps these to itself, except the state, which is announced on the bus.
            Action::Raise(_) | Action::Clear(_) | Action::Condition(_) | Action::State(_) => {}
        }
    }

    /// Starts what halts the computer, in a process group of its own: it must outlive us.
    fn run_command(&mut self, command: &[String]) {
        let Some((program, args)) = command.split_first() else { return };
        let started = Command::new(program).args(args).stdin(Stdio::null()).process_group(0).spawn();
        if let Err(error) = started {
            let text = format!("{program} cannot be run: {error}");
            self.shell.say(clock::now(), Level::Error, &text, &mut self.out);
        }
    }

    fn publish(&mut self, message: &Message) {
        let (now, sent) = (clock::now(), self.bus.publish(message));
        let again = self.health.on_published(sent.is_ok());
        match sent {
            Ok(()) if again => {
                let report = Report::new(Severity::Notice, Fault::PortDown, "lcm", "LCM bus: messages leave again");
                self.shell.clear(now, report, &mut self.out);
            }
            Ok(()) => {}
            Err(why) => {
                let report = Report::new(Severity::Warning, Fault::PortDown, "lcm", why);
                self.shell.raise(now, report, &mut self.out);
            }
        }
    }

    /// All messages have been read. Reports once that some came faster than they were read, and once that this is over.
    fn on_bus_served(&mut self, now: Instant) {
        let overhears = self.shell.module().overhears();
        let count = if overhears { self.bus.missed() } else { self.bus.kernel_dropped() };
        match self.health.on_served(now, count) {
            None => {}
            Some(Losses::Grow) => {
                let why = "LCM bus: messages are lost: they come faster than they are taken";
                self.raise(Fault::PortOverrun, "lcm", why);
            }
            Some(Losses::Over) => {
                let message = format!("LCM bus: no message lost for {} s; {count} in all", LOSSES_OVER.as_secs());
                let report = Report::new(Severity::Notice, Fault::PortOverrun, "lcm", message);
                self.shell.clear(now, report, &mut self.out);
                self.act();
            }
        }
    }

    /// Tells of datagrams that are no messages. They are for nobody in particular, so one process tells for the whole
    /// robot: the one that starts the others.
    fn watch_datagrams(&mut self, now: Instant) {
        if self.processes.is_none() {
            return;
        }
        let mut rejected = Vec::new();
        self.bus.rejected(|cause, why, count| rejected.push((cause, why, count)));
        for (cause, why, count) in rejected {
            self.drop_bad(now, Fault::MessageMalformed, cause, why, count);
        }
    }

    /// Counts input that is dropped, and tells of each cause once.
    fn drop_bad(&mut self, now: Instant, fault: Fault, cause: String, why: String, count: u64) {
        if self.bad.count(now, fault, &cause, count) {
            self.raise(fault, cause, why);
        }
    }

    fn tell_what_is_over(&mut self, now: Instant) {
        while let Some((fault, cause, count)) = self.bad.take_over(now) {
            let message = format!("{cause}: well for {} s; it was so {count} times", bad_input::OVER.as_secs());
            let report = Report::new(Severity::Notice, fault, cause, message);
            self.shell.clear(now, report, &mut self.out);
            self.act();
        }
    }

    /// Tells the watchdog what became of its processes.
    fn tell_of_processes(&mut self) {
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
        self.count_left_out();
    }

    /// Prints and publishes a line of a foreign module in its name.
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

    /// Publishes the numbers of omitted lines of foreign modules.
    fn count_left_out(&mut self) {
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
                        format!("{}: output leaves again", port.name),
                    );
                    self.shell.clear(now, report, &mut self.out);
                }
                self.watch_writing(index);
                self.tap(index, |tap| tap.sent(now, output));
            }
            Ok(false) => {
                port.overrun = true;
                let why = format!("{}: output is dropped: it does not leave", port.name);
                let report = Report::new(Severity::Warning, Fault::PortOverrun, &*port.name, why);
                self.shell.raise(now, report, &mut self.out);
            }
            Err(reason) => self.lose(index, &reason),
        }
    }

    /// Waits for room to write exactly while something waits for it.
    fn watch_writing(&mut self, index: usize) {
        let port = &mut self.ports[index];
        let wants = port.device.wants_to_write();
        // Told by edges it is always watched.
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

    /// The device is lost: told to the module now, done by `act`.
    fn lose(&mut self, index: usize, reason: &str) {
        let now = clock::now();
        // Closing its descriptor takes it out of the epoll.
        self.ports[index].lose(now);
        let event = Event::Port { port: PortId(index as u8), input: Input::Down(reason) };
        self.shell.handle(now, event, &mut self.out);
    }

    /// Lets the tap of a port see something, and sends what it makes of it.
    fn tap(&mut self, index: usize, look: impl FnOnce(&mut Tap)) {
        let Some((bus, tap)) = self.taps.get_mut(index).and_then(Option::as_mut) else {
            return;
        };
        look(tap);
        let epoch = self.out.epoch();
        while let Some((at, mut frame)) = tap.take() {
            frame.timestamp = epoch.timestamp(at);
            // Whether the bus takes messages is told by those that matter.
            let _ = self.bus.publish(&Raw { bus: bus.clone(), frame }.into());
        }
    }

    fn port_time(&mut self, index: usize) {
        let now = clock::now();
        let id = PortId(index as u8);
        let told = matches!(self.ports[index].state, PortState::Down { told: true, .. });
        match self.ports[index].try_open(now) {
            Some(Ok(())) => match self.watch(index) {
                Ok(()) => self.feed(Event::Port { port: id, input: Input::Up }),
                Err(errno) => self.lose(index, errno.desc()),
            },
            // It stays down, and for another reason than the module was told.
            Some(Err(reason)) if told => {
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
                    // The record has the time of reception; the module's time never goes back.
                    if let Some((_, tap)) = &mut self.taps[index] {
                        tap.received(at, &input);
                    }
                    self.shell.handle(now, Event::Port { port: id, input }, &mut self.out);
                }
                Ok(Received::Fault(fault, why)) => {
                    let name = port.name.clone();
                    let why = format!("{name}: {why}");
                    // Apart from what is wrong with the output.
                    self.drop_bad(now, fault, format!("{name} input"), why, 1);
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
            // What the module makes of it comes first.
            self.tap(index, |_| {});
        }
    }
}

fn taps(raw: Vec<Option<String>>, ports: usize) -> Vec<Option<(String, Tap)>> {
    let names = raw.into_iter().chain(std::iter::repeat(None)).take(ports);
    names.map(|name| name.map(|name| (name, Tap::default()))).collect()
}

/// The signals that a process of ours hears by its loop and not by a handler.
fn signals() -> nix::Result<SignalFd> {
    let mut set = SigSet::empty();
    for signal in [Signal::SIGTERM, Signal::SIGINT] {
        set.add(signal);
    }
    set.thread_block()?;
    SignalFd::with_flags(&set, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC)
}
