//! What a picture is drawn on: lines, areas, discs and words, in units of the page, y down. Two canvasses: [`super::svg`]
//! and [`super::raster`].

use navitools::Point;

/// A colour, of which so much covers what is below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colour {
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// 0..=1.
    pub cover: f32,
}

impl Colour {
    /// One that covers all, as `0xRRGGBB`.
    #[must_use]
    pub const fn new(rgb: u32) -> Self {
        let [_, r, g, b] = rgb.to_be_bytes();
        Self { rgb: [r, g, b], cover: 1.0 }
    }

    /// The same, covering so much.
    #[must_use]
    pub const fn cover(self, cover: f32) -> Self {
        Self { cover, ..self }
    }
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Stroke {
    /// Its colour.
    pub colour: Colour,
    /// How wide, units.
    pub width: f64,
    /// Length of dashes and of the gaps between, units; (0, 0): none.
    pub dash: (f64, f64),
}

impl Stroke {
    /// A whole line.
    #[must_use]
    pub const fn new(colour: Colour, width: f64) -> Self {
        Self { colour, width, dash: (0.0, 0.0) }
    }

    /// The same, dashed.
    #[must_use]
    pub const fn dashed(self, on: f64, off: f64) -> Self {
        Self { dash: (on, off), ..self }
    }
}

/// Which end of the words is at the place that is named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The first letter.
    Start,
    /// The middle.
    Middle,
    /// The last letter.
    End,
}

/// How words are drawn.
#[derive(Clone, Copy, Debug)]
pub struct Font {
    /// Height of the letters, units.
    pub size: f64,
    /// Whether they are bold.
    pub bold: bool,
    /// Their colour.
    pub colour: Colour,
    /// Where they begin.
    pub anchor: Anchor,
    /// Whether they run upwards.
    pub upwards: bool,
}

impl Font {
    /// Plain words of this size, from left to right.
    #[must_use]
    pub const fn new(size: f64, colour: Colour) -> Self {
        Self { size, bold: false, colour, anchor: Anchor::Start, upwards: false }
    }

    /// The same, bold.
    #[must_use]
    pub const fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    /// The same, anchored there.
    #[must_use]
    pub const fn at(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    /// The same, upwards.
    #[must_use]
    pub const fn upwards(self) -> Self {
        Self { upwards: true, ..self }
    }
}

/// A page to draw on. What is not a number is not drawn.
pub trait Canvas {
    /// What follows, up to [`Canvas::end`], belongs together under this name; names are words of our own.
    fn begin(&mut self, name: &str);
    /// Ends the innermost group.
    fn end(&mut self);
    /// A line through these points.
    fn line(&mut self, points: &[Point], stroke: &Stroke);
    /// A filled area.
    fn area(&mut self, corners: &[Point], fill: Colour, edge: Option<&Stroke>);
    /// A filled disc.
    fn disc(&mut self, middle: Point, radius: f64, fill: Colour, edge: Option<&Stroke>);
    /// Words whose base line begins, ends or has its middle at a point.
    fn text(&mut self, at: Point, text: &str, font: &Font);
}

/// A rectangle of the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    /// Left.
    pub x: f64,
    /// Top.
    pub y: f64,
    /// Width.
    pub w: f64,
    /// Height.
    pub h: f64,
}

impl Rect {
    /// The right edge.
    #[must_use]
    pub fn right(&self) -> f64 {
        self.x + self.w
    }

    /// The lower edge.
    #[must_use]
    pub fn bottom(&self) -> f64 {
        self.y + self.h
    }

    /// Its corners.
    #[must_use]
    pub fn corners(&self) -> [Point; 4] {
        let (right, bottom) = (self.right(), self.bottom());
        [(self.x, self.y), (right, self.y), (right, bottom), (self.x, bottom)].map(|(x, y)| Point { x, y })
    }

    /// Whether a point is in it.
    #[must_use]
    pub fn has(&self, point: Point) -> bool {
        (self.x..=self.right()).contains(&point.x) && (self.y..=self.bottom()).contains(&point.y)
    }

    /// The part of a line from `a` to `b` that is in it.
    #[must_use]
    pub fn cut(&self, a: Point, b: Point) -> Option<(Point, Point)> {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        // Liang and Barsky: for each edge how fast the line leaves by it, and how far from it it begins.
        let edges = [(-dx, a.x - self.x), (dx, self.right() - a.x), (-dy, a.y - self.y), (dy, self.bottom() - a.y)];
        for (speed, distance) in edges {
            if speed < 0.0 {
                enter = enter.max(distance / speed);
            } else if speed > 0.0 {
                leave = leave.min(distance / speed);
            } else if distance < 0.0 {
                return None;
            }
        }
        let at = |t: f64| Point { x: a.x + t * dx, y: a.y + t * dy };
        (enter <= leave).then(|| (at(enter), at(leave)))
    }

    /// The parts of a line that are in it.
    #[must_use]
    pub fn cut_line(&self, points: &[Point]) -> Vec<Vec<Point>> {
        let mut parts: Vec<Vec<Point>> = Vec::new();
        let mut open = false;
        for pair in points.windows(2) {
            let Some((a, b)) = self.cut(pair[0], pair[1]) else {
                open = false;
                continue;
            };
            match parts.last_mut().filter(|_| open && a == pair[0]) {
                Some(part) => part.push(b),
                None => parts.push(vec![a, b]),
            }
            open = b == pair[1];
        }
        parts
    }
}

/// Lines at 45° that fill a rectangle, so far apart; falling ones, or rising.
#[must_use]
pub fn hatch(rect: &Rect, apart: f64, falls: bool) -> Vec<[Point; 2]> {
    let mut lines = Vec::new();
    // Counted from the page's corner, so that rectangles side by side go on in each other.
    let low = if falls { rect.x - rect.bottom() } else { rect.x + rect.y };
    let reach = rect.w + rect.h;
    let mut along = (low / apart).ceil() * apart;
    while apart > 0.1 && along <= low + reach && lines.len() < 2000 {
        let at = |y: f64| Point { x: if falls { along + y } else { along - y }, y };
        lines.extend(rect.cut(at(rect.y), at(rect.bottom())).map(|(a, b)| [a, b]));
        along += apart;
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECT: Rect = Rect { x: 0.0, y: 0.0, w: 10.0, h: 5.0 };

    fn point(x: f64, y: f64) -> Point {
        Point { x, y }
    }

    #[test]
    fn a_line_is_cut_where_it_leaves_and_comes_back() {
        let line =
            [point(-5.0, 1.0), point(5.0, 1.0), point(5.0, 9.0), point(8.0, 9.0), point(8.0, 1.0), point(9.0, 1.0)];
        let parts = RECT.cut_line(&line);
        assert_eq!(
            parts,
            [
                vec![point(0.0, 1.0), point(5.0, 1.0), point(5.0, 5.0)],
                vec![point(8.0, 5.0), point(8.0, 1.0), point(9.0, 1.0)],
            ]
        );
        assert!(RECT.cut_line(&[point(-1.0, 2.0), point(-1.0, 3.0)]).is_empty());
        assert!(RECT.cut(point(f64::NAN, 1.0), point(f64::NAN, 2.0)).is_none_or(|(a, _)| a.x.is_nan()));
    }

    #[test]
    fn hatching_stays_within() {
        for falls in [false, true] {
            let lines = hatch(&RECT, 1.0, falls);
            assert!((10..=20).contains(&lines.len()), "{}", lines.len());
            let near = Rect { x: -1e-9, y: -1e-9, w: 10.0 + 2e-9, h: 5.0 + 2e-9 };
            assert!(lines.iter().flatten().all(|point| near.has(*point)), "{lines:?}");
        }
    }
}
