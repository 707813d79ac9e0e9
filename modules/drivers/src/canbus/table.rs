//! A drive as a file, `drives/NAME.toml`: by its data sheet, or with all objects that are written, mapped and read.
//!
//! EPOS and IclA are two such files, which are built in. A file is hostile input: whatever it contains, the result is
//! a table or a list of refused keys.

use super::cia402::{Cia402Config, VelocityUnit};
use super::config::{check_homed_bit, check_method};
use super::identity_keys::{self, IdentityKeys};
use base::Duration;
use canopen::axis::modes::Mode;
use canopen::dictionary::DataType;
use canopen::drives::cia402::{self, CONTROLWORD, Parameters, Pdo, Quantity, STATUSWORD, Setting, Transmission};
use canopen::drives::derive::{Reason, Refusal};
use canopen::drives::motor::{Reading, Topic, Unit};
use canopen::master::{Expect, Guarding};
use settings::{Entry, Form, Node, Table, Value, read_as, settings};
use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// The built-in files, by name.
pub(super) const BUILT_IN: [(&str, &str); 2] =
    [("epos", include_str!("drives/epos.toml")), ("icla", include_str!("drives/icla.toml"))];

/// Greatest number of objects that are written at a boot-up.
const SETTINGS_MAX: usize = 64;
/// Greatest number of objects that are read of the motor.
const READINGS_MAX: usize = 8;
/// Number of PDOs with an identifier of the pre-defined connection set.
const PDOS: usize = 4;
/// A mode of operation in a mapping.
const MODE: u32 = 0x6060_0008;
/// Target and actual velocity, in a mapping.
const VELOCITY: [u32; 2] = [0x60FF_0020, 0x606C_0020];
/// Target and actual position.
const POSITION: [u32; 2] = [0x607A_0020, 0x6064_0020];
/// Objects that are commanded, not set; the digital outputs among them, of which one may release a brake.
const COMMANDED: [u16; 11] = [0x6040, 0x6042, 0x6060, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x60FE, 0x60FF];
/// Indices from one axis of a device to the next (CiA 402).
const AXIS: u16 = 0x800;
/// Objects without which a drive may stop by its manual.
const STOPPING: [u16; 7] = [0x6007, 0x605A, 0x605E, 0x6081, 0x6083, 0x6084, 0x6085];
/// Longest time without a request after which a drive that is guarded stops: that of the heartbeat.
const LIFE_MAX: Duration = Duration::from_millis(200);

settings! {
    /// A drive as a file.
    #[derive(Clone, Debug, PartialEq)]
    #[allow(clippy::large_enum_variant, reason = "a robot has a few")]
    pub enum DriveFile by form {
        /// Any drive of CiA 402, by its data sheet; the other keys are those of a node with `driver = "cia402"`.
        Sheet(SheetFile) = "sheet",
        /// A drive of CiA 402 whose objects are listed here.
        Objects(ObjectsFile) = "objects",
    }
}

settings! {
    /// A drive by its data sheet.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SheetFile {
        /// Electronic data sheet, EDS or DCF, beside this file.
        eds: PathBuf = required;
        keys: Cia402Config = flat;
    }
    check SheetFile::check;
}

settings! {
    /// A drive by its objects.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ObjectsFile {
        /// Mode of operation: profile velocity turns a wheel, profile position steers.
        mode: TableMode = required;
        /// Unit of velocities; of ramps, per second.
        velocity_unit: VelocityUnit = required;
        /// Greatest velocity that the drive takes, in its unit.
        velocity_max: Option<u32> = optional, 1..=4_294_967_295;
        /// Motor turns per turn of what is moved, where it belongs to the drive; a node may have another one.
        gear: Option<f64> = optional, -10_000.0..=10_000.0;
        /// Position counts per turn of the motor; of a steering, a node may have others. Absent: 4096 of a steering.
        counts_per_turn: Option<f64> = optional, 1.0..=1e6;
        /// Homing method, a number of CiA 402 or one of the maker's; a node may have another one. Absent: 27.
        homing_method: Option<i8> = optional, -128..=127;
        /// Homing has an acceleration of its own, 0x609A; only of a steering.
        homing_acceleration: bool = true;
        /// Controlword that stops.
        quick_stop_word: u16 = 2, 2..=0x0B;
        /// The drive stays in Quick Stop Active until it is enabled again.
        keeps_quick_stop: bool = false;
        /// Bit of the statusword that says that the position counts from home. Absent: after each boot-up the drive is
        /// homed again.
        homed_bit: Option<u8> = optional, 8..=15;
        /// The drive watches the master's heartbeat (0x1016), and stops without it.
        watches_master: bool = true;
        /// Node guarding, of a drive without heartbeats.
        guarding: Option<GuardingKeys> = optional;
        /// Indices of objects that the drive lacks, or that are not to be written, and without which it stops
        /// nevertheless, by its manual: 0x6081 of a steering, 0x6083, 0x6084, 0x6085, 0x605A, 0x605E, 0x6007. The
        /// simulated drive by `eds` stops without the last three as the standard has it.
        stops_without: Vec<u16> = Vec::new(), 0x6007..=0x6085;
        /// Device type, 0x1000. Absent: not compared.
        device_type: Option<u32> = optional, 0..=4_294_967_295;
        /// Vendor id, 0x1018:1.
        vendor: u32 = required, 1..=4_294_967_295;
        /// Product code, 0x1018:2. Absent: not compared, and `identity` has an object at least.
        product: Option<u32> = optional, 0..=4_294_967_295;
        /// Least revision, 0x1018:3. Absent: not compared.
        revision_min: Option<u32> = optional, 0..=4_294_967_295;
        /// Further objects by which the drive is recognized.
        identity: Vec<IdentityKeys> = Vec::new();
        /// What is written and read back at each boot-up, after the mode of operation, in this order.
        settings: Vec<SettingKeys> = Vec::new();
        /// The RPDO that carries controlword and target.
        rpdo: PdoKeys = required;
        /// The TPDOs that carry statusword and actual value.
        tpdos: Vec<PdoKeys> = required;
        /// What is read of the motor, rated values first.
        motor: Vec<MotorKeys> = Vec::new();
        /// Electronic data sheet beside this file: it must agree, names objects in `advee can`, and is the simulated
        /// drive where `simulated` is absent.
        eds: Option<PathBuf> = optional;
        /// Built-in drive that is simulated in its place. Absent: the drive of `eds`.
        simulated: Option<Twin> = optional;
    }
    check ObjectsFile::check;
}

settings! {
    /// Mode of operation of a table.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum TableMode {
        /// Profile velocity.
        Velocity = "profile velocity",
        /// Profile position.
        Position = "profile position",
    }
}

settings! {
    /// A simulated drive that is built in.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Twin {
        /// maxon EPOS 70/10, profile velocity.
        Epos = "epos",
        /// Berger Lahr IclA N065, profile position.
        Icla = "icla",
    }
}

settings! {
    /// Node guarding.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct GuardingKeys {
        /// Guard time, 0x100C.
        period_s as period: Duration = 0.1, 0.01..=0.2;
        /// Life time factor, 0x100D: requests without an answer until the node is lost. The drive stops after this
        /// number of guard times without a request, at most 0.2 s together.
        factor: u8 = 2, 1..=10;
    }
    check GuardingKeys::check;
}

settings! {
    /// An object that is written and read back.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct SettingKeys {
        /// Index of the object.
        index: u16 = required, 0x1029..=0x9FFF;
        /// Its sub-index.
        sub: u8 = 0, 0..=255;
        /// Its type.
        type as data_type: ObjectType = required;
        /// Its value: a number, or what the limits of the robot and the gear make of it, in the unit of the drive.
        value: Written = required, Form(
            written, r#"an integer, or "velocity" or "acceleration" or "deceleration" or "quick stop""#, "", |_| {}
        );
    }
    check SettingKeys::check;
}

settings! {
    /// A PDO.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct PdoKeys {
        /// Number, by which it has its identifier.
        number: u8 = required, 1..=4;
        /// Mapping, in the form of 0x1600: 0x60FF0020 is 0x60FF:0 with 32 bits.
        map: Vec<u32> = required, 0x1000_0008..=0x9FFF_FF40;
        /// Transmission type that is written at each boot-up, at an event: a synchronous command or value would wait
        /// for SYNC. Absent: the communication parameters stay as they are.
        transmission: Option<u8> = optional, 254..=255;
        /// Inhibit time.
        inhibit_s as inhibit: Option<Duration> = optional, 0.0..=0.05;
        /// Event timer.
        event_s as event: Option<Duration> = optional, 0.001..=65.535;
        /// A drive that maps it otherwise is changed; else it is refused.
        adjust: bool = false;
    }
    check PdoKeys::check;
}

settings! {
    /// An object that is read of the motor.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct MotorKeys {
        /// What it is.
        topic: MotorTopic = required;
        /// Index of the object.
        index: u16 = required, 0x1000..=0x9FFF;
        /// Its sub-index.
        sub: u8 = 0, 0..=255;
        /// Its type.
        type as data_type: ObjectType = required;
        /// Its unit: this part of A, N m or °C, or per mille of the rated value.
        unit: MotorUnit = required;
    }
    check MotorKeys::check;
}

settings! {
    /// Type of an object.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum ObjectType {
        /// Signed, 8 bits.
        I8 = "INTEGER8",
        /// Signed, 16 bits.
        I16 = "INTEGER16",
        /// Signed, 32 bits.
        I32 = "INTEGER32",
        /// Unsigned, 8 bits.
        U8 = "UNSIGNED8",
        /// Unsigned, 16 bits.
        U16 = "UNSIGNED16",
        /// Unsigned, 32 bits.
        U32 = "UNSIGNED32",
    }
}

settings! {
    /// What an object says of the motor.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum MotorTopic {
        /// Rated current, A.
        RatedCurrent = "rated current",
        /// Rated torque, N m.
        RatedTorque = "rated torque",
        /// Current, A.
        Current = "current",
        /// Torque, N m.
        Torque = "torque",
        /// Temperature, °C.
        Temperature = "temperature",
    }
}

settings! {
    /// Unit of a value of the motor.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum MotorUnit {
        /// The unit itself.
        One = "1",
        /// A tenth of it.
        Tenth = "0.1",
        /// A hundredth of it.
        Hundredth = "0.01",
        /// A thousandth of it.
        Thousandth = "0.001",
        /// Per mille of the rated value.
        PerMille = "per mille",
    }
}

/// Value of an object that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written(pub Quantity);

impl Default for Written {
    fn default() -> Self {
        Self(Quantity::Fixed(0))
    }
}

fn written(entry: &Entry<'_>) -> Option<Written> {
    let quantity = match &entry.node.value {
        Value::Integer(value) => Some(Quantity::Fixed(*value)),
        Value::String(text) => match text.as_str() {
            "velocity" => Some(Quantity::Velocity),
            "acceleration" => Some(Quantity::Acceleration),
            "deceleration" => Some(Quantity::Deceleration),
            "quick stop" => Some(Quantity::QuickStop),
            _ => None,
        },
        _ => None,
    };
    if quantity.is_none() {
        entry.refuse(r#"an integer, or "velocity" or "acceleration" or "deceleration" or "quick stop""#);
    }
    quantity.map(Written)
}

/// A drive whose objects a file lists.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveTable {
    /// Name of the file without its ending.
    pub name: String,
    /// What is booted and commanded.
    pub table: cia402::Table,
    /// Velocity units at one motor turn per second.
    pub units_per_turn: f64,
    /// Greatest velocity that the drive takes, in its unit.
    pub velocity_max: Option<u32>,
    /// Built-in drive that is simulated in its place.
    pub simulated: Option<Twin>,
    /// Unit of velocities.
    pub velocity_unit: VelocityUnit,
    /// Position counts per turn of the motor, where the file states them.
    pub counts_per_turn: Option<f64>,
    /// Homing has an acceleration of its own, 0x609A.
    pub homing_acceleration: bool,
    /// Objects without which it stops nevertheless.
    pub stops_without: Vec<u16>,
}

/// The least transmission type of an RPDO that takes effect when it comes (CiA 301, object 1400h).
const AT_AN_EVENT: u32 = 254;

/// The built-in table of this name.
#[must_use]
pub fn built_in(name: &str) -> Option<Arc<DriveTable>> {
    let (_, text) = BUILT_IN.into_iter().find(|(own, _)| *own == name)?;
    let (_, file) = parsed(Path::new(name), text).ok()?;
    file.objects(name).map(Arc::new)
}

/// The text of a file as its values and its keys.
///
/// # Errors
/// One line for each key that is refused.
pub(super) fn parsed(path: &Path, text: &str) -> Result<(Node, DriveFile), Vec<String>> {
    let node = Node::parse(path, text)?;
    let file = read_as(&node).map_err(|refused| refused.0)?;
    Ok((node, file))
}

impl DriveFile {
    /// Data sheet beside the file.
    #[must_use]
    pub fn eds(&self) -> Option<&Path> {
        match self {
            Self::Sheet(file) => Some(&file.eds),
            Self::Objects(file) => file.eds.as_deref(),
        }
    }

    /// Motor turns per turn of what is moved, where the file states them.
    #[must_use]
    pub fn gear(&self) -> Option<f64> {
        match self {
            Self::Sheet(file) => file.keys.gear,
            Self::Objects(file) => file.gear,
        }
    }

    /// What the drive must be by the file. Of one by its data sheet vendor and product may be that sheet's.
    #[must_use]
    pub fn identity(&self) -> Vec<Expect> {
        match self {
            Self::Sheet(file) => file.keys.identity(),
            Self::Objects(file) => file.identity(),
        }
    }

    /// The table of a drive whose objects are listed.
    #[must_use]
    pub fn objects(&self, name: &str) -> Option<DriveTable> {
        let Self::Objects(file) = self else { return None };
        Some(DriveTable {
            name: name.into(),
            table: file.table(),
            units_per_turn: file.units_per_turn(),
            velocity_max: file.velocity_max,
            simulated: file.simulated,
            velocity_unit: file.velocity_unit,
            counts_per_turn: file.counts_per_turn,
            homing_acceleration: file.homing_acceleration,
            stops_without: file.stops_without.clone(),
        })
    }
}

impl DriveTable {
    /// True if it turns a wheel; else it steers.
    #[must_use]
    pub fn turns_wheels(&self) -> bool {
        self.table.mode == Mode::ProfileVelocity
    }

    /// Compares at each boot-up that commands take effect when they come: an RPDO whose transmission the file leaves as
    /// it is may wait for SYNC, and a stop with it.
    pub(super) fn compare_transmission(&mut self) {
        let rpdo = &self.table.rpdo;
        if rpdo.transmission.is_none() {
            let at_an_event = Expect::at_least(0x13FF + u16::from(rpdo.number), 2, AT_AN_EVENT);
            self.table.identity.to_mut().push(at_an_event);
        }
    }

    /// Refuses values that an object cannot hold by its type: they would be cut, the ramp of a stop among them.
    pub(super) fn check(&self, parameters: &Parameters) -> Result<(), Refusal> {
        self.table.settings.iter().try_for_each(|setting| {
            let (value, (low, high)) = (setting.number(parameters), setting.data_type.range());
            let reason = Reason::OutOfLimits { value, low, high };
            let fits = (low..=high).contains(&value);
            if fits { Ok(()) } else { Err(Refusal { index: setting.index, sub: setting.sub, reason }) }
        })
    }
}

impl SheetFile {
    fn check(&self, table: &Table<'_>) {
        check_beside(table, &self.eds);
    }
}

/// A data sheet lies in the folder of the file that names it, or below: a file from elsewhere names no other one.
fn check_beside(table: &Table<'_>, eds: &Path) {
    if !eds.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
        table.refuse("eds", "a data sheet beside this file, or in a folder beside it");
    }
}

impl ObjectsFile {
    fn check(&self, table: &Table<'_>) {
        let [target, value] = self.mode.objects();
        if self.velocity_unit == VelocityUnit::Stated {
            table.refuse("velocity_unit", "the unit itself: there may be no data sheet");
        }
        if self.velocity_unit == VelocityUnit::CountsPerSecond && self.counts_per_turn.is_none() {
            table.refuse_missing("counts_per_turn", "the position counts per turn of the motor, of counts/s");
        }
        if self.gear == Some(0.0) {
            table.refuse("gear", "a number that is not 0");
        }
        match self.mode {
            TableMode::Velocity => {
                for key in ["homing_method", "homing_acceleration"] {
                    table.refuse(key, "nothing: a wheel is not homed");
                }
            }
            TableMode::Position => {
                self.homing_method.into_iter().for_each(|number| check_method(table, number));
                check_homed_bit(table, self.homed_bit);
            }
        }
        if self.quick_stop_word & 0x86 != 0x02 {
            table.refuse("quick_stop_word", "a controlword with bit 1 set, bits 2 and 7 clear");
        }
        if !self.watches_master && self.guarding.is_none() {
            table.refuse("watches_master", "true, or a table guarding: a drive whose master is lost must stop");
        }
        if self.simulated.is_some_and(|twin| twin.mode() != self.mode) {
            table.refuse("simulated", "a drive of this mode of operation");
        }
        if !self.stops_without.iter().all(|index| STOPPING.contains(index)) {
            table.refuse("stops_without", "indices of objects by which a drive stops");
        }
        if let Some(eds) = &self.eds {
            check_beside(table, eds);
        }
        identity_keys::check_count(table, &self.identity);
        if self.product.is_none() && self.identity.is_empty() {
            table.refuse_missing("product", "the product code, or an object in identity: a vendor has several drives");
        }
        for (key, count, most) in
            [("settings", self.settings.len(), SETTINGS_MAX), ("motor", self.motor.len(), READINGS_MAX)]
        {
            if count > most {
                table.refuse(key, format_args!("at most {most} objects"));
            }
        }
        self.check_ramps(table);
        self.check_settings(table);
        if let Some(rpdo) = table.below("rpdo") {
            // A mode in the RPDO would hinder homing, which changes it.
            let allowed: &[u32] = if self.mode == TableMode::Velocity { &[MODE] } else { &[] };
            self.rpdo.check_content(&rpdo, &[CONTROLWORD, target], allowed);
        }
        if !(1..=PDOS).contains(&self.tpdos.len()) {
            table.refuse("tpdos", format_args!("1 to {PDOS} tables"));
        }
        let numbers: Vec<u8> = self.tpdos.iter().map(|pdo| pdo.number).collect();
        table.unique("tpdos", "number", &numbers, "one that no other table has");
        for (entry, what) in [(STATUSWORD, "the statusword"), (value, "the actual value")] {
            if !self.tpdos.iter().any(|pdo| pdo.map.contains(&entry)) {
                table.refuse("tpdos", format_args!("one that maps {what}, 0x{entry:08X}"));
            }
        }
    }

    /// A drive that is to stop has the ramps for it, or needs none; nor is it to move by what is stored in it.
    fn check_ramps(&self, table: &Table<'_>) {
        let mut needed = vec![
            (Quantity::Acceleration, 0x6083, "acceleration"),
            (Quantity::Deceleration, 0x6084, "deceleration"),
            (Quantity::QuickStop, 0x6085, "quick stop"),
        ];
        if self.mode == TableMode::Position {
            needed.push((Quantity::Velocity, 0x6081, "velocity"));
        }
        for (quantity, index, name) in needed {
            let is_set = self.settings.iter().any(|setting| setting.value.0 == quantity);
            if !is_set && !self.stops_without.contains(&index) {
                let expected = format!("one with value = {name:?}, or 0x{index:04X} in stops_without");
                if table.has("settings") {
                    table.refuse("settings", expected);
                } else {
                    table.refuse_missing("settings", expected);
                }
            }
        }
    }

    /// Refuses settings that contradict the others: a ramp that is written once more, and a code with which the drive
    /// does not brake, or goes on without its master.
    fn check_settings(&self, table: &Table<'_>) {
        for (n, setting) in self.settings.iter().enumerate().take(SETTINGS_MAX) {
            let Some(item) = table.item("settings", n) else { continue };
            let is_again = |other: &SettingKeys| {
                (other.index, other.sub) == (setting.index, setting.sub) && !(other.is_fixed() && setting.is_fixed())
            };
            if self.settings[..n].iter().any(is_again) {
                item.refuse("index", "an object that is not set before");
            }
            let Quantity::Fixed(code) = setting.value.0 else { continue };
            let expected = match (setting.index, setting.sub, code) {
                (0x605A | 0x605E, 0, 0) => "a code with which the motor does not roll on",
                (0x6007, 0, 0 | 2) => "3 or 1: a drive whose master is lost must brake",
                _ => continue,
            };
            if !self.stops_without.contains(&setting.index) {
                item.refuse("value", format_args!("{expected}, or 0x{:04X} in stops_without", setting.index));
            }
        }
    }

    /// Velocity units at one motor turn per second.
    fn units_per_turn(&self) -> f64 {
        match self.velocity_unit {
            VelocityUnit::Rpm => 60.0,
            VelocityUnit::TenthRpm => 600.0,
            VelocityUnit::MilliRpm => 60_000.0,
            VelocityUnit::Stated | VelocityUnit::CountsPerSecond => self.counts_per_turn.unwrap_or(0.0),
        }
    }

    fn identity(&self) -> Vec<Expect> {
        identity_keys::expected([Some(self.vendor), self.product, self.revision_min], &self.identity)
    }

    fn table(&self) -> cia402::Table {
        let [target, value] = self.mode.objects();
        let mode = self.mode.mode();
        let settings = self.settings.iter().map(SettingKeys::setting);
        cia402::Table {
            device_type: self.device_type,
            identity: Cow::Owned(self.identity()),
            settings: std::iter::once(Setting::mode(mode)).chain(settings).collect(),
            mode,
            rpdo: self.rpdo.pdo(),
            rpdos: Cow::Borrowed(&[]),
            target,
            tpdos: self.tpdos.iter().map(PdoKeys::pdo).collect(),
            value,
            quick_stop: self.quick_stop_word,
            keeps_quick_stop: self.keeps_quick_stop,
            homed: self.homed_bit.map_or(0, |bit| 1 << bit),
            watches_master: self.watches_master,
            guarding: self.guarding.map(|keys| Guarding { period: keys.period, factor: keys.factor }),
            motor: self.motor.iter().map(MotorKeys::reading).collect(),
        }
    }
}

impl TableMode {
    const fn mode(self) -> Mode {
        match self {
            Self::Velocity => Mode::ProfileVelocity,
            Self::Position => Mode::ProfilePosition,
        }
    }

    /// Target and actual value, in a mapping.
    const fn objects(self) -> [u32; 2] {
        match self {
            Self::Velocity => VELOCITY,
            Self::Position => POSITION,
        }
    }
}

impl Twin {
    const fn mode(self) -> TableMode {
        match self {
            Self::Epos => TableMode::Velocity,
            Self::Icla => TableMode::Position,
        }
    }
}

impl GuardingKeys {
    fn check(&self, table: &Table<'_>) {
        if self.period.saturating_mul(u32::from(self.factor)) > LIFE_MAX {
            let key = if table.has("period_s") { "period_s" } else { "factor" };
            table.refuse(key, "at most 0.2 s for period_s times factor, the limit of a heartbeat");
        }
    }
}

impl SettingKeys {
    fn check(&self, table: &Table<'_>) {
        let is_of_maker_or_profile = self.index == 0x1029 || self.index >= 0x2000;
        // Of each axis of the device.
        let of_axis = self.index.checked_sub(0x6000).map(|index| 0x6000 + index % AXIS);
        if !is_of_maker_or_profile || of_axis.is_some_and(|index| COMMANDED.contains(&index)) {
            table.refuse("index", "0x1029, or an object of the maker or the profile that commands nothing");
        }
        let (low, high) = self.data_type.data_type().range();
        if let Quantity::Fixed(value) = self.value.0
            && !(low..=high).contains(&value)
        {
            table.refuse("value", format_args!("an integer from {low} to {high}, by its type"));
        }
    }

    fn is_fixed(&self) -> bool {
        matches!(self.value.0, Quantity::Fixed(_))
    }

    fn setting(&self) -> Setting {
        let Self { index, sub, data_type, value: Written(value) } = *self;
        Setting { index, sub, data_type: data_type.data_type(), value }
    }
}

impl PdoKeys {
    fn check(&self, table: &Table<'_>) {
        let bits = |entry: &u32| entry & 0xFF;
        let are_whole = self.map.iter().all(|entry| matches!(bits(entry), 8 | 16 | 24 | 32 | 40 | 48 | 56 | 64));
        if !are_whole || self.map.is_empty() || self.map.iter().map(bits).sum::<u32>() > u64::BITS {
            table.refuse("map", "objects of whole bytes, at most 8 bytes together");
        }
        if self.transmission.is_none() {
            for key in ["inhibit_s", "event_s"] {
                table.refuse(key, "nothing without transmission");
            }
        }
    }

    /// Refuses an RPDO without `required`, or with what is neither that nor `allowed`: that would be sent as 0.
    fn check_content(&self, table: &Table<'_>, required: &[u32], allowed: &[u32]) {
        let lacks = required.iter().any(|entry| !self.map.contains(entry));
        let has_more = self.map.iter().any(|entry| !required.contains(entry) && !allowed.contains(entry));
        if lacks || has_more {
            let list = |entries: &[u32]| entries.iter().map(|entry| format!("0x{entry:08X}")).collect::<Vec<_>>();
            let (required, allowed) = (list(required).join(" and "), list(allowed).join(" or "));
            if allowed.is_empty() {
                table.refuse("map", format_args!("{required} alone"));
            } else {
                table.refuse("map", format_args!("{required}, and at most {allowed} beside them"));
            }
        }
    }

    fn pdo(&self) -> Pdo {
        let hundreds_of_us = |time: Duration| u16::try_from(time.as_micros() / 100).unwrap_or(u16::MAX);
        let millis = |time: Duration| u16::try_from(time.as_millis()).unwrap_or(u16::MAX);
        let transmission = self.transmission.map(|kind| Transmission {
            kind,
            inhibit: self.inhibit.map(hundreds_of_us),
            event_timer: self.event.map(millis),
        });
        Pdo { number: self.number, entries: Cow::Owned(self.map.clone()), transmission, adjust: self.adjust }
    }
}

impl MotorKeys {
    fn check(&self, table: &Table<'_>) {
        let is_measured = matches!(self.topic, MotorTopic::Current | MotorTopic::Torque);
        if self.unit == MotorUnit::PerMille && !is_measured {
            table.refuse("unit", "a part of A, N m or °C: only a current or a torque is per mille of a rated one");
        }
    }

    fn reading(&self) -> Reading {
        let topic = match self.topic {
            MotorTopic::RatedCurrent => Topic::RatedCurrent,
            MotorTopic::RatedTorque => Topic::RatedTorque,
            MotorTopic::Current => Topic::Current,
            MotorTopic::Torque => Topic::Torque,
            MotorTopic::Temperature => Topic::Temperature,
        };
        let unit = match self.unit {
            MotorUnit::One => Unit::Decimal(0),
            MotorUnit::Tenth => Unit::Decimal(-1),
            MotorUnit::Hundredth => Unit::Decimal(-2),
            MotorUnit::Thousandth => Unit::Decimal(-3),
            MotorUnit::PerMille => Unit::PerMille,
        };
        Reading { topic, index: self.index, sub: self.sub, data_type: self.data_type.data_type(), unit }
    }
}

impl ObjectType {
    const fn data_type(self) -> DataType {
        match self {
            Self::I8 => DataType::I8,
            Self::I16 => DataType::I16,
            Self::I32 => DataType::I32,
            Self::U8 => DataType::U8,
            Self::U16 => DataType::U16,
            Self::U32 => DataType::U32,
        }
    }
}
