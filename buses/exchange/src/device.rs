//! The other end: a device that answers the requests of its table, byte by byte. For the simulator and for tests.

use crate::frame::{Answer, Protocol};
use crate::octets::Octets;
use crate::value::{DIGITS_MAX, Place};
use crate::{Bytes, LEN_MAX};
use base::{Duration, Instant, Queue};
use heapless::Vec;

/// Requests of one device at most.
pub const REQUESTS_MAX: usize = 64;
/// Values in one request at most.
pub const VALUES_MAX: usize = 16;
/// From the request's last byte to the answer's first.
const DELAY: Duration = Duration::from_millis(2);

/// A request that a device answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// Its data; where `outputs` are, any values.
    pub request: Octets,
    /// Values in it.
    pub outputs: Vec<Place, VALUES_MAX>,
    /// The answer to it.
    pub answer: Answer,
    /// Data of an answer with values: [`answer_data`].
    pub data: Bytes,
}

/// Data of an answer with these values; one that has no number is left out.
#[must_use]
pub fn answer_data(protocol: &Protocol, answer: &Answer, values: &[(Place, f64)]) -> Bytes {
    let Answer::Data { length, prefix, suffix } = answer else { return Bytes::new() };
    let filler = if values.iter().all(|(place, _)| place.kind.is_text()) { b' ' } else { 0 };
    let mut data = Bytes::new();
    put(&mut data, 0, prefix.as_slice(), filler);
    let mut order: Vec<&(Place, f64), VALUES_MAX> = values.iter().take(VALUES_MAX).collect();
    order.sort_unstable_by_key(|(place, _)| (!place.after.is_empty(), place.at));
    for (place, value) in order {
        // A mark that the prefix has already is not repeated.
        let marked = data.windows(place.after.len().max(1)).position(|window| window == place.after.as_slice());
        let behind = match (place.after.is_empty(), marked) {
            (true, _) => 0,
            (false, Some(found)) => found + place.after.len(),
            (false, None) => {
                put(&mut data, usize::MAX, &place.after, filler);
                data.len()
            }
        };
        let at = behind + place.at;
        if place.kind.is_text() {
            let text = place.text(*value).unwrap_or_default();
            put(&mut data, at, text.as_bytes(), filler);
        } else {
            let end = (at + place.kind.size()).min(LEN_MAX);
            let _ = data.resize(data.len().max(end), filler);
            let _ = Place { at, ..place.clone() }.write(*value, &mut data);
        }
    }
    match length.and_then(|length| protocol.data_len(length)) {
        Some(len) => {
            let _ = data.resize(len, filler);
            put(&mut data, len.saturating_sub(suffix.len()), suffix.as_slice(), filler);
        }
        None => put(&mut data, usize::MAX, suffix.as_slice(), filler),
    }
    data
}

/// Writes bytes at a place, behind all of them at the most; what has no room is left out.
fn put(data: &mut Bytes, at: usize, bytes: &[u8], filler: u8) {
    let at = if at == usize::MAX { data.len() } else { at };
    let end = (at + bytes.len()).min(LEN_MAX);
    let _ = data.resize(data.len().max(end), filler);
    data.iter_mut().skip(at).zip(bytes).for_each(|(place, byte)| *place = *byte);
}

/// A device.
#[derive(Debug)]
pub struct Device {
    protocol: Protocol,
    known: Vec<Known, REQUESTS_MAX>,
    rx: Bytes,
    answers: Queue<(Instant, Bytes), 4>,
    /// From the request's last byte to the answer's first.
    pub delay: Duration,
}

impl Device {
    /// A device that knows no request.
    #[must_use]
    pub fn new(protocol: Protocol) -> Self {
        Self { protocol, known: Vec::new(), rx: Bytes::new(), answers: Queue::new(), delay: DELAY }
    }

    /// Adds a request; false if there is no room for another one.
    pub fn add(&mut self, known: Known) -> bool {
        self.known.push(known).is_ok()
    }

    /// The line is new: what was received and not answered is forgotten.
    pub fn reset(&mut self) {
        self.rx.clear();
        self.answers.clear();
    }

    /// Takes bytes from the line.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        for byte in bytes {
            if self.rx.push(*byte).is_err() {
                self.rx = self.rx.iter().skip(LEN_MAX / 2).chain([byte]).copied().collect();
            }
            let found = self.known.iter().find_map(|known| Some((known, known.frame(&self.protocol, &self.rx)?)));
            let Some((known, request)) = found else { continue };
            let answer = match &known.answer {
                Answer::Echo => Bytes::from_slice(request).ok(),
                Answer::Exact(data) => self.protocol.answer(data.as_slice()),
                Answer::Data { .. } => self.protocol.answer(&known.data),
            };
            self.rx.clear();
            answer.into_iter().for_each(|answer| _ = self.answers.push((now + self.delay, answer)));
        }
    }

    /// Next bytes for the line.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        self.answers.front().filter(|(due, _)| *due <= now)?;
        self.answers.pop().map(|(_, bytes)| bytes)
    }

    /// Instant of the next [`Self::poll_tx`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.answers.front().map(|(due, _)| *due)
    }
}

impl Known {
    /// The request at the end of what was received.
    fn frame<'a>(&self, protocol: &Protocol, rx: &'a [u8]) -> Option<&'a [u8]> {
        let around = protocol.check.len() + protocol.request_end.len();
        let inserted = self.outputs.iter().any(|place| place.span().is_none());
        let extra = if inserted { 1..=DIGITS_MAX } else { 0..=0 };
        extra.into_iter().find_map(|extra| {
            let start = rx.len().checked_sub(self.request.len() + extra + around)?;
            let frame = rx.get(start..)?;
            let checked = frame.strip_suffix(protocol.request_end.as_slice())?;
            let (data, check) = checked.split_at(checked.len() - protocol.check.len());
            (protocol.check.holds(data, check) && self.matches(data, extra)).then_some(frame)
        })
    }

    /// True if these are the data of the request, with any values in it.
    fn matches(&self, data: &[u8], inserted: usize) -> bool {
        let mut plain: Bytes = self.request.as_slice().iter().copied().collect();
        for place in &self.outputs {
            let Some(value) = place.value(data) else { return false };
            if !place.write(value, &mut plain) {
                return false;
            }
        }
        if inserted == 0 {
            return plain == data;
        }
        // Zeros before an inserted number are no difference.
        let at = self.outputs.iter().find(|place| place.span().is_none()).map_or(0, |place| place.at);
        let template = self.request.as_slice();
        at <= template.len() && data.starts_with(&template[..at]) && data.ends_with(&template[at..])
    }
}
