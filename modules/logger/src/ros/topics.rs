//! Topics: each has its type for good, and a small number that stays.

use std::collections::BTreeMap;
use std::iter;
use std::sync::Arc;

use super::kinds::RosType;
use super::standard::Standard;

/// Who takes what comes out: the topic, and the message as CDR.
pub type Sink<'a> = dyn FnMut(&Topic, &[u8]) + 'a;

/// How many topics there can be: with the channels as they are they fit into what a log can number (65 535).
pub const TOPICS_MAX: usize = 16_384;

/// Names that are kept for messages of standard types, and beginnings of such.
const KEPT: &[&str] = &[
    "/battery",
    "/diagnostics",
    "/marks",
    "/odometry",
    "/plan",
    "/pose",
    "/range/",
    "/rosout",
    "/scene",
    "/temperature/",
    "/tf",
];

/// A topic of ROS 2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its number: from 0, in the order in which topics were first heard.
    pub id: u16,
    /// Its name: `/LL_DATA_ODO`, `/range/3`.
    pub name: Arc<str>,
    /// The name of its messages' type: `lowlevel/msg/DataOdo`.
    pub schema_name: Arc<str>,
    /// The type as `ros2msg`.
    pub schema_text: Arc<str>,
}

#[derive(Clone, Debug, Default)]
pub struct Topics {
    all: Vec<Topic>,
    index: BTreeMap<Arc<str>, u16>,
    /// Texts of the standard types that are in use.
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

    /// Counts a message that found no place.
    pub fn leave_out(&mut self) {
        self.left_out += 1;
    }

    /// A new topic for a channel's messages of that type; `None` when there are too many.
    pub fn own(&mut self, channel: &str, first: bool, ty: &RosType) -> Option<u16> {
        let front = if is_kept(&format!("/{channel}")) { "/lcm/" } else { "/" };
        let name = format!("{front}{channel}");
        if first && !self.index.contains_key(name.as_str()) {
            return self.add(name, ty.clone());
        }
        let name = format!("{name}/{}", ty.name.replace("/msg/", "/"));
        let names = iter::once(name.clone()).chain((2..=TOPICS_MAX).map(|number| format!("{name}_{number}")));
        let free = names.into_iter().find(|name| !self.index.contains_key(name.as_str()))?;
        self.add(free, ty.clone())
    }

    /// The topic of that name, of a standard type; `None`, and counted, when there are too many.
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

fn is_kept(name: &str) -> bool {
    KEPT.iter().any(|kept| if kept.ends_with('/') { name.starts_with(kept) } else { name == *kept })
}
