//! Location of a robot: configuration, run folder, logs, bus.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The port of the folder of logs.
pub(crate) const LOG_BUS: &str = "log";
/// The gamepad's port.
pub(crate) const GAMEPAD_BUS: &str = "joystick";
/// The port of the 1-Wire bus.
pub(crate) const W1_BUS: &str = "w1";
/// Name of the port of the computer's temperatures.
pub(crate) const HOST_BUS: &str = "host";

/// Bus without `--lcm-url` and `LCM_DEFAULT_URL`.
pub const LCM_URL: &str = "udpm://239.255.76.67:7667?ttl=0&shm=auto";
/// Configuration, run folder and logs of an installed robot.
pub const INSTALLED: (&str, &str, &str) = ("/opt/advee/conf", "/run/advee", "/opt/advee/log");
/// Configuration, run folder and logs in a checkout.
pub const CHECKOUT: (&str, &str, &str) = ("conf/advee", "run", "log");

/// Location of a robot, passed to each of its processes.
#[derive(Clone, Debug)]
pub struct RobotLocation {
    /// Configuration folder.
    pub config: PathBuf,
    /// Run folder.
    pub run_dir: PathBuf,
    /// URL of the LCM bus.
    pub lcm_url: String,
    /// Overrides of `robot.toml`.
    pub sets: Vec<String>,
    /// True for the simulated robot.
    pub sim: bool,
    /// World of the simulation; `None` for the hall.
    pub world: Option<PathBuf>,
}

impl RobotLocation {
    /// The arguments that make another `advee run` find the same robot.
    #[must_use]
    pub fn arguments(&self) -> Vec<OsString> {
        let mut args: Vec<OsString> = Vec::new();
        args.extend(["--config".into(), self.config.clone().into()]);
        args.extend(["--run-dir".into(), self.run_dir.clone().into()]);
        args.extend(["--lcm-url".into(), self.lcm_url.clone().into()]);
        for set in &self.sets {
            args.extend(["--set".into(), set.into()]);
        }
        if self.sim {
            args.push("--sim".into());
        }
        if let Some(world) = &self.world {
            args.extend(["--world".into(), world.into()]);
        }
        args
    }
}

/// Folder of the runs, unless the configuration names another.
#[must_use]
pub fn log_folder() -> PathBuf {
    Path::new(if in_checkout() { CHECKOUT.2 } else { INSTALLED.2 }).into()
}

/// True if the working directory is a checkout.
#[must_use]
pub fn in_checkout() -> bool {
    Path::new(CHECKOUT.0).join("robot.toml").exists()
}
