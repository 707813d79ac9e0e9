//! The program that switches a port of a TS-7800 to EIA-485, on files in place of `/dev/mem` and `/proc/cpuinfo`.

#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::process::Command;

/// Physical address of the FPGA, where its identity is; the register follows 12 bytes later.
const FPGA: u64 = 0xE800_0000;
/// Identity of a TS-7800's FPGA, revision 3.
const IDENTITY: u32 = 0x00B4_8003;
const CPUINFO: &str = "model name\t: Feroceon\nHardware\t: Technologic Systems TS-78xx SBC\nRevision\t: 0000\n";

/// The built program and a board, in a folder that is removed at the end.
struct Board {
    folder: PathBuf,
    memory: File,
}

impl Board {
    /// None if there is no C compiler.
    fn new(test: &str) -> Option<Self> {
        testing::peer_or_skip(testing::tool("cc", "--version"))?;
        let folder = std::env::temp_dir().join(format!("advee-ts7800-{test}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let source = crate::support::workspace().join("examples/boards/ts7800_eia485.c");
        let built = Command::new("cc")
            .args(["-O2", "-Wall", "-Wextra", "-Werror", "-o"])
            .arg(folder.join("program"))
            .arg(source)
            .status();
        assert!(built.unwrap().success());
        fs::write(folder.join("cpuinfo"), CPUINFO).unwrap();
        let memory =
            File::options().read(true).write(true).create(true).truncate(true).open(folder.join("mem")).unwrap();
        // Sparse: it takes one page of the disk.
        memory.set_len(FPGA + 0x1000).unwrap();
        let board = Self { folder, memory };
        board.write([IDENTITY, 0x1111_1111, 0x2222_2222, 0x1234_0567, 0x4444_4444]);
        Some(board)
    }

    fn write(&self, registers: [u32; 5]) {
        let bytes: Vec<u8> = registers.iter().flat_map(|register| register.to_le_bytes()).collect();
        self.memory.write_all_at(&bytes, FPGA).unwrap();
    }

    fn registers(&self) -> [u32; 5] {
        std::array::from_fn(|number| {
            let mut bytes = [0; 4];
            self.memory.read_exact_at(&mut bytes, FPGA + 4 * number as u64).unwrap();
            u32::from_le_bytes(bytes)
        })
    }

    /// Exit status, output and error output.
    fn run(&self, arguments: &[&str]) -> (i32, String, String) {
        let mut program = Command::new(self.folder.join("program"));
        program.args(arguments).arg("--mem").arg(self.folder.join("mem"));
        let output = program.arg("--cpuinfo").arg(self.folder.join("cpuinfo")).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn the_bit_alone_is_changed_and_read_back() {
    let Some(board) = Board::new("bit") else { return };
    let with = |register| [IDENTITY, 0x1111_1111, 0x2222_2222, register, 0x4444_4444];
    let printed = |text: &str| (0, format!("0xE800000C: {text}\n"), String::new());
    assert_eq!(board.run(&["print"]), printed("0x12340567, bit 15 is 0"));
    assert_eq!(board.run(&["set"]), printed("0x12340567, now 0x12348567"));
    assert_eq!(board.registers(), with(0x1234_8567));
    // Again, as before each opening of a port.
    assert_eq!(board.run(&["set"]), printed("0x12348567, now 0x12348567"));
    assert_eq!(board.run(&["print"]), printed("0x12348567, bit 15 is 1"));
    assert_eq!(board.run(&["clear"]), printed("0x12348567, now 0x12340567"));
    assert_eq!(board.registers(), with(0x1234_0567));
}

#[test]
fn anything_but_the_board_is_refused_and_nothing_is_written() {
    let Some(board) = Board::new("refused") else { return };
    let before = board.registers();
    let no_board = |name: &str| {
        let (status, _, why) = board.run(&["set"]);
        assert!(status == 1 && why.contains("not a TS-7800"), "{name}: {status} {why}");
    };
    for name in ["Technologic Systems TS-78xx SBC clone", "Raspberry Pi 4 Model B", ""] {
        fs::write(board.folder.join("cpuinfo"), format!("Hardware\t: {name}\n")).unwrap();
        no_board(name);
    }
    fs::write(board.folder.join("cpuinfo"), "processor\t: 0\n").unwrap();
    no_board("none");
    assert_eq!(board.registers(), before);

    fs::write(board.folder.join("cpuinfo"), CPUINFO).unwrap();
    for identity in [0, 0xFFFF_FFFF, 0x00B4_8103] {
        let others = [identity, 1, 2, 3, 4];
        board.write(others);
        for wish in ["set", "clear", "print"] {
            let (status, printed, why) = board.run(&[wish]);
            assert!(status == 1 && printed.is_empty() && why.contains("not the FPGA of a TS-7800"), "{why}");
        }
        assert_eq!(board.registers(), others);
    }
    fs::remove_file(board.folder.join("mem")).unwrap();
    let (status, _, why) = board.run(&["set"]);
    assert!(status == 1 && why.ends_with("mem: No such file or directory\n"), "{why}");
}

#[test]
fn wrong_arguments_are_refused_with_the_usage() {
    let Some(board) = Board::new("usage") else { return };
    let before = board.registers();
    let wrong: [&[&str]; 4] = [&[], &["on"], &["set", "clear"], &["set", "--force"]];
    for arguments in wrong {
        let (status, _, why) = board.run(arguments);
        assert!(status == 2 && why.starts_with("usage: "), "{arguments:?}: {why}");
    }
    assert_eq!(board.registers(), before);
}
