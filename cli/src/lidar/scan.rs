//! `advee lidar scan`: every port is asked in every protocol, at the rates of the models, until a lidar answers.
//!
//! Only questions that read are sent. Ports that a process holds, and ports of the configuration that belong to other
//! devices, are left out.

use super::info::{identity_json, said, words};
use super::line::Line;
use super::target::{self, Held, kind, model_name, port_text, serial};
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, print};
use ::lidar::probe::{Identity, Kind};
use ::lidar::sick::{Dialect, Family};
use ::lidar::ydlidar;
use drivers::lidar::{MODELS, Model};
use host::ports::PortConfig;
use robot::config::Config;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Scan {
    /// Serial devices, and addresses HOST:PORT [default: the serial ports of this machine]
    ports: Vec<String>,
    /// A JSON object a port
    #[arg(long)]
    json: bool,
}

/// A Hokuyo on a serial line is delivered with this rate (SCIP 2.0, command SS), bit/s.
const HOKUYO_SERIAL: u32 = 19_200;
/// Column of a remark.
const REMARK: usize = 31;
/// Ports at most: so many are tried, and no more.
const PORTS_MAX: usize = 64;

/// A port, and what came of it.
struct Row {
    /// As it is named.
    name: String,
    found: Found,
}

enum Found {
    /// A lidar, and the port as it answered.
    Lidar(PortConfig, Box<Identity>),
    /// Nothing that is known; so many bytes arrived.
    Nothing(usize),
    /// Held by a process.
    Held(Held),
    /// Another device of the configuration, of this module.
    Used(String),
    /// It cannot be opened.
    Shut(String),
}

pub fn scan(common: &Common, command: &Scan) -> Outcome {
    let names = if command.ports.is_empty() { machine() } else { command.ports.clone() };
    if names.is_empty() {
        return Err("this machine has no serial port; name one, or HOST:PORT".into());
    }
    if names.len() > PORTS_MAX {
        return Err(format!("{} ports: name at most {PORTS_MAX} of them", names.len()).into());
    }
    // Ports that are named are asked, whatever the configuration says.
    let used = if command.ports.is_empty() { used(common) } else { Vec::new() };
    let mut rows = Vec::new();
    let mut progress = Progress::new("scanning");
    for (done, name) in names.iter().enumerate() {
        let mut show = |part: f64, what: &str| {
            let share = (done as f64 + part) / names.len() as f64;
            let found = rows.iter().filter(|row: &&Row| matches!(row.found, Found::Lidar(..))).count();
            progress.show(share, |_| format!("{what}  {found} found"));
        };
        match look(name, &used, &mut show)? {
            Some(found) => rows.push(Row { name: name.clone(), found }),
            None => return Err("interrupted".into()),
        }
    }
    progress.clear();
    let found = rows.iter().filter(|row| matches!(row.found, Found::Lidar(..))).count();
    if command.json {
        rows.iter().try_for_each(|row| print(row.json()))?;
    } else {
        print(text(&rows).trim_end())?;
    }
    let is_known = |row: &Row| matches!(&row.found, Found::Held(Held { module: Some(_), .. }));
    if found == 0 && !rows.iter().any(is_known) {
        let what = "no lidar answers: power, wires, the right port, and the rate are what to look at";
        return Err(what.into());
    }
    Ok(ExitCode::SUCCESS)
}

/// Names by the devices that they lead to.
type Names = BTreeMap<PathBuf, PathBuf>;

/// Serial ports of this machine that have hardware, by their lasting names where there are some.
fn machine() -> Vec<String> {
    let read = |folder: &str| fs::read_dir(folder).into_iter().flatten().flatten();
    let links = |folder: &str| -> Names {
        let leads = |entry: fs::DirEntry| Some((fs::canonicalize(entry.path()).ok()?, entry.path()));
        read(folder).filter_map(leads).collect()
    };
    let has_hardware = |folder: &Path| {
        // PORT_UNKNOWN of linux/serial_core.h: a place of the 8250 driver without a chip.
        let kind = fs::read_to_string(folder.join("type")).ok();
        folder.join("device").exists() && kind.is_none_or(|kind| kind.trim() != "0")
    };
    let ports = read("/sys/class/tty").filter(|entry| has_hardware(&entry.path()));
    let ports: Vec<(PathBuf, Option<String>)> =
        ports.map(|entry| (Path::new("/dev").join(entry.file_name()), usb_identity(&entry.path()))).collect();
    lasting(&ports, &links("/dev/serial/by-id"), &links("/dev/serial/by-path"))
}

/// Vendor, product and serial number of the USB device that a port in `/sys/class/tty` is on.
fn usb_identity(port: &Path) -> Option<String> {
    let device = fs::canonicalize(port.join("device")).ok()?;
    let usb = device.ancestors().find(|folder| folder.join("idVendor").exists())?;
    let of = |name: &str| fs::read_to_string(usb.join(name)).unwrap_or_default();
    Some(["idVendor", "idProduct", "serial"].map(of).concat())
}

/// The names that stay: by what the devices say of themselves, or, where several say the same and one name leads to
/// whichever came last, by the socket.
fn lasting(ports: &[(PathBuf, Option<String>)], by_id: &Names, by_path: &Names) -> Vec<String> {
    let is_shared = |identity: &Option<String>| {
        identity.is_some() && ports.iter().any(|(device, other)| other == identity && !by_id.contains_key(device))
    };
    let name = |(device, identity): &(PathBuf, Option<String>)| {
        let names = if is_shared(identity) { by_path } else { by_id };
        names.get(device).unwrap_or(device).display().to_string()
    };
    let mut names: Vec<String> = ports.iter().map(name).collect();
    names.sort();
    names
}

/// Ports of the configured robots that belong to other devices.
fn used(common: &Common) -> Vec<(PortConfig, String)> {
    let of = |sim: bool| {
        let place = common.place(sim);
        let config = Config::load(&place.config, sim, &place.sets).ok()?;
        Some(target::used(&place, &config))
    };
    [false, true].into_iter().filter_map(of).flatten().collect()
}

/// Rates and protocols of the engines' models on a serial line, in the order in which they are tried: who only has to
/// be listened to comes first.
fn attempts() -> Vec<(u32, Vec<Kind>)> {
    // What a Hokuyo does not know it refuses; an RPLIDAR waits for the rest of what it takes for a request, as is each
    // question for a YDLIDAR.
    let rank = |kind: &Kind| match kind {
        Kind::Ld => 0,
        Kind::Scip => 1,
        Kind::Rplidar | Kind::Cola(_) => 2,
        Kind::Ydlidar => 3,
    };
    // By rate, but who is asked last on his own.
    let group = |kind: &Kind| *kind == Kind::Ydlidar;
    let mut rates = BTreeMap::from([((false, HOKUYO_SERIAL), vec![Kind::Scip])]);
    for (_, model) in MODELS.0.iter().filter(|(_, model)| !matches!(model, Model::Sick(_))) {
        let kind = kind(*model, Dialect::Binary);
        let kinds = rates.entry((group(&kind), model.usual_baud())).or_default();
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    rates.values_mut().for_each(|kinds| kinds.sort_by_key(rank));
    let mut rates: Vec<(u32, Vec<Kind>)> = rates.into_iter().map(|((_, rate), kinds)| (rate, kinds)).collect();
    rates.sort_by_key(|(_, kinds)| kinds.iter().map(rank).min());
    rates
}

/// What is at a port; none at Ctrl-C.
fn look(name: &str, used: &[(PortConfig, String)], show: &mut dyn FnMut(f64, &str)) -> Result<Option<Found>, Failed> {
    let first = match target::port_of(name, HOKUYO_SERIAL) {
        Ok(port) => port,
        Err(failed) => return Ok(Some(Found::Shut(failed.why))),
    };
    if let Some(held) = target::held(&first) {
        return Ok(Some(Found::Held(held)));
    }
    if let Some((_, module)) = used.iter().find(|(port, _)| target::is_same(port, &first)) {
        return Ok(Some(Found::Used(module.clone())));
    }
    let ports: Vec<(PortConfig, Vec<Kind>)> = match &first {
        PortConfig::Terminal(terminal) => {
            let at = |(baud, kinds)| (serial(&terminal.path, baud), kinds);
            attempts().into_iter().map(at).collect()
        }
        // A connection for each protocol: what a device does not know may stay in its buffer.
        _ => [Kind::Cola(Dialect::Binary), Kind::Cola(Dialect::Text), Kind::Scip]
            .map(|kind| (first.clone(), vec![kind]))
            .to_vec(),
    };
    let (all, mut received, mut shut, mut opened) = (ports.len(), 0_usize, None, false);
    for (n, (port, kinds)) in ports.into_iter().enumerate() {
        show(n as f64 / all as f64, &port_text(&port));
        let mut line = match Line::open(name, port.clone()) {
            Ok(line) => line,
            // A port may not be able to make a rate, and another one well.
            Err(failed) => {
                shut = Some(failed.why);
                continue;
            }
        };
        opened = true;
        for kind in kinds {
            let probe = match line.probe(kind) {
                Ok(Some(probe)) => probe,
                Ok(None) => return Ok(None),
                // A device on the network may close a connection that it does not understand.
                Err(_) if matches!(port, PortConfig::Tcp { .. }) => break,
                Err(failed) => return Ok(Some(Found::Shut(failed.why))),
            };
            received = received.saturating_add(probe.received());
            if let Some(identity) = probe.identity() {
                return Ok(Some(Found::Lidar(port, Box::new(identity.clone()))));
            }
        }
    }
    Ok(Some(shut.filter(|_| !opened).map_or(Found::Nothing(received), Found::Shut)))
}

/// The model of the configuration that a device is, which answered at this port.
fn model(identity: &Identity, port: &PortConfig) -> Option<Model> {
    match identity.kind {
        Kind::Ld => identity.ld_model().map(Model::Ld),
        Kind::Rplidar => identity.rplidar.map(Model::Rplidar),
        Kind::Ydlidar => {
            let number = identity.ydlidar?;
            // A number that both may have: the rate decides.
            let is_rate =
                |model: ydlidar::Model| matches!(port, PortConfig::Terminal(terminal) if terminal.baud == model.baud());
            let is = |model: &ydlidar::Model| model.number() == number || model.may_have(number) && is_rate(*model);
            ydlidar::Model::ALL.into_iter().find(is).map(Model::Ydlidar)
        }
        Kind::Cola(_) => {
            let mut families = Family::ALL.into_iter();
            families.find(|family| identity.model.starts_with(family.name_begins().as_bytes())).map(Model::Sick)
        }
        Kind::Scip => {
            let is =
                |model: &Model| matches!(model, Model::Hokuyo(name) if identity.model.starts_with(name.as_bytes()));
            MODELS.0.iter().map(|(_, model)| *model).find(is)
        }
    }
}

impl Row {
    fn json(&self) -> Value {
        let (key, value) = match &self.found {
            Found::Lidar(port, identity) => {
                let mut value = identity_json(identity);
                value["driver"] = json!(model(identity, port).map(model_name));
                value["baud"] = match port {
                    PortConfig::Terminal(terminal) => terminal.baud.into(),
                    _ => Value::Null,
                };
                ("lidar", value)
            }
            Found::Nothing(bytes) => ("nothing", json!({ "bytes": bytes })),
            Found::Held(held) => {
                let lidar = held.module.as_ref().map(|(_, name)| name);
                ("held", json!({ "by": held.holder.text(), "process": held.holder.pid, "lidar": lidar }))
            }
            Found::Used(module) => ("used", json!({ "by": module })),
            Found::Shut(why) => ("shut", why.as_str().into()),
        };
        json!({ "port": self.name, key: value })
    }
}

/// What a person reads, and pastes.
fn text(rows: &[Row]) -> String {
    let mut text = String::new();
    let mut add = |line: &str, remark: &str| {
        // Writing to a string does not fail.
        let _ = match remark {
            "" => writeln!(text, "{line}"),
            remark => writeln!(text, "{line:<0$}# {remark}", REMARK.max(line.len() + 1)),
        };
    };
    let mut number = 0;
    for Row { name, found } in rows {
        match found {
            Found::Lidar(port, identity) => {
                let figures = said(identity).into_iter().map(|(what, value)| format!("{what} {value}"));
                let figures = figures.collect::<Vec<_>>().join(", ");
                add(&format!("# {}: {figures}", identity.kind.name()), "");
                let Some(model) = model(identity, port) else {
                    let what = words(&identity.model);
                    add(&format!("# {name}: there is no driver for {what}"), "");
                    add("", "");
                    continue;
                };
                number += 1;
                toml(&mut add, number, (name, port), identity, model);
            }
            Found::Nothing(0) => add(&format!("# {name}: nothing answers"), ""),
            Found::Nothing(bytes) => add(&format!("# {name}: {bytes} bytes arrive, of no lidar that is known"), ""),
            Found::Held(held) => {
                let lidar = held.module.as_ref().map(|(_, name)| format!(", as lidar.{name}")).unwrap_or_default();
                add(&format!("# {name}: held by {}{lidar}", held.holder.text()), "");
            }
            Found::Used(module) => add(&format!("# {name}: not asked, {module} has another device there"), ""),
            Found::Shut(why) => {
                let mut why = words(why.as_bytes());
                // Each layer says which port it is.
                while let Some(rest) = why.strip_prefix(&format!("{name}: ")) {
                    why = rest.into();
                }
                add(&format!("# {name}: {why}"), "");
            }
        }
    }
    text
}

/// The lines of a lidar.
fn toml(
    add: &mut dyn FnMut(&str, &str),
    number: u32,
    (name, port): (&str, &PortConfig),
    identity: &Identity,
    model: Model,
) {
    let sure = match identity.kind {
        Kind::Ld if model != Model::Ld(::lidar::ld::Model::Stl19p) => "? or \"ld06\": they do not say it",
        _ => "",
    };
    add(&format!("[lidar.lidar{number}]"), "? a name of your choice");
    add(&format!("model = \"{}\"", model_name(model)), sure);
    match port {
        PortConfig::Terminal(terminal) => {
            // A relative path would be one in the run folder.
            let path = std::path::absolute(name).unwrap_or_else(|_| name.into());
            add(&format!("port = {}", quoted(&path.display().to_string())), "");
            if terminal.baud != model.usual_baud() {
                add(&format!("baud = {}", terminal.baud), "");
            }
        }
        // The address that the name has now: the configuration takes no names.
        other => add(&format!("address = \"{}\"", port_text(other)), ""),
    }
    if identity.kind == Kind::Cola(Dialect::Text) {
        add("dialect = \"cola-a\"", "without a checksum: cola-b, where the device can be set to it");
    }
    add("x_m = 0.0", "? where it sits: forward from the robot's reference point");
    add("y_m = 0.0", "? to the left");
    add("theta_rad = 0.0", "? where its front looks; advee lidar align measures the three");
    add("", "");
}

/// A string of TOML.
fn quoted(text: &str) -> String {
    format!("\"{}\"", words(text.as_bytes()).replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use super::super::served::Served;
    use super::*;
    use ::lidar::emulated::{Device, Faults};
    use ::lidar::{hokuyo, ld, rplidar, sick};
    use std::time::{Duration, Instant};

    /// What is found, and its lines.
    fn found(served: &Served) -> (Row, String) {
        let name = served.port.clone();
        let found = look(&name, &[], &mut |_, _| ()).map_err(|failed| failed.why).unwrap().unwrap();
        let row = Row { name, found };
        let text = text(std::slice::from_ref(&row));
        (row, text)
    }

    /// The lines, without remarks, as robot.toml has them.
    fn keys(text: &str) -> Vec<&str> {
        text.lines()
            .map(|line| line.split('#').next().unwrap_or_default().trim())
            .filter(|line| !line.is_empty())
            .collect()
    }

    #[test]
    fn adapters_with_the_same_serial_number_are_named_by_their_sockets() {
        let port = |device: &str, identity: &str| (PathBuf::from(device), Some(identity.to_owned()));
        let names = |names: &[(&str, &str)]| -> Names {
            names.iter().map(|(device, name)| (PathBuf::from(device), PathBuf::from(name))).collect()
        };
        let by_id =
            names(&[("/dev/ttyUSB0", "/id/unlike"), ("/dev/ttyUSB2", "/id/alike"), ("/dev/ttyUSB3", "/id/if01")]);
        let by_path = names(&[("/dev/ttyUSB0", "/path/0"), ("/dev/ttyUSB1", "/path/1"), ("/dev/ttyUSB2", "/path/2")]);
        let ports = [
            port("/dev/ttyUSB0", "FT1"),
            port("/dev/ttyUSB1", "CP0001"),
            port("/dev/ttyUSB2", "CP0001"),
            // Another interface of the first adapter.
            port("/dev/ttyUSB3", "FT1"),
            (PathBuf::from("/dev/ttyS0"), None),
        ];
        assert_eq!(lasting(&ports, &by_id, &by_path), ["/dev/ttyS0", "/id/if01", "/id/unlike", "/path/1", "/path/2"]);
        assert_eq!(lasting(&ports[1..2], &names(&[]), &names(&[])), ["/dev/ttyUSB1"]);
    }

    #[test]
    fn rates_are_those_of_the_models_and_the_first_is_only_listened_at() {
        let attempts = attempts();
        assert_eq!(attempts[0], (230_400, vec![Kind::Ld]));
        assert_eq!(attempts.iter().find(|(baud, _)| *baud == 115_200).unwrap().1, [Kind::Scip, Kind::Rplidar]);
        let mut rates: Vec<u32> = attempts.iter().map(|(baud, _)| *baud).collect();
        rates.sort_unstable();
        assert_eq!(rates, [19_200, 115_200, 128_000, 230_400, 230_400, 256_000, 460_800, 1_000_000]);
        assert!(attempts[attempts.len() - 2..].iter().all(|(_, kinds)| *kinds == [Kind::Ydlidar]));
    }

    #[test]
    fn each_lidar_on_a_serial_port_is_found_with_its_lines() {
        let begin = Instant::now();
        for (model, name) in [(rplidar::Model::A1, "rplidar-a1"), (rplidar::Model::S2, "rplidar-s2")] {
            let served = Served::serial(move || Box::new(rplidar::emulated::Device::new(model)));
            let (_, text) = found(&served);
            let (model, port) = (format!("model = \"{name}\""), format!("port = \"{}\"", served.port));
            let keys = keys(&text);
            assert_eq!(keys[..3], ["[lidar.lidar1]", model.as_str(), port.as_str()], "{text}");
            assert!(text.starts_with("# RPLIDAR: model RPLIDAR model 0x"), "{text}");
        }
        for (model, name) in [(ydlidar::Model::X4, "ydlidar-x4"), (ydlidar::Model::G4, "ydlidar-g4")] {
            let served = Served::serial(move || Box::new(ydlidar::emulated::Device::new(model)));
            let (_, text) = found(&served);
            assert_eq!(keys(&text)[1], format!("model = \"{name}\""), "{text}");
        }
        let served = Served::serial(|| Box::new(hokuyo::emulated::Device::new(hokuyo::emulated::Model::URG_04LX)));
        let (row, text) = found(&served);
        assert!(keys(&text).contains(&"model = \"urg-04lx\""), "{text}");
        // A pseudo-terminal has no rate: the first one that is tried is not the usual one.
        assert!(keys(&text).contains(&"baud = 19200"), "{text}");
        assert_eq!(row.json()["lidar"]["serial"], "H0614967");
        assert!(begin.elapsed() < Duration::from_secs(60), "bounded");
    }

    #[test]
    fn an_ldrobot_is_found_by_listening() {
        let served = Served::serial(|| Box::new(ld::emulated::Device::new(ld::Model::Ld19)));
        // It sends nothing until its motor has spun up.
        let (_, text) = (0..10).map(|_| found(&served)).find(|(row, _)| matches!(row.found, Found::Lidar(..))).unwrap();
        assert!(text.contains("model = \"ld19\"") && text.contains("? or \"ld06\""), "{text}");
    }

    #[test]
    fn lidars_on_tcp_are_found_in_either_dialect() {
        for (dialect, line) in [(Dialect::Binary, None), (Dialect::Text, Some("dialect = \"cola-a\""))] {
            let served = Served::tcp(move || Box::new(sick::emulated::Device::new(Family::Tim7xx, dialect)));
            let (_, text) = found(&served);
            let keys = keys(&text);
            assert_eq!(keys[1], "model = \"sick-tim7xx\"", "{text}");
            assert_eq!(keys[2], format!("address = \"{}\"", served.port));
            assert_eq!(keys.iter().find(|key| key.starts_with("dialect")).copied(), line);
        }
    }

    #[test]
    fn a_model_without_a_driver_is_named_and_no_lines_are_written() {
        let served = Served::serial(|| {
            let mut device = rplidar::emulated::Device::new(rplidar::Model::A1);
            *device.faults() = Faults { stranger: true, ..Faults::default() };
            Box::new(device)
        });
        let (_, text) = found(&served);
        assert!(text.contains("there is no driver for RPLIDAR model 0xB8") && keys(&text).is_empty(), "{text}");
    }

    #[test]
    fn ports_of_others_are_named_and_not_asked() {
        let served = Served::serial(|| Box::new(rplidar::emulated::Device::new(rplidar::Model::A1)));
        let used = [(target::port_of(&served.port, 9600).unwrap(), "driver_rs485a".to_string())];
        let found = look(&served.port, &used, &mut |_, _| ()).map_err(|failed| failed.why).unwrap().unwrap();
        let row = Row { name: "/dev/ttyS1".into(), found };
        assert_eq!(text(&[row]), "# /dev/ttyS1: not asked, driver_rs485a has another device there\n");
        let shut = look("/dev/no-such-port", &[], &mut |_, _| ()).map_err(|failed| failed.why).unwrap().unwrap();
        assert!(matches!(shut, Found::Shut(_)));
    }

    #[test]
    fn the_lines_are_those_of_a_configuration() {
        let mut lines = Vec::new();
        let port = target::port_of("192.168.0.1:2112", 1200).unwrap();
        let served = Served::tcp(|| Box::new(sick::emulated::Device::new(Family::Tim5xx, Dialect::Text)));
        let (row, _) = found(&served);
        let Found::Lidar(_, identity) = row.found else { panic!("it is found") };
        let mut add = |line: &str, _: &str| lines.push(line.to_string());
        toml(&mut add, 1, ("", &port), &identity, Model::Sick(Family::Tim5xx));
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/courier");
        let sets: Vec<String> = lines
            .iter()
            .filter(|line| line.contains('='))
            .map(|line| format!("lidar.lidar1.{}", line.replacen(" = ", "=", 1)))
            .collect();
        let config = Config::load(&folder, false, &sets).unwrap();
        let lidar = config.robot.lidar.iter().find(|lidar| lidar.name == "lidar1").expect("the new one");
        assert_eq!((lidar.driver.model, lidar.driver.dialect), (Model::Sick(Family::Tim5xx), Dialect::Text));
    }
}
