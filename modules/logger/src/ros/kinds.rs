//! Types by the fingerprints that messages begin with.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Index;
use std::sync::Arc;

use lcm_gen::cdr::{Plan, Plans};
use lcm_gen::{Definition, MemberType, Primitive, Schema, Size, ros2};
use messages::{Channel, LCM_FILES};

/// Message type.
#[derive(Clone, Debug)]
pub struct Kind {
    /// LCM name: `lowlevel.data_odo_t`.
    pub name: Arc<str>,
    /// Text of the `.lcm` files that define it and all its members, in order of their names.
    pub lcm: Arc<str>,
    /// Offset of its `timestamp`, if it has one at a fixed offset.
    timestamp_at: Option<usize>,
    ros: Option<RosType>,
    foreign: bool,
}

/// Name and definition in ROS 2.
#[derive(Clone, Debug)]
pub struct RosType {
    pub name: Arc<str>,
    pub text: Arc<str>,
}

impl Kind {
    /// `timestamp` of a message, µs since the epoch, if it is at a fixed offset.
    #[must_use]
    pub fn timestamp(&self, data: &[u8]) -> Option<i64> {
        let bytes = data.get(self.timestamp_at?..)?.first_chunk()?;
        Some(i64::from_be_bytes(*bytes))
    }

    /// True if it is the type of the channel in the robot's table.
    pub(super) fn is(&self, channel: Channel) -> bool {
        !self.foreign && *self.name == *channel.type_name()
    }
}

/// All known types, the robot's first.
#[derive(Clone, Debug, Default)]
pub struct Kinds {
    kinds: Vec<Kind>,
    /// Plans of the robot's types and of foreign ones: both may have one of the same name.
    plans: [Plans; 2],
    /// Types with the fingerprint: one of the robot, a foreign one, or both.
    index: BTreeMap<u64, [Option<usize>; 2]>,
}

impl Index<usize> for Kinds {
    type Output = Kind;

    fn index(&self, place: usize) -> &Kind {
        &self.kinds[place]
    }
}

impl Kinds {
    /// Types of the robot.
    pub fn new() -> Self {
        let mut kinds = Self::default();
        // They are built in, and a test parses them.
        if let Ok(schema) = Schema::new(LCM_FILES) {
            kinds.add(&schema, LCM_FILES, false);
        }
        kinds
    }

    /// Types of the robot, and of the files.
    pub fn with(files: &[(impl AsRef<str>, impl AsRef<str>)]) -> Result<Self, lcm_gen::Error> {
        let schema = Schema::new(files)?;
        let mut kinds = Self::new();
        kinds.add(&schema, files, true);
        Ok(kinds)
    }

    fn add(&mut self, schema: &Schema, files: &[(impl AsRef<str>, impl AsRef<str>)], foreign: bool) {
        let names = ros2::Types::new(schema);
        let plans = Plans::new(schema);
        let mut texts: BTreeMap<BTreeSet<&str>, Arc<str>> = BTreeMap::new();
        for definition in schema.definitions() {
            let name = definition.name();
            let Some(fingerprint) = schema.fingerprint(&name) else { continue };
            let slot = &mut self.index.entry(fingerprint).or_default()[usize::from(foreign)];
            if slot.is_some() {
                continue; // of identical foreign types the first
            }
            *slot = Some(self.kinds.len());
            let needed: BTreeSet<&str> = schema.parts(&name).map(|part| part.file.as_str()).collect();
            let lcm = texts.entry(needed).or_insert_with_key(|needed| text_of(needed, files).into()).clone();
            let ros = names.get(&name).map(|ros| RosType { name: ros.name().into(), text: ros.text().into() });
            let timestamp_at = timestamp_at(schema, definition);
            self.kinds.push(Kind { name: name.into(), lcm, timestamp_at, ros, foreign });
        }
        self.plans[usize::from(foreign)] = plans;
    }

    /// Type of a message. On channels of the robot's table the robot's type takes precedence, elsewhere a foreign one.
    pub fn find(&self, channel: Option<Channel>, data: &[u8]) -> Option<usize> {
        let [own, foreign] = *self.index.get(&u64::from_be_bytes(*data.first_chunk()?))?;
        let listed = own.filter(|&own| channel.is_some_and(|channel| self.kinds[own].is(channel)));
        listed.or(foreign).or(own)
    }

    /// Conversion to ROS 2, if there is one.
    pub fn ros(&self, place: usize) -> Option<(Plan<'_>, &RosType)> {
        let kind = &self.kinds[place];
        self.plans[usize::from(kind.foreign)].get(&kind.name).zip(kind.ros.as_ref())
    }
}

fn text_of(needed: &BTreeSet<&str>, files: &[(impl AsRef<str>, impl AsRef<str>)]) -> String {
    let mut text = String::new();
    for (name, of) in files.iter().map(|(name, of)| (name.as_ref(), of.as_ref())) {
        if needed.contains(name) {
            text.push_str(of);
            text.push_str(if of.ends_with('\n') { "" } else { "\n" });
        }
    }
    text
}

/// Offset of `int64_t timestamp`, if all members before it have a fixed size.
fn timestamp_at(schema: &Schema, definition: &Definition) -> Option<usize> {
    let mut at = size_of::<u64>();
    for member in definition.members() {
        if member.name == "timestamp" && member.ty == MemberType::Primitive(Primitive::Int64) && member.dims.is_empty()
        {
            return Some(at);
        }
        let size = match &member.ty {
            MemberType::Primitive(Primitive::String) => return None,
            MemberType::Primitive(ty) => ty.min_size(),
            MemberType::Named(name) => schema.min_size(name).filter(|_| schema.is_fixed(name))?,
        };
        at += member.dims.iter().try_fold(size, |size, dim| match dim.size {
            Size::Fixed(count) => size.checked_mul(count),
            Size::Variable => None,
        })?;
    }
    None
}
