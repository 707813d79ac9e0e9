//! What `driver_power` must know of the robot; SI units but for ampere-hours.

use crate::rs485_bus::Node;
use base::{Duration, listed};
use rs485::boards::psc1::CHANNELS;
use rs485::crc::Crc8;
use settings::{Table, settings};

settings! {
    /// `[power]`: the power controller and its battery. With this table the robot does not move unless the state of the
    /// PAUSE line is known.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Config {
        /// Link to the controller: an EIA-485 bus with a node of driver `psc1`, and no other.
        bus: String = "rs485.power";
        /// bit/s on the wire.
        baud: u32 = unset 115_200;
        /// The check of its frames.
        crc: Crc8 = unset Crc8::SAE_J1850;
        /// The controller.
        node: Node = unset Node::usual();
        /// Capacity of the full battery.
        capacity_ah: f64 = required, 0.1..=10_000.0;
        /// Cells in series.
        cells: u8 = required, 1..=16;
        /// Charge below which a warning is reported.
        reserve: f64 = 0.2, 0.0..=1.0;
        /// Greatest currents of power channels.
        channels: Vec<ChannelConfig> = [];
        /// Computers that are shut down by their power buttons before their channels are switched off.
        computers: Vec<ComputerConfig> = [];
        /// The other modules, in the order in which they were started; they are ended the other way round.
        modules: Vec<String> = unset Vec::<String>::new();
        /// Program and arguments that halt the computer when the supply is cut or channel host is switched off; never
        /// run in simulation.
        halt_command as halt: Vec<String> = Vec::<String>::new();
        /// Program and arguments that restart it. Absent: a restart is refused.
        reboot_command as reboot: Vec<String> = Vec::<String>::new();
        /// A simulated robot: the computer belongs to others, and neither command is run.
        simulated: bool = unset false;
    }
    check Config::check_channels;
}

settings! {
    /// `[[power.channels]]`: greatest current of a power channel, at which it switches itself off.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ChannelConfig {
        /// Channel: `host`, `computer1`, `computer2`, `motors`, `monitor`, `audio`, `sensors` or `switch`.
        name: String = required;
        /// Greatest current.
        current_max_a: f64 = required, 0.1..=100.0;
        /// Share of it from which a warning is reported.
        warning_share: f64 = 0.8, 0.1..=1.0;
    }
}

settings! {
    /// `[[power.computers]]`: a computer that is fed by a power channel and has a power button that an output of `[io]`
    /// presses. Switching the channel off presses it, and switches off when the computer is down, or after
    /// `shutdown_s`.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ComputerConfig {
        /// Power channel: `computer1` or `computer2`.
        channel: String = required;
        /// Output of `[io]` at its power button, not on 1-Wire: pressed while it is 1.
        button: String = required;
        /// Input of `[io]` at its power LED: 1 while it runs. Absent: its shutdown is not observed, and it
        /// always gets the whole of `shutdown_s`.
        alive: Option<String> = optional;
        /// Length of a press. Longer ones switch many computers off at once.
        press_s as press: Duration = 0.3, 0.05..=3.0;
        /// Longest time of an orderly shutdown, from the press on.
        shutdown_s as shutdown: Duration = 60.0, 1.0..=600.0;
        /// The button is pressed after its supply came up, too: it does not start by itself.
        press_on: bool = false;
    }
}

listed! {
    /// Why a configuration is refused.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum ConfigError {
        /// The rate is not above 0.
        Rate => "the controller's rate must be above 0",
        /// Capacity, cells or reserve cannot be.
        Battery => "battery: a capacity above 0, 1 to 16 cells, a reserve of 0 to 1",
    }
}

impl std::error::Error for ConfigError {}

impl Config {
    fn check_channels(&self, table: &Table<'_>) {
        let names: Vec<&String> = self.channels.iter().map(|channel| &channel.name).collect();
        table.unique("channels", "name", &names, "one that no other entry has");
        let unknown = self.channels.iter().enumerate().filter(|(_, own)| !CHANNELS.contains(&own.name.as_str()));
        for item in unknown.filter_map(|(n, _)| table.item("channels", n)) {
            item.refuse("name", "a power channel: host, computer1, computer2, motors, monitor, audio, sensors, switch");
        }
        let fed: Vec<&String> = self.computers.iter().map(|computer| &computer.channel).collect();
        table.unique("computers", "channel", &fed, "one that no other entry has");
        let buttons: Vec<&String> = self.computers.iter().map(|computer| &computer.button).collect();
        table.unique("computers", "button", &buttons, "one that no other entry has");
        let others =
            fed.iter().enumerate().filter(|(_, channel)| !["computer1", "computer2"].contains(&channel.as_str()));
        for item in others.filter_map(|(n, _)| table.item("computers", n)) {
            item.refuse("channel", "\"computer1\" or \"computer2\"");
        }
    }

    /// Looks at what the module relies on.
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        if !(self.node.rate_hz.is_finite() && self.node.rate_hz > 0.0) {
            return Err(ConfigError::Rate);
        }
        let capacity = self.capacity_ah.is_finite() && self.capacity_ah > 0.0;
        let sane = capacity && (1..=16).contains(&self.cells) && (0.0..=1.0).contains(&self.reserve);
        if sane { Ok(()) } else { Err(ConfigError::Battery) }
    }
}
