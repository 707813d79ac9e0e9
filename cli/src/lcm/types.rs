//! Which types the tools know: the robot's own, built in, and others' from `.lcm` files.

use crate::Failed;
use lcm_gen::Schema;
use lcm_gen::dynamic::{DecodeError, Message, Type, Types};
use messages::Channel;
use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// Location of further types.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct TypesArg {
    /// Folder or file of .lcm types that are not the robot's; may be given often
    #[arg(long = "types", value_name = "DIR_OR_FILE")]
    types: Vec<PathBuf>,
}

/// A type file is text that people write: one above this size, bytes, is something else.
const FILE_MAX: u64 = 4 << 20;
/// Maximum number of files read below one folder.
const FILES_MAX: usize = 10_000;

/// All known types.
pub struct Dictionary {
    /// Types of `--types`, with those of the robot that it does not redefine.
    others: Option<Types>,
    own: Types,
}

/// Interpretation of the bytes on a channel.
pub enum Found<'a> {
    Message(Message<'a>),
    /// Of that type by its fingerprint, but malformed.
    Malformed(Type<'a>, DecodeError),
    /// A message of one type on a channel of the robot's that is for another.
    Misplaced(Message<'a>, &'static str),
    /// Fingerprint of no known type.
    Unknown(u64),
    /// Too short for a fingerprint.
    Short,
}

impl TypesArg {
    /// Names and texts of all those files.
    pub fn read(&self) -> Result<Vec<(String, String)>, Failed> {
        let mut files = Vec::new();
        for path in &self.types {
            find(path, true, &mut files)?;
        }
        files.sort();
        files.dedup();
        if files.is_empty() && !self.types.is_empty() {
            return Err(format!("{}: no .lcm file there", self.types[0].display()).into());
        }
        files.iter().map(|path| read(path)).collect()
    }
}

impl Dictionary {
    pub fn load(arg: &TypesArg) -> Result<Self, Failed> {
        let own = messages::LCM_FILES;
        let types = |files: &[(String, String)]| Schema::new(files).map(|schema| Types::new(&schema));
        let own: Vec<(String, String)> = own.iter().map(|(name, text)| ((*name).into(), (*text).into())).collect();
        let mut all = arg.read()?;
        let others = if all.is_empty() {
            None
        } else {
            // Theirs may use ours, and may be ours in another version.
            let mut defined = BTreeSet::new();
            for (name, text) in &all {
                let file = lcm_gen::parse(name, text).map_err(|error| Failed::from(error.to_string()))?;
                defined.extend(file.definitions.iter().map(lcm_gen::Definition::name));
            }
            let is_new = |(name, text): &&(String, String)| {
                let definitions = lcm_gen::parse(name, text).map(|file| file.definitions).unwrap_or_default();
                definitions.iter().all(|definition| !defined.contains(&definition.name()))
            };
            all.extend(own.iter().filter(is_new).cloned());
            Some(types(&all).map_err(|error| Failed::from(error.to_string()))?)
        };
        let own = types(&own).map_err(|error| Failed::from(format!("a type of the robot's own: {error}")))?;
        Ok(Self { others, own })
    }

    /// By name with package.
    pub fn get(&self, name: &str) -> Option<Type<'_>> {
        self.others.as_ref().and_then(|others| others.get(name)).or_else(|| self.own.get(name))
    }

    /// By fingerprint. Of types that differ in name only, the one that belongs on the channel.
    pub fn by_fingerprint(&self, channel: &str, fingerprint: u64) -> Option<Type<'_>> {
        let expected = Channel::from_name(channel).filter(|channel| channel.fingerprint() == fingerprint);
        let expected = expected.and_then(|channel| self.own.get(channel.type_name()));
        let others = || self.others.as_ref().and_then(|others| others.by_fingerprint(fingerprint));
        expected.or_else(others).or_else(|| self.own.by_fingerprint(fingerprint))
    }

    /// Interprets the bytes of a channel.
    pub fn find<'a>(&'a self, channel: &str, data: &'a [u8]) -> Found<'a> {
        let Some(fingerprint) = lcm::codec::fingerprint(data) else { return Found::Short };
        let Some(ty) = self.by_fingerprint(channel, fingerprint) else { return Found::Unknown(fingerprint) };
        match (ty.decode(data), Channel::from_name(channel)) {
            (Err(error), _) => Found::Malformed(ty, error),
            // With types of others it may be another robot's bus.
            (Ok(message), Some(channel)) if channel.fingerprint() != fingerprint && self.others.is_none() => {
                Found::Misplaced(message, channel.type_name())
            }
            (Ok(message), _) => Found::Message(message),
        }
    }
}

/// Why it is no message; a message is its type's name.
impl fmt::Display for Found<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Message(message) => write!(f, "{}", message.ty().name()),
            Self::Malformed(ty, error) => write!(f, "malformed {}: {error}", ty.name()),
            Self::Misplaced(message, expected) => write!(f, "a {} where {expected} belongs", message.ty().name()),
            Self::Unknown(fingerprint) => write!(f, "unknown type {fingerprint:#018x}; --types says where it is"),
            Self::Short => write!(f, "too short for a message"),
        }
    }
}

fn failed(path: &Path, error: impl fmt::Display) -> Failed {
    format!("{}: {error}", path.display()).into()
}

/// All `.lcm` files in and below a folder, or the file. Links to folders are not followed: they may form a circle.
fn find(path: &Path, named: bool, files: &mut Vec<PathBuf>) -> Result<(), Failed> {
    let metadata = if named { fs::metadata(path) } else { fs::symlink_metadata(path) };
    let kind = metadata.map_err(|error| failed(path, error))?.file_type();
    if kind.is_dir() {
        for entry in fs::read_dir(path).map_err(|error| failed(path, error))? {
            find(&entry.map_err(|error| failed(path, error))?.path(), false, files)?;
        }
    } else if named || path.extension().is_some_and(|extension| extension == "lcm") {
        if files.len() == FILES_MAX {
            return Err(failed(path, format_args!("more than {FILES_MAX} files")));
        }
        files.push(path.into());
    }
    Ok(())
}

fn read(path: &Path) -> Result<(String, String), Failed> {
    let metadata = fs::metadata(path).map_err(|error| failed(path, error))?;
    if !metadata.is_file() || metadata.len() > FILE_MAX {
        return Err(failed(path, "no type file"));
    }
    Ok((path.display().to_string(), lcm_gen::build::read_text(path)?))
}
