//! Style of printed text: coloured on a terminal. Nothing is told by colour alone.

use std::io::IsTerminal;

/// Colour of a good and of a bad state.
pub const GREEN: &str = "32";
pub const RED: &str = "1;31";

/// Whether texts are coloured.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    pub colour: bool,
}

impl Style {
    /// Style of standard output: coloured on a terminal, unless `NO_COLOR` is set.
    pub fn of_stdout() -> Self {
        let wanted = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        Self { colour: wanted && std::io::stdout().is_terminal() }
    }

    /// The text in the colour of an SGR code.
    pub fn paint(&self, code: &str, text: &str) -> String {
        if self.colour { format!("\x1b[{code}m{text}\x1b[0m") } else { text.into() }
    }
}
