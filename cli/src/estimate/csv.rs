//! The three files. What is wrong names file and line.

use super::super::Failed;
use estimator::filter::Beacon;
use navitools::{Motion, Point};
use std::fs;
use std::path::Path;

/// A bearing may be out of order by as much as the filter bears, s.
const DISORDER: f64 = 2.0;

/// Recorded data.
#[derive(Debug)]
pub struct Data {
    /// In order of time, s.
    pub odometry: Vec<(f64, Motion)>,
    /// In order of time, s.
    pub bearings: Vec<(f64, i32, f64)>,
    pub beacons: Vec<Beacon>,
}

impl Data {
    pub fn read(odometry: &Path, bearings: &Path, beacons: &Path) -> Result<Self, Failed> {
        let mut data = Self { odometry: Vec::new(), bearings: Vec::new(), beacons: Vec::new() };
        rows(odometry, ["time", "speed", "rotation"], |[time, translation, rotation]| {
            if data.odometry.last().is_some_and(|(last, _)| time <= *last) {
                return Err(format!("time {time} is not after that of the row before"));
            }
            data.odometry.push((time, Motion { translation, rotation }));
            Ok(())
        })?;
        if data.odometry.is_empty() {
            return Err(format!("{}: no odometry", odometry.display()).into());
        }
        let mut newest = f64::NEG_INFINITY;
        rows(bearings, ["time", "id", "bearing"], |[time, id, bearing]| {
            if time < newest - DISORDER {
                return Err(format!("time {time} is more than {DISORDER} s before that of a row before"));
            }
            newest = newest.max(time);
            data.bearings.push((time, number(id)?, bearing));
            Ok(())
        })?;
        data.bearings.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows(beacons, ["id", "x", "y"], |[id, x, y]| {
            let id = number(id)?;
            if data.beacons.iter().any(|beacon| beacon.id == id) {
                return Err(format!("beacon {id} is there twice"));
            }
            data.beacons.push(Beacon { id, at: Point { x, y } });
            Ok(())
        })?;
        Ok(data)
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
        assert_eq!(data.odometry[1], (2.0, Motion { translation: 0.6, rotation: 0.2 }));
        assert_eq!(data.bearings, [(1.5, 4, -0.5), (2.0, 3, 0.5)]);
        assert_eq!(data.beacons[1], Beacon { id: 4, at: Point { x: -1.0, y: 0.0 } });
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
        wrong(1, "5,1,0\n2.9,1,0\n", "bearings.csv:2: time 2.9 is more than 2 s before that of a row before");
        wrong(1, "5,1.5,0\n", "bearings.csv:1: 1.5 is no beacon's number");
        wrong(1, "5,1\n", "bearings.csv:1: bearing is missing");
        wrong(2, "1,0,0\n1,2,2\n", "map.csv:2: beacon 1 is there twice");
    }
}
