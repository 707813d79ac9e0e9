//! Drawing surface: lines, areas, discs and text, in units of the page, y down. Implementations: [`super::svg`] and
//! [`super::raster`].

use navitools::Point;

/// Colour with opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colour {
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// Opacity, 0..=1.
    pub cover: f32,
}

impl Colour {
    /// Opaque colour from `0xRRGGBB`.
    #[must_use]
    pub const fn new(rgb: u32) -> Self {
        let [_, r, g, b] = rgb.to_be_bytes();
        Self { rgb: [r, g, b], cover: 1.0 }
    }

    /// Same colour with this opacity.
    #[must_use]
    pub const fn cover(self, cover: f32) -> Self {
        Self { cover, ..self }
    }
}

/// Style of a line.
#[derive(Clone, Copy, Debug)]
pub struct Stroke {
    /// Colour.
    pub colour: Colour,
    /// Width, units.
    pub width: f64,
    /// Length of dashes and of the gaps between, units; (0, 0) for a solid line.
    pub dash: (f64, f64),
}

impl Stroke {
    /// Solid line.
    #[must_use]
    pub const fn new(colour: Colour, width: f64) -> Self {
        Self { colour, width, dash: (0.0, 0.0) }
    }

    /// Same line, dashed.
    #[must_use]
    pub const fn dashed(self, on: f64, off: f64) -> Self {
        Self { dash: (on, off), ..self }
    }
}

/// Position of the anchor point in a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Beginning.
    Start,
    /// Middle.
    Middle,
    /// End.
    End,
}

/// Style of a text.
#[derive(Clone, Copy, Debug)]
pub struct Font {
    /// Height of the letters, units.
    pub size: f64,
    /// True for bold letters.
    pub bold: bool,
    /// Colour.
    pub colour: Colour,
    /// Position of the anchor point.
    pub anchor: Anchor,
    /// True for text that runs upwards.
    pub upwards: bool,
}

impl Font {
    /// Plain text of this size, from left to right.
    #[must_use]
    pub const fn new(size: f64, colour: Colour) -> Self {
        Self { size, bold: false, colour, anchor: Anchor::Start, upwards: false }
    }

    /// Same style, bold.
    #[must_use]
    pub const fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    /// Same style with this anchor.
    #[must_use]
    pub const fn at(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    /// Same style, upwards.
    #[must_use]
    pub const fn upwards(self) -> Self {
        Self { upwards: true, ..self }
    }
}

/// Page to draw on. Coordinates that are not finite are not drawn.
pub trait Canvas {
    /// Begins a named group, up to [`Canvas::end`].
    fn begin(&mut self, name: &str);
    /// Ends the innermost group.
    fn end(&mut self);
    /// Draws a line through these points.
    fn line(&mut self, points: &[Point], stroke: &Stroke);
    /// Draws a filled area.
    fn area(&mut self, corners: &[Point], fill: Colour, edge: Option<&Stroke>);
    /// Draws a filled disc.
    fn disc(&mut self, middle: Point, radius: f64, fill: Colour, edge: Option<&Stroke>);
    /// Draws a text whose base line begins, ends or has its middle at a point.
    fn text(&mut self, at: Point, text: &str, font: &Font);
}

/// Rectangle of the page.
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
    /// Right edge.
    #[must_use]
    pub fn right(&self) -> f64 {
        self.x + self.w
    }

    /// Lower edge.
    #[must_use]
    pub fn bottom(&self) -> f64 {
        self.y + self.h
    }

    /// Corners.
    #[must_use]
    pub fn corners(&self) -> [Point; 4] {
        let (right, bottom) = (self.right(), self.bottom());
        [(self.x, self.y), (right, self.y), (right, bottom), (self.x, bottom)].map(|(x, y)| Point { x, y })
    }

    /// True if the point is inside.
    #[must_use]
    pub fn has(&self, point: Point) -> bool {
        (self.x..=self.right()).contains(&point.x) && (self.y..=self.bottom()).contains(&point.y)
    }

    /// Part of a line from `a` to `b` that is inside.
    #[must_use]
    pub fn cut(&self, a: Point, b: Point) -> Option<(Point, Point)> {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        // Liang and Barsky: for each edge the rate at which the line leaves by it, and its distance at the beginning.
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

    /// Parts of a line that are inside.
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

/// Lines at 45° that fill a rectangle, at this distance; falling or rising ones.
#[must_use]
pub fn hatch(rect: &Rect, apart: f64, falls: bool) -> Vec<[Point; 2]> {
    let mut lines = Vec::new();
    // Counted from the page's corner, so that the hatching of adjacent rectangles is continuous.
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
