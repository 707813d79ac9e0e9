//! Help.

use crate::cli::diag::command;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::widgets::{Block, Paragraph};

const KEYS: [(&str, &str); 11] = [
    ("1..6, tab", "views"),
    ("arrows", "mark a row; drive, once the drive is taken"),
    ("space, s", "STOP: zero at once, goal cancelled"),
    ("d", "take the drive, give it back; while taken zero is sent unless an arrow is held"),
    ("+ -", "speed of the arrows"),
    ("h", "home the steering"),
    ("f", "freeze the screen; the first line stays live"),
    ("/", "list only what contains a text; esc: all"),
    (":", "a command"),
    ("esc", "give the drive back, clear the filter"),
    ("q, ctrl-c", "quit"),
];

pub fn draw(frame: &mut Frame<'_>, area: Rect) {
    let lines = |list: &[(&str, &str)]| {
        list.iter().map(|(key, what)| format!("{key:<28} {what}")).collect::<Vec<_>>().join("\n")
    };
    let text = format!("{}\n\n{}", lines(&KEYS), lines(&command::HELP));
    frame.render_widget(Paragraph::new(text).block(Block::bordered().title(" help   any key ")), area);
}
