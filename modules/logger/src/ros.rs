//! Bus messages in their ROS 2 form, for people and their tools (`docs/logs.md`, section "ROS 2 types").
//!
//! [`Translator::translate`] returns for each message its own type, on the topic `/CHANNEL`, and the corresponding ROS
//! 2 standard type if there is one. A topic never changes its type.
//!
//! The type of a message follows from its fingerprint. If a type of the robot and a foreign one have the same members,
//! so that both match, the channel decides: those of the robot's table carry the robot's types. The topic `/CHANNEL`
//! has the type of the table, on other channels the type received first; other types on the channel go to
//! `/CHANNEL/package/Type`. A channel whose topic would have the name of a standard one (`pose`) is prefixed with
//! `/lcm/`.
//!
//! Input may come from any sender: each new topic and sensor gets a place in a bounded table, or is left out and
//! counted.

mod kinds;
mod robot;
mod scans;
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
pub use scans::lidar_frame;
pub use state::has_standard;
pub use topics::{Sink, TOPICS_MAX, Topic};
pub use write::{Fields, Pose};

/// Reason why a message has no ROS 2 form. The message itself is still recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Untranslated {
    /// The message is too short for a fingerprint, or no type has its fingerprint.
    Unknown,
    /// The type is recursive, which ROS 2 does not support, or nests too many variable arrays.
    NoSuchType {
        /// LCM name of the type.
        name: Arc<str>,
    },
    /// The message does not match its type.
    Malformed(ConvertError),
    /// A new topic would exceed [`TOPICS_MAX`].
    TooManyTopics,
}

impl fmt::Display for Untranslated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => write!(f, "no type has its fingerprint"),
            Self::NoSuchType { name } => write!(f, "ROS 2 has no types like {name}"),
            Self::Malformed(error) => error.fmt(f),
            Self::TooManyTopics => write!(f, "there are {TOPICS_MAX} topics already"),
        }
    }
}

impl std::error::Error for Untranslated {}

/// Longest message that is also converted to standard types, bytes: some take seven times the space there.
pub const STANDARD_MAX: usize = 1 << 20;

/// Memory kept from one message to the next, bytes.
const BUFFER_BYTES_KEPT: usize = 1 << 20;

/// Translator of messages, with the table of topics.
#[derive(Clone, Debug)]
pub struct Translator {
    scene: Scene,
    kinds: Kinds,
    /// Types received on each channel: index among the kinds, and topic.
    channels: BTreeMap<String, Vec<(usize, u16)>>,
    topics: Topics,
    state: State,
    /// Poses of the sensors by their frames; only for a live network.
    mounted: Option<BTreeMap<String, Pose>>,
    buffer: Vec<u8>,
}

impl Translator {
    /// Creates a translator with the robot's types.
    #[must_use]
    pub fn new(scene: RobotScene) -> Self {
        Self::build(scene, Kinds::new())
    }

    /// Creates a translator with additional foreign `.lcm` files, given as name (for messages) and text. All types that
    /// they refer to are among them; they may differ from the robot's versions.
    ///
    /// # Errors
    /// A file is invalid; the error has its name and the cause.
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
            mounted: None,
            buffer: Vec::new(),
        }
    }

    /// The same for a live network, whose frames are those of REP 105: poses of sensors come on `/tf_static`, all in
    /// each message, and that of the robot in `map` not as a transform, because `odom` lies between both.
    #[must_use]
    pub fn live(self) -> Self {
        Self { mounted: Some(BTreeMap::new()), ..self }
    }

    /// Type of a message on a channel, as recorded with the message; `None` if unknown.
    #[must_use]
    pub fn kind(&self, channel: &str, data: &[u8]) -> Option<&Kind> {
        self.kinds.find(Channel::from_name(channel), data).map(|place| &self.kinds[place])
    }

    /// All topics so far, indexed by `id`.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        self.topics.all()
    }

    /// Number of messages of standard types left out: too many topics, sensors or thermometers, or beyond
    /// [`STANDARD_MAX`].
    #[must_use]
    pub fn left_out(&self) -> u64 {
        self.topics.left_out()
    }

    /// Converts a bus message to ROS 2: its own type, then standard ones.
    ///
    /// # Errors
    /// The message has no ROS 2 form; `sink` was not called.
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
        if self.buffer.capacity() > BUFFER_BYTES_KEPT {
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
            let mounted = self.mounted.as_mut();
            let mut to = write::To { topics: &mut self.topics, buffer: &mut self.buffer, sink, mounted };
            self.state.translate(&mut self.scene, &message, &mut to);
        }
    }

    /// Converts a mark set at `timestamp`, µs since the epoch. [`translate`](Self::translate) does so for marks
    /// received over the bus.
    pub fn mark(&mut self, timestamp: i64, text: &str, sink: &mut Sink<'_>) {
        let mut to = write::To { topics: &mut self.topics, buffer: &mut self.buffer, sink, mounted: None };
        state::mark(&self.scene.robot.name, timestamp, text, &mut to);
    }
}
