//! Palette images of at most 256 colours: half the file size, without a visible difference in a picture of lines and
//! letters.

use std::collections::HashMap;

/// Maximum number of colours of a palette.
const COLOURS_MAX: usize = 256;

/// Palette of opaque pixels (four bytes each) as bytes red, green, blue, and the index of each pixel: the most frequent
/// colours; others are replaced by the nearest of them.
#[must_use]
pub fn palette(pixels: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let mut counts: HashMap<[u8; 3], u32> = HashMap::new();
    for run in runs(pixels) {
        *counts.entry(run.0).or_default() += run.1;
    }
    let mut colours: Vec<([u8; 3], u32)> = counts.iter().map(|(colour, count)| (*colour, *count)).collect();
    colours.sort_by_key(|(colour, count)| (std::cmp::Reverse(*count), *colour));
    let kept: Vec<[u8; 3]> = colours.iter().take(COLOURS_MAX).map(|(colour, _)| *colour).collect();
    let place: HashMap<[u8; 3], u8> = colours.iter().map(|(colour, _)| (*colour, nearest(&kept, *colour))).collect();
    let mut places = Vec::with_capacity(pixels.len() / 4);
    for (colour, count) in runs(pixels) {
        places.extend(std::iter::repeat_n(place[&colour], count as usize));
    }
    (kept.concat(), places)
}

/// Runs of pixels of one colour, of which most of a page consists.
fn runs(pixels: &[u8]) -> impl Iterator<Item = ([u8; 3], u32)> + '_ {
    let colours = pixels.as_chunks::<4>().0;
    colours.chunk_by(|a, b| a == b).map(|run| ([run[0][0], run[0][1], run[0][2]], run.len() as u32))
}

fn nearest(kept: &[[u8; 3]], colour: [u8; 3]) -> u8 {
    let distance = |other: &[u8; 3]| -> u32 {
        other.iter().zip(colour).map(|(a, b)| u32::from(a.abs_diff(b)) * u32::from(a.abs_diff(b))).sum()
    };
    let best = kept.iter().enumerate().min_by_key(|(_, other)| distance(other));
    best.and_then(|(n, _)| u8::try_from(n).ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colours_stay_as_they_are_and_of_many_the_rare_ones_move_to_their_neighbours() {
        let few: Vec<u8> = [[255, 255, 255, 255]; 5].into_iter().chain([[1, 2, 3, 255]]).flatten().collect();
        assert_eq!(palette(&few), (vec![255, 255, 255, 1, 2, 3], vec![0, 0, 0, 0, 0, 1]));
        let grey = |n: u8| [n, n, n, 255];
        // All greys twice, and one colour between two of them once.
        let all = (0..=255).flat_map(|n| [grey(n), grey(n)]).chain([[100, 100, 101, 255]]);
        let (colours, places) = palette(&all.flatten().collect::<Vec<u8>>());
        assert_eq!((colours.len(), places.len(), places[512]), (768, 513, 100));
        assert_eq!(palette(&[]), (vec![], vec![]));
    }
}
