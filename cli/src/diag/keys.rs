//! What keys do.

use super::app::{App, Mode, Tab};
use super::command::{self, Asked};
use super::drive::Arrow;
use base::Instant;
use messages::lowlevel::{CmdHoming, CmdMotion};
use messages::middlelevel::CmdGoal;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use std::mem;

/// A line that is typed is not longer, bytes.
const LINE_MAX: usize = 200;
/// Lines that are remembered.
const HISTORY_MAX: usize = 50;
/// Maximum scroll position, lines.
const SCROLL_MAX: usize = 200;
/// Rows of a page.
const PAGE: isize = 10;

impl App {
    pub fn on_key(&mut self, now: Instant, key: KeyEvent) {
        let arrow = match key.code {
            KeyCode::Up => Some(Arrow::Forward),
            KeyCode::Down => Some(Arrow::Back),
            KeyCode::Left => Some(Arrow::Left),
            KeyCode::Right => Some(Arrow::Right),
            KeyCode::Char(',') if self.drive.is_taken() && self.drive.goes_sideways() => Some(Arrow::AsideLeft),
            KeyCode::Char('.') if self.drive.is_taken() && self.drive.goes_sideways() => Some(Arrow::AsideRight),
            _ => None,
        };
        if key.kind == KeyEventKind::Release {
            if let Some(arrow) = arrow {
                self.drive.release(arrow);
            }
            return;
        }
        let mut code = key.code;
        if key.modifiers.contains(KeyModifiers::CONTROL) {
            match code {
                KeyCode::Char('c' | 'd') => self.quit = true,
                // A line feed: what some terminals send for Enter.
                KeyCode::Char('j') => code = KeyCode::Enter,
                _ => {}
            }
            if code != KeyCode::Enter {
                return;
            }
        }
        match mem::replace(&mut self.mode, Mode::Normal) {
            Mode::Normal => match arrow {
                Some(arrow) if self.drive.is_taken() => self.drive.press(now, arrow),
                Some(Arrow::Forward) => self.move_mark(now, -1),
                Some(Arrow::Back) => self.move_mark(now, 1),
                Some(Arrow::Left) => self.turn_to(self.tab.next(Tab::ALL.len() - 1)),
                Some(Arrow::Right) => self.turn_to(self.tab.next(1)),
                Some(Arrow::AsideLeft | Arrow::AsideRight) => {}
                None => self.on_letter(now, code),
            },
            Mode::Command(line) => self.on_command_line(now, line, code),
            Mode::Filter(line) => match typed(line, code) {
                Typed::More(line) => {
                    self.filter.clone_from(&line);
                    self.mode = Mode::Filter(line);
                }
                Typed::Done(line) => self.filter = line,
                Typed::Left => self.filter.clear(),
            },
            Mode::Confirm(what, message) if code == KeyCode::Char('y') => {
                self.send(now, *message, format!("sent: {what}"));
            }
            Mode::Confirm(..) => self.say(now, "not done"),
            Mode::Help => match code {
                KeyCode::Up => self.scroll_help(-1),
                KeyCode::Down => self.scroll_help(1),
                KeyCode::PageUp => self.scroll_help(-PAGE),
                KeyCode::PageDown => self.scroll_help(PAGE),
                _ => self.scroll = 0,
            },
        }
    }

    /// A text was pasted: only into a line that is typed.
    pub fn on_paste(&mut self, now: Instant, text: &str) {
        let (Mode::Command(line) | Mode::Filter(line)) = &mut self.mode else {
            self.say(now, "what is pasted is no keys: press : first");
            return;
        };
        for c in text.chars().filter(|c| !c.is_control()) {
            if line.len() + c.len_utf8() > LINE_MAX {
                break;
            }
            line.push(c);
        }
        if let Mode::Filter(line) = &self.mode {
            self.filter.clone_from(line);
        }
    }

    fn scroll_help(&mut self, lines: isize) {
        self.mode = Mode::Help;
        self.scroll_by(lines);
    }

    fn scroll_by(&mut self, lines: isize) {
        self.scroll = usize::from(self.scroll).saturating_add_signed(lines).min(SCROLL_MAX) as u16;
    }

    fn on_letter(&mut self, now: Instant, code: KeyCode) {
        match code {
            KeyCode::Char(digit @ '1'..='6') => self.turn_to(Tab::ALL[digit as usize - '1' as usize]),
            KeyCode::Tab => self.turn_to(self.tab.next(1)),
            KeyCode::BackTab => self.turn_to(self.tab.next(Tab::ALL.len() - 1)),
            KeyCode::PageUp if self.tab == Tab::Messages && self.expanded => self.scroll_by(-PAGE),
            KeyCode::PageDown if self.tab == Tab::Messages && self.expanded => self.scroll_by(PAGE),
            KeyCode::PageUp => self.move_mark(now, -PAGE),
            KeyCode::PageDown => self.move_mark(now, PAGE),
            KeyCode::Home => self.move_mark(now, isize::MIN),
            KeyCode::End => self.move_mark(now, isize::MAX),
            KeyCode::Enter => (self.expanded, self.scroll) = (!self.expanded, 0),
            KeyCode::Char('o') => {
                let order = &mut self.orders[self.tab as usize];
                *order = (*order + 1) % self.tab.orders().len();
            }
            KeyCode::Char('?') => (self.mode, self.scroll) = (Mode::Help, 0),
            KeyCode::Char('/') => self.mode = Mode::Filter(String::new()),
            KeyCode::Char(':') => self.begin_command(String::new()),
            KeyCode::Char('c') => {
                let line = self.line_about_mark(now);
                self.begin_command(line);
            }
            KeyCode::Char('m') => self.begin_command("mark ".into()),
            KeyCode::Char('q') => self.quit = true,
            KeyCode::Char('f') => self.freeze(now),
            KeyCode::Esc => {
                self.drive.give_back();
                self.filter.clear();
                self.expanded = false;
            }
            KeyCode::Char(' ' | 's') => self.stop(now),
            KeyCode::Char('d' | 'h') if self.read_only => self.say(now, "read-only: nothing is sent"),
            KeyCode::Char('d') => {
                self.drive.toggle();
                if self.drive.is_taken() {
                    self.turn_to(Tab::Overview);
                }
            }
            KeyCode::Char('h') => {
                let homing = CmdHoming { timestamp: self.timestamp(now), axis: "steering".into() };
                self.mode = Mode::Confirm("home the steering: the front wheels turn".into(), Box::new(homing.into()));
            }
            KeyCode::Char('+' | '=') => self.drive.faster(1.0),
            KeyCode::Char('-') => self.drive.faster(-1.0),
            _ => {}
        }
    }

    /// The beginning of a command about what is marked.
    fn line_about_mark(&self, now: Instant) -> String {
        let key = self.marked_key(now).unwrap_or_default();
        let node = || self.nodes.iter().find(|(_, axis)| key.rsplit('/').next() == Some(axis));
        match self.tab {
            Tab::Modules if !key.is_empty() => format!("state {key} "),
            Tab::Buses => node().map_or("sdo ".into(), |(id, _)| format!("sdo {id} ")),
            Tab::Logs => "log ".into(),
            _ => String::new(),
        }
    }

    fn begin_command(&mut self, line: String) {
        self.history.1 = self.history.0.len();
        self.mode = Mode::Command(line);
    }

    fn on_command_line(&mut self, now: Instant, line: String, code: KeyCode) {
        let (lines, place) = &mut self.history;
        match code {
            KeyCode::Up => *place = place.saturating_sub(1),
            KeyCode::Down => *place = (*place + 1).min(lines.len()),
            _ => {}
        }
        if matches!(code, KeyCode::Up | KeyCode::Down) {
            self.mode = Mode::Command(lines.get(*place).cloned().unwrap_or_default());
            return;
        }
        if code == KeyCode::Tab {
            let (model, at) = self.shown(now);
            let modules: Vec<String> = model.modules(at).into_iter().map(|row| row.module).collect();
            self.mode = Mode::Command(command::complete(&line, &modules, &self.faults));
            return;
        }
        match typed(line, code) {
            Typed::More(line) => self.mode = Mode::Command(line),
            Typed::Done(line) => self.command(now, line),
            Typed::Left => {}
        }
    }

    /// Zero, and no goal any more.
    fn stop(&mut self, now: Instant) {
        self.drive.stop();
        let timestamp = self.timestamp(now);
        let source = self.source().to_owned();
        let zero = CmdMotion { timestamp, speed: 0.0, steering: 0.0, priority: CmdMotion::REMOTE, source };
        self.send(now, zero, "");
        self.send(now, CmdGoal { timestamp, ..CmdGoal::default() }, "stop: zero sent, goal cancelled");
    }

    fn command(&mut self, now: Instant, line: String) {
        match command::read(&line, self.timestamp(now), self.source(), &self.nodes) {
            Ok(Asked::Quit) => self.quit = true,
            Ok(_) if self.read_only => self.say(now, "read-only: nothing is sent"),
            Ok(Asked::Say(message)) => {
                let said = format!("sent on {}", message.channel_name());
                self.send(now, *message, said);
            }
            Ok(Asked::Confirm(what, message)) => self.mode = Mode::Confirm(what, message),
            Ok(Asked::Object(object)) => {
                let timestamp = self.timestamp(now);
                let (request, said) = self.objects.ask(now, timestamp, object);
                self.send(now, request, said);
            }
            Err(why) => self.say(now, why),
        }
        if !line.trim().is_empty() && self.history.0.last() != Some(&line) {
            self.history.0.push(line);
            let over = self.history.0.len().saturating_sub(HISTORY_MAX);
            self.history.0.drain(..over);
        }
    }
}

enum Typed {
    More(String),
    Done(String),
    Left,
}

fn typed(mut line: String, code: KeyCode) -> Typed {
    match code {
        KeyCode::Enter => return Typed::Done(line),
        KeyCode::Esc => return Typed::Left,
        KeyCode::Backspace if line.pop().is_none() => return Typed::Left,
        KeyCode::Char(c) if line.len() + c.len_utf8() <= LINE_MAX && !c.is_control() => line.push(c),
        _ => {}
    }
    Typed::More(line)
}
