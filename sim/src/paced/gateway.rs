//! What passes from programs on a real LCM bus to a robot in virtual time, and which of them are in step with it.
//!
//! A program is in step if it answers each `SIM_DATA_CLOCK` with `SIM_CMD_CLOCK`: virtual time does not pass on beyond
//! a tick before it has. One that ceases to answer is waited for [`ANSWER_MAX`] of real time, then named, and no longer
//! waited for until it answers again.
//!
//! A motion command is good for 250 ms of the robot's time. A source that sends each 50 ms by the wall clock would be
//! late at 20 times real time, and its last command would move the robot for 5 s at a twentieth: the deadline would be
//! scaled. So motion commands of programs that are not in step are refused, unless time passes as for a robot.

use base::{Duration, Instant};
use messages::simulation::CmdClock;
use messages::{Channel, Message};
use module::admission::{Process, Sender};
use std::collections::{BTreeMap, VecDeque};
use xxhash_rust::xxh64::xxh64;

/// Real time for which a program in step is waited for.
pub const ANSWER_MAX: Duration = Duration::from_secs(1);
/// Maximum number of programs in step, and of those that are named as not in step; further ones are not waited for, and
/// their motion commands are refused like those of others.
pub const PROGRAMS_MAX: usize = 16;
/// Maximum length of the name of a program, bytes.
const NAME_MAX: usize = 64;
/// Set in the process ids of programs outside virtual time: no process has one as great.
const OUTSIDE: u32 = 1 << 30;
/// Messages of the robot's own that are recognized when the bus returns them.
const OWN_MAX: usize = 4096;

/// Channels that pass besides commands: what stops the robot, and what a program does in the place of a module.
const PASSED: [Channel; 7] = [
    Channel::LlEventStop,
    Channel::LlDataActiveBeacons,
    Channel::LlDataJoydev,
    Channel::LlDataGuard,
    Channel::LlDataRanges,
    Channel::MlDataEstimate,
    Channel::HlDataAction,
];

/// True for a channel whose messages pass into virtual time.
#[must_use]
pub fn passes(channel: Channel) -> bool {
    let is_own = matches!(channel, Channel::SimCmdRun | Channel::SimCmdClock);
    !is_own && (channel.name().contains("_CMD_") || PASSED.contains(&channel))
}

/// True for a channel that passes and whose messages repeat: a newer one makes up for one that is dropped.
#[must_use]
pub fn repeats(channel: Channel) -> bool {
    // LL_DATA_ACTIVE_BEACONS is a command by another name.
    PASSED.contains(&channel) && !matches!(channel, Channel::LlEventStop | Channel::LlDataActiveBeacons)
}

/// A sender on the real bus, as virtual time knows it: never one of the robot's own processes.
#[must_use]
pub fn outside(sender: Sender) -> Sender {
    let process = |Process { pid, uid }| Process { pid: pid | OUTSIDE, uid };
    Sender { process: sender.process.map(process), ..sender }
}

/// True for a sender that came from the real bus.
#[must_use]
pub fn is_outside(sender: Sender) -> bool {
    sender.pid().is_none_or(|pid| pid & OUTSIDE != 0)
}

/// A program in step.
#[derive(Debug)]
struct Program {
    name: String,
    /// Newest tick that it has answered.
    answered: i64,
}

/// Which programs are in step, and whose motion commands pass.
#[derive(Debug, Default)]
pub struct Gateway {
    programs: Vec<Program>,
    /// Names of those that are not.
    stray: Vec<String>,
    /// Timestamp of the newest tick, and the real time of its publication.
    tick: (i64, Instant),
    refused: u64,
    notices: VecDeque<String>,
}

impl Gateway {
    /// A tick was published.
    pub fn on_tick(&mut self, real: Instant, timestamp: i64) {
        self.tick = (timestamp, real);
    }

    /// Timestamp of the newest tick; 0 before the first.
    #[must_use]
    pub fn tick(&self) -> i64 {
        self.tick.0
    }

    /// Time passes again: programs are waited for from now on.
    pub fn on_run(&mut self, real: Instant) {
        self.tick.1 = real;
    }

    /// A program has answered. Answers to a tick that was never published are ignored.
    pub fn on_answer(&mut self, answer: &CmdClock) {
        let name = plain(&answer.source);
        if name.is_empty() || answer.tick > self.tick.0 || answer.tick <= 0 {
            return;
        }
        if let Some(program) = self.programs.iter_mut().find(|program| program.name == name) {
            program.answered = program.answered.max(answer.tick);
            return;
        }
        if self.programs.len() < PROGRAMS_MAX {
            self.stray.retain(|stray| *stray != name);
            self.notices.push_back(format!("{name} is in step: it is waited for"));
            // Of the ticks that it has missed since, none is waited for.
            self.programs.push(Program { name, answered: self.tick.0 });
        }
    }

    /// True while a program in step has not answered the newest tick: virtual time must not pass on.
    pub fn waits(&mut self, real: Instant) -> bool {
        let (tick, since) = self.tick;
        if self.programs.iter().all(|program| program.answered >= tick) {
            return false;
        }
        if real.since(since) < ANSWER_MAX {
            return true;
        }
        let late = |program: &mut Program| program.answered < tick;
        let late: Vec<Program> = self.programs.extract_if(.., late).collect();
        for Program { name, .. } in late {
            let limit = ANSWER_MAX.as_secs();
            self.notices.push_back(format!("{name} is not in step: no answer to SIM_DATA_CLOCK within {limit} s"));
            self.add_stray(name);
        }
        false
    }

    /// The real instant at which a program that is waited for is given up.
    #[must_use]
    pub fn until(&self) -> Instant {
        self.tick.1 + ANSWER_MAX
    }

    /// True if a message from outside passes; `real`: time passes as for a robot. Refusals are counted, and reported
    /// once for each program.
    pub fn admits(&mut self, message: &Message, real: bool) -> bool {
        let source = match message {
            _ if !passes(message.channel()) => return false,
            Message::LlCmdMotion(command) => &command.source,
            Message::LlCmdVelocity(command) => &command.source,
            Message::LlCmdCreep(command) => &command.source,
            _ => return true,
        };
        let name = plain(source);
        if real || self.programs.iter().any(|program| program.name == name) {
            return true;
        }
        self.refused += 1;
        if !self.stray.contains(&name) && self.add_stray(name.clone()) {
            self.notices.push_back(format!(
                "{name} is not in step: its motion commands are refused, since they come by the wall clock; goals and \
                 routes pass, and so does all at: advee sim speed 1"
            ));
        }
        false
    }

    fn add_stray(&mut self, name: String) -> bool {
        let is_new = self.stray.len() < PROGRAMS_MAX && !self.stray.contains(&name);
        if is_new {
            self.stray.push(name);
        }
        is_new
    }

    /// The next sentence for people.
    pub fn poll_notice(&mut self) -> Option<String> {
        self.notices.pop_front()
    }

    /// Number of refused motion commands.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Names of the programs in step.
    #[must_use]
    pub fn in_step(&self) -> Vec<String> {
        self.programs.iter().map(|program| program.name.clone()).collect()
    }

    /// Names of the programs that are not in step: they ceased to answer, or their motion commands were refused.
    #[must_use]
    pub fn not_in_step(&self) -> &[String] {
        &self.stray
    }
}

/// A name without control characters, of bounded length.
fn plain(name: &str) -> String {
    let mut plain = String::new();
    for c in name.chars().filter(|c| !c.is_control()) {
        if plain.len() + c.len_utf8() > NAME_MAX {
            break;
        }
        plain.push(c);
    }
    plain
}

/// The robot's own messages on a bus that returns what was published on it, for buses that do not identify the sender.
#[derive(Debug, Default)]
pub struct Echoes {
    /// Number of times that each was published and not returned yet, by its digest.
    counts: BTreeMap<u64, u32>,
    order: VecDeque<u64>,
}

impl Echoes {
    /// A message was published.
    pub fn on_published(&mut self, channel: &str, bytes: &[u8]) {
        let digest = digest(channel, bytes);
        *self.counts.entry(digest).or_default() += 1;
        self.order.push_back(digest);
        if self.order.len() > OWN_MAX
            && let Some(oldest) = self.order.pop_front()
        {
            self.take(oldest);
        }
    }

    /// True if a received message is one of them; each returns once.
    pub fn is_echo(&mut self, channel: &str, bytes: &[u8]) -> bool {
        self.take(digest(channel, bytes))
    }

    fn take(&mut self, digest: u64) -> bool {
        let Some(count) = self.counts.get_mut(&digest) else { return false };
        *count -= 1;
        if *count == 0 {
            self.counts.remove(&digest);
        }
        true
    }
}

fn digest(channel: &str, bytes: &[u8]) -> u64 {
    xxh64(bytes, xxh64(channel.as_bytes(), 0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::lowlevel::{CmdCreep, CmdMotion, CmdVelocity, EventStop};
    use messages::middlelevel::CmdGoal;
    use messages::{common, simulation};
    use module::admission::Way;

    const MS: fn(u64) -> Instant = Instant::from_millis;

    fn motion(source: &str) -> Message {
        CmdMotion { speed: 0.3, priority: 1, source: source.into(), ..CmdMotion::default() }.into()
    }

    fn answer(tick: i64, source: &str) -> CmdClock {
        CmdClock { timestamp: tick, tick, source: source.into() }
    }

    fn notices(gateway: &mut Gateway) -> Vec<String> {
        std::iter::from_fn(|| gateway.poll_notice()).collect()
    }

    #[test]
    fn commands_and_stops_pass_and_what_the_robot_itself_publishes_does_not() {
        let mut gateway = Gateway::default();
        let passing: [Message; 4] = [
            CmdGoal::default().into(),
            EventStop::default().into(),
            common::CmdState::default().into(),
            simulation::CmdFault::default().into(),
        ];
        for message in passing {
            assert!(gateway.admits(&message, false), "{}", message.channel_name());
        }
        let own: [Message; 5] = [
            common::DataState::default().into(),
            common::DataProcesses::default().into(),
            simulation::DataTruth::default().into(),
            simulation::DataClock::default().into(),
            simulation::CmdRun::default().into(),
        ];
        for message in own {
            assert!(!gateway.admits(&message, true), "{}", message.channel_name());
        }
        assert_eq!((gateway.refused(), notices(&mut gateway)), (0, vec![]));
    }

    #[test]
    fn measurements_repeat_and_commands_and_stops_do_not() {
        let repeating: Vec<Channel> = Channel::ALL.iter().copied().filter(|channel| repeats(*channel)).collect();
        assert!(repeating.contains(&Channel::LlDataRanges) && repeating.contains(&Channel::MlDataEstimate));
        assert!(repeating.iter().all(|channel| passes(*channel) && channel.name().contains("_DATA_")));
        assert!(!repeats(Channel::LlEventStop) && !repeats(Channel::LlDataActiveBeacons));
    }

    #[test]
    fn motion_by_the_wall_clock_is_refused_counted_and_named_once() {
        let mut gateway = Gateway::default();
        assert!(gateway.admits(&motion("drive@host:1"), true));
        let commands: [Message; 3] = [
            motion("drive@host:1"),
            CmdVelocity { source: "drive@host:1".into(), ..CmdVelocity::default() }.into(),
            CmdCreep { source: "drive@host:1".into(), ..CmdCreep::default() }.into(),
        ];
        for command in commands {
            assert!(!gateway.admits(&command, false));
        }
        assert_eq!((gateway.refused(), gateway.not_in_step()), (3, &["drive@host:1".to_string()][..]));
        let said = notices(&mut gateway);
        assert!(said.len() == 1 && said[0].starts_with("drive@host:1 is not in step"), "{said:?}");
    }

    #[test]
    fn a_program_that_answers_is_waited_for_and_may_move_the_robot() {
        let mut gateway = Gateway::default();
        gateway.on_tick(MS(0), 100);
        assert!(gateway.tick() == 100 && !gateway.waits(MS(0)), "nobody has answered yet");
        gateway.on_answer(&answer(100, "pilot"));
        assert_eq!((gateway.in_step(), gateway.waits(MS(1))), (vec!["pilot".to_string()], false));
        gateway.on_tick(MS(10), 150);
        assert!(gateway.waits(MS(10)) && gateway.waits(MS(1009)));
        assert!(gateway.admits(&motion("pilot"), false) && !gateway.admits(&motion("other"), false));
        gateway.on_answer(&answer(100, "pilot"));
        assert!(gateway.waits(MS(20)), "an older tick");
        gateway.on_answer(&answer(200, "pilot"));
        assert!(gateway.waits(MS(20)), "a tick that was never published");
        gateway.on_answer(&answer(150, "pilot"));
        assert!(!gateway.waits(MS(20)));
    }

    #[test]
    fn a_program_that_ceases_to_answer_is_given_up_and_named_until_it_answers_again() {
        let mut gateway = Gateway::default();
        gateway.on_tick(MS(0), 100);
        gateway.on_answer(&answer(100, "pilot"));
        gateway.on_tick(MS(10), 150);
        assert_eq!(gateway.until(), MS(1010));
        assert!(!gateway.waits(MS(1010)), "a second has passed");
        assert_eq!((gateway.in_step().len(), gateway.not_in_step()), (0, &["pilot".to_string()][..]));
        assert!(!gateway.admits(&motion("pilot"), false));
        let said = notices(&mut gateway);
        assert!(said.len() == 2 && said[1].contains("no answer to SIM_DATA_CLOCK within 1 s"), "{said:?}");
        gateway.on_tick(MS(2000), 200);
        gateway.on_answer(&answer(150, "pilot"));
        assert!(!gateway.waits(MS(2001)) && gateway.not_in_step().is_empty());
        gateway.on_tick(MS(2010), 250);
        assert!(gateway.waits(MS(2011)));
        // Time stood still meanwhile: the wait begins again.
        gateway.on_run(MS(9000));
        assert!(gateway.waits(MS(9999)) && !gateway.waits(MS(10_000)));
    }

    #[test]
    fn names_and_numbers_of_programs_are_bounded() {
        let mut gateway = Gateway::default();
        gateway.on_tick(MS(0), 100);
        for number in 0..100 {
            gateway.on_answer(&answer(100, &format!("p{number}")));
            assert!(!gateway.admits(&motion(&format!("q{number}")), false));
        }
        gateway.on_answer(&answer(100, "\n"));
        assert_eq!((gateway.in_step().len(), gateway.not_in_step().len()), (PROGRAMS_MAX, PROGRAMS_MAX));
        assert_eq!((gateway.refused(), notices(&mut gateway).len()), (100, 2 * PROGRAMS_MAX));
        assert_eq!(plain(&"ä\n".repeat(100)).len(), NAME_MAX);
    }

    #[test]
    fn a_sender_from_outside_is_never_one_of_the_robots_own_processes() {
        let own = Sender { way: Way::Memory, process: Some(Process { pid: 1001, uid: 0 }) };
        let unknown = Sender { way: Way::Host, process: None };
        assert_eq!([own, unknown, outside(own), outside(unknown)].map(is_outside), [false, true, true, true]);
    }

    #[test]
    fn what_the_bus_returns_is_recognized_once() {
        let mut echoes = Echoes::default();
        echoes.on_published("A", b"x");
        assert!(!echoes.is_echo("B", b"x") && !echoes.is_echo("A", b"y"));
        assert!(echoes.is_echo("A", b"x") && !echoes.is_echo("A", b"x"));
        for number in 0..2 * OWN_MAX as u32 {
            echoes.on_published("A", &number.to_be_bytes());
        }
        assert!(!echoes.is_echo("A", &0u32.to_be_bytes()), "long ago");
        assert!(echoes.is_echo("A", &(2 * OWN_MAX as u32 - 1).to_be_bytes()));
        assert!(echoes.counts.len() <= OWN_MAX && echoes.order.len() <= OWN_MAX);
    }
}
