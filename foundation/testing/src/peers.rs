//! Locations of the peers of `make test`.

use crate::Found;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Root of the checkout.
#[must_use]
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().nth(2).expect("foundation/testing lies two folders below the checkout").into()
}

/// User ids without an account, for processes of several users, and a group of them.
pub const USERS: [u32; 3] = [41_001, 41_002, 41_003];
/// Group of [`USERS`].
pub const GROUP: u32 = 41_000;

/// Processes of [`USERS`], which only root may start.
///
/// # Errors
/// One line with the reason.
pub fn users() -> Found<()> {
    let spawned = Command::new("true").uid(USERS[0]).gid(GROUP).status();
    spawned.map(|_| ()).map_err(|error| format!("no processes of other users: {error}"))
}

/// Python with these packages: `.venv`, created by `tools/venv`, or the one named by `ADVEE_PYTHON`.
///
/// # Errors
/// One line with the missing package.
pub fn python(packages: &[&str]) -> Found<PathBuf> {
    let named = std::env::var_os("ADVEE_PYTHON");
    let python = named.map_or_else(|| root().join(".venv/bin/python"), PathBuf::from);
    let import = if packages.is_empty() { "pass".into() } else { format!("import {}", packages.join(", ")) };
    let output = Command::new(&python).args(["-c", &import]).output();
    let output = output.map_err(|error| format!("{}: {error} (tools/venv makes it)", python.display()))?;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        let why = text.lines().last().unwrap_or("an import fails");
        return Err(format!("{}: {why} (tools/venv installs what is missing)", python.display()));
    }
    Ok(python)
}

/// Program in the PATH that accepts `option` with success.
///
/// # Errors
/// One line with its name.
pub fn tool(name: &str, option: &str) -> Found<()> {
    let status = Command::new(name).arg(option).stdout(Stdio::null()).stderr(Stdio::null()).status();
    match status {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{name} {option}: {status}")),
        Err(error) => Err(format!("{name}: {error} (tools/require installs it)")),
    }
}

/// Folder with Debian's LCM 1.3.1: `bin`, `include`, `lib`.
///
/// # Errors
/// One line: `tools/lcm-1.3.1` has not fetched it.
pub fn lcm_1_3_1() -> Found<PathBuf> {
    let prefix = root().join(".peers/lcm-1.3.1");
    match prefix.join("version").exists() {
        true => Ok(prefix),
        false => Err("official LCM 1.3.1 is not in .peers (tools/lcm-1.3.1 fetches it)".into()),
    }
}

/// Verifies a route of this machine to a multicast group, which the official LCM needs, unlike the LCM of this project.
///
/// # Errors
/// One line with the reason.
pub fn multicast_route(group: Ipv4Addr, port: u16) -> Found<()> {
    let reached = UdpSocket::bind("0.0.0.0:0").and_then(|socket| socket.connect((group, port)));
    reached.map_err(|error| format!("no route to {group}, which the official LCM needs: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checkout_is_found_and_missing_tools_are_named() {
        assert!(root().join("ARCHITECTURE.md").exists());
        let why = tool("no-such-program-at-all", "--version").expect_err("there is none");
        assert!(why.contains("no-such-program-at-all"), "{why}");
        assert_eq!(tool("true", "--version"), Ok(()));
    }
}
