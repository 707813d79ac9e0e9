//! Time to standstill that the table "What stops the robot" of ARCHITECTURE.md promises.

use super::kind::Kind;
use crate::stands;
use drivers::canbus;
use std::time::Duration;

/// Time after such a fault of a module on which the motion depends. A process that has taken all memory ends `dying`
/// after its first missed heartbeat, when the kernel has taken the memory back: until then it hangs, then it is dead.
pub fn stands_after(module: &str, kind: Kind, dying: Duration) -> Duration {
    let (dies, hangs) = match module {
        canbus::NAME => ("`driver_canbus` itself dies", "`driver_canbus` itself hangs"),
        watchdog::NAME => return figure("the watchdog dies"),
        _ => ("a critical module's process dies", "a critical module hangs"),
    };
    match kind {
        Kind::Killed => figure(dies),
        Kind::Memory => figure(hangs).min(figure(dies) + dying),
        _ => figure(hangs),
    }
}

/// Last figure in seconds of the row of an event: that among other processes.
fn figure(event: &str) -> Duration {
    let seconds = stands::figures(event, "s").pop();
    Duration::from_secs_f64(seconds.unwrap_or_else(|| panic!("no figure for: {event}")))
}
