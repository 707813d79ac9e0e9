//! Names of runs and of their files.

/// Last second whose year has four digits: 9999-12-31 23:59:59.
const LAST: u64 = 253_402_300_799;

/// Name of a run that begins in this second since the UNIX epoch: `YYYY_MM_DD_HH_MM_SS`, in UTC.
pub fn run(second: u64) -> String {
    let second = second.min(LAST);
    let (days, time) = (second / 86_400, second % 86_400);
    // Calendar with years that begin in March, so that the leap day comes last; eras of 400 years repeat.
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let march = (5 * day + 2) / 153;
    let (day, month) = (day - (153 * march + 2) / 5 + 1, if march < 10 { march + 3 } else { march - 9 });
    let year = era * 400 + year + u64::from(month <= 2);
    let (hour, minute, second) = (time / 3600, time / 60 % 60, time % 60);
    format!("{year:04}_{month:02}_{day:02}_{hour:02}_{minute:02}_{second:02}")
}

/// Name of a run that is not taken yet, with `_2`, `_3`, … if necessary.
pub fn free_run(second: u64, taken: impl Fn(&str) -> bool) -> String {
    let name = run(second);
    if !taken(&name) {
        return name;
    }
    let mut further = (2_u64..).map(|number| format!("{name}_{number}"));
    // There is always a free number.
    further.find(|name| !taken(name)).unwrap_or(name)
}

/// Order of a run among others: its second and its number within it; `None` if the name is not that of a run.
pub fn place(name: &str) -> Option<(&str, u64)> {
    let (second, behind) = name.split_at_checked(19)?;
    let pattern = |(place, byte): (usize, u8)| match place {
        4 | 7 | 10 | 13 | 16 => byte == b'_',
        _ => byte.is_ascii_digit(),
    };
    if !second.bytes().enumerate().all(pattern) {
        return None;
    }
    match behind.strip_prefix('_') {
        Some(number) if number.len() < 10 && number.bytes().all(|byte| byte.is_ascii_digit()) => {
            Some((second, number.parse().ok()?))
        }
        None if behind.is_empty() => Some((second, 1)),
        _ => None,
    }
}

/// File of a run with this number.
pub fn file(run: &str, number: u32) -> String {
    format!("{run}/log_{number:03}.mcap")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_named_by_its_second() {
        for (second, name) in [
            (0, "1970_01_01_00_00_00"),
            (951_782_399, "2000_02_28_23_59_59"),
            (951_782_400, "2000_02_29_00_00_00"),
            (951_868_800, "2000_03_01_00_00_00"),
            (1_767_225_599, "2025_12_31_23_59_59"),
            (1_767_225_600, "2026_01_01_00_00_00"),
            (4_107_542_400, "2100_03_01_00_00_00"),
            (LAST, "9999_12_31_23_59_59"),
            (u64::MAX, "9999_12_31_23_59_59"),
        ] {
            assert_eq!(run(second), name);
        }
    }

    #[test]
    fn two_runs_of_one_second_have_two_names() {
        let taken = ["1970_01_01_00_00_00", "1970_01_01_00_00_00_2"];
        assert_eq!(free_run(0, |name| taken.contains(&name)), "1970_01_01_00_00_00_3");
        assert_eq!(free_run(1, |name| taken.contains(&name)), "1970_01_01_00_00_01");
    }

    #[test]
    fn runs_are_distinguished_from_other_entries_and_ordered() {
        let mut names = ["2026_11_22_09_24_06_10", "2026_11_22_09_24_06", "2026_11_22_09_24_06_2"];
        names.sort_by_key(|name| place(name));
        assert_eq!(names, ["2026_11_22_09_24_06", "2026_11_22_09_24_06_2", "2026_11_22_09_24_06_10"]);
        for name in
            ["", "photos", "2026_11_22_09_24", "2026_11_22_09_24_06x", "2026_11_22_09_24_06_", "2026-11-22_09_24_06"]
        {
            assert_eq!(place(name), None, "{name}");
        }
        assert_eq!(place("2026_11_22_09_24_06_99999999999999999999"), None);
        assert_eq!(place("2026_11_22_09_24_0ä"), None);
    }
}
