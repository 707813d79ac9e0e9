//! Counters of refusals and failures; each kind is reported once.

use serde::Serialize;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Reason why a request, a connection or a viewer's message was not served.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// `Host` is not a name of the robot.
    Host,
    /// `Origin` is not listed.
    Origin,
    /// A proxy is in front, but there are no credentials.
    Proxy,
    /// Missing or wrong credentials.
    Credentials,
    /// Wrong code, or too many tries.
    Code,
    /// Too many connections.
    Connections,
    /// Too many viewers.
    Viewers,
    /// Too many downloads.
    Downloads,
    /// No WebSocket, or another protocol.
    Protocol,
    /// No HTTP, or too slow.
    Http,
    /// A frame too long, or against RFC 6455.
    Frame,
    /// Malformed message of a viewer.
    Malformed,
    /// A viewer's request that is not supported.
    NotGranted,
    /// A viewer that did not read for too long, or sent too many refused messages.
    SentAway,
}

impl Refusal {
    #[cfg(test)]
    const ALL: [Self; 14] = [
        Self::Host,
        Self::Origin,
        Self::Proxy,
        Self::Credentials,
        Self::Code,
        Self::Connections,
        Self::Viewers,
        Self::Downloads,
        Self::Protocol,
        Self::Http,
        Self::Frame,
        Self::Malformed,
        Self::NotGranted,
        Self::SentAway,
    ];

    /// Text for people.
    #[must_use]
    pub const fn why(self) -> &'static str {
        match self {
            Self::Host => "this Host is none of the robot's names (web.hosts)",
            Self::Origin => "pages of this Origin may not connect (web.origins)",
            Self::Proxy => "a proxy brought this, whose clients are not on this computer: web.token_file is needed",
            Self::Credentials => "it is not paired for this, and brings no credentials that are",
            Self::Code => "a code that pairs nobody",
            Self::Connections => "there are too many connections",
            Self::Viewers => "there are as many viewers as may be (web.viewers)",
            Self::Downloads => "as many files are downloaded as may be at once",
            Self::Protocol => {
                "a WebSocket is expected here, at /foxglove one of foxglove.sdk.v1 or foxglove.websocket.v1"
            }
            Self::Http => "a connection spoke no HTTP, or too slowly",
            Self::Frame => "a viewer sent a frame that is too long or broken",
            Self::Malformed => "a viewer sent a message that is none of the protocol",
            Self::NotGranted => "a viewer asked for more than to look",
            Self::SentAway => "a viewer that took nothing, or sent nonsense only, was sent away",
        }
    }
}

/// Counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// [`Refusal::Host`].
    pub host: u64,
    /// [`Refusal::Origin`].
    pub origin: u64,
    /// [`Refusal::Proxy`].
    pub proxy: u64,
    /// [`Refusal::Credentials`].
    pub credentials: u64,
    /// [`Refusal::Code`].
    pub code: u64,
    /// [`Refusal::Connections`].
    pub connections: u64,
    /// [`Refusal::Viewers`].
    pub viewers: u64,
    /// [`Refusal::Downloads`].
    pub downloads: u64,
    /// [`Refusal::Protocol`].
    pub protocol: u64,
    /// [`Refusal::Http`].
    pub http: u64,
    /// [`Refusal::Frame`].
    pub frame: u64,
    /// [`Refusal::Malformed`].
    pub malformed: u64,
    /// [`Refusal::NotGranted`].
    pub not_granted: u64,
    /// [`Refusal::SentAway`].
    pub sent_away: u64,
}

impl Counts {
    fn of(&mut self, refusal: Refusal) -> &mut u64 {
        match refusal {
            Refusal::Host => &mut self.host,
            Refusal::Origin => &mut self.origin,
            Refusal::Proxy => &mut self.proxy,
            Refusal::Credentials => &mut self.credentials,
            Refusal::Code => &mut self.code,
            Refusal::Connections => &mut self.connections,
            Refusal::Viewers => &mut self.viewers,
            Refusal::Downloads => &mut self.downloads,
            Refusal::Protocol => &mut self.protocol,
            Refusal::Http => &mut self.http,
            Refusal::Frame => &mut self.frame,
            Refusal::Malformed => &mut self.malformed,
            Refusal::NotGranted => &mut self.not_granted,
            Refusal::SentAway => &mut self.sent_away,
        }
    }
}

/// Counters, and pending reports.
#[derive(Debug, Default)]
pub struct Stats(Mutex<Inner>);

#[derive(Debug, Default)]
struct Inner {
    counts: Counts,
    news: Vec<String>,
}

/// Maximum length of a quotation in a report.
const QUOTED_MAX: usize = 80;

impl Stats {
    /// Counts a refusal; `what` is quoted in the first report of its kind.
    pub fn refuse(&self, refusal: Refusal, what: &str) {
        let mut inner = self.lock();
        let count = inner.counts.of(refusal);
        *count += 1;
        if *count == 1 {
            let what: String = what.chars().filter(|c| !c.is_control()).take(QUOTED_MAX).collect();
            let quoted = if what.is_empty() { String::new() } else { format!(": {what:?}") };
            inner.news.push(format!("refused: {}{quoted}; further ones are counted at /health", refusal.why()));
        }
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.lock().counts
    }

    /// Reports, one line each: at most one per kind, ever.
    pub fn take_news(&self) -> Vec<String> {
        std::mem::take(&mut self.lock().news)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_counted_separately_and_reported_once() {
        let stats = Stats::default();
        for (times, refusal) in Refusal::ALL.into_iter().enumerate() {
            for _ in 0..=times {
                stats.refuse(refusal, "a\nb");
            }
        }
        let counts = serde_json::to_value(stats.counts()).unwrap();
        let numbers: Vec<u64> = counts.as_object().unwrap().values().filter_map(serde_json::Value::as_u64).collect();
        let mut sorted = numbers.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (1..=Refusal::ALL.len() as u64).collect::<Vec<_>>(), "{counts}");
        let news = stats.take_news();
        assert_eq!(news.len(), Refusal::ALL.len());
        assert!(news.iter().all(|line| line.contains("\"ab\"") && !line.contains('\n')), "{news:?}");
        assert!(stats.take_news().is_empty());
    }
}
