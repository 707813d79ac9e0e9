//! Counters of refusals and failures; each kind is reported once.

use base::listed;
use serde::Serialize;
use std::sync::{Mutex, MutexGuard, PoisonError};

macro_rules! refusals {
    ($(#[doc = $doc:literal] $refusal:ident, $count:ident, $why:literal;)+) => {
        listed! {
            /// Reason why a request, a connection or a viewer's message was not served; its name is a text for people.
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            pub enum Refusal {
                $(#[doc = $doc] $refusal => $why,)+
            }
        }

        /// Counters.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
        pub struct Counts {
            $(#[doc = concat!("[`Refusal::", stringify!($refusal), "`].")] pub $count: u64,)+
        }

        impl Counts {
            fn of(&mut self, refusal: Refusal) -> &mut u64 {
                match refusal {
                    $(Refusal::$refusal => &mut self.$count,)+
                }
            }
        }
    };
}

refusals! {
    /// `Host` is not a name of the robot.
    Host, host, "this Host is none of the robot's names (web.hosts)";
    /// `Origin` is not listed.
    Origin, origin, "pages of this Origin may not connect (web.origins)";
    /// A proxy is in front, but there are no credentials.
    Proxy, proxy, "a proxy brought this, whose clients are not on this computer: web.token_file is needed";
    /// Missing or wrong credentials.
    Credentials, credentials, "it is not paired for this, and brings no credentials that are";
    /// Wrong code, or too many tries.
    Code, code, "a code that pairs nobody";
    /// Too many connections.
    Connections, connections, "there are too many connections";
    /// Too many viewers.
    Viewers, viewers, "there are as many viewers as may be (web.viewers)";
    /// Too many downloads.
    Downloads, downloads, "as many files are downloaded as may be at once";
    /// Too many runs to be read as a whole.
    Reads, reads, "another run is being read: ask again";
    /// No WebSocket, or another protocol.
    Protocol, protocol, "a WebSocket is expected here, at /foxglove one of foxglove.sdk.v1 or foxglove.websocket.v1";
    /// No HTTP, or too slow.
    Http, http, "a connection spoke no HTTP, or too slowly";
    /// A frame too long, or against RFC 6455.
    Frame, frame, "a viewer sent a frame that is too long or broken";
    /// Malformed message of a viewer.
    Malformed, malformed, "a viewer sent a message that is none of the protocol";
    /// A viewer's request that is not supported.
    NotGranted, not_granted, "a viewer asked for more than to look";
    /// A viewer that did not read for too long, or sent too many refused messages.
    SentAway, sent_away, "a viewer that took nothing, or sent nonsense only, was sent away";
}

/// Counters, and pending reports.
#[derive(Debug, Default)]
pub struct Stats(Mutex<Inner>);

#[derive(Debug, Default)]
struct Inner {
    counts: Counts,
    news: Vec<String>,
}

/// Maximum number of reports that wait to be taken: more than there are kinds of refusals.
const NEWS_MAX: usize = 64;
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
            inner.news.push(format!("refused: {}{quoted}; further ones are counted at /health", refusal.name()));
        }
    }

    /// Reports what somebody did, in a line.
    pub fn say(&self, line: String) {
        let mut inner = self.lock();
        if inner.news.len() < NEWS_MAX {
            inner.news.push(line);
        }
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.lock().counts
    }

    /// Reports, one line each: of refusals at most one per kind, ever.
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

    #[test]
    fn what_is_not_taken_is_bounded() {
        let stats = Stats::default();
        (0..1000).for_each(|n| stats.say(n.to_string()));
        let news = stats.take_news();
        assert_eq!((news.len(), news[1].as_str()), (NEWS_MAX, "1"));
    }
}
