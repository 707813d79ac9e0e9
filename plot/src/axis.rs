//! Axes: values with a grid line and a number.

/// Numbers of an axis from `from` to `to`, at most `most`: multiples of 1, 2 or 5 times a power of ten.
#[must_use]
pub fn numbers(from: f64, to: f64, most: usize) -> Vec<(f64, String)> {
    let span = to - from;
    if !(span > 0.0 && span.is_finite()) {
        return Vec::new();
    }
    let least = span / most.max(1) as f64;
    let decade = 10.0_f64.powi(least.log10().floor() as i32);
    let step =
        [1.0, 2.0, 5.0, 10.0].map(|factor| factor * decade).into_iter().find(|step| *step >= least * (1.0 - 1e-9));
    let step = step.unwrap_or(10.0 * decade);
    let decimals = usize::try_from(-(step.log10() + 1e-9).floor() as i64).unwrap_or(0).min(12);
    multiples(from, to, step).map(|value| (value, number(value, decimals))).collect()
}

/// Number as shown at an axis.
fn number(value: f64, decimals: usize) -> String {
    let value = value + 0.0;
    let text = if value.abs() >= 1e6 { format!("{value:.0e}") } else { format!("{value:.decimals$}") };
    // An en dash as the sign, which is as wide as a digit.
    text.replacen('-', "–", 1)
}

/// Ticks of a time axis from 0 to `seconds`, at most `most`, and the unit of their numbers.
#[must_use]
pub fn moments(seconds: f64, most: usize) -> (Vec<(f64, String)>, &'static str) {
    const STEPS: [f64; 21] = [
        0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0,
        14_400.0, 43_200.0, 86_400.0, 172_800.0,
    ];
    let least = seconds / most.max(1) as f64;
    let step = STEPS.into_iter().find(|step| *step >= least).unwrap_or(604_800.0);
    let unit = match seconds {
        ..=180.0 => "s",
        ..=10_800.0 => "min:s",
        _ => "h:min",
    };
    let text = |value: f64| match unit {
        "s" => number(value, usize::from(step < 1.0)),
        _ => clock(value, unit),
    };
    (multiples(0.0, seconds, step).map(|value| (value, text(value))).collect(), unit)
}

/// Time after the start as shown in lists: `12.3 s`, `3:07 min`, `1:02:03 h`.
#[must_use]
pub fn moment(seconds: f64) -> String {
    let (whole, negative) = (seconds.abs() as u64, if seconds < -0.05 { "–" } else { "" });
    match whole {
        0..180 => format!("{negative}{:.1} s", seconds.abs()),
        180..3600 => format!("{negative}{}:{:02} min", whole / 60, whole % 60),
        _ => format!("{negative}{}:{:02}:{:02} h", whole / 3600, whole / 60 % 60, whole % 60),
    }
}

fn clock(seconds: f64, unit: &str) -> String {
    let whole = seconds.round() as u64;
    let (large, small) = if unit == "min:s" { (whole / 60, whole % 60) } else { (whole / 3600, whole / 60 % 60) };
    format!("{large}:{small:02}")
}

fn multiples(from: f64, to: f64, step: f64) -> impl Iterator<Item = f64> {
    let (first, last) = ((from / step - 1e-9).ceil(), (to / step + 1e-9).floor());
    let count = if last - first < 1000.0 { (last - first + 1.0).max(0.0) as u32 } else { 0 };
    (0..count).map(move |n| (first + f64::from(n)) * step)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(list: &[(f64, String)]) -> Vec<&str> {
        list.iter().map(|(_, text)| text.as_str()).collect()
    }

    #[test]
    fn axes_have_round_numbers() {
        assert_eq!(texts(&numbers(-0.2, 1.1, 4)), ["0.0", "0.5", "1.0"]);
        assert_eq!(texts(&numbers(-0.5, 0.5, 5)), ["–0.4", "–0.2", "0.0", "0.2", "0.4"]);
        assert_eq!(texts(&numbers(25.91, 25.97, 4)), ["25.92", "25.94", "25.96"]);
        assert_eq!(texts(&numbers(0.0, 40.0, 20)), (0..=20).map(|n| (2 * n).to_string()).collect::<Vec<_>>());
        assert_eq!(texts(&numbers(-1e9, 1e9, 2)), ["–1e9", "0", "1e9"]);
        for (from, to) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert!(numbers(from, to, 5).is_empty());
        }
        // Terminates for numbers so large that adding a step does not change them.
        assert!(numbers(1e15, 1e15 + 1.0, 5).len() < 10);
    }

    #[test]
    fn times_have_readable_units() {
        assert_eq!(moments(64.0, 8).0.last().unwrap(), &(60.0, "60".to_string()));
        let (list, unit) = moments(600.0, 6);
        assert_eq!((texts(&list), unit), (vec!["0:00", "2:00", "4:00", "6:00", "8:00", "10:00"], "min:s"));
        assert_eq!(moments(20_000.0, 6).0[1].1, "1:00");
        assert_eq!(moments(1.0, 5).0[1].1, "0.2");
        assert_eq!([12.34, 187.2, 3723.0].map(moment), ["12.3 s", "3:07 min", "1:02:03 h"]);
        assert!(moments(31.0 * 86_400.0, 10).0.len() <= 10);
    }
}
