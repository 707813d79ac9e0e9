//! `advee drive SPEED STEERING [--for S]`: a manual source of motion at 20 Hz, which begins and ends with zero. With
//! `--rotation` or `--left` in place of the steering angle it commands a velocity of the body. It begins with its speed
//! once `driver_canbus` carries out its zero: motion of a source that must still wait for another one would not move
//! the robot, and then the source would have to send zero again.
//! Before that it releases the robot where that waits for an operator: the latch of PAUSE, homing. It ends once its
//! last zero has expired.

use super::bus::{Heard, Tool};
use super::release::Release;
use super::{Common, Failed, Outcome, finite, print, seconds};
use base::{Duration, Instant, Ticker};
use host::clock;
use messages::lowlevel::{CmdCreep, CmdMotion, CmdVelocity, DataMotion};
use messages::simulation::DataRun;
use messages::{Channel, Hold, Message, lowlevel, source_in_words};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(allow_negative_numbers = true, arg_required_else_help = true, after_help = EXAMPLES)]
pub struct Drive {
    /// m/s, forward
    #[arg(value_parser = finite)]
    speed: f64,
    /// rad, to the left; without it straight on
    #[arg(value_parser = finite)]
    steering: Option<f64>,
    /// Rotation to the left, rad/s, in place of STEERING
    #[arg(long, value_name = "RADPS", value_parser = finite, conflicts_with = "steering")]
    rotation: Option<f64>,
    /// Speed to the left, m/s, beside the one forward; of a base that can go sideways
    #[arg(long, value_name = "MPS", value_parser = finite, conflicts_with = "steering")]
    left: Option<f64>,
    /// Duration, s; without it until Ctrl-C
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    /// Creep past the guard where something stands in the way: only while somebody watches
    #[arg(long)]
    creep: bool,
}

const EXAMPLES: &str = "Examples:
  advee drive 0.3 --for 2           2 s straight on, at 0.3 m/s
  advee drive 0.3 0.2               to the left, until Ctrl-C
  advee drive 0.3 --rotation 0.2    to the left by 0.2 rad/s
  advee drive 0 --rotation 0.5      on the spot, if the base can
  advee drive 0 --left 0.2 --for 2  sideways, if the base can
  advee drive -0.2 0 --for 1        backward";

const PERIOD: Duration = Duration::from_millis(50);
/// Time limit, sending zero, for the robot to get ready; homing takes its time.
const READY: Duration = Duration::from_secs(20);
/// Time limit for standstill at the end.
const STAND: Duration = Duration::from_secs(3);
/// Time limit for its last command to expire: that lives for a second at most.
const EXPIRES: Duration = Duration::from_secs(2);
/// Less counts as standing.
const STANDS_MPS: f64 = 0.01;
const STANDS_RADPS: f64 = 0.02;
/// Less counts as not having steered.
const STEERED_RAD: f64 = 0.01;

/// What is commanded beside the speed.
#[derive(Clone, Copy)]
enum Turn {
    /// rad: `LL_CMD_MOTION`.
    Steering(f64),
    /// m/s to the left, and rad/s: `LL_CMD_VELOCITY`.
    Velocity(f64, f64),
}

/// Nothing beside the speed.
const NO_VELOCITY: Turn = Turn::Velocity(0.0, 0.0);

impl Turn {
    fn of(command: &Drive) -> Self {
        match (command.left, command.rotation) {
            (None, None) => Self::Steering(command.steering.unwrap_or(0.0)),
            (left, rotation) => Self::Velocity(left.unwrap_or(0.0), rotation.unwrap_or(0.0)),
        }
    }

    /// The same message without a turn.
    fn none(self) -> Self {
        match self {
            Self::Steering(_) => Self::Steering(0.0),
            Self::Velocity(..) => NO_VELOCITY,
        }
    }

    /// Goes with zero speed at the end: the wheels keep their angle.
    fn at_rest(self) -> Self {
        match self {
            Self::Steering(_) => self,
            Self::Velocity(..) => NO_VELOCITY,
        }
    }

    /// True if it is carried out with the steering angle `from`, rad.
    fn is_none_from(self, from: f64) -> bool {
        match self {
            Self::Steering(steering) => (steering - from).abs() < STEERED_RAD,
            Self::Velocity(left, rotation) => left == 0.0 && rotation == 0.0,
        }
    }

    fn words(self) -> String {
        match self {
            Self::Steering(steering) => format!("{steering} rad"),
            Self::Velocity(0.0, rotation) => format!("{rotation} rad/s"),
            Self::Velocity(left, rotation) => format!("{left} m/s to the left, {rotation} rad/s"),
        }
    }
}

/// Commands sent, and messages received.
struct Session {
    tool: Tool,
    grid: Ticker,
    last: Option<DataMotion>,
    told: String,
    /// Why the robot does not do all that it is commanded to do; empty if it does.
    bounded: String,
    /// What waits for an operator is released; absent once the robot is ready.
    release: Option<Release>,
    /// Number of this session.
    number: i64,
    /// It creeps past the guard.
    creeps: bool,
    /// It neither turns on the spot nor goes sideways, as last measured.
    stands: bool,
    /// It did so once.
    moved: bool,
}

/// Why a phase ended.
#[derive(PartialEq, Eq)]
enum End {
    Reached,
    Time,
    Interrupt,
}

pub fn drive(common: &Common, command: &Drive) -> Outcome {
    let channels = [Channel::LlDataMotion, Channel::LlDataVelocity, Channel::LlDataHold, Channel::SimDataRun];
    let tool = Tool::join(common, "drive", &channels)?;
    let (number, grid, turn) = (tool.timestamp(), Ticker::new(clock::now(), PERIOD), Turn::of(command));
    let mut session = Session {
        tool,
        grid,
        last: None,
        told: String::new(),
        bounded: String::new(),
        release: Some(Release::default()),
        number,
        creeps: command.creep,
        stands: true,
        moved: false,
    };
    // Drives that were in fault have no torque before a motion is commanded.
    let source = session.tool.source.clone();
    let ready = |motion: &DataMotion| motion.homed && motion.reason.is_empty() && motion.source == source;
    match session.command(0.0, turn.none(), clock::now() + READY, ready)? {
        End::Reached => {}
        End::Time => {
            return Err(format!("not ready within {} s: {}", READY.as_secs(), session.reason(common)).into());
        }
        End::Interrupt => return Err("interrupted before the robot was ready".into()),
    }
    session.release = None;
    let _ = print(format_args!("driving at {} m/s, {}", command.speed, turn.words()));
    let from = session.last.as_ref().map_or(0.0, |motion| motion.steering);
    let mut moved = command.speed.abs() < STANDS_MPS && turn.is_none_from(from);
    let until = command.time.map_or(Instant::NEVER, |time| clock::now() + time);
    session.command(command.speed, turn, until, |motion| {
        moved |= motion.speed.abs() >= STANDS_MPS || (motion.steering - from).abs() >= STEERED_RAD;
        false
    })?;
    let why_not = session.reason(common);
    moved |= session.moved;
    let stands = |motion: &DataMotion| motion.speed.abs() < STANDS_MPS && motion.speed_target == 0.0;
    let stood = session.command(0.0, turn.at_rest(), clock::now() + STAND, stands)?;
    if !moved {
        // A goal that follows must not find this source driving, either.
        session.expire()?;
        return Err(format!("the robot did not move: {why_not}").into());
    }
    match stood {
        End::Reached => {
            let _ = print(format_args!("the robot stands"));
            session.expire()?;
            Ok(ExitCode::SUCCESS)
        }
        End::Time | End::Interrupt => Err("the robot was told to stop and is not known to stand".into()),
    }
}

/// True if a simulation at another speed, or paused, refuses the motion commands of this source.
fn is_refused(run: &DataRun, source: &str) -> bool {
    (run.paused || run.speed != 1.0) && run.not_in_step.iter().any(|name| name == source)
}

impl Session {
    /// Commands this motion until `reached`, `until` or Ctrl-C, and prints on the way why the robot does not move.
    fn command(
        &mut self,
        speed: f64,
        turn: Turn,
        until: Instant,
        mut reached: impl FnMut(&DataMotion) -> bool,
    ) -> Result<End, Failed> {
        loop {
            let now = clock::now();
            if now >= until {
                return Ok(End::Time);
            }
            if self.grid.due(now) {
                let (timestamp, source) = (self.tool.timestamp(), self.tool.source.clone());
                let (session, priority) = (self.number, CmdMotion::REMOTE);
                if self.creeps {
                    let (source, held) = (source.clone(), speed != 0.0);
                    self.tool.publish(CmdCreep { timestamp, source, session, held })?;
                }
                match turn {
                    Turn::Steering(steering) => {
                        self.tool.publish(CmdMotion { timestamp, speed, steering, priority, source })?;
                    }
                    Turn::Velocity(vy, omega) => {
                        let vx = speed;
                        self.tool.publish(CmdVelocity { timestamp, vx, vy, omega, priority, source, session })?;
                    }
                }
            }
            match self.tool.hear(self.grid.next().min(until))? {
                Heard::Message(Message::LlDataMotion(motion)) => {
                    self.tell(self.waits_for(&motion).unwrap_or_else(|| motion.reason.clone()));
                    let end = reached(&motion) && self.stands;
                    self.last = Some(motion);
                    if end {
                        return Ok(End::Reached);
                    }
                }
                Heard::Message(Message::LlDataHold(list)) => {
                    if list.is_of_motion() {
                        self.bounded = list.holds.first().map_or_else(String::new, lowlevel::Hold::words);
                    }
                    if let Some(release) = &mut self.release {
                        release.on_holds(&mut self.tool, &list)?;
                    }
                }
                Heard::Message(Message::LlDataVelocity(velocity)) => {
                    // The speed is that forward. What is not known does not stand.
                    self.stands = velocity.vy.abs() < STANDS_MPS && velocity.omega.abs() < STANDS_RADPS;
                    let moves = velocity.vy.abs() >= STANDS_MPS || velocity.omega.abs() >= STANDS_RADPS;
                    self.moved |= self.release.is_none() && moves;
                }
                Heard::Message(Message::SimDataRun(run)) if is_refused(&run, &self.tool.source) => {
                    return Err("the simulation refuses commands by the wall clock unless its time passes as real \
                                time does: advee sim speed 1, advee sim run"
                        .into());
                }
                Heard::Message(_) | Heard::Nothing => {}
                Heard::Interrupt => return Ok(End::Interrupt),
            }
        }
    }

    /// Waits, without a command, until the last one has expired, or Ctrl-C: a goal that is older than that releases
    /// nothing, and one that a person gives after this command is meant to.
    fn expire(&mut self) -> Result<(), Failed> {
        let until = clock::now() + EXPIRES;
        while clock::now() < until {
            match self.tool.hear(until)? {
                Heard::Message(Message::LlDataMotion(motion)) if motion.source != self.tool.source => break,
                Heard::Interrupt => break,
                Heard::Message(_) | Heard::Nothing => {}
            }
        }
        Ok(())
    }

    /// Who drives the robot while this source must wait. The first message may be from before its first zero.
    fn waits_for(&self, motion: &DataMotion) -> Option<String> {
        let before = self.last.as_ref().filter(|_| self.release.is_some() && motion.reason.is_empty())?;
        let other = motion.source != self.tool.source && motion.source == before.source;
        other.then(|| Hold::OtherSource.words(&motion.source))
    }

    /// Prints a reason when it is another one. That nobody reads it must not end the driving halfway.
    fn tell(&mut self, reason: String) {
        if self.told != reason {
            if !reason.is_empty() {
                // Only what is waited for has a limit.
                let limit = self.release.as_ref().map(|_| format!(", at most {} s", READY.as_secs()));
                let _ = print(format_args!("waiting{}: {reason}", limit.unwrap_or_default()));
            }
            self.told = reason;
        }
    }

    fn reason(&self, common: &Common) -> String {
        match &self.last {
            None => format!("LL_DATA_MOTION is not heard on {}; is advee up?", common.lcm_url()),
            Some(motion) if !motion.reason.is_empty() => motion.reason.clone(),
            Some(motion) if !motion.homed => "the steering is not homed".into(),
            Some(motion) if !motion.source.is_empty() && motion.source != self.tool.source => {
                format!("{} holds the motion", source_in_words(&motion.source))
            }
            Some(_) if !self.bounded.is_empty() => self.bounded.clone(),
            Some(_) => "no reason is known".into(),
        }
    }
}
