//! What a DCF has written to its device.

use super::{Eds, Object};
use crate::Payload;
use crate::master::ConfigWrite;
use crate::pdo::{INVALID, MAX_ENTRIES, Pdo};
use alloc::vec::Vec;

/// Commands, not settings: the history of errors, store, restore, program control, and the controlwords of the axes of
/// a drive, which a configuration tool that read them from a running device leaves in the file.
const fn is_command(index: u16) -> bool {
    matches!(index, 0x1003 | 0x1010 | 0x1011 | 0x1F51) || matches!(index, 0x6000..=0x9FFF) && index & 0x07FF == 0x0040
}

const fn is_record(index: u16) -> bool {
    matches!(index, 0x1400..=0x15FF | 0x1800..=0x19FF)
}

const fn is_mapping(index: u16) -> bool {
    matches!(index, 0x1600..=0x17FF | 0x1A00..=0x1BFF)
}

/// The value of the configured device.
fn value(object: &Object, node: u8) -> Option<Payload> {
    object.parameter.as_ref().or(object.default.as_ref()).map(|setting| setting.data(node))
}

/// ParameterValue, if writable and different from the default.
fn change(object: &Object, node: u8) -> Option<Payload> {
    let wanted = object.parameter.as_ref()?.data(node);
    let writable = object.access.writes() && !object.refuses_write && !is_command(object.index);
    let differs = object.default.as_ref().is_none_or(|default| default.data(node) != wanted);
    (writable && differs).then_some(wanted)
}

fn write(object: &Object, node: u8) -> Option<ConfigWrite> {
    let write = ConfigWrite::new(object.index, object.sub, change(object, node)?);
    let compared = object.access.reads() && !object.refuses_read;
    Some(if compared { write } else { write.blindly() })
}

impl Eds {
    /// Mapping of a PDO by the file: the values of a DCF, or else the defaults. `record`: 0x1400 and up for RPDOs,
    /// 0x1800 and up for TPDOs. `None` if the file does not define it.
    #[must_use]
    pub fn pdo(&self, record: u16, node: u8) -> Option<Pdo> {
        let number = |index, sub| {
            let object = self.object(index, sub)?;
            let setting = object.parameter.as_ref().or(object.default.as_ref())?;
            Some(setting.number(object.data_type, node))
        };
        let map = record | 0x0200;
        let count = u8::try_from(number(map, 0)?).ok().filter(|count| *count <= 64)?;
        Some(Pdo {
            record,
            cob_id: number(record, 1)? as u32,
            kind: number(record, 2).unwrap_or(255) as u8,
            inhibit: number(record, 3).map(|value| value as u16),
            event_timer: number(record, 5).map(|value| value as u16),
            entries: (1..=count).map(|sub| number(map, sub).map(|entry| entry as u32)).collect::<Option<_>>()?,
        })
    }

    /// Writes that turn a new device with this node id into the one that the DCF describes: each writable
    /// ParameterValue that differs from the DefaultValue, ascending. A PDO with any difference is remapped by the
    /// procedure of CiA 301, 9.5.4, at the place of its communication record. Commands are left out: 0x1003, 0x1010,
    /// 0x1011, 0x1F51, and controlwords. Empty for an EDS. A DCF belongs to one device: `node` is the one of
    /// [`Commissioning`](super::Commissioning), since a ParameterValue may contain it implicitly.
    #[must_use]
    pub fn configuration(&self, node: u8) -> Vec<ConfigWrite> {
        let mut writes = Vec::new();
        for group in &self.groups {
            let (index, objects) = (group.index, self.of(group.index));
            if is_record(index) {
                self.configure_pdo(index, node, &mut writes);
            } else if !(is_mapping(index) && self.group(index & !0x0200).is_some()) {
                writes.extend(objects.iter().filter_map(|object| write(object, node)));
            }
        }
        writes
    }

    /// All objects of an index.
    fn of(&self, index: u16) -> &[Object] {
        let start = self.objects.partition_point(|object| object.index < index);
        let len = self.objects[start..].partition_point(|object| object.index == index);
        &self.objects[start..start + len]
    }

    fn configure_pdo(&self, record: u16, node: u8, writes: &mut Vec<ConfigWrite>) {
        let map = record | 0x0200;
        let changed = |object: &Object| change(object, node).is_some();
        let remapped = self.of(map).iter().any(changed);
        if !remapped && !self.of(record).iter().any(changed) {
            return;
        }
        let known = |index, sub| value(self.object(index, sub)?, node);
        let cob_id = known(record, 1).and_then(|value| value.bits());
        writes.extend(cob_id.map(|cob_id| ConfigWrite::new(record, 1, cob_id | INVALID)));
        if remapped {
            let count = known(map, 0).and_then(|count| count.bits()).map_or(0, |count| count as usize);
            writes.push(ConfigWrite::new(map, 0, 0_u8));
            // All of them: a node may forget the others when their number becomes 0.
            for sub in (1..=MAX_ENTRIES as u8).take(count) {
                writes.extend(known(map, sub).map(|entry| ConfigWrite::new(map, sub, entry)));
            }
            if count > 0 {
                writes.push(ConfigWrite::new(map, 0, count as u8));
            }
        }
        let others = self.of(record).iter().filter(|object| object.sub > 1);
        writes.extend(others.filter_map(|object| write(object, node)));
        let on = cob_id.filter(|cob_id| cob_id & INVALID == 0);
        writes.extend(on.map(|cob_id| ConfigWrite::new(record, 1, cob_id)));
    }
}
