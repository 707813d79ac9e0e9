//! Data sheets of drives, which lie beside `robot.toml`.

use crate::config::{self, CanBus, ConfigError};
use crate::place::RobotLocation;
use canopen::NodeConfig;
use canopen::eds::{self, Eds};
use canopen::master::Expect;
use drivers::canbus::{self, Canbus};
use settings::Value;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Digital inputs of a drive (CiA 402).
const INPUTS: u16 = 0x60FD;
/// Greatest speed of a motor, 1/min.
const MOTOR_SPEED: u16 = 0x6080;

fn error(path: &Path, why: impl std::fmt::Display) -> ConfigError {
    ConfigError(vec![format!("{}: {why}", path.display())])
}

/// The bytes of a sheet, one more than is accepted at most. A FIFO or a device would be read for ever.
fn bytes(path: &Path) -> Result<Vec<u8>, ConfigError> {
    if !path.is_file() {
        return Err(error(path, "expected a data sheet, and this is no file"));
    }
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(eds::MAX_FILE as u64 + 1).read_to_end(&mut bytes));
    read.map_err(|why| error(path, why))?;
    Ok(bytes)
}

fn load(path: &Path) -> Result<Eds, ConfigError> {
    Eds::parse(&bytes(path)?).map_err(|why| error(path, why))
}

/// True if a drive is driven by its sheet, or simulated by it.
fn needs_sheet(node: &canbus::Node) -> bool {
    let by_objects = node.drive.table().is_some_and(|table| table.simulated.is_none());
    node.drive.by_sheet().is_some() || by_objects && node.eds.is_some()
}

/// Reads the sheets of the drives that are driven or simulated by them, unless a recording has brought them.
pub(crate) fn read(place: &RobotLocation, bus: &mut CanBus) -> Result<(), ConfigError> {
    let by_sheet = |node: &canbus::Node| needs_sheet(node) && node.sheet.is_none();
    for (n, node) in bus.driver.nodes.iter_mut().enumerate().filter(|(_, node)| by_sheet(node)) {
        let Some(path) = &node.eds else { continue };
        let full = place.config.join(path);
        if !full.is_file() {
            return Err(missing(place, (&bus.name, n), path));
        }
        node.sheet = Some(Arc::new(load(&full)?));
    }
    Ok(())
}

/// No such sheet: with the line of the file that names it.
fn missing(place: &RobotLocation, (bus, n): (&str, usize), path: &Path) -> ConfigError {
    let files = if place.sim { &["sim.toml", "robot.toml"][..] } else { &["robot.toml"] };
    let line = files.iter().find_map(|file| {
        let root = settings::read(&place.config.join(file)).ok()?;
        let nodes = root.below("can")?.below(bus)?.below("nodes")?;
        let Value::Array(nodes) = &nodes.value else { return None };
        let named = nodes.get(n)?.below("eds")?;
        matches!(&named.value, Value::String(name) if Path::new(name) == path).then(|| named.origin.to_string())
    });
    let what = format!("can.{bus}.nodes[{n}].eds = {:?}", path.display().to_string());
    let line = line.or_else(|| config::drives::line_of_sheet(&place.config, path));
    let at = line.map_or_else(|| what.clone(), |line| format!("{line}: {what}"));
    ConfigError(vec![format!(
        "{at}: expected a data sheet: {}: there is no such file",
        place.config.join(path).display()
    )])
}

/// The text of each sheet by which a drive of the bus is driven, and its file.
pub(crate) fn texts(place: &RobotLocation, bus: &CanBus) -> Result<Vec<(PathBuf, String)>, ConfigError> {
    let driven = bus.driver.nodes.iter().filter(|node| needs_sheet(node));
    let text = |path: &PathBuf| {
        let full = place.config.join(path);
        let file = bytes(&full)?;
        // Letters of another code are in names and comments alone, by which nothing is driven.
        Ok((path.clone(), String::from_utf8_lossy(&file).into_owned()))
    };
    driven.filter_map(|node| node.eds.as_ref()).map(text).collect()
}

/// What is wrong with a configuration of the driver; where it is an object of a data sheet, with file and line.
pub(crate) fn named(place: &RobotLocation, buses: &[&CanBus], why: &canbus::ConfigError) -> String {
    let canbus::ConfigError::Drive { axis, refusal } = why else {
        return format!("driver_canbus: {why}");
    };
    let node = buses.iter().flat_map(|bus| &bus.driver.nodes).find(|node| node.axis == *axis);
    let Some(path) = node.and_then(|node| node.eds.as_ref()) else {
        return format!("driver_canbus: {why}");
    };
    let sheet = node.and_then(|node| node.sheet.as_ref());
    let line =
        sheet.and_then(|sheet| sheet.object(refusal.index, refusal.sub)).map(|object| format!(":{}", object.line));
    format!("{}{}: {why}", place.config.join(path).display(), line.unwrap_or_default())
}

/// A drive whose digital inputs stop the robot has them by its sheet: what cannot be read holds the robot for ever.
pub(crate) fn check_inputs(place: &RobotLocation, bus: &CanBus, stop: &canbus::Stop) -> Result<(), ConfigError> {
    for node in &bus.driver.nodes {
        let (Some(path), Some(sheet)) = (&node.eds, &node.sheet) else { continue };
        let stops = stop.inputs.iter().any(|input| input.axis == Some(node.axis));
        if stops && sheet.object(INPUTS, 0).is_none() {
            let axis = node.axis.name();
            let why =
                format!("0x60FD:0 (digital inputs): the {axis} drive has no such object, and [stop] inputs names it");
            return Err(error(&place.config.join(path), why));
        }
    }
    Ok(())
}

/// A drive that would be refused at its boot-up if it were as its sheet states it: it permits less of its motor than
/// the limits of the robot demand, or is another device.
pub(crate) struct Misfit {
    /// What is allowed, and may not be meant; with file and line.
    pub remark: String,
    /// The simulated drive is made of the sheet, and is so.
    pub is_simulated: bool,
}

/// Those of a bus.
pub(crate) fn misfits(place: &RobotLocation, bus: &CanBus, driver: &Canbus) -> Vec<Misfit> {
    let others = bus.driver.nodes.iter().filter_map(|node| other_device(place, node, driver));
    others.chain(slow_motors(place, bus, driver)).collect()
}

fn slow_motors(place: &RobotLocation, bus: &CanBus, driver: &Canbus) -> Vec<Misfit> {
    let slow = |node: &canbus::Node| {
        let (path, sheet) = (node.eds.as_ref()?, node.sheet.as_ref()?);
        let object = sheet.object(MOTOR_SPEED, 0)?;
        // Ids are those of a bus: the axis is unique.
        let setup = driver.nodes().find(|setup| setup.name == node.axis.name())?;
        let needed = setup.identity.iter().find(|expect| (expect.index, expect.sub) == (MOTOR_SPEED, 0))?.min;
        let needed = i64::from(needed);
        let stated = object.parameter.as_ref().or(object.default.as_ref())?.number(object.data_type, node.id);
        let advice = if object.access.writes() { "; motor_rpm_max writes it" } else { "" };
        let is_simulated = sheet.dictionary(node.id).get(MOTOR_SPEED, 0).is_some_and(|value| value < needed);
        let remark = || {
            format!(
                "{}:{}: 0x6080:0 (greatest motor speed) is {stated} rpm by the sheet, and the limits demand {needed} \
                 rpm of the {} drive: one that is set so is refused at its boot-up{advice}",
                place.config.join(path).display(),
                object.line,
                node.axis.name()
            )
        };
        (stated < needed).then(|| Misfit { remark: remark(), is_simulated })
    };
    bus.driver.nodes.iter().filter_map(slow).collect()
}

/// A data sheet that the configuration names must be one of a device that the driver can set up.
pub(crate) fn check(place: &RobotLocation, bus: &CanBus, driver: &Canbus) -> Result<(), ConfigError> {
    for node in bus.driver.nodes.iter().filter(|node| node.drive.by_sheet().is_none()) {
        // Ids are those of a bus: the axis is unique.
        let setup = driver.nodes().find(|setup| setup.name == node.axis.name());
        let (Some(path), Some(setup)) = (&node.eds, setup) else { continue };
        let path = place.config.join(path);
        if let Some(objection) = load(&path)?.objection(setup) {
            return Err(error(&path, format!("not the sheet of a drive for the {}: {objection}", setup.name)));
        }
    }
    Ok(())
}

/// A drive of another identity than its sheet states. The sheet of a sibling may be meant, so it is a remark.
fn other_device(place: &RobotLocation, node: &canbus::Node, driver: &Canbus) -> Option<Misfit> {
    let path = place.config.join(node.eds.as_ref()?);
    let setup = driver.nodes().find(|setup| setup.name == node.axis.name())?;
    let sheet = node.sheet.clone().or_else(|| load(&path).ok().map(Arc::new))?;
    let remark = IDENTITY.iter().find_map(|part| part.contradicted(&path, &sheet, setup))?;
    Some(Misfit { remark, is_simulated: needs_sheet(node) })
}

/// A part of the identity of a device.
struct Part {
    /// Sub-index in 0x1018.
    sub: u8,
    name: &'static str,
    /// Key of `[DeviceInfo]` in a sheet whose object has no value.
    key: &'static str,
    of_device: fn(&eds::Device) -> Option<u32>,
}

const IDENTITY: [Part; 3] = [
    Part { sub: 1, name: "vendor", key: "VendorNumber", of_device: |device| device.vendor },
    Part { sub: 2, name: "product", key: "ProductNumber", of_device: |device| device.product },
    Part { sub: 3, name: "revision", key: "RevisionNumber", of_device: |device| device.revision },
];
const IDENTITY_OBJECT: u16 = 0x1018;

impl Part {
    /// What the sheet states, and its line, if that is known; 0 states nothing.
    fn stated(&self, path: &Path, sheet: &Eds, node: u8) -> Option<(u32, Option<usize>)> {
        let object = sheet.object(IDENTITY_OBJECT, self.sub).and_then(|object| {
            let value = object.parameter.as_ref().or(object.default.as_ref())?;
            Some((value.number(object.data_type, node) as u32, Some(object.line as usize)))
        });
        let is_key =
            |line: &str| line.split_once('=').is_some_and(|(key, _)| key.trim().eq_ignore_ascii_case(self.key));
        let of_device = || {
            let value = (self.of_device)(sheet.device())?;
            let line = bytes(path).ok().and_then(|text| String::from_utf8_lossy(&text).lines().position(is_key));
            Some((value, line.map(|line| line + 1)))
        };
        object.filter(|(value, _)| *value != 0).or_else(of_device).filter(|(value, _)| *value != 0)
    }

    /// Why a drive that is as the sheet states would be refused at its boot-up.
    fn contradicted(&self, path: &Path, sheet: &Eds, setup: &NodeConfig) -> Option<String> {
        let (stated, line) = self.stated(path, sheet, setup.id)?;
        let of_part = |expect: &&Expect| (expect.index, expect.sub) == (IDENTITY_OBJECT, self.sub);
        let differs = |expect: &&Expect| !(expect.min..=expect.max).contains(&(stated & expect.mask));
        let expect = setup.identity.iter().filter(of_part).find(differs)?;
        let demanded = match (expect.min, expect.max) {
            (least, most) if least == most => format!("0x{least:X}"),
            (least, u32::MAX) => format!("at least 0x{least:X}"),
            (least, most) => format!("0x{least:X} to 0x{most:X}"),
        };
        let line = line.map(|line| format!(":{line}")).unwrap_or_default();
        let Self { sub, name, .. } = self;
        Some(format!(
            "{}{line}: 0x1018:{sub} ({name}) is 0x{stated:X} by the sheet, and the keys of the {} drive demand \
             {demanded}: the sheet of another drive, or a wrong {name}",
            path.display(),
            setup.name
        ))
    }
}
