//! Messages of the bus as ROS 2 has them, for people and their tools (`docs/logs.md`, section "ROS 2 types").
//!
//! [`Translator::translate`] gives of each message its own type, on the topic `/CHANNEL`, and of what ROS 2 has a standard
//! type for, that one. A topic keeps its type for good.
//!
//! A message's type is known by its fingerprint. Where a type of the robot's and a foreign one have the same members, so
//! that both fit, the channel decides: those of the robot's table carry the robot's. The topic `/CHANNEL` is of the type
//! that the table names, on other channels of the one that was heard first; what else is heard on the channel goes to
//! `/CHANNEL/package/Type`. A channel whose topic would be one of the standard ones (`pose`) has `/lcm/` in front.
//!
//! Feeds on what strangers send: each topic and sensor that somebody makes up has its place in a bounded table, or is
//! left out and counted.

mod kinds;
mod robot;
mod scene;
mod standard;
mod state;
mod topics;
mod write;

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use lcm_gen::cdr::ConvertError;
use messages::{Channel, Message};

use kinds::Kinds;
use scene::Scene;
use state::State;
use topics::Topics;

pub use kinds::Kind;
pub use robot::{Beacon, RobotScene, Sensor};
pub use topics::{Sink, TOPICS_MAX, Topic};

/// Why a message has no form in ROS 2. It is to be kept as it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Untranslated {
    /// No type has the fingerprint that it begins with, or it is too short for one.
    Unknown,
    /// Its type holds itself, which ROS 2 does not have, or more variable arrays in each other than anybody would want.
    NoSuchType {
        /// The type's name as LCM has it.
        name: Arc<str>,
    },
    /// It is no message of its type.
    Malformed(ConvertError),
    /// There are [`TOPICS_MAX`] topics, and it would take another.
    TooManyTopics,
}

impl fmt::Display for Untranslated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => write!(f, "no type has its fingerprint"),
            Self::NoSuchType { name } => write!(f, "ROS 2 has no types like {name}"),
            Self::Malformed(error) => error.fmt(f),
            Self::TooManyTopics => write!(f, "{TOPICS_MAX} topics and no more"),
        }
    }
}

impl std::error::Error for Untranslated {}

/// The longest message that is given in standard types as well, bytes: some take seven times as much there.
pub const STANDARD_MAX: usize = 1 << 20;

/// How much memory is kept from one message to the next, bytes.
const BUFFER_KEPT: usize = 1 << 20;

/// Translates messages; knows which topics there are.
#[derive(Clone, Debug)]
pub struct Translator {
    scene: Scene,
    kinds: Kinds,
    /// Of each channel the types that were heard there: place among the kinds, and topic.
    channels: BTreeMap<String, Vec<(usize, u16)>>,
    topics: Topics,
    state: State,
    buffer: Vec<u8>,
}

impl Translator {
    /// Knows the types of this robot's.
    #[must_use]
    pub fn new(scene: RobotScene) -> Self {
        Self::build(scene, Kinds::new())
    }

    /// Knows those of foreign `.lcm` files besides, given as name (for messages) and text. All types that they lead to are
    /// among them; they may be other versions of the robot's.
    ///
    /// # Errors
    /// What is wrong in which file.
    pub fn with_types(scene: RobotScene, files: &[(impl AsRef<str>, impl AsRef<str>)]) -> Result<Self, lcm_gen::Error> {
        Ok(Self::build(scene, Kinds::with(files)?))
    }

    fn build(scene: RobotScene, kinds: Kinds) -> Self {
        Self {
            scene: Scene::new(scene),
            kinds,
            channels: BTreeMap::new(),
            topics: Topics::default(),
            state: State::default(),
            buffer: Vec::new(),
        }
    }

    /// The type of a message on a channel: what a log says of the message as it is. `None`: nobody knows it.
    #[must_use]
    pub fn kind(&self, channel: &str, data: &[u8]) -> Option<&Kind> {
        self.kinds.find(Channel::from_name(channel), data).map(|place| &self.kinds[place])
    }

    /// All topics so far; the place of each is its `id`.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        self.topics.all()
    }

    /// How many messages of standard types were left out: too many topics, sensors or thermometers, or made of a message
    /// beyond [`STANDARD_MAX`].
    #[must_use]
    pub fn left_out(&self) -> u64 {
        self.topics.left_out()
    }

    /// Gives a message of the bus as ROS 2 has it: its own type, then standard ones.
    ///
    /// # Errors
    /// The message has no form in ROS 2; nothing was given to `sink`.
    pub fn translate(&mut self, channel: &str, data: &[u8], sink: &mut Sink<'_>) -> Result<(), Untranslated> {
        let listed = Channel::from_name(channel);
        let place = self.kinds.find(listed, data).ok_or(Untranslated::Unknown)?;
        let kind = &self.kinds[place];
        let no_such = || Untranslated::NoSuchType { name: kind.name.clone() };
        let (plan, ros) = self.kinds.ros(place).ok_or_else(no_such)?;
        self.buffer.clear();
        plan.convert(data, &mut self.buffer).map_err(Untranslated::Malformed)?;
        let heard = self.channels.get(channel).map_or(&[][..], Vec::as_slice);
        let known = heard.iter().find(|(heard, _)| *heard == place);
        let own = listed.is_some_and(|listed| kind.is(listed));
        let id = match known {
            Some(&(_, id)) => id,
            None => {
                let first = own || (listed.is_none() && heard.is_empty());
                let id = self.topics.own(channel, first, ros).ok_or(Untranslated::TooManyTopics)?;
                self.channels.entry(channel.to_owned()).or_default().push((place, id));
                id
            }
        };
        sink(self.topics.get(id), &self.buffer);
        if let Some(listed) = listed.filter(|_| own) {
            self.standard(listed, data, sink);
        }
        if self.buffer.capacity() > BUFFER_KEPT {
            self.buffer = Vec::new();
        }
        Ok(())
    }

    fn standard(&mut self, channel: Channel, data: &[u8], sink: &mut Sink<'_>) {
        if !state::has_standard(channel) {
            return;
        }
        if data.len() > STANDARD_MAX {
            self.topics.leave_out();
        } else if let Ok(message) = Message::decode(channel, data) {
            let mut to = write::To { topics: &mut self.topics, buffer: &mut self.buffer, sink };
            self.state.translate(&mut self.scene, &message, &mut to);
        }
    }

    /// Gives a mark that somebody set into the run at `timestamp`, µs since the epoch. [`translate`](Self::translate) does
    /// so for those that come over the bus.
    pub fn mark(&mut self, timestamp: i64, text: &str, sink: &mut Sink<'_>) {
        let mut to = write::To { topics: &mut self.topics, buffer: &mut self.buffer, sink };
        state::mark(&self.scene.robot.name, timestamp, text, &mut to);
    }
}
