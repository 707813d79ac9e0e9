//! Arbitration of motion commands (docs/design.md, section 4): priorities, time to live, and no resumption without a
//! release.
//!
//! Silence is no release: a manual source whose last command was motion, and that fell silent, was overruled or met a
//! stop, must send zero, however long it was silent. A source that was never received before moves the robot at once.
//! A source is identified by its name and priority: commands of both messages are those of one source, and a session of
//! `LL_CMD_VELOCITY` can only take a permission away.
//!
//! Pure policy over the sources' commands; independent of drives and bus.

use base::{Duration, Instant, Key};
use messages::lowlevel::{CmdMotion, CmdVelocity};
use std::ops::RangeInclusive;

/// Maximum number of sources with a row; a further one takes the row of the one that has been silent longest, of those
/// whose last command was zero if there is one.
pub const SOURCES_MAX: usize = 8;
/// Maximum number of sources without a row that are remembered because their last command was motion. Beyond it every
/// source without a row must send zero first.
const DISPLACED_MAX: usize = 64;

/// Source of commands, identified by its row in the arbiter's table: one name at one priority until another source
/// takes the row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SourceId(u8);

/// All rows of the table.
const IDS: [SourceId; SOURCES_MAX] = {
    let mut ids = [SourceId(0); SOURCES_MAX];
    let mut row = 0;
    while row < SOURCES_MAX {
        ids[row] = SourceId(row as u8);
        row += 1;
    }
    ids
};

impl Key for SourceId {
    type Table = [Instant; SOURCES_MAX];
    const ALL: &'static [Self] = &IDS;
    const EMPTY: Self::Table = [Instant::NEVER; SOURCES_MAX];

    fn index(self) -> usize {
        usize::from(self.0)
    }
}

/// What a command says beside the forward speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Course {
    /// Steering angle of the equivalent single front wheel, rad; counter-clockwise: `LL_CMD_MOTION`.
    Steering(f64),
    /// Velocity to the left, m/s, and rotation, rad/s; counter-clockwise: `LL_CMD_VELOCITY`.
    Velocity {
        /// To the left.
        vy: f64,
        /// Rotation.
        omega: f64,
    },
}

impl Course {
    /// True if it commands no motion by itself. Turning the steering of a robot that stands does not count as motion.
    fn is_zero(self) -> bool {
        matches!(self, Self::Steering(_) | Self::Velocity { vy: 0.0, omega: 0.0 })
    }

    /// True if both are of the same message.
    fn is_like(self, other: Self) -> bool {
        matches!(self, Self::Steering(_)) == matches!(other, Self::Steering(_))
    }
}

/// Command of either message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request<'a> {
    /// Forward speed of the robot frame's origin, m/s.
    pub speed: f64,
    /// The rest of the motion.
    pub course: Course,
    /// 0 planner, 1 remote operator, 2 gamepad, 3 maintenance.
    pub priority: i8,
    /// Name of the source.
    pub source: &'a str,
    /// Number that the program drew at its start; `LL_CMD_MOTION` has none.
    pub session: Option<i64>,
}

impl Request<'_> {
    /// True if it commands no motion, be the base able to follow it or not.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.speed == 0.0 && self.course.is_zero()
    }
}

impl<'a> From<&'a CmdMotion> for Request<'a> {
    fn from(command: &'a CmdMotion) -> Self {
        let &CmdMotion { speed, steering, priority, ref source, .. } = command;
        Self { speed, course: Course::Steering(steering), priority, source, session: None }
    }
}

impl<'a> From<&'a CmdVelocity> for Request<'a> {
    fn from(command: &'a CmdVelocity) -> Self {
        let &CmdVelocity { vx, vy, omega, priority, ref source, session, .. } = command;
        Self { speed: vx, course: Course::Velocity { vy, omega }, priority, source, session: Some(session) }
    }
}

/// Motion requested by a source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Forward speed of the robot frame's origin, m/s.
    pub speed: f64,
    /// The rest of the motion.
    pub course: Course,
    /// 0 planner, 1 remote operator, 2 gamepad, 3 maintenance.
    pub priority: i8,
    /// Source of the command.
    pub source: SourceId,
}

impl Command {
    fn is_zero(&self) -> bool {
        self.speed == 0.0 && self.course.is_zero()
    }
}

/// Priority of the planner; all higher ones are manual sources.
pub const PLANNER: i8 = 0;
/// Valid priorities.
pub const PRIORITIES: RangeInclusive<i8> = PLANNER..=3;

/// Decision on a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It moves the robot now.
    Holds,
    /// Another source holds the motion.
    Overruled,
    /// Another source of the same priority holds the motion, which is reported to people.
    Contested,
    /// The source must send zero first: the robot was stopped since it began, or it was silent.
    NotReleased,
    /// An operator must release the planner first.
    Latched,
    /// The robot is stopped for a fault: no source moves it.
    Blocked,
}

/// Relation of a command to the earlier ones of its source, by their sessions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Program {
    /// The same program, or one that does not say.
    Same,
    /// The program was started again: the earlier one has been silent for its time to live.
    Again,
    /// Another program commands under the same name.
    Another,
}

#[derive(Debug)]
struct Source {
    name: String,
    command: Command,
    at: Instant,
    /// Session of its last command that had one, and the time of that command.
    session: Option<(i64, Instant)>,
    /// True if it may move the robot: its last command was zero, or it is new, or it has moved the robot without a
    /// break since.
    armed: bool,
}

impl Source {
    fn is_of(&self, request: &Request<'_>) -> bool {
        self.command.priority == request.priority && self.name == request.source
    }

    /// Program that sends a command with this session, received at `at`.
    fn program(&self, at: Instant, session: Option<i64>, ttl: Duration) -> Program {
        match (self.session, session) {
            (Some((before, last)), Some(session)) if before != session => {
                if at.since(last) < ttl {
                    Program::Another
                } else {
                    Program::Again
                }
            }
            _ => Program::Same,
        }
    }
}

/// Arbiter of the motion.
#[derive(Debug)]
pub struct Arbiter {
    ttl: Duration,
    /// At most [`SOURCES_MAX`] rows.
    sources: Vec<Source>,
    displaced: Displaced,
    /// Source that moves the robot; kept after its last command until the robot stands.
    holder: Option<SourceId>,
    latched: bool,
    /// Releases by an operator from before this time are void: the end of the last stop, or the last manual command.
    release_after: Instant,
    /// The last release of the planner that took effect.
    released: Instant,
}

impl Arbiter {
    /// Creates an arbiter with commands valid for `ttl`. The planner is latched at first.
    #[must_use]
    pub fn new(ttl: Duration) -> Self {
        Self {
            ttl,
            sources: Vec::with_capacity(SOURCES_MAX),
            displaced: Displaced::default(),
            holder: None,
            latched: true,
            release_after: Instant::ZERO,
            released: Instant::ZERO,
        }
    }

    /// Processes a command received at `at`; `blocked` if a stop for a fault is in force. Returns the source, so that
    /// its name need not be looked up again, and the verdict.
    pub fn command<'a>(&mut self, at: Instant, command: impl Into<Request<'a>>, blocked: bool) -> (SourceId, Verdict) {
        let request = command.into();
        let (id, new) = self.place(at, &request);
        (id, self.judge(at, id, new, &request, blocked))
    }

    fn judge(&mut self, at: Instant, id: SourceId, new: bool, request: &Request<'_>, blocked: bool) -> Verdict {
        let &Request { speed, course, priority, session, .. } = request;
        let manual = priority > PLANNER;
        let rival = self.rival(at, id, priority);
        let program = self.sources[id.index()].program(at, session, self.ttl);
        let released_since = program == Program::Again && self.released > self.sources[id.index()].at;
        if !manual && rival.is_none() && program != Program::Same && !released_since {
            // An operator has released the earlier program.
            self.latch_planner(at);
        }
        let source = &mut self.sources[id.index()];
        let silent = at.since(source.at) >= self.ttl && !source.command.is_zero();
        let verdict = match rival {
            Some(other) if other == priority => Verdict::Contested,
            Some(_) => Verdict::Overruled,
            None => Verdict::Holds,
        };
        let held = verdict == Verdict::Holds && !blocked;
        let goes_on = source.armed && !silent && program != Program::Another;
        source.armed = request.is_zero() || (held && (new || goes_on));
        source.at = at;
        source.command = Command { speed, course, priority, source: id };
        if manual || rival.is_none() {
            // Another program that does not plan now is still another one when it does.
            source.session = session.map(|session| (session, at)).or(source.session);
        }
        if !held {
            return if blocked { Verdict::Blocked } else { verdict };
        }
        if !manual && self.latched {
            return Verdict::Latched;
        }
        if manual && !source.armed {
            return Verdict::NotReleased;
        }
        if manual {
            self.latched = true;
            self.release_after = self.release_after.max(at);
        }
        self.holder = Some(id);
        Verdict::Holds
    }

    /// The process was restarted and does not know which sources commanded before: every source must send zero first.
    pub fn trust_no_new_source(&mut self) {
        self.displaced.full = true;
    }

    /// True for a deliberate press: a command that moves, of a manual source whose last command was zero.
    #[must_use]
    pub fn is_press(&self, at: Instant, request: &Request<'_>) -> bool {
        let zero = |source: &Source| {
            let program = source.program(at, request.session, self.ttl);
            source.is_of(request) && source.command.is_zero() && program != Program::Another
        };
        request.priority > PLANNER && !request.is_zero() && self.sources.iter().any(zero)
    }

    /// True if the source's last command, of the other message, was received later: the messages came by two ways.
    #[must_use]
    pub fn is_outdated(&self, at: Instant, request: &Request<'_>) -> bool {
        let later = |source: &Source| at < source.at && !source.command.course.is_like(request.course);
        self.sources.iter().any(|source| source.is_of(request) && later(source))
    }

    /// True while a manual source holds the motion.
    #[must_use]
    pub fn is_held_by_hand(&self, now: Instant) -> bool {
        self.current(now).is_some_and(|command| command.priority > PLANNER)
    }

    /// Command that moves the robot at `now`, if any.
    #[must_use]
    pub fn current(&self, now: Instant) -> Option<Command> {
        let source = &self.sources[self.holder?.index()];
        let may = source.armed || source.command.priority == PLANNER;
        (may && now.since(source.at) < self.ttl).then_some(source.command)
    }

    /// Name of a source.
    #[must_use]
    pub fn name(&self, source: SourceId) -> &str {
        self.sources.get(source.index()).map_or("", |source| &source.name)
    }

    /// Priority of a source; [`PLANNER`] for an unused row.
    #[must_use]
    pub fn priority(&self, source: SourceId) -> i8 {
        self.sources.get(source.index()).map_or(PLANNER, |source| source.command.priority)
    }

    /// To be called after the decision at `now` was carried out. A holder whose command had expired by then has been
    /// stopped: if it was not silent but received late, its next command must not move the robot again without a
    /// release.
    pub fn expire_holder(&mut self, now: Instant) {
        if self.current(now).is_none()
            && let Some(holder) = self.holder
        {
            let source = &mut self.sources[holder.index()];
            source.armed &= source.command.is_zero();
        }
    }

    /// Expiry of the current command.
    #[must_use]
    pub fn poll_timeout(&self, now: Instant) -> Option<Instant> {
        let current = self.current(now)?;
        Some(self.sources[current.source.index()].at + self.ttl)
    }

    /// The robot stands: a holder without a valid command loses the motion and must be released like a stopped one.
    pub fn on_standstill(&mut self, now: Instant) {
        if self.current(now).is_none() {
            self.expire_holder(now);
            self.holder = None;
        }
    }

    /// The robot is being stopped for a fault, a PAUSE, or by an operator: all sources must be released again. To be
    /// called again at the end of the cause: releases given before do not count.
    pub fn disarm_all(&mut self, now: Instant) {
        self.latched = true;
        self.release_after = now;
        self.holder = None;
        for source in &mut self.sources {
            source.armed &= source.command.is_zero();
        }
    }

    /// A module without which the planner must not drive is gone: earlier releases are void, and a planner that holds
    /// the motion loses it. Manual sources go on.
    pub fn latch_planner(&mut self, now: Instant) {
        self.latched = true;
        self.release_after = self.release_after.max(now);
        self.holder = self.holder.filter(|id| self.sources[id.index()].command.priority > PLANNER);
    }

    /// An operator releases the planner by a `cmd_goal`, a `cmd_mode` that is an order to drive, or a manual
    /// `cmd_state` RUN, received at `at`. Without effect while a manual source moves the robot, and if received before
    /// the end of the last stop.
    pub fn release_planner(&mut self, at: Instant) {
        let manual = self.current(at).is_some_and(|command| command.priority > PLANNER);
        if !manual && at >= self.release_after {
            (self.latched, self.released) = (false, at);
        }
    }

    /// Priority of an active source that a command of `id` cannot overrule.
    fn rival(&self, at: Instant, id: SourceId, priority: i8) -> Option<i8> {
        let holder = self.holder.filter(|holder| *holder != id)?;
        let held = self.sources[holder.index()].command.priority;
        let stronger = held > priority && self.current(at).is_some();
        // Of two equal priorities the first one holds until it is silent and the robot stands.
        (stronger || held == priority).then_some(held)
    }

    /// Row of a command's source, and true if the source was never received before. A source without a row takes that
    /// of the source that has been silent longest. The holder keeps its own.
    fn place(&mut self, at: Instant, request: &Request<'_>) -> (SourceId, bool) {
        let &Request { speed, course, priority, source: name, .. } = request;
        if let Some(row) = self.sources.iter().position(|source| source.is_of(request)) {
            return (IDS[row], false);
        }
        let new = !self.displaced.take(name, priority);
        if self.sources.len() < SOURCES_MAX {
            let source = IDS[self.sources.len()];
            let command = Command { speed, course, priority, source };
            self.sources.push(Source { name: name.into(), command, at, session: None, armed: false });
            return (source, new);
        }
        let others = IDS.into_iter().filter(|id| Some(*id) != self.holder);
        let age = |id: &SourceId| {
            let row = &self.sources[id.index()];
            (!row.command.is_zero(), row.at)
        };
        let source = others.min_by_key(age).unwrap_or(IDS[0]);
        let row = &mut self.sources[source.index()];
        if !row.command.is_zero() {
            self.displaced.put(&row.name, row.command.priority);
        }
        row.at = at;
        row.name.clear();
        row.name.push_str(name);
        row.command = Command { speed, course, priority, source };
        (row.session, row.armed) = (None, false);
        (source, new)
    }
}

/// Sources that lost their row and whose last command was motion: they do not count as new.
#[derive(Debug, Default)]
struct Displaced {
    /// Hashes of name and priority, at most [`DISPLACED_MAX`].
    sources: Vec<u64>,
    /// More were displaced than can be remembered.
    full: bool,
}

impl Displaced {
    fn put(&mut self, name: &str, priority: i8) {
        let hash = hash(name, priority);
        if self.sources.contains(&hash) {
            return;
        }
        if self.sources.len() < DISPLACED_MAX {
            self.sources.push(hash);
        } else {
            self.full = true;
        }
    }

    /// Removes a source that gets a row; true if it was displaced, as far as can be known.
    fn take(&mut self, name: &str, priority: i8) -> bool {
        let hash = hash(name, priority);
        let known = self.sources.iter().position(|known| *known == hash);
        known.map(|place| self.sources.swap_remove(place)).is_some() || self.full
    }
}

/// FNV-1a of name and priority. Two sources with the same hash count as one, which must send zero.
fn hash(name: &str, priority: i8) -> u64 {
    let bytes = name.bytes().chain([priority as u8]);
    bytes.fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3))
}

/// True if a command may carry this priority.
#[must_use]
pub fn is_priority(priority: i8) -> bool {
    PRIORITIES.contains(&priority)
}

#[cfg(test)]
mod tests {
    use super::*;
    use Verdict::{Blocked, Contested, Holds, Latched, NotReleased, Overruled};

    struct Bench(Arbiter);

    impl Bench {
        fn new() -> Self {
            Self(Arbiter::new(Duration::from_millis(250)))
        }

        fn say(&mut self, ms: u64, source: &str, priority: i8, speed: f64) -> Verdict {
            let command = CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source: source.into() };
            self.0.command(Instant::from_millis(1000 + ms), &command, false).1
        }

        fn say_blocked(&mut self, ms: u64, source: &str, priority: i8, speed: f64) -> Verdict {
            let command = CmdMotion { timestamp: 0, speed, steering: 0.0, priority, source: source.into() };
            self.0.command(Instant::from_millis(1000 + ms), &command, true).1
        }

        fn moves(&self, ms: u64) -> Option<f64> {
            self.0.current(Instant::from_millis(1000 + ms)).map(|command| command.speed)
        }
    }

    #[test]
    fn a_command_lives_for_its_time_and_no_longer() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        assert_eq!(bench.moves(249), Some(0.4));
        assert_eq!(bench.moves(250), None);
    }

    #[test]
    fn the_higher_priority_takes_over_and_the_lower_does_not_resume_by_itself() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        assert_eq!(bench.say(10, "pad", 2, 0.2), Holds);
        assert_eq!(bench.moves(11), Some(0.2));
        assert_eq!(bench.say(50, "op", 1, 0.4), Overruled);
        // The gamepad is silent from 260 on; the operator has never released the stick.
        assert_eq!(bench.say(270, "op", 1, 0.4), NotReleased);
        assert_eq!(bench.say(320, "op", 1, 0.4), NotReleased);
        assert_eq!(bench.moves(321), None);
        assert_eq!(bench.say(370, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(420, "op", 1, 0.4), Holds);
    }

    #[test]
    fn of_equal_priorities_the_first_holds_until_it_is_silent_and_the_robot_stands() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "a", 1, 0.4), Holds);
        assert_eq!(bench.say(10, "b", 1, 0.1), Contested);
        assert_eq!(bench.say(300, "b", 1, 0.0), Contested);
        bench.0.on_standstill(Instant::from_millis(1310));
        assert_eq!(bench.say(320, "b", 1, 0.1), Holds);
        assert_eq!(bench.say(330, "a", 1, 0.4), Contested);
    }

    #[test]
    fn a_source_received_late_at_standstill_does_not_continue() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        // Served at 260, received at 200: the driver was late, and the robot was stopped before.
        bench.0.on_standstill(Instant::from_millis(1255));
        assert_eq!(bench.say(200, "op", 1, 0.4), NotReleased);
        assert_eq!(bench.say(250, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(300, "op", 1, 0.4), Holds);
    }

    #[test]
    fn after_a_stop_a_source_must_send_zero_first_however_long_it_was_silent() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        bench.0.disarm_all(Instant::from_millis(1001));
        assert_eq!(bench.moves(1), None);
        assert_eq!(bench.say_blocked(50, "op", 1, 0.4), Blocked);
        // The fault is cleared, the source was not released.
        assert_eq!(bench.say(100, "op", 1, 0.4), NotReleased);
        assert_eq!(bench.say(350, "op", 1, 0.4), NotReleased, "silent for its time to live");
        assert_eq!(bench.say(3_600_000, "op", 1, 0.4), NotReleased, "silent for an hour");
        assert_eq!(bench.say(3_600_050, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(3_600_100, "op", 1, 0.4), Holds);
    }

    #[test]
    fn a_source_that_stalls_does_not_continue() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(50, "op", 1, 0.3), Holds);
        // Nothing for 300 ms: a stalled radio, a process held up. The stick is still held.
        assert_eq!(bench.moves(300), None);
        assert_eq!(bench.say(350, "op", 1, 0.3), NotReleased);
        assert_eq!(bench.say(400, "op", 1, 0.3), NotReleased);
        bench.0.on_standstill(Instant::from_millis(1450));
        assert_eq!(bench.say(900, "op", 1, 0.3), NotReleased);
        assert_eq!(bench.moves(901), None);
        assert_eq!(bench.say(950, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(1000, "op", 1, 0.3), Holds);
    }

    #[test]
    fn a_new_source_moves_the_robot_at_once_and_one_that_ended_with_zero_at_any_time() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "program", 1, 0.3), Holds);
        assert_eq!(bench.say(50, "program", 1, 0.0), Holds);
        bench.0.on_standstill(Instant::from_millis(1500));
        bench.0.disarm_all(Instant::from_millis(1600));
        assert_eq!(bench.say(60_000, "program", 1, 0.3), Holds, "its last command was zero");
        bench.0.disarm_all(Instant::from_millis(61_010));
        assert_eq!(bench.say(60_100, "another", 1, 0.3), Holds, "never received before");
    }

    #[test]
    fn after_a_restart_every_source_must_send_zero() {
        let mut bench = Bench::new();
        bench.0.trust_no_new_source();
        assert_eq!(bench.say(0, "op", 1, 0.3), NotReleased);
        assert_eq!(bench.say(50, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(100, "op", 1, 0.3), Holds);
    }

    #[test]
    fn a_new_source_that_begins_during_a_stop_must_send_zero() {
        let mut bench = Bench::new();
        assert_eq!(bench.say_blocked(0, "program", 1, 0.3), Blocked);
        assert_eq!(bench.say(5_000, "program", 1, 0.3), NotReleased);
    }

    #[test]
    fn a_source_received_late_and_stopped_must_send_zero_too() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        bench.0.expire_holder(Instant::from_millis(1249));
        assert_eq!(bench.say(200, "op", 1, 0.4), Holds);
        // Received at 240 ms, served when the command of 200 ms has expired.
        bench.0.expire_holder(Instant::from_millis(1450));
        assert_eq!(bench.say(240, "op", 1, 0.4), NotReleased);
        assert_eq!(bench.say(440, "op", 1, 0.4), NotReleased);
        assert_eq!(bench.moves(460), None);
        assert_eq!(bench.say(690, "op", 1, 0.4), NotReleased, "silence is no release");
        assert_eq!(bench.say(700, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(750, "op", 1, 0.4), Holds);
    }

    #[test]
    fn the_planner_waits_for_an_operator_at_first_and_after_every_take_over() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "planner", 0, 0.4), Latched);
        bench.0.release_planner(Instant::from_millis(1010));
        assert_eq!(bench.say(260, "planner", 0, 0.4), Holds);
        assert_eq!(bench.say(270, "op", 1, 0.1), Holds);
        bench.0.release_planner(Instant::from_millis(1280));
        assert_eq!(bench.say(300, "planner", 0, 0.4), Overruled);
        bench.0.on_standstill(Instant::from_millis(1600));
        assert_eq!(bench.say(1000, "planner", 0, 0.4), Latched);
        bench.0.release_planner(Instant::from_millis(2100));
        assert_eq!(bench.say(1300, "planner", 0, 0.4), Holds);
    }

    #[test]
    fn a_release_before_the_end_of_the_stop_does_not_release_the_planner() {
        let mut bench = Bench::new();
        bench.0.disarm_all(Instant::from_millis(1100));
        bench.0.release_planner(Instant::from_millis(1099));
        assert_eq!(bench.say(110, "planner", 0, 0.4), Latched);
        bench.0.release_planner(Instant::from_millis(1120));
        assert_eq!(bench.say(120, "planner", 0, 0.4), Holds);
    }

    #[test]
    fn a_displaced_source_is_not_a_new_one() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        bench.0.disarm_all(Instant::from_millis(1001));
        for n in 0..9 {
            bench.say_blocked(10 + n, &format!("s{n}"), 3, 0.1);
        }
        bench.0.disarm_all(Instant::from_millis(1020));
        assert_eq!(bench.say(50, "op", 1, 0.4), NotReleased);
        // Its time to live has passed, and its row was taken twice.
        for n in 0..18 {
            bench.say_blocked(400 + n, &format!("t{n}"), 3, 0.1);
        }
        assert_eq!(bench.say(10_000, "op", 1, 0.4), NotReleased);
        assert_eq!(bench.say(10_050, "op", 1, 0.0), Holds);
        assert_eq!(bench.say(10_100, "op", 1, 0.4), Holds);
    }

    #[test]
    fn a_source_whose_last_command_was_zero_loses_its_row_first() {
        let mut bench = Bench::new();
        assert_eq!(bench.say_blocked(0, "stalled", 1, 0.4), Blocked);
        assert_eq!(bench.say(1, "ended", 1, 0.0), Holds);
        bench.0.on_standstill(Instant::from_millis(2000));
        for n in 0..7 {
            bench.say_blocked(2000 + n, &format!("s{n}"), 3, 0.1);
        }
        assert!(bench.0.sources.iter().any(|source| source.name == "stalled"));
        assert_eq!(bench.say(3000, "ended", 1, 0.4), Holds, "as a new one would");
    }

    #[test]
    fn more_displaced_sources_than_can_be_remembered_make_every_new_one_send_zero() {
        let mut bench = Bench::new();
        for n in 0..200 {
            bench.say_blocked(n, &format!("s{n}"), 1, 0.1);
        }
        for n in 0..200 {
            assert_eq!(bench.say(1000, &format!("s{n}"), 1, 0.1), NotReleased, "{n}");
        }
        assert_eq!(bench.say(1010, "new", 1, 0.1), NotReleased);
        assert_eq!(bench.say(1020, "new", 1, 0.0), Holds);
        assert_eq!(bench.say(1030, "new", 1, 0.1), Holds);
        assert!(bench.0.displaced.sources.len() <= DISPLACED_MAX);
    }

    #[test]
    fn the_holder_keeps_its_row_among_many_sources() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 3, 0.4), Holds);
        let holder = bench.0.current(Instant::from_millis(1000)).map(|command| command.source);
        for n in 0..100 {
            assert_eq!(bench.say(1 + n, &format!("s{n}"), 1, 0.1), Overruled);
        }
        let current = bench.0.current(Instant::from_millis(1101)).map(|command| command.source);
        assert_eq!(current, holder);
        assert_eq!(current.map(|source| (bench.0.name(source), bench.0.priority(source))), Some(("op", 3)));
        // Silent, but the robot is not known to stand.
        assert_eq!(bench.say(600, "other", 3, 0.1), Contested);
        assert_eq!(bench.say(610, "op", 3, 0.4), NotReleased, "it was silent");
        assert_eq!(bench.say(620, "op", 3, 0.0), Holds);
    }

    #[test]
    fn a_name_at_two_priorities_is_two_sources() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        assert_eq!(bench.say(10, "op", 2, 0.2), Holds);
        assert_eq!(bench.say(20, "op", 1, 0.4), Overruled);
        assert_eq!(bench.moves(21), Some(0.2));
    }

    #[test]
    fn many_names_take_no_memory() {
        let mut bench = Bench::new();
        for n in 0..1000 {
            bench.say(n, &format!("s{n}"), 1, 0.0);
        }
        assert_eq!(bench.0.sources.len(), SOURCES_MAX);
    }

    impl Bench {
        fn request(&mut self, ms: u64, command: &CmdVelocity) -> Verdict {
            self.0.command(Instant::from_millis(1000 + ms), command, false).1
        }

        /// `LL_CMD_VELOCITY` straight ahead, of a session.
        fn say_in(&mut self, ms: u64, source: &str, priority: i8, vx: f64, session: i64) -> Verdict {
            self.request(ms, &velocity(source, priority, vx, session))
        }

        fn is_press(&self, ms: u64, command: &CmdVelocity) -> bool {
            self.0.is_press(Instant::from_millis(1000 + ms), &command.into())
        }
    }

    fn velocity(source: &str, priority: i8, vx: f64, session: i64) -> CmdVelocity {
        CmdVelocity { vx, priority, source: source.into(), session, ..CmdVelocity::default() }
    }

    #[test]
    fn both_messages_of_a_name_are_one_source_and_the_newer_command_counts() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(0, "op", 1, 0.4), Holds);
        assert_eq!(bench.say_in(10, "op", 1, 0.2, 7), Holds);
        assert_eq!((bench.moves(11), bench.0.sources.len()), (Some(0.2), 1));
        assert_eq!(bench.say(20, "op", 1, 0.3), Holds);
        assert_eq!(bench.moves(21), Some(0.3));
        assert_eq!(bench.say_in(30, "other", 1, 0.2, 7), Contested);
        assert_eq!(bench.say_in(40, "pad", 2, 0.2, 7), Holds, "the higher priority");
        assert_eq!(bench.say(50, "op", 1, 0.3), Overruled);
        // The motion of one message is not released by silence or by the other message, but by its zero.
        bench.0.disarm_all(Instant::from_millis(1060));
        assert_eq!(bench.say_in(1000, "op", 1, 0.2, 7), NotReleased);
        assert_eq!(bench.say_in(1050, "op", 1, 0.0, 7), Holds);
        assert_eq!(bench.say(1100, "op", 1, 0.2), Holds);
        bench.0.disarm_all(Instant::from_millis(2110));
        assert_eq!(bench.say_in(1150, "op", 1, 0.2, 7), NotReleased);
        assert_eq!(bench.say(1200, "op", 1, 0.0), Holds);
        assert_eq!(bench.say_in(1250, "op", 1, 0.2, 7), Holds);
    }

    #[test]
    fn a_command_that_comes_by_a_slower_way_than_the_other_message_is_outdated() {
        let mut bench = Bench::new();
        assert_eq!(bench.say(100, "op", 1, 0.0), Holds);
        let outdated = |bench: &Bench, ms: u64, command: &CmdVelocity| {
            bench.0.is_outdated(Instant::from_millis(1000 + ms), &command.into())
        };
        let command = velocity("op", 1, 0.4, 7);
        assert_eq!([90, 100].map(|ms| outdated(&bench, ms, &command)), [true, false]);
        assert!(
            !outdated(&bench, 90, &velocity("op", 2, 0.4, 7)) && !outdated(&bench, 90, &velocity("pad", 1, 0.4, 7))
        );
        bench.request(110, &command);
        assert!(!outdated(&bench, 105, &command), "one message comes in the order in which it was sent");
    }

    #[test]
    fn a_rotation_alone_is_motion_whether_the_base_can_do_it_or_not() {
        let turn = CmdVelocity { omega: 0.3, ..velocity("op", 1, 0.0, 7) };
        let aside = CmdVelocity { vy: 0.3, ..velocity("op", 1, 0.0, 7) };
        for command in [turn, aside] {
            let mut bench = Bench::new();
            assert_eq!(bench.say_in(0, "op", 1, 0.0, 7), Holds);
            assert!(bench.is_press(10, &command));
            assert_eq!(bench.request(10, &command), Holds);
            bench.0.disarm_all(Instant::from_millis(1020));
            assert_eq!(bench.request(1030, &command), NotReleased);
            assert_eq!(bench.say_in(1040, "op", 1, 0.3, 7), NotReleased, "it was not zero");
            assert!(!bench.is_press(1050, &command));
        }
    }

    #[test]
    fn a_new_session_releases_nothing() {
        let mut bench = Bench::new();
        assert_eq!(bench.say_in(0, "op", 1, 0.4, 1), Holds);
        bench.0.disarm_all(Instant::from_millis(1001));
        for session in 2..9 {
            assert_eq!(bench.say_in(1000 * session as u64, "op", 1, 0.4, session), NotReleased, "{session}");
        }
        assert_eq!(bench.say_in(10_000, "op", 1, 0.0, 9), Holds);
        assert_eq!(bench.say_in(10_050, "op", 1, 0.4, 9), Holds);
        bench.0.disarm_all(Instant::from_millis(11_060));
        // Its row goes to others.
        for n in 0..9 {
            bench.say_blocked(10_100 + n, &format!("s{n}"), 3, 0.1);
        }
        assert_eq!(bench.say_in(20_000, "op", 1, 0.4, 10), NotReleased);
    }

    #[test]
    fn a_program_that_starts_again_drives_at_once_if_the_earlier_one_ended_with_zero() {
        let mut bench = Bench::new();
        assert_eq!(bench.say_in(0, "op", 1, 0.4, 1), Holds);
        assert_eq!(bench.say_in(50, "op", 1, 0.0, 1), Holds);
        assert!(!bench.is_press(299, &velocity("op", 1, 0.4, 2)));
        assert!(bench.is_press(300, &velocity("op", 1, 0.4, 2)));
        assert_eq!(bench.say_in(300, "op", 1, 0.4, 2), Holds);
    }

    #[test]
    fn two_programs_under_one_name_do_not_drive() {
        let mut bench = Bench::new();
        assert_eq!(bench.say_in(0, "op", 1, 0.4, 1), Holds);
        assert_eq!(bench.say_in(10, "op", 1, 0.4, 2), NotReleased, "it has not sent zero");
        assert_eq!(bench.moves(11), None);
        for ms in (50..1000).step_by(50) {
            assert_eq!(bench.say_in(ms, "op", 1, 0.0, 1), Holds);
            assert!(!bench.is_press(ms + 10, &velocity("op", 1, 0.4, 2)));
            assert_eq!(bench.say_in(ms + 10, "op", 1, 0.4, 2), NotReleased, "the zero of another one releases nothing");
            assert_eq!(bench.moves(ms + 11), None);
        }
        // Its own zero, after the other has ended.
        assert_eq!(bench.say_in(1000, "op", 1, 0.0, 2), Holds);
        assert_eq!(bench.say_in(1050, "op", 1, 0.4, 2), Holds);
    }

    #[test]
    fn a_planner_that_starts_again_waits_for_an_operator() {
        for pause in [50, 5000] {
            let mut bench = Bench::new();
            bench.0.release_planner(Instant::from_millis(1000));
            assert_eq!(bench.say_in(10, "guide", 0, 0.4, 1), Holds);
            assert_eq!(bench.say_in(60, "guide", 0, 0.4, 1), Holds);
            assert_eq!(bench.say_in(60 + pause, "guide", 0, 0.4, 2), Latched);
            assert_eq!(bench.moves(61 + pause), None);
            bench.0.release_planner(Instant::from_millis(1070 + pause));
            assert_eq!(bench.say_in(110 + pause, "guide", 0, 0.4, 2), Holds);
        }
    }

    #[test]
    fn a_planner_that_started_again_before_the_release_drives_by_it() {
        let mut bench = Bench::new();
        bench.0.release_planner(Instant::from_millis(1000));
        assert_eq!(bench.say_in(10, "guide", 0, 0.0, 1), Holds);
        // A new process, silent until its goal comes, which is the release.
        bench.0.release_planner(Instant::from_millis(6000));
        assert_eq!(bench.say_in(5020, "guide", 0, 0.4, 2), Holds);
    }

    #[test]
    fn a_planner_that_started_again_beside_another_one_waits_for_an_operator() {
        let mut bench = Bench::new();
        bench.0.release_planner(Instant::from_millis(1000));
        assert_eq!(bench.say_in(10, "guide", 0, 0.0, 1), Holds);
        bench.0.on_standstill(Instant::from_millis(2000));
        bench.0.release_planner(Instant::from_millis(2000));
        assert_eq!(bench.say(1010, "planner", 0, 0.4), Holds);
        assert_eq!(bench.say_in(1020, "guide", 0, 0.4, 2), Contested);
        bench.0.on_standstill(Instant::from_millis(3000));
        assert_eq!(bench.say_in(2010, "guide", 0, 0.4, 2), Latched);
    }
}
