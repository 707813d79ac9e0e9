//! PDOs: those of the drive where they carry what is needed, else mapped anew.

use super::draft::Draft;
use super::refusal::{Reason, Refusal};
use super::sheet::Sheet;
use crate::axis::modes::Mode;
use crate::dictionary::{Access, DataType};
use crate::drives::cia402::{CONTROLWORD, INHIBIT, Pdo, Quantity, STATUSWORD, Setting, TORQUE, Transmission};
use crate::pdo::{INVALID, Layout, Mapped};
use alloc::borrow::Cow;
use alloc::vec;
use alloc::vec::Vec;

const RPDO: u16 = 0x1400;
const TPDO: u16 = 0x1800;
/// Communication records of all RPDOs that a device may have.
const RPDOS: core::ops::RangeInclusive<u16> = RPDO..=0x15FF;
/// PDOs of the pre-defined connection set.
const NUMBERS: core::ops::RangeInclusive<u8> = 1..=4;
/// Other TPDOs that are switched off, at most.
const TPDOS_MAX: u16 = 32;
const MODE: u16 = 0x6060;
/// Transmission types of a PDO that is sent at an event.
const EVENT: [u8; 2] = [255, 254];
/// The torque is sent this often, ms; with an event timer whether it changes or not. It changes with each sample.
const TORQUE_MS: u16 = 20;
/// The same as an inhibit time, in 100 us.
const TORQUE_INHIBIT: u16 = 10 * TORQUE_MS;

/// PDOs of a drive in use.
pub(super) struct Pdos {
    pub rpdo: Pdo,
    /// Communication records of all RPDOs.
    pub rpdos: Vec<u16>,
    pub tpdos: Vec<Pdo>,
}

/// A direction: first communication record, and the kinds of transmission that are wanted.
#[derive(Clone, Copy)]
struct Side<'a> {
    sheet: Sheet<'a>,
    first: u16,
    kinds: &'static [u8],
}

/// Chooses the PDOs for target and value, entries of mappings; switches the other TPDOs off.
pub(super) fn pdos(draft: &mut Draft<'_>, target: u32, value: u32) -> Result<Pdos, Refusal> {
    let (sheet, mode) = (draft.sheet, draft.description.mode);
    let kinds: &[u8] = match mode {
        Mode::CyclicPosition | Mode::Interpolated => &[1],
        Mode::CyclicVelocity if draft.description.sync.is_some() => &[1, 255, 254],
        _ => &EVENT,
    };
    // A mode in the RPDO would hinder homing, which changes it.
    let takes_mode = draft.description.homing.is_none();
    let commands = |entry: u32| {
        let mapped = Mapped::new(entry);
        [CONTROLWORD, target].contains(&entry) || mapped.is_dummy() || takes_mode && mapped.index == MODE
    };
    let receives = Side { sheet, first: RPDO, kinds };
    let usable = |entries: &[u32]| carries(entries, &[CONTROLWORD, target]) && entries.iter().all(|e| commands(*e));
    let rpdo = receives.as_it_is(usable).map_or_else(|| receives.anew(&[CONTROLWORD, target]), Ok)?;

    let sends = Side { sheet, first: TPDO, kinds };
    let both = sends.as_it_is(|entries| carries(entries, &[STATUSWORD, value]));
    let anew = || sends.anew(&[STATUSWORD, value]).map(|pdo| vec![pdo]);
    let pair = || {
        let status = sends.as_it_is(|entries| carries(entries, &[STATUSWORD]))?;
        Some(vec![status, sends.as_it_is(|entries| carries(entries, &[value]))?])
    };
    let mut tpdos = match both {
        Some(pdo) => vec![pdo],
        None => anew().or_else(|refusal| pair().ok_or(refusal))?,
    };
    if draft.description.torque {
        tpdos.extend(torque(Side { kinds: &EVENT, ..sends }, &tpdos));
    }
    switch_off(draft, &tpdos);
    let listed = sheet.eds.groups().iter().map(|group| group.index);
    let rpdos = listed.filter(|index| RPDOS.contains(index)).collect();
    Ok(Pdos { rpdo, rpdos, tpdos })
}

/// The torque in a TPDO of its own, as it is or mapped anew, which is sent in a period: by its inhibit time, and its
/// event timer, if it has one. `None`: the drive has no torque of CiA 402-2, no such TPDO, or it cannot be set.
fn torque(sends: Side<'_>, used: &[Pdo]) -> Option<Pdo> {
    let sheet = sends.sheet;
    let object = |index, data_type| sheet.typed(index, 0, data_type).ok().filter(|object| object.access.reads());
    object(0x6076, DataType::U32).and(object(0x6077, DataType::I16))?;
    let periodic = |pdo: Pdo| {
        let record = sends.record(pdo.number);
        let takes = |sub, value: u16| {
            sheet.takes(record, sub, value.into()).is_ok_and(|object| object.data_type == DataType::U16)
        };
        let transmission = pdo.transmission.filter(|_| takes(3, TORQUE_INHIBIT))?;
        let (inhibit, event_timer) = (Some(TORQUE_INHIBIT), takes(5, TORQUE_MS).then_some(TORQUE_MS));
        Some(Pdo { transmission: Some(Transmission { inhibit, event_timer, ..transmission }), ..pdo })
    };
    let is_free = |number: &u8| used.iter().all(|pdo| pdo.number != *number);
    let as_it_is = |number| {
        let entries = sheet.eds.pdo(sends.record(number), sheet.node)?.entries;
        (entries == [TORQUE]).then(|| sends.sent(number, entries).ok().and_then(periodic)).flatten()
    };
    let anew = |number| {
        let mappable = sends.mappable(TORQUE).is_ok() && sends.can_be_mapped(sends.record(number));
        mappable.then(|| sends.sent(number, vec![TORQUE]).ok().and_then(periodic)).flatten()
    };
    let mut free = NUMBERS.filter(is_free);
    free.clone().find_map(as_it_is).or_else(|| free.find_map(anew))
}

/// True if a mapping has each of these once.
fn carries(entries: &[u32], wanted: &[u32]) -> bool {
    wanted.iter().all(|wanted| entries.iter().filter(|entry| *entry == wanted).count() == 1)
}

impl Side<'_> {
    fn record(&self, number: u8) -> u16 {
        self.first + u16::from(number) - 1
    }

    /// The identifier of the pre-defined connection set.
    fn cob_id(&self, number: u8) -> u32 {
        let base = if self.first == RPDO { 0x100 } else { 0x80 };
        base + 0x100 * u32::from(number) + u32::from(self.sheet.node)
    }

    /// The shortest PDO with a mapping that is usable.
    fn as_it_is(&self, usable: impl Fn(&[u32]) -> bool) -> Option<Pdo> {
        let pdo = |number| {
            let entries = self.sheet.eds.pdo(self.record(number), self.sheet.node)?.entries;
            let fits = Layout::new(&entries).is_ok() && usable(&entries);
            fits.then(|| self.sent(number, entries).ok()).flatten()
        };
        NUMBERS.filter_map(pdo).min_by_key(|pdo| pdo.entries.len())
    }

    /// The first PDO whose mapping can be changed to these.
    fn anew(&self, entries: &[u32]) -> Result<Pdo, Refusal> {
        entries.iter().try_for_each(|entry| self.mappable(*entry))?;
        let refusal = Refusal::new(self.first | 0x200, 0, Reason::NoPdo);
        let mut all = NUMBERS.filter(|number| self.can_be_mapped(self.record(*number)));
        all.find_map(|number| self.sent(number, entries.to_vec()).ok()).ok_or(refusal)
    }

    fn mappable(&self, entry: u32) -> Result<(), Refusal> {
        let Mapped { index, sub, .. } = Mapped::new(entry);
        let object = self.sheet.need(index, sub)?;
        let direction = match object.access {
            Access::ReadWriteTransmit => self.first == TPDO,
            Access::ReadWriteReceive => self.first == RPDO,
            access if self.first == RPDO => access.writes(),
            access => access.reads(),
        };
        let mappable = object.mappable && direction;
        if mappable { Ok(()) } else { Err(Refusal::new(index, sub, Reason::NotMappable)) }
    }

    fn can_be_mapped(&self, record: u16) -> bool {
        let map = record | 0x200;
        let entry = |sub| self.sheet.writable(map, sub).is_ok_and(|object| object.data_type == DataType::U32);
        let count = self.sheet.takes(map, 0, 2).is_ok_and(|object| object.data_type == DataType::U8);
        count && entry(1) && entry(2) && self.sheet.typed(record, 1, DataType::U32).is_ok_and(|id| id.access.writes())
    }

    /// A PDO with its transmission: set where it can be, else as it is.
    fn sent(&self, number: u8, entries: Vec<u32>) -> Result<Pdo, Refusal> {
        let (sheet, record) = (self.sheet, self.record(number));
        let id = sheet.typed(record, 1, DataType::U32)?;
        let kind = sheet.typed(record, 2, DataType::U8)?;
        let writable = id.access.writes() && kind.access.writes();
        let taken = self.kinds.iter().find(|code| sheet.check(kind, i64::from(**code)).is_ok());
        let transmission = match (writable, taken) {
            (true, Some(code)) => Some(self.transmission(record, *code)),
            _ => {
                let is_there = sheet.stated(record, 1).is_some_and(|id| id as u32 & !(1 << 30) == self.cob_id(number));
                let stated = sheet.stated(record, 2);
                let sound = self.kinds.iter().any(|code| Some(i64::from(*code)) == stated);
                if !is_there || !sound {
                    return Err(Refusal::new(record, 2, Reason::NotWritable));
                }
                None
            }
        };
        let adjust = writable && self.can_be_mapped(record);
        Ok(Pdo { number, entries: Cow::Owned(entries), transmission, adjust })
    }

    fn transmission(&self, record: u16, kind: u8) -> Transmission {
        let inhibit = self.sheet.takes(record, 3, INHIBIT.into());
        let inhibit = inhibit.is_ok_and(|inhibit| inhibit.data_type == DataType::U16);
        let inhibit = (inhibit && self.first == TPDO && kind >= 254).then_some(INHIBIT);
        Transmission { kind, inhibit, event_timer: None }
    }
}

/// Frames that nobody reads: TPDOs that a new drive sends, or a DCF lets it send.
fn switch_off(draft: &mut Draft<'_>, used: &[Pdo]) {
    for record in TPDO..TPDO + TPDOS_MAX {
        let is_used = used.iter().any(|pdo| TPDO + u16::from(pdo.number) - 1 == record);
        let id = draft.sheet.stated(record, 1).filter(|id| *id as u32 & INVALID == 0);
        let writable = draft.sheet.typed(record, 1, DataType::U32).is_ok_and(|id| id.access.writes());
        if let Some(id) = id.filter(|_| writable && !is_used) {
            let value = Quantity::Fixed(i64::from(id as u32 | INVALID));
            draft.settings.push(Setting { index: record, sub: 1, data_type: DataType::U32, value });
        }
    }
}
