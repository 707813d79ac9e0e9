//! The letters of a picture: their outlines, and how wide words are. Noto Sans, cut down (`font/README.md`).

use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

const REGULAR: &[u8] = include_bytes!("font/NotoSans-Regular.ttf");
const BOLD: &[u8] = include_bytes!("font/NotoSans-Bold.ttf");

/// Both weights.
pub struct Letters {
    regular: Face<'static>,
    bold: Face<'static>,
}

impl std::fmt::Debug for Letters {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Letters")
    }
}

impl Default for Letters {
    fn default() -> Self {
        let face = |bytes| Face::parse(bytes, 0).expect("the font is part of the program, and a test reads it");
        Self { regular: face(REGULAR), bold: face(BOLD) }
    }
}

impl Letters {
    /// How wide words of this size are.
    #[must_use]
    pub fn width(&self, text: &str, size: f64, bold: bool) -> f64 {
        let face = self.face(bold);
        let units: f64 = text.chars().map(|c| f64::from(advance(face, glyph(face, c)))).sum();
        units * size / f64::from(face.units_per_em())
    }

    /// As much of the words as has room within `room`; what is left out shows as an ellipsis.
    #[must_use]
    pub fn fit(&self, text: &str, size: f64, bold: bool, room: f64) -> String {
        if self.width(text, size, bold) <= room {
            return text.into();
        }
        let room = room - self.width("…", size, bold);
        let mut fits = String::new();
        for c in text.chars() {
            fits.push(c);
            if self.width(&fits, size, bold) > room {
                fits.pop();
                break;
            }
        }
        fits.truncate(fits.trim_end().len());
        fits.push('…');
        fits
    }

    /// The outline of words in font units, y up, and how many units the size of the letters has.
    #[must_use]
    pub fn outline(&self, text: &str, bold: bool) -> (Option<Path>, f32) {
        let face = self.face(bold);
        let mut pen = Pen { path: PathBuilder::new(), x: 0.0 };
        for c in text.chars() {
            let glyph = glyph(face, c);
            face.outline_glyph(glyph, &mut pen);
            pen.x += f32::from(advance(face, glyph));
        }
        (pen.path.finish(), f32::from(face.units_per_em()))
    }

    fn face(&self, bold: bool) -> &Face<'static> {
        if bold { &self.bold } else { &self.regular }
    }
}

fn glyph(face: &Face<'_>, c: char) -> GlyphId {
    let c = if c.is_control() { ' ' } else { c };
    face.glyph_index(c).unwrap_or(GlyphId(0))
}

fn advance(face: &Face<'_>, glyph: GlyphId) -> u16 {
    face.glyph_hor_advance(glyph).unwrap_or(0)
}

/// Draws glyphs one after another.
struct Pen {
    path: PathBuilder,
    x: f32,
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.path.move_to(self.x + x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.path.line_to(self.x + x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.path.quad_to(self.x + x1, y1, self.x + x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.path.cubic_to(self.x + x1, y1, self.x + x2, y2, self.x + x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_letters_that_pictures_use_are_there() {
        let letters = Letters::default();
        for c in ('!'..='~').chain("·°²±×µσ…–áčďéěíňóřšťúůýžÁŽäöüß".chars()) {
            assert_ne!(glyph(&letters.regular, c), GlyphId(0), "{c}");
            assert!(letters.outline(&c.to_string(), true).0.is_some(), "{c}");
        }
        // Others are boxes, and no more than that.
        assert_eq!(glyph(&letters.regular, '火'), GlyphId(0));
        assert!(letters.outline("火", false).0.is_some());
    }

    #[test]
    fn words_are_cut_to_their_room() {
        let letters = Letters::default();
        let whole = letters.width("the robot stands", 10.0, false);
        assert!((60.0..100.0).contains(&whole), "{whole}");
        assert_eq!(letters.fit("the robot stands", 10.0, false, whole), "the robot stands");
        let cut = letters.fit("the robot stands", 10.0, false, 0.6 * whole);
        assert!(cut.ends_with('…') && letters.width(&cut, 10.0, false) <= 0.6 * whole, "{cut}");
        assert_eq!(letters.fit("the robot", 10.0, false, 0.0), "…");
        assert!(letters.width("bold", 10.0, true) > letters.width("bold", 10.0, false));
    }
}
