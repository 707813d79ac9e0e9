//! Help.

use crate::diag::app::App;
use crate::diag::command;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::widgets::{Block, Paragraph};

const KEYS: [(&str, &str); 21] = [
    ("space, s", "STOP: zero at once, goal cancelled"),
    ("d", "take control of the motion, or release it. While it is held zero is sent"),
    ("", "unless an arrow is held. A terminal does not report its release:"),
    ("", "one press runs 0.7 s, each repeat 0.2 s more"),
    ("arrows", "drive, while you have control; else mark a row, change the view"),
    (", .", "go sideways while you have control, if the base can"),
    ("+ -", "speed of the arrows"),
    ("h", "home the steering"),
    ("1..6, tab", "views"),
    ("enter", "more of the marked row, or of the overview; again: less"),
    ("o", "another order of the rows"),
    ("/", "list only what contains a text; esc: all"),
    ("f", "freeze the screen; the first line stays live"),
    ("c", "begin a command about the marked row"),
    (":", "a command; tab completes it, up and down: earlier ones"),
    ("m", "a mark in the log"),
    ("pgup, pgdn", "ten rows up, down"),
    ("esc", "release control, clear the filter"),
    ("q, ctrl-c", "quit; the robot stops if you drove"),
    ("", ""),
    ("ages", "are before values; grey and a ! mean older than twice the period"),
];

pub fn draw(frame: &mut Frame<'_>, app: &App, area: Rect) {
    let keys = KEYS.iter().map(|(key, what)| format!("{key:<11} {what}"));
    let commands = command::HELP.iter().map(|(usage, what)| format!(":{usage:<35} {what}"));
    let lines: Vec<String> = keys.chain([String::new()]).chain(commands).collect();
    let room = usize::from(area.height.saturating_sub(2));
    let scroll = usize::from(app.scroll).min(lines.len().saturating_sub(room));
    let title = if lines.len() > room { " help   down: more, any other key: back " } else { " help   any key: back " };
    let text = Paragraph::new(lines.join("\n")).scroll((scroll as u16, 0));
    frame.render_widget(text.block(Block::bordered().title(title)), area);
}
