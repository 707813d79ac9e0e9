//! `advee log diff`: two logs, channel by channel.

use super::decode::Decoder;
use super::select::{Select, Selection};
use super::source::{Item, Items, Log};
use crate::lcm::table::shown;
use crate::lcm::types::TypesArg;
use crate::progress::Progress;
use crate::{Failed, Outcome, print};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Diff {
    /// A log
    a: PathBuf,
    /// Another log
    b: PathBuf,
    /// Compare times of reception too
    #[arg(long)]
    times: bool,
    #[command(flatten)]
    select: Select,
    /// JSON lines, one for each channel that differs
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    types: TypesArg,
}

/// Comparable form of a message: content and time.
#[derive(Clone, Copy, PartialEq)]
struct Print {
    payload: u64,
    time: u64,
}

/// Both sides of a channel.
#[derive(Default)]
struct Side {
    /// Messages of A and of B.
    count: [u64; 2],
    /// Messages of the side that is ahead.
    ahead: VecDeque<Print>,
    /// Number of the first pair that differs.
    differs: Option<u64>,
}

pub fn diff(command: &Diff) -> Outcome {
    let logs = [Log::open(&command.a)?, Log::open(&command.b)?];
    let selections = [Selection::of(&command.select, &logs[0])?, Selection::of(&command.select, &logs[1])?];
    let open = || Ok::<_, Failed>([logs[0].items(&selections[0])?, logs[1].items(&selections[1])?]);
    let channels = compare(open()?, command.times)?;
    let mut different = 0;
    let mut decoders = [Decoder::new(&command.types)?, Decoder::new(&command.types)?];
    for (name, side) in channels.iter().filter(|(_, side)| side.differs.is_some() || side.count[0] != side.count[1]) {
        different += 1;
        let mut shown = [Value::Null, Value::Null];
        if let Some(number) = side.differs {
            for ((items, shown), decoder) in open()?.iter_mut().zip(&mut shown).zip(&mut decoders) {
                *shown = nth(items, name, number, decoder)?;
            }
        }
        tell(command, name, side, &shown)?;
    }
    let messages: u64 = channels.values().map(|side| side.count[0]).sum();
    if different == 0 {
        if !command.json {
            print(format_args!("the same: {messages} messages on {} channels", channels.len()))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    Err(Failed { code: 1, why: format!("{different} of {} channels differ", channels.len()) })
}

fn compare(mut items: [Items; 2], times: bool) -> Result<BTreeMap<(String, String), Side>, Failed> {
    let mut channels: BTreeMap<(String, String), Side> = BTreeMap::new();
    let mut progress = Progress::new("comparing");
    let (mut open, mut count) = ([true; 2], 0_u64);
    // One of each in turn, so that neither side gets far ahead.
    while open[0] || open[1] {
        for log in 0..2 {
            let Some(item) = items[log].next()? else {
                open[log] = false;
                continue;
            };
            let print = Print { payload: hash(item.data), time: if times { item.log_time } else { 0 } };
            let key = (item.channel.to_owned(), item.encoding.to_owned());
            let side = match channels.get_mut(&key) {
                Some(side) => side,
                None => channels.entry(key).or_default(),
            };
            take(side, log, print);
            count += 1;
        }
        if count.is_multiple_of(4096) {
            let (a, b) = (items[0].progress(), items[1].progress());
            progress.tell(a.0 + b.0, a.1 + b.1);
        }
    }
    Ok(channels)
}

fn take(side: &mut Side, log: usize, print: Print) {
    let ahead = side.count[log] >= side.count[1 - log];
    side.count[log] += 1;
    if side.differs.is_some() {
        return;
    }
    if ahead {
        side.ahead.push_back(print);
    } else if side.ahead.pop_front() != Some(print) {
        side.differs = Some(side.count[log] - 1);
        side.ahead = VecDeque::new();
    }
}

fn hash(data: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    data.hash(&mut hasher);
    hasher.finish()
}

/// Time and content of a channel's message of that number.
fn nth(items: &mut Items, name: &(String, String), number: u64, decoder: &mut Decoder) -> Result<Value, Failed> {
    let mut count = 0;
    while let Some(item) = items.next()? {
        if item.channel != name.0 || item.encoding != name.1 {
            continue;
        }
        if count == number {
            return Ok(content(&item, decoder));
        }
        count += 1;
    }
    Ok(Value::Null)
}

fn content(item: &Item<'_>, decoder: &mut Decoder) -> Value {
    let message = match decoder.decode(item) {
        Ok(message) => serde_json::to_value(message).unwrap_or_default(),
        Err(_) => json!({ "bytes": item.data.len(), "begin": hex(item.data) }),
    };
    json!({ "log_time": item.log_time, "message": message })
}

fn hex(data: &[u8]) -> String {
    data.iter().take(32).map(|byte| format!("{byte:02x}")).collect()
}

fn tell(command: &Diff, name: &(String, String), side: &Side, messages: &[Value; 2]) -> Result<(), Failed> {
    let [a, b] = side.count;
    if command.json {
        return print(json!({
            "channel": name.0, "encoding": name.1, "messages": side.count, "first": side.differs,
            "a": messages[0], "b": messages[1],
        }));
    }
    let counts = if a == b { format!("{a} messages") } else { format!("{a} messages, {b} in the other") };
    match side.differs {
        None => print(format_args!("{}: {counts}, the same as far as both go", shown(&name.0))),
        Some(number) => {
            print(format_args!("{}: {counts}, number {number} is the first that differs", shown(&name.0)))?;
            print(format_args!("  a {}", messages[0]))?;
            print(format_args!("  b {}", messages[1]))
        }
    }
}
