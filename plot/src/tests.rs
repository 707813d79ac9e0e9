//! Pictures of synthetic runs: complete ones, and those of damaged or hostile recordings.

use super::*;
use crate::Footprint;
use messages::{Message, common, lowlevel, middlelevel, simulation};
use navitools::Point;
use simulator::world::{Segment, World};

const BEGIN: i64 = 1_795_302_110_000_000;

fn picture() -> Picture {
    let geometry = Footprint { length_m: 0.9, width_m: 0.6, rear_overhang_m: 0.15, corners: Vec::new() };
    Picture::new(World::hall(20.0, 12.0), Some(geometry))
}

fn state(module: &str, state: i8) -> Message {
    common::DataState { timestamp: 0, module: module.into(), state }.into()
}

fn error(severity: i8, number: i32, message: &str) -> Message {
    common::Error { severity, number, module: "driver_power".into(), message: message.into(), ..Default::default() }
        .into()
}

/// Ten seconds of a robot that drives, stops and reports faults.
fn whole() -> Picture {
    let mut picture = picture();
    for n in 0..100 {
        let (x, at) = (4.0 + 0.1 * f64::from(n), BEGIN + i64::from(n) * 100_000);
        picture.take(at, &simulation::DataTruth { x, y: 6.0, ..Default::default() }.into());
        let covariance = [[0.04, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0; 3]];
        let quality = middlelevel::DataEstimate::FINE;
        picture.take(at, &middlelevel::DataEstimate { x, y: 6.1, covariance, quality, ..Default::default() }.into());
        let reason = if n < 50 { "" } else { "PAUSE is engaged by <bumper2>" };
        let motion =
            lowlevel::DataMotion { speed: 0.5, speed_target: 0.6, reason: reason.into(), ..Default::default() };
        picture.take(at, &motion.into());
        picture.take(at, &state("driver_power", if n < 70 { 3 } else { 4 }));
    }
    picture.take(BEGIN, &lowlevel::DataPower { voltage: 25.9, charge: 0.8, ..Default::default() }.into());
    picture.take(BEGIN, &middlelevel::DataPlan { timestamp: 0, x: vec![1.0, 1.5], y: vec![2.0, 2.0] }.into());
    let cells = middlelevel::DataObstacles { timestamp: 0, size: 0.1, x: vec![3.0], y: vec![2.0] };
    picture.take(BEGIN, &cells.into());
    picture.take(BEGIN + 7_000_000, &error(2, 0x0502, "the supply is cut"));
    picture.take(BEGIN + 8_000_000, &error(2, 0x0502, "the supply is cut"));
    let stop = lowlevel::EventStop { timestamp: 0, engaged: true, source: "bumper2".into() };
    picture.take(BEGIN + 5_000_000, &stop.into());
    let action = common::CmdLog::MARK;
    picture.take(BEGIN + 2_000_000, &common::CmdLog { timestamp: 0, action, text: "here it squeaks".into() }.into());
    picture.note("contact: by robot, robot 0.400 m/s, wall, at 13.900 6.000");
    picture.note("something else");
    picture.entitle(Title { run: "2026_11_22".into(), robot: "advee".into(), ..Title::default() });
    picture
}

/// Number of occurrences of `what` in the group of this name.
fn within(svg: &str, group: &str, what: &str) -> usize {
    let mut depth = 0;
    let from = svg.find(&format!("<g class=\"{group}\">")).unwrap_or_else(|| panic!("no {group}"));
    let lines = svg[from..].lines().take_while(|line| {
        depth += i32::from(line.starts_with("<g ")) - i32::from(*line == "</g>");
        depth > 0
    });
    lines.filter(|line| line.contains(what)).count()
}

fn size(png: &[u8]) -> (u32, u32, usize) {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(png));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, pixels.chunks(3).filter(|pixel| pixel.iter().all(|part| *part < 128)).count())
}

#[test]
fn every_part_of_the_run_is_in_the_picture() {
    assert!(picture().is_empty() && !whole().is_empty());
    let svg = whole().svg();
    let ours = |group, what| within(&svg, group, what);
    assert_eq!(
        (ours("world", "<polyline"), ours("truth", "<polyline"), ours("estimate", "stroke-dasharray")),
        (4, 1, 1)
    );
    assert_eq!((ours("plan", "<polyline"), ours("obstacles", "<polygon"), ours("robot", "<polygon")), (1, 1, 1));
    assert_eq!((ours("ellipses", "<polyline"), ours("contacts", "<polyline")), (5, 2));
    assert_eq!((ours("speed", "stroke=\"#0072b2\""), ours("battery", "<circle"), ours("marks", ">M1<")), (2, 2, 1));
    // States have letters, in their bars and in the legend; causes have theirs, and the list has the text.
    assert_eq!((ours("states", ">R<"), ours("states", ">E<"), ours("states", ">error<")), (2, 2, 1));
    assert_eq!((ours("stops", ">bumper2<"), ours("stops", "A  PAUSE is engaged by &lt;bumper2&gt;<")), (1, 1));
    for text in [
        "advee · 2026_11_22<",
        "2026-11-21 23:01:50 UTC  ·  9.9 s  ·  9.9 m  ·  1 contact  ·  2 errors  ·  0 warnings  ·  25.90 to 25.90 V",
        "ERROR  driver_power PowerOff: the supply is cut (2 times, last 8.0 s)",
        ">here it squeaks<",
        ">4.9 s<",
        "time since 23:01:50 UTC / s",
    ] {
        assert!(svg.contains(text), "{text}");
    }
    assert!(!svg.contains("NaN") && svg.ends_with("</svg>\n"));
    assert_eq!(svg.matches("<g ").count(), svg.matches("</g>").count());
    let (width, height, dark) = size(&whole().png().unwrap());
    let high: u32 = svg.split("height=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
    assert_eq!(width * high, 1000 * height, "both canvasses have one page");
    assert!(dark > 20_000, "{dark}");
}

#[test]
fn stops_follow_the_numbers_of_the_log_and_a_missing_command_is_not_a_stop() {
    let picture = |with_numbers: bool| {
        let mut picture = whole();
        for n in 0..50 {
            let hold = if n < 25 { messages::Hold::NobodyCommands } else { messages::Hold::PauseBumper };
            let hold = lowlevel::Hold { code: hold.code(), subject: "bumper7".into(), ..Default::default() };
            let list = lowlevel::DataHold { timestamp: 0, module: "driver_canbus".into(), holds: vec![hold] };
            if with_numbers {
                picture.take(BEGIN + i64::from(n) * 200_000, &list.into());
            }
        }
        picture.svg()
    };
    let ours = |svg: &str, what| within(svg, "stops", what);
    let (new, old) = (picture(true), picture(false));
    assert_eq!((ours(&new, "A  PAUSE is engaged by bumper7<"), ours(&new, "nobody commands the motion<")), (1, 1));
    assert_eq!((ours(&new, "bumper2&gt;<"), ours(&new, ">B  ")), (0, 0), "the text of LL_DATA_MOTION is not read");
    assert_eq!(ours(&old, "A  PAUSE is engaged by &lt;bumper2&gt;<"), 1, "a log from before the numbers");
}

#[test]
fn a_bound_is_a_stop_only_while_the_robot_stands() {
    let mut picture = picture();
    for n in 0..100 {
        let at = BEGIN + i64::from(n) * 100_000;
        let speed = if n < 50 { 0.2 } else { 0.0 };
        picture.take(at, &lowlevel::DataMotion { speed, ..Default::default() }.into());
        let code = if n < 50 { messages::Hold::GuardSlows } else { messages::Hold::GuardStops }.code();
        let holds = vec![lowlevel::Hold { code, subject: "sonar 3".into(), ..Default::default() }];
        picture.take(at, &lowlevel::DataHold { timestamp: 0, module: "driver_canbus".into(), holds }.into());
    }
    let svg = picture.svg();
    assert_eq!((within(&svg, "stops", ">A  something is near: sonar 3<"), svg.matches("slows for").count()), (1, 0));
}

#[test]
fn the_bounds_of_the_guard_are_curves_and_its_last_fields_are_around_the_robot() {
    let field = |kind, occupied, x: Vec<f64>| {
        let y = vec![-0.3, -0.3, 0.3, 0.3];
        lowlevel::Field { kind, occupied, x, y }
    };
    let guard = |occupied| lowlevel::DataGuard {
        forward: 0.7,
        backward: 0.6,
        fields: vec![
            field(lowlevel::Field::PROTECTIVE, occupied, vec![0.8, 1.3, 1.3, 0.8]),
            field(lowlevel::Field::WARNING, false, vec![0.8, 2.5, 2.5, 0.8]),
        ],
        ..Default::default()
    };
    let svg = |occupied, end: i64| {
        let mut picture = whole();
        for n in 0..=90 {
            picture.take(BEGIN + n * 100_000 + end, &guard(occupied).into());
        }
        picture.svg()
    };
    let without = whole().svg();
    assert!(!without.contains("at most") && !without.contains("class=\"fields\"") && !without.contains("field<"));
    // Two curves more, each with its line in the legend.
    let plain = svg(false, 900_000);
    let lines = |svg: &str| ["#d55e00", "#6a3d9a"].map(|ink| within(svg, "speed", &format!("stroke=\"{ink}\"")));
    assert_eq!((lines(&without), lines(&plain)), ([0, 0], [2, 2]));
    assert_eq!((within(&plain, "speed", ">at most forward<"), within(&plain, "speed", ">at most backward<")), (1, 1));
    assert_eq!((within(&without, "speed", ">–0.5<"), within(&plain, "speed", ">–0.5<")), (0, 1), "backward is below");
    // An outline each; what is in a field fills it. The legend names what is there.
    let occupied = svg(true, 900_000);
    assert_eq!((within(&plain, "fields", "<polyline"), within(&plain, "fields", "<polygon")), (2, 0));
    assert_eq!((within(&occupied, "fields", "<polyline"), within(&occupied, "fields", "<polygon")), (2, 1));
    let named = |svg: &str| {
        [">protective field<", ">warning field<", ">something is in it<"].map(|name| within(svg, "legend", name))
    };
    assert_eq!((named(&plain), named(&occupied)), ([1, 1, 0], [1, 1, 1]));
    // The guard fell silent before the end: where its fields would be now is not known.
    assert!(!svg(true, 300_000).contains("class=\"fields\""));
    // A message that is no field, from anybody.
    let mut picture = whole();
    let odd = [vec![f64::NAN; 4], vec![1e300; 4], vec![1.0; 2]].map(|x| field(0, true, x));
    let (forward, backward) = (f64::NAN, f64::INFINITY);
    let message = lowlevel::DataGuard { forward, backward, fields: odd.into(), ..Default::default() };
    picture.take(BEGIN + 9_900_000, &message.into());
    let svg = picture.svg();
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

#[test]
fn without_the_truth_the_robot_is_drawn_where_it_believes_to_be() {
    let mut picture = picture();
    for n in 0..10 {
        let quality = middlelevel::DataEstimate::FINE;
        let estimate = middlelevel::DataEstimate { x: 5.0 + f64::from(n), y: 6.0, quality, ..Default::default() };
        picture.take(BEGIN + i64::from(n) * 100_000, &estimate.into());
    }
    assert_eq!(within(&picture.svg(), "robot", "<polygon"), 1);
}

#[test]
fn a_run_without_positions_or_without_data_is_still_a_page() {
    let mut bare = Picture::new(World::default(), None);
    assert!(size(&bare.png().unwrap()).2 > 1000, "axes and words");
    bare.take(BEGIN, &state("watchdog", 3));
    let svg = bare.svg();
    assert!(!bare.is_empty() && !svg.contains("class=\"map\"") && svg.contains("no data"));
}

#[test]
fn invalid_numbers_times_and_positions_do_no_harm() {
    let mut picture = whole();
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 1e18, f64::MIN_POSITIVE];
    for (n, value) in odd.into_iter().enumerate() {
        let at = BEGIN + 9_000_000 + n as i64;
        picture.take(at, &simulation::DataTruth { x: value, y: 1.0, theta: value, ..Default::default() }.into());
        let covariance = [[value; 3]; 3];
        let estimate = middlelevel::DataEstimate { x: 5.0, y: 6.0, covariance, quality: 3, ..Default::default() };
        picture.take(at + 3_000_000 * n as i64, &estimate.into());
        let motion = lowlevel::DataMotion { speed: value, steering: value, ..Default::default() };
        picture.take(at, &motion.into());
        picture.take(at, &lowlevel::DataPower { voltage: value, charge: value, ..Default::default() }.into());
        picture.take(at, &middlelevel::DataPlan { timestamp: 0, x: vec![value; 3], y: vec![1.0, 2.0, value] }.into());
        let cells = middlelevel::DataObstacles { timestamp: 0, size: value, x: vec![1.0, value], y: vec![1.0; 2] };
        picture.take(at, &cells.into());
    }
    for stray in [i64::MIN, i64::MAX, 0, BEGIN - 40 * 86_400_000_000] {
        picture.take(stray, &state("driver_power", 3));
        picture.take(stray, &error(127, i32::MIN, "\0\u{1b}[2J</svg>"));
    }
    picture.take(BEGIN + 100, &error(-128, i32::MAX, "\0\u{1b}[2J</svg>"));
    picture.take(BEGIN + 200, &state("\n", -7));
    let svg = picture.svg();
    assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.matches("</svg>").count() == 1);
    assert!(svg.contains("8 messages with implausible timestamps are left out"));
    size(&picture.png().unwrap());
}

#[test]
fn positions_beyond_the_world_do_not_shrink_it() {
    let far = |picture: &mut Picture| {
        for n in 0..1000 {
            let x = if n == 500 { 9e5 } else { f64::from(n) * 0.01 };
            picture
                .take(BEGIN + i64::from(n) * 1000, &simulation::DataTruth { x, y: 3.0, ..Default::default() }.into());
        }
    };
    for world in [World::hall(20.0, 12.0), World::default()] {
        let mut picture = Picture::new(world, None);
        far(&mut picture);
        let svg = picture.svg();
        // The numbers at its axes are metres, not thousands.
        assert!(within(&svg, "map", ">10<") > 0 && within(&svg, "map", "00000") == 0);
    }
}

#[test]
fn a_million_messages_and_two_hundred_modules_are_a_page() {
    let mut picture = picture();
    for n in 0..1_000_000_i64 {
        let at = BEGIN + n * 10_000;
        let x = 10.0 + 5.0 * (n as f64 * 1e-3).sin();
        match n % 4 {
            0 => picture.take(at, &simulation::DataTruth { x, y: 6.0, ..Default::default() }.into()),
            1 => picture
                .take(at, &lowlevel::DataMotion { speed: x, reason: format!("{n}"), ..Default::default() }.into()),
            2 => picture.take(at, &state(&format!("module_{}", n % 1200), (n % 7) as i8)),
            _ => picture.take(at, &error((n % 3) as i8, n as i32, &"a very long word ".repeat(30))),
        }
    }
    (0..1000).for_each(|n| picture.mark(BEGIN + n, "again"));
    let svg = picture.svg();
    assert!(svg.len() < 5_000_000, "{}", svg.len());
    for text in ["and 249990 more", "modules with fewer changes", "changes of states or reasons are left out"] {
        assert!(svg.contains(text), "{text}");
    }
    let (_, height, _) = size(&picture.png().unwrap());
    assert!(height < 6000, "{height}");
}

#[test]
fn a_narrow_world_and_a_long_one_have_their_place() {
    for (wide, high) in [(3.0, 60.0), (200.0, 2.0), (0.0, 0.0)] {
        let corner = |x, y| Point { x, y };
        let walls = vec![Segment { a: corner(0.0, 0.0), b: corner(wide, high) }];
        let mut picture = Picture::new(World { walls, ..World::default() }, None);
        picture.take(BEGIN, &simulation::DataTruth { x: 1.0, y: 1.0, ..Default::default() }.into());
        let svg = picture.svg();
        let height: f64 = svg.split("height=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
        assert!((500.0..1300.0).contains(&height), "{height}");
    }
}
