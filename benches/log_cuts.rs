//! Loss when the logger is killed: `cargo bench -p advee --bench log_cuts [-- KILLS]`.
//!
//! A logger records a publisher at 500 Hz, and is killed at a random instant, 2 000 times. Each file is read as it was
//! left; then the next start restores the index of all of them. Goal: at most 250 ms and one synchronization lost,
//! every file readable.

#[path = "../advee/tests/support/log.rs"]
mod log;
#[path = "../advee/tests/support.rs"]
mod support;

use log::Rig;
use std::collections::BTreeSet;
use std::fs;
use std::thread;
use std::time::Duration;

const KILLS: usize = 2000;
/// Number of loggers at a time.
const SIDES: usize = 4;

fn main() {
    let asked = std::env::args().skip(1).find_map(|arg| arg.parse::<usize>().ok());
    let each = asked.unwrap_or(KILLS).div_ceil(SIDES);
    let sides: Vec<_> = (0..SIDES).map(|side| thread::spawn(move || campaign(side as u64, each))).collect();
    let (mut lost, mut bad) = (Vec::new(), 0);
    for side in sides {
        let (its, refused) = side.join().expect("no file is refused");
        lost.extend(its);
        bad += refused;
    }
    lost.sort_unstable();
    let share = |part: f64| lost[((lost.len() - 1) as f64 * part) as usize];
    println!(
        "{} kills: lost before the kill, ms: median {}, 99 % {}, worst {}",
        lost.len(),
        share(0.5),
        share(0.99),
        share(1.0)
    );
    println!("files without an index after the next start: {bad}");
}

/// Losses of `kills` kills, and number of files without an index in the end.
fn campaign(side: u64, kills: usize) -> (Vec<u64>, usize) {
    let mut rig = Rig::new();
    let mut random = 0x9E37_79B9_7F4A_7C15 ^ (side + 1).wrapping_mul(0xD1B5_4A32_D192_ED03);
    let mut lost = Vec::new();
    let mut known = BTreeSet::new();
    let mut bad = 0;
    for kill in 0..kills {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        lost.push(log::cut(&mut rig, Duration::from_micros(100_000 + random % 700_000)));
        // From time to time the repaired files are checked and removed.
        if kill % 50 == 49 || kill + 1 == kills {
            let logger = rig.start(&[]);
            thread::sleep(Duration::from_secs(2));
            assert_eq!(logger.stop(), 0);
            let files = rig.files();
            let unmended = |file: &&std::path::PathBuf| {
                let bytes = fs::read(file).unwrap_or_default();
                !bytes.is_empty() && !matches!(mcap::Summary::read(&bytes), Ok(Some(_)))
            };
            bad += files.iter().filter(unmended).filter(|file| known.insert((*file).clone())).count();
            files.iter().filter_map(|file| file.parent()).for_each(|run| drop(fs::remove_dir_all(run)));
        }
    }
    (lost, bad)
}
