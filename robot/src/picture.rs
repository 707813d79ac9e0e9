//! Picture of a run from its log: files `log_NNN.mcap` with the messages of the bus, and the configuration.

use crate::config::{ConfigError, Robot};
use host::runs;
use logger::read::{Filter, Messages};
use messages::{Channel, Message};
use navitools::Point;
use plot::{Picture, Title};
use record::Header;
use simulator::world::{Beacon, World};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A step of the wall clock forward, µs: nothing else is silent for an hour in a log to which the watchdog alone adds
/// ten messages a second.
const FORWARD: i64 = 3_600_000_000;

/// A part of a run: between two moments after its start, s.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Start.
    pub from: f64,
    /// End.
    pub to: f64,
}

impl Part {
    /// The whole run.
    pub const WHOLE: Self = Self { from: 0.0, to: f64::INFINITY };

    /// True if a moment is in it; both are microseconds since the UNIX epoch.
    #[must_use]
    pub fn has(self, begin_us: i64, at_us: i64) -> bool {
        (self.from..=self.to).contains(&(at_us.saturating_sub(begin_us) as f64 / 1e6))
    }
}

/// Reads the robot and its world from the header of a run: [`recording::described`](crate::recording::described).
pub type Describe = fn(&Header) -> Result<(Robot, World), ConfigError>;

/// PNG of a whole run, from the log in its folder.
///
/// # Errors
/// One line: the reason why there is no picture.
pub fn png(run: &Path, describe: Describe) -> Result<Vec<u8>, String> {
    let picture = read(run, &runs::log_files(run), Part::WHOLE, None, describe, &mut |_| {})?;
    match picture.is_empty() {
        true => Err("the run has no message of a robot".into()),
        false => picture.png(),
    }
}

/// Name of a run: that of its folder.
#[must_use]
pub fn name(run: &Path) -> String {
    // `.` has a name, too.
    let run = run.canonicalize().unwrap_or_else(|_| run.into());
    run.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Empty picture of the run with this header.
///
/// # Errors
/// The configuration in the header is refused.
pub fn open(run: &Path, header: &Header, describe: Describe) -> Result<(Picture, Title), ConfigError> {
    let (robot, mut world) = describe(header)?;
    if world.beacons.is_empty() {
        let beacon = |known: &settings::robot::Beacon| Beacon { id: known.id, at: Point { x: known.x, y: known.y } };
        world.beacons = robot.beacons.iter().map(beacon).collect();
    }
    let title = Title {
        run: name(run),
        robot: robot.general.name.clone(),
        program: header.program.clone(),
        remarks: Vec::new(),
    };
    Ok((Picture::new(world, Some(robot.footprint())), title))
}

/// Picture of a part of a run; `known`: configuration that the log need not have; `told` of the share that is read.
/// Damaged places are left out, and the picture says so.
///
/// # Errors
/// One line: the log has no message.
pub fn read(
    run: &Path,
    files: &[PathBuf],
    part: Part,
    known: Option<Header>,
    describe: Describe,
    told: &mut dyn FnMut(f64),
) -> Result<Picture, String> {
    let mut remarks = Vec::new();
    let mut opened = Vec::new();
    let mut texts = Vec::new();
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match runs::open_log(path, &mut texts) {
            Ok((file, index)) => {
                let damage = &index.damage;
                if damage.regions + damage.cut + damage.sealed > 0 {
                    let bytes = damage.bytes + damage.cut;
                    remarks.push(format!("{name}: {} damaged places, {bytes} bytes are left out", damage.regions));
                }
                opened.push((file, Arc::new(index)));
            }
            Err(error) => remarks.push(format!("{name}: {error}")),
        }
    }
    let (mut picture, title) = begin(run, &known.unwrap_or_else(|| runs::attached(texts)), describe);
    let wants = |channel: &logger::read::Channel, _: Option<&logger::read::Schema>| {
        channel.encoding == "lcm" && Channel::from_name(&channel.topic).is_some()
    };
    let spans = || opened.iter().filter_map(|(_, index)| index.span());
    let begin_ns = spans().map(|span| span.0).min().unwrap_or_default();
    let whole_ns = spans().map(|span| span.1).max().unwrap_or_default().saturating_sub(begin_ns).max(1);
    let mut messages = Messages::new(opened, &Filter { from: 0, to: u64::MAX, wants: &wants });
    let (mut clock, mut foreign) = (Clock::default(), 0);
    loop {
        let entry = match messages.next_entry() {
            Ok(Some(entry)) => entry,
            Ok(None) => break,
            Err(error) => {
                remarks.push(error.to_string());
                break;
            }
        };
        told(entry.message.log_time.saturating_sub(begin_ns) as f64 / whole_ns as f64);
        let at_us = clock.at(i64::try_from(entry.message.log_time / 1000).unwrap_or(i64::MAX));
        let begin_us = clock.first.unwrap_or(at_us);
        let channel = Channel::from_name(&entry.channel.topic).filter(|_| part.has(begin_us, at_us));
        match channel.map(|channel| Message::decode(channel, entry.message.data)) {
            Some(Ok(message)) => picture.take(at_us, &message),
            Some(Err(_)) => foreign += 1,
            None => {}
        }
    }
    if clock.first.is_none() {
        let why = remarks.into_iter().next().unwrap_or_else(|| "nothing is logged".into());
        return Err(format!("{}: no message: {why}", run.display()));
    }
    let skipped = messages.skipped();
    let mut add = |count: u64, what: &str| {
        if count > 0 {
            remarks.push(format!("{count} {what}"));
        }
    };
    add(clock.steps, "steps of the clock by an hour and more: times go on where they were");
    add(skipped.damaged + skipped.sealed, "chunks of the log cannot be read and are left out");
    add(foreign, "messages that are not what their channels carry are left out");
    picture.entitle(Title { remarks: [title.remarks, remarks].concat(), ..title });
    Ok(picture)
}

/// An empty picture: with the world and the robot where they are known.
fn begin(run: &Path, header: &Header, describe: Describe) -> (Picture, Title) {
    open(run, header, describe).unwrap_or_else(|refused| {
        let why = refused.0.last().map(|line| line.trim()).unwrap_or_default();
        let remarks = vec![format!("no map and no robot: {why}")];
        (Picture::new(World::default(), None), Title { run: name(run), remarks, ..Title::default() })
    })
}

/// Moments that go on when somebody sets the wall clock forward: messages come in order of their times.
#[derive(Default)]
struct Clock {
    first: Option<i64>,
    last: i64,
    shift: i64,
    steps: u64,
}

impl Clock {
    /// The moment of a message on this scale, which begins where the wall clock was; all µs.
    fn at(&mut self, wall_us: i64) -> i64 {
        let at = wall_us.saturating_add(self.shift);
        if self.first.is_none() {
            (self.first, self.last) = (Some(at), at);
        } else if at > self.last.saturating_add(FORWARD) {
            self.shift = self.last.saturating_sub(wall_us);
            self.steps += 1;
            return self.last;
        }
        self.last = self.last.max(at);
        at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::described;
    use messages::{common, lowlevel, simulation};
    use std::borrow::Cow;
    use std::fs;
    use std::io::Cursor;

    const BEGIN_NS: u64 = 1_795_302_110_000_000_000;

    /// The folder of a run, removed in the end.
    struct Run(PathBuf);

    impl Drop for Run {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    impl Run {
        fn new(name: &str, files: &[Vec<u8>]) -> Self {
            let run = Self(std::env::temp_dir().join(format!("advee-plot-{name}-{}", std::process::id())));
            fs::create_dir_all(&run.0).unwrap();
            for (n, file) in files.iter().enumerate() {
                fs::write(run.0.join(format!("log_{n:03}.mcap")), file).unwrap();
            }
            run
        }

        fn svg(&self) -> Result<String, String> {
            read(&self.0, &runs::log_files(&self.0), Part::WHOLE, None, described, &mut |_| {})
                .map(|picture| picture.svg())
        }
    }

    /// A log of these messages, each so many ns after the beginning, with the shipped configuration.
    fn logged(said: &[(u64, Message)]) -> Vec<u8> {
        let mut writer = mcap::WriteOptions::new().compression(None).create(Cursor::new(Vec::new())).unwrap();
        let conf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf");
        let texts = [
            (runs::ROBOT, fs::read(conf.join("advee/robot.toml")).unwrap()),
            (runs::SIM, fs::read(conf.join("advee/sim.toml")).unwrap()),
            (runs::MODULES, fs::read(conf.join("advee/modules.toml")).unwrap()),
            (runs::WORLD, fs::read(conf.join("worlds/hall.toml")).unwrap()),
            (runs::OVERRIDES, b"robot.name=\"logged\"\n".to_vec()),
        ];
        for (name, data) in texts {
            let (name, media_type) = (name.into(), "text/plain".into());
            let data = Cow::Owned(data);
            writer.attach(&mcap::Attachment { log_time: 0, create_time: 0, name, media_type, data }).unwrap();
        }
        for (n, (after, message)) in said.iter().enumerate() {
            let mut data = Vec::new();
            message.encode(&mut data).unwrap();
            let channel_id =
                writer.add_channel(0, &message.channel_name(), "lcm", &std::collections::BTreeMap::new()).unwrap();
            let log_time = BEGIN_NS.saturating_add(*after);
            let header =
                mcap::records::MessageHeader { channel_id, sequence: n as u32, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header, &data).unwrap();
        }
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    }

    fn drive(from: u64) -> Vec<(u64, Message)> {
        let mut said = Vec::new();
        for n in 0..100_u64 {
            let at = from + n * 100_000_000;
            let truth = simulation::DataTruth { x: 4.0 + n as f64 * 0.05, y: 6.0, ..Default::default() };
            let motion = lowlevel::DataMotion { speed: 0.5, reason: "is held".into(), ..Default::default() };
            let state = common::DataState { module: "watchdog".into(), state: 3, ..Default::default() };
            said.extend([(at, truth.into()), (at, motion.into()), (at, state.into())]);
        }
        let (action, text) = (common::CmdLog::MARK, "here".to_string());
        said.push((from + 5_000_000_000, common::CmdLog { timestamp: 0, action, text }.into()));
        said
    }

    #[test]
    fn a_log_of_two_files_is_drawn_with_its_world_its_robot_and_its_marks() {
        let run = Run::new("whole", &[logged(&drive(0)), logged(&drive(10_000_000_000))]);
        let svg = run.svg().unwrap();
        for text in
            ["logged · advee-plot-whole", "·  19.9 s  ·  9.9 m", ">M1<", ">M2<", ">here<", "is held", ">watchdog<"]
        {
            assert!(svg.contains(text), "{text}");
        }
        let world = svg.split("<g class=\"world\">").nth(1).unwrap().split("</g>").next().unwrap();
        assert_eq!((world.matches("<polyline").count(), world.matches("<circle").count()), (13, 6));
        let (files, mut shares) = (runs::log_files(&run.0), Vec::new());
        let mut told = |share| shares.push(share);
        let part = read(&run.0, &files, Part { from: 5.0, to: 7.0 }, None, described, &mut told).unwrap();
        assert!(shares.is_sorted() && shares.last().is_some_and(|last| *last > 0.9 && *last <= 1.0), "{shares:?}");
        assert!(part.svg().contains("·  2.0 s  ·  1.0 m"));
    }

    #[test]
    fn a_clock_that_is_set_does_not_make_a_year_of_a_minute() {
        let later = 86_400_000_000_000 * 300;
        let svg = Run::new("clock", &[logged(&drive(0)), logged(&drive(later))]).svg().unwrap();
        assert!(
            svg.contains("1 steps of the clock by an hour and more") && svg.contains("·  19.8 s  ·"),
            "{}",
            &svg[..2000]
        );
    }

    #[test]
    fn whatever_is_damaged_or_cut_off_is_a_picture_or_one_line() {
        let whole = logged(&drive(0));
        for n in 0..60 {
            let mut harmed = whole.clone();
            let place = whole.len() * n / 60;
            if n % 2 == 0 {
                harmed.truncate(place);
            } else {
                harmed[place..(place + 9).min(whole.len())].fill(0xff);
            }
            match Run::new("harmed", &[harmed]).svg() {
                Ok(svg) => assert!(svg.ends_with("</svg>\n")),
                Err(why) => assert!(why.lines().count() == 1 && why.contains("no message"), "{why}"),
            }
        }
        for file in [b"".to_vec(), b"something else".to_vec()] {
            let why = Run::new("other", &[file]).svg().unwrap_err();
            assert!(why.ends_with("nothing is logged") || why.contains("log_000.mcap"), "{why}");
        }
    }

    #[test]
    fn what_is_not_what_its_channel_carries_is_counted_and_without_a_configuration_there_is_no_map() {
        let mut writer = mcap::WriteOptions::new().compression(None).create(Cursor::new(Vec::new())).unwrap();
        for (topic, data) in [("LL_DATA_ODO", &b"no odometry"[..]), ("OTHERS", b"?"), ("SIM_DATA_TRUTH", b"")] {
            let channel_id = writer.add_channel(0, topic, "lcm", &std::collections::BTreeMap::new()).unwrap();
            let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: u64::MAX, publish_time: 0 };
            writer.write_to_known_channel(&header, data).unwrap();
        }
        writer.finish().unwrap();
        let svg = Run::new("foreign", &[writer.into_inner().into_inner()]).svg().unwrap();
        assert!(
            svg.contains("2 messages that are not what their channels carry") && svg.contains("no map and no robot")
        );
    }
}
