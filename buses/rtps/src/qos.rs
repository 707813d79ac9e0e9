//! Quality of service, as far as it decides who hears whom.

/// What happens to lost samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reliability {
    /// They stay lost: sensor data.
    BestEffort,
    /// They are sent again, while the writer has them.
    Reliable,
}

/// Quality of service of a writer or reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// What happens to lost samples.
    pub reliability: Reliability,
    /// A reader that comes later gets the last samples: maps, fixed transforms.
    pub transient_local: bool,
    /// Number of last samples that a writer keeps, at least 1.
    pub depth: u16,
}

impl Qos {
    /// Measurements: the newest counts, a lost one stays lost.
    pub const SENSOR: Self = Self { reliability: Reliability::BestEffort, transient_local: false, depth: 5 };
    /// What must arrive.
    pub const RELIABLE: Self = Self { reliability: Reliability::Reliable, transient_local: false, depth: 10 };
    /// What must arrive, at late comers too: the last one.
    pub const LATCHED: Self = Self { reliability: Reliability::Reliable, transient_local: true, depth: 1 };

    /// True if a writer with this quality satisfies a reader that asks for `asked`.
    #[must_use]
    pub fn satisfies(self, asked: Self) -> bool {
        self.reliability >= asked.reliability && self.transient_local >= asked.transient_local
    }
}
