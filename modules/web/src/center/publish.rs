//! Messages that an engineer publishes from the view *Messages*: on which channels, and the bytes of one.
//!
//! Nothing moves the robot, releases it from a stop, or speaks for one of its modules from there (docs/web.md,
//! "Publishing").

use base::{Duration, Instant};
use lcm_gen::dynamic::{Missing, Type, Types, Value};
use lcm_gen::{Primitive, Schema};
use messages::Channel;
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// Maximum number of messages in a second, of all pages together.
const PER_SECOND_MAX: usize = 5;
/// Maximum length of a channel's name (LCM).
const NAME_MAX: usize = 63;
/// Maximum length of a message on a channel that is not the robot's, bytes.
const SIZE_MAX: usize = 4 << 10;
/// Maximum number of characters of a message that the note about it quotes.
const QUOTED_MAX: usize = 200;

/// Motion, and acts that move the robot or release it from a stop: each has a command of its own, with its checks.
const MOVES: [Channel; 7] = [
    Channel::LlCmdMotion,
    Channel::LlCmdVelocity,
    Channel::LlCmdCreep,
    Channel::LlCmdHoming,
    Channel::MlCmdGoal,
    Channel::MlCmdMode,
    Channel::CmCmdState,
];
/// By these the watchdog judges modules, and modules the watchdog.
const SUPERVISES: [Channel; 2] = [Channel::CmDataProcesses, Channel::CmDataState];
/// Between two modules: another channel is for programs and people.
const INTERNAL: [Channel; 1] = [Channel::LlCmdNodeIo];

/// Commands to the simulation.
const SIMULATES: [Channel; 3] = [Channel::SimCmdFault, Channel::SimCmdRun, Channel::SimCmdClock];

/// A channel on which engineers may publish.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Publishable {
    /// Name.
    pub channel: &'static str,
    /// Type of its messages.
    pub r#type: &'static str,
    /// A message to begin with: JSON in which everything is zero, false or empty.
    pub message: String,
}

/// Why nothing may be published on a channel; `None` if it may be.
#[must_use]
pub fn refusal(channel: &str, simulated: bool) -> Option<&'static str> {
    if !(1..=NAME_MAX).contains(&channel.len()) || !channel.bytes().all(|byte| byte.is_ascii_graphic()) {
        return Some("the name of a channel has 1 to 63 letters, digits and signs");
    }
    match Channel::from_name(channel) {
        Some(own) if MOVES.contains(&own) => {
            Some("it moves the robot, or releases it from a stop: the page has a command of its own for that")
        }
        Some(own) if SUPERVISES.contains(&own) => Some("modules are supervised by it: nobody else speaks there"),
        Some(own) if INTERNAL.contains(&own) => {
            Some("a module commands another one by it: LL_CMD_OUTPUT sets an output")
        }
        Some(own) if SIMULATES.contains(&own) && !simulated => Some("this robot is not simulated"),
        Some(_) if !simulated && !channel.contains("_CMD_") => {
            Some("a module of the robot speaks there: on a robot that is not simulated nobody speaks for it")
        }
        _ => None,
    }
}

/// What publishing needs to know, and the messages of the last second.
#[derive(Debug)]
pub struct Publisher {
    types: Types,
    simulated: bool,
    last: Mutex<Rate>,
}

impl Publisher {
    /// Of a robot that is simulated or not.
    ///
    /// # Errors
    /// A type of the robot's is invalid; one line.
    pub fn new(simulated: bool) -> Result<Self, String> {
        let schema = Schema::new(messages::LCM_FILES).map_err(|error| format!("a type of the robot's own: {error}"))?;
        Ok(Self { types: Types::new(&schema), simulated, last: Mutex::default() })
    }

    /// The robot's channels on which engineers may publish, by their names.
    #[must_use]
    pub fn offered(&self) -> Vec<Publishable> {
        // A family of channels has no name of its own.
        let own = Channel::ALL.iter().filter(|channel| **channel != Channel::LlDataRaw);
        let free = own.filter(|channel| refusal(channel.name(), self.simulated).is_none());
        let mut offered: Vec<Publishable> = free
            .filter_map(|channel| {
                let (channel, r#type) = (channel.name(), channel.type_name());
                Some(Publishable { channel, r#type, message: empty(self.types.get(r#type)?)? })
            })
            .collect();
        offered.sort_unstable_by_key(|offer| offer.channel);
        offered
    }

    /// Bytes of a message that is published now: JSON of all its fields but `timestamp`, and in commands `source`,
    /// which are those of here. `message_type`: of a channel that is not the robot's, else empty.
    ///
    /// # Errors
    /// Reason of the refusal, for the user.
    pub fn message(
        &self,
        now: Instant,
        (channel, message_type): (&str, &str),
        json: &str,
        (timestamp, source): (i64, &str),
    ) -> Result<Vec<u8>, String> {
        if let Some(why) = refusal(channel, self.simulated) {
            return Err(why.into());
        }
        let own = Channel::from_name(channel);
        let ty = match own.map(Channel::type_name) {
            Some(name) if !["", name].contains(&message_type) => {
                return Err(format!("messages on {channel} are of the type {name}"));
            }
            name => name.unwrap_or(message_type),
        };
        let ty = self.types.get(ty).ok_or_else(|| format!("{ty:?} is none of the robot's types"))?;
        let mut message = serde_json::from_str(json).map_err(|error| format!("this is no JSON: {error}"))?;
        set(ty, &mut message, "timestamp", Primitive::Int64, Value::Int(timestamp));
        if own.is_some() && channel.contains("_CMD_") {
            set(ty, &mut message, "source", Primitive::String, Value::Text(source.to_owned().into()));
        }
        let mut bytes = Vec::new();
        ty.encode(&message, Missing::Refuse, &mut bytes).map_err(|error| error.to_string())?;
        let most = own.map_or(SIZE_MAX, Channel::size_max);
        if bytes.len() > most {
            return Err(format!("the message has {} bytes, and at most {most} are accepted there", bytes.len()));
        }
        self.permit(now).map(|()| bytes)
    }

    /// Counts a message that is about to be published; scenarios count, too, as they are long and begin the simulation
    /// anew.
    ///
    /// # Errors
    /// There were too many in the last second; a line for the user.
    pub fn permit(&self, now: Instant) -> Result<(), String> {
        match self.last.lock().unwrap_or_else(PoisonError::into_inner).permits(now) {
            true => Ok(()),
            false => Err(format!("at most {PER_SECOND_MAX} messages are published in a second")),
        }
    }
}

/// Note about a message that was published: who did it, and what.
#[must_use]
pub fn note(source: &str, channel: &str, json: &str) -> String {
    let mut quoted: String = json.chars().filter(|c| !c.is_control()).take(QUOTED_MAX + 1).collect();
    if quoted.chars().count() > QUOTED_MAX {
        quoted = quoted.chars().take(QUOTED_MAX - 1).chain(['…']).collect();
    }
    format!("{} published {channel}: {quoted}", messages::source_in_words(source))
}

/// A message in which everything is zero, false or empty.
fn empty(ty: Type<'_>) -> Option<String> {
    let mut bytes = Vec::new();
    ty.encode(&Value::Struct(Vec::new()), Missing::Zero, &mut bytes).ok()?;
    serde_json::to_string(&ty.decode(&bytes).ok()?).ok()
}

/// Sets a member of a message whose type has it.
fn set(ty: Type<'_>, message: &mut Value<'static>, name: &'static str, of: Primitive, value: Value<'static>) {
    let Value::Struct(members) = message else { return };
    if ty.has(name, of) {
        members.retain(|(known, _)| known != name);
        members.push((name.into(), value));
    }
}

/// Times of the messages of the last second.
#[derive(Debug, Default)]
struct Rate(VecDeque<Instant>);

impl Rate {
    /// True if one more may be published now; it then counts.
    fn permits(&mut self, now: Instant) -> bool {
        while self.0.front().is_some_and(|first| now.since(*first) >= Duration::from_secs(1)) {
            self.0.pop_front();
        }
        let free = self.0.len() < PER_SECOND_MAX;
        if free {
            self.0.push_back(now);
        }
        free
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Message;
    use messages::common::CmdLog;
    use messages::lowlevel::CmdOutput;

    const T0: Instant = Instant::from_millis(10_000);

    /// Published a second after the last one.
    fn published(publisher: &Publisher, channel: &str, ty: &str, json: &str) -> Result<Message, String> {
        let bytes = publisher.message(T0, (channel, ty), json, (7, "web:Eve"))?;
        publisher.last.lock().unwrap().0.clear();
        Ok(Message::receive(channel, &bytes).expect("the robot's channel").expect("a message of its type"))
    }

    #[test]
    fn a_command_is_published_with_the_time_and_the_user_of_here() {
        let publisher = Publisher::new(false).unwrap();
        let mark = published(&publisher, "CM_CMD_LOG", "", r#"{"action": 2, "text": "here"}"#).unwrap();
        let wanted = CmdLog { timestamp: 7, action: CmdLog::MARK, text: "here".into() };
        assert_eq!(mark, Message::from(wanted));
        let forged = r#"{"timestamp": 1, "source": "Jana", "name": "lamp", "value": null}"#;
        let Message::LlCmdOutput(output) = published(&publisher, "LL_CMD_OUTPUT", "", forged).unwrap() else {
            panic!("another message");
        };
        assert!(output.value.is_nan(), "what is judged by the module that obeys it");
        let wanted = CmdOutput { timestamp: 7, name: "lamp".into(), value: 0.0, source: "web:Eve".into() };
        assert_eq!(CmdOutput { value: 0.0, ..output }, wanted);
        let typed = published(&publisher, "CM_CMD_LOG", "common.cmd_log_t", r#"{"action": 0, "text": ""}"#);
        assert!(typed.is_ok(), "{typed:?}");
    }

    #[test]
    fn what_moves_the_robot_or_supervises_modules_is_never_published() {
        for simulated in [false, true] {
            let publisher = Publisher::new(simulated).unwrap();
            for channel in MOVES.into_iter().chain(SUPERVISES).map(Channel::name) {
                let refused = publisher.message(T0, (channel, ""), "{}", (7, "web:Eve")).unwrap_err();
                assert!(refused.contains("moves the robot") || refused.contains("supervised"), "{channel}: {refused}");
                assert!(publisher.offered().iter().all(|offer| offer.channel != channel), "{channel}");
            }
            for channel in ["", "A B", "A\n", "Ä", &"x".repeat(64)] {
                assert!(refusal(channel, simulated).is_some_and(|why| why.contains("1 to 63")), "{channel:?}");
            }
        }
    }

    #[test]
    fn on_a_robot_that_is_not_simulated_only_commands_and_foreign_channels_are_free() {
        for channel in Channel::ALL.iter().filter(|channel| !MOVES.contains(channel)) {
            let (name, commands) = (format!("{}A", channel.name()), channel.name().contains("_CMD_"));
            let name = if *channel == Channel::LlDataRaw { name.as_str() } else { channel.name() };
            let free = commands && !SIMULATES.contains(channel) && !INTERNAL.contains(channel);
            assert_eq!(refusal(name, false).is_none(), free, "{name}");
            let never = SUPERVISES.contains(channel) || INTERNAL.contains(channel);
            assert_eq!(refusal(name, true).is_none(), !never, "{name} in simulation");
        }
        for simulated in [false, true] {
            assert_eq!(refusal("MY_LIGHTS", simulated), None);
        }
        let publisher = Publisher::new(false).unwrap();
        let bytes = publisher.message(T0, ("MY_LIGHTS", "common.cmd_log_t"), r#"{"action":1,"text":""}"#, (7, "x"));
        let mut wanted = Vec::new();
        Message::from(CmdLog { timestamp: 7, action: 1, text: String::new() }).encode(&mut wanted).unwrap();
        assert_eq!(bytes.unwrap(), wanted);
    }

    #[test]
    fn what_is_no_message_of_its_type_is_refused_with_the_reason() {
        let publisher = Publisher::new(true).unwrap();
        let deep = format!("{}{}", "[".repeat(3000), "]".repeat(3000));
        for (channel, ty, json, why) in [
            ("CM_CMD_LOG", "lowlevel.cmd_sdo_t", "{}", "messages on CM_CMD_LOG are of the type common.cmd_log_t"),
            ("MY_LIGHTS", "", "{}", "\"\" is none of the robot's types"),
            ("MY_LIGHTS", "my.lights_t", "{}", "\"my.lights_t\" is none of the robot's types"),
            ("CM_CMD_LOG", "", "{", "this is no JSON: "),
            ("CM_CMD_LOG", "", deep.as_str(), "this is no JSON: "),
            ("CM_CMD_LOG", "", "[]", "expected an object, found an array"),
            ("CM_CMD_LOG", "", "{}", "action: missing"),
            ("CM_CMD_LOG", "", r#"{"action":1,"text":"","more":1}"#, "more: no such member"),
            ("CM_CMD_LOG", "", r#"{"action":1,"action":1,"text":""}"#, "action: given twice"),
            ("CM_CMD_LOG", "", r#"{"action":300,"text":""}"#, "action: out of the range of int8_t"),
            ("CM_CMD_LOG", "", r#"{"action":1.5,"text":""}"#, "action: expected a whole number, found a number"),
            ("CM_CMD_LOG", "", r#"{"action":1,"text":5}"#, "text: expected a text, found a number"),
        ] {
            let refused = publisher.message(T0, (channel, ty), json, (7, "x")).expect_err(json);
            assert!(refused.starts_with(why), "{json:.60}: {refused}");
        }
        let long = format!(r#"{{"action":2,"text":"{}"}}"#, "x".repeat(5000));
        for (channel, ty) in [("CM_CMD_LOG", ""), ("MY_LIGHTS", "common.cmd_log_t")] {
            let refused = publisher.message(T0, (channel, ty), &long, (7, "x")).unwrap_err();
            assert!(refused.ends_with("at most 4096 are accepted there"), "{refused}");
        }
    }

    #[test]
    fn few_are_published_in_a_second_and_refused_ones_do_not_count() {
        let publisher = Publisher::new(false).unwrap();
        let at = |millis: u64, json: &str| {
            let now = T0 + Duration::from_millis(millis);
            publisher.message(now, ("CM_CMD_LOG", ""), json, (7, "x"))
        };
        let good = r#"{"action":1,"text":""}"#;
        for n in 0..50 {
            assert!(at(n, "{}").is_err());
        }
        let passed = (0..200).filter(|n| at(10 * n, good).is_ok()).count();
        assert_eq!(passed, 2 * PER_SECOND_MAX, "in two seconds");
        let scenarios = Publisher::new(true).unwrap();
        assert_eq!((0..100).filter(|_| scenarios.permit(T0).is_ok()).count(), PER_SECOND_MAX);
        assert!(at(1990, good).unwrap_err().contains("in a second") && at(2001, good).is_ok());
    }

    #[test]
    fn each_offered_channel_has_a_message_to_begin_with() {
        let [real, simulated] = [false, true].map(|simulated| Publisher::new(simulated).unwrap());
        let names = |publisher: &Publisher| publisher.offered().iter().map(|offer| offer.channel).collect::<Vec<_>>();
        let commands = [
            "CM_CMD_LEVEL",
            "CM_CMD_LOG",
            "HL_CMD_ACTION",
            "LL_CMD_OUTPUT",
            "LL_CMD_POWER",
            "LL_CMD_SDO",
            "ML_CMD_BEACON_USE",
            "ML_CMD_ESTIMATE",
            "ML_CMD_PARAMETER",
        ];
        assert_eq!(names(&real), commands);
        assert!(names(&simulated).contains(&"SIM_CMD_FAULT") && names(&simulated).contains(&"LL_DATA_ODO"));
        for Publishable { channel, r#type, message } in simulated.offered() {
            let said = published(&simulated, channel, r#type, &message);
            assert!(said.is_ok(), "{channel}: {message}: {said:?}");
        }
    }

    #[test]
    fn the_note_says_who_did_it_in_a_line_of_bounded_length() {
        let line = note("web:Eve", "LL_CMD_POWER", "{\n\"device\": 4}");
        assert_eq!(line, "Eve (web) published LL_CMD_POWER: {\"device\": 4}");
        let long = note("web:Eve", "X", &"y".repeat(5000));
        assert!(long.chars().count() < QUOTED_MAX + 40 && long.ends_with('…'), "{long}");
    }
}
