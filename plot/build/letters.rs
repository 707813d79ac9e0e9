//! Extracts the letters of `advee plot` from DejaVu Sans: outlines and widths of Latin letters and some signs, as
//! tables in the program instead of two fonts of 0.7 MB.

use std::fmt::Write;
use std::path::Path;
use std::{env, fs};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// Characters of labels: Latin languages, some Greek, dashes, quotes, per mille, minutes and seconds.
const LETTERS: &[std::ops::RangeInclusive<u32>] = &[
    0x20..=0x7E,
    0xA0..=0x17F,
    0x394..=0x394,
    0x3B1..=0x3B1,
    0x3B8..=0x3B8,
    0x3C3..=0x3C3,
    0x3C9..=0x3C9,
    0x2013..=0x2014,
    0x2018..=0x201E,
    0x2022..=0x2022,
    0x2026..=0x2026,
    0x2030..=0x2033,
];

/// Outlines as numbers: operation, then its points.
struct Pen(Vec<i16>);

impl Pen {
    fn put(&mut self, what: i16, points: &[f32]) {
        self.0.push(what);
        self.0.extend(points.iter().map(|value| *value as i16));
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.put(0, &[x, y]);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.put(1, &[x, y]);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.put(2, &[x1, y1, x, y]);
    }

    fn curve_to(&mut self, _: f32, _: f32, _: f32, _: f32, _: f32, _: f32) {
        unreachable!("a TrueType font has quadratic curves only");
    }

    fn close(&mut self) {
        self.put(3, &[]);
    }
}

fn cut(out: &mut String, name: &str, font: &[u8]) {
    let face = Face::parse(font, 0).expect("the package has a font");
    let mut pen = Pen(Vec::new());
    let mut glyphs = Vec::new();
    let letters = LETTERS.iter().cloned().flatten().filter_map(char::from_u32);
    let found = letters.filter_map(|letter| Some((letter, face.glyph_index(letter)?)));
    // First the glyph for a missing letter.
    for (letter, glyph) in std::iter::once(('\0', GlyphId(0))).chain(found) {
        let begin = pen.0.len();
        face.outline_glyph(glyph, &mut pen);
        glyphs.push((letter, face.glyph_hor_advance(glyph).unwrap_or(0), begin, pen.0.len()));
    }
    let units = face.units_per_em();
    writeln!(out, "static {name}: Face = Face {{ units: {units}, glyphs: &[").expect("a text takes text");
    for (letter, advance, begin, end) in glyphs {
        writeln!(out, "    Glyph {{ letter: {letter:?}, advance: {advance}, outline: ({begin}, {end}) }},")
            .expect("a text takes text");
    }
    writeln!(out, "], outlines: &{:?} }};", pen.0).expect("a text takes text");
}

/// Tables of both faces.
fn tables() -> String {
    let mut out = String::new();
    cut(&mut out, "REGULAR", dejavu::sans::regular());
    cut(&mut out, "BOLD", dejavu::sans::bold());
    out
}

fn main() {
    println!("cargo::rerun-if-changed=build");
    let folder = env::var("OUT_DIR").expect("cargo sets it for build scripts");
    fs::write(Path::new(&folder).join("letters.rs"), tables()).expect("OUT_DIR can be written");
}
