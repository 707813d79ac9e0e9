//! Lower part of a picture: events over time.

use super::axis;
use super::canvas::{Anchor, Canvas, Font, Rect, Stroke};
use super::data::{Picture, StandstillCause};
use super::map::frame;
use super::page::Sheet;
use super::series::{Lane, Series, Span};
use super::style::{self, ESTIMATE, GREY, GRID, HEAD, INK, MARK, PLAN, SMALL, TEXT, TRUTH};
use navitools::Point;

/// Heights, units: of a heading, a panel with an axis, a row.
const TOP: f64 = 16.0;
const PANEL: f64 = 84.0;
const ROW: f64 = 15.0;
/// Space after a panel, units.
const GAP: f64 = 14.0;
/// Gap that interrupts a line, s: motion is sent at 20 Hz, the battery voltage at 1 Hz.
const MOTION_GAP_S: f64 = 1.0;
const POWER_GAP_S: f64 = 10.0;
/// Maximum number of modules drawn.
const MODULES_MAX: usize = 40;

/// Curve of a panel.
struct Curve<'a> {
    name: &'a str,
    series: &'a Series,
    stroke: Stroke,
    hold: f64,
}

impl Picture {
    /// Draws everything with a time below `top`; returns its lower end.
    pub(super) fn draw_timeline(&self, canvas: &mut dyn Canvas, sheet: &Sheet, top: f64) -> f64 {
        let top = top + if self.marks.is_empty() { 0.0 } else { 12.0 };
        let curve = |name, series, stroke, hold| Curve { name, series, stroke, hold };
        let target = Stroke::new(INK, 1.0).dashed(4.0, 2.5);
        let mut speeds = vec![
            curve("measured", &self.speed, Stroke::new(TRUTH, 1.5), MOTION_GAP_S),
            curve("commanded", &self.speed_target, target, MOTION_GAP_S),
        ];
        // Of the guard, where the robot has one.
        let bounds = ["at most forward", "at most backward"].into_iter().zip(&self.bounds);
        let strokes = [Stroke::new(ESTIMATE, 1.2), Stroke::new(MARK, 1.2).dashed(1.5, 2.0)];
        let bounds = bounds.zip(strokes).filter(|((_, bound), _)| bound.range().is_some());
        speeds.extend(bounds.map(|((name, bound), stroke)| curve(name, bound, stroke, MOTION_GAP_S)));
        let mut y = panel(canvas, sheet, top, ("speed", "Speed", "m/s"), &speeds, None);
        let angles = [
            curve("measured", &self.steering, Stroke::new(PLAN, 1.5), MOTION_GAP_S),
            curve("commanded", &self.steering_target, target, MOTION_GAP_S),
        ];
        y = panel(canvas, sheet, y, ("steering", "Steering", "rad"), &angles, None);
        let voltage = [curve("voltage (left)", &self.voltage, Stroke::new(ESTIMATE, 1.5), POWER_GAP_S)];
        let charge = curve("charge (right)", &self.charge, Stroke::new(INK, 1.2).dashed(1.5, 2.0), POWER_GAP_S);
        y = panel(canvas, sheet, y, ("battery", "Battery", "V"), &voltage, Some((&charge, "%")));
        y = self.draw_stops(canvas, sheet, y);
        y = self.draw_errors(canvas, sheet, y);
        y = self.draw_states(canvas, sheet, y);
        let bottom = y - GAP;
        self.draw_marks(canvas, sheet, top, bottom);
        draw_times(canvas, sheet, bottom)
    }

    /// Causes of standstill in order of their letters, with total duration, s, and number.
    pub(super) fn reasons(&self) -> Vec<(String, f64, usize)> {
        let mut all: Vec<(String, f64, usize)> = Vec::new();
        let stands = self.stands().spans().iter().filter(|span| !span.what.words.is_empty() && !span.what.idle);
        for span in stands {
            match all.iter_mut().find(|(what, ..)| *what == span.what.words) {
                Some((_, seconds, times)) => {
                    *seconds += span.to - span.from;
                    *times += 1;
                }
                None => all.push((span.what.words.clone(), span.to - span.from, 1)),
            }
        }
        all
    }

    fn draw_stops(&self, canvas: &mut dyn Canvas, sheet: &Sheet, top: f64) -> f64 {
        canvas.begin("stops");
        head(canvas, sheet, top, "Stops", "causes of standstill; letters are explained below");
        let reasons = self.reasons();
        let rows: [(&str, &Lane<StandstillCause>); 2] = [("PAUSE line", &self.pause), ("stands", self.stands())];
        let rect = rows_rect(sheet, top, rows.len());
        grid(canvas, sheet, &rect);
        for (n, (name, lane)) in rows.into_iter().enumerate() {
            let y = rect.y + ROW * n as f64;
            name_row(canvas, sheet, y, name);
            for (span, bar) in bars(sheet, lane, y).filter(|(span, _)| !span.what.words.is_empty()) {
                let StandstillCause { words: what, idle } = &span.what;
                let place = reasons.iter().position(|(reason, ..)| reason == what);
                let idle = *idle;
                let filling = style::reason(place.unwrap_or(0), idle);
                let letter = place.map_or(String::new(), letter);
                let whole = if letter.is_empty() { what.clone() } else { format!("{letter}  {what}") };
                let width = |words: &str| sheet.letters.width(words, SMALL, false);
                let beside = sheet.left + sheet.width - bar.right() - 6.0;
                let words = if width(&whole) + 8.0 < bar.w { whole.as_str() } else { &letter };
                filling.draw(canvas, &bar, Some((words, width(words))).filter(|_| !words.is_empty()));
                // The PAUSE line has no letters: its source is in the bar, or beside it.
                if words.is_empty() && !idle && width(&whole) < beside {
                    let at = Point { x: bar.right() + 3.0, y: bar.y + bar.h / 2.0 + 0.36 * SMALL };
                    canvas.text(at, &whole, &Font::new(SMALL, INK));
                }
            }
        }
        frame(canvas, &rect);
        canvas.end();
        rect.bottom() + GAP
    }

    fn draw_errors(&self, canvas: &mut dyn Canvas, sheet: &Sheet, top: f64) -> f64 {
        canvas.begin("errors");
        head(canvas, sheet, top, "Reports", "numbers are those of the list below");
        let rect = rows_rect(sheet, top, 3);
        grid(canvas, sheet, &rect);
        let listed = self.listed();
        for (n, name) in ["errors", "warnings", "notices"].into_iter().enumerate() {
            let (severity, y) = (2 - n, rect.y + ROW * n as f64);
            let ticks = &self.errors[severity];
            name_row(canvas, sheet, y, &format!("{name} ({})", ticks.count));
            let mut last = f64::NEG_INFINITY;
            let mut moments = ticks.moments().to_vec();
            moments.sort_by(f64::total_cmp);
            for x in moments.iter().map(|at| sheet.x(*at)) {
                // Events too close to be distinguished are drawn once.
                if x - last > 0.5 {
                    style::severity(canvas, severity, Point { x, y: y + ROW / 2.0 });
                    last = x;
                }
            }
            let numbered = listed.iter().enumerate().filter(|(_, told)| told.severity == severity);
            let numbered: Vec<(usize, f64)> = numbered.map(|(n, told)| (n + 1, sheet.x(told.first))).collect();
            // If signs touch, their numbers follow the last of them.
            for near in numbered.chunk_by(|a, b| b.1 - a.1 < 20.0) {
                let text = near.iter().map(|(number, _)| number.to_string()).collect::<Vec<_>>().join(", ");
                let x = near[near.len() - 1].1 + 6.0;
                let fits = x + sheet.letters.width(&text, SMALL, false) < rect.right();
                let (x, anchor) = if fits { (x, Anchor::Start) } else { (near[0].1 - 6.0, Anchor::End) };
                let font = Font::new(SMALL, INK).at(anchor);
                canvas.text(Point { x, y: y + ROW / 2.0 + 3.5 }, &text, &font);
            }
        }
        frame(canvas, &rect);
        canvas.end();
        rect.bottom() + GAP
    }

    fn draw_states(&self, canvas: &mut dyn Canvas, sheet: &Sheet, top: f64) -> f64 {
        if self.states.is_empty() {
            return top;
        }
        canvas.begin("states");
        let modules = self.shown_modules();
        head(canvas, sheet, top, "Modules", "");
        let mut x = sheet.left + 62.0;
        let said = |value: i8| modules.iter().any(|(_, lane)| lane.spans().iter().any(|span| span.what == value));
        for value in (i8::MIN..=i8::MAX).filter(|value| said(*value)) {
            let (state, filling, letter) = style::state(value);
            let swatch = Rect { x, y: top + 1.5, w: 16.0, h: 11.0 };
            filling.draw(canvas, &swatch, Some((letter, sheet.letters.width(letter, SMALL, false))));
            let name = state.name().to_lowercase();
            canvas.text(Point { x: x + 20.0, y: top + 10.5 }, &name, &Font::new(TEXT, INK));
            x += 36.0 + sheet.letters.width(&name, TEXT, false);
        }
        let rect = rows_rect(sheet, top, modules.len());
        grid(canvas, sheet, &rect);
        for (n, (name, lane)) in modules.iter().enumerate() {
            let y = rect.y + ROW * n as f64;
            name_row(canvas, sheet, y, name);
            for (span, bar) in bars(sheet, lane, y) {
                let (_, filling, letter) = style::state(span.what);
                filling.draw(canvas, &bar, Some((letter, sheet.letters.width(letter, SMALL, false))));
            }
        }
        frame(canvas, &rect);
        canvas.end();
        rect.bottom() + GAP
    }

    /// Modules with a row, by name, up to the maximum number; those with the most changes take precedence.
    fn shown_modules(&self) -> Vec<(&str, &Lane<i8>)> {
        let mut all: Vec<_> = self.states.iter().map(|(name, lane)| (name.as_str(), lane)).collect();
        if all.len() > MODULES_MAX {
            all.sort_by_key(|(_, lane)| std::cmp::Reverse(lane.spans().len()));
            all.truncate(MODULES_MAX);
            all.sort_by_key(|(name, _)| *name);
        }
        all
    }

    /// Number of modules without a row.
    pub(super) fn hidden_modules(&self) -> usize {
        self.states.len().saturating_sub(MODULES_MAX)
    }

    fn draw_marks(&self, canvas: &mut dyn Canvas, sheet: &Sheet, top: f64, bottom: f64) {
        canvas.begin("marks");
        let mut right = f64::NEG_INFINITY;
        for (n, (at, _)) in self.marks.iter().enumerate() {
            let (x, name) = (sheet.x(*at), format!("M{}", n + 1));
            canvas.line(&[Point { x, y: top }, Point { x, y: bottom }], &Stroke::new(MARK, 1.0).dashed(2.0, 2.0));
            let flag = [(0.0, 0.0), (0.0, -9.0), (8.0, -6.5), (0.0, -4.0)].map(|(a, b)| Point { x: x + a, y: top + b });
            canvas.area(&flag, MARK, None);
            if x > right {
                canvas.text(Point { x: x + 10.0, y: top - 3.0 }, &name, &Font::new(SMALL, MARK).bold());
                right = x + 14.0 + sheet.letters.width(&name, SMALL, true);
            }
        }
        canvas.end();
    }
}

/// Letter of a cause: A to Z, then numbered.
pub(super) fn letter(n: usize) -> String {
    match u8::try_from(n) {
        Ok(n) if n < 26 => char::from(b'A' + n).to_string(),
        _ => (n + 1).to_string(),
    }
}

fn head(canvas: &mut dyn Canvas, sheet: &Sheet, top: f64, name: &str, rest: &str) {
    let y = top + 10.5;
    canvas.text(Point { x: sheet.left, y }, name, &Font::new(HEAD, INK).bold());
    let x = sheet.left + sheet.letters.width(name, HEAD, true) + 10.0;
    canvas.text(Point { x, y }, rest, &Font::new(TEXT, GREY));
}

fn name_row(canvas: &mut dyn Canvas, sheet: &Sheet, y: f64, name: &str) {
    let name = sheet.letters.fit(name, TEXT, false, sheet.left - 10.0);
    canvas.text(Point { x: sheet.left - 6.0, y: y + ROW / 2.0 + 3.5 }, &name, &Font::new(TEXT, INK).at(Anchor::End));
}

fn rows_rect(sheet: &Sheet, top: f64, rows: usize) -> Rect {
    Rect { x: sheet.left, y: top + TOP, w: sheet.width, h: ROW * rows as f64 }
}

/// Bars of intervals in a row: with a minimum width, and without those that would be hidden by the previous one.
fn bars<'a, T: PartialEq>(sheet: &'a Sheet, lane: &'a Lane<T>, y: f64) -> impl Iterator<Item = (&'a Span<T>, Rect)> {
    let mut end = f64::NEG_INFINITY;
    lane.spans().iter().filter_map(move |span| {
        let (x, right) = (sheet.x(span.from), sheet.x(span.to));
        let w = (right - x).max(1.2);
        let bar = Rect { x: x.min(sheet.left + sheet.width - w), y: y + 1.5, w, h: ROW - 3.0 };
        let seen = bar.right() > end + 0.3;
        end = end.max(bar.right());
        seen.then_some((span, bar))
    })
}

fn grid(canvas: &mut dyn Canvas, sheet: &Sheet, rect: &Rect) {
    for (second, _) in &sheet.moments {
        let x = sheet.x(sheet.from + second);
        canvas.line(&[Point { x, y: rect.y }, Point { x, y: rect.bottom() }], &Stroke::new(GRID, 0.8));
    }
}

fn draw_times(canvas: &mut dyn Canvas, sheet: &Sheet, bottom: f64) -> f64 {
    canvas.begin("times");
    for (second, text) in &sheet.moments {
        let x = sheet.x(sheet.from + second);
        canvas.text(Point { x, y: bottom + 14.0 }, text, &Font::new(TEXT, GREY).at(Anchor::Middle));
    }
    let at = Point { x: sheet.left + sheet.width / 2.0, y: bottom + 28.0 };
    canvas.text(at, &sheet.time_label, &Font::new(TEXT, INK).at(Anchor::Middle));
    canvas.end();
    bottom + 40.0
}

/// Panel with a value axis on the left, and another on the right for one more curve.
fn panel(
    canvas: &mut dyn Canvas,
    sheet: &Sheet,
    top: f64,
    (class, name, unit): (&str, &str, &str),
    left: &[Curve<'_>],
    right: Option<(&Curve<'_>, &str)>,
) -> f64 {
    canvas.begin(class);
    head(canvas, sheet, top, name, "");
    let rect = Rect { x: sheet.left, y: top + TOP, w: sheet.width, h: PANEL };
    grid(canvas, sheet, &rect);
    let mut x = sheet.left + sheet.letters.width(name, HEAD, true) + 14.0;
    for curve in left.iter().chain(right.map(|(curve, _)| curve)) {
        let y = top + 7.0;
        canvas.line(&[Point { x, y }, Point { x: x + 19.0, y }], &curve.stroke);
        canvas.text(Point { x: x + 24.0, y: top + 10.5 }, curve.name, &Font::new(TEXT, INK));
        x += 40.0 + sheet.letters.width(curve.name, TEXT, false);
    }
    let middle = rect.y + rect.h / 2.0;
    let font = Font::new(TEXT, INK).at(Anchor::Middle).upwards();
    canvas.text(Point { x: rect.x - 40.0, y: middle }, unit, &font);
    let ranges = left.iter().filter_map(|curve| curve.series.range());
    if let Some(range) = ranges.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) {
        let scale = Scale::new(range, &rect);
        for (value, text) in axis::numbers(scale.least, scale.most, 4) {
            let y = scale.y(value);
            canvas.line(&[Point { x: rect.x, y }, Point { x: rect.right(), y }], &Stroke::new(GRID, 0.8));
            canvas.text(Point { x: rect.x - 6.0, y: y + 3.5 }, &text, &Font::new(TEXT, GREY).at(Anchor::End));
        }
        left.iter().for_each(|curve| draw_curve(canvas, sheet, curve, &scale));
    } else if right.is_none_or(|(curve, _)| curve.series.range().is_none()) {
        let at = Point { x: rect.x + rect.w / 2.0, y: middle + 3.5 };
        canvas.text(at, "no data", &Font::new(TEXT, GREY).at(Anchor::Middle));
    }
    if let Some((curve, unit)) = right
        && let Some(range) = curve.series.range()
    {
        let scale = Scale::new(range, &rect);
        for (value, text) in axis::numbers(scale.least, scale.most, 4) {
            let at = Point { x: rect.right() + 6.0, y: scale.y(value) + 3.5 };
            canvas.text(at, &text, &Font::new(TEXT, GREY));
        }
        canvas.text(Point { x: rect.right() + 46.0, y: middle }, unit, &font);
        draw_curve(canvas, sheet, curve, &scale);
    }
    frame(canvas, &rect);
    canvas.end();
    rect.bottom() + GAP
}

/// Mapping from values to a panel.
struct Scale {
    least: f64,
    most: f64,
    bottom: f64,
    height: f64,
}

impl Scale {
    fn new((least, most): (f64, f64), rect: &Rect) -> Self {
        // Larger values are not plausible and would exceed the precision of floating point.
        let (least, most) = (least.clamp(-1e9, 1e9), most.clamp(-1e9, 1e9));
        let room = (0.08 * (most - least)).max(0.02 * most.abs()).max(0.01);
        Self { least: least - room, most: most + room, bottom: rect.bottom(), height: rect.h }
    }

    fn y(&self, value: f64) -> f64 {
        let value = value.clamp(self.least, self.most);
        self.bottom - (value - self.least) / (self.most - self.least) * self.height
    }
}

fn draw_curve(canvas: &mut dyn Canvas, sheet: &Sheet, curve: &Curve<'_>, scale: &Scale) {
    for line in curve.series.lines(curve.hold) {
        let place = |point: &Point| Point { x: sheet.x(point.x), y: scale.y(point.y) };
        match &line[..] {
            [alone] => canvas.disc(place(alone), curve.stroke.width, curve.stroke.colour, None),
            line => canvas.line(&line.iter().map(place).collect::<Vec<_>>(), &curve.stroke),
        }
    }
}
