//! Reads a file of records; whatever it holds, no more memory is taken than it has bytes, and nothing is believed that
//! its checks do not confirm.

use super::wire::Take;
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
    /// Where the next record begins.
    place: usize,
    /// Its number.
    number: u32,
    version: u16,
    header: Header,
    epoch: Epoch,
    at: Instant,
    ended: bool,
}

/// What stands in it.
#[derive(Clone, Copy, Debug)]
pub enum Item<'a> {
    /// A call and its answer.
    Record(Record<'a>),
    /// The end.
    End(End),
}

/// How a file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The module ended; nothing is missing.
    Exited,
    /// The file had reached its largest size; the module went on.
    Limit,
    /// After a whole record: the process was killed, or runs yet. What it was told in its last moments may be missing.
    Open,
}

/// A call and its answer, in a record whose check was right.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    /// Counted from 0, which is the header.
    pub number: u32,
    /// Where it begins in the file.
    pub place: usize,
    /// How the shell's time stands against the wall clock.
    pub epoch: Epoch,
    /// When the call came.
    pub at: Instant,
    call: Take<'a>,
}

/// Why a file is not to be trusted, and from where on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The byte at which that begins.
    pub place: usize,
    /// The number of the record there.
    pub record: u32,
    /// The moment of the last record before it.
    pub after: Instant,
    /// What is wrong.
    pub why: Why,
}

/// What is wrong with a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// It does not begin as one.
    NotOne,
    /// It is of this version, which cannot be read.
    Version(u16),
    /// It is of this version, which can be read but not replayed: shells of that version published less.
    Outdated(u16),
    /// It ends within a record, or before the first one.
    Cut,
    /// A check is wrong.
    Damaged,
    /// This record follows: those between are missing.
    Missing(u32),
    /// So many calls found no room when they were to be written.
    Gap(u32),
    /// A record is whole and holds what cannot be.
    Malformed(Malformed),
    /// There is more after the end.
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
    /// One line: what is wrong, and where.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.why {
            Why::NotOne | Why::Version(_) | Why::Outdated(_) => write!(f, "{}", self.why),
            why => write!(f, "{why} at byte {}, record {}", self.place, self.record),
        }
    }
}

impl<'a> Reader<'a> {
    /// Reads the beginning of a file.
    ///
    /// # Errors
    /// It is none, of another version, or its header is not whole.
    pub fn open(bytes: &'a [u8]) -> Result<Self, Refusal> {
        let refusal = |why| Refusal { place: 0, record: 0, after: Instant::ZERO, why };
        let rest = bytes.strip_prefix(&MAGIC).ok_or_else(|| {
            // A file that was cut off within its first bytes is one yet.
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

    /// Whose file it is.
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

    /// The next record; none after the end.
    ///
    /// # Errors
    /// Something is missing or wrong here. From here on nothing can be read.
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

    /// What a record is; none when it is for the reader alone.
    fn item(&mut self, payload: Take<'a>) -> Result<Option<Item<'a>>, Why> {
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

    /// The next record's payload, and where it ends; its check is right, and its number follows.
    fn payload(&self) -> Result<(Take<'a>, usize), Refusal> {
        let mut take = Take(&self.bytes[self.place..]);
        let cut = |_| self.refusal(Why::Cut);
        let len = match take.small::<usize>() {
            Ok(len) if len <= RECORD_MAX => len,
            // Cut off within its length.
            Err(_) if take.0.is_empty() => return Err(self.refusal(Why::Cut)),
            _ => return Err(self.refusal(Why::Damaged)),
        };
        let mut word = || take.slice(4).map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]));
        let (number, crc) = (word().map_err(cut)?, word().map_err(cut)?);
        let payload = take.slice(len).map_err(cut)?;
        match () {
            () if check(number, payload) != crc => Err(self.refusal(Why::Damaged)),
            () if number != self.number => Err(self.refusal(Why::Missing(number))),
            () => Ok((Take(payload), self.bytes.len() - take.0.len())),
        }
    }
}

impl<'a> Record<'a> {
    /// Shows the call to `f`; tells what that said, and the answer as it was recorded.
    ///
    /// # Errors
    /// The record holds what no recorder writes.
    pub fn call<T>(&self, f: impl FnOnce(Call<'_>) -> T) -> Result<(T, &'a [u8]), Refusal> {
        let mut take = self.call;
        let said = call::take(&mut take, self.at, f).map_err(|what| self.refuse(what))?;
        Ok((said, take.0))
    }

    /// The answer.
    ///
    /// # Errors
    /// The record holds what no recorder writes.
    pub fn answer(&self) -> Result<Answer, Refusal> {
        let ((), rest) = self.call(|_| ())?;
        answer::take(Take(rest), self.at).map_err(|what| self.refuse(what))
    }

    fn refuse(&self, what: Malformed) -> Refusal {
        Refusal { place: self.place, record: self.number, after: self.at, why: what.into() }
    }
}
