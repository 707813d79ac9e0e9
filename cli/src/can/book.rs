//! What is known of the objects of each node: names, types, and how PDOs are mapped when a node has booted. From the
//! data sheet that is given, else the configured one, else the one of its driver, else the standards.

use super::standard;
use super::target::{Known, Target};
use super::value::{self, Shown};
use crate::Failed;
use canopen::Abort;
use canopen::dictionary::DataType;
use canopen::drives::epos;
use canopen::eds::{self, Eds};
use canopen::pdo::Pdo;
use drivers::canbus::Drive;
use drivers::canbus::table::Twin;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

const EPOS: &str = include_str!("../../../buses/canopen/eds/epos_sim.eds");
const ICLA: &str = include_str!("../../../buses/canopen/eds/icla_sim.eds");

/// The book of a bus.
#[derive(Default)]
pub struct Book {
    nodes: BTreeMap<u8, Eds>,
    /// For every node.
    given: Option<Eds>,
}

impl Book {
    /// Names and types for the configured nodes; `given`: data sheet for the node that is asked.
    pub fn new(target: &Target, given: Option<&Path>) -> Result<Self, Failed> {
        let given = given.map(read).transpose()?;
        let nodes = target.known.iter().map(|known| Ok((known.id, sheet(known)?))).collect::<Result<_, Failed>>()?;
        Ok(Self { nodes, given })
    }

    fn sheet(&self, node: u8) -> Option<&Eds> {
        self.given.as_ref().or_else(|| self.nodes.get(&node))
    }

    /// The nodes that have data sheets of their own.
    pub fn nodes(&self) -> impl Iterator<Item = u8> + '_ {
        self.nodes.keys().copied()
    }

    /// The name of an object.
    pub fn name(&self, node: u8, index: u16, sub: u8) -> Option<String> {
        let written = self.sheet(node).and_then(|sheet| sheet.name(index, sub)).map(|name| name.to_string());
        written.or_else(|| standard::object(index, sub).map(|(name, _)| name))
    }

    /// Index and name: `0x6041 Statusword`.
    pub fn titled(&self, node: u8, index: u16, sub: u8) -> String {
        let name = self.name(node, index, sub).map(|name| format!(" {name}")).unwrap_or_default();
        value::object(index, sub) + &name
    }

    /// An abort code with its name: that of the standard, or of the node's vendor.
    pub fn abort(&self, node: u8, code: Abort) -> String {
        let vendor = self.sheet(node).and_then(|sheet| sheet.dictionary(node).get(0x1018, 1));
        let own = epos::abort_name(code).filter(|_| vendor == Some(i64::from(epos::VENDOR)));
        own.map_or_else(|| code.to_string(), |name| format!("{name} (0x{:08X})", code.0))
    }

    /// The type of an object.
    pub fn data_type(&self, node: u8, index: u16, sub: u8) -> Option<DataType> {
        let written = self.sheet(node).and_then(|sheet| sheet.object(index, sub)).map(|object| object.data_type);
        written.or_else(|| standard::object(index, sub).map(|(_, data_type)| data_type))
    }

    /// Text of the data of an object.
    pub fn show(&self, node: u8, index: u16, sub: u8, data: &[u8]) -> Shown {
        value::show(index, self.data_type(node, index, sub), data)
    }

    /// The object that is meant: by number, `0x6041` or `0x1018:1`, or by name.
    pub fn resolve(&self, node: u8, text: &str) -> Result<(u16, u8), Failed> {
        let written = eds::address(text).or_else(|| self.sheet(node)?.resolve(text));
        let found = written.or_else(|| standard::resolve(text));
        found.ok_or_else(|| {
            let sheet = if self.sheet(node).is_some() { "its data sheet" } else { "the standards (--eds gives more)" };
            format!("no object {text:?}: expected 0x6041, 0x1018:1, or one name of {sheet}").into()
        })
    }

    /// The PDOs of a node that has booted.
    pub fn pdos(&self, node: u8) -> Vec<Pdo> {
        let Some(sheet) = self.sheet(node) else {
            return Vec::new();
        };
        let records = sheet.groups().iter().map(|group| group.index);
        let records = records.filter(|index| matches!(index, 0x1400..=0x15FF | 0x1800..=0x19FF));
        records.filter_map(|record| sheet.pdo(record, node)).collect()
    }
}

fn sheet(known: &Known) -> Result<Eds, Failed> {
    match &known.eds {
        Some(path) => read(path),
        None => {
            let twin = known.drive.table().and_then(|table| table.simulated);
            let text = match known.drive {
                Drive::Wheel(_) | Drive::Steering(_) if twin == Some(Twin::Epos) => EPOS,
                Drive::Wheel(_) | Drive::Steering(_) if twin == Some(Twin::Icla) => ICLA,
                Drive::Wheel(_) | Drive::Steering(_) | Drive::Cia402(_) => {
                    return Err(format!("{}: no data sheet is configured", known.name).into());
                }
                Drive::Odrive(_) | Drive::Vesc(_) => {
                    return Err(format!("{}: this drive is no CANopen node", known.name).into());
                }
            };
            Eds::parse(text.as_bytes()).map_err(|error| format!("the built-in data sheet: {error}").into())
        }
    }
}

fn read(path: &Path) -> Result<Eds, Failed> {
    let file = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Eds::parse(&file).map_err(|error| format!("{}: {error}", path.display()).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_abort_code_of_a_vendor_is_named_for_its_nodes_only() {
        let node = |text: &str| Book { given: Some(Eds::parse(text.as_bytes()).unwrap()), ..Book::default() };
        let code = Abort(0x0F00_FFC0);
        assert_eq!(node(EPOS).abort(1, code), "wrong NMT state (0x0F00FFC0)");
        assert_eq!(node(ICLA).abort(1, code), "unknown abort code (0x0F00FFC0)");
        assert_eq!(node(EPOS).abort(1, Abort::NO_OBJECT), "object does not exist (0x06020000)");
    }
}
