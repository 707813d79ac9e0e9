//! The PDO engine of a node: what 0x1400, 0x1600, 0x1800 and 0x1A00 say, done.

use crate::{Abort, Dictionary};
use alloc::vec::Vec;
use base::can::Frame;
use base::{Duration, Instant, Queue};

const INVALID: i64 = 1 << 31;

/// Whole bytes of a PDO: an object's place in the dictionary, or a gap (a dummy entry).
#[derive(Clone, Copy)]
pub(super) struct Mapped {
    at: Option<usize>,
    len: u8,
}

pub(super) type Mapping = heapless::Vec<Mapped, 8>;

/// What 0x1400 or 0x1800 and its mapping say.
#[derive(Default)]
struct Record {
    index: u16,
    /// `None` while the PDO does not exist or carries nothing.
    cob_id: Option<u16>,
    kind: u8,
    mapping: Mapping,
}

impl Record {
    fn load(&mut self, pdos: &Lookup, dictionary: &Dictionary) {
        let map = self.index + 0x200;
        let number = |index, sub| dictionary.get(index, sub);
        self.kind = number(self.index, 2).unwrap_or(255) as u8;
        let count = number(map, 0).unwrap_or(0).clamp(0, 8) as u8;
        self.mapping = pdos.compile(dictionary, map, count).unwrap_or_default();
        let cob_id = number(self.index, 1).unwrap_or(INVALID);
        self.cob_id = (cob_id & INVALID == 0 && !self.mapping.is_empty()).then_some((cob_id & 0x7FF) as u16);
    }

    fn len(&self) -> usize {
        self.mapping.iter().map(|mapped| usize::from(mapped.len)).sum()
    }

    fn is_event_driven(&self) -> bool {
        self.kind >= 254
    }
}

#[derive(Default)]
struct Rpdo {
    record: Record,
    data: [u8; 8],
    /// Waits for SYNC.
    buffered: bool,
}

#[derive(Default)]
struct Tpdo {
    record: Record,
    inhibit: Duration,
    event_timer: Duration,
    /// A mapped object changed since it was sent.
    changed: bool,
    inhibited_until: Instant,
    /// When the event timer sends it anyway.
    due: Option<Instant>,
    syncs: u8,
}

/// What became of a frame with an RPDO's identifier.
pub(super) enum Received {
    /// [`Pdos::apply`] it now.
    Apply(usize),
    /// It waits for SYNC.
    Buffered,
    /// Too short: 1 for the PDO of 0x1400.
    TooShort(u16),
}

/// Resolves mapping entries.
struct Lookup;

impl Lookup {
    /// One mapping entry: index, sub-index, bits.
    fn locate(&self, dictionary: &Dictionary, map: u16, entry: u32) -> Result<Mapped, Abort> {
        let (index, sub, bits) = ((entry >> 16) as u16, (entry >> 8) as u8, entry as u8);
        let len = bits / 8;
        if bits % 8 != 0 || len == 0 || len > 8 {
            return Err(Abort::NOT_MAPPABLE);
        }
        let received = map < 0x1800;
        if received && matches!(index, 0x0001..=0x0007) && sub == 0 {
            return Ok(Mapped { at: None, len });
        }
        let at = dictionary.find_mappable(index, sub, usize::from(len), received)?;
        Ok(Mapped { at: Some(at), len })
    }

    /// The first `count` entries of a mapping record.
    fn compile(&self, dictionary: &Dictionary, map: u16, count: u8) -> Result<Mapping, Abort> {
        let mut mapping = Mapping::new();
        for sub in 1..=count {
            let entry = dictionary.get(map, sub).ok_or(Abort::PDO_LENGTH)?;
            let mapped = self.locate(dictionary, map, entry as u32)?;
            mapping.push(mapped).map_err(|_| Abort::PDO_LENGTH)?;
        }
        let len: usize = mapping.iter().map(|mapped| usize::from(mapped.len)).sum();
        if len <= 8 { Ok(mapping) } else { Err(Abort::PDO_LENGTH) }
    }
}

/// All PDOs of a node.
pub(super) struct Pdos {
    rpdos: Vec<Rpdo>,
    tpdos: Vec<Tpdo>,
    /// Where [`Self::receive`] goes on with the frame at hand.
    cursor: usize,
}

impl Pdos {
    pub(super) fn new(dictionary: &Dictionary) -> Self {
        let record = |index| Record { index, ..Record::default() };
        let rpdos = dictionary.indices(0x1400..=0x15FF).map(|index| Rpdo { record: record(index), ..Rpdo::default() });
        let tpdos = dictionary.indices(0x1800..=0x19FF).map(|index| Tpdo { record: record(index), ..Tpdo::default() });
        let mut pdos = Self { rpdos: rpdos.collect(), tpdos: tpdos.collect(), cursor: 0 };
        pdos.reload(dictionary);
        pdos
    }

    pub(super) fn locate(&self, dictionary: &Dictionary, map: u16, entry: u32) -> Result<Mapped, Abort> {
        Lookup.locate(dictionary, map, entry)
    }

    pub(super) fn compile(&self, dictionary: &Dictionary, map: u16, count: u8) -> Result<Mapping, Abort> {
        Lookup.compile(dictionary, map, count)
    }

    /// Everything anew from the dictionary.
    pub(super) fn reload(&mut self, dictionary: &Dictionary) {
        for rpdo in &mut self.rpdos {
            rpdo.record.load(&Lookup, dictionary);
            rpdo.buffered = false;
        }
        for tpdo in &mut self.tpdos {
            tpdo.load(dictionary);
            *tpdo =
                Tpdo { inhibited_until: Instant::ZERO, due: None, changed: false, syncs: 0, ..core::mem::take(tpdo) };
        }
    }

    /// A communication or mapping record was written.
    pub(super) fn configure(&mut self, dictionary: &Dictionary, index: u16, now: Instant) {
        let record = index & !0x0200;
        for rpdo in self.rpdos.iter_mut().filter(|rpdo| rpdo.record.index == record) {
            rpdo.record.load(&Lookup, dictionary);
            rpdo.buffered = false;
        }
        for tpdo in self.tpdos.iter_mut().filter(|tpdo| tpdo.record.index == record) {
            tpdo.load(dictionary);
            tpdo.restart(now);
        }
    }

    /// Operational: event-driven PDOs are sent once (EPOS from 2032h).
    pub(super) fn start(&mut self, now: Instant) {
        for tpdo in &mut self.tpdos {
            tpdo.restart(now);
            tpdo.changed = true;
            tpdo.inhibited_until = now;
        }
    }

    /// An object changed.
    pub(super) fn touch(&mut self, dictionary: &Dictionary, index: u16, sub: u8) {
        let Ok(at) = dictionary.find(index, sub) else {
            return;
        };
        for tpdo in &mut self.tpdos {
            tpdo.changed |= tpdo.record.mapping.iter().any(|mapped| mapped.at == Some(at));
        }
    }

    /// Call until `None`: more than one RPDO may listen to an identifier.
    pub(super) fn receive(&mut self, id: u16, data: &[u8]) -> Option<Received> {
        while let Some(rpdo) = self.rpdos.get_mut(self.cursor) {
            self.cursor += 1;
            if rpdo.record.cob_id != Some(id) {
                continue;
            }
            let len = rpdo.record.len();
            let Some(data) = data.get(..len) else {
                return Some(Received::TooShort(rpdo.record.index - 0x1400 + 1));
            };
            rpdo.data[..len].copy_from_slice(data);
            rpdo.buffered = !rpdo.record.is_event_driven();
            return Some(if rpdo.buffered { Received::Buffered } else { Received::Apply(self.cursor - 1) });
        }
        self.cursor = 0;
        None
    }

    /// An RPDO that waited for this SYNC.
    pub(super) fn take_buffered(&mut self) -> Option<usize> {
        let at = self.rpdos.iter().position(|rpdo| rpdo.buffered)?;
        self.rpdos[at].buffered = false;
        Some(at)
    }

    /// Stores what an RPDO brought; gives the places of what was stored. Values out of limits are left out.
    pub(super) fn apply(&mut self, number: usize, dictionary: &mut Dictionary) -> heapless::Vec<usize, 8> {
        let rpdo = &self.rpdos[number];
        let mut written = heapless::Vec::new();
        let mut data = &rpdo.data[..];
        for mapped in &rpdo.record.mapping {
            let (part, rest) = data.split_at(usize::from(mapped.len));
            data = rest;
            if let Some(at) = mapped.at
                && dictionary.store_at(at, part)
            {
                let _ = written.push(at); // as many as the mapping has
            }
        }
        written
    }

    /// Transmission types 0 to 240.
    pub(super) fn sync(&mut self, now: Instant, dictionary: &Dictionary, tx: &mut Queue<Frame, 64>) {
        for tpdo in &mut self.tpdos {
            tpdo.syncs = tpdo.syncs.saturating_add(1);
            let due = match tpdo.record.kind {
                0 => tpdo.changed,
                every @ 1..=240 => tpdo.syncs >= every,
                _ => false,
            };
            if due {
                tpdo.send(now, dictionary, tx);
            }
        }
    }

    /// Transmission types 254 and 255.
    pub(super) fn send_due(&mut self, now: Instant, dictionary: &Dictionary, tx: &mut Queue<Frame, 64>) {
        for tpdo in self.tpdos.iter_mut().filter(|tpdo| tpdo.next().is_some_and(|next| next <= now)) {
            tpdo.send(now, dictionary, tx);
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.tpdos.iter().filter_map(Tpdo::next).min()
    }
}

impl Tpdo {
    fn load(&mut self, dictionary: &Dictionary) {
        self.record.load(&Lookup, dictionary);
        let number = |sub| dictionary.get(self.record.index, sub).unwrap_or(0).unsigned_abs();
        self.inhibit = Duration::from_micros(number(3) * 100);
        self.event_timer = Duration::from_millis(number(5));
    }

    fn restart(&mut self, now: Instant) {
        self.syncs = 0;
        self.due = (!self.event_timer.is_zero()).then(|| now + self.event_timer);
    }

    /// When it is to be sent, if it is event driven.
    fn next(&self) -> Option<Instant> {
        if self.record.cob_id.is_none() || !self.record.is_event_driven() {
            return None;
        }
        match (self.changed, self.due) {
            (true, _) => Some(self.inhibited_until),
            (false, due) => due.map(|due| due.max(self.inhibited_until)),
        }
    }

    fn send(&mut self, now: Instant, dictionary: &Dictionary, tx: &mut Queue<Frame, 64>) {
        let Some(cob_id) = self.record.cob_id else {
            return;
        };
        let mut data = heapless::Vec::<u8, 8>::new();
        for mapped in &self.record.mapping {
            let value = mapped.at.map_or(0, |at| dictionary.value_at(at)).to_le_bytes();
            let _ = data.extend_from_slice(&value[..usize::from(mapped.len)]); // compiled to fit
        }
        tx.push(Frame::standard(cob_id, &data));
        self.changed = false;
        self.inhibited_until = now + self.inhibit;
        self.restart(now);
    }
}
