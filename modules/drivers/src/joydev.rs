//! `driver_joydev`: a gamepad as a manual source of motion, with a dead-man button.
//!
//! Device    any with two axes and a button, as in [`base::gamepad`]; docs/gamepad.md
//! Commands  `LL_CMD_MOTION`, or of a base that does not steer `LL_CMD_VELOCITY`, of priority 2 at 20 Hz while the
//!           dead-man button is held, then one zero, then nothing;
//!           `LL_CMD_CREEP` beside it while the creep button is held, too, and once when it is released
//! Data      `LL_DATA_JOYDEV` at 5 Hz
//! Silence   an absent gamepad is not an error; a gamepad that disappears, or appears again, counts as released
//!
//! Motion requires that the button was seen released and then pressed, and that all sticks were seen centred since.
//! The creep button counts from a press while the sticks are followed. In PAUSE the gamepad is reported but commands
//! nothing; in STOP it does neither.

mod config;
mod mapping;
#[cfg(test)]
mod tests;

pub use config::{Commands, Config, ConfigError, Gear, StickConfig};
pub use mapping::{Mapping, Refusal, Stick};

use base::gamepad::{Device, Input as News};
use base::{Deadlines, Duration, Fault, Instant, Severity};
use messages::lowlevel::{CmdCreep, CmdMotion, CmdVelocity, DataJoydev};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, State};

/// Name of the module.
pub const NAME: &str = "driver_joydev";
/// Source name in its commands.
pub const SOURCE: &str = "gamepad";
/// Priority of a gamepad among the sources of motion.
const PRIORITY: i8 = 2;

const PORT: PortId = PortId(0);
const COMMAND_PERIOD: Duration = Duration::from_millis(50);
const DATA_PERIOD: Duration = Duration::from_millis(200);

base::deadlines! {
    /// Deadlines of the driver.
    enum Timer {
        /// A command is sent. Set while the dead-man button moves the robot.
        Command,
        /// `LL_DATA_JOYDEV` is published. Set from the start on, except in STOP.
        Data,
        /// A gamepad that moves the robot has been silent for too long.
        Silence,
    }
}

/// State of the dead-man button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Hold {
    /// Released.
    Free,
    /// Held since a time when it could not count; must be released first.
    Stale,
    /// Pressed while a stick was off centre: zero is commanded until all were centred.
    OffCentre,
    /// The sticks' values are commanded.
    Drives,
}

/// Driver of the gamepad.
#[derive(Debug)]
pub struct Joydev {
    config: Config,
    commands: Commands,
    ports: [PortSpec; 1],
    state: State,
    /// Connected device and its mapping; without a mapping it cannot drive the robot.
    device: Option<(Device, Option<Mapping>)>,
    hold: Hold,
    /// The creep button is held, since a press while the sticks were followed.
    creeps: bool,
    /// Session of its commands: its start time.
    session: i64,
    /// Time of the last event.
    last_event: Instant,
    /// Last commanded steering angle, rad.
    steering: f64,
    deadlines: Deadlines<Timer>,
    /// Absence already reported.
    absence_reported: bool,
    /// Last reported reason why the held button moves nothing; `Free`: nothing to report.
    reported_hold: Hold,
}

/// Values requested by the gamepad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Demand {
    held: bool,
    centred: bool,
    sticks: Sticks,
}

/// Positions of the sticks, in the units of what they command.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sticks {
    /// Speed, m/s.
    speed: f64,
    /// Steering angle, rad, or rotation, rad/s.
    steering: f64,
    /// Speed to the left, m/s.
    sideways: f64,
}

impl Joydev {
    /// Creates the driver of a gamepad whose sticks command this.
    ///
    /// # Errors
    /// The configuration is contradictory.
    pub fn new(config: Config, commands: Commands) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            ports: [PortSpec { bus: config.bus.clone(), line: Line::Gamepad }],
            config,
            commands,
            state: State::Init,
            device: None,
            hold: Hold::Free,
            creeps: false,
            session: 0,
            last_event: Instant::ZERO,
            steering: 0.0,
            deadlines: Deadlines::new(),
            absence_reported: false,
            reported_hold: Hold::Free,
        })
    }

    fn on_news(&mut self, now: Instant, news: News<'_>, out: &mut Actions) {
        self.last_event = now;
        match (news, &mut self.device) {
            (News::Found(device), _) => self.on_found(now, device, out),
            (News::Gone, _) => self.on_gone(now, "no gamepad connected", out),
            (News::Axis { code, value }, Some((device, _))) => device.set_axis(code, value),
            (News::Button { code, pressed }, Some((device, mapping))) => {
                device.set_button(code, pressed);
                let (dead_man, creep) = mapping.as_ref().map_or((None, None), |own| (Some(own.dead_man), own.creep));
                // At once: it may be pressed again within the same frame.
                if !pressed && dead_man == Some(code) {
                    self.decide(now, out);
                }
                if creep == Some(code) {
                    self.on_creep(now, pressed, out);
                }
            }
            // Changes that belong together are evaluated together.
            (News::Frame, Some(_)) => self.decide(now, out),
            _ => {}
        }
    }

    /// A gamepad appeared: it may be another one, or the same after unseen events. It counts as released.
    fn on_found(&mut self, now: Instant, device: &Device, out: &mut Actions) {
        self.let_go(now, out);
        let known = self.device.as_ref().is_some_and(|(own, _)| own.name() == device.name());
        let mapping = Mapping::of(&self.config, self.commands, device);
        let (bus, name) = (self.config.bus.as_str(), device.name());
        match &mapping {
            Ok(Mapping { speed, steering, sideways, dead_man, creep }) => {
                if !known {
                    let (speed, steering) = (mapping::axis(speed.code), mapping::axis(steering.code));
                    let turn = if self.commands == Commands::Motion { "steering" } else { "rotation" };
                    let sideways = sideways.as_ref().map(|stick| format!(", sideways {}", mapping::axis(stick.code)));
                    let sideways = sideways.unwrap_or_default();
                    let dead_man = mapping::button(*dead_man);
                    let creep = creep.map_or(String::new(), |creep| format!(", creep {}", mapping::button(creep)));
                    out.note(format!("{name}: speed {speed}, {turn} {steering}{sideways}, dead man {dead_man}{creep}"));
                }
                out.clear(Fault::GamepadRefused, bus, format!("{name} can drive the robot"));
            }
            Err(refusal) => {
                let why = format!("{name} cannot drive the robot: {refusal}");
                out.clear(Fault::GamepadRefused, bus, "another gamepad");
                out.raise(Severity::Warning, Fault::GamepadRefused, bus, why);
            }
        }
        self.device = Some((device.clone(), mapping.ok()));
        self.hold = Hold::Stale;
        self.absence_reported = false;
        self.decide(now, out);
    }

    fn on_gone(&mut self, now: Instant, why: &str, out: &mut Actions) {
        self.let_go(now, out);
        self.device = None;
        self.hold = Hold::Free;
        self.report_hold(out);
        out.clear(Fault::GamepadRefused, self.config.bus.as_str(), "it is gone");
        if !self.absence_reported {
            self.absence_reported = true;
            out.note(why);
        }
    }

    /// Requested values; zero if it is absent or cannot drive the robot.
    fn demand(&self) -> Demand {
        let Some((device, Some(mapping))) = &self.device else { return Demand::default() };
        let raw = |stick: &Stick| device.axis(stick.code).map_or(0, |axis| axis.value);
        let held = |code: u16| device.button(code) == Some(true);
        let gear = [self.config.slow, self.config.fast].into_iter().flatten().find(|gear| held(gear.button));
        let scale = gear.map_or(self.config.scale, |gear| gear.scale);
        let value = |stick: &Stick| stick.value(raw(stick));
        Demand {
            held: held(mapping.dead_man),
            centred: mapping.sticks().all(|stick| stick.is_centred(raw(stick))),
            sticks: Sticks {
                speed: value(&mapping.speed) * scale,
                steering: value(&mapping.steering),
                sideways: mapping.sideways.as_ref().map_or(0.0, value) * scale,
            },
        }
    }

    /// Decides whether the gamepad moves the robot.
    fn decide(&mut self, now: Instant, out: &mut Actions) {
        let demand = self.demand();
        let before = self.hold;
        self.hold = match (before, demand) {
            (_, Demand { held: false, .. }) => Hold::Free,
            (Hold::Stale, _) => Hold::Stale,
            _ if self.state != State::Run => Hold::Stale,
            (Hold::Drives, _) => Hold::Drives,
            (_, Demand { centred: true, .. }) => Hold::Drives,
            (_, _) => Hold::OffCentre,
        };
        match (before.commands(), self.hold.commands()) {
            (true, false) => self.zero(now, out),
            (false, true) => self.deadlines.set(Timer::Command, now),
            _ => {}
        }
        self.report_hold(out);
    }

    /// Ends the motion, whatever the state of the button.
    fn let_go(&mut self, now: Instant, out: &mut Actions) {
        if self.hold.commands() {
            self.hold = Hold::Stale;
            self.zero(now, out);
        }
    }

    /// Sends the last command: standstill with unchanged steering angle.
    fn zero(&mut self, now: Instant, out: &mut Actions) {
        self.deadlines.clear(Timer::Command);
        let steering = if self.commands == Commands::Motion { self.steering } else { 0.0 };
        self.send(now, Sticks { steering, ..Sticks::default() }, out);
        self.on_creep(now, false, out);
    }

    /// The creep button was pressed or released. A press counts while the sticks are followed: an earlier one is not a
    /// deliberate act.
    fn on_creep(&mut self, now: Instant, pressed: bool, out: &mut Actions) {
        let creeped = std::mem::replace(&mut self.creeps, pressed && self.hold == Hold::Drives);
        if creeped && !self.creeps {
            self.send_creep(now, out);
        }
    }

    fn send_creep(&self, now: Instant, out: &mut Actions) {
        let (timestamp, source) = (out.timestamp(now), SOURCE.into());
        out.publish(CmdCreep { timestamp, source, session: self.session, held: self.creeps });
    }

    fn send(&mut self, now: Instant, sticks: Sticks, out: &mut Actions) {
        let Sticks { speed, steering, sideways } = sticks;
        self.steering = steering;
        let (timestamp, priority, source, session) = (out.timestamp(now), PRIORITY, SOURCE.into(), self.session);
        match self.commands {
            Commands::Motion => out.publish(CmdMotion { timestamp, speed, steering, priority, source }),
            Commands::Velocity { .. } => {
                let (vx, vy, omega) = (speed, sideways, steering);
                out.publish(CmdVelocity { timestamp, vx, vy, omega, priority, source, session });
            }
        }
    }

    /// Reports why the held button moves nothing, unless that is obvious.
    fn report_hold(&mut self, out: &mut Actions) {
        let hold = if self.state == State::Run { self.hold } else { Hold::Free };
        if hold == self.reported_hold {
            return;
        }
        let bus = self.config.bus.as_str();
        if self.reported_hold != Hold::Free {
            out.clear(Fault::GamepadNotReleased, bus, "the dead-man button is effective again");
        }
        let why = self.why_not(hold);
        self.reported_hold = if why.is_some() { hold } else { Hold::Free };
        if let Some(why) = why {
            out.raise(Severity::Warning, Fault::GamepadNotReleased, bus, why);
        }
    }

    fn why_not(&self, hold: Hold) -> Option<String> {
        let (device, Some(mapping)) = self.device.as_ref()? else { return None };
        let button = mapping::button(mapping.dead_man);
        match hold {
            Hold::Free | Hold::Drives => None,
            Hold::Stale => Some(format!("{button} was held before: release it first")),
            Hold::OffCentre => {
                let off = |stick: &&Stick| device.axis(stick.code).is_some_and(|axis| !stick.is_centred(axis.value));
                let stick = mapping.sticks().find(off)?;
                Some(format!("{button} was pressed with {} off centre: release that first", mapping::axis(stick.code)))
            }
        }
    }

    fn on_state(&mut self, now: Instant, state: State, out: &mut Actions) {
        self.state = state;
        match state {
            State::Stop | State::Terminate => self.deadlines.clear(Timer::Data),
            _ if !self.deadlines.is_set(Timer::Data) => self.deadlines.set(Timer::Data, now),
            _ => {}
        }
        self.decide(now, out);
    }

    fn on_timer(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.is_due(Timer::Silence, now) {
            self.let_go(now, out);
            out.note(
                "the gamepad has been silent for too long: it counts as released \
             (gamepad.quiet_s = 0 for one with a cable)",
            );
        }
        self.decide(now, out);
        if self.deadlines.tick(Timer::Command, now, COMMAND_PERIOD) {
            let sticks = if self.hold == Hold::Drives { self.demand().sticks } else { Sticks::default() };
            if self.creeps {
                self.send_creep(now, out);
            }
            self.send(now, sticks, out);
        }
        if self.deadlines.tick(Timer::Data, now, DATA_PERIOD) {
            out.publish(self.told(out.timestamp(now)));
        }
    }

    fn told(&self, timestamp: i64) -> DataJoydev {
        let Demand { held, sticks: Sticks { speed, steering, .. }, .. } = self.demand();
        let name = self.device.as_ref().map_or(String::new(), |(device, _)| device.name().into());
        DataJoydev { timestamp, name, connected: self.device.is_some(), dead_man: held, speed, steering }
    }

    /// Deadline at which a gamepad that drives has been silent for too long.
    fn silent_at(&self) -> Option<Instant> {
        self.config.quiet.filter(|_| self.hold.commands()).map(|quiet| self.last_event + quiet)
    }
}

impl Hold {
    /// True while commands are sent.
    const fn commands(self) -> bool {
        matches!(self, Self::OffCentre | Self::Drives)
    }
}

impl Module for Joydev {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.deadlines.set(Timer::Data, now);
                self.session = out.timestamp(now);
                // With or without a gamepad.
                out.working();
            }
            Event::Port { port: PORT, input: Input::Gamepad(news) } => self.on_news(now, news, out),
            Event::Port { port: PORT, input: Input::Down(why) } => {
                self.on_gone(now, &format!("no gamepad connected: {why}"), out);
            }
            Event::State(state) => self.on_state(now, state, out),
            Event::Timer => self.on_timer(now, out),
            Event::Port { .. } | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        self.deadlines.replace(Timer::Silence, self.silent_at());
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }
}
