//! Letters of a picture: outlines and text widths. DejaVu Sans, reduced by the build script.

use tiny_skia::{Path, PathBuilder};

include!(concat!(env!("OUT_DIR"), "/letters.rs"));

/// Font face.
#[derive(Debug)]
struct Face {
    /// Units per em.
    units: u16,
    /// Glyphs in order of their letters; the first one is drawn for missing letters.
    glyphs: &'static [Glyph],
    /// Operations (0 move, 1 line, 2 curve, 3 close) with their points.
    outlines: &'static [i16],
}

#[derive(Debug)]
struct Glyph {
    letter: char,
    advance: u16,
    /// Beginning and end of its outline.
    outline: (usize, usize),
}

impl Face {
    fn glyph(&self, letter: char) -> &'static Glyph {
        let letter = if letter.is_control() { ' ' } else { letter };
        let place = self.glyphs.binary_search_by_key(&letter, |glyph| glyph.letter);
        &self.glyphs[place.unwrap_or(0)]
    }

    /// Draws a letter at `x`.
    fn draw(&self, glyph: &Glyph, x: f32, path: &mut PathBuilder) {
        let mut numbers = self.outlines[glyph.outline.0..glyph.outline.1].iter().copied().map(f32::from);
        let mut next = || numbers.next();
        while let Some(what) = next() {
            let mut point = || Some((x + next()?, next()?));
            match what as u8 {
                0 => point().into_iter().for_each(|(x, y)| path.move_to(x, y)),
                1 => point().into_iter().for_each(|(x, y)| path.line_to(x, y)),
                2 => point().zip(point()).into_iter().for_each(|((x1, y1), (x, y))| path.quad_to(x1, y1, x, y)),
                _ => path.close(),
            }
        }
    }
}

/// Both weights.
#[derive(Clone, Copy, Debug, Default)]
pub struct Letters;

impl Letters {
    /// Width of a text of this size.
    #[must_use]
    pub fn width(&self, text: &str, size: f64, bold: bool) -> f64 {
        let face = face(bold);
        let units: f64 = text.chars().map(|letter| f64::from(face.glyph(letter).advance)).sum();
        units * size / f64::from(face.units)
    }

    /// Text shortened to `room`, with an ellipsis for the rest.
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

    /// Outline of a text in font units, y up, and the number of units per em.
    #[must_use]
    pub fn outline(&self, text: &str, bold: bool) -> (Option<Path>, f32) {
        let face = face(bold);
        let (mut path, mut x) = (PathBuilder::new(), 0.0);
        for letter in text.chars() {
            let glyph = face.glyph(letter);
            face.draw(glyph, x, &mut path);
            x += f32::from(glyph.advance);
        }
        (path.finish(), f32::from(face.units))
    }
}

fn face(bold: bool) -> &'static Face {
    if bold { &BOLD } else { &REGULAR }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_letters_that_pictures_use_are_there() {
        let letters = Letters;
        for c in ('!'..='~').chain("·°²±×µσ…–áčďéěíňóřšťúůýžÁŽäöüß".chars()) {
            assert_eq!(REGULAR.glyph(c).letter, c);
            assert!(letters.outline(&c.to_string(), true).0.is_some(), "{c}");
        }
        // Other letters are boxes.
        assert_eq!(REGULAR.glyph('火').letter, '\0');
        assert!(letters.outline("火", false).0.is_some());
    }

    #[test]
    fn texts_are_shortened_to_their_width() {
        let letters = Letters;
        let whole = letters.width("the robot stands", 10.0, false);
        assert!((60.0..100.0).contains(&whole), "{whole}");
        assert_eq!(letters.fit("the robot stands", 10.0, false, whole), "the robot stands");
        let cut = letters.fit("the robot stands", 10.0, false, 0.6 * whole);
        assert!(cut.ends_with('…') && letters.width(&cut, 10.0, false) <= 0.6 * whole, "{cut}");
        assert_eq!(letters.fit("the robot", 10.0, false, 0.0), "…");
        assert!(letters.width("bold", 10.0, true) > letters.width("bold", 10.0, false));
    }
}
