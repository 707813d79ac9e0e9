//! What a node refuses to have written, beyond what its dictionary refuses.

use super::Phase;
use super::pdo;
use crate::sdo::Objects;
use crate::wire::is_restricted;
use crate::{Abort, Dictionary, NmtState, Payload};

const SAVE: i64 = 0x6576_6173; // "save"
const LOAD: i64 = 0x6461_6F6C; // "load"
const INVALID: i64 = 1 << 31;
/// Bit 30 of 0x1005 and 0x1012: this node produces it; of a TPDO's COB-ID: no remote frames.
const BIT_30: i64 = 1 << 30;
/// Least period: ten times the duration of a SYNC at 1 Mbit/s.
const SYNC_MICROS_MIN: i64 = 500;

/// A dictionary behind the rules of the communication profile.
pub(super) struct Guarded<'a> {
    pub(super) dictionary: &'a mut Dictionary,
    pub(super) phase: Phase,
    pub(super) written: Option<(u16, u8)>,
}

impl Objects for Guarded<'_> {
    fn read(&mut self, index: u16, sub: u8) -> Result<Payload, Abort> {
        self.dictionary.read(index, sub)
    }

    fn check_write(&self, index: u16, sub: u8, size: Option<usize>) -> Result<Option<usize>, Abort> {
        self.dictionary.check_write(index, sub, size)
    }

    fn write(&mut self, index: u16, sub: u8, data: &[u8]) -> Result<(), Abort> {
        let value = self.dictionary.parse(index, sub, data)?;
        self.check(index, sub, value)?;
        self.dictionary.write(index, sub, data)?;
        self.written = Some((index, sub));
        Ok(())
    }
}

fn require(holds: bool, otherwise: Abort) -> Result<(), Abort> {
    if holds { Ok(()) } else { Err(otherwise) }
}

impl Guarded<'_> {
    fn check(&self, index: u16, sub: u8, value: i64) -> Result<(), Abort> {
        match (index, sub) {
            (0x1003, 0) => require(value == 0, Abort::RANGE),
            (0x1005, 0) => self.check_cob_id(index, value, |id| id & BIT_30 != 0),
            (0x1006, 0) => require(value == 0 || value >= SYNC_MICROS_MIN, Abort::RANGE),
            // This node consumes TIME but does not produce it.
            (0x1012, 0) if value & BIT_30 != 0 => Err(Abort::RANGE),
            (0x1012, 0) => self.check_cob_id(index, value, |id| id & INVALID != 0),
            (0x1014, 0) => self.check_cob_id(index, value, |id| id & INVALID == 0),
            (0x1019, 0) => {
                require(matches!(value, 0 | 2..=240), Abort::RANGE)?;
                require(self.dictionary.get(0x1006, 0).unwrap_or(0) == 0, Abort::DEVICE_STATE)
            }
            (0x1029, 1..) => require(matches!(value, 0..=2), Abort::RANGE),
            (0x1010, 1..) => require(value == SAVE, Abort::CANNOT_STORE),
            (0x1011, 1..) => require(value == LOAD, Abort::CANNOT_STORE),
            (0x1016, 1..) => self.check_consumer(sub, value),
            (0x1400..=0x15FF | 0x1800..=0x19FF, _) => self.check_communication(index, sub, value),
            (0x1600..=0x17FF | 0x1A00..=0x1BFF, _) => self.check_mapping(index, sub, value),
            _ => Ok(()),
        }
    }

    /// SYNC, TIME and EMCY: the identifier stays while the object `lives`; 29 bits are not spoken.
    fn check_cob_id(&self, index: u16, value: i64, lives: fn(i64) -> bool) -> Result<(), Abort> {
        let present = self.dictionary.get(index, 0).unwrap_or(0);
        let keeps = present & 0x1FFF_FFFF == value & 0x1FFF_FFFF;
        require(value & 0x3FFF_F800 == 0, Abort::RANGE)?;
        require(keeps || !(lives(present) && lives(value)), Abort::RANGE)?;
        require(!is_restricted((value & 0x7FF) as u16), Abort::RANGE)
    }

    /// Two entries for one node are refused (CiA 301, 0x1016).
    fn check_consumer(&self, sub: u8, value: i64) -> Result<(), Abort> {
        let watched = |entry: i64| (entry & 0xFFFF != 0).then_some(entry >> 16 & 0xFF).filter(|node| *node != 0);
        require(watched(value).is_none_or(|node| node <= 127), Abort::RANGE)?;
        let others = (1..=127).filter(|other| *other != sub).filter_map(|other| self.dictionary.get(0x1016, other));
        let taken = others.filter_map(watched).any(|node| watched(value) == Some(node));
        require(!taken, Abort::INCOMPATIBLE)
    }

    /// 0x1400 and 0x1800 (CiA 301, Tables 55 and 56).
    fn check_communication(&self, index: u16, sub: u8, value: i64) -> Result<(), Abort> {
        let present = self.dictionary.get(index, 1).unwrap_or(INVALID);
        let valid = present & INVALID == 0;
        match sub {
            1 => {
                // The identifier stays while the PDO exists; 29 bits are not spoken.
                let keeps = present & 0x3FFF_FFFF == value & 0x3FFF_FFFF;
                require(!valid || value & INVALID != 0 || keeps, Abort::RANGE)?;
                require(value & 0x3FFF_F800 == 0, Abort::RANGE)?;
                require(value & INVALID != 0 || !is_restricted((value & 0x7FF) as u16), Abort::RANGE)
            }
            // 252 and 253 are sent at remote frames only.
            2 if matches!(value, 252 | 253) => require(index >= 0x1800 && present & BIT_30 == 0, Abort::RANGE),
            2 => require(matches!(value, 0..=240 | 254 | 255), Abort::RANGE),
            6 if !(0..=240).contains(&value) => Err(Abort::RANGE),
            3 | 6 => require(!valid, Abort::UNSUPPORTED_ACCESS),
            _ => Ok(()),
        }
    }

    /// 0x1600 and 0x1A00: the procedure of CiA 301, 9.5.4, and no shortcut.
    fn check_mapping(&self, index: u16, sub: u8, value: i64) -> Result<(), Abort> {
        require(self.phase != Phase::Running(NmtState::Operational), Abort::DEVICE_STATE)?;
        let valid = self.dictionary.get(index - 0x200, 1).unwrap_or(INVALID) & INVALID == 0;
        require(!valid, Abort::UNSUPPORTED_ACCESS)?;
        if sub == 0 {
            require((0..=64).contains(&value), Abort::PDO_LENGTH)?;
            pdo::compile(self.dictionary, index, value as u8).map(|_| ())
        } else {
            require(self.dictionary.get(index, 0) == Some(0), Abort::UNSUPPORTED_ACCESS)?;
            if value == 0 { Ok(()) } else { pdo::locate(self.dictionary, index, value as u32).map(|_| ()) }
        }
    }
}
