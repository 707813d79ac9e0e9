//! Canvas of pixels, written as PNG.

use super::canvas::{Anchor, Canvas, Colour, Font, Stroke};
use super::letters::Letters;
use super::palette::palette;
use navitools::Point;
use tiny_skia::{FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, StrokeDash, Transform};

/// Pixels per unit of the page: sharp in print for a page of 1000 units.
const SCALE: f32 = 2.0;
/// Distance from the page's corner beyond which nothing is drawn, units; the rasterizer fails beyond it.
const REACH_UNITS: f64 = 10_000.0;

/// Page of pixels.
#[derive(Debug)]
pub struct Raster {
    pixels: Pixmap,
    letters: Letters,
}

impl Raster {
    /// White page of this size, units; `None` if it has no pixel, or too many.
    #[must_use]
    pub fn new(width: f64, height: f64) -> Option<Self> {
        let pixels = |units: f64| (units * f64::from(SCALE)).round() as u32;
        let (width, height) = (pixels(width), pixels(height));
        let mut pixels = Pixmap::new(width, height).filter(|_| width <= 8192 && height <= 16_384)?;
        pixels.fill(tiny_skia::Color::WHITE);
        Some(Self { pixels, letters: Letters })
    }

    /// Page as a PNG file.
    ///
    /// # Errors
    /// The encoder failed, which is not expected.
    pub fn finish(self) -> Result<Vec<u8>, String> {
        let (colours, places) = palette(self.pixels.data());
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, self.pixels.width(), self.pixels.height());
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_palette(colours);
        encoder.set_compression(png::Compression::High);
        // Differences of palette indices carry no information.
        encoder.set_filter(png::Filter::NoFilter);
        let written = encoder.write_header().and_then(|mut writer| {
            writer.write_image_data(&places)?;
            writer.finish()
        });
        written.map(|()| out).map_err(|error| error.to_string())
    }

    fn fill(&mut self, path: Option<Path>, colour: Colour, transform: Transform) {
        if let Some(path) = path {
            self.pixels.fill_path(&path, &paint(colour), FillRule::Winding, transform, None);
        }
    }

    fn stroke(&mut self, path: Option<&Path>, stroke: &Stroke) {
        let dash = (stroke.dash.0 > 0.0)
            .then(|| StrokeDash::new(vec![stroke.dash.0 as f32, stroke.dash.1 as f32], 0.0))
            .flatten();
        let line_cap = if dash.is_some() { LineCap::Butt } else { LineCap::Round };
        let how = tiny_skia::Stroke {
            width: stroke.width as f32,
            line_cap,
            line_join: LineJoin::Round,
            dash,
            ..tiny_skia::Stroke::default()
        };
        if let Some(path) = path {
            self.pixels.stroke_path(path, &paint(stroke.colour), &how, scaled(), None);
        }
    }
}

impl Canvas for Raster {
    fn begin(&mut self, _: &str) {}

    fn end(&mut self) {}

    fn line(&mut self, points: &[Point], stroke: &Stroke) {
        self.stroke(path(points, false).as_ref(), stroke);
    }

    fn area(&mut self, corners: &[Point], fill: Colour, edge: Option<&Stroke>) {
        let path = path(corners, true);
        self.fill(path.clone(), fill, scaled());
        if let Some(edge) = edge {
            self.stroke(path.as_ref(), edge);
        }
    }

    fn disc(&mut self, middle: Point, radius: f64, fill: Colour, edge: Option<&Stroke>) {
        let path = (near(middle) && radius < REACH_UNITS)
            .then(|| PathBuilder::from_circle(middle.x as f32, middle.y as f32, radius as f32))
            .flatten();
        self.fill(path.clone(), fill, scaled());
        if let Some(edge) = edge {
            self.stroke(path.as_ref(), edge);
        }
    }

    fn text(&mut self, at: Point, text: &str, font: &Font) {
        if !near(at) || text.len() > 10_000 {
            return;
        }
        let (path, units) = self.letters.outline(text, font.bold);
        let width = self.letters.width(text, font.size, font.bold) as f32;
        let begin = match font.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -width / 2.0,
            Anchor::End => -width,
        };
        let size = font.size as f32 / units;
        let place = scaled().pre_translate(at.x as f32, at.y as f32);
        let turned = if font.upwards { place.pre_rotate(-90.0) } else { place };
        self.fill(path, font.colour, turned.pre_translate(begin, 0.0).pre_scale(size, -size));
    }
}

/// True if a point can be drawn; false for NaN.
fn near(point: Point) -> bool {
    point.x.abs() < REACH_UNITS && point.y.abs() < REACH_UNITS
}

fn scaled() -> Transform {
    Transform::from_scale(SCALE, SCALE)
}

fn paint(colour: Colour) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    let [r, g, b] = colour.rgb;
    paint.set_color_rgba8(r, g, b, (colour.cover.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint
}

/// Path through these points; `None` if one cannot be drawn, or they form no path.
fn path(points: &[Point], closed: bool) -> Option<Path> {
    if !points.iter().all(|point| near(*point)) {
        return None;
    }
    let mut path = PathBuilder::new();
    for (n, point) in points.iter().enumerate() {
        match n {
            0 => path.move_to(point.x as f32, point.y as f32),
            _ => path.line_to(point.x as f32, point.y as f32),
        }
    }
    if closed && points.len() > 2 {
        path.close();
    }
    path.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(png: &[u8]) -> (u32, u32, Vec<u8>) {
        let mut decoder = png::Decoder::new(std::io::Cursor::new(png));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
        (info.width, info.height, pixels)
    }

    #[test]
    fn drawn_shapes_are_in_the_decoded_file() {
        let mut raster = Raster::new(100.0, 50.0).unwrap();
        let red = Colour::new(0xff0000);
        raster.area(&[(10.0, 10.0), (20.0, 10.0), (20.0, 20.0), (10.0, 20.0)].map(|(x, y)| Point { x, y }), red, None);
        raster.text(Point { x: 60.0, y: 40.0 }, "W", &Font::new(20.0, Colour::new(0)).at(Anchor::Middle));
        let (width, height, pixels) = decoded(&raster.finish().unwrap());
        assert_eq!((width, height), (200, 100));
        let pixel = |x: usize, y: usize| &pixels[3 * (y * 200 + x)..][..3];
        assert_eq!((pixel(30, 30), pixel(18, 30)), (&[255, 0, 0][..], &[255; 3][..]));
        let dark: Vec<usize> = (0..20_000).filter(|n| pixels[3 * n..3 * n + 3].iter().all(|part| *part < 40)).collect();
        assert!(
            dark.len() > 50 && dark.iter().all(|n| (98..142).contains(&(n % 200)) && n / 200 < 81),
            "{}",
            dark.len()
        );
    }

    #[test]
    fn nan_and_distant_coordinates_do_no_harm() {
        let mut raster = Raster::new(50.0, 50.0).unwrap();
        let (black, at) = (Colour::new(0), |x: f64, y: f64| Point { x, y });
        let stroke = Stroke::new(black, 1.0);
        for far in [f64::NAN, f64::INFINITY, -1e30, 1e9] {
            raster.line(&[at(0.0, 0.0), at(far, far)], &stroke.dashed(3.0, 2.0));
            raster.area(&[at(0.0, 0.0), at(far, 1.0), at(2.0, far)], black, Some(&stroke));
            raster.disc(at(far, 0.0), 1.0, black, None);
            raster.text(at(far, 0.0), "far", &Font::new(10.0, black).upwards());
        }
        raster.line(&[], &stroke);
        raster.line(&[at(1.0, 1.0)], &stroke);
        decoded(&raster.finish().unwrap());
        assert!(Raster::new(0.0, 10.0).is_none() && Raster::new(1e9, 1e9).is_none());
    }
}
