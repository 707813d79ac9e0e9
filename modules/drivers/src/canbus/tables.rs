//! The tables of drives that a configuration may name: the built-in ones, and those of the folder `drives`.
//!
//! A node that names a table gets its keys before it is read, each with the file and the line that it is from, so that
//! what is wrong is named where it is written. Keys of the node count in place of those of the table.

use super::config::{DRIVERS, Drive, STEERS, TURNS};
use super::table::{BUILT_IN, DriveFile, DriveTable, parsed};
use settings::{Node, Problems, Value};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The folder beside `robot.toml`.
pub const FOLDER: &str = "drives";
/// Greatest size of a file, bytes.
pub const BYTES_MAX: usize = 256 * 1024;
/// Greatest number of files.
pub const FILES_MAX: usize = 64;
/// Greatest length of a name.
const NAME_MAX: usize = 40;

/// Keys of a table of objects that are keys of the node, too.
const SHARED: [&str; 4] = ["eds", "gear", "counts_per_turn", "homing_method"];

/// Tables by name.
#[derive(Clone, Debug)]
pub struct DriveTables {
    tables: BTreeMap<String, Entry>,
}

#[derive(Clone, Debug)]
struct Entry {
    file: DriveFile,
    keys: Node,
    /// Of a drive whose objects are listed.
    objects: Option<Arc<DriveTable>>,
    /// Its file, of a user's.
    path: Option<String>,
}

impl Entry {
    fn new(name: &str, path: &Path, text: &str, of_user: bool) -> Result<Self, Vec<String>> {
        let (keys, file) = parsed(path, text)?;
        let objects = file.objects(name).map(|mut table| {
            // The built-in ones are compared as they always were.
            if of_user {
                table.compare_transmission();
            }
            Arc::new(table)
        });
        Ok(Self { file, keys, objects, path: of_user.then(|| path.display().to_string()) })
    }
}

impl Default for DriveTables {
    /// The built-in ones.
    fn default() -> Self {
        let entry =
            |(name, text): (&str, &str)| Some((name.into(), Entry::new(name, Path::new(name), text, false).ok()?));
        Self { tables: BUILT_IN.into_iter().filter_map(entry).collect() }
    }
}

impl DriveTables {
    /// Adds the file of this name, without its ending, in place of a built-in one of the same name.
    ///
    /// # Errors
    /// One line for each thing that is wrong in it.
    pub fn add(&mut self, name: &str, path: &Path, text: &str) -> Result<(), Vec<String>> {
        let refused = |why: String| Err(vec![format!("{}: {why}", path.display())]);
        let is_letter = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
        if name.is_empty() || name.len() > NAME_MAX || !name.chars().all(is_letter) {
            return refused(format!("expected a name of at most {NAME_MAX} letters, digits, - and _"));
        }
        if DRIVERS.contains(&name) {
            return refused(format!("expected another name: {name:?} is a driver that is no table"));
        }
        if text.len() > BYTES_MAX {
            return refused(format!("expected at most {BYTES_MAX} bytes"));
        }
        if self.tables.values().filter(|entry| entry.path.is_some()).count() >= FILES_MAX {
            return refused(format!("expected at most {FILES_MAX} files"));
        }
        self.tables.insert(name.into(), Entry::new(name, path, text, true)?);
        Ok(())
    }

    /// Each table: its name, its content, and true if it is a user's.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &DriveFile, bool)> {
        self.tables.iter().map(|(name, entry)| (name.as_str(), &entry.file, entry.path.is_some()))
    }

    /// Files that replace a built-in table, as lines for a person.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        let replaces = |(name, _): (&str, &str)| {
            let path = self.tables.get(name)?.path.as_ref()?;
            Some(format!("{path}: replaces the built-in table {name:?}"))
        };
        BUILT_IN.into_iter().filter_map(replaces).collect()
    }

    /// Gives the nodes of a robot's file that name tables the keys of these, and notes names that no table has.
    pub fn expand(&self, robot: &mut Node, problems: &Problems) {
        let Value::Table(robot) = &mut robot.value else { return };
        let Some(Value::Table(buses)) = robot.get_mut("can").map(|can| &mut can.value) else { return };
        for (bus, keys) in buses {
            let Value::Table(keys) = &mut keys.value else { continue };
            let Some(Value::Array(nodes)) = keys.get_mut("nodes").map(|nodes| &mut nodes.value) else { continue };
            for (n, node) in nodes.iter_mut().enumerate() {
                if let Value::Table(node) = &mut node.value {
                    self.expand_node(node, &format!("can.{bus}.nodes[{n}].driver"), problems);
                }
            }
        }
    }

    fn expand_node(&self, node: &mut BTreeMap<String, Node>, key: &str, problems: &Problems) {
        let Some(Node { origin, value: Value::String(name) }) = node.get("driver") else { return };
        if DRIVERS.contains(&name.as_str()) {
            return;
        }
        let Some(entry) = self.tables.get(name) else {
            let tables = self.tables.keys().map(String::as_str);
            let names: Vec<String> = tables.chain(DRIVERS).map(|name| format!("{name:?}")).collect();
            let expected = format!("{}, or the NAME of a file {FOLDER}/NAME.toml", names.join(" or "));
            problems.add(origin, key, format!(" = {name:?}: expected {expected}"));
            return;
        };
        let driver = match &entry.objects {
            Some(table) if table.turns_wheels() => format!("{TURNS}{name}"),
            Some(_) => format!("{STEERS}{name}"),
            None => "cia402".into(),
        };
        let origin = origin.clone();
        node.insert("driver".into(), Node { origin, value: Value::String(driver) });
        let Value::Table(keys) = &entry.keys.value else { return };
        let is_taken = |key: &str| key != "form" && (entry.objects.is_none() || SHARED.contains(&key));
        // A wheel has no counts of its own.
        let is_wheel = entry.objects.as_ref().is_some_and(|table| table.turns_wheels());
        for (key, value) in keys.iter().filter(|(key, _)| is_taken(key) && !(is_wheel && *key == "counts_per_turn")) {
            node.entry(key.clone()).or_insert_with(|| if key == "eds" { beside(value) } else { value.clone() });
        }
    }

    /// Gives a drive the table of objects that its node names, after it was read.
    pub fn bind(&self, robot: &Node, bus: &str, n: usize, drive: &mut Drive) {
        let node = robot.below("can").and_then(|can| can.below(bus)).and_then(|bus| bus.below("nodes"));
        let Some(Value::Array(nodes)) = node.map(|nodes| &nodes.value) else { return };
        let driver = nodes.get(n).and_then(|node| node.below("driver")).map(|driver| &driver.value);
        let Some(Value::String(driver)) = driver else { return };
        let name = [TURNS, STEERS].into_iter().find_map(|kind| driver.strip_prefix(kind));
        let table = name.and_then(|name| self.tables.get(name)).and_then(|entry| entry.objects.clone());
        match drive {
            Drive::Wheel(keys) => keys.table = table.or(keys.table.take()),
            Drive::Steering(keys) => keys.table = table.or(keys.table.take()),
            Drive::Cia402(_) | Drive::Odrive(_) | Drive::Vesc(_) => {}
        }
    }
}

/// The path of a data sheet beside the file that names it, from `robot.toml` on.
fn beside(node: &Node) -> Node {
    let value = match &node.value {
        Value::String(name) if !name.is_empty() => Value::String(Path::new(FOLDER).join(name).display().to_string()),
        other => other.clone(),
    };
    Node { origin: node.origin.clone(), value }
}
