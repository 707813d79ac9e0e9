//! `advee up --sim --speed N`: the simulated robot in virtual time, in this process, beside real time.
//!
//! Everything that its modules publish is published on the LCM bus, with virtual timestamps; commands and stops from
//! there reach them at the present virtual instant ([`Gateway`]). Web server and node of ROS 2 are processes of their
//! own on that bus, as they are of a live robot.

mod companions;
mod start;

use super::{PATROL, Up, clean, welcome};
use crate::{Common, Failed, Outcome, neighbours};
use base::{Duration, Epoch, Instant};
use companions::Companions;
use diagnostics::orders;
use host::bus::{Bus, Received};
use host::clock;
use host::log::Log;
use host::run_folder::RunFolder;
use messages::simulation::{CmdRun, DataClock, DataRun};
use messages::{Channel, Message, common};
use module::admission::{Admission, Policy};
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use robot::config::{self, Config, SIMULATOR};
use robot::place::RobotLocation;
use robot::{preflight, topology};
use sim::host::{self as virtual_host, News, Virtual};
use sim::paced::gateway::{Echoes, Gateway, is_outside, outside, passes, repeats};
use sim::paced::pacer::{Pacer, Speed, TICK};
use simulator::world::World;
use start::{NAME, Start};
use std::cell::RefCell;
use std::fs;
use std::mem;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::rc::Rc;
use std::time::SystemTime;

/// Real time for which time passes before the bus is read again.
const SERVED: Duration = Duration::from_millis(5);
/// Maximum number of messages that are read at a time.
const RECEIVED_MAX: usize = 1000;
/// Maximum number of messages that wait for time to pass; further ones are dropped.
const PENDING_MAX: usize = 1000;
/// Real period of `SIM_DATA_RUN`, and of `SIM_DATA_CLOCK` while time stands still.
const ANNOUNCED: Duration = Duration::from_secs(1);
/// Real time after which a tick that a program in step has not answered is published again: it, or its answer, may be
/// lost.
const REPEATED: Duration = Duration::from_millis(100);
/// Maximum length of the name of a world in a command, bytes: a refusal repeats it each second.
const WORLD_MAX: usize = 64;
/// Virtual time limit of an orderly end: the watchdog's own is shorter.
const END: Duration = Duration::from_secs(10);

/// Runs the robot until Ctrl-C.
pub fn run(common: &Common, command: &Up, config: Config, world: &World, speed: Speed) -> Outcome {
    let log = Log::new("up");
    let signals = signals()?;
    let folder = RunFolder::take(&common.run_dir())?;
    let own = std::path::absolute(common.run_dir()).ok();
    let refused = match command.force {
        true => Ok(()),
        false => neighbours::refuse(&common.lcm_url(), "this robot is not started", own.as_deref()),
    };
    let (begun, place) = (SystemTime::now(), command.place(common));
    let goal = command.goal.clone().unwrap_or_else(|| PATROL.into());
    let logs = topology::log_folder(&place, &config.robot);
    let result = refused.and_then(|()| {
        for module in config.modules.iter().filter(|module| module.command.is_some()) {
            let why = "a program of its own is not started in virtual time; if started by hand it is waited for, as \
                       long as it answers SIM_DATA_CLOCK";
            log.line(format_args!("{}: {why}", module.name()));
        }
        // Companions read it, too: from wherever they run.
        let texts = std::path::absolute(folder.path()).map_err(|error| format!("run folder: {error}"))?;
        let mut paced = Paced::new(&log, place, config, goal, world, speed, texts)?;
        welcome::greet(common.run_dir(), paced.companions.serve());
        let result = paced.until_signalled(&signals);
        paced.end();
        clean(&folder, &paced.config);
        result
    });
    folder.release();
    if result.is_ok() {
        welcome::farewell(&log, &logs, begun);
    }
    result.map(|()| ExitCode::SUCCESS)
}

/// Ctrl-C and its like, and the end of a child, as something to wait for.
fn signals() -> Result<SignalFd, Failed> {
    let mut set = SigSet::empty();
    for signal in [Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP, Signal::SIGCHLD] {
        set.add(signal);
    }
    let opened =
        set.thread_block().and_then(|()| SignalFd::with_flags(&set, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC));
    opened.map_err(|errno| format!("signalfd: {}", errno.desc()).into())
}

/// The robot's modules in virtual time.
struct Robot {
    machine: Virtual,
    epoch: Epoch,
    /// What they published since.
    outbox: Rc<RefCell<Vec<Message>>>,
}

impl Robot {
    /// Starts a robot; timestamps count from `epoch`.
    fn new(place: &RobotLocation, epoch: Epoch) -> Result<Self, Failed> {
        let config = virtual_host::Config { epoch, own_clock: true, ..virtual_host::Config::default() };
        let mut machine = topology::virtual_machine_attached(place, config)?;
        let outbox = Rc::new(RefCell::new(Vec::new()));
        let out = outbox.clone();
        machine.observe(move |_, news| match news {
            News::Message { sender, message } if !is_outside(*sender) => out.borrow_mut().push((*message).clone()),
            News::Report { module, report } => Log::new(module).report(report, false),
            News::Note { module, line } => Log::new(module).line(line),
            _ => {}
        });
        machine.keep(watchdog::NAME)?;
        Ok(Self { machine, epoch, outbox })
    }

    fn now(&self) -> Instant {
        self.machine.now()
    }

    fn timestamp(&self) -> i64 {
        self.epoch.timestamp(self.now())
    }

    /// A message of this program, at this instant.
    fn say(&mut self, message: impl Into<Message>) {
        self.machine.inject(self.now(), message);
        self.machine.run_until(self.now());
    }

    /// Shuts all modules down in good order, as on SIGTERM, while virtual time passes as fast as it can.
    fn end(&mut self) {
        let until = self.now() + END;
        if let Some(watchdog) = self.machine.pid(watchdog::NAME) {
            self.machine.terminate(watchdog);
        }
        while self.machine.processes().next().is_some() && self.now() < until {
            self.machine.run_until(self.now() + TICK);
        }
    }
}

/// A robot in virtual time, and what it is beside.
struct Paced {
    log: Log,
    place: RobotLocation,
    config: Config,
    /// Name of the route that it drives when it is ready.
    goal: String,
    /// Name of the world.
    world: String,
    /// The folder of worlds that came as text, and how many did.
    scenarios: (PathBuf, u64),
    robot: Robot,
    /// The virtual instant of the next tick, and the real one at which the last is published again.
    tick: Instant,
    again: Instant,
    pacer: Pacer,
    gateway: Gateway,
    /// The gateway obeys the same senders as modules do.
    admission: Admission,
    bus: Bus,
    echoes: Echoes,
    buffer: Vec<u8>,
    /// A failure of the bus was reported.
    broken: bool,
    /// Number of messages that wait for time to pass.
    pending: usize,
    /// Timestamp of the last command, and why it was refused.
    answer: (i64, String),
    /// Real time of the next announcement, and whether the last one said that time stands still.
    announce: Instant,
    stood: bool,
    start: Option<Start>,
    companions: Companions,
}

impl Paced {
    fn new(
        log: &Log,
        place: RobotLocation,
        config: Config,
        goal: String,
        world: &World,
        speed: Speed,
        texts: PathBuf,
    ) -> Result<Self, Failed> {
        let own = [Channel::SimCmdClock, Channel::SimCmdRun];
        let names = Channel::ALL.iter().filter(|channel| passes(**channel) || own.contains(channel));
        let names: Vec<&str> = names.map(|channel| channel.name()).collect();
        let bus = Bus::open(&place.lcm_url, &names)?;
        let robot = Robot::new(&place, Epoch { offset_us: (clock::wall() / 1000) as i64 })?;
        let real = clock::now();
        let companions = Companions::new(&config);
        let commands = Policy { commands: config.robot.bus.commands, ..Policy::default() };
        Ok(Self {
            log: log.clone(),
            world: name(&place),
            scenarios: (texts, 0),
            start: Start::new(&goal, &config, world),
            place,
            config,
            goal,
            robot,
            tick: Instant::ZERO,
            again: real,
            pacer: Pacer::new(speed, real, Instant::ZERO),
            gateway: Gateway::default(),
            admission: Admission::new(commands, None),
            bus,
            echoes: Echoes::default(),
            buffer: Vec::new(),
            broken: false,
            pending: 0,
            answer: (0, String::new()),
            announce: real,
            stood: false,
            companions,
        })
    }

    fn until_signalled(&mut self, signals: &SignalFd) -> Result<(), Failed> {
        loop {
            while let Ok(Some(signal)) = signals.read_signal() {
                if signal.ssi_signo != Signal::SIGCHLD as u32 {
                    return Ok(());
                }
            }
            self.companions.watch(clock::now(), &self.log, &self.place);
            self.receive();
            self.advance();
            let real = clock::now();
            self.tell(real);
            let until = self.next(real);
            crate::bus::wait(&[signals.as_fd(), self.bus.as_fd()], until.since(clock::now()))?;
        }
    }

    /// The real instant at which there is something to do.
    fn next(&mut self, real: Instant) -> Instant {
        // A program is given up only while time is to pass: one may be halted beside a robot that stands still.
        let waits = !self.pacer.is_paused() && self.gateway.waits(real);
        let passes_on = match waits {
            true => self.gateway.until().min(self.again),
            false => self.pacer.next(real, self.robot.now()),
        };
        passes_on.min(self.announce).min(self.companions.poll_timeout())
    }

    /// Takes what has come from the bus.
    fn receive(&mut self) {
        let knows_senders = self.bus.knows_senders();
        for _ in 0..RECEIVED_MAX {
            let echoes = &mut self.echoes;
            let received =
                self.bus.receive_with(clock::now(), |_, raw| knows_senders || !echoes.is_echo(raw.channel, raw.data));
            match received {
                Received::Message { message, .. } => {
                    // A new start takes long: signals are looked at before the next message.
                    if self.on_message(message) {
                        return;
                    }
                }
                Received::Malformed { .. } | Received::Foreign => {}
                Received::Broken(why) => return self.on_failure(&why),
                Received::Nothing => return,
            }
        }
    }

    /// Takes a message; true if it has begun a new start of the robot.
    fn on_message(&mut self, message: Message) -> bool {
        let sender = self.bus.sender();
        // What this process published comes back.
        if sender.pid() == Some(std::process::id()) || self.admission.judge(&message, sender).is_err() {
            return false;
        }
        match message {
            Message::SimCmdRun(command) => {
                self.on_command(&command);
                return matches!(command.action, CmdRun::RESET | CmdRun::WORLD | CmdRun::SCENARIO);
            }
            Message::SimCmdClock(answer) => self.gateway.on_answer(&answer),
            message if self.has_room(message.channel()) && self.gateway.admits(&message, self.pacer.is_real()) => {
                self.pending += 1;
                self.robot.machine.inject_by(self.robot.now(), outside(sender), message);
            }
            _ => {}
        }
        false
    }

    /// True if a message of this channel may wait for time to pass. Measurements leave room for commands and stops.
    fn has_room(&self, channel: Channel) -> bool {
        self.pending < if repeats(channel) { PENDING_MAX / 2 } else { PENDING_MAX }
    }

    fn on_failure(&mut self, why: &str) {
        if !mem::replace(&mut self.broken, true) {
            self.log.line(why);
        }
    }

    /// Lets time pass as far as is due.
    fn advance(&mut self) {
        let begun = clock::now();
        loop {
            let (real, now) = (clock::now(), self.robot.now());
            if now >= self.tick {
                self.publish_tick(real);
            }
            if self.pacer.is_paused() || self.gateway.waits(real) || real.since(begun) >= SERVED {
                return;
            }
            let due = self.pacer.due(real, now).min(self.tick);
            if due <= now {
                return;
            }
            self.robot.machine.run_until(due);
            self.pending = 0;
            self.pacer.on_ran(clock::now(), due);
            self.flush();
        }
    }

    fn publish_tick(&mut self, real: Instant) {
        let now = self.robot.now();
        while self.tick <= now {
            self.tick += TICK;
        }
        let timestamp = self.robot.timestamp();
        let rate = self.pacer.achieved(real, now);
        self.robot.say(DataClock { timestamp, rate });
        self.flush();
        self.gateway.on_tick(real, timestamp);
        self.again = real + REPEATED;
    }

    /// Publishes what the modules have published in virtual time.
    fn flush(&mut self) {
        let messages = mem::take(&mut *self.robot.outbox.borrow_mut());
        for message in &messages {
            self.publish(message);
            let now = self.robot.now();
            let due = self.start.as_mut().map(|start| start.on_message(self.robot.epoch.timestamp(now), now, message));
            for message in due.into_iter().flatten() {
                self.robot.machine.inject(now, message);
            }
        }
        self.start.take_if(|start| start.is_done());
    }

    fn publish(&mut self, message: &Message) {
        let channel = message.channel_name();
        self.buffer.clear();
        // Those of the modules were encoded before.
        if message.encode(&mut self.buffer).is_err() {
            return;
        }
        if !self.bus.knows_senders() && passes(message.channel()) {
            self.echoes.on_published(&channel, &self.buffer);
        }
        match self.bus.publish_raw(&channel, &self.buffer) {
            Ok(()) => self.broken = false,
            Err(why) => self.on_failure(&why),
        }
    }

    /// Reports what people are to know, and the state once a second.
    fn tell(&mut self, real: Instant) {
        while let Some(text) = self.gateway.poll_notice() {
            Log::new(NAME).line(&text);
            let timestamp = self.robot.timestamp();
            let level = common::EventText::WARNING;
            self.robot.say(common::EventText { timestamp, module: SIMULATOR.into(), level, text });
            self.flush();
            self.announce = real;
        }
        if self.announce <= real || self.stood != self.pacer.is_paused() {
            self.stood = self.pacer.is_paused();
            self.announce = real + ANNOUNCED;
            self.publish(&self.state().into());
            if self.pacer.is_paused() {
                // The same tick again, for programs that have just joined: time may stand between two of them, and an
                // answer to any other instant is ignored.
                self.publish(&DataClock { timestamp: self.gateway.tick(), rate: 0.0 }.into());
            }
        }
        // Time stands at the tick that is waited for.
        if self.again <= real && !self.pacer.is_paused() && self.gateway.waits(real) {
            self.again = real + REPEATED;
            let rate = self.pacer.achieved(real, self.robot.now());
            self.publish(&DataClock { timestamp: self.gateway.tick(), rate }.into());
        }
    }

    fn state(&self) -> DataRun {
        DataRun {
            timestamp: self.robot.timestamp(),
            paused: self.pacer.is_paused(),
            speed: self.pacer.speed().factor(),
            world: self.world.clone(),
            command: self.answer.0,
            refusal: self.answer.1.clone(),
            refused: i64::try_from(self.gateway.refused()).unwrap_or(i64::MAX),
            in_step: self.gateway.in_step(),
            not_in_step: self.gateway.not_in_step().to_vec(),
        }
    }

    fn on_command(&mut self, command: &CmdRun) {
        let done = self.execute(command);
        self.answer = (command.timestamp, done.err().unwrap_or_default());
        self.publish(&self.state().into());
    }

    /// Executes a command.
    ///
    /// # Errors
    /// Why it is refused, in a line; nothing has changed then.
    fn execute(&mut self, command: &CmdRun) -> Result<(), String> {
        let (real, now) = (clock::now(), self.robot.now());
        match command.action {
            CmdRun::PAUSE => {
                self.pacer.pause();
                self.announce = real;
            }
            CmdRun::RUN => {
                self.pacer.run(real, now);
                self.gateway.on_run(real);
            }
            CmdRun::SPEED => self.pacer.set_speed(Speed::new(command.value)?, real, now),
            CmdRun::STEP => {
                let lasts = if command.value == 0.0 { Ok(TICK) } else { Duration::try_from_secs_f64(command.value) };
                self.pacer.step(lasts.map_err(|error| format!("step: {error}"))?, real, now)?;
                self.gateway.on_run(real);
            }
            CmdRun::RESET => self.restart(self.place.world.clone())?,
            CmdRun::WORLD => {
                if !is_world_name(&command.world) {
                    return Err(format!(
                        "a world is a name in conf/worlds: letters, digits, - and _, at most {WORLD_MAX} characters"
                    ));
                }
                let last = self.place.world.clone();
                self.restart(Some(PathBuf::from(&command.world)))?;
                self.forget(last);
            }
            CmdRun::SCENARIO => self.on_scenario(&command.world)?,
            other => return Err(format!("there is no action {other}")),
        }
        Ok(())
    }

    /// A new start in a world of this text, which becomes a file of the run folder. One that is refused is removed
    /// again, and so is that of the last world, which nobody reads any more.
    fn on_scenario(&mut self, text: &str) -> Result<(), String> {
        orders::scenario(0, text, "").map(drop)?;
        config::world_without_files(Path::new("scenario"), text).map_err(in_a_line)?;
        let (folder, number) = &mut self.scenarios;
        *number += 1;
        let path = scenario(folder, *number);
        fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
        let last = self.place.world.clone();
        if let Err(why) = self.restart(Some(path.clone())) {
            let _ = fs::remove_file(&path);
            // The page that sent it knows no path of this computer.
            return Err(why.replace(&format!("{}:", path.display()), "scenario:"));
        }
        self.forget(last);
        Ok(())
    }

    /// Removes the file of a world that came as text, if it is one.
    fn forget(&self, world: Option<PathBuf>) {
        let (folder, number) = &self.scenarios;
        if let Some(path) = world.filter(|path| (1..=*number).any(|number| *path == scenario(folder, number))) {
            let _ = fs::remove_file(path);
        }
    }

    /// A new start of the robot in a world, with the same seed. Its timestamps go on where those of the last one end.
    fn restart(&mut self, world: Option<PathBuf>) -> Result<(), String> {
        let place = RobotLocation { world, ..self.place.clone() };
        // The new robot is that of the files as they are now.
        let config = Config::load(&place.config, place.sim, &place.sets).map_err(in_a_line)?;
        let world = config::world(&place.config, place.world.as_deref(), &place.sets).map_err(in_a_line)?;
        preflight::check(&place, &config, &world).map_err(in_a_line)?;
        self.robot.end();
        self.flush();
        let epoch = Epoch { offset_us: self.robot.epoch.timestamp(self.robot.now() + TICK) };
        self.robot = Robot::new(&place, epoch).map_err(|failed| failed.why)?;
        self.config = config;
        (self.tick, self.pending) = (Instant::ZERO, 0);
        self.pacer.reset(clock::now(), Instant::ZERO);
        self.start = Start::new(&self.goal, &self.config, &world);
        if place.world != self.place.world {
            // Their map is of the world.
            self.companions.restart(clock::now());
        }
        self.world = name(&place);
        self.place = place;
        self.announce = clock::now();
        Ok(())
    }

    /// Ends everything in good order.
    fn end(&mut self) {
        self.companions.end();
        self.robot.end();
        self.flush();
        self.forget(self.place.world.clone());
    }
}

fn in_a_line(error: config::ConfigError) -> String {
    error.to_string().replace('\n', "; ")
}

/// The file of a world that came as text.
fn scenario(folder: &Path, number: u64) -> PathBuf {
    folder.join(format!("scenario-{number}.toml"))
}

/// True if a command may name a world so: never a path.
fn is_world_name(name: &str) -> bool {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_".contains(&byte);
    (1..=WORLD_MAX).contains(&name.len()) && name.bytes().all(is_plain)
}

/// Name of the world of a robot.
fn name(place: &RobotLocation) -> String {
    let path = config::world_place(&place.config, place.world.as_deref());
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_world_in_a_command_is_a_short_name_and_no_path() {
        for name in ["hall", "empty-2", "a_b", &"a".repeat(WORLD_MAX)] {
            assert!(is_world_name(name), "{name}");
        }
        for name in
            ["", ".", "..", "../hall", "/etc/passwd", "a/b", "a b", "hall\n", "hála", &"a".repeat(WORLD_MAX + 1)]
        {
            assert!(!is_world_name(name), "{name}");
        }
    }
}
