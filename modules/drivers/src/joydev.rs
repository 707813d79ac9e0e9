//! `driver_joydev`: a gamepad as a manual source of motion, with a dead-man button.
//!
//! Device    any with two axes and a button, as [`base::gamepad`] has it; docs/gamepad.md
//! Commands  `LL_CMD_MOTION` of priority 2 at 20 Hz while the dead-man button is held, then a zero, then nothing
//! Data      `LL_DATA_JOYDEV` at 5 Hz
//! Silence   a gamepad that is not there is no error; one that goes counts as let go, and so does one that came anew
//!
//! Nothing moves the robot but a button that was seen to be let go and pressed, with both sticks seen in the middle since.
//! In PAUSE it tells what the gamepad does and commands nothing, in STOP it does neither.

mod config;
mod mapping;
#[cfg(test)]
mod tests;

pub use config::{Config, ConfigError, Gear, StickConfig};
pub use mapping::{Mapping, Refusal, Stick};

use base::gamepad::{Device, Input as News};
use base::{Deadlines, Duration, Fault, Instant, Severity};
use messages::lowlevel::{CmdMotion, DataJoydev};
use module::{Actions, Event, Input, Line, Module, PortId, PortSpec, State};

/// The module's name.
pub const NAME: &str = "driver_joydev";
/// What its commands call their source.
pub const SOURCE: &str = "gamepad";
/// A gamepad's priority among the sources of motion.
const PRIORITY: i8 = 2;

const PORT: PortId = PortId(0);
const COMMAND: Duration = Duration::from_millis(50);
const DATA: Duration = Duration::from_millis(200);

base::deadlines! {
    /// What the driver waits for.
    enum Timer {
        /// A command is sent. Set while the dead-man button moves the robot.
        Command,
        /// `LL_DATA_JOYDEV` is published. Set from the start on, except in STOP.
        Data,
        /// A gamepad that moves the robot has been silent for too long.
        Silence,
    }
}

/// How the dead-man button is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Hold {
    /// It is free.
    Free,
    /// It was held when it could not count, and must be let go first.
    Stale,
    /// A stick was off the middle when it was pressed: zero is commanded until both have been there.
    OffCentre,
    /// What the sticks ask for is commanded.
    Drives,
}

/// The driver.
#[derive(Debug)]
pub struct Joydev {
    config: Config,
    ports: [PortSpec; 1],
    state: State,
    /// What is there, and what it is for; none: it cannot drive the robot.
    device: Option<(Device, Option<Mapping>)>,
    hold: Hold,
    /// When it last told something.
    heard: Instant,
    /// The steering angle that was commanded last, rad.
    steering: f64,
    deadlines: Deadlines<Timer>,
    /// It was told that there is none.
    told_gone: bool,
    /// How the button was held when it was last told that it moves nothing; free: nothing is to be told.
    told_hold: Hold,
}

/// What the gamepad asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Asked {
    held: bool,
    centred: bool,
    speed: f64,
    steering: f64,
}

impl Joydev {
    /// The driver.
    ///
    /// # Errors
    /// What cannot be meant.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            ports: [PortSpec { bus: config.bus.clone(), line: Line::Gamepad }],
            config,
            state: State::Init,
            device: None,
            hold: Hold::Free,
            heard: Instant::ZERO,
            steering: 0.0,
            deadlines: Deadlines::new(),
            told_gone: false,
            told_hold: Hold::Free,
        })
    }

    fn on_news(&mut self, now: Instant, news: News<'_>, out: &mut Actions) {
        self.heard = now;
        match (news, &mut self.device) {
            (News::Found(device), _) => self.on_found(now, device, out),
            (News::Gone, _) => self.on_gone(now, "not connected", out),
            (News::Axis { code, value }, Some((device, _))) => device.set_axis(code, value),
            (News::Button { code, pressed }, Some((device, mapping))) => {
                device.set_button(code, pressed);
                // At once: it may be pressed again within the same frame.
                if !pressed && mapping.as_ref().is_some_and(|mapping| mapping.dead_man == code) {
                    self.judge(now, out);
                }
            }
            // What belongs together is judged together.
            (News::Frame, Some(_)) => self.judge(now, out),
            _ => {}
        }
    }

    /// It may be another one, or the same after it told what nobody heard: it counts as let go.
    fn on_found(&mut self, now: Instant, device: &Device, out: &mut Actions) {
        self.let_go(now, out);
        let known = self.device.as_ref().is_some_and(|(own, _)| own.name() == device.name());
        let mapping = Mapping::of(&self.config, device);
        let (bus, name) = (self.config.bus.as_str(), device.name());
        match &mapping {
            Ok(Mapping { speed, steering, dead_man }) => {
                if !known {
                    let (speed, steering) = (mapping::axis(speed.code), mapping::axis(steering.code));
                    let dead_man = mapping::button(*dead_man);
                    out.note(format!("{name}: speed {speed}, steering {steering}, dead man {dead_man}"));
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
        self.told_gone = false;
        self.judge(now, out);
    }

    fn on_gone(&mut self, now: Instant, why: &str, out: &mut Actions) {
        self.let_go(now, out);
        self.device = None;
        self.hold = Hold::Free;
        self.tell_hold(out);
        out.clear(Fault::GamepadRefused, self.config.bus.as_str(), "it is gone");
        if !self.told_gone {
            self.told_gone = true;
            out.note(why);
        }
    }

    /// What it asks for; nothing when it is not there, or cannot drive the robot.
    fn asked(&self) -> Asked {
        let Some((device, Some(mapping))) = &self.device else { return Asked::default() };
        let raw = |stick: &Stick| device.axis(stick.code).map_or(0, |axis| axis.value);
        let held = |code: u16| device.button(code) == Some(true);
        let gear = [self.config.slow, self.config.fast].into_iter().flatten().find(|gear| held(gear.button));
        let (speed, steering) = (&mapping.speed, &mapping.steering);
        Asked {
            held: held(mapping.dead_man),
            centred: speed.is_centred(raw(speed)) && steering.is_centred(raw(steering)),
            speed: speed.asks(raw(speed)) * gear.map_or(self.config.scale, |gear| gear.scale),
            steering: steering.asks(raw(steering)),
        }
    }

    /// Decides whether it moves the robot.
    fn judge(&mut self, now: Instant, out: &mut Actions) {
        let asked = self.asked();
        let before = self.hold;
        self.hold = match (before, asked) {
            (_, Asked { held: false, .. }) => Hold::Free,
            (Hold::Stale, _) => Hold::Stale,
            _ if self.state != State::Run => Hold::Stale,
            (Hold::Drives, _) => Hold::Drives,
            (_, Asked { centred: true, .. }) => Hold::Drives,
            (_, _) => Hold::OffCentre,
        };
        match (before.commands(), self.hold.commands()) {
            (true, false) => self.zero(now, out),
            (false, true) => self.deadlines.set(Timer::Command, now),
            _ => {}
        }
        self.tell_hold(out);
    }

    /// Ends the motion, whatever the button does.
    fn let_go(&mut self, now: Instant, out: &mut Actions) {
        if self.hold.commands() {
            self.hold = Hold::Stale;
            self.zero(now, out);
        }
    }

    /// The last command: to stand, the wheels as they are.
    fn zero(&mut self, now: Instant, out: &mut Actions) {
        self.deadlines.clear(Timer::Command);
        let steering = self.steering;
        self.send(now, 0.0, steering, out);
    }

    fn send(&mut self, now: Instant, speed: f64, steering: f64, out: &mut Actions) {
        self.steering = steering;
        let (timestamp, source) = (out.timestamp(now), SOURCE.into());
        out.publish(CmdMotion { timestamp, speed, steering, priority: PRIORITY, source });
    }

    /// Tells why the button is held and moves nothing, where that could be expected of it.
    fn tell_hold(&mut self, out: &mut Actions) {
        let hold = if self.state == State::Run { self.hold } else { Hold::Free };
        if hold == self.told_hold {
            return;
        }
        let bus = self.config.bus.as_str();
        if self.told_hold != Hold::Free {
            out.clear(Fault::GamepadNotReleased, bus, "the dead-man button does what it is to do");
        }
        let why = self.why_not(hold);
        self.told_hold = if why.is_some() { hold } else { Hold::Free };
        if let Some(why) = why {
            out.raise(Severity::Warning, Fault::GamepadNotReleased, bus, why);
        }
    }

    fn why_not(&self, hold: Hold) -> Option<String> {
        let (device, Some(mapping)) = self.device.as_ref()? else { return None };
        let button = mapping::button(mapping.dead_man);
        match hold {
            Hold::Free | Hold::Drives => None,
            Hold::Stale => Some(format!("{button} was held before: let it go first")),
            Hold::OffCentre => {
                let off = |stick: &&Stick| device.axis(stick.code).is_some_and(|axis| !stick.is_centred(axis.value));
                let stick = [&mapping.speed, &mapping.steering].into_iter().find(off)?;
                Some(format!(
                    "{button} was pressed with {} off its middle: let that go first",
                    mapping::axis(stick.code)
                ))
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
        self.judge(now, out);
    }

    fn on_timer(&mut self, now: Instant, out: &mut Actions) {
        if self.deadlines.is_due(Timer::Silence, now) {
            self.let_go(now, out);
            out.note("the gamepad has said nothing for too long: it counts as let go");
        }
        self.judge(now, out);
        if self.deadlines.tick(Timer::Command, now, COMMAND) {
            let Asked { speed, steering, .. } = self.asked();
            let (speed, steering) = if self.hold == Hold::Drives { (speed, steering) } else { (0.0, 0.0) };
            self.send(now, speed, steering, out);
        }
        if self.deadlines.tick(Timer::Data, now, DATA) {
            out.publish(self.told(out.timestamp(now)));
        }
    }

    fn told(&self, timestamp: i64) -> DataJoydev {
        let Asked { held, speed, steering, .. } = self.asked();
        let name = self.device.as_ref().map_or(String::new(), |(device, _)| device.name().into());
        DataJoydev { timestamp, name, connected: self.device.is_some(), dead_man: held, speed, steering }
    }

    /// When a gamepad that drives has been silent for too long.
    fn silent_at(&self) -> Option<Instant> {
        self.config.quiet.filter(|_| self.hold.commands()).map(|quiet| self.heard + quiet)
    }
}

impl Hold {
    /// Whether commands are sent.
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
                // With or without a gamepad.
                out.working();
            }
            Event::Port { port: PORT, input: Input::Gamepad(news) } => self.on_news(now, news, out),
            Event::Port { port: PORT, input: Input::Down(why) } => {
                self.on_gone(now, &format!("not connected: {why}"), out);
            }
            Event::State(state) => self.on_state(now, state, out),
            Event::Timer => self.on_timer(now, out),
            Event::Port { .. } | Event::Message { .. } | Event::Heard { .. } | Event::Process(_) => {}
        }
        self.deadlines.replace(Timer::Silence, self.silent_at());
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }
}
