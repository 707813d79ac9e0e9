//! The virtual host: many processes, the LCM bus and all wires in one thread, in virtual time.
//!
//! Every event has a time in integer nanoseconds and, among equal times, a number in order of scheduling. All
//! randomness comes from streams of one seed. The same seed and the same calls give the same run to the last bit, which
//! [`Virtual::digest`] proves.
//!
//! Modelled: LCM as a multicast that reaches every process including the sender's, with latency and loss; CAN with
//! exact frame lengths, arbitration and error confinement (`can`); serial lines with 11 bits per word and collisions
//! (`serial`); I2C with the duration of its bits (`i2c`), 1-Wire with that of a search or a measurement (`w1`); disks
//! that lose unsynchronized data in a power failure ([`Disk`]); processes that are started, ended, killed, hung or
//! slow, send heartbeats as live ones do, and outlive their watchdog for a while; and the effect of faults on all of
//! these. A process accepts only the senders that [`Config::policy`] names, as in the live host. Not modelled:
//! computing time (an event is served at once, or with a given latency), resource usage
//! ([`module::ProcessEvent::Usage`] is never sent), and the reports of messages that are not accepted.

mod agenda;
mod can;
mod config;
mod digest;
mod gamepad;
mod i2c;
mod life;
mod news;
mod owner;
mod serial;
mod served;
#[cfg(test)]
mod simulator_tests;
mod store;
#[cfg(test)]
mod tests;
mod thermal;
mod w1;
mod wire;

pub use config::Config;
pub use news::{News, Traffic};
pub use store::{Disk, Stored};

use agenda::{Entry, Happening, SentMessage, Waiting};
use base::can::Frame;
use base::gamepad::Event as GamepadEvent;
use base::serial::Word;
use base::store::{Answer, Request};
use base::{Duration, Fault, Instant, Report, Severity};
use can::WireEvent;
use digest::Digest;
use life::{Kept, Life};
use messages::{Channel, Message};
use module::admission::{self, Admission, RELEASES, Refusal, SECOND_ROBOT_END, Sender, Way};
use module::{Action, Actions, Event, ExitStatus, Input, Output, PortId, ProcessCommand, ProcessEvent, Shell, State};
use owner::Owner;
use simulator::Random;
use simulator::disturbance::{Disturbance, part};
use simulator::faults::{self, InjectedFault};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::mem;
use std::rc::Rc;
use store::Backing;
use wire::{Kind, Wire, open};

/// Number of SIGKILL.
const SIGKILL: i32 = 9;
/// Reason of a port that is down because its CAN controller is bus-off.
const BUS_OFF: &str = "bus-off";
/// First process id.
const FIRST_PID: u32 = 1000;
/// Maximum number of pending inputs of a hung process; further ones are dropped, as by full socket buffers.
const BACKLOG_MAX: usize = 1024;
/// Maximum number of times in a row that a module may be due at once.
const SPIN_MAX: u32 = 10_000;
/// Name of the LCM bus as a target of faults.
const LCM: &str = "lcm";
/// Message when a recorder has no room.
const GAPS_TEXT: &str = "the record of inputs is incomplete: the disk takes nothing";
/// Maximum delay of the second copy of a duplicated message.
const DUPLICATE_WITHIN: Duration = Duration::from_millis(2);

/// A process.
struct Process {
    pid: u32,
    /// Process that is informed of its end; 0: none.
    parent: u32,
    module: Rc<str>,
    shell: Shell,
    /// Wires of its ports.
    wires: Vec<usize>,
    life: Life,
    /// Which senders it accepts.
    admission: Admission,
    /// Time at which it last received the watchdog of another robot, while that is reported.
    second_robot: Option<Instant>,
    /// Actions, with the epoch at the start of the process.
    out: Actions,
    /// The loss of inputs was reported.
    told_of_gaps: bool,
    /// Time of its last timer event, and the number of them at that time.
    spin: (Instant, u32),
}

impl Process {
    /// True for a channel of its module, and the list of processes, by which a guarded process knows from which senders
    /// to accept that all is well.
    fn hears(&self, channel: Channel) -> bool {
        let learns = || self.admission.is_guarded() && RELEASES.iter().any(|channel| self.shell.wants(*channel));
        self.shell.wants(channel) || channel == Channel::CmDataProcesses && learns()
    }
}

/// Creates a module's shell by name, with its wanted state. The error is the reason in one line.
pub type Factory = Box<dyn FnMut(&str, State) -> Result<Shell, String>>;
/// Receives all news with their times.
pub type Observer = Box<dyn FnMut(Instant, &News<'_>)>;

/// A machine in virtual time.
pub struct Virtual {
    config: Config,
    factory: Factory,
    observers: Vec<Observer>,
    now: Instant,
    number: u64,
    agenda: BinaryHeap<Reverse<Entry>>,
    processes: Vec<Process>,
    wires: Vec<Wire>,
    /// Timers of the processes and of the wires, in their order: apart from them, since all are compared before every
    /// event.
    process_timers: Vec<Timer>,
    wire_timers: Vec<Timer>,
    next_pid: u32,
    kept: Vec<Kept>,
    /// State of each module that is kept for the next watchdog.
    remembered: BTreeMap<String, (State, bool)>,
    /// A check of heartbeats is scheduled.
    looking: bool,
    lcm: Random,
    lcm_disturbance: Disturbance,
    /// Arrival time of each process's last message.
    arrivals: BTreeMap<u32, Instant>,
    digest: Digest,
    bytes: Vec<u8>,
    ports: Vec<Owner>,
    /// What is to execute the requests of ports that are not open yet, by bus.
    backings: Vec<(String, Backing)>,
}

/// Deadline of a process or a wire, and its number in order of scheduling; `None`: there is none.
type Timer = Option<(Instant, u64)>;

/// Next event.
enum Next {
    Agenda,
    Process(usize),
    Wire(usize),
}

impl Virtual {
    /// Creates a machine at time zero without processes.
    #[must_use]
    pub fn new(config: Config, factory: impl FnMut(&str, State) -> Result<Shell, String> + 'static) -> Self {
        Self {
            factory: Box::new(factory),
            observers: Vec::new(),
            now: Instant::ZERO,
            number: 0,
            agenda: BinaryHeap::new(),
            processes: Vec::new(),
            wires: Vec::new(),
            process_timers: Vec::new(),
            wire_timers: Vec::new(),
            next_pid: FIRST_PID,
            kept: Vec::new(),
            remembered: BTreeMap::new(),
            looking: false,
            lcm: Random::stream(config.seed, 1),
            lcm_disturbance: Disturbance::default(),
            arrivals: BTreeMap::new(),
            digest: Digest::new(config.seed),
            bytes: Vec::new(),
            ports: Vec::new(),
            backings: Vec::new(),
            config,
        }
    }

    /// Adds an observer.
    pub fn observe(&mut self, observer: impl FnMut(Instant, &News<'_>) + 'static) {
        self.observers.push(Box::new(observer));
    }

    /// Current time.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.now
    }

    /// Digest of everything sent so far.
    #[must_use]
    pub fn digest(&self) -> u64 {
        self.digest.value()
    }

    /// All processes in order of their ids: id, module.
    pub fn processes(&self) -> impl Iterator<Item = (u32, &str)> {
        self.processes.iter().map(|process| (process.pid, &*process.module))
    }

    /// Latest process of a module.
    #[must_use]
    pub fn pid(&self, module: &str) -> Option<u32> {
        self.processes.iter().rev().find(|process| &*process.module == module).map(|process| process.pid)
    }

    /// State of a process; `None` if it does not exist.
    #[must_use]
    pub fn state(&self, pid: u32) -> Option<State> {
        self.place(pid).map(|place| self.processes[place].shell.state())
    }

    /// Shell of a process, for inspection.
    #[must_use]
    pub fn shell(&self, pid: u32) -> Option<&Shell> {
        self.place(pid).map(|place| &self.processes[place].shell)
    }

    /// Traffic on a bus; `None` if no port was ever on it.
    #[must_use]
    pub fn traffic(&self, bus: &str) -> Option<Traffic> {
        self.wires.iter().find(|wire| &*wire.bus == bus).map(Wire::traffic)
    }

    /// Disk behind a port for log files; `None` if no such port was ever opened.
    pub fn disk(&mut self, bus: &str) -> Option<&mut Disk> {
        self.wires.iter_mut().find(|wire| &*wire.bus == bus).and_then(|wire| match &mut wire.kind {
            Kind::Store(wire) => Some(&mut wire.server.disk),
            _ => None,
        })
    }

    /// Lets `perform` execute the requests of the port for log files on `bus`, which is opened later, in the place of a
    /// [`Disk`]. The requests take the same virtual time.
    pub fn back(&mut self, bus: &str, perform: impl FnMut(Request) -> Answer + 'static) {
        self.backings.push((bus.into(), Backing(Box::new(perform))));
    }

    /// Starts a process that is not supervised.
    ///
    /// # Errors
    /// One line: the factory's reason, or that a port does not fit its bus.
    pub fn spawn(&mut self, module: &str, wanted: State) -> Result<u32, String> {
        self.start(0, module, wanted)
    }

    /// Asks a process to end, as SIGTERM does.
    pub fn terminate(&mut self, pid: u32) {
        self.tell(pid, Waiting::Terminate);
    }

    /// Ends a process now, as SIGKILL does.
    pub fn kill(&mut self, pid: u32) {
        self.end(pid, ExitStatus::Signal(SIGKILL));
    }

    /// Sends a message at a given time (now, if that is past), as process 0 of the robot's user.
    pub fn inject(&mut self, at: Instant, message: impl Into<Message>) {
        self.inject_by(at, sender(0), message);
    }

    /// The same, from any sender.
    pub fn inject_by(&mut self, at: Instant, sender: Sender, message: impl Into<Message>) {
        self.schedule(at.max(self.now), Happening::Inject(SentMessage { sender, message: message.into() }));
    }

    /// Sends a frame at a given time (now, if that is past), as a node on a CAN bus that belongs to nobody; false if no
    /// port was ever on that bus.
    pub fn inject_frame(&mut self, at: Instant, bus: &str, frame: Frame) -> bool {
        let place = self.wires.iter().position(|wire| &*wire.bus == bus && matches!(wire.kind, Kind::Can(_)));
        if let Some(place) = place {
            self.schedule(at.max(self.now), Happening::Frame(place, frame));
        }
        place.is_some()
    }

    /// Sends an event of a gamepad that no process simulates; false if no port of that bus was ever opened.
    pub fn gamepad(&mut self, bus: &str, event: GamepadEvent) -> bool {
        let place = self.wires.iter().position(|wire| &*wire.bus == bus && matches!(wire.kind, Kind::Gamepad(_)));
        if let Some(place) = place {
            self.gamepad_tells(place, Owner { pid: 0, port: PortId(0) }, event);
        }
        place.is_some()
    }

    /// Injects a fault into a bus for a duration in s (0: permanent), like `SIM_CMD_FAULT` with the bus as its target;
    /// `lcm` is a bus, too. False if the bus does not exist or has no such fault.
    pub fn fault(&mut self, target: &str, fault: &str, value: f64, lasts: f64) -> bool {
        let (now, until) = (self.now, faults::until(self.now, lasts));
        let Some(injected) = InjectedFault::from_name(fault, value) else { return false };
        let place = self.wires.iter().position(|wire| &*wire.bus == target);
        let known = match place {
            Some(place) => self.wires[place].inject(now, injected, until),
            None if target == LCM && matches!(injected, InjectedFault::Noise(_)) => false,
            None if target == LCM => self.lcm_disturbance.inject(now, injected, until),
            None => false,
        };
        if known {
            self.news(&News::Fault { target, fault, until });
        }
        if let Some(place) = place {
            // Immediate effects are reported after the fault.
            self.pass_events(place);
            self.arm_wire(place);
        }
        known
    }

    /// Processes all events up to and including `end`.
    ///
    /// # Panics
    /// A module is due at once again and again: a live host would spin.
    pub fn run_until(&mut self, end: Instant) {
        while let Some((at, next)) = self.next().filter(|(at, _)| *at <= end) {
            self.now = self.now.max(at);
            match next {
                Next::Agenda => self.serve_agenda(),
                Next::Process(place) => self.serve_timer(place),
                Next::Wire(place) => self.serve_wire(place),
            }
        }
        self.now = self.now.max(end);
    }

    fn next(&self) -> Option<(Instant, Next)> {
        // There are at most a dozen, and this is called before every event: plain loops instead of chained iterators.
        let mut first = self.agenda.peek().map(|Reverse(entry)| ((entry.at, entry.number), Next::Agenda));
        let mut sooner = |timer: &Timer, next| {
            if let Some(due) = *timer
                && first.as_ref().is_none_or(|(key, _)| due < *key)
            {
                first = Some((due, next));
            }
        };
        for (place, timer) in self.wire_timers.iter().enumerate() {
            sooner(timer, Next::Wire(place));
        }
        for (place, timer) in self.process_timers.iter().enumerate() {
            sooner(timer, Next::Process(place));
        }
        first.map(|((at, _), next)| (at, next))
    }

    fn number(&mut self) -> u64 {
        self.number += 1;
        self.number
    }

    fn schedule(&mut self, at: Instant, happening: Happening) {
        let number = self.number();
        self.agenda.push(Reverse(Entry { at, number, happening }));
    }

    fn place(&self, pid: u32) -> Option<usize> {
        self.processes.iter().position(|process| process.pid == pid)
    }

    fn news(&mut self, news: &News<'_>) {
        for observer in &mut self.observers {
            observer(self.now, news);
        }
    }

    fn start(&mut self, parent: u32, module: &str, wanted: State) -> Result<u32, String> {
        let shell = (self.factory)(module, wanted)?;
        let pid = self.next_pid;
        let specs = shell.module().ports();
        let mut wires = Vec::with_capacity(specs.len());
        for spec in specs {
            let wire = open(&mut self.wires, &self.config, &spec.bus, spec.line)?;
            if let Kind::Store(store) = &mut self.wires[wire].kind
                && let Some(place) = self.backings.iter().position(|(bus, _)| *bus == spec.bus)
            {
                store.server.backing = Some(self.backings.swap_remove(place).1);
            }
            wires.push(wire);
            self.wire_timers.resize(self.wires.len(), None);
        }
        self.next_pid += 1;
        self.process_timers.push(None);
        self.processes.push(Process {
            pid,
            parent,
            module: module.into(),
            shell,
            wires,
            life: Life::new(),
            admission: Admission::new(self.config.policy.clone(), (parent != 0).then(|| of_robot(parent))),
            second_robot: None,
            out: Actions::new(self.config.epoch),
            told_of_gaps: false,
            spin: (Instant::ZERO, 0),
        });
        self.schedule(self.now + self.config.start_delay, Happening::Tell(pid, Waiting::Start));
        self.news(&News::Started { module, pid });
        Ok(pid)
    }

    fn serve_agenda(&mut self) {
        let Some(Reverse(entry)) = self.agenda.pop() else {
            return;
        };
        match entry.happening {
            Happening::Deliver(message) => self.deliver(&message),
            Happening::Inject(SentMessage { sender, message }) => self.publish(sender, message),
            Happening::Frame(place, frame) => {
                if let Kind::Can(wire) = &mut self.wires[place].kind {
                    wire.send_foreign(self.now, frame);
                }
                self.arm_wire(place);
            }
            Happening::Tell(pid, waiting) => self.tell(pid, waiting),
            Happening::Serve(pid, waiting) => self.serve(pid, waiting),
            Happening::Look => self.serve_check(),
            Happening::Lonely(pid) => self.end_unsupervised(pid),
            Happening::Again(place) => self.again(place),
        }
    }

    fn begin(&mut self, pid: u32) {
        let Some(place) = self.place(pid) else { return };
        self.processes[place].life.begin(self.now);
        self.adopt(pid);
        self.handle(pid, Event::Start);
        self.report_heartbeats(pid);
        let ports = self.place(pid).map_or(0, |place| self.processes[place].wires.len());
        for port in (0..ports).map(|port| PortId(port as u8)) {
            let Some(place) = self.place(pid) else { return };
            let wire = self.processes[place].wires[usize::from(port.0)];
            // The process that receives fault commands emulates their targets.
            let emulates = self.processes[place].shell.wants(Channel::SimCmdFault);
            let module = self.processes[place].module.clone();
            let up = self.wires[wire].join(Owner { pid, port }, &module, emulates);
            let input = if up { Input::Up } else { Input::Down(BUS_OFF) };
            self.handle(pid, Event::Port { port, input });
            if let Kind::Gamepad(gamepad) = &self.wires[wire].kind
                && let Some(found) = gamepad.present()
            {
                self.tell(pid, Waiting::Gamepad(port, found.into()));
            }
        }
    }

    fn deliver(&mut self, sent: &Rc<SentMessage>) {
        let message = &sent.message;
        let mut loss = self.config.lcm_loss.max(self.lcm_disturbance.loss(self.now));
        if let Message::SimCmdFault(command) = message {
            // Fault commands are not affected by faults.
            loss = 0.0;
            let (target, fault) = (command.target.as_str(), command.fault.as_str());
            let of_a_bus = self.fault(target, fault, command.value, command.duration);
            // Otherwise it is a fault of the simulator's, which reports unknown ones.
            if !of_a_bus && InjectedFault::from_name(fault, command.value).is_some() {
                self.news(&News::Fault { target, fault, until: faults::until(self.now, command.duration) });
            }
        }
        let mut bytes = None;
        let mut pid = 0;
        // By id, not by index: serving one may end or start others.
        while let Some(place) = self.processes.iter().position(|process| process.pid > pid) {
            let process = &self.processes[place];
            pid = process.pid;
            let (wants, wants_raw_bus) = (process.hears(message.channel()), process.shell.module().wants_raw_bus());
            if !process.life.started || !(wants || wants_raw_bus) || self.lcm.chance(loss) {
                continue;
            }
            if wants_raw_bus {
                let (channel, data) = bytes.get_or_insert_with(|| encoded(message)).clone();
                self.tell(pid, Waiting::Heard(self.now, channel, data));
            }
            if wants {
                self.tell(pid, Waiting::Message(self.now, sent.clone()));
            }
        }
    }

    fn serve_timer(&mut self, place: usize) {
        let process = &mut self.processes[place];
        process.spin = if process.spin.0 == self.now { (self.now, process.spin.1 + 1) } else { (self.now, 1) };
        assert!(process.spin.1 < SPIN_MAX, "{} is due at once again and again, at {:?}", process.module, self.now);
        let pid = process.pid;
        self.handle(pid, Event::Timer);
    }

    fn serve_wire(&mut self, place: usize) {
        let now = self.now;
        match &mut self.wires[place].kind {
            Kind::Can(wire) => {
                wire.handle_timeout(now);
                self.pass_events(place);
            }
            Kind::Serial(wire) => {
                if let Some(arrival) = wire.handle_timeout(now) {
                    self.words_over(place, arrival);
                }
            }
            Kind::I2c(wire) => match wire.handle_timeout(now) {
                Some(i2c::I2cEvent::Asked(chips, transfer)) => {
                    self.tell(chips.pid, Waiting::I2cRequested(chips.port, transfer));
                }
                Some(i2c::I2cEvent::Over(owner, transfer, outcome)) => {
                    self.transfer_over(place, owner, &transfer, outcome);
                }
                None => {}
            },
            Kind::OneWire(wire) => {
                if let Some((owner, answer)) = wire.handle_timeout(now) {
                    let bus = self.wires[place].bus.clone();
                    self.digest.w1(now, &bus, &answer);
                    self.news(&News::OneWire { bus: &bus, answer: &answer });
                    self.tell(owner.pid, Waiting::OneWire(owner.port, answer));
                }
            }
            Kind::Thermal(wire) => {
                if let Some((owner, state)) = wire.handle_timeout(now) {
                    self.tell(owner.pid, Waiting::Thermal(owner.port, state));
                }
            }
            Kind::Store(wire) => {
                if let Some((owner, answer)) = wire.handle_timeout(now) {
                    self.tell(owner.pid, Waiting::Store(owner.port, answer));
                }
            }
            Kind::Gamepad(_) | Kind::Gpio(_) => {}
        }
        self.arm_wire(place);
    }

    /// Forwards the events of a CAN wire.
    fn pass_events(&mut self, place: usize) {
        while let Kind::Can(wire) = &mut self.wires[place].kind
            && let Some(told) = wire.poll_event()
        {
            match told {
                WireEvent::Frame(owner, frame) => self.frame_over(place, owner, frame),
                WireEvent::Lost(frame) => {
                    let bus = self.wires[place].bus.clone();
                    self.digest.can(self.now, &bus, &frame);
                    self.news(&News::CanLost { bus: &bus, frame });
                }
                WireEvent::Off(owner) => self.tell(owner.pid, Waiting::Down(owner.port)),
                WireEvent::Back(owner) => self.tell(owner.pid, Waiting::Up(owner.port)),
                WireEvent::Notice(owner, notice) => self.tell(owner.pid, Waiting::Notice(owner.port, notice)),
            }
        }
    }

    fn frame_over(&mut self, place: usize, owner: Owner, frame: Frame) {
        let bus = self.wires[place].bus.clone();
        self.digest.can(self.now, &bus, &frame);
        self.news(&News::Can { bus: &bus, pid: owner.pid, frame });
        let wire = &mut self.wires[place];
        let Some((at, times)) = wire.passes(self.now) else {
            self.news(&News::CanLost { bus: &bus, frame });
            return;
        };
        let echo = self.config.can_echo;
        self.each_port(place, |host, port| {
            let hears = match &host.wires[place].kind {
                Kind::Can(wire) => wire.hears(host.now, port),
                Kind::Serial(_)
                | Kind::I2c(_)
                | Kind::OneWire(_)
                | Kind::Thermal(_)
                | Kind::Gamepad(_)
                | Kind::Gpio(_)
                | Kind::Store(_) => false,
            };
            if hears && (port != owner || echo) {
                for _ in 0..times {
                    host.tell_at(at, port.pid, Waiting::Can(port.port, frame));
                }
            }
        });
    }

    fn words_over(&mut self, place: usize, arrival: serial::Arrival) {
        let (bus, owner) = (self.wires[place].bus.clone(), arrival.owner);
        self.digest.words(self.now, &bus, &arrival.words);
        self.news(&News::Words { bus: &bus, pid: owner.pid, words: &arrival.words });
        let mut words = arrival.words;
        let wire = &mut self.wires[place];
        wire.garble(self.now, &mut words);
        let words: Rc<[Word]> = words.into();
        if let Some((at, times)) = wire.passes(self.now) {
            self.each_port(place, |host, port| {
                for _ in 0..if port == owner { 0 } else { times } {
                    host.tell_at(at, port.pid, Waiting::Words(port.port, words.clone()));
                }
            });
        }
        if arrival.sent {
            self.tell(owner.pid, Waiting::Sent(owner.port));
        }
    }

    fn transfer_over(
        &mut self,
        place: usize,
        owner: Owner,
        transfer: &base::i2c::Transfer,
        outcome: base::i2c::Outcome,
    ) {
        let bus = self.wires[place].bus.clone();
        self.digest.i2c(self.now, &bus, transfer, &outcome);
        self.news(&News::I2c { bus: &bus, transfer, outcome: &outcome });
        self.tell(owner.pid, Waiting::I2c(owner.port, outcome));
    }

    /// Serves the current ports of a wire; that may open and close ports.
    fn each_port(&mut self, place: usize, mut serve: impl FnMut(&mut Self, Owner)) {
        let mut ports = mem::take(&mut self.ports);
        ports.clear();
        ports.extend_from_slice(self.wires[place].ports());
        for port in &ports {
            serve(self, *port);
        }
        self.ports = ports;
    }

    /// Sends a process an event at a given time.
    fn tell_at(&mut self, at: Instant, pid: u32, waiting: Waiting) {
        if at <= self.now {
            self.tell(pid, waiting);
        } else {
            self.schedule(at, Happening::Tell(pid, waiting));
        }
    }

    /// An event has arrived for a process: it is served, or waits while the process hangs or is slow.
    fn tell(&mut self, pid: u32, waiting: Waiting) {
        let Some(place) = self.place(pid) else { return };
        let life = &mut self.processes[place].life;
        if life.hung.is_none() && (!life.late.is_zero() || life.behind > self.now) {
            life.behind = life.behind.max(self.now + life.late);
            let at = life.behind;
            self.schedule(at, Happening::Serve(pid, waiting));
            return;
        }
        self.serve(pid, waiting);
    }

    /// Serves an event, or queues it while the process hangs.
    fn serve(&mut self, pid: u32, waiting: Waiting) {
        let Some(place) = self.place(pid) else { return };
        let process = &mut self.processes[place];
        if process.life.hung.is_some() {
            if process.life.backlog.len() < BACKLOG_MAX {
                process.life.backlog.push_back(waiting);
            } else {
                let module = process.module.clone();
                self.news(&News::Dropped { whose: &module, count: 1 });
            }
            return;
        }
        match waiting {
            Waiting::Message(at, sent) => match process.admission.judge(&sent.message, sent.sender) {
                Ok(()) if !process.shell.wants(sent.message.channel()) => {}
                Ok(()) => {
                    let from = process.admission.origin(&sent.message, sent.sender);
                    self.news(&News::Heard { pid, at, sender: sent.sender, message: &sent.message });
                    self.handle(pid, Event::Message { at, from, message: &sent.message });
                }
                Err(Refusal::SecondRobot) => self.on_second_robot(pid),
                Err(Refusal::Command | Refusal::Release | Refusal::NotYet) => {}
            },
            Waiting::Can(port, frame) => {
                let input = Input::Can { frame, at: self.now };
                self.handle(pid, Event::Port { port, input });
            }
            Waiting::Notice(port, notice) => self.handle(pid, Event::Port { port, input: Input::CanNotice(notice) }),
            Waiting::Down(port) => self.handle(pid, Event::Port { port, input: Input::Down(BUS_OFF) }),
            Waiting::Up(port) => self.handle(pid, Event::Port { port, input: Input::Up }),
            Waiting::Words(port, words) => self.handle(pid, Event::Port { port, input: Input::Words(&words) }),
            Waiting::I2c(port, outcome) => self.handle(pid, Event::Port { port, input: Input::I2c(&outcome) }),
            Waiting::I2cRequested(port, transfer) => {
                self.handle(pid, Event::Port { port, input: Input::I2cRequested(&transfer) });
            }
            Waiting::OneWire(port, answer) => self.handle(pid, Event::Port { port, input: Input::OneWire(&answer) }),
            Waiting::Thermal(port, state) => self.handle(pid, Event::Port { port, input: Input::Thermal(&state) }),
            Waiting::Gamepad(port, event) => {
                self.handle(pid, Event::Port { port, input: Input::Gamepad(event.as_input()) });
            }
            Waiting::Gpio(port, signal) => self.handle(pid, Event::Port { port, input: Input::Gpio(signal) }),
            Waiting::Store(port, answer) => self.handle(pid, Event::Port { port, input: Input::Store(&answer) }),
            Waiting::Heard(at, channel, data) => {
                self.handle(pid, Event::RawMessage { at, channel: &channel, data: &data });
            }
            Waiting::Sent(port) => self.handle(pid, Event::Port { port, input: Input::Sent }),
            Waiting::Exited(pid_ended, status) => {
                self.handle(pid, Event::Process(ProcessEvent::Exited { pid: pid_ended, status }));
            }
            Waiting::Started(module, pid_new) => {
                self.handle(pid, Event::Process(ProcessEvent::Started { module: &module, pid: pid_new }));
            }
            Waiting::Unstartable(module, reason) => {
                self.handle(pid, Event::Process(ProcessEvent::Unstartable { module: &module, reason: &reason }));
            }
            Waiting::HeartbeatStarted(child) => {
                self.handle(pid, Event::Process(ProcessEvent::HeartbeatStarted { pid: child }));
            }
            Waiting::HeartbeatLate(child, last) => {
                self.handle(pid, Event::Process(ProcessEvent::HeartbeatLate { pid: child, thread: "main", last }));
            }
            Waiting::SecondRobotEnd => self.end_second_robot(pid),
            Waiting::Start => self.begin(pid),
            Waiting::Terminate => {
                let mut out = mem::take(&mut process.out);
                process.shell.terminate(self.now, &mut out);
                self.perform(pid, out);
            }
        }
    }

    fn handle(&mut self, pid: u32, event: Event<'_>) {
        let Some(place) = self.place(pid) else { return };
        let process = &mut self.processes[place];
        let mut out = mem::take(&mut process.out);
        process.shell.handle(self.now, event, &mut out);
        if process.shell.has_lost_inputs() && !mem::replace(&mut process.told_of_gaps, true) {
            let report = Report::new(Severity::Warning, Fault::InputsLost, "inputs", GAPS_TEXT);
            process.shell.raise(self.now, report, &mut out);
        }
        self.perform(pid, out);
    }

    /// A process has received the watchdog of another robot.
    fn on_second_robot(&mut self, pid: u32) {
        let Some(place) = self.place(pid) else { return };
        let process = &mut self.processes[place];
        if process.second_robot.replace(self.now).is_none() {
            let report = Report::new(Severity::Error, Fault::SecondRobot, "", "two robots are on this bus");
            let mut out = mem::take(&mut process.out);
            process.shell.raise(self.now, report, &mut out);
            self.perform(pid, out);
            self.schedule(self.now + SECOND_ROBOT_END, Happening::Tell(pid, Waiting::SecondRobotEnd));
        }
    }

    /// Clears the fault once the other watchdog is silent.
    fn end_second_robot(&mut self, pid: u32) {
        let Some(place) = self.place(pid) else { return };
        let process = &mut self.processes[place];
        let Some(end) = process.second_robot.map(|at| at + SECOND_ROBOT_END) else { return };
        if end > self.now {
            self.schedule(end, Happening::Tell(pid, Waiting::SecondRobotEnd));
            return;
        }
        process.second_robot = None;
        let report = Report::new(Severity::Notice, Fault::SecondRobot, "", "one robot is on this bus");
        let mut out = mem::take(&mut process.out);
        process.shell.clear(self.now, report, &mut out);
        self.perform(pid, out);
    }

    /// Executes a shell's actions, then arms its timer.
    fn perform(&mut self, pid: u32, mut out: Actions) {
        for action in out.drain() {
            self.act(pid, action);
        }
        if let Some(place) = self.place(pid) {
            self.processes[place].out = out;
            self.arm(place);
        }
    }

    fn act(&mut self, pid: u32, action: Action) {
        let Some(place) = self.place(pid) else { return };
        let module = self.processes[place].module.clone();
        match action {
            Action::Publish(message) => {
                if let Message::CmDataProcesses(list) = &message {
                    self.processes[place].admission.on_own_list(list, 0);
                }
                self.publish(sender(pid), message);
            }
            Action::Send(port, output) => self.send(place, port, output),
            Action::Report(report) => self.news(&News::Report { module: &module, report: &report }),
            Action::Note(_, line) => self.news(&News::Note { module: &module, line: &line }),
            Action::State(state) => self.news(&News::State { module: &module, state }),
            Action::Process(command) => self.command(pid, command),
            Action::Exit(code) => self.end(pid, ExitStatus::Code(i32::from(code))),
            // There is no computer to halt.
            Action::Run(command) => {
                let line = format!("not run: {}", command.join(" "));
                self.news(&News::Note { module: &module, line: &line });
            }
            // Handled within the shell.
            Action::Raise(_) | Action::Clear(_) | Action::Condition(_) => {}
        }
    }

    fn publish(&mut self, sender: Sender, message: Message) {
        let pid = sender.pid().unwrap_or(0);
        if self.config.own_clock && matches!(message, Message::SimDataClock(_)) && self.place(pid).is_some() {
            return;
        }
        self.bytes.clear();
        if let Err(error) = message.encode(&mut self.bytes) {
            let line = format!("not sent on {}: {error}", message.channel_name());
            self.news(&News::Note { module: "lcm", line: &line });
            return;
        }
        self.digest.message(self.now, pid, &message.channel_name(), &self.bytes);
        self.news(&News::Message { sender, message: &message });
        let hears = |process: &Process| process.hears(message.channel()) || process.shell.module().wants_raw_bus();
        if self.processes.iter().any(hears) {
            let jitter = part(self.config.lcm_jitter, &mut self.lcm);
            let disturbance = &self.lcm_disturbance;
            let at = self.now + self.config.lcm_latency + jitter + disturbance.delay(self.now);
            let at = match disturbance.reorder(self.now, &mut self.lcm) {
                Some(later) => at + later,
                None => {
                    // A socket is a queue: messages of one process keep their order.
                    let last = self.arrivals.entry(pid).or_default();
                    *last = at.max(*last);
                    *last
                }
            };
            let message = Rc::new(SentMessage { sender, message });
            if self.lcm_disturbance.duplicates(self.now, &mut self.lcm) {
                let again = at + part(DUPLICATE_WITHIN, &mut self.lcm);
                self.schedule(again, Happening::Deliver(message.clone()));
            }
            self.schedule(at, Happening::Deliver(message));
        }
    }

    fn send(&mut self, place: usize, port: PortId, output: Output) {
        let process = &self.processes[place];
        let owner = Owner { pid: process.pid, port };
        let Some(&wire) = process.wires.get(usize::from(port.0)) else {
            return;
        };
        match (&mut self.wires[wire].kind, output) {
            (Kind::Can(wire), Output::Can(frame)) => wire.send(self.now, owner, frame),
            (Kind::Serial(wire), Output::Words(words)) if !words.is_empty() => {
                wire.send(self.now, owner, words);
            }
            (Kind::I2c(wire), Output::I2c(transfer)) => wire.send(owner, transfer),
            (Kind::I2c(wire), Output::I2cAnswer(outcome)) => wire.answer(self.now, owner, outcome),
            (Kind::OneWire(wire), Output::OneWire(request)) => wire.send(self.now, owner, request),
            (Kind::OneWire(wire), Output::OneWireState(answer)) => wire.server.is(owner, answer),
            (Kind::Thermal(wire), Output::Thermal) => wire.send(self.now, owner, ()),
            (Kind::Thermal(wire), Output::ThermalState(state)) => wire.server.is(owner, state),
            (Kind::Store(wire), Output::Store(request)) => wire.send(self.now, owner, request),
            (Kind::Gamepad(_), Output::Gamepad(event)) => {
                self.gamepad_tells(wire, owner, event);
                return;
            }
            (Kind::Gpio(_), Output::Gpio(signal)) => {
                let bus = self.wires[wire].bus.clone();
                self.digest.gpio(self.now, &bus, signal);
                self.each_port(wire, |host, other| {
                    if other != owner {
                        host.schedule(host.now, Happening::Tell(other.pid, Waiting::Gpio(other.port, signal)));
                    }
                });
                return;
            }
            // A frame on a serial line or the like: nothing is sent.
            _ => return,
        }
        self.arm_wire(wire);
    }

    /// Forwards an event from one end of a gamepad's wire to the others.
    fn gamepad_tells(&mut self, place: usize, owner: Owner, event: GamepadEvent) {
        let wire = &mut self.wires[place];
        let bus = wire.bus.clone();
        self.digest.gamepad(self.now, &bus, &event);
        if let Kind::Gamepad(wire) = &mut wire.kind {
            wire.tell(owner.pid, &event);
        }
        let event = Rc::new(event);
        self.each_port(place, |host, port| {
            if port != owner {
                host.schedule(host.now, Happening::Tell(port.pid, Waiting::Gamepad(port.port, event.clone())));
            }
        });
    }

    fn command(&mut self, parent: u32, command: ProcessCommand) {
        match command {
            ProcessCommand::Spawn { module, wanted } => {
                self.remembered.insert(module.clone(), (wanted, false));
                let news = match self.start(parent, &module, wanted) {
                    Ok(pid) => Waiting::Started(module.into(), pid),
                    Err(reason) => Waiting::Unstartable(module.into(), reason.into()),
                };
                self.schedule(self.now, Happening::Tell(parent, news));
            }
            ProcessCommand::Terminate { pid } => {
                self.schedule(self.now, Happening::Tell(pid, Waiting::Terminate));
            }
            ProcessCommand::Kill { pid } => self.kill(pid),
            ProcessCommand::Remember { module, wanted, held } => {
                self.remembered.insert(module, (wanted, held));
            }
            // There is no parent to inform.
            ProcessCommand::Health { .. } => {}
        }
    }

    fn end(&mut self, pid: u32, status: ExitStatus) {
        let Some(place) = self.place(pid) else { return };
        let process = self.processes.remove(place);
        self.process_timers.remove(place);
        for place in 0..self.wires.len() {
            if self.wires[place].close(pid) {
                self.gamepad_tells(place, Owner { pid, port: PortId(0) }, GamepadEvent::Gone);
            }
        }
        self.news(&News::Exited { module: &process.module, pid, status });
        if process.parent != 0 {
            let at = self.now + self.config.exit_delay;
            self.schedule(at, Happening::Tell(process.parent, Waiting::Exited(pid, status)));
        }
        self.after(pid, status);
    }

    fn arm(&mut self, place: usize) {
        let process = &self.processes[place];
        let life = &process.life;
        let due = if life.started && life.hung.is_none() { process.shell.poll_timeout() } else { None };
        let due = due.map(|due| due + life.late);
        self.process_timers[place] = self.rearmed(self.process_timers[place], due);
    }

    fn arm_wire(&mut self, place: usize) {
        if let Some(count) = self.wires[place].dropped() {
            let bus = self.wires[place].bus.clone();
            self.news(&News::Dropped { whose: &bus, count });
        }
        let due = self.wires[place].poll_timeout();
        self.wire_timers[place] = self.rearmed(self.wire_timers[place], due);
    }

    /// An unchanged timer keeps its number: it is served in the order in which it was set.
    fn rearmed(&mut self, old: Timer, due: Option<Instant>) -> Timer {
        match (old, due) {
            (Some((at, number)), Some(due)) if at == due => Some((at, number)),
            (_, due) => due.map(|due| (due, self.number())),
        }
    }
}

/// A process of the robot's user; all modules of the simulation have the same.
fn of_robot(pid: u32) -> admission::Process {
    admission::Process { pid, uid: 0 }
}

/// Such a process, whose messages come through shared memory.
fn sender(pid: u32) -> Sender {
    Sender { way: Way::Memory, process: Some(of_robot(pid)) }
}

/// Channel and bytes of a message.
fn encoded(message: &Message) -> (Rc<str>, Rc<[u8]>) {
    let mut data = Vec::new();
    // It was encoded when it was sent.
    let _ = message.encode(&mut data);
    (message.channel_name().as_ref().into(), data.into())
}
