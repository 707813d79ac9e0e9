//! Exit codes of a module's process, as in 2011: a class plus a number 0..=16. For a process that a signal ended, 128 +
//! the signal's number.
//!
//! Numbers 1 to 8 of a class have one meaning in all modules, those in [`SHARED`]; numbers from 9 on are each module's
//! own. A code keeps its meaning for ever. `docs/supervision.md` has the same table.

/// Ended as commanded.
pub const OK: u8 = 0;
/// A resource was refused: a file, memory, a permission, the configuration.
pub const RESOURCE: u8 = 0x10;
/// The machine refused what the module needs at its start: the message bus, its heartbeat page, a descriptor.
pub const START: u8 = RESOURCE + 1;
/// The module's place in the shared memory of the message bus was damaged while it ran.
pub const BUS_LOST: u8 = RESOURCE + 2;
/// The kernel refused to wait for input while it ran.
pub const WAIT: u8 = RESOURCE + 3;
/// A server inside the module stood still: the web server, the node of ROS 2.
pub const SERVER_STALLED: u8 = RESOURCE + 4;
/// Another program has the address where the module listens; only a server started by hand ends for that.
pub const ADDRESS_IN_USE: u8 = RESOURCE + 5;
/// A device failed. No module of this project ends for that: it is in ERROR until the device is back.
pub const DEVICE: u8 = 0x20;
/// Any other cause.
pub const OTHER: u8 = 0x40;
/// A defect of the program: a panic, whose file and line are in the last line that it printed.
pub const PANIC: u8 = OTHER + 1;

/// Codes of this project's modules other than 0, each with its meaning, in order.
pub const SHARED: [(u8, &str); 9] = [
    (RESOURCE, "the configuration or the command line is refused"),
    (START, "the machine refused what it needs to start"),
    (BUS_LOST, "its place in the shared memory of the message bus was damaged"),
    (WAIT, "the kernel refused to wait for input"),
    (SERVER_STALLED, "its server stood still"),
    (ADDRESS_IN_USE, "another program has its address"),
    (DEVICE, "a device failed"),
    (OTHER, "any other cause"),
    (PANIC, "a defect of the program, at the place in its last line"),
];

/// Meaning of a code with a number that all modules share; `None` for a class alone, and for any other code.
#[must_use]
pub fn meaning(code: i32) -> Option<&'static str> {
    let is_class = [RESOURCE, DEVICE, OTHER].map(i32::from).contains(&code);
    let known = SHARED.iter().find(|(known, _)| i32::from(*known) == code && !is_class);
    known.map(|(_, meaning)| *meaning)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_codes_are_of_their_classes_and_in_order() {
        assert!(SHARED.is_sorted_by(|(one, _), (next, _)| one < next));
        for (code, _) in SHARED {
            assert!([RESOURCE, DEVICE, OTHER].iter().any(|class| (*class..=class + 8).contains(&code)), "{code:#04x}");
        }
        assert_eq!([OK, RESOURCE, DEVICE, OTHER], [0, 0x10, 0x20, 0x40]);
        assert_eq!(meaning(0x14), Some("its server stood still"));
        assert_eq!([0, 0x10, 0x20, 0x23, 0x40, 0x42, -1, 137].map(meaning), [None; 8]);
    }

    #[test]
    fn the_page_about_supervision_has_the_same_table() {
        let page = include_str!("../../../docs/supervision.md");
        let is_row = |line: &&str| line.starts_with("| `0x");
        let rows: Vec<&str> = page.lines().filter(is_row).collect();
        let expected: Vec<String> =
            SHARED.iter().map(|(code, meaning)| format!("| `{code:#04x}` | {meaning} |")).collect();
        assert_eq!(rows.len(), expected.len(), "{rows:?}");
        for (row, expected) in rows.iter().zip(&expected) {
            assert!(row.starts_with(expected), "{row}\n{expected}");
        }
    }
}
