//! Shapes drawn on a map; valid and invalid pictures and YAML texts.

use super::*;

fn count(map: &Map) -> usize {
    map.cells().iter().filter(|cell| **cell == Cell::Occupied).count()
}

/// Rows from the top, `#` occupied.
fn picture(map: &Map) -> Vec<String> {
    let letter = |cell: &Cell| match cell {
        Cell::Free => '.',
        Cell::Occupied => '#',
        Cell::Unknown => '?',
    };
    map.cells().chunks(map.frame().width).rev().map(|row| row.iter().map(letter).collect()).collect()
}

#[test]
fn a_wall_is_every_cell_that_it_passes_through() {
    let mut map = Map::around((0.0, 0.0), (6.0, 4.0), 1.0).unwrap();
    map.wall((0.5, 0.5), (5.5, 3.25));
    assert_eq!(picture(&map), [".....#", "...###", ".###..", "##...."]);
    // The wall is the same in the other direction.
    let mut back = Map::around((0.0, 0.0), (6.0, 4.0), 1.0).unwrap();
    back.wall((5.5, 3.25), (0.5, 0.5));
    assert_eq!(map, back);
    let mut upright = Map::around((0.0, 0.0), (3.0, 3.0), 1.0).unwrap();
    upright.wall((1.5, 2.5), (1.5, 1.5));
    assert_eq!(picture(&upright), [".#.", ".#.", "..."]);
}

#[test]
fn every_point_of_a_drawn_shape_is_occupied() {
    let mut seed = 1u32;
    let mut random = move |high: f64| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) * high
    };
    for _ in 0..200 {
        let mut map = Map::around((-3.0, -2.0), (7.0, 6.0), 0.13).unwrap();
        let (a, b) = ((random(10.0) - 3.0, random(8.0) - 2.0), (random(10.0) - 3.0, random(8.0) - 2.0));
        map.wall(a, b);
        for part in 1..1000 {
            let part = f64::from(part) / 1000.0;
            let (x, y) = (a.0 + (b.0 - a.0) * part, a.1 + (b.1 - a.1) * part);
            assert_eq!(map.at(x, y), Some(Cell::Occupied), "{a:?} to {b:?} at {x}, {y}");
        }
        let mut map = Map::around((-3.0, -2.0), (7.0, 6.0), 0.13).unwrap();
        let (centre, radius) = ((random(10.0) - 3.0, random(8.0) - 2.0), random(2.0));
        map.column(centre, radius);
        for index in 0..map.cells().len() {
            let (x, y) = map.frame().centre(index % map.frame().width, index / map.frame().width);
            let away = libm::hypot(x - centre.0, y - centre.1);
            let occupied = map.cells()[index] == Cell::Occupied;
            assert!(occupied || away > radius, "{x}, {y} in a column at {centre:?}");
            assert!(!occupied || away < radius + 0.1, "{x}, {y} off a column at {centre:?}");
        }
    }
}

#[test]
fn a_polygon_is_filled_and_shapes_beyond_the_map_do_no_harm() {
    let mut map = Map::around((0.0, 0.0), (8.0, 8.0), 1.0).unwrap();
    map.polygon(&[(1.5, 1.5), (6.5, 1.5), (6.5, 6.5), (1.5, 6.5)]);
    assert_eq!(count(&map), 36);
    for far in [1e300, f64::INFINITY, f64::NAN, -1e9] {
        map.wall((far, 0.0), (0.0, far));
        map.column((far, far), 1.0);
        map.column((1.0, 1.0), far);
        map.polygon(&[(far, 0.0), (1.0, far), (2.0, 2.0)]);
    }
    map.polygon(&[]);
    map.set(8, 0, Cell::Occupied);
    assert_eq!(map.at(8.0, 0.5), None);
    assert_eq!(map.at(f64::NAN, 0.5), None);
}

#[test]
fn a_map_of_shapes_holds_them_all() {
    let walls = [((0.0, 0.0), (4.0, 0.0)), ((4.0, 0.0), (4.0, 3.0))];
    let map = Map::drawn(&walls, &[((-2.0, 1.0), 0.5)], &[vec![(5.0, 5.0), (6.0, 5.0), (6.0, 6.0)]], (0.0, 9.0), 0.05);
    let map = map.unwrap();
    for (x, y) in [(4.0, 3.0), (0.0, 0.0), (-2.5, 1.0), (6.0, 6.0)] {
        assert_eq!(map.at(x, y), Some(Cell::Occupied), "{x}, {y}");
    }
    assert_eq!(map.at(0.0, 9.0), Some(Cell::Free));
    // Walls just within cells occupy these, wherever the drawing begins.
    let walls = [((0.02, 0.0501), (1.0199, 0.0501)), ((0.02, 0.0501), (0.02, 1.0199))];
    let map = Map::drawn(&walls, &[], &[], (0.5, 0.5), 0.05).unwrap();
    assert!((map.frame().x + 0.05).abs() < 1e-9 && map.frame().y.abs() < 1e-9, "{:?}", map.frame());
    assert_eq!((map.at(0.5, 0.075), map.at(0.5, 0.125)), (Some(Cell::Occupied), Some(Cell::Free)));
    assert_eq!((map.at(0.025, 0.5), map.at(0.075, 0.5)), (Some(Cell::Occupied), Some(Cell::Free)));
    assert!(Map::drawn(&[((0.0, 0.0), (1e9, 1e9))], &[], &[], (0.0, 0.0), 0.05).is_err());
    assert!(Map::drawn(&[((0.0, 0.0), (1.0, f64::INFINITY))], &[], &[], (0.0, 0.0), 0.05).is_err());
}

#[test]
fn invalid_frames_are_rejected() {
    let frame = |x, resolution, width, height| Frame { x, y: 0.0, resolution, width, height };
    assert_eq!(Map::new(frame(0.0, 0.05, 4096, 4096)).map(|map| map.cells().len()), Ok(CELLS_MAX));
    for bad in [
        frame(0.0, 0.05, 4097, 4096),
        frame(0.0, 0.05, usize::MAX, 2),
        frame(0.0, 0.05, 0, 5),
        frame(0.0, 0.0, 5, 5),
        frame(0.0, f64::NAN, 5, 5),
        frame(f64::INFINITY, 0.05, 5, 5),
    ] {
        assert!(Map::new(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn pictures_are_read_plain_and_raw_of_eight_and_sixteen_bits() {
    let plain = pgm::read(b"P2\n# by hand\n3 2 # wide\n255\n0 100 255\n1 2 3\n").unwrap();
    assert_eq!((plain.width, plain.height, &plain.grey[..]), (3, 2, &[0, 100, 255, 1, 2, 3][..]));
    let raw = pgm::read(b"P5 3 2 255\n\x00\x64\xff\x01\x02\x03 and more").unwrap();
    assert_eq!(raw, plain);
    let deep = pgm::read(b"P5\n2 1\n65535\n\x01\x00\xff\xff").unwrap();
    assert_eq!((deep.max, &deep.grey[..]), (65535, &[256, 65535][..]));
    // White space that looks like the first pixel is picture data.
    let odd = pgm::read(b"P5 1 1 255\n\n").unwrap();
    assert_eq!(odd.grey, [10]);
}

#[test]
fn invalid_pictures_are_rejected_with_the_position() {
    let told = |bytes: &[u8]| pgm::read(bytes).unwrap_err().to_string();
    for (bytes, why) in [
        (&b""[..], "byte 0: not a PGM file: expected P2 or P5"),
        (b"P6 1 1 255\n\0\0\0", "byte 0: not a PGM file: expected P2 or P5"),
        (b"P5", "byte 0: not a PGM file: expected P2 or P5"),
        (b"P5\n", "byte 3: expected the width, a number"),
        (b"P5\nx 1 255\n", "byte 3: expected the width, a number"),
        (b"P5\n-1 1 255\n", "byte 3: expected the width, a number"),
        (b"P5\n0 1 255\n", "byte 3: the width is 0: out of range"),
        (b"P5\n99999999999999999999999 1 255\n", "byte 3: the width is 18446744073709551615: out of range"),
        (b"P5\n4097 4096 255\n", "byte 12: 4097 × 4096 pixels: expected 1 to 16777216"),
        (b"P5\n2 2 0\n", "byte 7: the white value is 0: out of range"),
        (b"P5\n2 2 65536\n", "byte 7: the white value is 65536: out of range"),
        (b"P5\n2 2 255\n\x01\x02\x03", "byte 14: the picture ends after 3 of 4 pixels"),
        (b"P5\n2 2 255", "byte 10: the picture ends after 0 of 4 pixels"),
        (b"P5\n2 1 100\n\x01\x65", "byte 12: the grey value is 101: out of range"),
        (b"P2\n2 2 255\n1 2 3", "byte 16: the picture ends after 3 of 4 pixels"),
        (b"P2\n2 2 255\n1 2 x 4", "byte 15: expected the grey value, a number"),
        (b"P2\n2 2 255\n1 2 300 4", "byte 15: the grey value is 300: out of range"),
    ] {
        assert_eq!(told(bytes), why, "{:?}", String::from_utf8_lossy(bytes));
    }
}

const TEXT: &str = "image: hall.pgm  # beside this\nresolution: 0.05\norigin: [-1.0, 2.5, 0.0]\nnegate: 0\n\
                    occupied_thresh: 0.65\nfree_thresh: 0.196\n";

#[test]
fn the_text_beside_a_picture_is_read_as_nav2_writes_it() {
    let info = yaml::read(TEXT).unwrap();
    assert_eq!((info.image.as_str(), info.resolution, info.origin), ("hall.pgm", 0.05, (-1.0, 2.5)));
    assert_eq!((info.negate, info.occupied_thresh, info.free_thresh), (false, 0.65, 0.196));
    assert_eq!(info.mode, yaml::Mode::Trinary);
    let other = "%YAML 1.2\n---\nimage: \"a #1.pgm\"\nmode: 'scale'\nresolution: 5.0e-2\norigin:\n  - -1.0\n  - 2.5\n  \
                 - 0\nnegate: false\noccupied_thresh: 0.65\nfree_thresh: 0.196\nextra:\n  deep: 1\n  - item\nmore: {a: 1}\n";
    let other = yaml::read(other.strip_prefix("%YAML 1.2\n").unwrap()).unwrap();
    assert_eq!((other.image.as_str(), other.mode, other.origin), ("a #1.pgm", yaml::Mode::Scale, (-1.0, 2.5)));
}

#[test]
fn invalid_texts_are_rejected_with_the_line() {
    let told = |from: &str, to: &str| yaml::read(&TEXT.replace(from, to)).unwrap_err().to_string();
    for (from, to, why) in [
        ("image: hall.pgm", "image:", "line 1: image: \"[]\" is not a text"),
        ("image: hall.pgm  # beside this\n", "", "image is missing"),
        ("0.05", "0", "line 2: resolution: \"0\" is not a number from 0.001 to 10"),
        ("0.05", "nan", "line 2: resolution: \"nan\" is not a number from 0.001 to 10"),
        ("0.05", ".inf", "line 2: resolution: \".inf\" is not a number from 0.001 to 10"),
        ("0.0]", "0.1]", "line 3: origin: \"[-1.0, 2.5, 0.1]\" is turned: only maps with theta 0 are read"),
        (", 0.0]", "]", "line 3: origin: \"[-1.0, 2.5]\" is not a list of three numbers: x, y, theta"),
        ("[-1.0", "[nan", "line 3: origin: \"[nan, 2.5, 0.0]\" is not a list of three numbers: x, y, theta"),
        ("negate: 0", "negate: 2", "line 4: negate: \"2\" is neither 0 nor 1"),
        ("0.65", "1.5", "line 5: occupied_thresh: \"1.5\" is not a number from 0 to 1"),
        ("0.196", "0.7", "line 6: free_thresh: \"0.7\" is above occupied_thresh"),
        ("negate: 0", "negate 0", "line 4: expected `key: value`, found \"negate 0\""),
        ("negate: 0", "resolution: 1", "line 4: resolution occurs twice"),
        ("negate: 0", "- 5", "line 4: a list item without a list"),
        ("negate: 0", "negate: 0\nmode: quaternary", "line 5: mode: \"quaternary\" is not one of trinary, scale, raw"),
    ] {
        assert_eq!(told(from, to), why);
    }
    assert!(yaml::read(&"#".repeat(1 << 17)).is_err());
}

#[test]
fn grey_becomes_cells_by_nav2_s_rules_and_the_top_row_is_the_highest() {
    let map = |mode: &str, grey: &str, negate: &str| {
        let text = TEXT.replace("negate: 0", &format!("negate: {negate}\nmode: {mode}"));
        let picture = pgm::read(format!("P2 {} 1 255 {grey}", grey.split(' ').count()).as_bytes()).unwrap();
        picture_of(&yaml::read(&text).unwrap().map(&picture).unwrap())
    };
    fn picture_of(map: &Map) -> String {
        picture(map).concat()
    }
    // map_saver writes 254, 0 and 205; 205 is (255 - 205) / 255 = 0.19608, not below 0.196.
    assert_eq!(map("trinary", "254 0 205 89 90", "0"), ".#?#?");
    assert_eq!(map("trinary", "254 0 205 89 90", "1"), "#.#??");
    assert_eq!(map("scale", "254 0 205 89 90", "0"), ".#.#.");
    assert_eq!(map("raw", "0 99 100 101 255", "0"), "..#??");
    let two = pgm::read(b"P2 1 2 255 0 254").unwrap();
    let map = yaml::read(TEXT).unwrap().map(&two).unwrap();
    assert_eq!(picture(&map), ["#", "."]);
    assert_eq!(map.at(-0.99, 2.51), Some(Cell::Free));
    assert_eq!(map.at(-0.99, 2.56), Some(Cell::Occupied));
}

#[test]
fn random_bytes_are_rejected_or_parsed_without_harm() {
    let mut seed = 7u32;
    let mut random = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        seed >> 8
    };
    let pictures: [&[u8]; 3] = [
        b"P2\n# c\n3 2\n255\n0 100 255\n1 2 3\n",
        b"P5 3 2 255\n\x00\x64\xff\x01\x02\x03",
        b"P5 2 1 999\n\x01\x00\x02\x00",
    ];
    for round in 0..20_000 {
        let mut bytes = pictures[round % 3].to_vec();
        for _ in 0..random() % 4 {
            let at = random() as usize % bytes.len();
            match random() % 3 {
                0 => bytes[at] = random() as u8,
                1 => bytes.truncate(at.max(1)),
                _ => bytes.insert(at, b"0123456789 #\n-P"[random() as usize % 15]),
            }
        }
        if let Ok(picture) = pgm::read(&bytes) {
            assert_eq!(picture.grey.len(), picture.width * picture.height);
            assert!(picture.grey.iter().all(|grey| *grey <= picture.max));
        }
        let mut text = TEXT.as_bytes().to_vec();
        for _ in 0..1 + random() % 3 {
            let at = random() as usize % text.len();
            match random() % 3 {
                0 => text[at] = b"0123456789 #\n-:[],'\"eE.x"[random() as usize % 24],
                1 => text.truncate(at.max(1)),
                _ => text.insert(at, b"0123456789 #\n-:[],'\"eE.x"[random() as usize % 24]),
            }
        }
        match yaml::read(std::str::from_utf8(&text).unwrap()) {
            Ok(info) => assert!(info.resolution > 0.0 && info.origin.0.is_finite() && info.origin.1.is_finite()),
            Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
        }
    }
}

#[test]
fn the_distance_from_a_map_is_0_within_its_edges() {
    let frame = Frame { x: -1.0, y: 2.0, resolution: 0.5, width: 6, height: 4 };
    for (x, y, away) in [(-1.0, 2.0, 0.0), (2.0, 4.0, 0.0), (0.0, 3.0, 0.0), (-2.0, 3.0, 1.0), (5.0, 8.0, 5.0)] {
        assert_eq!(frame.distance(x, y), away, "{x}, {y}");
        assert_eq!(frame.is_outside(x, y), away > 0.0, "{x}, {y}");
    }
}

#[test]
fn a_written_picture_is_read_again() {
    for (max, grey) in [(255, vec![0, 205, 254, 255, 7, 10]), (65535, vec![0, 256, 65535, 255, 2570, 13])] {
        let picture = pgm::Picture { width: 3, height: 2, max, grey };
        assert_eq!(pgm::read(&pgm::write(&picture)).unwrap(), picture);
    }
}
