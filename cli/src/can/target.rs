//! Which CAN bus is meant, who is known to be on it, and which module holds it.

use crate::holder::{self, Holder, Running};
use crate::{Common, Failed, choice, whole};
use drivers::canbus::Drive;
use host::ports::PortConfig;
use host::ports::settings::CanInterface;
use module::State;
use robot::config::{CanBus, Robot, SIMULATOR};
use robot::place::RobotLocation;
use robot::topology;
use std::fs;
use std::path::{Path, PathBuf};

/// Selection of a bus, common to all commands.
#[derive(clap::Args)]
pub struct Where {
    /// Bus of the configuration: main; may be left out where there is only one
    #[arg(long, value_name = "NAME", conflicts_with = "interface")]
    bus: Option<String>,
    /// can0, slcan:DEVICE or udp:GROUP:PORT, in place of --bus
    #[arg(long, value_name = "IFACE", value_parser = interface)]
    interface: Option<CanInterface>,
    /// bit/s of --interface
    #[arg(long, value_name = "BD", requires = "interface", conflicts_with = "bus", default_value = "500000",
          value_parser = clap::value_parser!(u32).range(10_000..=1_000_000))]
    bitrate: u32,
}

fn interface(text: &str) -> Result<CanInterface, String> {
    CanInterface::parse(text).ok_or_else(|| "expected can0, slcan:/DEVICE or udp:GROUP:PORT".into())
}

/// A node that is configured.
#[derive(Clone, Debug)]
pub struct Known {
    /// Id, 1..=127.
    pub id: u8,
    /// Name for people: its axis.
    pub name: String,
    /// Kind of drive.
    pub drive: Drive,
    /// Electronic data sheet, where another than the built-in one is configured.
    pub eds: Option<PathBuf>,
}

/// A bus.
pub struct Target {
    /// For people: `can.main`, or the interface.
    pub name: String,
    /// The `<BUS>` of `LL_DATA_RAW_<BUS>`, and whether it is configured to be sent; none for a port that is no bus's.
    pub raw: Option<(String, bool)>,
    /// Port.
    pub port: PortConfig,
    /// bit/s.
    pub bitrate: u32,
    /// Configured nodes.
    pub known: Vec<Known>,
    /// The node id of the module that is its master, where it is the robot's.
    pub master: Option<u8>,
    /// What is added to an id where `LL_CMD_SDO` names a node of this bus: 1000 for each bus before it. `None`: it is
    /// no bus of the drives, and `LL_CMD_SDO` does not reach it. 0 for an interface that is not configured.
    pub numbers_from: Option<i32>,
}

/// The module that holds a bus.
pub struct Held {
    /// Holder.
    pub holder: Holder,
    /// The robot that it is of.
    pub place: RobotLocation,
}

impl Where {
    /// Finds the bus: the simulated robot's while one runs in the run folder, else as configured.
    pub fn find(&self, common: &Common) -> Result<Target, Failed> {
        if let Some(interface) = &self.interface {
            return Target::find(common, interface, self.bitrate);
        }
        let (place, robot) = common.robot()?;
        let bus = choice::bus("can", self.bus.as_deref(), &robot.can, |bus| &bus.name, "--interface")?;
        Target::of(&place, &robot, bus)
    }
}

impl Target {
    /// The bus of an interface, as `--interface` has it; at its usual bit rate, where that must be known.
    pub fn on(common: &Common, interface: &CanInterface) -> Result<Self, Failed> {
        Self::find(common, interface, 500_000)
    }

    /// An interface may be one of the robot's: then its nodes are known, too.
    fn find(common: &Common, interface: &CanInterface, bitrate: u32) -> Result<Self, Failed> {
        let port = interface.port(&common.lcm_url(), bitrate)?;
        let name = match (interface, &port) {
            (CanInterface::Socket(interface), _) => interface.clone(),
            (CanInterface::Slcan(path), _) => format!("slcan:{}", path.display()),
            (_, PortConfig::CanUdp { bus }) => format!("udp:{bus}"),
            (interface, _) => format!("{interface:?}"),
        };
        // The simulated one's, too, before it runs.
        let configured = [true, false].into_iter().find_map(|sim| {
            let (place, robot) = (common.place(sim), common.load(sim).ok()?.robot);
            let mut buses = robot.can.iter().filter_map(|bus| Self::of(&place, &robot, bus).ok());
            buses.find(|bus| is_same(&bus.port, &port))
        });
        let stranger = Self { name, raw: None, port, bitrate, known: Vec::new(), master: None, numbers_from: Some(0) };
        Ok(configured.unwrap_or(stranger))
    }

    fn of(place: &RobotLocation, robot: &Robot, bus: &CanBus) -> Result<Self, Failed> {
        let nodes = bus.driver.nodes.iter().filter(|node| node.is_canopen());
        let known = nodes.map(|node| Known {
            id: node.id,
            name: node.axis.name().into(),
            drive: node.drive.clone(),
            eds: node.eds.as_ref().map(|eds| place.config.join(eds)),
        });
        let is_of_drives = robot.buses_of_motion(&robot.can).iter().any(|own| own.name == bus.name);
        Ok(Self {
            name: format!("can.{}", bus.name),
            raw: Some((bus.name.to_uppercase(), bus.port.raw)),
            port: bus.port.interface.port(&place.lcm_url, bus.driver.bitrate)?,
            bitrate: bus.driver.bitrate,
            known: known.collect(),
            master: Some(bus.driver.master),
            numbers_from: is_of_drives.then(|| robot.node_number(bus, 0)),
        })
    }

    /// Which module holds the bus: one that runs on this machine and has it among its ports. The simulator is on the
    /// bus as its nodes, and holds nothing.
    pub fn held(&self) -> Option<Held> {
        let has = |running: &Running| {
            let made = topology::module(&running.place, &running.module, State::Stop);
            made.is_ok_and(|(_, host)| host.ports.iter().any(|port| is_same(port, &self.port)))
        };
        let running = holder::modules().filter(|running| running.module != SIMULATOR).find(has)?;
        Some(Held { holder: Holder::from(&running), place: running.place })
    }

    /// Refuses a bus that a module holds, with a hint.
    pub fn refuse_held(&self, what: &str) -> Result<(), Failed> {
        let Some(Held { holder, .. }) = self.held() else {
            return Ok(());
        };
        let module = holder.module.clone().unwrap_or_default();
        let text = format!("{} is held by {}: {what}", self.name, holder.text());
        Err(format!("{text}; stop it first (advee state {module} TERMINATE)").into())
    }

    /// Name of a node; empty for an unconfigured one.
    pub fn name_of(&self, node: u8) -> &str {
        let known = self.known.iter().find(|known| known.id == node).map(|known| known.name.as_str());
        known.unwrap_or(if self.master == Some(node) { "master" } else { "" })
    }

    /// The node that is meant by a name or an id, decimal or 0x….
    pub fn node(&self, text: &str) -> Result<u8, Failed> {
        if let Some(known) = self.known.iter().find(|known| known.name == text) {
            return Ok(known.id);
        }
        let number: Option<u8> = whole(text);
        if let Some(id) = number.filter(|id| (1..=127).contains(id)) {
            return Ok(id);
        }
        let names = choice::or_one_of(self.known.iter().map(|known| format!("{} ({})", known.name, known.id)));
        Err(format!("no node {text:?}: expected an id from 1 to 127{names}").into())
    }

    /// A node for people: `1 (propulsion)`.
    pub fn text(&self, node: u8) -> String {
        match self.name_of(node) {
            "" => format!("node {node}"),
            name => format!("node {node} ({name})"),
        }
    }
}

/// True if two ports are the same bus.
fn is_same(one: &PortConfig, other: &PortConfig) -> bool {
    match (one, other) {
        (PortConfig::CanSocket { interface: one }, PortConfig::CanSocket { interface: other }) => one == other,
        // What keeps them apart is the port.
        (PortConfig::CanUdp { bus: one }, PortConfig::CanUdp { bus: other }) => one.port() == other.port(),
        (PortConfig::CanSlcan { path: one, .. }, PortConfig::CanSlcan { path: other, .. }) => {
            let device = |path: &Path| fs::canonicalize(path).unwrap_or_else(|_| path.into());
            device(one) == device(other)
        }
        _ => false,
    }
}
