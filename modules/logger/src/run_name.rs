//! Names of the folders of runs.

/// Name of a second since the UNIX epoch.
#[must_use]
pub fn run_name(second: u64) -> String {
    let (mut days, time) = (second / 86_400, second % 86_400);
    let leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let mut year = 1970;
    while days >= 365 + u64::from(leap(year)) {
        days -= 365 + u64::from(leap(year));
        year += 1;
    }
    let lengths = [31, 28 + u64::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while days >= lengths[month] {
        days -= lengths[month];
        month += 1;
    }
    let (hour, minute, second) = (time / 3600, time / 60 % 60, time % 60);
    format!("{year:04}_{:02}_{:02}_{hour:02}_{minute:02}_{second:02}", month + 1, days + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_named_by_its_second() {
        assert_eq!(run_name(0), "1970_01_01_00_00_00");
        assert_eq!(run_name(951_782_399), "2000_02_28_23_59_59");
        assert_eq!(run_name(951_782_400), "2000_02_29_00_00_00");
        assert_eq!(run_name(1_767_225_599), "2025_12_31_23_59_59");
        assert_eq!(run_name(4_107_542_400), "2100_03_01_00_00_00");
    }
}
