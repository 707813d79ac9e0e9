//! What is measured, over made-up times; and the loop itself, live.

use super::bus::Gaps;
use super::histogram::Histogram;
use super::metronome::{Metronome, Plan};
use super::report::{Report, Row};
use base::{Duration, Instant};
use module::{Action, Actions, Event, Module, State};

fn histogram(limit: usize, times: &[u64]) -> Histogram {
    let mut histogram = Histogram::new(limit);
    times.iter().for_each(|us| histogram.add(*us));
    histogram
}

#[test]
fn a_histogram_knows_what_a_sorted_list_would() {
    let mut times: Vec<u64> = (0..2000_u64).map(|n| n * 7919 % 997).collect();
    let histogram = histogram(1000, &times);
    times.sort_unstable();
    assert_eq!((histogram.count(), histogram.min(), histogram.max()), (2000, times[0], times[1999]));
    assert!((histogram.mean() - times.iter().sum::<u64>() as f64 / 2000.0).abs() < 1e-9);
    for (of, all) in [(1_u64, 2), (99, 100), (999, 1000), (1, 1)] {
        let place = (2000 * of).div_ceil(all) as usize;
        assert_eq!(histogram.quantile(of, all), times[place - 1], "{of}/{all}");
    }
}

#[test]
fn what_lies_beyond_the_limit_counts_as_the_largest() {
    let histogram = histogram(100, &[5, 99, 100, 7_000_000]);
    assert_eq!((histogram.count(), histogram.max()), (4, 7_000_000));
    assert_eq!((histogram.quantile(1, 2), histogram.quantile(3, 4)), (99, 7_000_000));
    assert_eq!(histogram.filled().collect::<Vec<_>>(), [(5, 1), (99, 1)]);
    let huge = self::histogram(10, &[u64::MAX, u64::MAX]);
    assert_eq!((huge.max(), huge.quantile(1, 2)), (u64::MAX, u64::MAX));
}

#[test]
fn an_empty_histogram_is_all_zeros() {
    let empty = Histogram::new(10);
    assert_eq!((empty.count(), empty.min(), empty.max(), empty.quantile(99, 100)), (0, 0, 0, 0));
    assert!(empty.mean().abs() < f64::EPSILON);
}

#[test]
fn deviations_count_either_way() {
    let around = histogram(1000, &[500, 497, 500, 502, 1500]).around(500);
    assert_eq!(around.filled().collect::<Vec<_>>(), [(0, 2), (2, 1), (3, 1)]);
    assert_eq!((around.count(), around.max()), (5, 1000));
}

const US: Duration = Duration::from_micros(1);

/// A metronome that is woken so many µs after each moment that it asks for; what it measured, and whether it ended.
fn woken(plan: Plan, late: &[u32]) -> (super::metronome::Measured, bool) {
    let (mut module, measured) = Metronome::new(plan);
    let mut out = Actions::default();
    module.handle(Instant::from_millis(10), Event::Start, &mut out);
    for late in late {
        let Some(due) = module.poll_timeout() else { break };
        module.handle(due + *late * US, Event::Timer, &mut out);
    }
    let ended = out.as_slice().iter().any(|action| matches!(action, Action::Exit(0)));
    let measured = measured.borrow().clone();
    (measured, ended)
}

#[test]
fn lateness_is_counted_from_the_moment_asked_for_and_lost_periods_are_missed() {
    let plan = Plan { interval: 1000 * US, priority: None, time: None };
    let (measured, ended) = woken(plan, &[0, 30, 999, 1000, 3500, 20]);
    assert_eq!(measured.late.filled().map(|(us, _)| us).collect::<Vec<_>>(), [0, 20, 30, 999, 1000, 3500]);
    assert_eq!((measured.missed, ended), (1 + 3, false));
}

#[test]
fn a_metronome_ends_by_its_time_and_when_it_is_told_to() {
    let plan = Plan { interval: 1000 * US, priority: None, time: Some(10_000 * US) };
    let (measured, ended) = woken(plan, &[5; 100]);
    assert_eq!((measured.late.count(), ended), (11, true));
    let (mut module, _) = Metronome::new(plan);
    let mut out = Actions::default();
    module.handle(Instant::ZERO, Event::Start, &mut out);
    module.handle(Instant::ZERO, Event::State(State::Terminate), &mut out);
    assert_eq!(module.poll_timeout(), None);
}

#[test]
fn an_early_timer_counts_for_nothing() {
    let plan = Plan { interval: 1000 * US, priority: None, time: None };
    let (mut module, measured) = Metronome::new(plan);
    let mut out = Actions::default();
    module.handle(Instant::ZERO, Event::Start, &mut out);
    let due = module.poll_timeout().unwrap();
    module.handle(due - US, Event::Timer, &mut out);
    assert_eq!((measured.borrow().late.count(), module.poll_timeout()), (0, Some(due)));
}

/// Frames each 50 ms and so many µs.
fn frames(gaps: &mut Gaps, id: u16, off: &[i64]) {
    for (n, off) in (1..).zip(off) {
        gaps.frame(id, ((n * 50_000 + off) * 1000) as u64);
    }
}

#[test]
fn frames_are_compared_with_their_median_period_each_identifier_by_itself() {
    let mut gaps = Gaps::new(&[]);
    frames(&mut gaps, 0x77F, &[0, 0, 40, 0, 0, 0]);
    frames(&mut gaps, 0x080, &[0, 7]);
    frames(&mut gaps, 0x181, &[0, 0, 0]);
    let rows = gaps.rows();
    let told: Vec<_> = rows.iter().map(|row| (&*row.name, row.period_us, row.times.count(), row.times.max())).collect();
    assert_eq!(told, [("0x080 SYNC", Some(50_007), 1, 0), ("0x77f heartbeat 127", Some(50_000), 5, 40)]);
    assert_eq!(rows[1].counts, [("longest gap us", 50_040)]);
}

#[test]
fn wanted_identifiers_alone_are_looked_at() {
    let mut gaps = Gaps::new(&[0x181]);
    frames(&mut gaps, 0x181, &[0, 0]);
    frames(&mut gaps, 0x080, &[0, 0]);
    assert_eq!(gaps.rows().len(), 1);
    assert_eq!(gaps.rows()[0].name, "0x181");
}

#[test]
fn a_gap_over_lost_frames_or_a_stepped_clock_is_none() {
    let mut gaps = Gaps::new(&[]);
    frames(&mut gaps, 0x080, &[0, 0, 0]);
    gaps.lost();
    gaps.frame(0x080, 900_000_000);
    gaps.frame(0x080, 400_000_000);
    gaps.frame(0x080, 450_000_000);
    let rows = gaps.rows();
    assert_eq!((rows[0].times.count(), rows[0].times.max()), (3, 0));
    assert_eq!(rows[0].counts[1], ("steps of the clock", 1));
}

#[test]
fn a_bus_full_of_heartbeats_takes_bounded_memory() {
    let mut gaps = Gaps::new(&[]);
    for id in 0x701..=0x77F {
        frames(&mut gaps, id, &[0, 0]);
    }
    let rows = gaps.rows();
    assert_eq!(rows.len(), 16);
    assert!(rows[0].counts.contains(&("frames of further identifiers", 2 * (127 - 16))), "{:?}", rows[0].counts);
}

#[test]
fn a_report_is_a_table_and_can_show_each_time() {
    let times = histogram(100, &[1, 2, 2, 250]);
    let row = Row { name: "late by".into(), period_us: Some(1000), times, counts: vec![("missed", 3)] };
    let report = Report { how: "somehow".into(), times: "wake-up", rows: vec![row] };
    let text = report.text(true);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "somehow");
    assert_eq!(lines[1].split_whitespace().last(), Some("max"));
    let words: Vec<&str> = lines[2].split_whitespace().collect();
    assert_eq!(words, ["late", "by", "1000", "4", "1", "63.8", "250", "250", "250", "3", "missed"]);
    assert_eq!(&lines[4..], ["late by: us, count", "000001 000001", "000002 000002"]);
    assert!(!report.text(false).contains("count\n0000"));
}
