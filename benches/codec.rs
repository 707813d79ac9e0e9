//! Encoding and decoding, compared with the code of the official lcm-gen: `cargo bench -p lcm-gen --bench codec`.
//!
//! The message is `advee.range_scan_t`: a number, a string of 12, 16 × (double, double, int8_t), 305 bytes. The C code
//! of lcm-gen comes from the Python package installed by `tools/venv`, is built with `cc -O2`, and runs in a separate
//! process; the rounds of all cases alternate. Goals: 15 ns to encode into an existing buffer, 25 ns to decode with a
//! borrowed string, where C takes 25 and 70.
#![allow(clippy::disallowed_methods, reason = "a bench asks the time and starts its peer")]

#[path = "../foundation/lcm-gen/tests/vectors/generated.rs"]
#[rustfmt::skip]
#[allow(dead_code, reason = "only one of the types is measured")]
mod vectors;

use std::fmt::Write as _;
use std::hint::black_box;
use std::io::{BufRead, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;
use std::{env, fs};

use lcm::codec::{Type, View};
use vectors::advee::{Range, RangeScan, RangeScanRef};

const ROUNDS: usize = 200;
const ROUND: i64 = 20_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scan = RangeScan { utime: 1_321_867_200_123_456, sensor: "HOKUYO_FRONT".into(), ..RangeScan::default() };
    for (i, range) in scan.ranges.iter_mut().enumerate() {
        let i = i as f64;
        *range = Range { distance: 0.25 * i, bearing: -1.5 + 0.2 * i, status: i as i8 - 8 };
    }
    let mut message = Vec::new();
    scan.encode(&mut message)?;

    let mut peer = match Peer::start(&message) {
        Ok(peer) => Some(peer),
        Err(why) => {
            println!("skipped: lcm-gen's C: {why}");
            None
        }
    };
    let mut slice = [0; 512];
    let mut buffer = Vec::new();
    let mut cases: Vec<(&str, Option<char>, Vec<f64>)> = vec![
        ("encode, C", Some('e'), vec![]),
        ("encode_into(&mut [u8])", None, vec![]),
        ("encode(&mut Vec), reused", None, vec![]),
        ("encode with size and malloc, C", Some('m'), vec![]),
        ("encode(&mut Vec), fresh", None, vec![]),
        ("decode and cleanup, C", Some('d'), vec![]),
        ("RangeScanRef::decode, borrowed", None, vec![]),
        ("RangeScan::decode and drop, owned", None, vec![]),
        ("memcpy of the message", None, vec![]),
    ];
    for _ in 0..ROUNDS {
        for (name, letter, figures) in &mut cases {
            let figure = match (letter, &mut peer) {
                (Some(letter), Some(peer)) => peer.round(*letter)?,
                (Some(_), None) => continue,
                (None, _) => match *name {
                    "encode_into(&mut [u8])" => round(|i| {
                        scan.utime = i;
                        let _ = black_box(black_box(&scan).encode_into(black_box(&mut slice)));
                    }),
                    "encode(&mut Vec), reused" => round(|i| {
                        scan.utime = i;
                        buffer.clear();
                        let _ = black_box(black_box(&scan).encode(black_box(&mut buffer)));
                    }),
                    "encode(&mut Vec), fresh" => round(|i| {
                        scan.utime = i;
                        let mut fresh = Vec::new();
                        let _ = black_box(black_box(&scan).encode(&mut fresh));
                        black_box(&fresh);
                    }),
                    "RangeScanRef::decode, borrowed" => round(|_| {
                        black_box(&RangeScanRef::decode(black_box(&message)));
                    }),
                    "RangeScan::decode and drop, owned" => round(|_| {
                        black_box(&RangeScan::decode(black_box(&message)));
                    }),
                    _ => round(|_| {
                        slice[..message.len()].copy_from_slice(black_box(&message));
                        black_box(&mut slice);
                    }),
                },
            };
            figures.push(figure);
        }
    }
    report(&mut cases);
    Ok(())
}

/// Nanoseconds per call.
fn round(mut call: impl FnMut(i64)) -> f64 {
    let begin = Instant::now();
    (0..ROUND).for_each(&mut call);
    begin.elapsed().as_nanos() as f64 / ROUND as f64
}

fn report(cases: &mut [(&str, Option<char>, Vec<f64>)]) {
    println!("advee.range_scan_t, 305 bytes; ns, {ROUNDS} alternating rounds of {ROUND}");
    println!("{:36} {:>6} {:>6} {:>8}", "", "best", "median", "best / C");
    let mut of_c = None;
    for (name, letter, figures) in cases.iter_mut().filter(|(_, _, figures)| !figures.is_empty()) {
        figures.sort_by(f64::total_cmp);
        let (best, median) = (figures[0], figures[figures.len() / 2]);
        let ratio = match (letter, of_c, *name) {
            (Some(_), ..) => {
                of_c = Some(best);
                String::new()
            }
            (None, Some(c), name) if !name.starts_with("memcpy") => format!("{:.2}", best / c),
            _ => String::new(),
        };
        println!("{name:36} {best:6.1} {median:6.1} {ratio:>8}");
    }
}

/// Process that runs lcm-gen's code.
struct Peer {
    child: Child,
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
}

impl Peer {
    /// Generates, builds and starts it; its message must equal `ours`.
    fn start(ours: &[u8]) -> Result<Self, String> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let python = env::var_os("ADVEE_PYTHON").map_or_else(|| root.join(".venv/bin/python"), PathBuf::from);
        let package = run(Command::new(&python).args(["-c", "import lcm; print(lcm.__path__[0])"]))?;
        let official = Path::new(package.trim()).parent().unwrap_or(Path::new("/")).to_owned();
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("codec");
        fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let types = root.join("foundation/lcm-gen/tests/vectors/types/range_scan_t.lcm");
        run(Command::new(official.join("bin/lcm-gen"))
            .args(["-c", "--c-no-pubsub", "--c-cpath"])
            .arg(&folder)
            .arg("--c-hpath")
            .args([&folder, &types]))?;
        let program = folder.join("peer");
        run(Command::new("cc")
            .args(["-O2", "-I"])
            .arg(official.join("include"))
            .arg("-I")
            .arg(&folder)
            .arg(root.join("benches/codec/peer.c"))
            .args(["advee_range_scan_t.c", "advee_range_t.c"].map(|file| folder.join(file)))
            .arg("-o")
            .arg(&program))?;
        let started = Command::new(&program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut child = started.map_err(|error| format!("{}: {error}", program.display()))?;
        let (to, from) = (child.stdin.take(), child.stdout.take().ok_or("it has no output")?);
        let mut peer = Self { child, to, from: BufReader::new(from) };
        let hex = ours.iter().fold(String::new(), |mut hex, byte| {
            let _ = write!(hex, "{byte:02x}");
            hex
        });
        let theirs = peer.line().map_err(|error| error.to_string())?;
        if theirs == hex { Ok(peer) } else { Err(format!("its message differs: {theirs} and ours {hex}")) }
    }

    fn round(&mut self, letter: char) -> Result<f64, Box<dyn std::error::Error>> {
        self.to.as_mut().ok_or("the peer is gone")?.write_all(&[letter as u8])?;
        Ok(self.line()?.parse()?)
    }

    fn line(&mut self) -> std::io::Result<String> {
        let mut line = String::new();
        self.from.read_line(&mut line)?;
        Ok(line.trim().to_owned())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.to = None; // the process ends with its input
        let _ = self.child.wait();
    }
}

/// Output of the command; its error output if it fails.
fn run(command: &mut Command) -> Result<String, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| format!("{program}: {error}"))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    Err(format!("{program}: {}", String::from_utf8_lossy(&output.stderr).trim()))
}
