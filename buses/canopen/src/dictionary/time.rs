//! TIME_OF_DAY and TIME_DIFFERENCE as text.

use super::data_type::magnitude;
use crate::Payload;
use crate::wire::TimeOfDay;
use alloc::string::String;
use core::fmt::Write;

const DAY_MS: u32 = 86_400_000;

/// Both types: 28 bits of milliseconds, 4 reserved, 16 bits of days.
pub(super) fn show(out: &mut String, raw: i64, of_day: bool) -> core::fmt::Result {
    let (millis, days) = ((raw & 0x0FFF_FFFF) as u32, (raw >> 32 & 0xFFFF) as u32);
    if of_day {
        let (year, month, day) = date(days);
        write!(out, "{year:04}-{month:02}-{day:02} ")?;
    } else {
        write!(out, "{days}d ")?;
    }
    let (seconds, millis) = (millis / 1000, millis % 1000);
    write!(out, "{:02}:{:02}:{:02}.{millis:03}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

pub(super) fn parse(text: &str, of_day: bool) -> Option<Payload> {
    let (days, clock) = text.split_once([' ', 'T'])?;
    let number = |text: &str| magnitude(text, 10).and_then(|value| u32::try_from(value).ok());
    let days = if of_day {
        let mut parts = days.splitn(3, '-').map(number);
        let (year, month, day) = (parts.next()??, parts.next()??, parts.next()??);
        // 65536 days: the search is short, and knows the calendar in one direction only.
        let guess = year.checked_sub(1984)?.checked_mul(365)?;
        (guess..guess.saturating_add(500)).find(|days| date(*days) == (year, month, day))?
    } else {
        number(days.strip_suffix('d')?)?
    };
    let days = u16::try_from(days).ok()?;
    let mut parts = clock.trim().splitn(3, ':');
    let (hours, minutes, seconds) = (number(parts.next()?)?, number(parts.next()?)?, parts.next()?);
    let (seconds, millis) = seconds.split_once('.').unwrap_or((seconds, "0"));
    let scale = [100, 10, 1].get(millis.len().checked_sub(1)?)?;
    let (seconds, millis) = (number(seconds)?, number(millis)? * scale);
    let valid = hours < 24 && minutes < 60 && seconds < 60;
    let millis = (hours.min(24) * 3600 + minutes.min(60) * 60 + seconds.min(60)) * 1000 + millis;
    let time = TimeOfDay { millis: millis % DAY_MS, days };
    valid.then(|| time.encode().as_slice().into())
}

/// Year, month and day, `days` after 1984-01-01.
fn date(days: u32) -> (u32, u32, u32) {
    let leap = |year: u32| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let (mut year, mut rest) = (1984, days);
    loop {
        let length = 365 + u32::from(leap(year));
        if rest < length {
            break;
        }
        (year, rest) = (year + 1, rest - length);
    }
    let lengths = [31, 28 + u32::from(leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while rest >= lengths[month] {
        rest -= lengths[month];
        month += 1;
    }
    (year, month as u32 + 1, rest + 1)
}
