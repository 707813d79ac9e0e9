//! `advee can identify`: the drives on a bus, as the lines of `robot.toml` by which they are driven.
//!
//! A drive is known by its identity (0x1018): from the tables in the folder `drives`, from the data sheets in the
//! configuration folder and those that are given, else from the built-in tables. ODrives and VESCs, which are no nodes
//! of CANopen, are known by their versions. What nobody but a person knows is marked by a question mark.

use super::controllers::{Controller, Kind};
use super::scan::{Asked, Row};
use super::target::{Target, Where};
use crate::{Common, Failed, Outcome, print};
use base::Duration;
use canopen::axis::modes::Mode;
use canopen::drives::derive::{
    Derived, Description, Limits, Quirks, Reason, Refusal, VelocityUnit, derive, position_mode, velocity_mode,
};
use canopen::eds::Eds;
use drivers::canbus::table::DriveFile;
use drivers::canbus::tables::FOLDER;
use host::ports::PortConfig;
use robot::config::drives::{self, DriveTables};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Identify {
    #[command(flatten)]
    place: Where,
    #[command(flatten)]
    asked: Asked,
    /// Data sheet of a drive (EDS, DCF), or a folder of them, beside those in the configuration folder; may be given
    /// often
    #[arg(long = "eds", value_name = "PATH")]
    sheets: Vec<PathBuf>,
}

/// A data sheet.
struct Sheet {
    path: PathBuf,
    eds: Eds,
    /// It lies beside `robot.toml`.
    beside: bool,
}

/// A drive as a file.
struct Known {
    name: String,
    file: DriveFile,
    /// It is in the folder of the configuration.
    of_user: bool,
    /// Its data sheet, where the file says nothing else of its vendor.
    sheet: Option<Sheet>,
}

/// What drives a node.
enum Driver<'a> {
    /// A table.
    Table(&'a Known),
    Sheet(&'a Sheet),
    /// A drive of which there is no sheet.
    Unknown,
    /// One that states no vendor, by which its sheet would be found.
    Nameless,
    /// Of another profile, or of none: the low word of its device type.
    NoDrive(u16),
}

/// Low word of 0x1000.
const PROFILE: u16 = 402;
/// Column of a remark.
const REMARK: usize = 31;
/// A usual wheel: its circumference, m, and motion, for values that a sheet may not take.
const WHEEL_M: f64 = 0.5;
const LIMITS: Limits = Limits { velocity: 0.5, acceleration: 0.5, deceleration: 0.5, quick_stop: 1.0 };
/// Period of velocities on a bus without SYNC.
const SETPOINTS: Duration = Duration::from_millis(20);
/// Period of SYNC for a drive whose mode needs it.
const SYNC: Duration = Duration::from_millis(10);
/// A usual steering: position counts per turn of the motor, and its end, rad.
const COUNTS: u32 = 4096;
const STEERING_RAD: f64 = 0.8;

pub fn identify(common: &Common, command: &Identify) -> Outcome {
    let target = command.place.find(common)?;
    let sheets = sheets(&common.config_dir(), &command.sheets)?;
    let tables = tables(&common.config_dir())?;
    let (rows, others) = command.asked.everybody(&target)?;
    let rows: Vec<_> = rows.iter().map(|(id, row)| (*id, row)).collect();
    print(text(&target, &axes(common), (&rows, &others), (&sheets, &tables)).trim_end())?;
    Ok(ExitCode::SUCCESS)
}

/// Axes of the configured robot; without a configuration those of a base with two wheels.
fn axes(common: &Common) -> Vec<&'static str> {
    let configured = [false, true].into_iter().find_map(|sim| common.load(sim).ok());
    configured.map_or_else(|| vec!["left", "right"], |config| config.robot.axes().to_vec())
}

/// The built-in tables, and those in the configuration folder.
fn tables(config: &Path) -> Result<Vec<Known>, Failed> {
    known(&drives::read(config)?, config)
}

fn known(tables: &DriveTables, config: &Path) -> Result<Vec<Known>, Failed> {
    let known = |(name, file, of_user): (&str, &DriveFile, bool)| {
        let states_vendor = file.identity().iter().any(|expect| (expect.index, expect.sub) == (0x1018, 1));
        let sheet = file.eds().filter(|_| !states_vendor).map(|eds| read(config.join(FOLDER).join(eds), true));
        Ok(Known { name: name.into(), file: file.clone(), of_user, sheet: sheet.transpose()? })
    };
    tables.iter().map(known).collect()
}

/// The sheets in the configuration folder, if there is one, and those that are given.
fn sheets(config: &Path, given: &[PathBuf]) -> Result<Vec<Sheet>, Failed> {
    let beside = if config.is_dir() { files(config)? } else { Vec::new() };
    let mut sheets = beside.into_iter().map(|path| read(path, true)).collect::<Result<Vec<Sheet>, Failed>>()?;
    for path in given {
        let files = if path.is_dir() { files(path)? } else { vec![path.clone()] };
        for file in files {
            sheets.push(read(file, false)?);
        }
    }
    Ok(sheets)
}

/// Data sheets in a folder, by name.
fn files(folder: &Path) -> Result<Vec<PathBuf>, Failed> {
    let list = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let is_sheet = |path: &PathBuf| {
        let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        matches!(extension.as_deref(), Some("eds" | "dcf"))
    };
    let mut files: Vec<PathBuf> = list.flatten().map(|entry| entry.path()).filter(is_sheet).collect();
    files.sort();
    Ok(files)
}

fn read(path: PathBuf, beside: bool) -> Result<Sheet, Failed> {
    let file = fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let eds = Eds::parse(&file).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(Sheet { path, eds, beside })
}

impl Sheet {
    /// True if vendor and product are a node's; a sheet that names no product is its vendor's only one.
    fn is_of(&self, node: u8, row: &Row) -> bool {
        let (device, dictionary) = (self.eds.device(), self.eds.dictionary(node));
        let object = |sub| dictionary.get(0x1018, sub).and_then(|number| u32::try_from(number).ok());
        let stated = |sub, device: Option<u32>| object(sub).filter(|number| *number != 0).or(device);
        let same = |at: u8, device| {
            stated(at, device).filter(|number| *number != 0).map(|it| row.number(at.into()) == Some(it))
        };
        same(1, device.vendor) == Some(true) && same(2, device.product) != Some(false)
    }

    fn name(&self) -> String {
        self.path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    }
}

impl Known {
    /// True if a node has the identity of the file.
    fn is_of(&self, node: u8, row: &Row) -> bool {
        if self.sheet.as_ref().is_some_and(|sheet| !sheet.is_of(node, row)) {
            return false;
        }
        let expected = self.file.identity();
        let mut identity = expected.iter().filter(|expect| expect.index == 0x1018);
        let is_stated = self.sheet.is_some() || identity.clone().any(|expect| expect.sub == 1);
        is_stated
            && identity.all(|expect| {
                let said = row.number(expect.sub.into());
                said.is_some_and(|value| (expect.min..=expect.max).contains(&(value & expect.mask)))
            })
    }

    /// The lines of a node that has this drive.
    fn add_to(&self, lines: &mut Lines<'_>, node: u8, axis: (&str, &str)) {
        lines.node(node, axis, &self.name);
        let has_gear = self.file.gear().is_some()
            || self.sheet.as_ref().is_some_and(|sheet| sheet.eds.object(0x6091, 1).is_some());
        if !has_gear {
            lines.gear();
        }
        if axis.0 == STEERING {
            lines.steering();
        }
    }
}

fn driver<'a>(node: u8, row: &Row, sheets: &'a [Sheet], tables: &'a [Known]) -> Driver<'a> {
    if let Some(profile) = row.number(0).map(|device| device as u16).filter(|profile| *profile != PROFILE) {
        return Driver::NoDrive(profile);
    }
    let table = |of_user: bool| tables.iter().find(|known| known.of_user == of_user && known.is_of(node, row));
    if let Some(own) = table(true) {
        return Driver::Table(own);
    }
    if let Some(sheet) = sheets.iter().find(|sheet| sheet.is_of(node, row)) {
        return Driver::Sheet(sheet);
    }
    let states_vendor = row.number(1).is_some_and(|vendor| vendor != 0);
    let unknown = if states_vendor { Driver::Unknown } else { Driver::Nameless };
    table(false).map_or(unknown, Driver::Table)
}

impl Driver<'_> {
    /// Why there are no lines for the node, for a person.
    fn refusal(&self) -> Option<String> {
        Some(match self {
            Self::NoDrive(0) => "No drive of CiA 402: 0x1000:0 (device type): the device states no profile.".into(),
            Self::NoDrive(profile) => {
                let refusal = Refusal { index: 0x1000, sub: 0, reason: Reason::Profile(*profile) };
                format!("No drive of CiA 402: {refusal}")
            }
            Self::Unknown => "No data sheet with this vendor and product: give the maker's EDS by --eds.".into(),
            Self::Nameless => {
                "It states no vendor (0x1018:1), by which its data sheet is found: name the sheet by eds in a node of \
                 robot.toml."
                    .into()
            }
            Self::Table(_) | Self::Sheet(_) => return None,
        })
    }
}

/// What a person reads, and pastes.
fn text(
    target: &Target,
    axes: &[&'static str],
    (rows, others): (&[(u8, &Row)], &[Controller]),
    (sheets, tables): (&[Sheet], &[Known]),
) -> String {
    // An interface that is no bus of the configuration becomes its first one.
    let bus = if target.name.starts_with("can.") { target.name.as_str() } else { "can.main" };
    let mut lines = Lines { text: String::new(), bus };
    let count = rows.len() + others.len();
    let count = if count == 1 { "1 node answers".into() } else { format!("{count} nodes answer") };
    lines.remark(&format!("{count} on {}. Check the lines with a question mark.", target.name));
    lines.blank();
    lines.add(&format!("[{}]", lines.bus), "");
    if let Some(interface) = interface(&target.port) {
        lines.add(&format!("interface = {}", quoted(&interface)), "");
    }
    lines.add(&format!("bitrate = {}", target.bitrate), "");
    // Axes keep the nodes that they have.
    let configured = |node: u8| target.known.iter().find(|known| known.id == node).map(|known| known.name.as_str());
    let mut free = axes.iter().filter(|axis| !target.known.iter().any(|known| known.name == **axis));
    for (node, row) in rows {
        lines.blank();
        lines.remark(&title(*node, row));
        let driver = driver(*node, row, sheets, tables);
        if let Some(why) = driver.refusal() {
            lines.remark(&why);
            continue;
        }
        let Some(axis) = configured(*node).or_else(|| free.next().copied()) else {
            lines.remark("The robot has no further axis.");
            continue;
        };
        let is_sure = configured(*node).is_some();
        let check =
            if is_sure { "" } else { "? turn it by hand, and see whose position changes: advee can monitor --changes" };
        match driver {
            Driver::Sheet(sheet) => by_sheet(&mut lines, *node, (axis, check), sheet),
            Driver::Table(known) => known.add_to(&mut lines, *node, (axis, check)),
            Driver::Unknown | Driver::Nameless | Driver::NoDrive(_) => {}
        }
    }
    for Controller { id, kind } in others {
        lines.blank();
        let check = "? turn it by hand, and see whose position changes";
        match kind {
            Kind::Odrive(version) => {
                let [hardware, firmware] =
                    [version.hardware, version.firmware].map(|[major, minor, last]| format!("{major}.{minor}.{last}"));
                lines.remark(&format!("ODrive {id}: hardware {hardware}, firmware {firmware}"));
                if *id == 0 {
                    lines.remark("Its node id is 0, which is not driven: set axis0.config.can.node_id to 1 or more.");
                    continue;
                }
                let Some(axis) = free.next().filter(|axis| **axis != STEERING) else {
                    lines.remark("The robot has no further wheel.");
                    continue;
                };
                lines.node(*id, (axis, check), "odrive");
                lines.gear();
                lines.add(&format!("hardware = \"{hardware}\""), "");
                lines.add(&format!("firmware = \"{firmware}\""), "");
                // A wrong number would name another parameter of the device.
                lines.remark("Two keys are missing, endpoints from flat_endpoints.json of this hardware and firmware:");
                lines.remark("enable_watchdog = ? axis0.config.enable_watchdog");
                lines.remark("watchdog_timeout = ? axis0.config.watchdog_timeout");
            }
            Kind::Vesc { firmware: [major, minor], hardware } => {
                lines.remark(&format!("VESC {id}: {}, firmware {major}.{minor}", clean(hardware)));
                let Some(axis) = free.next().filter(|axis| **axis != STEERING) else {
                    lines.remark("The robot has no further wheel.");
                    continue;
                };
                lines.node(*id, (axis, check), "vesc");
                lines.gear();
                lines.add("pole_pairs = 7", "? pairs of poles of the motor");
            }
        }
    }
    lines.text
}

const STEERING: &str = "steering";

/// The lines of a drive that its sheet describes.
fn by_sheet(lines: &mut Lines<'_>, node: u8, axis: (&str, &str), sheet: &Sheet) {
    let tried = Tried::of(&sheet.eds, node, axis.0 == STEERING);
    let Tried { unit, counts, gear, derived } = match tried {
        Ok(tried) => tried,
        Err(refusal) => {
            lines.remark(&format!("Not driven by {}: {}", quoted(&sheet.name()), clean(&refusal.to_string())));
            return;
        }
    };
    lines.node(node, axis, "cia402");
    let beside = if sheet.beside {
        String::new()
    } else {
        format!("copy it beside robot.toml: {}", clean(&sheet.path.display().to_string()))
    };
    lines.add(&format!("eds = {}", quoted(&sheet.name())), &beside);
    match gear {
        Some(_) => lines.gear(),
        None => lines.remark("gear: by 0x6091 of the sheet; mounted the other way round it needs a negative one here"),
    }
    if unit.is_some() {
        lines.add("velocity_unit = \"rpm\"", "? the sheet does not say it: see the manual");
    }
    if let Some(counts) = counts {
        lines.add(&format!("counts_per_turn = {counts}"), "? position counts per turn of the motor");
    }
    if axis.0 == STEERING {
        lines.steering();
    }
    if matches!(derived.table.mode, Mode::CyclicPosition | Mode::Interpolated) {
        lines.remark("Needs SYNC: sync_s = 0.01, at most 0.02, in the table of the bus");
    }
    for lacks in &derived.reservations {
        lines.remark(&format!(
            "Needs [stop] second_way, or its manual and stops_without: {}",
            clean(&lacks.to_string())
        ));
    }
}

/// Unit of velocity, counts and gear, as far as they are given.
type Way = (Option<VelocityUnit>, Option<u32>, Option<f64>);

/// The fewest lines with which a sheet describes a drive.
struct Tried {
    unit: Option<VelocityUnit>,
    counts: Option<u32>,
    gear: Option<f64>,
    derived: Derived,
}

impl Tried {
    fn of(eds: &Eds, node: u8, steers: bool) -> Result<Self, Refusal> {
        let mode = if steers { position_mode(eds, node) } else { velocity_mode(eds, node) };
        let description = |second_way, (unit, counts, gear): Way| Description {
            mode,
            per_turn: if steers { TAU } else { WHEEL_M },
            gear,
            counts_per_turn: counts,
            velocity_unit: unit,
            limits: LIMITS,
            range: steers.then_some([-STEERING_RAD, STEERING_RAD]),
            homing: None,
            sync: matches!(mode, Mode::CyclicPosition | Mode::Interpolated).then_some(SYNC),
            setpoints: Some(SETPOINTS),
            master: 127,
            torque: false,
            second_way,
            quirks: Quirks::default(),
        };
        let mut counts = vec![None];
        counts.extend(steers.then_some(Some(COUNTS)));
        let mut ways = Vec::new();
        for second_way in [false, true] {
            for unit in [None, Some(VelocityUnit::Rpm)] {
                for counts in &counts {
                    ways.extend([None, Some(1.0)].map(|gear| (second_way, (unit, *counts, gear))));
                }
            }
        }
        let tried = |(second_way, way): (bool, Way)| {
            let (unit, counts, gear) = way;
            let derived = derive(eds, node, &description(second_way, way))?;
            Ok(Self { unit, counts, gear, derived })
        };
        // If none does, what is in the way of the last one cannot be given by any line.
        let last = (true, (Some(VelocityUnit::Rpm), steers.then_some(COUNTS), Some(1.0)));
        ways.into_iter().find_map(|way| tried(way).ok()).map_or_else(|| tried(last), Ok)
    }
}

/// Lines of TOML.
struct Lines<'a> {
    text: String,
    /// Table of the bus.
    bus: &'a str,
}

impl Lines<'_> {
    fn blank(&mut self) {
        self.text.push('\n');
    }

    /// Writing to a string does not fail.
    fn add(&mut self, line: &str, remark: &str) {
        let _ = match remark {
            "" => writeln!(self.text, "{line}"),
            remark => writeln!(self.text, "{line:<0$}# {remark}", REMARK.max(line.len() + 1)),
        };
    }

    fn remark(&mut self, text: &str) {
        let _ = writeln!(self.text, "# {text}");
    }

    fn node(&mut self, node: u8, (axis, check): (&str, &str), driver: &str) {
        self.add(&format!("[[{}.nodes]]", self.bus), "");
        self.add(&format!("id = {node}"), "");
        self.add(&format!("axis = {}", quoted(axis)), check);
        self.add(&format!("driver = \"{driver}\""), "");
    }

    fn gear(&mut self) {
        self.add("gear = 1", "? turns of the motor per turn of the wheel; negative: the other way round");
    }

    /// What a steering needs beside that.
    fn steering(&mut self) {
        self.add("switch_rad = -0.6", "? angle at which the homing switch closes");
        self.add("homing_speed_radps = 0.1", "? speed towards it");
    }
}

fn title(node: u8, row: &Row) -> String {
    let device = Some(clean(&row.device())).filter(|device| !device.is_empty());
    let profile = match row.number(0).map(|device| device & 0xFFFF) {
        Some(0) | None => String::new(),
        Some(profile) => format!(", CiA {profile}"),
    };
    let number = |name: &str, at| row.number(at).map(|number| format!(", {name} 0x{number:08X}")).unwrap_or_default();
    let numbers = [("vendor", 1), ("product", 2), ("revision", 3), ("serial", 4)].map(|(name, at)| number(name, at));
    let device = device.map(|device| format!(": {device}")).unwrap_or_default();
    format!("Node {node}{device}{profile}{}", numbers.concat())
}

/// The key `interface`; none for a bus of the simulated robot, which is not its own.
fn interface(port: &PortConfig) -> Option<String> {
    match port {
        PortConfig::CanSocket { interface } => Some(interface.clone()),
        PortConfig::CanSlcan { path, .. } => Some(format!("slcan:{}", path.display())),
        PortConfig::CanUdp { bus } => Some(format!("udp:{bus}")),
        _ => None,
    }
}

/// What a node or a file says of itself, within a line.
fn clean(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

/// A string of TOML.
fn quoted(text: &str) -> String {
    format!("\"{}\"", clean(text).replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn built_in() -> Vec<Known> {
        known(&DriveTables::default(), Path::new("")).unwrap()
    }

    #[track_caller]
    fn refused(numbers: &[Option<u32>], text: &str) {
        let tables = built_in();
        let refusal = driver(1, &Row::stating(numbers), &[], &tables).refusal();
        assert!(refusal.as_ref().is_some_and(|refusal| refusal.contains(text)), "{refusal:?}, not {text}");
    }

    #[test]
    fn a_node_that_is_not_driven_is_named_with_object_and_reason() {
        let drive = Some(0x0002_0192);
        refused(&[Some(0x000F_0191), Some(1), Some(2)], "0x1000:0 (device type): the device is of profile 401, not");
        refused(&[Some(0), Some(1), Some(2)], "0x1000:0 (device type): the device states no profile");
        refused(&[drive, Some(1), Some(2)], "No data sheet with this vendor and product");
        refused(&[drive, Some(0), Some(2)], "It states no vendor (0x1018:1)");
        refused(&[drive, None], "It states no vendor (0x1018:1)");
        let epos = Row::stating(&[drive, Some(0xFB), Some(0x6410_0000), Some(0x2033_0000)]);
        assert!(matches!(driver(1, &epos, &[], &built_in()), Driver::Table(known) if known.name == "epos"));
    }

    #[test]
    fn a_drive_of_a_table_of_the_folder_is_written_with_its_name() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let folder = std::env::temp_dir().join(format!("advee-identify-{}", std::process::id()));
        fs::create_dir_all(folder.join(FOLDER)).unwrap();
        let sheet = root.join("buses/canopen/eds/others/maxon_epos4_50_15_node1.dcf");
        fs::copy(sheet, folder.join(FOLDER).join("own.dcf")).unwrap();
        let write = |name: &str, text: &str| fs::write(folder.join(FOLDER).join(name), text).unwrap();
        write("own.toml", "form = \"sheet\"\neds = \"own.dcf\"\n");
        write("lift.toml", "form = \"sheet\"\neds = \"own.dcf\"\ngear = 5\nvendor = 7\nrevision_min = 3\n");
        let tables = tables(&folder).unwrap();
        let drive = Some(0x0002_0192);
        let name = |numbers: &[Option<u32>]| match driver(1, &Row::stating(numbers), &[], &tables) {
            Driver::Table(known) => known.name.clone(),
            _ => String::new(),
        };
        let own = &tables.iter().find(|known| known.name == "own").unwrap().sheet.as_ref().unwrap().eds;
        let stated = |sub| own.dictionary(1).get(0x1018, sub).map(|number| number as u32);
        assert_eq!(name(&[drive, stated(1), stated(2), Some(1)]), "own");
        assert_eq!(name(&[drive, Some(7), Some(1), Some(3)]), "lift");
        assert_eq!(name(&[drive, Some(7), Some(1), Some(2)]), "", "an older revision");
        assert_eq!(name(&[drive, Some(0xFB), Some(0x6410_0000)]), "epos");

        let lift = tables.iter().find(|known| known.name == "lift").unwrap();
        let mut lines = Lines { text: String::new(), bus: "can.main" };
        lift.add_to(&mut lines, 3, ("left", ""));
        assert_eq!(lines.text, "[[can.main.nodes]]\nid = 3\naxis = \"left\"\ndriver = \"lift\"\n");
        fs::remove_file(folder.join(FOLDER).join("own.dcf")).unwrap();
        assert!(super::tables(&folder).is_err(), "a sheet that is not there is named");
        fs::remove_dir_all(&folder).unwrap();
    }
}
