//! How even frames come on a CAN bus. The kernel's receive times are compared, so it does not matter when we get to
//! read them.

use super::histogram::Histogram;
use super::report::{Report, Row, kernel};
use crate::can::{Heard, Link, Target};
use crate::{Common, Failed};
use base::can::{Id, Notice};
use base::{Duration, Instant};
use host::clock;
use host::ports::settings::CanInterface;
use std::collections::BTreeMap;

/// Gaps of this length and more are counted together, µs: beyond the time limits of heartbeats here.
const LIMIT: usize = 300_000;
/// Maximum number of identifiers that are measured.
const SERIES_MAX: usize = 16;
/// SYNC and heartbeats (CiA 301, predefined connection set).
const SYNC: u16 = 0x080;
const HEARTBEATS: std::ops::RangeInclusive<u16> = 0x701..=0x77F;

/// Frames of one identifier.
struct Series {
    last: Option<u64>,
    gaps: Histogram,
}

/// Gaps between frames, by identifier.
pub struct Gaps {
    wanted: Vec<u16>,
    series: BTreeMap<u16, Series>,
    /// Frames beyond the maximum number of identifiers, and times that went backwards.
    untold: u64,
    stepped: u64,
}

impl Gaps {
    /// Frames with these identifiers; with none of them SYNC and heartbeats.
    pub fn new(wanted: &[u16]) -> Self {
        Self { wanted: wanted.into(), series: BTreeMap::new(), untold: 0, stepped: 0 }
    }

    /// A frame was received at this time of the kernel's wall clock, ns.
    pub fn frame(&mut self, id: u16, at: u64) {
        let usual = || id == SYNC || HEARTBEATS.contains(&id);
        if !(self.wanted.contains(&id) || self.wanted.is_empty() && usual()) {
            return;
        }
        if !self.series.contains_key(&id) && self.series.len() == SERIES_MAX {
            self.untold += 1;
            return;
        }
        let series = self.series.entry(id).or_insert_with(|| Series { last: None, gaps: Histogram::new(LIMIT) });
        match series.last.replace(at).map(|last| at.checked_sub(last)) {
            Some(Some(gap)) => series.gaps.add(gap / 1000),
            Some(None) => self.stepped += 1,
            None => {}
        }
    }

    /// Reports lost frames: no gap extends over them.
    pub fn lost(&mut self) {
        self.series.values_mut().for_each(|series| series.last = None);
    }

    /// Distances of the gaps from their median.
    pub fn rows(&self) -> Vec<Row> {
        let row = |(id, Series { gaps, .. }): (&u16, &Series)| {
            let period = gaps.quantile(1, 2);
            let mut counts = vec![("longest gap us", gaps.max())];
            counts.extend((self.untold > 0).then_some(("frames of further identifiers", self.untold)));
            counts.extend((self.stepped > 0).then_some(("steps of the clock", self.stepped)));
            Row { name: name(*id), period_us: Some(period), times: gaps.around(period), counts }
        };
        self.series.iter().filter(|(_, series)| series.gaps.count() > 0).map(row).collect()
    }
}

fn name(id: u16) -> String {
    match id {
        SYNC => "0x080 SYNC".into(),
        id if HEARTBEATS.contains(&id) => format!("{id:#05x} heartbeat {}", id - 0x700),
        id => format!("{id:#05x}"),
    }
}

/// Measures until the time is over, or until Ctrl-C.
pub fn measure(
    common: &Common,
    interface: &CanInterface,
    ids: &[u16],
    time: Option<Duration>,
) -> Result<Report, Failed> {
    let target = Target::on(common, interface)?;
    let mut link = Link::open(&target)?;
    let until = time.map_or(Instant::NEVER, |time| clock::now() + time);
    let mut gaps = Gaps::new(ids);
    loop {
        let now = clock::now();
        match link.receive(now)? {
            Heard::Frame { frame, stamp } => {
                if let (Id::Standard(id), Some(at)) = (frame.id(), stamp) {
                    gaps.frame(id, at);
                }
            }
            Heard::Notice(Notice::Lost(_)) => gaps.lost(),
            Heard::Notice(_) | Heard::Note(_) => {}
            Heard::Nothing if now >= until || link.wait(until)? => break,
            Heard::Nothing => {}
        }
        // A bus that never falls silent must not keep us.
        if now >= until {
            break;
        }
    }
    let rows = gaps.rows();
    if rows.is_empty() {
        let what = if ids.is_empty() { "SYNC or heartbeat" } else { "frame of these identifiers" };
        return Err(format!("{}: no {what} came twice", target.name).into());
    }
    let how = format!("frames on {}, by the kernel's receive times, kernel {}", target.name, kernel());
    Ok(Report { how, times: "off its period by", rows })
}
