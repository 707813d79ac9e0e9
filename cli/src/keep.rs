//! `advee keep MODULE`: starts and ends a module as this user, for the watchdog of another user's robot. A unit of the
//! service manager runs it (`packaging/systemd/advee-web.service`).

use super::{Failed, Outcome};
use nix::unistd::User;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Keep {
    /// Which module
    module: String,
    /// Folder of this user, which ADVEE_KEEPERS of the robot names
    #[arg(long, value_name = "DIR")]
    folder: PathBuf,
    /// User of the robot, a name or number: its watchdog alone commands here
    #[arg(long, value_name = "USER")]
    robot: String,
}

pub fn keep(Keep { module, folder, robot }: &Keep) -> Outcome {
    let uid = match robot.parse() {
        Ok(uid) => uid,
        Err(_) => match User::from_name(robot) {
            Ok(Some(user)) => user.uid.as_raw(),
            Ok(None) => return Err(Failed::from(format!("--robot {robot}: there is no such user"))),
            Err(errno) => return Err(Failed::from(format!("--robot {robot}: {}", errno.desc()))),
        },
    };
    host::keeper::keep(folder, module, uid)?;
    Ok(ExitCode::SUCCESS)
}
