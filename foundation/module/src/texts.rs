//! Lines of text for people on `CM_EVENT_TEXT`: limits of their length and rate.

use base::{Duration, Instant, Level};
use messages::common;
use std::collections::VecDeque;
use std::mem;

/// Maximum length of a text in a message, bytes of UTF-8.
pub const TEXT_MAX: usize = 512;
/// Maximum number of texts of one module within one second. One of them is reserved for the count of omitted texts.
pub const RATE: usize = 50;
/// Time over which texts are counted.
const WINDOW: Duration = Duration::from_secs(1);
/// End of a text that was truncated.
const CUT: &str = "…";

/// Rate limiter for the texts of one module; counts omitted texts.
#[derive(Clone, Debug, Default)]
pub struct Texts {
    /// Times of the latest texts, at most [`RATE`].
    sent: VecDeque<Instant>,
    left_out: u32,
}

impl Texts {
    /// Returns the message for a text, or `None` if the rate is exceeded. The caller applies the threshold of levels.
    pub fn take(
        &mut self,
        now: Instant,
        timestamp: i64,
        module: &str,
        level: Level,
        text: &str,
    ) -> Option<common::EventText> {
        self.forget(now);
        if self.sent.len() >= RATE - 1 {
            self.left_out = self.left_out.saturating_add(1);
            return None;
        }
        self.sent.push_back(now);
        let (module, text) = (module.into(), clipped(text));
        Some(common::EventText { timestamp, module, level: level as i8, text })
    }

    /// Returns the message with the number of texts omitted since the previous such message, if any.
    pub fn left_out(&mut self, now: Instant, timestamp: i64, module: &str) -> Option<common::EventText> {
        if self.left_out == 0 {
            return None;
        }
        self.forget(now);
        if self.sent.len() >= RATE {
            return None;
        }
        self.sent.push_back(now);
        let text = format!("{} texts left out: more than {} in a second", mem::take(&mut self.left_out), RATE - 1);
        Some(common::EventText { timestamp, module: module.into(), level: common::EventText::WARNING, text })
    }

    fn forget(&mut self, now: Instant) {
        while self.sent.front().is_some_and(|sent| now.since(*sent) >= WINDOW) {
            self.sent.pop_front();
        }
    }
}

/// Returns a text without control characters, truncated to [`TEXT_MAX`] bytes.
#[must_use]
pub fn clipped(text: &str) -> String {
    let whole = text.len() <= TEXT_MAX;
    let mut end = if whole { text.len() } else { TEXT_MAX - CUT.len() };
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let mut clipped = String::with_capacity(end + if whole { 0 } else { CUT.len() });
    // A control character of two bytes becomes one byte: the result is never longer.
    clipped.extend(text[..end].chars().map(|c| if c.is_control() { ' ' } else { c }));
    if !whole {
        clipped.push_str(CUT);
    }
    clipped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_one_line_of_at_most_512_bytes() {
        assert_eq!(clipped("one\nline\0"), "one line ");
        for text in ["x".repeat(512), "ä".repeat(256)] {
            assert_eq!(clipped(&text), text);
        }
        for text in ["x".repeat(513), "ä".repeat(257), "𝄞".repeat(1000)] {
            let clipped = clipped(&text);
            assert!(clipped.len() <= TEXT_MAX && clipped.len() > TEXT_MAX - 4, "{}", clipped.len());
            assert!(clipped.ends_with('…') && text.starts_with(&clipped[..500]));
        }
    }

    #[test]
    fn at_most_fifty_texts_a_second_and_omitted_ones_are_counted() {
        let (mut texts, mut sent, mut counted) = (Texts::default(), Vec::new(), 0);
        // 20 every 100 ms for three seconds, and one each second afterwards.
        for ms in (0..3000).step_by(100).flat_map(|ms| [ms; 20]).chain([4000, 5000, 6000]) {
            let now = Instant::from_millis(ms);
            if texts.take(now, 0, "toy", Level::Info, "text").is_some() {
                sent.push(ms);
            }
            if ms % 1000 == 0
                && let Some(said) = texts.left_out(now, 0, "toy")
            {
                sent.push(ms);
                assert_eq!(said.level, common::EventText::WARNING);
                counted += said.text.split(' ').next().unwrap().parse::<usize>().unwrap();
            }
        }
        for (n, ms) in sent.iter().enumerate() {
            let within = sent[n..].iter().take_while(|other| **other < ms + 1000).count();
            assert!(within <= RATE, "{within} from {ms} ms on");
        }
        let texts = 603;
        assert!(counted > 0);
        let counts = sent.len() + counted - texts;
        assert!((1..=4).contains(&counts), "each text is sent or counted; {counts} are the counts themselves");
    }
}
