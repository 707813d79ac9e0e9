//! `--trace A,B`: what the rules observe in a part of an episode, one line for each observation.

use base::can::{Frame, Id};
use base::{Duration, Instant};
use sim::host::{News, Virtual};
use std::collections::BTreeMap;
use std::io::Write;

/// Part of an episode: from and to, time of the episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trace {
    from: Instant,
    to: Instant,
}

/// Reads `A,B`, seconds.
pub fn part(text: &str) -> Result<Trace, String> {
    let expected = || "expected A,B: seconds of the episode, A before B".to_string();
    let (from, to) = text.split_once(',').ok_or_else(expected)?;
    let at = |text: &str| {
        let seconds = text.trim().parse().ok().filter(|seconds| (0.0..=1e9).contains(seconds)).ok_or_else(expected)?;
        Ok::<_, String>(Instant::ZERO + Duration::from_secs_f64(seconds))
    };
    let (from, to) = (at(from)?, at(to)?);
    if from < to { Ok(Trace { from, to }) } else { Err(expected()) }
}

impl Trace {
    /// Prints what a machine's observers are given from now on.
    pub fn observe(self, machine: &mut Virtual) {
        let mut names = Names(machine.processes().map(|(pid, module)| (pid, module.to_owned())).collect());
        machine.observe(move |now, news| {
            if let News::Started { module, pid } = news {
                names.0.insert(*pid, (*module).to_owned());
            }
            if (self.from..=self.to).contains(&now) {
                // A reader that has read enough does not end the episode.
                let _ = writeln!(std::io::stdout(), "{}", line(now, news, &names));
            }
        });
    }
}

/// Modules by their processes.
struct Names(BTreeMap<u32, String>);

impl Names {
    fn of(&self, pid: u32) -> String {
        self.0.get(&pid).cloned().unwrap_or_else(|| format!("process {pid}"))
    }
}

/// An observation: its time, its kind, and the rest.
fn line(now: Instant, news: &News<'_>, names: &Names) -> String {
    let (kind, what) = match news {
        News::Message { sender, message } => {
            let by = sender.pid().map_or_else(|| format!("{:?}", sender.way), |pid| names.of(pid));
            ("sent", format!("by {by}: {message:?}"))
        }
        News::Heard { pid, at, message, .. } => {
            let waited = now.since(*at).as_secs_f64() * 1e3;
            ("served", format!("to {}, waited {waited:.3} ms: {message:?}", names.of(*pid)))
        }
        News::Can { bus, pid, frame } => {
            let by = if *pid == 0 { "a node".into() } else { names.of(*pid) };
            ("frame", format!("{bus} by {by}: {}", content(frame)))
        }
        News::CanLost { bus, frame } => ("lost", format!("{bus}: {}", content(frame))),
        News::Words { bus, pid, words } => ("words", format!("{bus} to {}: {words:?}", names.of(*pid))),
        News::I2c { bus, transfer, outcome } => ("i2c", format!("{bus}: {transfer:?} {outcome:?}")),
        News::OneWire { bus, answer } => ("1-wire", format!("{bus}: {answer:?}")),
        News::Report { module, report } => ("report", format!("{module}: {report:?}")),
        News::Note { module, line } => ("text", format!("{module}: {line}")),
        News::State { module, state } => ("state", format!("{module}: {state}")),
        News::Started { module, pid } => ("started", format!("{module}, process {pid}")),
        News::Exited { module, status, .. } => ("exited", format!("{module}: {status:?}")),
        News::Hung { module, .. } => ("hung", (*module).to_owned()),
        News::Resumed { module, .. } => ("resumed", (*module).to_owned()),
        News::Crawls { module, late, .. } => ("slow", format!("{module}: {} s late", late.as_secs_f64())),
        News::Fault { target, fault, until } => {
            let until = if *until == Instant::NEVER { "ever".into() } else { seconds(*until) };
            ("fault", format!("{target} {fault} until {until}"))
        }
        News::Dropped { whose, count } => ("dropped", format!("{whose}: {count}")),
    };
    // A text of a module may have several lines.
    format!("{:>12} {kind:7} {}", seconds(now), what.replace('\n', "\\n"))
}

/// Identifier and data, as `advee can monitor` has them: `501 0F 00`.
fn content(frame: &Frame) -> String {
    let id = match frame.id() {
        Id::Standard(id) => format!("{id:03X}"),
        Id::Extended(id) => format!("{id:08X}"),
    };
    frame.data().iter().fold(id, |text, byte| format!("{text} {byte:02X}"))
}

fn seconds(at: Instant) -> String {
    format!("{:.6}", at.as_nanos() as f64 / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_two_moments_the_earlier_one_first() {
        let part = part("12.5, 13").map(|part| (part.from, part.to));
        assert_eq!(part, Ok((Instant::from_millis(12_500), Instant::from_millis(13_000))));
        for odd in ["", "1", "2,1", "1,1", "-1,2", "1,NaN", "a,b", "1,2,3"] {
            assert!(super::part(odd).is_err(), "{odd}");
        }
    }

    #[test]
    fn an_observation_is_one_line_with_time_kind_and_module() {
        let names = Names([(7, "planner".to_owned())].into());
        let at = Instant::from_millis(12_500);
        let text = line(at, &News::Note { module: "planner", line: "one\ntwo" }, &names);
        assert_eq!(text, "   12.500000 text    planner: one\\ntwo");
        let until = Instant::NEVER;
        let text = line(at, &News::Fault { target: "psc1", fault: "silent", until }, &names);
        assert_eq!(text, "   12.500000 fault   psc1 silent until ever");
        let text = line(at, &News::Words { bus: "rs485.a", pid: 7, words: &[] }, &names);
        assert_eq!(text, "   12.500000 words   rs485.a to planner: []");
    }
}
