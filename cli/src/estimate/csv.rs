//! The three files. What is wrong names file and line.

use super::super::Failed;
use estimator::filter::{Beacon, ROTATION_MAX, SPEED_MAX};
use estimator::recorded::Recording;
use navitools::{Motion, Point};
use std::fs;
use std::path::Path;

/// A bearing may be out of order by as much as the filter bears, s.
const DISORDER: f64 = 2.0;

/// Greatest coordinate of a beacon, m; those of a national grid are below.
const COORDINATE_MAX: f64 = 1e7;
/// Maximum number of unknown beacons that a warning names.
const NAMED_MAX: usize = 8;

/// Recorded data.
#[derive(Debug)]
pub struct Data {
    pub recording: Recording,
    pub beacons: Vec<Beacon>,
}

impl Data {
    pub fn read(odometry: &Path, bearings: &Path, beacons: &Path) -> Result<Self, Failed> {
        let mut data = Self { recording: Recording::default(), beacons: Vec::new() };
        rows(odometry, ["time", "speed", "rotation"], |[time, translation, rotation]| {
            if data.recording.odometry.last().is_some_and(|(last, _)| time <= *last) {
                return Err(format!("time {time} is not after that of the row before"));
            }
            if translation.abs() > SPEED_MAX || rotation.abs() > ROTATION_MAX {
                return Err(format!(
                    "{translation} m/s, {rotation} rad/s: beyond {SPEED_MAX} m/s or {ROTATION_MAX} rad/s"
                ));
            }
            data.recording.odometry.push((time, Motion { translation, rotation }));
            Ok(())
        })?;
        if data.recording.odometry.is_empty() {
            return Err(format!("{}: no odometry", odometry.display()).into());
        }
        let mut newest = f64::NEG_INFINITY;
        rows(bearings, ["time", "id", "bearing"], |[time, id, bearing]| {
            if time < newest - DISORDER {
                return Err(format!("time {time} is more than {DISORDER} s before that of a row before"));
            }
            newest = newest.max(time);
            data.recording.bearings.push((time, number(id)?, bearing));
            Ok(())
        })?;
        if data.recording.bearings.is_empty() {
            return Err(format!("{}: no bearings", bearings.display()).into());
        }
        data.recording.bearings.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows(beacons, ["id", "x", "y"], |[id, x, y]| {
            let id = number(id)?;
            if data.beacons.iter().any(|beacon| beacon.id == id) {
                return Err(format!("beacon {id} is there twice"));
            }
            if x.abs() > COORDINATE_MAX || y.abs() > COORDINATE_MAX {
                return Err(format!("beacon {id} at {x}, {y}: beyond {COORDINATE_MAX} m"));
            }
            data.beacons.push(Beacon { id, at: Point { x, y } });
            Ok(())
        })?;
        if data.beacons.is_empty() {
            return Err(format!("{}: no beacons", beacons.display()).into());
        }
        Ok(data)
    }

    /// Warns of bearings of beacons that are not on the map.
    ///
    /// # Errors
    /// All bearings are.
    pub fn unknown_beacons(&self, bearings: &Path, beacons: &Path) -> Result<(), Failed> {
        let mut ids: Vec<i32> = Vec::new();
        let mut count = 0;
        for (_, id, _) in &self.recording.bearings {
            if !self.beacons.iter().any(|beacon| beacon.id == *id) {
                count += 1;
                if let Err(place) = ids.binary_search(id) {
                    ids.insert(place, *id);
                }
            }
        }
        if count == 0 {
            return Ok(());
        }
        let names: Vec<String> = ids.iter().take(NAMED_MAX).map(ToString::to_string).collect();
        let more = if ids.len() > NAMED_MAX { ", …" } else { "" };
        let what = format!("of beacons that are not on the map {}: {}{more}", beacons.display(), names.join(", "));
        if count == self.recording.bearings.len() {
            return Err(format!("{}: all bearings are {what}", bearings.display()).into());
        }
        eprintln!("{}: ignores {count} bearings {what}", bearings.display());
        Ok(())
    }
}

/// The number of a beacon.
fn number(id: f64) -> Result<i32, String> {
    let whole = id.fract() == 0.0 && id.abs() <= f64::from(i32::MAX);
    if whole { Ok(id as i32) } else { Err(format!("{id} is no beacon's number")) }
}

/// Reads rows of three numbers; a heading may give the order of the columns.
fn rows(path: &Path, columns: [&str; 3], mut take: impl FnMut([f64; 3]) -> Result<(), String>) -> Result<(), Failed> {
    let text = fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut places = [0, 1, 2];
    let mut first = true;
    for (line, row) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
        let row = row.trim();
        if row.is_empty() || row.starts_with('#') {
            continue;
        }
        let refuse = |why: String| Failed::from(format!("{}:{line}: {why}", path.display()));
        let fields: Vec<&str> = row.split(',').map(|field| field.trim().trim_matches('"')).collect();
        if std::mem::take(&mut first) && fields[0].parse::<f64>().is_err() {
            for (place, name) in places.iter_mut().zip(columns) {
                let found = fields.iter().position(|field| field.eq_ignore_ascii_case(name));
                *place = found.ok_or_else(|| refuse(format!("no column {name}; expected {}", columns.join(","))))?;
            }
            continue;
        }
        let mut numbers = [0.0; 3];
        for ((value, place), name) in numbers.iter_mut().zip(places).zip(columns) {
            let field = fields.get(place).ok_or_else(|| refuse(format!("{name} is missing")))?;
            let number = field.parse::<f64>().ok().filter(|number| number.is_finite() && number.abs() < 1e15);
            *value = number.ok_or_else(|| refuse(format!("{name} = {field:?}: expected a number")))?;
        }
        take(numbers).map_err(refuse)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(texts: [&str; 3]) -> Result<Data, String> {
        let folder = std::env::temp_dir().join(format!("advee-csv-{}-{:p}", std::process::id(), texts[0]));
        fs::create_dir_all(&folder).unwrap();
        let paths = ["odo.csv", "bearings.csv", "map.csv"].map(|name| folder.join(name));
        for (path, text) in paths.iter().zip(texts) {
            fs::write(path, text).unwrap();
        }
        let data = Data::read(&paths[0], &paths[1], &paths[2]).map_err(|failed| failed.why);
        fs::remove_dir_all(&folder).unwrap();
        data
    }

    #[test]
    fn columns_go_by_their_heading_or_their_place() {
        let data = read([
            "speed, time, rotation, more\n0.5,1,0.1,7\n# a comment\n\n0.6,2,0.2,7\n",
            "2,3,0.5\n1.5,4,-0.5\n",
            "id,x,y\r\n3,1,2\r\n4,-1,0\r\n",
        ]);
        let data = data.unwrap();
        assert_eq!(data.recording.odometry[1], (2.0, Motion { translation: 0.6, rotation: 0.2 }));
        assert_eq!(data.recording.bearings, [(1.5, 4, -0.5), (2.0, 3, 0.5)]);
        assert_eq!(data.beacons[1], Beacon { id: 4, at: Point { x: -1.0, y: 0.0 } });
    }

    #[test]
    fn bearings_of_unknown_beacons_alone_are_refused() {
        let data = |bearings| read(["1,0,0\n", bearings, "1,0,0\n2,5,0\n"]).unwrap();
        let judge = |bearings| data(bearings).unknown_beacons(Path::new("b.csv"), Path::new("m.csv"));
        assert!(judge("1,1,0\n2,2,0\n").is_ok() && judge("1,1,0\n2,7,0\n").is_ok());
        let why = judge("1,9,0\n2,7,0\n3,9,0\n").unwrap_err().why;
        assert_eq!(why, "b.csv: all bearings are of beacons that are not on the map m.csv: 7, 9");
    }

    #[test]
    fn what_is_wrong_names_file_and_line() {
        let good = ["time,speed,rotation\n1,0,0\n2,0,0\n", "time,id,bearing\n1,1,0\n", "id,x,y\n1,0,0\n"];
        let wrong = |place: usize, text, expected: &str| {
            let mut texts = good;
            texts[place] = text;
            let why = read(texts).unwrap_err();
            assert!(why.ends_with(expected), "{why}");
        };
        wrong(0, "time,speed,rotation\n1,0,0\n1,0,0\n", "odo.csv:3: time 1 is not after that of the row before");
        wrong(0, "time,speed,rotation\n1,0,nan\n", "odo.csv:2: rotation = \"nan\": expected a number");
        wrong(0, "time,speed\n1,0\n", "odo.csv:1: no column rotation; expected time,speed,rotation");
        wrong(0, "", "odo.csv: no odometry");
        wrong(0, "1,0,0\n2,1e14,0\n", "odo.csv:2: 100000000000000 m/s, 0 rad/s: beyond 10 m/s or 20 rad/s");
        wrong(1, "time,id,bearing\n", "bearings.csv: no bearings");
        wrong(2, "id,x,y\n", "map.csv: no beacons");
        wrong(2, "1,0,0\n2,1e14,0\n", "map.csv:2: beacon 2 at 100000000000000, 0: beyond 10000000 m");
        wrong(1, "5,1,0\n2.9,1,0\n", "bearings.csv:2: time 2.9 is more than 2 s before that of a row before");
        wrong(1, "5,1.5,0\n", "bearings.csv:1: 1.5 is no beacon's number");
        wrong(1, "5,1\n", "bearings.csv:1: bearing is missing");
        wrong(2, "1,0,0\n1,2,2\n", "map.csv:2: beacon 1 is there twice");
    }
}
