//! A bus of this computer alone is not opened where the kernel refuses the socket filter: real processes, in which
//! every attachment of a filter fails.

#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use crate::support::{self, Robot};
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Loaded into a process (`LD_PRELOAD`): the kernel has no memory for a socket filter.
const REFUSES: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <sys/socket.h>

int setsockopt(int fd, int level, int option, const void *value, socklen_t length)
{
    int (*real)(int, int, int, const void *, socklen_t) = dlsym(RTLD_NEXT, "setsockopt");
    if (level == SOL_SOCKET && option == SO_ATTACH_FILTER) {
        errno = ENOMEM;
        return -1;
    }
    return real(fd, level, option, value, length);
}
"#;
/// What is reported.
const WHY: &str = "cannot attach the socket filter that keeps datagrams of other hosts away";

/// The library, in a folder that is removed at the end.
struct Library(PathBuf);

impl Library {
    /// None if there is no C compiler.
    fn build(test: &str) -> Option<Self> {
        testing::peer_or_skip(testing::tool("cc", "--version"))?;
        let folder = std::env::temp_dir().join(format!("advee-no-filter-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (source, library) = (folder.join("refuses.c"), folder.join("refuses.so"));
        std::fs::write(&source, REFUSES).unwrap();
        let built = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(library).arg(source).status();
        assert!(built.unwrap().success());
        Some(Self(folder))
    }

    fn path(&self) -> PathBuf {
        self.0.join("refuses.so")
    }
}

impl Drop for Library {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn modules_whose_bus_cannot_be_kept_local_do_not_start() {
    let Some(library) = Library::build("bus") else { return };
    let _turn = support::turn();
    let run_dir = std::env::temp_dir().join(format!("advee-no-filter-{}", std::process::id()));
    let url = format!("udpm://239.255.76.67:{}?ttl=0", support::unique_port());
    for arguments in [&["run", "watchdog"][..], &["run", "driver_canbus"], &["up", "--sim"]] {
        let mut advee = support::advee(&url, &run_dir);
        let output = advee.args(arguments).env("LD_PRELOAD", library.path()).stdin(Stdio::null()).output().unwrap();
        let why = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && why.contains(WHY), "{arguments:?}: {}: {why}", output.status);
    }
    let _ = std::fs::remove_dir_all(run_dir);
}

#[test]
fn drives_whose_bus_cannot_be_kept_local_are_not_driven() {
    let Some(library) = Library::build("can") else { return };
    // A message bus of the network needs no such filter; the drives' CAN bus over UDP always does.
    let mut robot = Robot::start_with(1, &[], |up, _| {
        up.env("LD_PRELOAD", library.path());
    });
    robot.until("the CAN bus is refused", 20.0, |view| view.errors.iter().any(|error| error.message.contains(WHY)));
    robot.until("the driver says so", 20.0, |view| view.motion.is_some());
    assert!(!robot.view.is_free() && !robot.view.is_homed(), "{:?}", robot.view.causes());
    robot.drive(0.3, 0.0, 1.0);
    let speed = robot.view.speed();
    assert!(!robot.view.is_free() && (speed.is_nan() || speed == 0.0), "{speed}: {:?}", robot.view.causes());
}
