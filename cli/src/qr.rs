//! A text as a QR code of characters, two rows of modules in a line: for a phone's camera.

use qrcode::QrCode;
use qrcode::render::unicode::Dense1x2;

/// Black on white, whatever the terminal's colours are: not every reader takes an inverted code.
const BLACK_ON_WHITE: &str = "\x1b[38;5;16;48;5;231m";
const PLAIN: &str = "\x1b[0m";

/// Lines of a QR code with its margin; empty if the text is too long for one. Without colour dark modules are solid
/// blocks, which a reader needs to be darker than what is around them.
pub fn lines(text: &str, colour: bool) -> Vec<String> {
    let Ok(code) = QrCode::new(text) else { return Vec::new() };
    let picture = code.render::<Dense1x2>().build();
    let line = |line: &str| match colour {
        true => format!("{BLACK_ON_WHITE}{line}{PLAIN}"),
        false => line.to_owned(),
    };
    picture.lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Modules of the rendered code, true if dark, without its margin of 4.
    fn modules(text: &str) -> Vec<Vec<bool>> {
        let lines = lines(text, false);
        let width = lines[0].chars().count();
        let mut rows = Vec::new();
        for line in &lines {
            let of = |dark: [char; 2]| line.chars().map(|c| dark.contains(&c)).collect::<Vec<_>>();
            rows.extend([of(['\u{2588}', '\u{2580}']), of(['\u{2588}', '\u{2584}'])]);
        }
        assert!(rows[..4].iter().flatten().all(|dark| !dark), "its margin is light");
        rows[4..width - 4].iter().map(|row| row[4..width - 4].to_vec()).collect()
    }

    #[test]
    fn a_code_has_three_corners_and_fits_into_a_small_terminal() {
        let link = "http://192.168.100.100:8080/#12345678";
        let modules = modules(link);
        let size = modules.len();
        for (x, y) in [(0, 0), (size - 7, 0), (0, size - 7)] {
            let row = |n: usize| -> String {
                modules[y + n][x..x + 7].iter().map(|dark| if *dark { '#' } else { '.' }).collect()
            };
            let corner: Vec<String> = (0..7).map(row).collect();
            assert_eq!(corner, ["#######", "#.....#", "#.###.#", "#.###.#", "#.###.#", "#.....#", "#######"]);
        }
        let lines = lines(link, true);
        assert!(lines.len() <= 20 && lines.iter().all(|line| line.chars().filter(|c| !c.is_ascii()).count() <= 40));
        assert!(lines.iter().all(|line| line.starts_with(BLACK_ON_WHITE) && line.ends_with(PLAIN)));
    }

    #[test]
    fn a_text_that_is_too_long_has_none() {
        assert!(lines(&"x".repeat(4000), false).is_empty());
    }
}
