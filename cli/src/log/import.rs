//! `advee log import`: an official LCM event log becomes a log as the logger writes them.

use super::export::{New, options};
use super::select::{Select, Selection};
use super::source::{Item, Kind, Log};
use crate::lcm::types::TypesArg;
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, complain, print};
use logger::ros::{RobotScene, Sensor, Topic, Translator};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapError, Writer};
use robot::config::Sensors;
use serde_json::json;
use settings::Section;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Import {
    /// An official LCM event log
    log: PathBuf,
    /// The folder of the run that is made of it
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    #[command(flatten)]
    select: Select,
    /// Print a summary as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    types: TypesArg,
}

/// A file of the run is not much longer.
const FILE_MAX: u64 = 1 << 30;
/// A file numbers 65 535 channels, each of which comes twice.
const CHANNELS_MAX: usize = 30_000;

pub fn import(common: &Common, command: &Import) -> Outcome {
    let log = Log::open(&command.log)?;
    if !matches!(log.kind, Kind::Events(_)) {
        return Err(
            format!("{}: is no LCM event log; advee log export changes MCAP files", command.log.display()).into()
        );
    }
    let files = command.types.read()?;
    let scene = scene(common);
    let name = scene.name.clone();
    let translator = Translator::with_types(scene, &files).map_err(|error| Failed::from(error.to_string()))?;
    if command.out.read_dir().is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(format!("{}: is there already and not empty", command.out.display()).into());
    }
    std::fs::create_dir_all(&command.out)
        .map_err(|error| Failed::from(format!("{}: {error}", command.out.display())))?;
    let mut items = log.items(&Selection::of(&command.select, &log)?)?;
    let mut progress = Progress::new("importing");
    let mut run = Run { translator, folder: &command.out, robot: &name, files: 0, messages: 0, untranslated: 0 };
    let mut file = run.open()?;
    while let Some(item) = items.next()? {
        if file.bytes > FILE_MAX || file.raw.len() > CHANNELS_MAX {
            let full = std::mem::replace(&mut file, run.open()?);
            full.finish()?;
        }
        run.take(&item, &mut file)?;
        if run.messages.is_multiple_of(4096) {
            let (done, all) = items.progress();
            progress.tell(done, all);
        }
    }
    file.finish()?;
    drop(progress);
    if let Some(left_out) = items.left_out() {
        complain(&left_out);
    }
    let Run { files, messages, untranslated, .. } = run;
    if command.json {
        print(json!({"messages": messages, "files": files, "raw_only": untranslated}))?;
    } else {
        print(format_args!("{}: {messages} messages in {files} files", command.out.display()))?;
        if untranslated > 0 {
            print(format_args!(
                "  {untranslated} of them only as they are: no type is known (--types says where it is)"
            ))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The robot's name is that of the configuration, if there is one. Its shape and beacons need not be the log's.
fn scene(common: &Common) -> RobotScene {
    let robot = common.load(false).map(|config| (config.robot.general.name, config.robot.sensors));
    let (name, sensors) = robot.unwrap_or_else(|_| (String::new(), Sensors::usual()));
    let sonar = Sensor::srf08(sensors.srf08.beam_rad);
    RobotScene { name, sonar, infrared: Sensor::GP2Y0A41, ..RobotScene::default() }
}

/// The way of all messages.
struct Run<'a> {
    translator: Translator,
    folder: &'a Path,
    robot: &'a str,
    files: u32,
    messages: u64,
    untranslated: u64,
}

/// Output file.
struct Out {
    new: New,
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    bytes: u64,
    /// Numbers of the channels: of name and type, of the translator's topic.
    raw: BTreeMap<(String, Option<String>), u16>,
    topics: BTreeMap<u16, u16>,
}

impl Run<'_> {
    fn open(&mut self) -> Result<Out, Failed> {
        let path = self.folder.join(format!("log_{:03}.mcap", self.files));
        let (new, file) = New::create(&path)?;
        let failed = |error: McapError| Failed::from(format!("{}: {error}", path.display()));
        let mut writer =
            Writer::with_options(BufWriter::with_capacity(1 << 20, file), options("ros2")).map_err(failed)?;
        let about = [("robot", self.robot), ("version", env!("CARGO_PKG_VERSION")), ("imported", "lcm event log")];
        let metadata = about.iter().map(|(key, value)| ((*key).into(), (*value).into())).collect();
        writer.write_metadata(&Metadata { name: "advee".into(), metadata }).map_err(failed)?;
        for (name, text) in messages::LCM_FILES.iter().filter(|_| self.files == 0) {
            let (name, media_type, data) = ((*name).into(), "text/plain".into(), Cow::Borrowed(text.as_bytes()));
            writer.attach(&Attachment { log_time: 0, create_time: 0, name, media_type, data }).map_err(failed)?;
        }
        self.files += 1;
        Ok(Out { new, path, writer, bytes: 0, raw: BTreeMap::new(), topics: BTreeMap::new() })
    }

    fn take(&mut self, item: &Item<'_>, out: &mut Out) -> Result<(), Failed> {
        let sequence = self.messages as u32;
        self.messages += 1;
        let kind = self.translator.kind(item.channel, item.data);
        let us = kind.and_then(|kind| kind.timestamp(item.data)).and_then(|us| u64::try_from(us).ok());
        let publish_time = us.filter(|us| *us > 0).and_then(|us| us.checked_mul(1000)).unwrap_or(item.log_time);
        let ty = kind.map(|kind| kind.name.to_string());
        let key = (item.channel.to_owned(), ty);
        let channel_id = match out.raw.get(&key) {
            Some(id) => *id,
            None => {
                let schema = kind.map(|kind| out.writer.add_schema(&kind.name, "", &[]));
                let schema = schema.transpose().map_err(|error| out.failed(&error))?.unwrap_or(0);
                let added = out.writer.add_channel(schema, item.channel, "lcm", &logger::types(kind));
                let id = added.map_err(|error| out.failed(&error))?;
                out.raw.insert(key, id);
                id
            }
        };
        let header = MessageHeader { channel_id, sequence, log_time: item.log_time, publish_time };
        let written = out.writer.write_to_known_channel(&header, item.data);
        written.map_err(|error| out.failed(&error))?;
        out.bytes += item.data.len() as u64;
        let mut wrong = None;
        let translated = self.translator.translate(item.channel, item.data, &mut |topic, cdr| {
            if wrong.is_none() {
                wrong = out.put(topic, header, cdr).err();
            }
        });
        self.untranslated += u64::from(translated.is_err());
        wrong.map_or(Ok(()), |error| Err(out.failed(&error)))
    }
}

impl Out {
    fn put(&mut self, topic: &Topic, header: MessageHeader, cdr: &[u8]) -> Result<(), McapError> {
        let channel_id = match self.topics.get(&topic.id) {
            Some(id) => *id,
            None => {
                let schema = self.writer.add_schema(&topic.schema_name, "ros2msg", topic.schema_text.as_bytes())?;
                let id = self.writer.add_channel(schema, &topic.name, "cdr", &BTreeMap::new())?;
                self.topics.insert(topic.id, id);
                id
            }
        };
        self.bytes += cdr.len() as u64;
        self.writer.write_to_known_channel(&MessageHeader { channel_id, ..header }, cdr)
    }

    fn failed(&self, error: &McapError) -> Failed {
        format!("{}: {error}", self.path.display()).into()
    }

    fn finish(mut self) -> Result<(), Failed> {
        let finished = self.writer.finish();
        finished.map_err(|error| self.failed(&error))?;
        let path = self.path.clone();
        self.writer.into_inner().flush().map_err(|error| Failed::from(format!("{}: {error}", path.display())))?;
        self.new.finish()
    }
}
