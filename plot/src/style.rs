//! Colours, patterns and letters. No information is in the colour alone; the colours are distinguishable with colour
//! vision deficiencies (Okabe and Ito, "Color Universal Design", 2008).

use super::canvas::{Anchor, Canvas, Colour, Font, Rect, Stroke, hatch};
use module::State;
use navitools::Point;

pub const INK: Colour = Colour::new(0x1a1a1a);
pub const GREY: Colour = Colour::new(0x5f6368);
pub const FRAME: Colour = Colour::new(0x9aa0a6);
pub const GRID: Colour = Colour::new(0xe4e6e9);
pub const WHITE: Colour = Colour::new(0xffffff);
pub const TRUTH: Colour = Colour::new(0x0072b2);
pub const ESTIMATE: Colour = Colour::new(0xd55e00);
pub const PLAN: Colour = Colour::new(0x009e73);
pub const BEACON: Colour = Colour::new(0xe69f00);
pub const OBSTACLE: Colour = Colour::new(0xcc79a7);
pub const COLUMN: Colour = Colour::new(0x8a8d91);
pub const DROP: Colour = Colour::new(0xf6dcdc);
pub const CONTACT: Colour = Colour::new(0xc00000);
pub const MARK: Colour = Colour::new(0x6a3d9a);

/// Sizes of letters, units.
pub const TITLE: f64 = 21.0;
pub const HEAD: f64 = 11.5;
pub const TEXT: f64 = 10.0;
pub const SMALL: f64 = 9.0;

/// Width below which a bar is filled without hatching, units.
const NARROW_UNITS: f64 = 3.0;

/// Filling of an area: colour, and lines over it.
#[derive(Clone, Copy, Debug)]
pub struct Filling {
    pub fill: Colour,
    /// Distance of falling and rising lines, units; 0 without lines.
    pub falls: f64,
    pub rises: f64,
    /// Colour of lines and letters.
    pub ink: Colour,
}

impl Filling {
    const fn new(fill: u32, falls: f64, rises: f64, ink: Colour) -> Self {
        Self { fill: Colour::new(fill), falls, rises, ink }
    }

    /// Fills a rectangle, with a text if it fits.
    pub fn draw(&self, canvas: &mut dyn Canvas, rect: &Rect, words: Option<(&str, f64)>) {
        let narrow = rect.w < NARROW_UNITS;
        let edge = Stroke::new(self.ink.cover(0.6), 0.5);
        canvas.area(&rect.corners(), self.fill, (!narrow).then_some(&edge));
        if narrow {
            return;
        }
        let line = Stroke::new(self.ink.cover(0.55), 0.6);
        for (apart, falls) in [(self.falls, true), (self.rises, false)].into_iter().filter(|(apart, _)| *apart > 0.0) {
            for ends in hatch(rect, apart, falls) {
                canvas.line(&ends, &line);
            }
        }
        let Some((words, width)) = words.filter(|(_, width)| *width + 4.0 <= rect.w) else { return };
        let middle = Point { x: rect.x + rect.w / 2.0, y: rect.y + rect.h / 2.0 };
        if self.falls + self.rises > 0.0 {
            // Letters have a plain background.
            let ground = Rect { x: middle.x - width / 2.0 - 1.5, y: rect.y + 1.0, w: width + 3.0, h: rect.h - 2.0 };
            canvas.area(&ground.corners(), self.fill, None);
        }
        let at = Point { x: middle.x, y: middle.y + 0.36 * SMALL };
        canvas.text(at, words, &Font::new(SMALL, self.ink).at(Anchor::Middle));
    }
}

/// State, its filling and its letter; an undefined value is UNKNOWN.
#[must_use]
pub fn state(value: i8) -> (State, Filling, &'static str) {
    let state = State::from_value(value).unwrap_or(State::Unknown);
    let (filling, letter) = match state {
        State::Unknown => (Filling::new(0xffffff, 0.0, 0.0, INK), "?"),
        State::Init => (Filling::new(0xd9e8f5, 0.0, 5.0, INK), "I"),
        State::Stop => (Filling::new(0xd5d7da, 5.0, 5.0, INK), "S"),
        State::Run => (Filling::new(0xcde9db, 0.0, 0.0, INK), "R"),
        State::Error => (Filling::new(0xf3b49b, 2.6, 0.0, INK), "E"),
        State::Terminate => (Filling::new(0x5f6368, 0.0, 0.0, WHITE), "T"),
        State::Pause => (Filling::new(0xfbe8a6, 5.0, 0.0, INK), "P"),
    };
    (state, filling, letter)
}

/// Filling of the `n`th cause of standstill, or of standstill without a command.
#[must_use]
pub fn reason(n: usize, idle: bool) -> Filling {
    const KINDS: [Filling; 6] = [
        Filling::new(0xf3b49b, 4.0, 0.0, INK),
        Filling::new(0xfbe8a6, 0.0, 4.0, INK),
        Filling::new(0xd9e8f5, 4.0, 4.0, INK),
        Filling::new(0xe6d3ea, 7.0, 0.0, INK),
        Filling::new(0xd9ead0, 0.0, 7.0, INK),
        Filling::new(0xe3d8cc, 7.0, 7.0, INK),
    ];
    if idle { Filling::new(0xf1f3f4, 0.0, 0.0, GREY) } else { KINDS[n % KINDS.len()] }
}

/// Signs of severities, from NOTICE to ERROR: a line, a rhombus, a triangle.
pub fn severity(canvas: &mut dyn Canvas, severity: usize, at: Point) {
    let corner = |x: f64, y: f64| Point { x: at.x + x, y: at.y + y };
    match severity {
        0 => canvas.line(&[corner(0.0, -4.0), corner(0.0, 4.0)], &Stroke::new(GREY, 1.0)),
        1 => {
            let corners = [corner(0.0, -4.5), corner(3.5, 0.0), corner(0.0, 4.5), corner(-3.5, 0.0)];
            canvas.area(&corners, BEACON, Some(&Stroke::new(INK, 0.5)));
        }
        _ => {
            let corners = [corner(0.0, -4.5), corner(4.5, 4.0), corner(-4.5, 4.0)];
            canvas.area(&corners, CONTACT, Some(&Stroke::new(INK, 0.5)));
        }
    }
}

/// Outline of a field of the guard: solid if what is in it stops the robot, dotted if it slows the robot.
#[must_use]
pub fn field(protective: bool) -> Stroke {
    if protective { Stroke::new(ESTIMATE, 1.8) } else { Stroke::new(BEACON, 1.4).dashed(1.5, 2.5) }
}

/// Sign of a contact: a cross.
pub fn contact(canvas: &mut dyn Canvas, at: Point, size: f64) {
    for turn in [1.0, -1.0] {
        let end = |way: f64| Point { x: at.x + way, y: at.y + turn * way };
        canvas.line(&[end(-size), end(size)], &Stroke::new(CONTACT, 1.8));
    }
}
