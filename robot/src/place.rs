//! Where a robot is found: its configuration, its run folder, its logs, its bus.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The port of the folder of logs.
pub(crate) const LOG_BUS: &str = "log";
/// The gamepad's port.
pub(crate) const GAMEPAD_BUS: &str = "joystick";
/// The port of the 1-Wire bus.
pub(crate) const W1_BUS: &str = "w1";

/// The bus when neither `--lcm-url` nor `LCM_DEFAULT_URL` names one.
pub const LCM_URL: &str = "udpm://239.255.76.67:7667?ttl=0&shm=auto";
/// Where an installed robot has its configuration, its run folder and its logs.
pub const INSTALLED: (&str, &str, &str) = ("/opt/advee/conf", "/run/advee", "/opt/advee/log");
/// The same in a checkout.
pub const CHECKOUT: (&str, &str, &str) = ("conf/advee", "run", "log");

/// Where a robot is to be found; what every process of it is told.
#[derive(Clone, Debug)]
pub struct Place {
    /// The configuration folder.
    pub config: PathBuf,
    /// The run folder.
    pub run_dir: PathBuf,
    /// The LCM bus.
    pub lcm_url: String,
    /// Overrides of `robot.toml`.
    pub sets: Vec<String>,
    /// The simulated robot.
    pub sim: bool,
    /// Its world; none: the hall.
    pub world: Option<PathBuf>,
}

impl Place {
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

/// Where runs have their folders, unless the configuration says otherwise.
#[must_use]
pub fn log_folder() -> PathBuf {
    Path::new(if in_checkout() { CHECKOUT.2 } else { INSTALLED.2 }).into()
}

/// Whether the working directory is a checkout.
#[must_use]
pub fn in_checkout() -> bool {
    Path::new(CHECKOUT.0).join("robot.toml").exists()
}
