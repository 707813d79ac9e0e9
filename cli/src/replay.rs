//! `advee replay RUN`: makes each module of a run again, tells it what it was told, and compares what it answers.

use super::progress::Progress;
use super::{Common, Failed, Outcome, print};
use base::{Epoch, Instant, can, store};
use host::clock;
use host::log::TimeOfDay;
use host::recorder;
use module::{Action, Output, PortId, PortSpec};
use record::{Difference, End, First, Item, Player, Reader, Refusal};
use robot::recording;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// A file of inputs is read whole; one that is longer is none of ours.
pub(super) const FILE_MAX: u64 = 4 << 30;

#[derive(clap::Args)]
pub struct Replay {
    /// The folder of a run, or one file of its inputs
    run: PathBuf,
    /// Only this module; all of its lives
    #[arg(long, value_name = "NAME")]
    module: Option<String>,
    /// JSON lines, one for each life of a module
    #[arg(long)]
    json: bool,
}

/// What became of one file.
struct Played {
    /// Name: the module, and `.2` on for later lives.
    name: String,
    calls: u64,
    actions: u64,
    /// From its first call to its last one.
    span: (Instant, Instant),
    epoch: Epoch,
    /// How long it took to play, s.
    took: f64,
    /// Made by another program than this.
    other: Option<String>,
    outcome: Verdict,
}

enum Verdict {
    Same(End),
    Different(Box<Difference>, Vec<PortSpec>),
    Refused(Refusal),
    /// The module cannot be made again.
    Unmade(String),
}

pub fn replay(common: &Common, command: &Replay) -> Outcome {
    let files = files(&command.run, command.module.as_deref())?;
    let len = |path: &PathBuf| fs::metadata(path).map_or(0, |data| data.len());
    let whole = files.iter().map(len).sum();
    let (mut all, mut before, mut progress) = (Vec::new(), 0, Progress::new("replaying"));
    for file in &files {
        let played = play(file, &common.sets, &mut |place| progress.tell(before + place, whole))?;
        before += len(file);
        progress.clear();
        match command.json {
            true => print(as_json(&played))?,
            false => as_text(&played).iter().try_for_each(print)?,
        }
        all.push(played);
    }
    let same = all.iter().filter(|played| matches!(played.outcome, Verdict::Same(_))).count();
    if !command.json {
        let calls: u64 = all.iter().map(|played| played.calls).sum();
        let took: f64 = all.iter().map(|played| played.took).sum();
        print(format_args!("{same} of {} are the same; {calls} events, {:.0} events/s", all.len(), rate(calls, took)))?;
    }
    Ok(if same == all.len() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The files that are asked for, by name.
pub(super) fn files(run: &Path, module: Option<&str>) -> Result<Vec<PathBuf>, Failed> {
    if run.is_file() {
        return Ok(vec![run.into()]);
    }
    let folder = run.join(recorder::FOLDER);
    let refused =
        |error| format!("{}: {error}; a run has it when it was recorded with log.inputs = true", folder.display());
    let entries = fs::read_dir(&folder).map_err(refused)?;
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.retain(|path| path.is_file() && module.is_none_or(|module| of_module(path) == module));
    files.sort_by_key(|path| (of_module(path).to_string(), name(path).len(), name(path)));
    match files.is_empty() {
        true => Err(format!("{}: no inputs of {}", folder.display(), module.unwrap_or("any module")).into()),
        false => Ok(files),
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn of_module(path: &Path) -> &str {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.split('.').next().unwrap_or_default()
}

/// Plays a file; `told` of its bytes so far.
fn play(path: &Path, sets: &[String], told: &mut dyn FnMut(u64)) -> Result<Played, Failed> {
    let named = |error| format!("{}: {error}", path.display());
    if fs::metadata(path).map_err(named)?.len() > FILE_MAX {
        return Err(format!("{}: longer than {} GiB", path.display(), FILE_MAX >> 30).into());
    }
    let bytes = fs::read(path).map_err(named)?;
    let begin = clock::now();
    let mut played = Played {
        name: name(path),
        calls: 0,
        actions: 0,
        span: (Instant::ZERO, Instant::ZERO),
        epoch: Epoch::default(),
        took: 0.0,
        other: None,
        outcome: Verdict::Same(End::Open),
    };
    played.outcome = match Reader::open(&bytes).and_then(Reader::comparable) {
        Ok(reader) => {
            played.other = Some(reader.header().program.clone()).filter(|other| *other != recording::program());
            match recording::rebuild(reader.header(), sets) {
                Ok(shell) => follow(reader, Player::new(shell), &mut played, told).unwrap_or_else(Verdict::Refused),
                Err(error) => Verdict::Unmade(error.to_string()),
            }
        }
        Err(refusal) => Verdict::Refused(refusal),
    };
    played.took = clock::now().since(begin).as_secs_f64();
    Ok(played)
}

/// Plays a file to its end, or to where that makes no sense any more.
fn follow(
    mut reader: Reader<'_>,
    mut player: Player,
    played: &mut Played,
    told: &mut dyn FnMut(u64),
) -> Result<Verdict, Refusal> {
    let mut verdict = Verdict::Same(End::Open);
    while let Some(item) = reader.read()? {
        match item {
            Item::Record(record) => {
                told(record.place as u64);
                if played.calls == 0 {
                    (played.span.0, played.epoch) = (record.at, record.epoch);
                }
                match player.play(&record)? {
                    Ok(actions) => played.actions += actions as u64,
                    Err(difference) => {
                        return Ok(Verdict::Different(difference, player.shell().module().ports().to_vec()));
                    }
                }
                played.calls += 1;
                played.span.1 = record.at;
            }
            Item::End(end) => verdict = Verdict::Same(end),
        }
    }
    Ok(verdict)
}

fn rate(calls: u64, took: f64) -> f64 {
    calls as f64 / took.max(1e-9)
}

impl Played {
    fn seconds(&self, at: Instant) -> f64 {
        at.since(self.span.0).as_secs_f64()
    }

    /// A moment as the logs have it, and on the module's own scale.
    fn moment(&self, at: Instant) -> String {
        let wall = u64::try_from(self.epoch.timestamp(at)).unwrap_or_default().saturating_mul(1000);
        format!("{} UTC, {:.6} s after its start", TimeOfDay(wall), self.seconds(at))
    }
}

fn as_text(played: &Played) -> Vec<String> {
    let other = played.other.as_ref().map_or(String::new(), |other| format!("; recorded by {other}"));
    let line = |word: &str, rest: String| format!("{:20} {word:10} {rest}{other}", played.name);
    let so_far = format!("the {} events before it are the same", played.calls);
    match &played.outcome {
        Verdict::Same(end) => {
            let end = match end {
                End::Exited => "",
                End::Limit => "; its file was full then",
                End::Open => "; then it was killed, or it runs yet",
            };
            let rate = rate(played.calls, played.took);
            let (calls, actions, seconds) = (played.calls, played.actions, played.seconds(played.span.1));
            let rest = format!("{calls} events, {actions} actions in {seconds:.1} s{end}; {rate:.0} events/s");
            vec![line("same", rest)]
        }
        Verdict::Different(difference, ports) => {
            let moment = played.moment(difference.at);
            let rest = format!("at {moment}, record {}, on {}; {so_far}", difference.record, difference.call);
            let mut lines = vec![line("DIFFERENT", rest)];
            let compared = Compared::new(difference, ports);
            lines.push(format!("    {}", compared.title()));
            lines.extend(compared.fields.iter().map(|(name, was, is)| format!("    {name}: {was} -> {is}")));
            lines
        }
        Verdict::Refused(refusal) if played.calls == 0 => vec![line("REFUSED", refusal.to_string())],
        Verdict::Refused(refusal) => {
            vec![line("REFUSED", format!("{refusal}, after {}; {so_far}", played.moment(refusal.after)))]
        }
        Verdict::Unmade(why) => vec![line("REFUSED", format!("it cannot be made again: {}", why.replace('\n', "; ")))],
    }
}

fn as_json(played: &Played) -> Value {
    let mut value = json!({
        "file": played.name,
        "module": played.name.split('.').next(),
        "events": played.calls,
        "actions": played.actions,
        "seconds": played.seconds(played.span.1),
        "events_per_second": rate(played.calls, played.took),
        "recorded_by": played.other.clone().unwrap_or_else(recording::program),
    });
    let (result, details) = match &played.outcome {
        Verdict::Same(end) => ("same", json!({ "end": format!("{end:?}").to_lowercase() })),
        Verdict::Different(difference, ports) => {
            let compared = Compared::new(difference, ports);
            let fields = compared.fields.iter().map(|(name, was, is)| json!({ "field": name, "was": was, "is": is }));
            let details = json!({
                "record": difference.record,
                "time": played.seconds(difference.at),
                "timestamp": played.epoch.timestamp(difference.at),
                "on": difference.call,
                "action": compared.place,
                "channel": compared.channel,
                "was": compared.was,
                "is": compared.is,
                "fields": fields.collect::<Vec<_>>(),
            });
            ("different", details)
        }
        Verdict::Refused(refusal) => {
            let details = json!({
                "why": refusal.why.to_string(),
                "byte": refusal.place,
                "record": refusal.record,
                "time": played.seconds(refusal.after),
            });
            ("refused", details)
        }
        Verdict::Unmade(why) => ("refused", json!({ "why": why })),
    };
    value["result"] = result.into();
    value[result] = details;
    value
}

/// Two answers side by side.
struct Compared {
    /// Which action of the answer, from 1; none: when to be woken.
    place: Option<usize>,
    /// Where it goes: a channel, a bus, or what else it is. Of the recorded one, where they differ in that.
    channel: String,
    was: Value,
    is: Value,
    /// Fields that differ: name, as recorded, as of now.
    fields: Vec<(String, Value, Value)>,
}

impl Compared {
    fn new(difference: &Difference, ports: &[PortSpec]) -> Self {
        let (place, was, is) = match &difference.first {
            First::Wake { was, is } => {
                let wake = |wake: &Option<Instant>| {
                    let seconds = wake.map(|at| match at >= difference.at {
                        true => at.since(difference.at).as_secs_f64(),
                        false => -difference.at.since(at).as_secs_f64(),
                    });
                    Some((String::from("timer"), json!({ "due in s": seconds })))
                };
                (None, wake(was), wake(is))
            }
            First::Action { place, was, is } => {
                let shown = |action: &Option<Box<Action>>| action.as_ref().map(|action| show(action, ports));
                (Some(place + 1), shown(was), shown(is))
            }
        };
        let channel = was.as_ref().or(is.as_ref()).map(|(channel, _)| channel.clone()).unwrap_or_default();
        let fields = match (&was, &is) {
            (Some((was_on, was)), Some((is_on, is))) if was_on == is_on => differing(was, is),
            (was, is) => {
                let whole = |side: &Option<(String, Value)>| match side {
                    Some((channel, value)) => json!({ channel: value }),
                    None => Value::Null,
                };
                vec![("action".into(), whole(was), whole(is))]
            }
        };
        let value = |side: Option<(String, Value)>| side.map_or(Value::Null, |(_, value)| value);
        Self { place, channel, was: value(was), is: value(is), fields }
    }

    fn title(&self) -> String {
        match self.place {
            Some(place) => format!("its action {place}, {}, recorded -> now:", self.channel),
            None => "when it wants to be woken, recorded -> now:".into(),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

/// Where an action goes, and its fields.
fn show(action: &Action, ports: &[PortSpec]) -> (String, Value) {
    let bus =
        |PortId(port): PortId| ports.get(usize::from(port)).map_or(format!("port {port}"), |spec| spec.bus.clone());
    let plain = |what: &str, value: Value| (what.to_string(), json!({ what: value }));
    match action {
        Action::Publish(message) => {
            (message.channel_name().into_owned(), serde_json::to_value(message).unwrap_or_default())
        }
        Action::Send(port, Output::Can(frame)) => {
            let id = match frame.id() {
                can::Id::Standard(id) => format!("{id:03X}"),
                can::Id::Extended(id) => format!("{id:08X}"),
            };
            let (remote, length, data) = (frame.is_remote(), frame.dlc(), hex(frame.data()));
            (bus(*port), json!({ "id": id, "remote": remote, "length": length, "data": data }))
        }
        Action::Send(port, Output::Words(words)) => {
            let word = |word: &base::serial::Word| format!("{}{:02X}", if word.ninth { "*" } else { "" }, word.byte);
            (bus(*port), json!({ "words": words.iter().map(word).collect::<Vec<_>>().join(" ") }))
        }
        Action::Send(port, Output::I2c(transfer)) => {
            let read = format!("{:?}", transfer.read);
            let address = transfer.address.to_string();
            (bus(*port), json!({ "address": address, "write": hex(&transfer.write), "read": read }))
        }
        Action::Send(port, Output::I2cAnswer(Ok(read))) => (bus(*port), json!({ "read": hex(read) })),
        Action::Send(port, Output::I2cAnswer(Err(error))) => (bus(*port), json!({ "error": error.to_string() })),
        Action::Send(port, Output::OneWire(request)) => (bus(*port), json!({ "asked": format!("{request:?}") })),
        Action::Send(port, Output::OneWireState(answer)) => (bus(*port), json!({ "is": format!("{answer:?}") })),
        Action::Send(port, Output::Thermal) => (bus(*port), json!({ "asked": "temperatures" })),
        Action::Send(port, Output::ThermalState(state)) => (bus(*port), json!({ "is": format!("{state:?}") })),
        Action::Send(port, Output::Store(store::Request::Append { bytes, sync })) => {
            (bus(*port), json!({ "append": bytes.len(), "sync": sync }))
        }
        Action::Send(port, Output::Store(request)) => (bus(*port), json!({ "asked": format!("{request:?}") })),
        Action::Send(port, Output::Gpio(signal)) => (bus(*port), json!({ "gpio": format!("{signal:?}") })),
        Action::Send(port, Output::Gamepad(event)) => (bus(*port), json!({ "gamepad": format!("{event:?}") })),
        Action::Report(report) | Action::Raise(report) | Action::Clear(report) => {
            let fields = json!({
                "fault": report.fault.name(),
                "subject": report.subject,
                "severity": format!("{:?}", report.severity),
                "message": report.message,
                "fatal": report.fatal,
                "file": report.location.file,
                "line": report.location.line,
            });
            ("report".into(), fields)
        }
        Action::Note(_, line) => plain("note", line.as_str().into()),
        Action::Condition(condition) => plain("condition", format!("{condition:?}").into()),
        Action::Process(command) => plain("process", format!("{command:?}").into()),
        Action::Run(command) => plain("run", command.join(" ").into()),
        Action::State(state) => plain("state", state.name().into()),
        Action::Exit(code) => plain("exit", (*code).into()),
    }
}

/// The fields in which two values differ, by their path. Values that JSON shows alike differ in their bits.
fn differing(was: &Value, is: &Value) -> Vec<(String, Value, Value)> {
    let mut fields = Vec::new();
    compare("", was, is, &mut fields);
    if fields.is_empty() {
        fields.push(("bits".into(), was.clone(), is.clone()));
    }
    fields
}

fn compare(path: &str, was: &Value, is: &Value, fields: &mut Vec<(String, Value, Value)>) {
    let below = |key: &str| if path.is_empty() { key.to_string() } else { format!("{path}.{key}") };
    match (was, is) {
        (Value::Object(was), Value::Object(is)) => {
            for (key, value) in was {
                compare(&below(key), value, is.get(key).unwrap_or(&Value::Null), fields);
            }
        }
        (Value::Array(was), Value::Array(is)) if was.len() == is.len() => {
            for (n, (was, is)) in was.iter().zip(is).enumerate() {
                compare(&format!("{path}[{n}]"), was, is, fields);
            }
        }
        (was, is) if was != is => fields.push((path.into(), was.clone(), is.clone())),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_that_differ_are_named_by_their_path() {
        let was = json!({ "a": 1, "b": [{ "c": true }, { "c": false }], "d": [1], "e": null });
        let is = json!({ "a": 1, "b": [{ "c": true }, { "c": true }], "d": [1, 2], "e": null });
        let names: Vec<String> = differing(&was, &is).into_iter().map(|(name, ..)| name).collect();
        assert_eq!(names, ["b[1].c", "d"]);
        assert_eq!(differing(&was, &was)[0].0, "bits");
    }

    #[test]
    fn a_file_is_its_module_s_whichever_life_it_is() {
        assert_eq!(of_module(Path::new("run/inputs/driver_canbus.12")), "driver_canbus");
        assert_eq!(of_module(Path::new("driver_power")), "driver_power");
    }
}
