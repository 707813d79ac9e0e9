//! `advee bench can`: frames per second that our own CAN port sends and receives, and the number lost.

use super::jitter::interface;
use crate::can::{Heard, Link, Target};
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, print};
use base::can::{Frame, Id};
use base::{Duration, Instant};
use host::clock;
use host::ports::settings::CanInterface;
use serde_json::json;
use std::process::ExitCode;

/// Time after the last frame at which missing frames count as lost.
const PATIENCE: Duration = Duration::from_secs(1);
/// Number of frames sent before received ones are read.
const BURST: u32 = 32;
/// Their identifier: no node of CANopen has it.
const ID: u16 = 0x7F0;

#[derive(clap::Args)]
pub struct Can {
    /// One end of the bus: can0, udp:GROUP:PORT or slcan:DEVICE
    #[arg(value_name = "IFACE", value_parser = interface)]
    one: CanInterface,
    /// The other end
    #[arg(value_name = "IFACE", value_parser = interface)]
    other: CanInterface,
    /// Frames of 8 bytes each way
    #[arg(long, value_name = "N", default_value = "20000", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    frames: u32,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// A port with its output and its received frames.
struct End {
    name: String,
    link: Link,
    to_send: u32,
    sent: u32,
    /// Number of frames received from the other end.
    heard: u32,
    /// Number of frames received out of order.
    out_of_order: u32,
    next: u32,
}

/// Result of one direction, or of both at once.
pub struct Way {
    pub name: String,
    pub frames: u32,
    pub lost: u32,
    pub out_of_order: u32,
    pub time: Duration,
}

impl End {
    fn open(common: &Common, interface: &CanInterface) -> Result<Self, Failed> {
        let target = Target::on(common, interface)?;
        let link = Link::open(&target)?;
        Ok(Self { name: target.name, link, to_send: 0, sent: 0, heard: 0, out_of_order: 0, next: 0 })
    }

    fn begin(&mut self, to_send: u32) {
        self.to_send = to_send;
        (self.sent, self.heard, self.out_of_order, self.next) = (0, 0, 0, 0);
    }

    /// Sends as long as there is room, but no more than a burst.
    fn send(&mut self, now: Instant) -> Result<(), Failed> {
        self.link.flush(now)?;
        for _ in 0..BURST {
            if self.link.is_full() || self.sent == self.to_send {
                break;
            }
            let mut data = [0; 8];
            data[..4].copy_from_slice(&self.sent.to_le_bytes());
            self.sent += 1;
            self.link.send(now, Frame::standard(ID, &data))?;
        }
        Ok(())
    }

    /// Takes what has come; whether that was anything.
    fn receive(&mut self, now: Instant) -> Result<bool, Failed> {
        let before = self.heard;
        loop {
            match self.link.receive(now)? {
                Heard::Frame { frame, .. } if frame.id() == Id::Standard(ID) => self.count(&frame),
                Heard::Frame { .. } | Heard::Notice(_) | Heard::Note(_) => {}
                Heard::Nothing => return Ok(self.heard != before),
            }
        }
    }

    fn count(&mut self, frame: &Frame) {
        let Some(number) = frame.data().first_chunk().map(|bytes| u32::from_le_bytes(*bytes)) else {
            return;
        };
        self.heard = self.heard.saturating_add(1);
        self.out_of_order = self.out_of_order.saturating_add(u32::from(number < self.next));
        self.next = number.saturating_add(1);
    }

    fn has_sent(&self) -> bool {
        self.sent == self.to_send && !self.link.is_full()
    }
}

/// Sends this number of frames from each end at once, and receives them, and shows it; `None` when interrupted.
fn measure(
    ends: &mut [End; 2],
    frames: [u32; 2],
    name: String,
    progress: &mut Progress,
) -> Result<Option<Way>, Failed> {
    let (start, all) = (clock::now(), frames[0].saturating_add(frames[1]));
    let mut last = start;
    ends.iter_mut().zip(frames).for_each(|(end, frames)| end.begin(frames));
    loop {
        let now = clock::now();
        for end in ends.iter_mut() {
            end.send(now)?;
            if end.receive(now)? {
                last = clock::now();
            }
        }
        let heard = ends[0].heard.saturating_add(ends[1].heard);
        progress.show(f64::from(heard) / f64::from(all), |took| {
            format!("{name}, {:.0} frames/s", f64::from(heard) / took.as_secs_f64())
        });
        if heard >= all || now.since(last) > PATIENCE {
            let out_of_order = ends[0].out_of_order.saturating_add(ends[1].out_of_order);
            return Ok(Some(Way {
                name,
                frames: all,
                lost: all.saturating_sub(heard),
                out_of_order,
                time: last.since(start),
            }));
        }
        // Does not wait while an end has frames to send.
        let busy = ends.iter().any(|end| !end.has_sent());
        let wait = if busy { Duration::ZERO } else { Duration::from_millis(1) };
        for end in ends.iter_mut() {
            if end.link.wait(clock::now() + wait)? {
                return Ok(None);
            }
        }
    }
}

impl Way {
    /// Frames that came, a second.
    fn rate(&self) -> f64 {
        f64::from(self.frames.saturating_sub(self.lost)) / self.time.as_secs_f64().max(1e-9)
    }
}

pub fn can(common: &Common, command: &Can) -> Outcome {
    let mut ends = [End::open(common, &command.one)?, End::open(common, &command.other)?];
    let (one, other, frames) = (ends[0].name.clone(), ends[1].name.clone(), command.frames);
    let ways = [
        ([frames, 0], format!("{one} to {other}")),
        ([0, frames], format!("{other} to {one}")),
        ([frames, frames], "both at once".into()),
    ];
    let (mut went, mut progress) = (Vec::new(), Progress::new("measuring"));
    for (frames, name) in ways {
        progress.restart();
        match measure(&mut ends, frames, name, &mut progress)? {
            Some(way) => went.push(way),
            None => return Ok(ExitCode::FAILURE),
        }
    }
    progress.clear();
    print(text(&went, command.json).trim_end())?;
    let good = went.iter().all(|way| way.lost == 0 && way.out_of_order == 0);
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// For programs, or for people.
pub fn text(ways: &[Way], as_json: bool) -> String {
    if as_json {
        let rows = ways.iter().map(|way| {
            let Way { name, frames, lost, out_of_order, time } = way;
            json!({ "way": name, "frames": frames, "lost": lost, "out_of_order": out_of_order, "s": time.as_secs_f64(),
                    "frames_per_s": way.rate() })
        });
        return json!({ "ways": rows.collect::<Vec<_>>() }).to_string();
    }
    let width = ways.iter().map(|way| way.name.len()).max().unwrap_or(0);
    let mut text = format!("{:width$} {:>9} {:>6} {:>12} {:>9}\n", "", "frames", "lost", "out of order", "frames/s");
    for way in ways {
        let Way { name, frames, lost, out_of_order, .. } = way;
        text += &format!("{name:width$} {frames:>9} {lost:>6} {out_of_order:>12} {:>9.0}\n", way.rate());
    }
    text
}
