//! Reader of record files. For any content, memory use is bounded by the length of the file, and only data with valid
//! checksums is used.

use super::wire::Decoder;
use super::{
    Answer, Call, END, EPOCH, EXITED, GAP, Header, LIMIT, MAGIC, Malformed, OLDEST, RECORD_MAX, VERSION, answer, call,
    check,
};
use base::{Epoch, Instant};
use std::fmt;

/// A file of records.
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    /// Offset of the next record.
    place: usize,
    /// Number of the next record.
    number: u32,
    version: u16,
    header: Header,
    epoch: Epoch,
    at: Instant,
    ended: bool,
}

/// Content of a file.
#[derive(Clone, Copy, Debug)]
pub enum Item<'a> {
    /// A call and its answer.
    Record(Record<'a>),
    /// The end of the file.
    End(End),
}

/// Reason for the end of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The module ended; nothing is missing.
    Exited,
    /// The file reached its maximum size; the module continued.
    Limit,
    /// Ended after a complete record: the process was killed or is still running. The last calls may be missing.
    Open,
}

/// A call and its answer, from a record with a valid CRC.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    /// Number of the record, counted from 0, which is the header.
    pub number: u32,
    /// Offset of the record in the file.
    pub place: usize,
    /// Offset between the shell's time and the wall clock.
    pub epoch: Epoch,
    /// Time of the call.
    pub at: Instant,
    call: Decoder<'a>,
}

/// Position from which a file is invalid, and the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Offset of the invalid record.
    pub place: usize,
    /// Number of the invalid record.
    pub record: u32,
    /// Time of the last valid record before it.
    pub after: Instant,
    /// Reason.
    pub why: Why,
}

/// Reason why a file is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The magic number is missing.
    NotOne,
    /// The version is not supported.
    Version(u16),
    /// The version can be read but not replayed: its shells published less.
    Outdated(u16),
    /// The file ends within a record, or before the first one.
    Cut,
    /// A CRC is wrong.
    Damaged,
    /// This record follows: those in between are missing.
    Missing(u32),
    /// Number of calls that could not be written in time.
    Gap(u32),
    /// A record is complete but has invalid content.
    Malformed(Malformed),
    /// Data follows the end record.
    More,
}

impl From<Malformed> for Why {
    fn from(what: Malformed) -> Self {
        Self::Malformed(what)
    }
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotOne => f.write_str("not a file of recorded inputs"),
            Self::Version(version) => {
                write!(f, "of version {version} of the format; this program reads {OLDEST} to {VERSION}")
            }
            Self::Outdated(version) => write!(
                f,
                "of version {version} of the format, when modules did not yet publish CM_DATA_FAULTS and CM_EVENT_TEXT: this \
                 program replays {VERSION}; use the one that recorded it"
            ),
            Self::Cut => f.write_str("cut off"),
            Self::Damaged => f.write_str("damaged: the check is wrong"),
            Self::Missing(next) => write!(f, "a gap: record {next} follows"),
            Self::Gap(lost) => write!(f, "a gap: {lost} calls could not be written in time"),
            Self::Malformed(Malformed(what)) => write!(f, "malformed: expected {what}"),
            Self::More => f.write_str("there is more after the end"),
        }
    }
}

impl fmt::Display for Refusal {
    /// Reason and position in one line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.why {
            Why::NotOne | Why::Version(_) | Why::Outdated(_) => write!(f, "{}", self.why),
            why => write!(f, "{why} at byte {}, record {}", self.place, self.record),
        }
    }
}

impl<'a> Reader<'a> {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// Not a record file, of another version, or with an incomplete header.
    pub fn open(bytes: &'a [u8]) -> Result<Self, Refusal> {
        let refusal = |why| Refusal { place: 0, record: 0, after: Instant::ZERO, why };
        let rest = bytes.strip_prefix(&MAGIC).ok_or_else(|| {
            // A file truncated within its first bytes is still recognized.
            refusal(if MAGIC.starts_with(bytes) { Why::Cut } else { Why::NotOne })
        })?;
        let (version, rest) = rest.split_first_chunk().ok_or_else(|| refusal(Why::Cut))?;
        let version = u16::from_le_bytes(*version);
        if !(OLDEST..=VERSION).contains(&version) {
            return Err(refusal(Why::Version(version)));
        }
        let mut reader = Self {
            bytes,
            place: bytes.len() - rest.len(),
            number: 0,
            version,
            header: Header {
                program: String::new(),
                module: String::new(),
                wanted: module::State::Unknown,
                texts: Vec::new(),
            },
            epoch: Epoch::default(),
            at: Instant::ZERO,
            ended: false,
        };
        let (payload, next) = reader.payload()?;
        reader.header = Header::take(payload).map_err(|what| reader.refusal(what.into()))?;
        reader.go_on(next);
        Ok(reader)
    }

    /// Header of the file.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Returns the file if its answers can be compared with those of a shell of today.
    ///
    /// # Errors
    /// Its version is not [`VERSION`].
    pub fn comparable(self) -> Result<Self, Refusal> {
        match self.version {
            VERSION => Ok(self),
            other => Err(Refusal { place: 0, record: 0, after: Instant::ZERO, why: Why::Outdated(other) }),
        }
    }

    /// Reads the next record; `None` after the end.
    ///
    /// # Errors
    /// Data is missing or invalid here; nothing can be read from here on.
    pub fn read(&mut self) -> Result<Option<Item<'a>>, Refusal> {
        if self.ended {
            return match self.place == self.bytes.len() {
                true => Ok(None),
                false => Err(self.refusal(Why::More)),
            };
        }
        while self.place < self.bytes.len() {
            let (payload, next) = self.payload()?;
            if let Some(item) = self.item(payload).map_err(|why| self.refusal(why))? {
                self.go_on(next);
                return Ok(Some(item));
            }
            self.go_on(next);
        }
        self.ended = true;
        Ok(Some(Item::End(End::Open)))
    }

    /// Parses a record; `None` if it concerns the reader only.
    fn item(&mut self, payload: Decoder<'a>) -> Result<Option<Item<'a>>, Why> {
        let mut take = payload;
        let at = call::before(self.at, take.signed()?.wrapping_neg());
        let call = take;
        match take.u8()? {
            EPOCH => {
                (self.at, self.epoch) = (at, Epoch { offset_us: take.signed()? });
                Ok(None)
            }
            GAP => Err(Why::Gap(take.small()?)),
            END => {
                let end = match take.u8()? {
                    EXITED => End::Exited,
                    LIMIT => End::Limit,
                    _ => return Err(Malformed("a known kind of end").into()),
                };
                self.ended = true;
                Ok(Some(Item::End(end)))
            }
            _ => {
                self.at = at;
                Ok(Some(Item::Record(Record { number: self.number, place: self.place, epoch: self.epoch, at, call })))
            }
        }
    }

    fn refusal(&self, why: Why) -> Refusal {
        Refusal { place: self.place, record: self.number, after: self.at, why }
    }

    fn go_on(&mut self, place: usize) {
        self.place = place;
        self.number = self.number.wrapping_add(1);
    }

    /// Payload of the next record with a valid CRC and the expected number, and its end offset.
    fn payload(&self) -> Result<(Decoder<'a>, usize), Refusal> {
        let mut take = Decoder(&self.bytes[self.place..]);
        let cut = |_| self.refusal(Why::Cut);
        let len = match take.small::<usize>() {
            Ok(len) if len <= RECORD_MAX => len,
            // Truncated within its length.
            Err(_) if take.0.is_empty() => return Err(self.refusal(Why::Cut)),
            _ => return Err(self.refusal(Why::Damaged)),
        };
        let mut word = || take.slice(4).map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
        let (number, crc) = (word().map_err(cut)?, word().map_err(cut)?);
        let payload = take.slice(len).map_err(cut)?;
        match () {
            () if check(number, payload) != crc => Err(self.refusal(Why::Damaged)),
            () if number != self.number => Err(self.refusal(Why::Missing(number))),
            () => Ok((Decoder(payload), self.bytes.len() - take.0.len())),
        }
    }
}

impl<'a> Record<'a> {
    /// Passes the call to `f`; returns its result, and the encoded answer.
    ///
    /// # Errors
    /// The record contains what no recorder writes.
    pub fn call<T>(&self, f: impl FnOnce(Call<'_>) -> T) -> Result<(T, &'a [u8]), Refusal> {
        let mut take = self.call;
        let said = call::take(&mut take, self.at, f).map_err(|what| self.refuse(what))?;
        Ok((said, take.0))
    }

    /// Parses the answer.
    ///
    /// # Errors
    /// The record contains what no recorder writes.
    pub fn answer(&self) -> Result<Answer, Refusal> {
        let ((), rest) = self.call(|_| ())?;
        answer::take(Decoder(rest), self.at).map_err(|what| self.refuse(what))
    }

    fn refuse(&self, what: Malformed) -> Refusal {
        Refusal { place: self.place, record: self.number, after: self.at, why: what.into() }
    }
}
