//! PDOs by the names of what is mapped in them: as the node's data sheet has it, as its driver wants it, and as SDO
//! transfers were seen to change it.

use super::{Look, Told, said};
use crate::can::book::Book;
use crate::can::value::{self, Shown};
use base::can::{Frame, Id};
use canopen::pdo::{INVALID, Layout, MAX_ENTRIES, Mapped};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Bit 29 of a COB-ID: it has 29 bits.
const EXTENDED: u32 = 1 << 29;

/// A PDO of a node.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Pdo {
    /// COB-ID of 0x1400:1 or 0x1800:1 with flags; `None` while unknown.
    cob_id: Option<u32>,
    /// Number of objects that count: sub-index 0 of the mapping.
    count: u8,
    /// The mapping's sub-indices from 1 on.
    entries: Vec<u32>,
}

/// Node, whether it receives it, and number, 0 for the PDO of 0x1400 or 0x1800.
type Key = (u8, bool, u16);

/// All known PDOs.
#[derive(Default)]
pub struct Maps(BTreeMap<Key, Pdo>);

impl Maps {
    /// PDOs of the data sheets.
    pub fn new(book: &Book) -> Self {
        let mut maps = Self::default();
        book.nodes().for_each(|node| maps.boot(book, node));
        maps
    }

    /// A node has booted: its mappings are those of its data sheet again.
    pub fn boot(&mut self, book: &Book, node: u8) {
        self.0.retain(|(known, _, _), _| *known != node);
        for canopen::pdo::Pdo { record, cob_id, entries, .. } in book.pdos(node) {
            let (received, first) = if record < 0x1800 { (true, 0x1400) } else { (false, 0x1800) };
            let pdo = Pdo { cob_id: Some(cob_id), count: entries.len() as u8, entries };
            self.0.insert((node, received, record - first), pdo);
        }
    }

    /// Takes an object that was read or written: it may change a mapping.
    pub fn learn(&mut self, node: u8, index: u16, sub: u8, data: &[u8]) {
        let (received, is_mapping, number) = match index {
            0x1400..=0x15FF => (true, false, index - 0x1400),
            0x1600..=0x17FF => (true, true, index - 0x1600),
            0x1800..=0x19FF => (false, false, index - 0x1800),
            0x1A00..=0x1BFF => (false, true, index - 0x1A00),
            _ => return,
        };
        let Some(value) = value::number(data).and_then(|value| u32::try_from(value).ok()) else {
            return;
        };
        let is_known = matches!((is_mapping, usize::from(sub)), (false, 1) | (true, 0..=MAX_ENTRIES));
        if !is_known {
            return;
        }
        let pdo = self.0.entry((node, received, number)).or_default();
        match (is_mapping, usize::from(sub)) {
            (false, _) => pdo.cob_id = Some(value),
            (true, 0) => pdo.count = value.min(MAX_ENTRIES as u32) as u8,
            (true, at) => {
                pdo.entries.resize(pdo.entries.len().max(at), 0);
                pdo.entries[at - 1] = value;
            }
        }
    }

    /// Decodes a PDO; `None` if the frame is no known node's PDO.
    pub fn told(&self, book: &Book, frame: &Frame) -> Option<Told> {
        let wanted = match frame.id() {
            Id::Standard(id) => u32::from(id),
            Id::Extended(id) => id | EXTENDED,
        };
        let has = |pdo: &Pdo, flags: u32| pdo.cob_id.is_some_and(|id| id & (flags | EXTENDED | 0x1FFF_FFFF) == wanted);
        // A PDO that is off by the known configuration but sent nevertheless: some frames were missed.
        let valid = self.0.iter().find(|(_, pdo)| has(pdo, INVALID));
        let ((node, received, number), pdo) = valid.or_else(|| self.0.iter().find(|(_, pdo)| has(pdo, 0)))?;
        let what = name(*received, u32::from(*number) + 1);
        if frame.is_remote() {
            return Some(Told::new(Some(*node), what, Look::Command, "asked for", json!({"remote": true})));
        }
        let mapped = &pdo.entries[..usize::from(pdo.count).min(pdo.entries.len())];
        let Some(layout) = Layout::new(mapped).ok().filter(|_| !mapped.is_empty()) else {
            return Some(raw(*node, what, frame));
        };
        let look = if *received { Look::Command } else { Look::Plain };
        let Some(values) = unpack(book, *node, &layout, frame.data()) else {
            let says = format!("shorter than its mapping: {}", said(frame));
            return Some(Told::new(Some(*node), what, Look::Bad, says, json!({"short": true})));
        };
        let says: Vec<String> = values.iter().map(|(name, shown)| format!("{name} {}", shown.text)).collect();
        let object: Map<String, Value> = values.into_iter().map(|(name, shown)| (name, shown.json)).collect();
        Some(Told::new(Some(*node), what, look, says.join(", "), json!({"values": object})))
    }
}

/// A PDO of the pre-defined connection set with an unknown mapping.
pub fn unmapped(node: u8, received: bool, number: u8, frame: &Frame) -> Told {
    raw(node, name(received, u32::from(number)), frame)
}

fn raw(node: u8, what: String, frame: &Frame) -> Told {
    Told::new(Some(node), what, Look::Plain, said(frame), json!({}))
}

fn name(received: bool, number: u32) -> String {
    format!("{}{number}", if received { "RPDO" } else { "TPDO" })
}

/// The mapped objects by name with their values; none when the frame has fewer bits than are mapped.
fn unpack(book: &Book, node: u8, layout: &Layout, data: &[u8]) -> Option<Vec<(String, Shown)>> {
    let values = layout.unpack(data)?.map(|(item, value)| {
        let Mapped { index, sub, bits } = item.mapped;
        let name = book.name(node, index, sub).unwrap_or_else(|| value::object(index, sub));
        (name, book.show(node, index, sub, &value.to_le_bytes()[..usize::from(bits).div_ceil(8)]))
    });
    Some(values.collect())
}
