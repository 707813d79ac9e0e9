//! `advee can scan`: every node id is asked who is there.

use super::access::{Access, Ended, Job};
use super::controllers::{self, Controller};
use super::decode::state_name;
use super::target::{Target, Where};
use super::value;
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, print};
use base::Duration;
use canopen::dictionary::DataType;
use canopen::sdo::Error;
use canopen::{Abort, NmtState};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Scan {
    #[command(flatten)]
    place: Where,
    #[command(flatten)]
    asked: Asked,
    /// JSON lines: one a node
    #[arg(long)]
    json: bool,
}

/// Who is asked, common to the commands that ask every node.
#[derive(clap::Args)]
pub struct Asked {
    /// First node id
    #[arg(long, value_name = "NODE", default_value = "1", value_parser = clap::value_parser!(u8).range(1..=127))]
    from: u8,
    /// Last node id
    #[arg(long, value_name = "NODE", default_value = "127", value_parser = clap::value_parser!(u8).range(1..=127))]
    to: u8,
    /// Time limit of a node's answer, ms; where a module holds the bus, its limit counts
    #[arg(long, value_name = "MS", default_value = "200", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    timeout: u64,
}

/// Objects read from a node, in this order: device type, identity, names and versions.
const OBJECTS: [(u16, u8); 8] =
    [(0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3), (0x1018, 4), (0x1008, 0), (0x1009, 0), (0x100A, 0)];
const NUMBERS: usize = 5;
/// A node that does not answer is asked again; a module that has no room for a question, too.
const TRIES: u32 = 2;
/// A module waits longer for an answer.
const TRIES_THROUGH: u32 = 1;
const TRIES_BUSY: u32 = 100;
/// Heartbeats of those who were found are waited for.
const HEARTBEATS: Duration = Duration::from_millis(300);

/// A node that is being asked.
#[derive(Default)]
pub struct Row {
    /// Answers in the order of [`OBJECTS`].
    said: Vec<Option<Vec<u8>>>,
    tries: u32,
    /// First answer came after this.
    took: Option<Duration>,
    state: Option<NmtState>,
}

/// Who answered.
struct Answers {
    access: Access,
    rows: BTreeMap<u8, Row>,
    interrupted: bool,
}

impl Asked {
    fn ask(&self, target: &Target) -> Result<Answers, Failed> {
        let mut access = Access::open(target, Duration::from_millis(self.timeout))?;
        // The module does not ask itself.
        let itself = target.master.filter(|_| access.held.is_some());
        let ids = (self.from..=self.to).filter(|node| Some(*node) != itself);
        let (rows, interrupted) = ask(&mut access, ids.collect())?;
        let rows = rows.into_iter().filter(|(_, row)| row.took.is_some()).collect();
        Ok(Answers { access, rows, interrupted })
    }

    /// Asks who is there, and then who is there beside CANopen, unless a module holds the bus. Fails if nobody is, or
    /// when it is interrupted.
    pub fn everybody(&self, target: &Target) -> Result<(BTreeMap<u8, Row>, Vec<Controller>), Failed> {
        let Answers { rows, interrupted, access } = self.ask(target)?;
        let is_free = access.held.is_none() && !interrupted;
        // A serial device is for one user at a time.
        drop(access);
        let others = match is_free {
            true => controllers::find(target, &(self.from..=self.to), rows.is_empty())?,
            false => Vec::new(),
        };
        ended(target, interrupted, rows.len() + others.len())?;
        Ok((rows, others))
    }
}

pub fn scan(common: &Common, command: &Scan) -> Outcome {
    let target = command.place.find(common)?;
    let Answers { mut access, rows: mut found, interrupted } = command.asked.ask(&target)?;
    let nodes: Vec<u8> = found.keys().copied().collect();
    let states = access.states(&nodes, if interrupted { Duration::ZERO } else { HEARTBEATS })?;
    found.iter_mut().for_each(|(node, row)| row.state = states.get(node).copied());
    let answered = found.len();
    let range = command.asked.from..=command.asked.to;
    for known in target.known.iter().filter(|known| range.contains(&known.id)) {
        found.entry(known.id).or_default();
    }
    let through = access.through();
    if command.json {
        found.iter().try_for_each(|(node, row)| print(row.json(&target, *node, through)))?;
    } else {
        table(&target, &found).iter().try_for_each(print)?;
        let until = if interrupted { ", then interrupted" } else { "" };
        let through = through.map(|module| format!(", through {module}")).unwrap_or_default();
        let s = if answered == 1 { "" } else { "s" };
        print(format!("{answered} node{s} on {}{through}{until}", target.name))?;
    }
    ended(&target, interrupted, answered)?;
    Ok(ExitCode::SUCCESS)
}

/// Whether everybody was asked, and anybody answered.
fn ended(target: &Target, interrupted: bool, answered: usize) -> Result<(), Failed> {
    match (interrupted, answered) {
        (true, _) => Err("interrupted".into()),
        (false, 0) => {
            let what = format!("{}: nobody answers", target.name);
            let look = "power, wires, termination and bit rate are what to look at";
            let others = "ODrives and VESCs are found by identify, while no module holds the bus \
                          (docs/motor-controllers.md)";
            Err(format!("{what}: {look}; {others}").into())
        }
        _ => Ok(()),
    }
}

/// Asks nodes, several at once, and each one thing after the other; whether it was interrupted.
fn ask(access: &mut Access, mut waiting: VecDeque<u8>) -> Result<(BTreeMap<u8, Row>, bool), Failed> {
    let (mut rows, mut asked, all) = (BTreeMap::<u8, Row>::new(), 0, waiting.len());
    let mut progress = Progress::new("scanning");
    loop {
        while asked < access.at_once
            && let Some(node) = waiting.pop_front()
        {
            let next = rows.entry(node).or_default().said.len();
            access.begin(Job::read(node, OBJECTS[next]))?;
            asked += 1;
        }
        if asked == 0 {
            return Ok((rows, false));
        }
        let Some(Ended { node, result, took }) = access.next(&mut |_, _| ())? else {
            return Ok((rows, true));
        };
        asked -= 1;
        let tries = if access.held.is_some() { TRIES_THROUGH } else { TRIES };
        let row = rows.entry(node).or_default();
        // A module whose drives are no nodes of CANopen has no master, and asks nobody.
        let unasked = matches!(result, Err(Error::Refused(Abort::NO_RESOURCE))) && access.held.is_some();
        if unasked && row.took.is_none() {
            continue;
        }
        if row.take(result, took, tries) {
            // Who was found is asked on before anybody else.
            waiting.push_front(node);
        }
        let done = rows.len() - asked.min(rows.len());
        let found = rows.values().filter(|row| row.took.is_some()).count();
        progress.show(done as f64 / all.max(1) as f64, |_| format!("{found} found"));
    }
}

impl Row {
    /// Takes an answer, of which `tries` may be missing; whether there is more to be asked.
    fn take(&mut self, result: Result<Vec<u8>, Error>, took: Duration, tries: u32) -> bool {
        self.tries += 1;
        let said = match result {
            Ok(data) => Some(data),
            Err(Error::Refused(Abort::OUT_OF_MEMORY)) if self.tries < TRIES_BUSY => return true,
            Err(Error::Timeout | Error::Cancelled) if self.tries < tries => return true,
            // No node there, or no longer.
            Err(Error::Timeout | Error::Cancelled) => return false,
            Err(_) => None,
        };
        self.said.push(said);
        self.took.get_or_insert(took);
        self.tries = 0;
        self.said.len() < OBJECTS.len()
    }

    /// Node that answered with these numbers, in the order of [`OBJECTS`].
    #[cfg(test)]
    pub fn stating(numbers: &[Option<u32>]) -> Self {
        let said = numbers.iter().map(|number| number.map(|number| number.to_le_bytes().to_vec()));
        Self { said: said.collect(), ..Self::default() }
    }

    /// Device type, vendor, product, revision or serial number: 0 to 4.
    pub fn number(&self, at: usize) -> Option<u32> {
        let data = self.said.get(at)?.as_ref()?;
        value::number(data).and_then(|number| u32::try_from(number).ok())
    }

    /// Its names and versions, for people.
    pub fn device(&self) -> String {
        let texts = (NUMBERS..OBJECTS.len()).filter_map(|at| self.text(at)).filter(|text| !text.is_empty());
        texts.collect::<Vec<_>>().join(", ")
    }

    fn text(&self, at: usize) -> Option<String> {
        Some(DataType::Text.show(self.said.get(at)?.as_ref()?).trim().into())
    }

    fn json(&self, target: &Target, node: u8, through: Option<&str>) -> Value {
        json!({
            "bus": target.name,
            "node": node,
            "name": Some(target.name_of(node)).filter(|name| !name.is_empty()),
            "configured": target.known.iter().any(|known| known.id == node),
            "missing": self.took.is_none(),
            "state": self.state.map(state_name),
            "device_type": self.number(0),
            "vendor": self.number(1),
            "product": self.number(2),
            "revision": self.number(3),
            "serial": self.number(4),
            "device_name": self.text(NUMBERS),
            "hardware_version": self.text(NUMBERS + 1),
            "software_version": self.text(NUMBERS + 2),
            "round_trip_s": self.took.map(|took| took.as_secs_f64()),
            "through": through,
        })
    }

    /// Columns but the first two.
    fn columns(&self) -> [String; 8] {
        let hex = |at| self.number(at).map_or("-".into(), |number| format!("{number:08X}"));
        let profile = match self.number(0) {
            Some(0) => "none".into(),
            Some(device_type) => format!("CiA {}", device_type & 0xFFFF),
            None => "-".into(),
        };
        [
            self.state.map_or("-", state_name).into(),
            profile,
            hex(1),
            hex(2),
            hex(3),
            hex(4),
            self.took.map_or(String::new(), |took| format!("{:.2}", took.as_secs_f64() * 1e3)),
            self.device(),
        ]
    }
}

fn table(target: &Target, rows: &BTreeMap<u8, Row>) -> Vec<String> {
    if rows.is_empty() {
        return Vec::new();
    }
    let width = rows.keys().map(|node| target.name_of(*node).len()).max().unwrap_or(0).max(4);
    let line = |node: &str, name: &str, [state, profile, vendor, product, revision, serial, ms, device]: [&str; 8]| {
        let identity = format!("{vendor:8}  {product:8}  {revision:8}  {serial:8}");
        let line = format!("{node:>4}  {name:width$}  {state:15}  {profile:8}  {identity}  {ms:>6}  {device}");
        line.trim_end().to_string()
    };
    let heading = ["STATE", "PROFILE", "VENDOR", "PRODUCT", "REVISION", "SERIAL", "ms", "DEVICE"];
    let row = |(node, row): (&u8, &Row)| {
        let name = target.name_of(*node);
        match row.took {
            None => format!("{node:>4}  {name:width$}  MISSING: configured, does not answer"),
            Some(_) => line(&node.to_string(), name, row.columns().each_ref().map(String::as_str)),
        }
    };
    [line("NODE", "NAME", heading)].into_iter().chain(rows.iter().map(row)).collect()
}
