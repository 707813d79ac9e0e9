//! Canvas for SVG 1.1, without scripts, styles and references.

use super::canvas::{Anchor, Canvas, Colour, Font, Stroke};
use navitools::Point;
use std::fmt::Write;

/// SVG text being written.
#[derive(Debug)]
pub struct Svg {
    out: String,
}

impl Svg {
    /// White page of this size, units; a unit is a pixel by default.
    #[must_use]
    pub fn new(width: f64, height: f64) -> Self {
        let out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" viewBox=\"0 0 \
             {width:.0} {height:.0}\" font-family=\"'DejaVu Sans','Noto Sans',Arial,sans-serif\" \
             fill=\"none\" stroke-linejoin=\"round\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        Self { out }
    }

    /// Complete text.
    #[must_use]
    pub fn finish(mut self) -> String {
        self.out.push_str("</svg>\n");
        self.out
    }

    fn points(&mut self, points: &[Point]) {
        for (n, point) in points.iter().enumerate() {
            let gap = if n == 0 { "" } else { " " };
            let _ = write!(self.out, "{gap}{},{}", Short(point.x), Short(point.y));
        }
    }

    fn stroke(&mut self, stroke: &Stroke) {
        let _ = write!(self.out, " stroke=\"{}\" stroke-width=\"{}\"", Hex(stroke.colour), Short(stroke.width));
        if stroke.colour.cover < 1.0 {
            let _ = write!(self.out, " stroke-opacity=\"{}\"", stroke.colour.cover);
        }
        if stroke.dash.0 > 0.0 {
            let _ = write!(self.out, " stroke-dasharray=\"{} {}\"", Short(stroke.dash.0), Short(stroke.dash.1));
        }
    }

    fn filled(&mut self, fill: Colour, edge: Option<&Stroke>) {
        let _ = write!(self.out, " fill=\"{}\"", Hex(fill));
        if fill.cover < 1.0 {
            let _ = write!(self.out, " fill-opacity=\"{}\"", fill.cover);
        }
        if let Some(edge) = edge {
            self.stroke(edge);
        }
        self.out.push_str("/>\n");
    }
}

impl Canvas for Svg {
    fn begin(&mut self, name: &str) {
        let _ = write!(self.out, "<g class=\"");
        escape(&mut self.out, name);
        self.out.push_str("\">\n");
    }

    fn end(&mut self) {
        self.out.push_str("</g>\n");
    }

    fn line(&mut self, points: &[Point], stroke: &Stroke) {
        if points.len() < 2 || !all_numbers(points) {
            return;
        }
        self.out.push_str("<polyline points=\"");
        self.points(points);
        self.out.push('"');
        self.stroke(stroke);
        self.out.push_str("/>\n");
    }

    fn area(&mut self, corners: &[Point], fill: Colour, edge: Option<&Stroke>) {
        if corners.len() < 3 || !all_numbers(corners) {
            return;
        }
        self.out.push_str("<polygon points=\"");
        self.points(corners);
        self.out.push('"');
        self.filled(fill, edge);
    }

    fn disc(&mut self, middle: Point, radius: f64, fill: Colour, edge: Option<&Stroke>) {
        if !all_numbers(&[middle]) || !radius.is_finite() {
            return;
        }
        let _ =
            write!(self.out, "<circle cx=\"{}\" cy=\"{}\" r=\"{}\"", Short(middle.x), Short(middle.y), Short(radius));
        self.filled(fill, edge);
    }

    fn text(&mut self, at: Point, text: &str, font: &Font) {
        if !all_numbers(&[at]) || text.is_empty() {
            return;
        }
        let (x, y) = (Short(at.x), Short(at.y));
        let _ = write!(self.out, "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" fill=\"{}\"", font.size, Hex(font.colour));
        if font.bold {
            self.out.push_str(" font-weight=\"bold\"");
        }
        self.out.push_str(match font.anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        });
        if font.upwards {
            let _ = write!(self.out, " transform=\"rotate(-90 {x} {y})\"");
        }
        self.out.push('>');
        escape(&mut self.out, text);
        self.out.push_str("</text>\n");
    }
}

fn all_numbers(points: &[Point]) -> bool {
    points.iter().all(|point| point.x.is_finite() && point.y.is_finite())
}

/// Number rounded to a hundredth.
struct Short(f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", (self.0 * 100.0).round() / 100.0 + 0.0)
    }
}

struct Hex(Colour);

impl std::fmt::Display for Hex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [r, g, b] = self.0.rgb;
        write!(f, "#{r:02x}{g:02x}{b:02x}")
    }
}

/// Escapes a text for XML; characters that XML does not allow become spaces.
fn escape(out: &mut String, text: &str) {
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\u{fffe}' | '\u{ffff}' => out.push(' '),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_texts_are_escaped_and_nan_is_left_out() {
        let mut svg = Svg::new(100.0, 50.0);
        let at = |x: f64| Point { x, y: 1.234 };
        svg.begin("a\"b");
        svg.text(at(1.0), "</text><script>&\"\u{7}\u{ffff}", &Font::new(10.0, Colour::new(0x010203)));
        svg.line(&[at(0.0), at(f64::NAN)], &Stroke::new(Colour::new(0), 1.0));
        svg.disc(at(0.0), f64::INFINITY, Colour::new(0), None);
        svg.area(&[at(0.0), at(-0.001), at(2.0)], Colour::new(0xff0000).cover(0.5), None);
        svg.end();
        let text = svg.finish();
        assert!(text.contains("<g class=\"a&quot;b\">"), "{text}");
        assert!(text.contains("fill=\"#010203\">&lt;/text&gt;&lt;script&gt;&amp;&quot;  </text>"), "{text}");
        assert!(text.contains("points=\"0,1.23 0,1.23 2,1.23\" fill=\"#ff0000\" fill-opacity=\"0.5\""), "{text}");
        assert!(!text.contains("NaN") && !text.contains("inf") && !text.contains("<polyline"), "{text}");
    }
}
