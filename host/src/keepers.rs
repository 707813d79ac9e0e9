//! Which modules run as other users than the robot's, and where the keeper of each is ([`crate::keeper`]).

use nix::unistd::geteuid;
use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

/// Environment variable with the keepers of a robot: `web=/run/advee-web`, several with blanks between them. Without
/// it, as in a checkout, all modules run as one user.
pub const VARIABLE: &str = "ADVEE_KEEPERS";

/// Where the keeper of a module is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The module.
    pub module: String,
    /// Folder of its user.
    pub folder: PathBuf,
}

impl Place {
    /// The keepers that the environment names.
    ///
    /// # Errors
    /// The variable is invalid, in one line.
    pub fn all() -> Result<Vec<Self>, String> {
        let text = std::env::var_os(VARIABLE).unwrap_or_default();
        let text = text.to_str().ok_or_else(|| format!("{VARIABLE} is no text"))?;
        let place = |word: &str| match word.split_once('=') {
            Some((module, folder)) if !module.is_empty() && folder.starts_with('/') => {
                Ok(Self { module: module.into(), folder: folder.into() })
            }
            _ => Err(format!("{VARIABLE}: {word:?} is not MODULE=FOLDER with an absolute folder")),
        };
        text.split_ascii_whitespace().map(place).collect()
    }

    /// User of the module.
    ///
    /// # Errors
    /// The folder does not exist.
    pub fn user(&self) -> io::Result<u32> {
        Ok(fs::symlink_metadata(&self.folder)?.uid())
    }

    /// Socket of the keeper.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.folder.join("keeper")
    }
}

/// Users of this robot, as far as this process knows: its own, and those of the modules that the environment names.
#[must_use]
pub fn users() -> Vec<u32> {
    let others = Place::all().unwrap_or_default().into_iter().filter_map(|place| place.user().ok());
    std::iter::once(own_user()).chain(others).collect()
}

/// User of this process.
#[must_use]
pub fn own_user() -> u32 {
    geteuid().as_raw()
}

/// True if modules of this robot run as other users.
#[must_use]
pub fn are_any() -> bool {
    Place::all().is_ok_and(|places| !places.is_empty())
}
