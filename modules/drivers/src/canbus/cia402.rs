//! A drive of CiA 402 by its data sheet: from the keys of the configuration to what the drive must be.

use super::brake::Brake;
use super::config::{ConfigError, check_homed_bit, check_method};
use super::identity_keys::{self, IdentityKeys};
use super::{Axis, Config, ramp};
use base::Duration;
use canopen::axis::modes::Mode;
use canopen::drives::derive::{
    self, Derived, Description, Limits, Quirks, brake_output, derive, position_mode, velocity_mode,
};
use canopen::drives::motor::{Own, Unit};
use canopen::eds::Eds;
use canopen::master::Expect;
use settings::{Table, settings};
use std::sync::Arc;

settings! {
    /// A CiA 402 drive by its data sheet, `eds`; what is absent here must be stated there.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Cia402Config {
        /// Motor turns per turn of the wheel, or of the equivalent single front wheel, not 0; negative when they turn
        /// in opposite directions. Absent: 0x6091.
        gear: Option<f64> = optional, -10_000.0..=10_000.0;
        /// Position counts per turn of the motor. Absent: 0x6092, or 0x608F.
        counts_per_turn: Option<u32> = optional, 1..=1_000_000_000;
        /// Mode of operation: of a wheel one of the velocity, of a steering one of the position. Absent: the profile
        /// mode, where the drive offers it (0x6502), else the cyclic one.
        mode: Option<DriveMode> = optional;
        /// Who switches the holding brake of a wheel.
        brake: BrakeControl = BrakeControl::Drive;
        /// From the brake's output to the wheel that turns freely: until then set-points are 0.
        brake_release_s as brake_release: Duration = 0.2, 0.0..=5.0;
        /// Unit of the drive's velocities; of its ramps, per second. `"stated"`: by the data sheet, which has 0x60A9;
        /// or counts/s, where it has 0x608F or 0x6092.
        velocity_unit: VelocityUnit = VelocityUnit::Stated;
        /// Vendor id, 0x1018:1. Where neither this nor `product` is given both must be as in the data sheet.
        vendor: Option<u32> = optional, 1..=4_294_967_295;
        /// Product code, 0x1018:2.
        product: Option<u32> = optional, 0..=4_294_967_295;
        /// Least revision, 0x1018:3.
        revision_min: Option<u32> = optional, 0..=4_294_967_295;
        /// Further objects by which the drive is recognized.
        identity: Vec<IdentityKeys> = Vec::new();
        /// Controlword that stops.
        quick_stop_word: u16 = 2, 2..=0x0B;
        /// The drive stays in Quick Stop Active although no option code (0x605A) says so.
        keeps_quick_stop: bool = false;
        /// Indices of objects that the drive lacks, or that cannot be written, and without which it stops nevertheless,
        /// by its manual: 0x605A, 0x605E, 0x6007, 0x1016, 0x6081 to 0x6085.
        stops_without: Vec<u16> = Vec::new(), 0x1000..=0x9FFF;
        /// Object of the motor's current, index and sub-index in one number: 0x30D102 is 0x30D1:2. Absent: 0x6078, per
        /// mille of 0x6075, where the data sheet has both.
        current_object: Option<u32> = optional, 0x10_0000..=0xFF_FFFF;
        /// Unit of `current_object`.
        current_unit: CurrentUnit = CurrentUnit::Milliampere;
        /// Object of a temperature, of the motor or of the power stage, in the same form.
        temperature_object: Option<u32> = optional, 0x10_0000..=0xFF_FFFF;
        /// Unit of `temperature_object`.
        temperature_unit: TemperatureUnit = TemperatureUnit::TenthDegree;
        /// Bit of the statusword that says that the position counts from home. Absent: after each boot-up the drive is
        /// homed again.
        homed_bit: Option<u8> = optional, 8..=15;
        /// Angle at which the homing switch closes; only of a steering.
        switch_rad as switch: Option<f64> = optional, -2.0..=2.0;
        /// Homing method, a number of CiA 402 or one of the maker's; only of a steering.
        homing_method: i8 = 27, -128..=127;
        /// Speed towards the switch; only of a steering.
        homing_speed_radps as homing_speed: Option<f64> = optional, 0.001..=10.0;
        /// Longest homing; only of a steering.
        homing_timeout_s as homing_timeout: Duration = 15.0, 1.0..=120.0;
    }
    check Cia402Config::check;
}

settings! {
    /// Unit of a drive's velocities.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum VelocityUnit {
        /// The one that the data sheet states.
        Stated = "stated",
        /// Turns of the motor per minute.
        Rpm = "rpm",
        /// A tenth of it.
        TenthRpm = "0.1 rpm",
        /// A thousandth of it.
        MilliRpm = "0.001 rpm",
        /// Position counts per second.
        CountsPerSecond = "counts/s",
    }
}

settings! {
    /// Mode of operation of a drive.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum DriveMode {
        /// The drive accelerates by its own ramps.
        ProfileVelocity = "profile velocity",
        /// This computer makes the ramps, a set-point for each SYNC (`sync_s`, at most 0.02), else each 20 ms. A quick
        /// stop is the drive's own all the same.
        CyclicVelocity = "cyclic synchronous velocity",
        /// The drive moves by its own profile.
        ProfilePosition = "profile position",
        /// This computer makes the profile, a set-point for each SYNC (`sync_s`, at most 0.02). A quick stop is the
        /// drive's own all the same.
        CyclicPosition = "cyclic synchronous position",
        /// The same, in the older mode of CiA 402 for it.
        Interpolated = "interpolated position",
    }
}

impl DriveMode {
    const fn mode(self) -> Mode {
        match self {
            Self::ProfileVelocity => Mode::ProfileVelocity,
            Self::CyclicVelocity => Mode::CyclicVelocity,
            Self::ProfilePosition => Mode::ProfilePosition,
            Self::CyclicPosition => Mode::CyclicPosition,
            Self::Interpolated => Mode::Interpolated,
        }
    }

    const fn is_of_position(self) -> bool {
        matches!(self, Self::ProfilePosition | Self::CyclicPosition | Self::Interpolated)
    }
}

settings! {
    /// Who switches a holding brake.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum BrakeControl {
        /// The drive switches it by itself, or has no brake: nothing is written.
        Drive = "drive",
        /// This driver, by the brake output of the drive, bit 0 of 0x60FE:1: released after the drive was enabled, set
        /// when the wheel stands and its drive is off or is to be.
        Output = "output",
    }
}

settings! {
    /// Unit of a drive's current.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum CurrentUnit {
        /// mA, as in maxon's drives.
        Milliampere = "mA",
        /// A tenth of an ampere.
        TenthAmpere = "0.1 A",
        /// Per mille of the rated current, 0x6075, as in CiA 402.
        PerMille = "per mille",
    }
}

settings! {
    /// Unit of a drive's temperature.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum TemperatureUnit {
        /// A tenth of a degree Celsius.
        TenthDegree = "0.1 degC",
        /// A degree Celsius.
        Degree = "degC",
    }
}

/// Objects without which a drive may stop by its manual.
const STOPPING: [u16; 9] = [0x605A, 0x605E, 0x6007, 0x1016, 0x6081, 0x6082, 0x6083, 0x6084, 0x6085];

/// A drive: its data sheet, and what a person says of it.
#[derive(Clone, Debug)]
pub struct Cia402 {
    /// The keys.
    pub keys: Cia402Config,
    /// The sheet, to be read by who may open files.
    pub sheet: Option<Arc<Eds>>,
    /// Greatest speed that motor and gear can bear, 1/min, if it is given.
    pub motor_rpm_max: Option<f64>,
}

/// What an axis asks of its drive.
pub(super) struct Wanted {
    pub axis: Axis,
    pub node: u8,
    pub mode: Mode,
    /// What a turn of the output is, m or rad.
    pub per_turn: f64,
    pub limits: Limits,
    /// Least and greatest position.
    pub range: Option<[f64; 2]>,
    /// The torque is judged.
    pub torque: bool,
}

impl Cia402Config {
    fn check(&self, table: &Table<'_>) {
        if self.gear == Some(0.0) {
            table.refuse("gear", "a number that is not 0");
        }
        if self.quick_stop_word & 0x86 != 0x02 {
            table.refuse("quick_stop_word", "a controlword with bit 1 set, bits 2 and 7 clear");
        }
        if !self.stops_without.iter().all(|index| STOPPING.contains(index)) {
            table.refuse("stops_without", "indices of objects by which a drive stops");
        }
        identity_keys::check_count(table, &self.identity);
        check_method(table, self.homing_method);
    }

    /// What only one of the axes needs.
    pub(super) fn check_axis(&self, axis: Axis, table: &Table<'_>) {
        if !table.has("eds") {
            table.refuse_missing("eds", "the data sheet of the drive");
        }
        let steers = axis == Axis::Steering;
        if self.mode.is_some_and(|mode| mode.is_of_position() != steers) {
            let expected = if steers { "a mode of the position" } else { "a mode of the velocity" };
            table.refuse("mode", expected);
        }
        if axis == Axis::Steering {
            if self.brake == BrakeControl::Output {
                table.refuse("brake", "\"drive\": the output of a steering is not switched");
            }
            if !table.has("switch_rad") {
                table.refuse_missing("switch_rad", "the angle at which the homing switch closes");
            }
            if !table.has("homing_speed_radps") {
                table.refuse_missing("homing_speed_radps", "the speed towards the homing switch");
            }
            check_homed_bit(table, self.homed_bit);
        } else {
            table.refuse("homing_method", "nothing: a wheel is not homed");
        }
    }

    /// What the drive must be by the keys.
    pub(super) fn identity(&self) -> Vec<Expect> {
        identity_keys::expected([self.vendor, self.product, self.revision_min], &self.identity)
    }

    fn quirks(&self) -> Quirks {
        Quirks {
            quick_stop: Some(self.quick_stop_word),
            keeps_quick_stop: self.keeps_quick_stop,
            homed: self.homed_bit.map_or(0, |bit| 1 << bit),
            vouched: self.stops_without.clone(),
            identity: self.identity(),
            current: self.current(),
            temperature: self.temperature(),
            ..Quirks::default()
        }
    }

    /// Object of the motor's current by the manual.
    #[must_use]
    pub fn current(&self) -> Option<Own> {
        let unit = match self.current_unit {
            CurrentUnit::Milliampere => Unit::Decimal(-3),
            CurrentUnit::TenthAmpere => Unit::Decimal(-1),
            CurrentUnit::PerMille => Unit::PerMille,
        };
        self.current_object.map(|object| own(object, unit))
    }

    /// Object of a temperature by the manual.
    #[must_use]
    pub fn temperature(&self) -> Option<Own> {
        let unit = match self.temperature_unit {
            TemperatureUnit::TenthDegree => Unit::Decimal(-1),
            TemperatureUnit::Degree => Unit::Decimal(0),
        };
        self.temperature_object.map(|object| own(object, unit))
    }
}

/// An object of the form 0x30D102.
fn own(object: u32, unit: Unit) -> Own {
    let [sub, low, high, _] = object.to_le_bytes();
    Own { index: u16::from_le_bytes([low, high]), sub, unit }
}

impl VelocityUnit {
    /// The unit; none: as the data sheet states it.
    #[must_use]
    pub const fn unit(self) -> Option<derive::VelocityUnit> {
        Some(match self {
            Self::Stated => return None,
            Self::Rpm => derive::VelocityUnit::Rpm,
            Self::TenthRpm => derive::VelocityUnit::TenthRpm,
            Self::MilliRpm => derive::VelocityUnit::MilliRpm,
            Self::CountsPerSecond => derive::VelocityUnit::CountsPerSecond,
        })
    }
}

impl Cia402 {
    /// The mode in which it is driven: of a wheel a velocity mode, of a steering a position mode.
    pub(super) fn mode(&self, axis: Axis, node: u8) -> Mode {
        let steers = axis == Axis::Steering;
        match (self.keys.mode, self.sheet.as_deref()) {
            (Some(mode), _) => mode.mode(),
            (None, Some(sheet)) if steers => position_mode(sheet, node),
            (None, Some(sheet)) => velocity_mode(sheet, node),
            (None, None) if steers => Mode::ProfilePosition,
            (None, None) => Mode::ProfileVelocity,
        }
    }

    /// The holding brake of a wheel, if this driver switches it.
    pub(super) fn brake(&self, axis: Axis, node: u8) -> Result<Option<Brake>, ConfigError> {
        let sheet = self.sheet.as_deref().filter(|_| self.keys.brake == BrakeControl::Output);
        let Some(sheet) = sheet else { return Ok(None) };
        let has_mask = brake_output(sheet).map_err(|refusal| ConfigError::Drive { axis, refusal })?;
        Ok(Some(Brake::new(node, has_mask, self.keys.brake_release)))
    }

    /// The drive of an axis.
    pub(super) fn derive(&self, wanted: &Wanted, config: &Config) -> Result<Derived, ConfigError> {
        let axis = wanted.axis;
        let sheet = self.sheet.as_deref().ok_or(ConfigError::NoSheet(axis))?;
        let homes = wanted.axis == Axis::Steering;
        let description = Description {
            mode: wanted.mode,
            per_turn: wanted.per_turn,
            gear: self.keys.gear,
            counts_per_turn: self.keys.counts_per_turn,
            velocity_unit: self.keys.velocity_unit.unit(),
            limits: wanted.limits,
            range: wanted.range,
            homing: homes.then_some(self.keys.homing_method),
            sync: config.sync_and_master(wanted.axis).0,
            setpoints: Some(ramp::PERIOD),
            master: config.sync_and_master(wanted.axis).1,
            torque: wanted.torque,
            second_way: config.stop.has_second_way(config.has_pause_line),
            quirks: Quirks { motor_rpm_max: self.motor_rpm_max.map(|rpm| rpm as u32), ..self.keys.quirks() },
        };
        derive(sheet, wanted.node, &description).map_err(|refusal| ConfigError::Drive { axis, refusal })
    }
}
