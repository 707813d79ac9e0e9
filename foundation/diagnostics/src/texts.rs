//! Texts of modules for people (`CM_EVENT_TEXT`).

use base::Level;
use messages::common::EventText;
use module::texts::clipped;
use serde::Serialize;
use std::collections::VecDeque;

/// Maximum number of texts.
const TEXTS_MAX: usize = 500;

/// Text as shown.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ShownText {
    /// Publication, microseconds since the UNIX epoch.
    pub timestamp: i64,
    /// Module, at most 512 bytes.
    pub module: String,
    /// Level; values of `event_text_t`.
    pub level: i8,
    /// One line, at most 512 bytes.
    pub text: String,
}

impl ShownText {
    /// Name of the level; `?` for an undefined value.
    #[must_use]
    pub fn level(&self) -> &'static str {
        Level::from_value(self.level).map_or("?", Level::name)
    }
}

/// Latest texts of all modules.
#[derive(Clone, Debug, Default)]
pub struct Texts {
    texts: VecDeque<ShownText>,
}

impl Texts {
    /// Adds a text.
    pub fn take(&mut self, text: &EventText) {
        if self.texts.len() == TEXTS_MAX {
            self.texts.pop_front();
        }
        let (module, line) = (clipped(&text.module), clipped(&text.text));
        self.texts.push_back(ShownText { timestamp: text.timestamp, module, level: text.level, text: line });
    }

    /// Texts, the newest first.
    pub fn latest(&self) -> impl Iterator<Item = &ShownText> {
        self.texts.iter().rev()
    }
}
