//! What inputs and outputs there are, and what cannot be.

use super::canopen::Canopen;
use super::output::OutputKeys;
use super::pattern::Pattern;
use super::serial::Serial;
use super::situation::Situation;
use crate::gpio_line::LineRule;
use base::Duration;
use base::gpio::{Bias, LineId};
use base::listed;
use base::w1::Rom;
use messages::Channel;
use modbus::value::{Kind, Place};
use modbus::{Line, Table as Registers};
use settings::{Choice, Parsed, Table, settings};
use std::path::PathBuf;

/// Signals of the robot at most.
pub const SIGNALS_MAX: usize = 500;
/// Entries of `[signals]` at most.
pub const SHOWS_MAX: usize = 100;

const TABLES: Choice<Registers> = Choice(&[
    ("coil", Registers::Coils),
    ("discrete", Registers::DiscreteInputs),
    ("holding", Registers::HoldingRegisters),
    ("input", Registers::InputRegisters),
]);

const FORMATS: Choice<Kind> = Choice(&[
    ("u16", Kind::U16),
    ("i16", Kind::I16),
    ("u32", Kind::U32),
    ("i32", Kind::I32),
    ("f32", Kind::F32),
    ("bit", Kind::Bit),
]);

const BIASES: Choice<Bias> = Choice(&[
    ("as-is", Bias::AsIs),
    ("disabled", Bias::Disabled),
    ("pull-up", Bias::PullUp),
    ("pull-down", Bias::PullDown),
]);

settings! {
    /// Keys of `[io.modbus.<name>]` for the driver.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ModbusKeys {
        /// Unit of the signals that name none.
        unit: u8 = 1, 0..=255;
        /// Longest time to an answer, without the time that it takes on the line.
        time_limit_s as time_limit: Duration = 0.1, 0.005..=5.0;
        /// Further attempts before a device counts as lost; a lost one is asked once a second.
        retries: u8 = 2, 0..=10;
        /// Period in which inputs are read.
        period_s as period: Duration = 0.1, 0.005..=60.0;
        /// Period in which outputs are written, beside each change.
        refresh_s as refresh: Duration = 0.5, 0.01..=60.0;
        /// Older values are not valid.
        age_max_s as age_max: Duration = 1.5, 0.02..=300.0;
        /// Its inputs and outputs.
        signals: Vec<SignalKeys> = [];
    }
    check ModbusKeys::check;
}

settings! {
    /// `[[io.modbus.<name>.signals]]`: a value of a device.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SignalKeys {
        /// Name, of one signal of the robot.
        name: String = required;
        /// Unit of the device. Absent: the bus's.
        unit: Option<u8> = optional, 0..=255;
        /// Table of the device.
        table: Registers = required, TABLES;
        /// Address on the wire, from 0: 0 is the register that many manuals call 40001 or 1.
        address: u16 = required, 0..=65_535;
        /// Type of a value in registers.
        format: Kind = Kind::U16, FORMATS;
        /// With `format = "bit"`: the bit of the register, 0 the lowest. The other bits of a register with such
        /// outputs are written as 0.
        bit: u8 = 0, 0..=15;
        /// Of two registers the first has the low word.
        low_word_first: bool = false;
        /// Value = number × scale + offset.
        scale: f64 = 1.0, -1e9..=1e9;
        /// See `scale`.
        offset: f64 = 0.0, -1e9..=1e9;
        /// It is written. Otherwise it is read, also from a table that could be written.
        output: bool = false;
        /// Outputs in registers: always written by the function for several registers; some devices know no other.
        write_several: bool = false;
        /// Its value in a simulated device, at the start.
        simulated: f64 = 0.0, -1e9..=1e9;
        limits: OutputKeys = flat;
    }
    check SignalKeys::check;
}

settings! {
    /// `[[io.gpio]]`: a line of a GPIO chip of the computer. Its value is 1 while it is active, else 0.
    #[derive(Clone, Debug, PartialEq)]
    pub struct GpioKeys {
        /// Name, of one signal of the robot.
        name: String = required;
        /// Device file of the chip, `"/dev/gpiochip0"`. A name without `/`: the simulator's line, in the run folder.
        chip: PathBuf = required;
        /// Number of the line on the chip, or its name there.
        line: LineId = required, LineRule;
        /// It is active at the low level.
        active_low: bool = false;
        /// It is set. Otherwise it is read.
        output: bool = false;
        /// Inputs: resistor of the chip.
        bias: Bias = Bias::AsIs, BIASES;
        /// Inputs: a level that lasts shorter is no event; by the chip, or by the kernel.
        debounce_s as debounce: Duration = 0.0, 0.0..=1.0;
        /// Inputs: it is active in simulation.
        simulated: bool = false;
        limits: OutputKeys = flat;
    }
    check GpioKeys::check;
}

/// Channels of a switch.
const CHANNELS: Choice<u8> = Choice(&[("A", 0), ("B", 1)]);

settings! {
    /// `[[io.w1]]`: a channel of a DS2413 on the 1-Wire bus, `[w1]`. As an output its value is 1 while it conducts to
    /// ground, as an input while its pin is high.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SwitchKeys {
        /// Name, of one signal of the robot.
        name: String = required;
        /// Code as the kernel names it.
        id as rom: Rom = required, Parsed(
            switch, "a DS2413 as the kernel names it: \"3a-0000001a2b3c\"", "3a-0000001a2b3c"
        );
        /// Channel: PIOA or PIOB.
        channel: u8 = required, CHANNELS;
        /// Inverts its value: 1 while it does not conduct, or its pin is low.
        active_low: bool = false;
        /// It is set. Otherwise it is read.
        output: bool = false;
        /// Inputs: it is 1 in simulation.
        simulated: bool = false;
        limits: OutputKeys = flat;
    }
    check SwitchKeys::check;
}

/// Power channels that may be outputs: those that no sensor, drive or computer depends on.
const POWER_CHANNELS: Choice<&'static str> = Choice(&[("monitor", "monitor"), ("audio", "audio")]);

settings! {
    /// `[[io.power]]`: a channel of the power controller as an output, 1 while it is on.
    #[derive(Clone, Debug, PartialEq)]
    pub struct PowerKeys {
        /// Name, of one signal of the robot.
        name: String = required;
        /// Power channel.
        channel: &'static str = required, POWER_CHANNELS;
        limits: OutputKeys = flat;
    }
    check PowerKeys::check;
}

settings! {
    /// `[[io.battery]]`: a battery whose values are signals; each key but `name` and `cells` is the name of one.
    #[derive(Clone, Debug, PartialEq)]
    pub struct BatteryKeys {
        /// Its name on `LL_DATA_BATTERY`.
        name: String = required;
        /// V.
        voltage: Option<String> = optional;
        /// A, positive when charging.
        current: Option<String> = optional;
        /// State of charge, 0 to 1.
        charge: Option<String> = optional;
        /// State of health, 0 to 1.
        health: Option<String> = optional;
        /// Degrees Celsius.
        temperature: Option<String> = optional;
        /// Above 0: it is being charged.
        charging: Option<String> = optional;
        /// Voltages of the cells, V: names of signals.
        cells: Vec<String> = Vec::<String>::new();
    }
}

settings! {
    /// `[signals]`: what outputs show of the robot: lamps, horns and the like (docs/io.md). No output is a safety
    /// function.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Shows {
        /// Time for which `starting` applies, from the first set-point of a robot that stood. Motion does not wait.
        signal_s as signal: Duration = 2.0, 0.1..=30.0;
        /// Speed from which the robot counts as moving.
        speed_mps: f64 = 0.02, 0.001..=1.0;
        /// Rotation from which it counts as turning.
        turn_radps: f64 = 0.1, 0.01..=3.0;
        /// What each output shows when: of the entries of an output, the first that applies; without one it has its
        /// safe value.
        show: Vec<ShowKeys> = [];
    }
    check Shows::check;
}

settings! {
    /// `[[signals.show]]`: what an output shows in a situation.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ShowKeys {
        /// Name of an output of `[io]`.
        output: String = required;
        /// Situation in which it is shown.
        when: Situation = required;
        /// What the output does from the beginning of the situation on.
        pattern: Pattern = required, Parsed(Pattern::parse, Pattern::EXPECTED, "on");
        /// Value of the output while it is on.
        value: f64 = 1.0, -1e9..=1e9;
        /// Value while it is off.
        value_off: f64 = 0.0, -1e9..=1e9;
    }
}

impl Shows {
    fn check(&self, table: &Table<'_>) {
        for item in (SHOWS_MAX..self.show.len()).filter_map(|n| table.item("show", n)) {
            item.refuse("output", format_args!("no more than {SHOWS_MAX} entries"));
        }
    }
}

impl ModbusKeys {
    fn check(&self, table: &Table<'_>) {
        if self.signals.is_empty() {
            table.refuse_missing("signals", "at least one signal");
        }
        for (n, signal) in self.signals.iter().enumerate() {
            let clash = |other: &SignalKeys| {
                let words = |keys: &SignalKeys| keys.format != Kind::Bit || keys.bit == signal.bit;
                let same = other.table == signal.table && other.unit(self.unit) == signal.unit(self.unit);
                let (a, b) = (other.place(), signal.place());
                let meets = u32::from(a.address) < u32::from(b.address) + u32::from(b.width())
                    && u32::from(b.address) < u32::from(a.address) + u32::from(a.width());
                same && meets && (words(other) || signal.format != Kind::Bit)
            };
            if signal.output && self.signals[..n].iter().filter(|other| other.output).any(clash) {
                table.item("signals", n).iter().for_each(|item| {
                    item.refuse("address", "one that no other output has");
                });
            }
        }
    }
}

impl SignalKeys {
    fn check(&self, table: &Table<'_>) {
        let place = self.place();
        if self.scale == 0.0 {
            table.refuse("scale", "a number other than 0");
        }
        if !place.is_valid() && self.scale != 0.0 {
            table.refuse("address", "at most 65534 for a value of two registers");
        }
        if self.output && !self.table.is_writable() {
            table.refuse("table", "\"coil\" or \"holding\" for an output");
        }
        self.limits.check(table, self.output, |value| place.number(value).is_some());
    }

    /// True for an output that takes this value.
    #[must_use]
    pub fn takes(&self, value: f64) -> bool {
        self.output && self.limits.accepts(value) && self.place().number(value).is_some()
    }

    /// The unit of the device on a bus with this one.
    #[must_use]
    pub fn unit(&self, usual: u8) -> u8 {
        self.unit.unwrap_or(usual)
    }

    /// Where its value is.
    #[must_use]
    pub fn place(&self) -> Place {
        let Self { table, address, format, bit, low_word_first, scale, offset, .. } = *self;
        Place { table, address, kind: format, bit, low_first: low_word_first, scale, offset }
    }
}

impl GpioKeys {
    fn check(&self, table: &Table<'_>) {
        self.limits.check(table, self.output, |value| value == 0.0 || value == 1.0);
    }

    /// True for an output that takes this value.
    #[must_use]
    pub fn takes(&self, value: f64) -> bool {
        self.output && self.limits.accepts(value) && (value == 0.0 || value == 1.0)
    }
}

fn switch(text: &str) -> Option<Rom> {
    Rom::parse(text).filter(|id| id.is_switch())
}

impl SwitchKeys {
    fn check(&self, table: &Table<'_>) {
        self.limits.check(table, self.output, |value| value == 0.0 || value == 1.0);
    }

    /// True for an output that takes this value.
    #[must_use]
    pub fn takes(&self, value: f64) -> bool {
        self.output && self.limits.accepts(value) && (value == 0.0 || value == 1.0)
    }
}

impl PowerKeys {
    fn check(&self, table: &Table<'_>) {
        self.limits.check(table, true, |value| value == 0.0 || value == 1.0);
    }

    /// True if it takes this value.
    #[must_use]
    pub fn takes(&self, value: f64) -> bool {
        self.limits.accepts(value) && (value == 0.0 || value == 1.0)
    }
}

impl BatteryKeys {
    /// The signals that it names.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.signals().map(|(_, name)| name)
    }

    /// The same, each with its key.
    pub fn signals(&self) -> impl Iterator<Item = (&'static str, &String)> {
        let Self { voltage, current, charge, health, temperature, charging, .. } = self;
        let fields = [
            ("voltage", voltage),
            ("current", current),
            ("charge", charge),
            ("health", health),
            ("temperature", temperature),
            ("charging", charging),
        ];
        let named = fields.into_iter().filter_map(|(key, name)| Some((key, name.as_ref()?)));
        named.chain(self.cells.iter().map(|name| ("cells", name)))
    }
}

/// A Modbus line with its devices.
#[derive(Clone, Debug, PartialEq)]
pub struct Modbus {
    /// The bus's name: `modbus.plc`.
    pub bus: String,
    /// Serial line or connection.
    pub line: Line,
    /// Its keys.
    pub keys: ModbusKeys,
}

/// A GPIO line.
#[derive(Clone, Debug, PartialEq)]
pub struct Gpio {
    /// The port's name: `gpio.horn`.
    pub bus: String,
    /// Its keys.
    pub keys: GpioKeys,
}

/// Configuration of `driver_io`.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Period of `LL_DATA_IO` and `LL_DATA_BATTERY`.
    pub publish: Duration,
    /// Modbus lines.
    pub modbus: Vec<Modbus>,
    /// Lines of devices with simple request and answer.
    pub serial: Vec<Serial>,
    /// GPIO lines.
    pub gpio: Vec<Gpio>,
    /// Name of the 1-Wire bus.
    pub w1_bus: String,
    /// Channels of switches on it.
    pub switches: Vec<SwitchKeys>,
    /// Channels of the power controller.
    pub power: Vec<PowerKeys>,
    /// CANopen devices, which `driver_canbus` serves.
    pub canopen: Vec<Canopen>,
    /// Batteries.
    pub batteries: Vec<BatteryKeys>,
    /// What outputs show.
    pub signals: Shows,
    /// Inputs that stop the robot (`[stop]`), but those of CANopen devices.
    pub stops: Vec<String>,
}

impl Config {
    /// Channels that the module receives with it.
    pub(super) fn subscriptions(&self) -> Vec<Channel> {
        let shown = [Channel::LlDataVelocity, Channel::LlDataHold, Channel::CmDataFaults];
        let shown = shown.into_iter().filter(|_| !self.signals.show.is_empty());
        let power = [Channel::LlDataPower].into_iter().filter(|_| !self.power.is_empty());
        let canopen = [Channel::LlDataNodeIo].into_iter().filter(|_| !self.canopen.is_empty());
        [Channel::LlCmdOutput].into_iter().chain(shown).chain(power).chain(canopen).collect()
    }
}

listed! {
    /// Why a configuration is refused.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum ConfigError {
        /// Without any.
        Empty => "no signals",
        /// More than [`SIGNALS_MAX`].
        Count => "more than 500 signals, or more than 250 lines and buses",
        /// Two signals of one name.
        Name => "two signals have the same name",
        /// `[stop]` names no input.
        Stop => "[stop] names an input that there is not",
        /// A battery names no signal.
        Battery => "a battery names a signal that there is not",
        /// An entry of `[signals]` names no output, or a value that the output does not take.
        Show => "an entry of [signals] names no output, or a value that it does not take",
        /// A serial line has units 1 to 247.
        Unit => "a serial line has units 1 to 247",
        /// A request of a serial line.
        Request => "a request of a serial line is too long, or its answer has neither a length nor an end",
        /// The master's own check.
        Line => "the line's rate or time limit is out of range",
    }
}

impl std::error::Error for ConfigError {}
