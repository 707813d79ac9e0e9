//! `advee can sdo read`, `write`, `upload` and `download`: one object of one node.

use super::access::{Access, Ended, Job};
use super::book::Book;
use super::target::{Target, Where};
use super::value;
use crate::commands::commands;
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, print};
use base::Duration;
use canopen::Abort;
use canopen::dictionary::DataType;
use canopen::sdo::{Error, MAX_LEN};
use serde_json::{Value, json};
use std::fs;
use std::io::{Read, Write, stdin, stdout};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

commands! {
    |common, command|
    pub enum Sdo {
        /// Read an object
        Read(ReadObject) => read(common, command),
        /// Set an object
        Write(WriteObject) => write(common, command),
        /// Read an object into a file
        Upload(Upload) => upload(common, command),
        /// Write an object from a file
        Download(Download) => download(common, command),
    }
}

/// Which object of which node.
#[derive(clap::Args)]
struct Of {
    /// Node, by its id or the name of its axis
    node: String,
    /// 0x6041, 0x1018:1, or a name of its data sheet or the standards: Statusword
    object: String,
    #[command(flatten)]
    place: Where,
    /// Electronic data sheet (EDS or DCF) [default: eds of robot.toml, else its driver's own]
    #[arg(long, value_name = "FILE")]
    eds: Option<PathBuf>,
    /// Time limit of the node's answer, ms
    #[arg(long, value_name = "MS", default_value = "500", value_parser = clap::value_parser!(u64).range(1..=60_000))]
    timeout: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
pub struct ReadObject {
    #[command(flatten)]
    of: Of,
    /// Type, where no data sheet has it: u16, i32, text, UNSIGNED8, …
    #[arg(long = "type", value_name = "TYPE", value_parser = value::data_type)]
    data_type: Option<DataType>,
}

#[derive(clap::Args)]
pub struct WriteObject {
    #[command(flatten)]
    of: Of,
    /// Value by its type; without a type 0x and 2, 4, 8 or 16 digits
    #[arg(allow_hyphen_values = true, value_parser = written)]
    value: String,
    /// Type, where no data sheet has it: u16, i32, text, UNSIGNED8, …
    #[arg(long = "type", value_name = "TYPE", value_parser = value::data_type)]
    data_type: Option<DataType>,
}

/// A value may be a negative number in any notation; anything else with a hyphen is a mistyped option.
fn written(text: &str) -> Result<String, String> {
    let number =
        |text: &str| text.starts_with(|c: char| c.is_ascii_digit() || c == '.') || ["inf", "NaN"].contains(&text);
    match text.strip_prefix('-') {
        Some(rest) if !number(rest) => Err("no such option; write `-- VALUE` for a text that begins so".into()),
        _ => Ok(text.into()),
    }
}

#[derive(clap::Args)]
pub struct Upload {
    #[command(flatten)]
    of: Of,
    /// Output file; - for stdout
    file: PathBuf,
    /// By block transfer, if the node can
    #[arg(long)]
    block: bool,
}

#[derive(clap::Args)]
pub struct Download {
    #[command(flatten)]
    of: Of,
    /// Input file; - for stdin
    file: PathBuf,
    /// By block transfer, if the node can
    #[arg(long)]
    block: bool,
}

fn read(common: &Common, ReadObject { of, data_type }: &ReadObject) -> Outcome {
    let mut asked = Asked::new(common, of)?;
    let (data, took) = asked.run(None, false)?;
    let data_type = data_type.or_else(|| asked.data_type());
    let shown = value::show(asked.object.0, data_type, &data);
    let more = json!({"value": shown.json, "text": shown.text, "data": data});
    asked.say(&format!(" = {}", shown.text), took, more)
}

fn write(common: &Common, WriteObject { of, value, data_type }: &WriteObject) -> Outcome {
    let mut asked = Asked::new(common, of)?;
    let data_type = data_type.or_else(|| asked.data_type());
    let data = value::parse(data_type, value)?;
    let (_, took) = asked.run(Some(data.clone()), false)?;
    let shown = value::show(asked.object.0, data_type, &data);
    let more = json!({"value": shown.json, "text": shown.text, "data": data});
    asked.say(&format!(" = {}, written", shown.text), took, more)
}

fn upload(common: &Common, Upload { of, file, block }: &Upload) -> Outcome {
    let mut asked = Asked::new(common, of)?;
    let (data, took) = asked.run(None, *block)?;
    let is_stdout = file.as_os_str() == "-";
    let written = if is_stdout { stdout().write_all(&data) } else { fs::write(file, &data) };
    written.map_err(|error| format!("{}: {error}", file.display()))?;
    if is_stdout { Ok(ExitCode::SUCCESS) } else { asked.say_moved(&data, took, "read into", file) }
}

fn download(common: &Common, Download { of, file, block }: &Download) -> Outcome {
    let data = contents(file)?;
    if data.is_empty() || data.len() > MAX_LEN {
        return Err(format!("{}: {} bytes, expected 1 to {MAX_LEN}", file.display(), data.len()).into());
    }
    let mut asked = Asked::new(common, of)?;
    let (_, took) = asked.run(Some(data.clone()), *block)?;
    asked.say_moved(&data, took, "written from", file)
}

fn contents(file: &Path) -> Result<Vec<u8>, Failed> {
    let mut data = Vec::new();
    // One byte more shows that the file is too long.
    let most = MAX_LEN as u64 + 1;
    let read = match file.as_os_str() == "-" {
        true => stdin().take(most).read_to_end(&mut data),
        false => fs::File::open(file).and_then(|open| open.take(most).read_to_end(&mut data)),
    };
    read.map_err(|error| format!("{}: {error}", file.display()))?;
    Ok(data)
}

/// Requested object, and the access to it.
struct Asked<'a> {
    of: &'a Of,
    target: Target,
    book: Book,
    access: Access,
    node: u8,
    object: (u16, u8),
}

impl<'a> Asked<'a> {
    fn new(common: &Common, of: &'a Of) -> Result<Self, Failed> {
        let target = of.place.find(common)?;
        let node = target.node(&of.node)?;
        let book = Book::new(&target, of.eds.as_deref())?;
        let object = book.resolve(node, &of.object)?;
        let access = Access::open(&target, Duration::from_millis(of.timeout))?;
        Ok(Self { of, target, book, access, node, object })
    }

    fn data_type(&self) -> Option<DataType> {
        self.book.data_type(self.node, self.object.0, self.object.1)
    }

    fn title(&self) -> String {
        format!("{}: {}", self.target.text(self.node), self.book.titled(self.node, self.object.0, self.object.1))
    }

    /// Reads or writes it; its data and how long it took.
    fn run(&mut self, data: Option<Vec<u8>>, block: bool) -> Result<(Vec<u8>, Duration), Failed> {
        let writes = data.is_some();
        let job = Job { data, block, ..Job::read(self.node, self.object) };
        let mut progress = Progress::new(if writes { "writing" } else { "reading" });
        let through = self.access.through().map(String::from);
        let all = job.data.as_ref().and_then(|data| u32::try_from(data.len()).ok());
        let ended =
            self.access.ask(job, &mut |moved, size| show(&mut progress, moved, all.or(size), through.as_deref()));
        progress.clear();
        let Ended { result, took, .. } = ended?;
        result.map(|data| (data, took)).map_err(|error| self.refused(error, writes, block))
    }

    fn refused(&self, error: Error, writes: bool, block: bool) -> Failed {
        let why = match (error, self.access.through()) {
            (Error::Refused(Abort::LOCAL_CONTROL | Abort::DEVICE_STATE), Some(module)) if writes => format!(
                "{error}: {module} holds {} and lets nobody else write what moves or guards a drive, nor anything else \
                 of one while the robot moves; stop it first (advee state {module} TERMINATE)",
                self.target.name
            ),
            (Error::Refused(Abort::TIMEOUT), _) if block => {
                format!("{error}; a block that lost its last frame cannot be saved: try again, or without --block")
            }
            (Error::Refused(code), _) => format!("refused: {}", self.book.abort(self.node, code)),
            _ => error.to_string(),
        };
        format!("{}: {why}", self.title()).into()
    }

    fn say(&self, what: &str, took: Duration, mut more: Value) -> Outcome {
        if !self.of.json {
            let through = self.access.through().map(|module| format!(", through {module}")).unwrap_or_default();
            print(format!("{}{what} ({:.2} ms{through})", self.title(), took.as_secs_f64() * 1e3))?;
            return Ok(ExitCode::SUCCESS);
        }
        let (index, sub) = self.object;
        more["bus"] = self.target.name.as_str().into();
        (more["node"], more["index"], more["sub"]) = (self.node.into(), index.into(), sub.into());
        more["object"] = self.book.name(self.node, index, sub).into();
        (more["through"], more["seconds"]) = (self.access.through().into(), took.as_secs_f64().into());
        print(more).map(|()| ExitCode::SUCCESS)
    }

    fn say_moved(&self, data: &[u8], took: Duration, how: &str, file: &Path) -> Outcome {
        let rate = data.len() as f64 / took.as_secs_f64().max(1e-9) / 1e3;
        let what = format!(": {} bytes {how} {}, {rate:.1} kB/s", data.len(), file.display());
        self.say(&what, took, json!({"len": data.len(), "file": file.display().to_string()}))
    }
}

/// Shows bytes moved of all, where that is known. Through a module nothing is known but that it takes its time.
fn show(progress: &mut Progress, moved: usize, size: Option<u32>, through: Option<&str>) {
    let rate = |took: Duration| format!("{:.1} kB/s", moved as f64 / took.as_secs_f64().max(1e-3) / 1e3);
    match (size.filter(|size| *size > 0), through) {
        (_, Some(module)) => progress.open(|_| format!("through {module}")),
        (Some(all), None) => {
            progress.show(moved as f64 / f64::from(all), |took| format!("{moved} of {all} bytes  {}", rate(took)));
        }
        (None, None) => progress.open(|took| format!("{moved} bytes  {}", rate(took))),
    }
}
