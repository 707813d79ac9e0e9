//! `advee lidar info`: who a lidar is, whether it is well, and how fast it turns, as it says itself.

use super::held::{self, Known};
use super::line::{Line, Measured};
use super::monitor::Row;
use super::target::{self, Held, Target, Where, model_name, port_text};
use crate::{Common, Failed, Outcome, print};
use ::lidar::hokuyo::{self, Hokuyo};
use ::lidar::ld::{self, LdLidar, NoEcho};
use ::lidar::probe::{Identity, Kind, Probe};
use ::lidar::rplidar::{self, Rplidar};
use ::lidar::sick::{self, Sick};
use ::lidar::ydlidar::{self, Ydlidar};
use ::lidar::{Health, LostReason};
use base::Duration;
use drivers::lidar::Model;
use host::log::OneLine;
use messages::lowlevel::DataBus;
use serde_json::{Value, json};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Info {
    #[command(flatten)]
    place: Where,
    /// Only ask: start no scan, so that the speed of the motor is not measured
    #[arg(long)]
    ask: bool,
    /// A JSON object a lidar
    #[arg(long)]
    json: bool,
}

/// Time in which the motor of an RPLIDAR or YDLIDAR reaches its speed.
const SPIN_UP: Duration = Duration::from_millis(2500);
/// Width of the names of figures, and of lidars.
const WIDTH: usize = 10;

/// What came of a lidar.
enum Found {
    /// A module holds its port, and the bus says this.
    Held(Held, Box<Known>),
    /// It said this, and measured that unless it was only asked.
    Said(Box<Identity>, Option<Box<Measured>>),
    /// No answer; so many bytes arrived that belong to none.
    Silent(usize),
}

pub fn info(common: &Common, command: &Info) -> Outcome {
    let targets = command.place.find(common)?;
    let mut silent = Vec::new();
    for target in &targets {
        let Some(found) = look(target, command.ask)? else { return Err("interrupted".into()) };
        if !is_well(target, &found) {
            silent.push(target.name.clone());
        }
        match command.json {
            true => print(to_json(target, &found))?,
            false => lines(target, &found).iter().try_for_each(print)?,
        }
    }
    if silent.is_empty() { Ok(ExitCode::SUCCESS) } else { Err(format!("not well: {}", silent.join(", ")).into()) }
}

/// What a lidar says, or the bus of it; none at Ctrl-C.
fn look(target: &Target, ask: bool) -> Result<Option<Found>, Failed> {
    if let Some(held) = target::held(&target.port) {
        return Ok(held::listen(&held)?.map(|known| Found::Held(held, Box::new(known))));
    }
    let mut line = Line::open(&target.name, target.port.clone())?;
    let Some(probe) = line.probe(target.kind())? else { return Ok(None) };
    let Some(identity) = probe.identity() else { return Ok(Some(Found::Silent(Probe::received(&probe)))) };
    // One that reports an error is not started: the driver would reset it.
    let starts = !ask && is_ours(target, identity) && !matches!(identity.health, Some(Health::Error { .. }));
    if !starts {
        return Ok(Some(Found::Said(Box::new(identity.clone()), None)));
    }
    let measured = start(&mut line, target)?;
    line.leave(identity.kind, identity.rplidar)?;
    Ok(measured.map(|measured| Found::Said(Box::new(identity.clone()), Some(Box::new(measured)))))
}

/// Starts it as its driver does.
fn start(line: &mut Line, target: &Target) -> Result<Option<Measured>, Failed> {
    let no_echo = NoEcho::Unknown;
    match target.model {
        Model::Ld(model) => line.measure(LdLidar::new(ld::Config { model, no_echo }), Duration::ZERO),
        Model::Rplidar(model) => line.measure(Rplidar::new(rplidar::Config::new(model)), SPIN_UP),
        Model::Ydlidar(model) => line.measure(Ydlidar::new(ydlidar::Config::new(model)), SPIN_UP),
        Model::Sick(family) => line.measure(Sick::new(sick::Config::new(family, target.dialect)), Duration::ZERO),
        Model::Hokuyo(name) => line.measure(Hokuyo::new(hokuyo::Config::new(name)), Duration::ZERO),
    }
}

/// True if it is the model that is expected; another one is not started.
fn is_ours(target: &Target, identity: &Identity) -> bool {
    match target.model {
        Model::Ld(_) => true,
        Model::Rplidar(model) => identity.rplidar == Some(model),
        Model::Ydlidar(model) => identity.ydlidar.is_some_and(|number| model.may_have(number)),
        Model::Sick(family) => identity.model.starts_with(family.name_begins().as_bytes()),
        Model::Hokuyo(name) => identity.model.starts_with(name.as_bytes()),
    }
}

fn is_well(target: &Target, found: &Found) -> bool {
    match found {
        Found::Held(_, known) => known.row("").status == "OK" && known.faults.as_ref().is_none_or(Vec::is_empty),
        Found::Said(identity, measured) => {
            let measures = |measured: &Measured| measured.lost.is_none() && measured.faults.is_empty();
            let works = !matches!(identity.health, Some(Health::Error { .. }));
            works && is_ours(target, identity) && measured.as_deref().is_none_or(measures)
        }
        Found::Silent(_) => false,
    }
}

/// Words of a device, within a line.
pub fn words(text: &[u8]) -> String {
    String::from_utf8_lossy(text).chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

fn health_text(health: Health) -> String {
    match health {
        Health::Good => "good".into(),
        Health::Warning { code } => format!("warning, code 0x{code:04x}"),
        Health::Error { code } => format!("error, code 0x{code:04x}"),
    }
}

/// What `SCdevicestate` of a SICK means (Telegram Listing, 4.11).
fn state_text(state: u8) -> String {
    match state {
        0 => "0, busy".into(),
        1 => "1, ready".into(),
        2 => "2, error".into(),
        other => other.to_string(),
    }
}

/// What `LCMstate` of a SICK means.
fn contamination_text(level: u8) -> String {
    let word = match level {
        0 => "clean",
        1 => "warning",
        2 => "error",
        3 => "fatal error",
        _ => return level.to_string(),
    };
    format!("{level}, {word}")
}

/// Figures of what it said, by name, for people.
pub fn said(identity: &Identity) -> Vec<(&'static str, String)> {
    let ydlidar = ydlidar::Model::ALL.into_iter().find(|model| identity.ydlidar == Some(model.number()));
    let known = identity.rplidar.map(rplidar::Model::name).or_else(|| ydlidar.map(ydlidar::Model::name));
    let known = known.map(|name| format!(" ({name})")).unwrap_or_default();
    let model = match identity.kind {
        Kind::Ld => "does not say it; LD06, LD19 or STL-19P".into(),
        _ => format!("{}{known}", words(&identity.model)),
    };
    let text = |text: &[u8]| Some(words(text)).filter(|text| !text.is_empty());
    let rate = match identity.kind {
        Kind::Ld => "motor",
        _ => "set to",
    };
    [
        ("model", Some(model)),
        ("firmware", text(&identity.firmware)),
        ("hardware", text(&identity.hardware)),
        ("serial", text(&identity.serial)),
        ("health", identity.health.map(health_text)),
        ("state", identity.state.map(state_text)),
        ("optics", identity.contamination.map(contamination_text)),
        ("says", text(&identity.words)),
        ("laser", text(&identity.laser)),
        (rate, identity.rate_hz.map(|rate| format!("{rate:.1} turns/s"))),
        ("samples", identity.samples_per_s.map(|rate| format!("{rate:.0} /s"))),
    ]
    .into_iter()
    .filter_map(|(name, value)| Some((name, value?)))
    .collect()
}

/// Speed, beams, and how many of them measured.
fn speed_text(row: &Row<'_>, beams_per_s: f64) -> String {
    let turns = row.turns_per_s.map_or_else(|| "-".into(), |turns| format!("{turns:.1}"));
    let part = (100 * row.measured).checked_div(row.beams).map_or_else(|| "-".into(), |part| format!("{part} %"));
    format!("{turns} turns/s, {beams_per_s:.0} beams/s, {part} of them measured")
}

fn lost_text(reason: LostReason) -> String {
    match reason {
        LostReason::Silent => "it does not measure: nothing arrives".into(),
        LostReason::Garbled => "it does not measure: nothing that arrives is valid".into(),
        LostReason::Stalled => "it sends nothing new: its motor stands".into(),
        LostReason::Refused { code } => format!("it refused a request, code 0x{code:04x}"),
        LostReason::Identity => "it is another model than configured".into(),
        LostReason::Device { code } => format!("it reports error 0x{code:04x}, and does not measure"),
        LostReason::Closed => "the connection was closed".into(),
    }
}

fn held_figures(known: &Known) -> Vec<(&'static str, String)> {
    let row = known.row("");
    let mut figures = vec![("status", row.status.to_string())];
    if let Some(scan) = &known.scan {
        figures.push(("speed", speed_text(&row, known.per_second(row.beams))));
        let step = scan.angle_step.abs().to_degrees();
        figures.push(("range", format!("{:.2} to {:.2} m, beams {step:.2}° apart", scan.range_min, scan.range_max)));
    }
    if let Some(line) = &known.line {
        let is_open = if line.state == DataBus::CLOSED { "closed" } else { "open" };
        let (messages, rejected) = (line.frames, line.errors);
        figures.push(("line", format!("{is_open}, {messages} messages, {rejected} rejected")));
    }
    match known.faults.as_deref() {
        None => figures.push(("faults", "not known".into())),
        Some([]) => figures.push(("faults", "none".into())),
        Some(all) => figures.extend(all.iter().map(|fault| ("fault", OneLine(fault).to_string()))),
    }
    figures
}

fn lines(target: &Target, found: &Found) -> Vec<String> {
    let (name, place) = (&target.name, port_text(&target.port));
    let model = model_name(target.model);
    let (heading, figures) = match found {
        Found::Held(held, known) => {
            let says = if held.module.is_some() { ", of which the bus says:" } else { ": end it first" };
            let heading = format!("{model} at {place}; the port is held by {}{says}", held.holder.text());
            (heading, if held.module.is_some() { held_figures(known) } else { Vec::new() })
        }
        Found::Silent(0) => (format!("{model} at {place}"), vec![("silent", "nothing answers".into())]),
        Found::Silent(bytes) => {
            let what = format!("{bytes} bytes arrive that are none of {}", target.kind().name());
            (format!("{model} at {place}"), vec![("silent", format!("{what}: another model, or another rate"))])
        }
        Found::Said(identity, measured) => {
            let mut figures = said(identity);
            if !is_ours(target, identity) {
                figures.push(("expected", format!("{model}: the driver refuses this one")));
            }
            if let Some(measured) = measured {
                let row = Row::of("", &measured.seen);
                figures.push(("speed", speed_text(&row, row.beams as f64)));
                match measured.lost {
                    Some(reason) => figures.push(("fault", lost_text(reason))),
                    None if measured.faults.is_empty() => figures.push(("faults", "none".into())),
                    None => figures.extend(measured.faults.iter().map(|fault| ("fault", (*fault).to_string()))),
                }
            }
            (format!("{model} at {place}"), figures)
        }
    };
    let figures = figures.into_iter().map(|(what, value)| format!("{:WIDTH$} {what:<WIDTH$} {value}", ""));
    [format!("{name:<WIDTH$} {heading}")].into_iter().chain(figures).collect()
}

/// What it said, for programs.
pub fn identity_json(identity: &Identity) -> Value {
    let text = |text: &[u8]| Some(words(text)).filter(|text| !text.is_empty());
    let health = |health: Health| match health {
        Health::Good => ("good", 0),
        Health::Warning { code } => ("warning", code),
        Health::Error { code } => ("error", code),
    };
    json!({
        "protocol": identity.kind.name(),
        "model": text(&identity.model),
        "firmware": text(&identity.firmware),
        "hardware": text(&identity.hardware),
        "serial": text(&identity.serial),
        "health": identity.health.map(|it| health(it).0),
        "code": identity.health.map(|it| health(it).1),
        "state": identity.state,
        "contamination": identity.contamination,
        "says": text(&identity.words),
        "laser": text(&identity.laser),
        "turns_per_s": identity.rate_hz,
        "samples_per_s": identity.samples_per_s,
    })
}

fn to_json(target: &Target, found: &Found) -> Value {
    let head = json!({
        "name": target.name,
        "expected": model_name(target.model),
        "port": port_text(&target.port),
        "well": is_well(target, found),
    });
    let row = |row: &Row<'_>, beams_per_s: f64| {
        json!({
            "turns_per_s": row.turns_per_s,
            "beams_per_s": beams_per_s,
            "measured": (row.beams > 0).then(|| row.measured as f64 / row.beams as f64),
        })
    };
    let (key, value) = match found {
        Found::Held(held, known) => {
            let seen = known.row("");
            let value = json!({
                "by": held.holder.module,
                "process": held.holder.pid,
                "status": seen.status,
                "scan": row(&seen, known.per_second(seen.beams)),
                "rejected": known.line.as_ref().map(|line| line.errors),
                "faults": known.faults,
            });
            ("held", value)
        }
        Found::Silent(bytes) => ("silent", json!({ "bytes": bytes })),
        Found::Said(identity, measured) => {
            let mut value = identity_json(identity);
            if let Some(measured) = measured {
                let seen = Row::of("", &measured.seen);
                value["scan"] = row(&seen, seen.beams as f64);
                value["faults"] = json!(measured.faults);
                value["lost"] = json!(measured.lost.map(lost_text));
            }
            ("device", value)
        }
    };
    let mut object = head;
    object[key] = value;
    object
}

#[cfg(test)]
mod tests {
    use super::super::served::Served;
    use super::super::target::port_of;
    use super::*;
    use crate::holder::Holder;
    use ::lidar::emulated::{Device, Faults};
    use ::lidar::sick::{Dialect, Family};
    use messages::lowlevel::DataScan;

    fn target(port: &str, model: Model) -> Target {
        Target {
            name: "front".into(),
            model,
            dialect: Dialect::Binary,
            port: port_of(port, model.usual_baud()).unwrap(),
        }
    }

    fn shown(port: &str, model: Model, ask: bool) -> (Vec<String>, bool) {
        let target = target(port, model);
        let found = look(&target, ask).map_err(|failed| failed.why).unwrap().unwrap();
        (lines(&target, &found), is_well(&target, &found))
    }

    fn has(lines: &[String], what: &str, value: &str) -> bool {
        lines.iter().any(|line| line.trim_start().strip_prefix(what).is_some_and(|rest| rest.trim().starts_with(value)))
    }

    #[test]
    fn a_serial_lidar_says_who_it_is_and_is_measured() {
        let served = Served::serial(|| Box::new(rplidar::emulated::Device::new(rplidar::Model::A2)));
        let (lines, is_well) = shown(&served.port, Model::Rplidar(rplidar::Model::A2), false);
        assert!(lines[0].starts_with("front      rplidar-a2 at ") && is_well, "{lines:#?}");
        for (what, value) in [
            ("model", "RPLIDAR model 0x28 (rplidar-a2)"),
            ("firmware", "1.20"),
            ("serial", "8BB6EDF9C7E29BD1A7E39EF26E3F4302"),
            ("health", "good"),
            ("faults", "none"),
        ] {
            assert!(has(&lines, what, value), "{what}: {lines:#?}");
        }
        let speed = lines.iter().find_map(|line| line.trim_start().strip_prefix("speed")).unwrap();
        let turns: f64 = speed.trim().split(' ').next().unwrap().parse().unwrap();
        assert!((turns - 10.0).abs() < 1.5, "{speed}");
        // It was stopped: asked only, it answers at once and measures nothing.
        let (lines, is_well) = shown(&served.port, Model::Rplidar(rplidar::Model::A2), true);
        assert!(is_well && has(&lines, "health", "good") && !has(&lines, "speed", ""), "{lines:#?}");
        // Another model than expected is shown, and not started.
        let (lines, is_well) = shown(&served.port, Model::Rplidar(rplidar::Model::C1), false);
        assert!(!is_well && has(&lines, "expected", "rplidar-c1: the driver refuses this one"), "{lines:#?}");
    }

    #[test]
    fn a_ydlidar_says_who_it_is_and_is_measured() {
        let served = Served::serial(|| Box::new(ydlidar::emulated::Device::new(ydlidar::Model::G4)));
        let (lines, is_well) = shown(&served.port, Model::Ydlidar(ydlidar::Model::G4), false);
        assert!(lines[0].starts_with("front      ydlidar-g4 at ") && is_well, "{lines:#?}");
        for (what, value) in [
            ("model", "YDLIDAR model 5 (ydlidar-g4)"),
            ("firmware", "1.10"),
            ("serial", "2020062200002209"),
            ("health", "good"),
            ("set to", "10.0 turns/s"),
            ("faults", "none"),
        ] {
            assert!(has(&lines, what, value), "{what}: {lines:#?}");
        }
        let (lines, is_well) = shown(&served.port, Model::Ydlidar(ydlidar::Model::X4), false);
        assert!(!is_well && has(&lines, "expected", "ydlidar-x4: the driver refuses this one"), "{lines:#?}");
    }

    #[test]
    fn a_lidar_on_tcp_and_one_that_only_sends_are_shown_too() {
        let family = Family::Lms1xx;
        let served = Served::tcp(move || Box::new(sick::emulated::Device::new(family, Dialect::Binary)));
        let (lines, is_well) = shown(&served.port, Model::Sick(family), false);
        assert!(is_well && has(&lines, "model", "LMS10x_FieldEval"), "{lines:#?}");
        assert!(has(&lines, "state", "1, ready") && has(&lines, "optics", "0, clean"), "{lines:#?}");
        assert!(has(&lines, "serial", "18520122"), "{lines:#?}");
        let served = Served::serial(|| Box::new(ld::emulated::Device::new(ld::Model::Ld19)));
        let (lines, is_well) = shown(&served.port, Model::Ld(ld::Model::Ld19), false);
        assert!(is_well && has(&lines, "model", "does not say it"), "{lines:#?}");
    }

    #[test]
    fn an_error_is_said_with_its_code_and_the_device_is_not_started() {
        let served = Served::serial(|| {
            let mut device = rplidar::emulated::Device::new(rplidar::Model::A1);
            *device.faults() = Faults { error: true, ..Faults::default() };
            Box::new(device)
        });
        let (lines, is_well) = shown(&served.port, Model::Rplidar(rplidar::Model::A1), false);
        assert!(!is_well && has(&lines, "health", "error, code 0x8002") && !has(&lines, "speed", ""), "{lines:#?}");
    }

    #[test]
    fn silence_and_a_wrong_protocol_are_told_apart() {
        let served = Served::serial(|| Box::new(ld::emulated::Device::new(ld::Model::Ld19)));
        let is_other = |lines: &[String]| lines[1].contains("bytes arrive that are none of RPLIDAR");
        // It sends nothing until its motor has spun up.
        let ended = (0..30).any(|_| {
            let (lines, is_well) = shown(&served.port, Model::Rplidar(rplidar::Model::A1), false);
            assert!(!is_well && has(&lines, "silent", ""), "{lines:#?}");
            is_other(&lines)
        });
        assert!(ended);
        let served = Served::serial(|| Box::new(rplidar::emulated::Device::new(rplidar::Model::A1)));
        let (lines, _) = shown(&served.port, Model::Ld(ld::Model::Ld19), false);
        assert!(has(&lines, "silent", "nothing answers"), "{lines:#?}");
    }

    #[test]
    fn a_port_that_a_module_holds_is_told_with_what_the_bus_says() {
        let holder = Holder::test("driver_lidar", 123);
        let mut known = Known { faults: Some(vec!["0x0901 lidar top is silent".into()]), ..Known::default() };
        for n in 0..9 {
            let scan = DataScan {
                timestamp: 100_000 * n,
                revolution: n,
                angle_step: -0.014,
                range_min: 0.02,
                range_max: 8.0,
                ranges: vec![1.0; 110],
                ..DataScan::default()
            };
            known.seen.add(&scan);
            known.scan = Some(scan);
        }
        let held = Held { holder, module: Some(("memq://".into(), "top".into())) };
        let target = target("run/lidar-top", Model::Ld(ld::Model::Ld19));
        let found = Found::Held(held, Box::new(known));
        assert_eq!(
            lines(&target, &found),
            [
                "front      ld19 at run/lidar-top, 230400 bit/s; the port is held by driver_lidar, process 123, of \
                 which the bus says:",
                "           status     OK",
                "           speed      10.0 turns/s, 450 beams/s, 100 % of them measured",
                "           range      0.02 to 8.00 m, beams 0.80° apart",
                "           fault      0x0901 lidar top is silent",
            ]
        );
        assert!(!is_well(&target, &found), "it has a fault");
        assert_eq!(to_json(&target, &found)["held"]["by"], "driver_lidar");
    }
}
