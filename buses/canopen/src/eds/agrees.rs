//! Whether a data sheet is that of the device that a driver expects: asked before anything is on the bus.

use super::Eds;
use crate::NodeConfig;
use crate::dictionary::Access;
use alloc::format;
use alloc::string::String;

impl Eds {
    /// First objection to this configuration of the device: an object that is missing, read-only, or of another width;
    /// a PDO with an object that cannot be mapped. `None`: the data sheet agrees. Identity is not compared: sheets of
    /// one family often carry a sibling's.
    #[must_use]
    pub fn objection(&self, node: &NodeConfig) -> Option<String> {
        let error_control = [(0x1016, 1, 4, node.master_limit.is_some()), (0x1017, 0, 2, node.guarding.is_none())];
        let error_control = error_control.into_iter().filter(|(.., used)| *used);
        let writes = node.writes.iter().map(|write| (write.index, write.sub, write.value.len()));
        let writes = writes.chain(error_control.map(|(index, sub, len, _)| (index, sub, len)));
        let mapped = node.mappings.iter().flat_map(|pdo| pdo.entries.iter().map(|entry| (pdo.record, *entry)));
        writes
            .filter_map(|(index, sub, len)| self.unwritable(index, sub, len))
            .chain(mapped.filter_map(|(record, entry)| self.unmappable(record, entry)))
            .next()
    }

    fn unwritable(&self, index: u16, sub: u8, len: usize) -> Option<String> {
        let Some(object) = self.object(index, sub) else {
            return Some(format!("it has no object 0x{index:04X}:{sub}"));
        };
        let name = &object.name;
        match object.data_type.width() {
            _ if !object.access.writes() => Some(format!("0x{index:04X}:{sub} ({name}) cannot be written")),
            Some(width) if width != len => Some(format!("0x{index:04X}:{sub} ({name}) has {width} bytes, not {len}")),
            _ => None,
        }
    }

    fn unmappable(&self, record: u16, entry: u32) -> Option<String> {
        let (index, sub, bits) = ((entry >> 16) as u16, (entry >> 8) as u8, entry as u8);
        let Some(object) = self.object(index, sub) else {
            return Some(format!("it has no object 0x{index:04X}:{sub}"));
        };
        let name = &object.name;
        let direction = if record < 0x1800 { object.access.writes() } else { object.access != Access::WriteOnly };
        match object.data_type.width() {
            Some(width) if width * 8 != usize::from(bits) => {
                Some(format!("0x{index:04X}:{sub} ({name}) has {} bits, not {bits}", width * 8))
            }
            _ if !object.mappable || !direction => {
                Some(format!("0x{index:04X}:{sub} ({name}) cannot be mapped into the PDO of 0x{record:04X}"))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drives::{epos, icla};
    use crate::master::ConfigWrite;

    const EPOS: &[u8] = include_bytes!("../../eds/epos_sim.eds");
    const ICLA: &[u8] = include_bytes!("../../eds/icla_sim.eds");

    #[test]
    fn the_sheets_of_both_drives_agree_with_their_drivers_and_not_with_each_others() {
        let [epos_sheet, icla_sheet] = [EPOS, ICLA].map(|file| Eds::parse(file).unwrap());
        let epos = epos::node_config("propulsion", &epos::parameters(1));
        let icla = icla::node_config("steering", &icla::parameters(2));
        assert_eq!(epos_sheet.objection(&epos), None);
        assert_eq!(icla_sheet.objection(&icla), None);
        assert_eq!(epos_sheet.objection(&icla).unwrap(), "it has no object 0x605A:0");
    }

    #[test]
    fn what_cannot_be_written_as_the_driver_does_is_named() {
        let sheet = Eds::parse(EPOS).unwrap();
        let with = |write| NodeConfig { writes: [write].into(), ..NodeConfig::new(1, "drive") };
        let objection = |write| sheet.objection(&with(write)).unwrap();
        assert!(objection(ConfigWrite::new(0x6041, 0, 0_u16)).ends_with("cannot be written"));
        assert!(objection(ConfigWrite::new(0x6083, 0, 0_u16)).ends_with("has 4 bytes, not 2"));
    }
}
