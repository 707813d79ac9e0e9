//! Folders as the kernel fills them, and as no kernel does.

use super::read::Reader;
use super::*;
use base::thermal::Throttle;

/// A folder for a test, removed at its end.
struct Sys(PathBuf);

impl Sys {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("advee-thermal-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        Self(folder)
    }

    fn file(&self, path: &str, text: impl AsRef<[u8]>) {
        let path = self.0.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
}

impl Drop for Sys {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn all(state: &State) -> Vec<(&str, i32)> {
    state.readings().iter().map(|reading| (reading.zone.as_str(), reading.millidegrees)).collect()
}

#[test]
fn zones_and_monitors_are_read_by_name_in_order_of_their_numbers() {
    let sys = Sys::new("names");
    for (n, kind, value) in [(0, "acpitz", "27800"), (10, "x86_pkg_temp", "45000"), (2, "acpitz", "29800")] {
        sys.file(&format!("class/thermal/thermal_zone{n}/type"), format!("{kind}\n"));
        sys.file(&format!("class/thermal/thermal_zone{n}/temp"), format!("{value}\n"));
    }
    sys.file("class/thermal/cooling_device0/type", "Fan\n");
    sys.file("class/hwmon/hwmon1/name", "coretemp\n");
    sys.file("class/hwmon/hwmon1/temp2_input", "44000\n");
    sys.file("class/hwmon/hwmon1/temp2_label", "Core 0\n");
    sys.file("class/hwmon/hwmon1/temp3_input", "-5000\n");
    sys.file("class/hwmon/hwmon1/temp2_max", "84000\n");
    let state = Reader::new(sys.0.clone()).read();
    let expected = [
        ("acpitz", 27_800),
        ("acpitz.2", 29_800),
        ("x86_pkg_temp", 45_000),
        ("coretemp/Core 0", 44_000),
        ("coretemp/temp3", -5000),
    ];
    assert_eq!(all(&state), expected);
    assert_eq!(state.throttle, None);
    assert_eq!(Reader::new("/nowhere".into()).read(), State::default());
}

#[test]
fn nonsense_is_left_out() {
    let sys = Sys::new("nonsense");
    let values: [&[u8]; 6] = [b"", b"hot", b"4500000000000", b"900000", b"\xFF\xFE", b"45 000"];
    for (n, value) in values.into_iter().enumerate() {
        sys.file(&format!("class/thermal/thermal_zone{n}/type"), "cpu");
        sys.file(&format!("class/thermal/thermal_zone{n}/temp"), value);
    }
    sys.file("class/thermal/thermal_zone9/type", "a\nb");
    sys.file("class/thermal/thermal_zone9/temp", "1000");
    sys.file("class/thermal/thermal_zone/type", "c");
    sys.file("devices/platform/soc/soc:firmware/get_throttled", "no number");
    assert_eq!(Reader::new(sys.0.clone()).read(), State::default());
}

#[test]
fn throttling_is_what_applies_now() {
    let sys = Sys::new("throttle");
    let mut reader = Reader::new(sys.0.clone());
    let count = |n: u64| sys.file("devices/system/cpu/cpu1/thermal_throttle/package_throttle_count", format!("{n}\n"));
    let told = |slowed, under_voltage| Some(Throttle { slowed, under_voltage });
    count(7);
    assert_eq!(reader.read().throttle, told(false, false), "before the first reading");
    count(9);
    assert_eq!(reader.read().throttle, told(true, false));
    assert_eq!(reader.read().throttle, told(false, false));
    for (bits, expected) in [("0", told(false, false)), ("50005", told(true, true)), ("50000", told(false, false))] {
        sys.file("devices/platform/soc/soc:firmware/get_throttled", format!("{bits}\n"));
        assert_eq!(reader.read().throttle, expected, "{bits}");
    }
}

#[test]
fn what_the_simulator_writes_is_what_is_read() {
    let sys = Sys::new("folder");
    let mut state = State::default();
    assert!(state.push("cpu-thermal", 51_250) && state.push("gpu-thermal", -1000));
    state.throttle = Some(Throttle { slowed: true, under_voltage: false });
    let folder = Folder(sys.0.clone());
    let mut write = folder.work();
    assert_eq!(write(state.clone()), Ok(state.clone()));
    assert_eq!(Reader::new(sys.0.clone()).read(), state);
    drop(write);
    assert!(!sys.0.exists());
}
