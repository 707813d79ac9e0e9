//! Page: headline, map, time line, lists; its height depends on the content.

use super::axis;
use super::canvas::{Canvas, Colour, Font, Stroke};
use super::data::{Picture, ReportGroup};
use super::letters::Letters;
use super::raster::Raster;
use super::style::{GREY, HEAD, INK, TEXT, TITLE};
use super::svg::Svg;
use super::timeline::letter;
use base::Fault;
use logger::run_name;
use navitools::Point;

/// Dimensions of the page, units.
const WIDTH: f64 = 1000.0;
const LEFT: f64 = 104.0;
const RIGHT: f64 = 60.0;
const TOP: f64 = 34.0;
/// Distance of the lines of a list.
const LINE: f64 = 14.0;
/// Maximum number of entries of the lists; the others are counted.
const REPORTS_MAX: usize = 10;
const REASONS_MAX: usize = 8;
const MARKS_MAX: usize = 8;

/// Properties common to all parts of a page.
pub struct Sheet {
    /// Left edge of panels.
    pub left: f64,
    /// Width of panels.
    pub width: f64,
    /// Beginning of the run, s since the UNIX epoch.
    pub from: f64,
    /// Duration of the run, s.
    pub seconds: f64,
    /// Ticks of the time axis: seconds after the beginning, and their labels.
    pub moments: Vec<(f64, String)>,
    /// Label of the time axis.
    pub time_label: String,
    /// Unit of the numbers beside the path.
    pub unit_in_words: &'static str,
    pub letters: Letters,
}

impl Sheet {
    /// Position of a time, units.
    pub fn x(&self, at: f64) -> f64 {
        self.left + ((at - self.from) / self.seconds).clamp(0.0, 1.0) * self.width
    }
}

impl Picture {
    /// Picture as SVG.
    #[must_use]
    pub fn svg(&self) -> String {
        let sheet = self.sheet();
        let mut svg = Svg::new(WIDTH, self.draw(&mut NullCanvas, &sheet));
        self.draw(&mut svg, &sheet);
        svg.finish()
    }

    /// Picture as PNG.
    ///
    /// # Errors
    /// One line with the reason: the picture would be too large, or the encoder failed.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        let sheet = self.sheet();
        let height = self.draw(&mut NullCanvas, &sheet);
        let mut raster =
            Raster::new(WIDTH, height).ok_or_else(|| format!("a page of {height:.0} lines is too large"))?;
        self.draw(&mut raster, &sheet);
        raster.finish()
    }

    fn sheet(&self) -> Sheet {
        let (from, to) = self.span.unwrap_or((0.0, 0.0));
        let seconds = (to - from).max(1.0);
        let width = WIDTH - LEFT - RIGHT;
        let (moments, unit) = axis::moments(seconds, 12);
        let unit_in_words = match unit {
            "s" => "time, s",
            "min:s" => "time, min:s",
            _ => "time, h:min",
        };
        let time_label = format!("time since {} UTC / {unit}", &date(from)[11..]);
        Sheet { left: LEFT, width, from, seconds, moments, time_label, unit_in_words, letters: Letters }
    }

    /// Draws everything; returns the height.
    fn draw(&self, canvas: &mut dyn Canvas, sheet: &Sheet) -> f64 {
        let top = self.draw_title(canvas, sheet);
        let top = self.draw_map(canvas, sheet, top);
        let top = self.draw_timeline(canvas, sheet, top + 8.0);
        let bottom = self.draw_lists(canvas, sheet, top);
        (bottom + 14.0).ceil()
    }

    fn draw_title(&self, canvas: &mut dyn Canvas, sheet: &Sheet) -> f64 {
        canvas.begin("title");
        let title = &self.title;
        let named = |name: &str, of: &str| if name.is_empty() { of.to_string() } else { format!("{name} · {of}") };
        let headline = named(&title.robot, if title.run.is_empty() { "a run" } else { &title.run });
        let headline = sheet.letters.fit(&headline, TITLE, true, WIDTH - LEFT - 20.0);
        canvas.text(Point { x: LEFT, y: TOP }, &headline, &Font::new(TITLE, INK).bold());
        let mut facts = vec![format!("{} UTC", date(sheet.from))];
        facts.push(match self.span {
            Some((from, to)) => axis::moment(to - from),
            None => "no time".into(),
        });
        let way = if self.truth.spots().is_empty() { &self.estimate } else { &self.truth };
        facts.push(format!("{:.1} m", way.distance()));
        facts.push(counted(self.contacts(), "contact"));
        facts.push(counted(self.errors[2].count, "error"));
        facts.push(counted(self.errors[1].count, "warning"));
        facts.extend(self.voltage.ends().map(|(first, last)| format!("{first:.2} to {last:.2} V")));
        facts.extend(Some(title.program.clone()).filter(|program| !program.is_empty()));
        let facts = sheet.letters.fit(&facts.join("  ·  "), HEAD, false, WIDTH - LEFT - 20.0);
        canvas.text(Point { x: LEFT, y: TOP + 19.0 }, &facts, &Font::new(HEAD, GREY));
        canvas.end();
        TOP + 36.0
    }

    /// Reports with a line in the list, in order of time: the most severe, and of these the first.
    pub(super) fn listed(&self) -> Vec<&ReportGroup> {
        let mut told: Vec<&ReportGroup> = self.texts.iter().collect();
        told.sort_by(|a, b| b.severity.cmp(&a.severity).then(a.first.total_cmp(&b.first)));
        told.truncate(REPORTS_MAX);
        told.sort_by(|a, b| a.first.total_cmp(&b.first));
        told
    }

    fn draw_lists(&self, canvas: &mut dyn Canvas, sheet: &Sheet, top: f64) -> f64 {
        let mut y = top;
        let since = |at: f64| axis::moment(at - sheet.from);
        let mut reasons: Vec<_> = self.reasons().into_iter().enumerate().collect();
        let more = reasons.len().saturating_sub(REASONS_MAX);
        // The longest, in order of their letters.
        reasons.sort_by(|(_, (_, a, _)), (_, (_, b, _))| b.total_cmp(a));
        reasons.truncate(REASONS_MAX);
        reasons.sort_by_key(|(n, _)| *n);
        let rows = reasons.into_iter().map(|(n, (what, seconds, times))| {
            let often = if times > 1 { format!(", {times} times") } else { String::new() };
            (letter(n), format!("{}{often}", axis::moment(seconds)), what)
        });
        y = list(canvas, sheet, y, ("Stops", "total duration and cause"), rows.collect(), more as u64);
        let listed = self.listed();
        let more = self.texts.len() as u64 - listed.len() as u64 + self.texts_left_out;
        let rows = listed
            .iter()
            .enumerate()
            .map(|(n, told)| ((n + 1).to_string(), since(told.first), line_of(told, told.last - sheet.from)));
        y = list(canvas, sheet, y, ("Reports", "first time and text"), rows.collect(), more);
        let rows = self.marks.iter().take(MARKS_MAX).enumerate();
        let rows = rows.map(|(n, (at, text))| (format!("M{}", n + 1), since(*at), text.clone()));
        let more = self.marks.len().saturating_sub(MARKS_MAX) as u64 + self.unmarked;
        y = list(canvas, sheet, y, ("Marks", ""), rows.collect(), more);
        self.draw_remarks(canvas, sheet, y)
    }

    /// Lists what the picture does not show.
    fn draw_remarks(&self, canvas: &mut dyn Canvas, sheet: &Sheet, mut y: f64) -> f64 {
        let lost: u64 = self.states.values().map(|lane| lane.lost).sum::<u64>() + self.stands().lost + self.pause.lost;
        let mut remarks = self.title.remarks.clone();
        let mut add = |count: u64, what: &str| {
            if count > 0 {
                remarks.push(format!("{count} {what}"));
            }
        };
        add(self.hidden_modules() as u64, "modules with fewer changes have no row");
        add(self.announcements_left_out, "announcements of modules beyond the maximum are left out");
        add(lost, "changes of states or reasons are left out");
        add(self.implausible, "messages with implausible timestamps are left out");
        canvas.begin("remarks");
        for remark in remarks.iter().take(REPORTS_MAX) {
            let text = sheet.letters.fit(remark, TEXT, false, WIDTH - LEFT - 20.0);
            canvas.text(Point { x: LEFT, y: y + 10.0 }, &text, &Font::new(TEXT, GREY));
            y += LINE;
        }
        canvas.end();
        y
    }
}

/// List below the time line: (sign, time, text) each.
fn list(
    canvas: &mut dyn Canvas,
    sheet: &Sheet,
    top: f64,
    (name, explained): (&str, &str),
    rows: Vec<(String, String, String)>,
    more: u64,
) -> f64 {
    if rows.is_empty() {
        return top;
    }
    canvas.begin("list");
    let mut y = top + 14.0;
    canvas.text(Point { x: LEFT, y }, name, &Font::new(HEAD, INK).bold());
    let x = LEFT + sheet.letters.width(name, HEAD, true) + 10.0;
    canvas.text(Point { x, y }, explained, &Font::new(TEXT, GREY));
    for (sign, time, words) in rows {
        y += LINE;
        canvas.text(Point { x: LEFT, y }, &sign, &Font::new(TEXT, INK).bold());
        canvas.text(Point { x: LEFT + 26.0, y }, &time, &Font::new(TEXT, GREY));
        let x = LEFT + 36.0 + sheet.letters.width(&time, TEXT, false).max(84.0);
        let words = sheet.letters.fit(&words, TEXT, false, WIDTH - 20.0 - x);
        canvas.text(Point { x, y }, &words, &Font::new(TEXT, INK));
    }
    if more > 0 {
        y += LINE;
        canvas.text(Point { x: LEFT + 26.0, y }, &format!("and {more} more"), &Font::new(TEXT, GREY));
    }
    canvas.end();
    y + 8.0
}

fn line_of(told: &ReportGroup, last: f64) -> String {
    let severity = ["notice", "warning", "ERROR"][told.severity];
    let known = Fault::ALL.iter().find(|fault| i32::from(**fault as u16) == told.number);
    let name = known.map_or(format!("0x{:04X}", told.number), |fault| fault.name().to_string());
    let often =
        if told.times > 1 { format!(" ({} times, last {})", told.times, axis::moment(last)) } else { String::new() };
    format!("{severity}  {} {name}: {}{often}", told.module, told.message)
}

fn counted(count: u64, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Seconds since the UNIX epoch as `2026-11-22 09:40:01`.
fn date(at: f64) -> String {
    // An unset clock may be far off; the limit avoids long loops over years.
    let name = run_name(at.clamp(0.0, 4e9) as u64);
    name[..10].replace('_', "-") + " " + &name[11..].replace('_', ":")
}

/// Canvas that draws nothing, to measure the height of a page.
struct NullCanvas;

impl Canvas for NullCanvas {
    fn begin(&mut self, _: &str) {}
    fn end(&mut self) {}
    fn line(&mut self, _: &[Point], _: &Stroke) {}
    fn area(&mut self, _: &[Point], _: Colour, _: Option<&Stroke>) {}
    fn disc(&mut self, _: Point, _: f64, _: Colour, _: Option<&Stroke>) {}
    fn text(&mut self, _: Point, _: &str, _: &Font) {}
}
