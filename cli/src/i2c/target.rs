//! Which bus is meant, and who is known to be on it.

use crate::holder::holder;
use crate::{Common, Failed, choice, whole};
use base::i2c::Address;
use host::ports::settings::I2cPlace;
use robot::config::I2cBus;
use std::fs;
use std::path::Path;

/// Selection of a bus, common to all commands.
#[derive(clap::Args)]
pub struct Where {
    /// Bus of the configuration: aux; may be left out where there is only one
    #[arg(long, value_name = "NAME", conflicts_with = "port")]
    bus: Option<String>,
    /// Any bus, in place of --bus: /dev/i2c-1, gpio:/dev/gpiochip0:SDA:SCL or unix:PATH
    #[arg(long, value_name = "PLACE", value_parser = place)]
    port: Option<I2cPlace>,
    /// Clock of a --port of two GPIO lines
    #[arg(long, value_name = "HZ", requires = "port", conflicts_with = "bus", default_value = "100000",
          value_parser = clap::value_parser!(u32).range(1000..=1_000_000))]
    hz: u32,
}

fn place(text: &str) -> Result<I2cPlace, String> {
    I2cPlace::parse(text).ok_or_else(|| "expected /dev/i2c-1, gpio:/dev/gpiochip0:SDA:SCL or unix:PATH".into())
}

/// A chip that is configured.
#[derive(Clone, Debug)]
pub struct Known {
    /// Name for people.
    pub name: String,
    /// Address.
    pub address: Address,
}

/// A bus.
pub struct Target {
    /// For people: `i2c.aux`, or the device.
    pub name: String,
    /// Port.
    pub port: host::ports::PortConfig,
    /// The adapter's device file, which one process has at a time.
    pub device: Option<std::path::PathBuf>,
    /// Configured chips.
    pub known: Vec<Known>,
}

impl Where {
    /// Finds the bus: the simulated robot's while one runs in the run folder, else as configured.
    pub fn find(&self, common: &Common) -> Result<Target, Failed> {
        if let Some(port) = &self.port {
            return Ok(self.find_port(common, port));
        }
        let (place, robot) = common.robot()?;
        let bus = choice::bus("i2c", self.bus.as_deref(), &robot.i2c, |bus| &bus.name, "--port")?;
        let port = bus.port.place.port(&place.run_dir, bus.port.hz);
        Ok(Target { name: format!("i2c.{}", bus.name), port, device: device(&bus.port.place), known: known(bus) })
    }

    /// A port may be one of the robot's: then its chips are known, too.
    fn find_port(&self, common: &Common, port: &I2cPlace) -> Target {
        let same = |bus: &I2cBus| match (&bus.port.place, port) {
            (I2cPlace::Dev(one), I2cPlace::Dev(two)) => {
                one == two || fs::canonicalize(one).is_ok_and(|one| fs::canonicalize(two).is_ok_and(|two| one == two))
            }
            (one, two) => one == two,
        };
        let robot = common.robot().ok();
        let configured = robot.as_ref().and_then(|(_, robot)| robot.i2c.iter().find(|bus| same(bus)));
        // What is named on the command line is looked for in the working directory.
        let path = port.port(Path::new(""), self.hz);
        Target {
            name: port.to_string(),
            port: path,
            device: device(port),
            known: configured.map(known).unwrap_or_default(),
        }
    }
}

fn device(place: &I2cPlace) -> Option<std::path::PathBuf> {
    match place {
        I2cPlace::Dev(path) => Some(path.clone()),
        I2cPlace::Gpio { chip, .. } => Some(chip.clone()),
        I2cPlace::Socket(_) => None,
    }
}

fn known(bus: &I2cBus) -> Vec<Known> {
    let chips = bus.driver.chips.iter();
    chips.filter_map(|chip| Some(Known { name: chip.name.clone(), address: chip.address()? })).collect()
}

impl Target {
    /// Refuses while a module has the adapter.
    pub fn is_free(&self) -> Result<(), Failed> {
        let Some(holder) = self.device.as_deref().and_then(|device: &Path| holder(device)) else { return Ok(()) };
        let whose = format!("{} is held by {}", self.name, holder.text());
        Err(match &holder.module {
            Some(module) => format!("{whose}: stop it first (advee state {module} TERMINATE)"),
            None => format!("{whose}: end it first"),
        }
        .into())
    }

    /// The chip that is meant by a name or an address, decimal or 0x….
    pub fn chip(&self, text: &str) -> Result<Known, Failed> {
        if let Some(known) = self.known.iter().find(|known| known.name == text) {
            return Ok(known.clone());
        }
        if let Some(address) = whole(text).and_then(Address::new) {
            return Ok(self.at(address));
        }
        let names = choice::or_one_of(self.known.iter().map(|known| format!("{} ({})", known.name, known.address)));
        Err(format!("no chip {text:?}: expected an address from 0x00 to 0x7f{names}").into())
    }

    /// The chip at an address.
    pub fn at(&self, address: Address) -> Known {
        let known = self.known.iter().find(|known| known.address == address).cloned();
        known.unwrap_or_else(|| Known { name: "?".into(), address })
    }

    /// True if the chip is configured.
    pub fn knows(&self, address: Address) -> bool {
        self.known.iter().any(|known| known.address == address)
    }
}

impl Known {
    /// For people: `fan1 (0x18)`.
    pub fn text(&self) -> String {
        match self.name.as_str() {
            "?" => format!("chip {}", self.address),
            name => format!("{name} ({})", self.address),
        }
    }
}
