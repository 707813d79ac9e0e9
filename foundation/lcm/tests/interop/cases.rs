//! The messages that go both ways as bytes.

/// Messages of one kind, a row of the table.
pub struct Case {
    /// The row.
    pub name: String,
    /// What follows `TO_` or `FROM_` in the channel's name, and the size of the payload.
    pub messages: Vec<(String, Size)>,
}

/// How large a payload is.
#[derive(Clone, Copy)]
pub enum Size {
    /// So many bytes.
    Payload(usize),
    /// As many as make so many with the channel's name and its NUL.
    Whole(usize),
}

pub fn cases() -> Vec<Case> {
    use Size::{Payload, Whole};
    let one = |name: &str, suffix: &str, size| Case { name: name.into(), messages: vec![(suffix.into(), size)] };
    let series = (0..50).map(|n| (format!("SERIES_{}", n % 7), Payload(60_000 * n / 49)));
    vec![
        one("no payload", "NOTHING", Payload(0)),
        one("channel's name of 63 bytes", "", Payload(3)),
        Case { name: "50 sizes to 60 000 bytes, all byte values".into(), messages: series.collect() },
        one("65 499 bytes with name and NUL: one datagram", "EDGE", Whole(65_499)),
        one("65 500 bytes: two fragments", "EDGE", Whole(65_500)),
        one("1 MiB: 17 fragments", "MIB", Payload(1 << 20)),
        one("10 MiB: 161 fragments", "TEN_MIB", Payload(10 << 20)),
    ]
}

impl Case {
    /// The channels and payloads in one direction, `TO_` or `FROM_`.
    pub fn directed(&self, prefix: &str) -> Vec<(String, Vec<u8>)> {
        let message = |(n, (suffix, size)): (usize, &(String, Size))| {
            let mut channel = format!("{prefix}{suffix}");
            if suffix.is_empty() {
                channel.push_str(&"C".repeat(63 - prefix.len()));
            }
            let size = match *size {
                Size::Payload(size) => size,
                Size::Whole(size) => size - channel.len() - 1,
            };
            (channel, (0..size).map(|i| (i + n + i / 256 + i / 65_521) as u8).collect())
        };
        self.messages.iter().enumerate().map(message).collect()
    }
}
