//! Which lidars are meant, where they are connected, and who holds their ports.

use crate::holder::{self, Holder, Running};
use crate::{Common, Failed};
use ::lidar::probe::Kind;
use ::lidar::sick::Dialect;
use drivers::lidar::{MODELS, Model};
use host::ports::{ByteParity, PortConfig, TerminalConfig};
use module::State;
use robot::config::{self, Config, ModuleEntry, SIMULATOR};
use robot::place::RobotLocation;
use robot::topology;
use std::fs;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};

/// Selection of lidars, common to the commands that talk to one.
#[derive(clap::Args)]
pub struct Where {
    /// Name of a lidar of the configuration; all of them if it is left out
    name: Option<String>,
    /// Serial device, or ADDRESS:PORT, in place of a name
    #[arg(long, value_name = "PORT", conflicts_with = "name", requires = "model")]
    port: Option<String>,
    /// Model at --port, as in robot.toml
    #[arg(long, value_name = "MODEL", requires = "port", value_parser = model)]
    model: Option<Model>,
    /// bit/s of --port [default: the usual rate of the model]
    #[arg(long, value_name = "BD", requires = "port", value_parser = clap::value_parser!(u32).range(1200..=4_000_000))]
    baud: Option<u32>,
}

/// A model by its name in the configuration.
fn model(text: &str) -> Result<Model, String> {
    let found = MODELS.0.iter().find(|(name, _)| *name == text);
    let names = || MODELS.0.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    found.map(|(_, model)| *model).ok_or_else(|| format!("expected one of {}", names()))
}

/// The name of a model in the configuration.
pub fn model_name(model: Model) -> &'static str {
    MODELS.0.iter().find(|(_, known)| *known == model).map_or("?", |(name, _)| name)
}

/// A lidar, and its port.
pub struct Target {
    /// Name in the configuration, else the port.
    pub name: String,
    /// Model that is expected.
    pub model: Model,
    /// SICK: its dialect, as configured.
    pub dialect: Dialect,
    /// Port.
    pub port: PortConfig,
}

/// Who holds a port.
pub struct Held {
    /// Holder.
    pub holder: Holder,
    /// Bus of its robot, and the lidar's name there, if it is a module of one.
    pub module: Option<(String, String)>,
}

impl Where {
    /// The lidars: those of the simulated robot while one runs in the run folder, else as configured.
    pub fn find(&self, common: &Common) -> Result<Vec<Target>, Failed> {
        if let (Some(port), Some(model)) = (&self.port, self.model) {
            let plain = port_of(port, self.baud.unwrap_or_else(|| model.usual_baud()))?;
            let (name, dialect, port) = (port.clone(), Dialect::Binary, config::lidar_port(plain, model));
            return Ok(vec![Target { name, model, dialect, port }]);
        }
        let (place, robot) = common.robot()?;
        let all: Vec<Target> = robot.lidar.iter().map(|lidar| Target::of(&place, lidar)).collect();
        if all.is_empty() {
            return Err("robot.toml has no table [lidar.<name>]; name a port with --port and --model".into());
        }
        let Some(name) = &self.name else { return Ok(all) };
        let names = all.iter().map(|target| target.name.clone()).collect::<Vec<_>>().join(", ");
        let found: Vec<Target> = all.into_iter().filter(|target| target.name == *name).collect();
        if found.is_empty() {
            Err(format!("robot.toml has no [lidar.{name}]; it has {names}").into())
        } else {
            Ok(found)
        }
    }
}

impl Target {
    fn of(place: &RobotLocation, lidar: &config::Lidar) -> Self {
        let (model, dialect) = (lidar.driver.model, lidar.driver.dialect);
        Self { name: lidar.name.clone(), model, dialect, port: lidar.driver_port(&place.run_dir) }
    }

    /// Protocol of its model.
    pub fn kind(&self) -> Kind {
        kind(self.model, self.dialect)
    }
}

/// Protocol of a model.
pub fn kind(model: Model, dialect: Dialect) -> Kind {
    match model {
        Model::Ld(_) => Kind::Ld,
        Model::Rplidar(_) => Kind::Rplidar,
        Model::Ydlidar(_) => Kind::Ydlidar,
        Model::Sick(_) => Kind::Cola(dialect),
        Model::Hokuyo(_) => Kind::Scip,
    }
}

/// A port as people name it: a device file, or the address and port of a device on the network.
pub fn port_of(text: &str, baud: u32) -> Result<PortConfig, Failed> {
    if text.contains('/') || !text.contains(':') {
        return Ok(serial(Path::new(text), baud));
    }
    let found = text.to_socket_addrs().map_err(|error| format!("{text}: {error}"))?.next();
    let address: SocketAddr = found.ok_or_else(|| format!("{text}: no address has this name"))?;
    Ok(PortConfig::Tcp { address })
}

/// A serial line of bytes without parity.
pub fn serial(path: &Path, baud: u32) -> PortConfig {
    let (bytes, low_latency) = (Some(ByteParity::None), true);
    PortConfig::Terminal(TerminalConfig { bytes, low_latency, ..TerminalConfig::new(path.into(), baud) })
}

/// A port for people: `/dev/ttyUSB0, 230400 bit/s`.
pub fn port_text(port: &PortConfig) -> String {
    match port {
        PortConfig::Terminal(terminal) => format!("{}, {} bit/s", terminal.path.display(), terminal.baud),
        PortConfig::Tcp { address } => address.to_string(),
        other => format!("{other:?}"),
    }
}

/// Who holds a port on this machine; a TCP connection is held by a module that has the same address.
pub fn held(port: &PortConfig) -> Option<Held> {
    let has = |running: &Running| {
        let made = topology::module(&running.place, &running.module, State::Stop);
        made.is_ok_and(|(_, host)| host.ports.iter().any(|theirs| is_same(theirs, port)))
    };
    let modules = || holder::modules().filter(|running| running.module != SIMULATOR);
    let (holder, running) = match port {
        PortConfig::Terminal(terminal) => {
            let holder = holder::holder(&terminal.path)?;
            let running = modules().find(|running| running.pid == holder.pid);
            (holder, running)
        }
        _ => {
            let running = modules().find(has)?;
            (Holder::from(&running), Some(running))
        }
    };
    let name = |running: &Running| {
        let place = &running.place;
        let config = Config::load(&place.config, place.sim, &place.sets).ok()?;
        let mut lidars = config.robot.lidar.iter();
        let found = lidars.find(|lidar| is_same(&lidar.stream().port(&place.run_dir), port))?;
        Some((place.lcm_url.clone(), found.name.clone()))
    };
    let module = running.as_ref().and_then(name);
    Some(Held { holder, module })
}

/// Files and addresses that a robot's other modules use, each with its module: nothing is asked there.
pub fn used(place: &RobotLocation, config: &Config) -> Vec<(PortConfig, String)> {
    let names = config.modules.iter().map(ModuleEntry::name);
    let others = names.filter(|name| ![SIMULATOR, drivers::lidar::NAME].contains(name));
    let ports = others.flat_map(|name| {
        let made = topology::module(place, name, State::Stop);
        let ports = made.map(|(_, host)| host.ports).unwrap_or_default();
        ports.into_iter().map(move |port| (port, name.to_string()))
    });
    ports.collect()
}

/// True if two ports are the same device.
pub fn is_same(one: &PortConfig, other: &PortConfig) -> bool {
    match (file(one), file(other), one, other) {
        (Some(one), Some(other), ..) => real(one) == real(other),
        (.., PortConfig::Tcp { address: one }, PortConfig::Tcp { address: other }) => one == other,
        _ => false,
    }
}

/// Device file of a serial port.
fn file(port: &PortConfig) -> Option<&Path> {
    match port {
        PortConfig::Terminal(terminal) => Some(&terminal.path),
        PortConfig::CanSlcan { path, .. } => Some(path),
        _ => None,
    }
}

fn real(path: &Path) -> PathBuf {
    fs::canonicalize(path).unwrap_or_else(|_| path.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_is_a_file_or_an_address() {
        let text = |port: &str| port_of(port, 115_200).map(|port| port_text(&port)).map_err(|failed| failed.why);
        assert_eq!(text("/dev/ttyUSB0").as_deref(), Ok("/dev/ttyUSB0, 115200 bit/s"));
        assert_eq!(text("/dev/serial/by-path/pci-0:1").as_deref(), Ok("/dev/serial/by-path/pci-0:1, 115200 bit/s"));
        assert_eq!(text("ttyUSB0").as_deref(), Ok("ttyUSB0, 115200 bit/s"));
        assert_eq!(text("192.168.0.1:2112").as_deref(), Ok("192.168.0.1:2112"));
        assert!(text("192.168.0.1:port").is_err());
    }

    #[test]
    fn a_device_is_the_same_by_whatever_name() {
        let folder = std::env::temp_dir().join(format!("advee-lidar-same-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let (device, link) = (folder.join("device"), folder.join("link"));
        fs::write(&device, "").unwrap();
        std::os::unix::fs::symlink(&device, &link).unwrap();
        let slcan = PortConfig::CanSlcan { path: device.clone(), bitrate: 500_000 };
        assert!(is_same(&serial(&device, 1200), &serial(&link, 9600)) && is_same(&serial(&link, 1200), &slcan));
        assert!(!is_same(&serial(&device, 1200), &serial(&folder, 1200)));
        fs::remove_dir_all(&folder).unwrap();
        let [one, other] = ["127.0.0.1:2111", "127.0.0.1:2112"].map(|text| port_of(text, 1200).unwrap());
        assert!(is_same(&one, &one) && !is_same(&one, &other));
    }

    #[test]
    fn models_have_the_names_of_the_configuration() {
        for (name, known) in MODELS.0 {
            assert_eq!((model(name), model_name(*known)), (Ok(*known), *name));
        }
        assert!(model("ld07").is_err_and(|why| why.contains("ld06, ld19")));
    }
}
