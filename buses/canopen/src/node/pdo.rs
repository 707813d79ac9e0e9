//! The PDO engine of a node, by objects 0x1400, 0x1600, 0x1800 and 0x1A00.

use crate::{Abort, Dictionary};
use alloc::vec::Vec;
use base::can::Frame;
use base::{Duration, Instant, Queue};

const INVALID: i64 = 1 << 31;
/// Bit 30 of a TPDO's COB-ID.
const NO_REMOTE: i64 = 1 << 30;
/// Most entries of a mapping: single bits.
const ENTRIES_MAX: usize = 64;

/// Some bits of a PDO: an object's place in the dictionary, or a gap (a dummy entry).
#[derive(Clone, Copy)]
pub(super) struct Mapped {
    at: Option<usize>,
    bits: u8,
}

impl Mapped {
    const fn mask(self) -> u64 {
        u64::MAX >> (64 - self.bits)
    }
}

/// At most 64 bits in all.
pub(super) type Mapping = Vec<Mapped>;

/// Content of 0x1400 or 0x1800 and its mapping.
#[derive(Default)]
struct Record {
    index: u16,
    /// `None` while the PDO does not exist or carries nothing.
    cob_id: Option<u16>,
    kind: u8,
    mapping: Mapping,
    /// Bytes.
    len: usize,
}

impl Record {
    fn load(&mut self, dictionary: &Dictionary) {
        let map = self.index + 0x200;
        let number = |index, sub| dictionary.get(index, sub);
        self.kind = number(self.index, 2).unwrap_or(255) as u8;
        let count = number(map, 0).unwrap_or(0).clamp(0, ENTRIES_MAX as i64) as u8;
        self.mapping = compile(dictionary, map, count).unwrap_or_default();
        self.len = bits(&self.mapping).div_ceil(8);
        let cob_id = number(self.index, 1).unwrap_or(INVALID);
        self.cob_id = (cob_id & INVALID == 0 && !self.mapping.is_empty()).then_some((cob_id & 0x7FF) as u16);
    }

    /// 1 for 0x1400 or 0x1800.
    fn number(&self) -> u16 {
        (self.index & 0x1FF) + 1
    }

    fn is_event_driven(&self) -> bool {
        self.kind >= 254
    }
}

fn bits(mapping: &[Mapped]) -> usize {
    mapping.iter().map(|mapped| usize::from(mapped.bits)).sum()
}

/// One mapping entry: index, sub-index, bits.
pub(super) fn locate(dictionary: &Dictionary, map: u16, entry: u32) -> Result<Mapped, Abort> {
    let (index, sub, bits) = ((entry >> 16) as u16, (entry >> 8) as u8, entry as u8);
    if !matches!(bits, 1..=64) {
        return Err(Abort::NOT_MAPPABLE);
    }
    let received = map < 0x1800;
    if received && matches!(index, 0x0001..=0x0007) && sub == 0 {
        return Ok(Mapped { at: None, bits });
    }
    let at = dictionary.find_mappable(index, sub, bits, received)?;
    Ok(Mapped { at: Some(at), bits })
}

/// The first `count` entries of a mapping record.
pub(super) fn compile(dictionary: &Dictionary, map: u16, count: u8) -> Result<Mapping, Abort> {
    let mut mapping = Mapping::new();
    for sub in 1..=count {
        let entry = dictionary.get(map, sub).ok_or(Abort::PDO_LENGTH)?;
        mapping.push(locate(dictionary, map, entry as u32)?);
    }
    if bits(&mapping) <= 64 { Ok(mapping) } else { Err(Abort::PDO_LENGTH) }
}

#[derive(Default)]
struct Rpdo {
    record: Record,
    data: [u8; 8],
    /// Waits for SYNC.
    buffered: bool,
    /// 0x1400:5; zero: no deadline.
    deadline: Duration,
    /// Time when it is late. Monitoring starts with the first one.
    until: Option<Instant>,
    /// True if excess length has been reported since the last frame of the right length.
    told_long: bool,
}

impl Rpdo {
    fn load(&mut self, dictionary: &Dictionary) {
        self.record.load(dictionary);
        let deadline = dictionary.get(self.record.index, 5).unwrap_or(0).unsigned_abs();
        (self.deadline, self.until) = (Duration::from_millis(deadline), None);
        (self.buffered, self.told_long) = (false, false);
    }
}

#[derive(Default)]
struct Tpdo {
    record: Record,
    inhibit: Duration,
    event_timer: Duration,
    /// A mapped object changed since it was sent.
    changed: bool,
    inhibited_until: Instant,
    /// Time when the event timer sends it anyway.
    due: Option<Instant>,
    syncs: u8,
    /// The SYNC counter that is its first SYNC; 0: it has had it, or does not care.
    awaits: u8,
    /// Remote frames are answered.
    remote: bool,
    /// Type 252: taken at the last SYNC.
    sample: Option<[u8; 8]>,
}

/// Result of a frame with an RPDO's identifier.
pub(super) enum Received {
    /// [`Pdos::apply`] it now. Given the number when it is the first one longer than its mapping.
    Apply(usize, Option<u16>),
    /// Waits for SYNC; otherwise as above.
    Buffered(Option<u16>),
    /// Too short: 1 for the PDO of 0x1400.
    TooShort(u16),
}

/// All PDOs of a node.
pub(super) struct Pdos {
    rpdos: Vec<Rpdo>,
    tpdos: Vec<Tpdo>,
    /// RPDO at which [`Self::receive`] continues with the present frame.
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

    /// Reads all from the dictionary again.
    pub(super) fn reload(&mut self, dictionary: &Dictionary) {
        for rpdo in &mut self.rpdos {
            rpdo.load(dictionary);
        }
        for tpdo in &mut self.tpdos {
            let record = core::mem::take(&mut tpdo.record);
            *tpdo = Tpdo { record, ..Tpdo::default() };
            tpdo.load(dictionary);
        }
    }

    /// A communication or mapping record was written.
    pub(super) fn configure(&mut self, dictionary: &Dictionary, index: u16, now: Instant) {
        let record = index & !0x0200;
        for rpdo in self.rpdos.iter_mut().filter(|rpdo| rpdo.record.index == record) {
            rpdo.load(dictionary);
        }
        for tpdo in self.tpdos.iter_mut().filter(|tpdo| tpdo.record.index == record) {
            tpdo.load(dictionary);
            tpdo.restart(now);
        }
    }

    /// Operational: event-driven PDOs are sent once (EPOS from 2032h); deadlines start with the first RPDO.
    pub(super) fn start(&mut self, now: Instant, dictionary: &Dictionary) {
        for rpdo in &mut self.rpdos {
            rpdo.until = None;
        }
        for tpdo in &mut self.tpdos {
            tpdo.load(dictionary);
            tpdo.restart(now);
            tpdo.changed = true;
            tpdo.inhibited_until = now;
        }
    }

    /// An object changed.
    pub(super) fn touch(&mut self, dictionary: &Dictionary, index: u16, sub: u8) {
        if let Ok(at) = dictionary.find(index, sub) {
            self.touch_at(at);
        }
    }

    /// The same by its place in the dictionary.
    pub(super) fn touch_at(&mut self, at: usize) {
        for tpdo in &mut self.tpdos {
            tpdo.changed |= tpdo.record.mapping.iter().any(|mapped| mapped.at == Some(at));
        }
    }

    /// Call until `None`: more than one RPDO may listen to an identifier.
    pub(super) fn receive(&mut self, now: Instant, id: u16, data: &[u8]) -> Option<Received> {
        while let Some(rpdo) = self.rpdos.get_mut(self.cursor) {
            self.cursor += 1;
            if rpdo.record.cob_id != Some(id) {
                continue;
            }
            let len = rpdo.record.len;
            let Some(fitting) = data.get(..len) else {
                return Some(Received::TooShort(rpdo.record.number()));
            };
            rpdo.data[..len].copy_from_slice(fitting);
            rpdo.buffered = !rpdo.record.is_event_driven();
            rpdo.until = (!rpdo.deadline.is_zero()).then(|| now + rpdo.deadline);
            let long = data.len() > len;
            let news = (long && !rpdo.told_long).then(|| rpdo.record.number());
            rpdo.told_long = long;
            return Some(if rpdo.buffered { Received::Buffered(news) } else { Received::Apply(self.cursor - 1, news) });
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

    /// An RPDO that has not come in its time: 1 for the PDO of 0x1400.
    pub(super) fn take_late(&mut self, now: Instant) -> Option<u16> {
        let late = |rpdo: &&mut Rpdo| rpdo.until.is_some_and(|until| until <= now);
        let rpdo = self.rpdos.iter_mut().find(late)?;
        rpdo.until = None;
        Some(rpdo.record.number())
    }

    /// Stores what an RPDO brought; gives the places of what was stored. Values out of limits are left out.
    pub(super) fn apply(&mut self, number: usize, dictionary: &mut Dictionary) -> heapless::Vec<usize, ENTRIES_MAX> {
        let rpdo = &self.rpdos[number];
        let mut written = heapless::Vec::new();
        let mut frame = u64::from_le_bytes(rpdo.data);
        for mapped in &rpdo.record.mapping {
            let value = frame & mapped.mask();
            frame = frame.checked_shr(mapped.bits.into()).unwrap_or(0);
            if let Some(at) = mapped.at
                && dictionary.store_at(at, &value.to_le_bytes())
            {
                let _ = written.push(at); // as many as the mapping has
            }
        }
        written
    }

    /// Transmission types 0 to 240 are sent, type 252 is sampled. `counter`: 0 when the SYNC has none.
    pub(super) fn sync(&mut self, now: Instant, counter: u8, dictionary: &Dictionary, tx: &mut Queue<Frame, 64>) {
        for tpdo in &mut self.tpdos {
            if tpdo.awaits != 0 && counter != 0 {
                if tpdo.awaits != counter {
                    continue;
                }
                (tpdo.awaits, tpdo.syncs) = (0, 0);
            }
            tpdo.syncs = tpdo.syncs.saturating_add(1);
            match tpdo.record.kind {
                0 if tpdo.changed => tpdo.send(now, dictionary, tx),
                every @ 1..=240 if tpdo.syncs >= every => tpdo.send(now, dictionary, tx),
                252 => tpdo.sample = Some(tpdo.data(dictionary)),
                _ => {}
            }
        }
    }

    /// A remote frame: asynchronous PDOs are sent as they are, type 252 as it was at SYNC.
    pub(super) fn remote(&mut self, now: Instant, id: u16, dictionary: &Dictionary, tx: &mut Queue<Frame, 64>) {
        for tpdo in self.tpdos.iter_mut().filter(|tpdo| tpdo.remote && tpdo.record.cob_id == Some(id)) {
            match (tpdo.record.kind, tpdo.sample) {
                (252, Some(sample)) => {
                    tx.push(Frame::standard(id, &sample[..tpdo.record.len]));
                }
                (253.., _) => tpdo.send(now, dictionary, tx),
                _ => {}
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
        let late = self.rpdos.iter().filter_map(|rpdo| rpdo.until);
        self.tpdos.iter().filter_map(Tpdo::next).chain(late).min()
    }
}

impl Tpdo {
    fn load(&mut self, dictionary: &Dictionary) {
        self.record.load(dictionary);
        let number = |sub| dictionary.get(self.record.index, sub).unwrap_or(0).unsigned_abs();
        self.inhibit = Duration::from_micros(number(3) * 100);
        self.event_timer = Duration::from_millis(number(5));
        // Without a SYNC counter its start value does not count.
        let counts = dictionary.get(0x1019, 0).is_some_and(|overflow| overflow != 0);
        self.awaits = if counts { number(6) as u8 } else { 0 };
        self.remote = dictionary.get(self.record.index, 1).is_some_and(|cob_id| cob_id & NO_REMOTE == 0);
        self.sample = None;
    }

    fn restart(&mut self, now: Instant) {
        self.syncs = 0;
        self.due = (!self.event_timer.is_zero()).then(|| now + self.event_timer);
    }

    /// Instant of the next transmission, if event driven.
    fn next(&self) -> Option<Instant> {
        if self.record.cob_id.is_none() || !self.record.is_event_driven() {
            return None;
        }
        match (self.changed, self.due) {
            (true, _) => Some(self.inhibited_until),
            (false, due) => due.map(|due| due.max(self.inhibited_until)),
        }
    }

    fn data(&self, dictionary: &Dictionary) -> [u8; 8] {
        let (mut frame, mut offset) = (0, 0);
        for mapped in &self.record.mapping {
            let value = mapped.at.map_or(0, |at| dictionary.value_at(at)) as u64;
            frame |= (value & mapped.mask()) << offset;
            offset += u32::from(mapped.bits);
        }
        frame.to_le_bytes()
    }

    fn send(&mut self, now: Instant, dictionary: &Dictionary, tx: &mut Queue<Frame, 64>) {
        let Some(cob_id) = self.record.cob_id else {
            return;
        };
        tx.push(Frame::standard(cob_id, &self.data(dictionary)[..self.record.len]));
        self.changed = false;
        self.inhibited_until = now + self.inhibit;
        self.restart(now);
    }
}
