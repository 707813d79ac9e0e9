//! Topics: each has a constant type and a small constant number.

use std::collections::BTreeMap;
use std::iter;
use std::sync::Arc;

use super::kinds::RosType;
use super::standard::Standard;

/// Consumer of translated messages: topic, and message as CDR.
pub type Sink<'a> = dyn FnMut(&Topic, &[u8]) + 'a;

/// Maximum number of topics: with the raw channels they fit into the channel numbers of a log (65 535).
pub const TOPICS_MAX: usize = 16_384;

/// Names, and prefixes of names, reserved for standard types.
const RESERVED_NAMES: &[&str] = &[
    "/battery",
    "/battery/",
    "/diagnostics",
    "/imu/",
    "/marks",
    "/odometry",
    "/plan",
    "/pose",
    "/range/",
    "/rosout",
    "/scene",
    "/temperature/",
    "/tf",
    "/tf_static",
];

/// ROS 2 topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Number: from 0, in the order of first reception.
    pub id: u16,
    /// Name: `/LL_DATA_ODO`, `/range/3`.
    pub name: Arc<str>,
    /// Name of the message type: `lowlevel/msg/DataOdo`.
    pub schema_name: Arc<str>,
    /// Definition of the type as `ros2msg`.
    pub schema_text: Arc<str>,
}

#[derive(Clone, Debug, Default)]
pub struct Topics {
    all: Vec<Topic>,
    index: BTreeMap<Arc<str>, u16>,
    /// Definitions of the standard types in use.
    standard: BTreeMap<&'static str, RosType>,
    left_out: u64,
}

impl Topics {
    pub fn all(&self) -> &[Topic] {
        &self.all
    }

    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    pub fn get(&self, id: u16) -> &Topic {
        &self.all[usize::from(id)]
    }

    /// Counts a message that was left out.
    pub fn leave_out(&mut self) {
        self.left_out += 1;
    }

    /// Creates a topic for messages of this type on a channel; `None` if there are too many.
    pub fn own(&mut self, channel: &str, first: bool, ty: &RosType) -> Option<u16> {
        let front = if is_reserved(&format!("/{channel}")) { "/lcm/" } else { "/" };
        let name = format!("{front}{channel}");
        if first && !self.index.contains_key(name.as_str()) {
            return self.add(name, ty.clone());
        }
        let name = format!("{name}/{}", ty.name.replace("/msg/", "/"));
        let names = iter::once(name.clone()).chain((2..=TOPICS_MAX).map(|number| format!("{name}_{number}")));
        let free = names.into_iter().find(|name| !self.index.contains_key(name.as_str()))?;
        self.add(free, ty.clone())
    }

    /// Topic of this name and standard type; `None`, and counted, if there are too many.
    pub fn standard(&mut self, name: &str, ty: Standard) -> Option<u16> {
        if let Some(&id) = self.index.get(name) {
            return Some(id);
        }
        let ty = self.standard.entry(ty.name()).or_insert_with(|| ty.describe()).clone();
        let id = self.add(name.to_owned(), ty);
        self.left_out += u64::from(id.is_none());
        id
    }

    fn add(&mut self, name: String, ty: RosType) -> Option<u16> {
        let id = u16::try_from(self.all.len()).ok().filter(|_| self.all.len() < TOPICS_MAX)?;
        let name: Arc<str> = name.into();
        self.all.push(Topic { id, name: name.clone(), schema_name: ty.name, schema_text: ty.text });
        self.index.insert(name, id);
        Some(id)
    }
}

fn is_reserved(name: &str) -> bool {
    RESERVED_NAMES.iter().any(|kept| if kept.ends_with('/') { name.starts_with(kept) } else { name == *kept })
}
