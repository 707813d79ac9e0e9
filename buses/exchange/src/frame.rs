//! Frames: data, then the check, then the end.

use crate::check::Check;
use crate::octets::Octets;
use crate::{Bytes, LEN_MAX};

/// What all frames of a line have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Protocol {
    /// Check of requests and answers.
    pub check: Check,
    /// Last bytes of a request.
    pub request_end: Octets,
    /// Last bytes of an answer.
    pub answer_end: Octets,
}

/// What is answered to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The request itself.
    Echo,
    /// These data.
    Exact(Octets),
    /// Data with values.
    Data {
        /// Bytes of the whole answer. Absent: it ends with [`Protocol::answer_end`].
        length: Option<usize>,
        /// Its first bytes.
        prefix: Octets,
        /// The last bytes of its data.
        suffix: Octets,
    },
}

/// What is received if the answer to one request is intact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expected {
    shape: Shape,
    check: Check,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Shape {
    /// A frame of which all is known, and where its data end.
    Frame(Bytes, usize),
    Data {
        length: Option<usize>,
        prefix: Octets,
        suffix: Octets,
        end: Octets,
    },
}

/// What received bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The beginning of an answer.
    More,
    /// No answer, and none can come of it.
    Wrong,
    /// An answer with this number of bytes of data.
    Answer(usize),
}

impl Protocol {
    /// A frame with these data; `None` if it is too long.
    fn frame(&self, data: &[u8], end: &Octets) -> Option<Bytes> {
        let mut frame = Bytes::from_slice(data).ok()?;
        (self.check.append(&mut frame) && frame.extend_from_slice(end.as_slice()).is_ok()).then_some(frame)
    }

    /// A request with these data; `None` if it is too long.
    #[must_use]
    pub fn request(&self, data: &[u8]) -> Option<Bytes> {
        self.frame(data, &self.request_end)
    }

    /// An answer with these data; `None` if it is too long.
    #[must_use]
    pub fn answer(&self, data: &[u8]) -> Option<Bytes> {
        self.frame(data, &self.answer_end)
    }

    /// Bytes of an answer of this length before its check.
    #[must_use]
    pub fn data_len(&self, length: usize) -> Option<usize> {
        length.checked_sub(self.check.len() + self.answer_end.len())
    }

    /// What is expected for a request; `None` if the answer would have neither a length nor an end, or is too long.
    #[must_use]
    pub fn expect(&self, answer: &Answer, request: &Bytes) -> Option<Expected> {
        let shape = match answer {
            Answer::Echo => {
                Shape::Frame(request.clone(), request.len().saturating_sub(self.check.len() + self.request_end.len()))
            }
            Answer::Exact(data) => Shape::Frame(self.answer(data.as_slice())?, data.len()),
            Answer::Data { length, prefix, suffix } => {
                let fixed = prefix.len() + suffix.len();
                let is_possible = match length {
                    Some(length) => *length <= LEN_MAX && self.data_len(*length).is_some_and(|len| len >= fixed),
                    None => !self.answer_end.is_empty() && !self.check.is_binary(),
                };
                let (prefix, suffix, end) = (prefix.clone(), suffix.clone(), self.answer_end.clone());
                is_possible.then_some(Shape::Data { length: *length, prefix, suffix, end })?
            }
        };
        Some(Expected { shape, check: self.check })
    }
}

impl Expected {
    /// Bytes of the answer; `None` if that is not known before.
    #[must_use]
    pub(crate) fn length(&self) -> Option<usize> {
        match &self.shape {
            Shape::Frame(frame, _) => Some(frame.len()),
            Shape::Data { length, .. } => *length,
        }
    }

    /// First bytes of the answer that are known before.
    fn head(&self) -> &[u8] {
        match &self.shape {
            Shape::Frame(frame, _) => frame,
            Shape::Data { prefix, .. } => prefix.as_slice(),
        }
    }

    /// Number of bytes before the first place where an answer may begin.
    pub fn noise(&self, rx: &[u8]) -> usize {
        let begins = |n: &usize| rx[*n..].iter().zip(self.head()).all(|(byte, known)| byte == known);
        (0..rx.len()).find(begins).unwrap_or(rx.len())
    }

    /// What bytes without noise before them are.
    pub(crate) fn judge(&self, rx: &[u8]) -> Verdict {
        let (length, prefix, suffix, end) = match &self.shape {
            Shape::Frame(frame, data) if rx == frame.as_slice() => return Verdict::Answer(*data),
            Shape::Frame(frame, _) if rx.len() >= frame.len() => return Verdict::Wrong,
            Shape::Frame(..) => return Verdict::More,
            Shape::Data { length, prefix, suffix, end } => (length, prefix, suffix, end),
        };
        let is_complete = match length {
            Some(length) => rx.len() >= *length,
            None => rx.windows(end.len().max(1)).any(|window| window == end.as_slice()),
        };
        if !is_complete {
            return if rx.len() < LEN_MAX { Verdict::More } else { Verdict::Wrong };
        }
        if length.is_some_and(|length| rx.len() > length) {
            return Verdict::Wrong;
        }
        self.data_of(rx, prefix, suffix, end).map_or(Verdict::Wrong, Verdict::Answer)
    }

    /// Bytes of data of a complete frame; `None` if it is damaged.
    fn data_of(&self, rx: &[u8], prefix: &Octets, suffix: &Octets, end: &Octets) -> Option<usize> {
        let checked = rx.strip_suffix(end.as_slice())?;
        // An end in the middle: more than one answer.
        if self.length().is_none() && checked.windows(end.len().max(1)).any(|window| window == end.as_slice()) {
            return None;
        }
        let (data, check) = checked.split_at_checked(checked.len().checked_sub(self.check.len())?)?;
        let between = data.strip_prefix(prefix.as_slice())?;
        (between.ends_with(suffix.as_slice()) && self.check.holds(data, check)).then_some(data.len())
    }
}
