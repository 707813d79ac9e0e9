//! The server's bus connection: messages are read several times a second, translated, and passed to the hub.
//!
//! People do not see more updates than that, and without a wake-up per message the server costs the robot almost
//! nothing. Messages keep the reception times of the kernel and the rings.

use super::app::App;
use super::center::ExtraState;
use base::{Epoch, Instant};
use host::bus::Bus;
use host::clock;
use logger::ros::{RobotScene, Translator};
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

/// Read period while Foxglove is connected, and while it is not. For pages it reads when their next update is due.
const POLL_PERIOD: Duration = Duration::from_millis(40);
const IDLE_POLL_PERIOD: Duration = Duration::from_millis(200);
/// Maximum number of messages read at a time: a flood waits, or is lost, while viewers are served.
const BURST: usize = 2000;

/// Reader of the bus.
pub struct BusReader {
    bus: Bus,
    translator: Translator,
    epoch: Epoch,
}

impl BusReader {
    /// Joins the bus.
    ///
    /// # Errors
    /// One line: the bus cannot be joined.
    pub fn open(url: &str, scene: RobotScene) -> Result<Self, String> {
        Ok(Self { bus: Bus::open(url, &[".*"])?, translator: Translator::new(scene), epoch: clock::epoch() })
    }

    /// Reads messages until the server ends.
    pub async fn hear(mut self, app: App) {
        loop {
            app.bus.turns.fetch_add(1, Relaxed);
            let more = self.take(&app);
            let (now, show) = (clock::now(), &app.center.show);
            let holder = app.command_queue.holder();
            let beside = ExtraState { holder: holder.as_ref(), viewers: app.viewers(), play: None };
            let due = show.turn(now, now, beside);
            let period = if app.hub().viewers() == 0 { IDLE_POLL_PERIOD } else { POLL_PERIOD };
            if more {
                tokio::task::yield_now().await;
                continue;
            }
            tokio::select! {
                () = tokio::time::sleep(period.min(due.since(now))) => {}
                () = show.woken() => {}
            }
        }
    }

    /// Processes the received messages; true if there may be more.
    fn take(&mut self, app: &App) -> bool {
        let mut hub = app.hub();
        let mut taken = 0;
        while taken < BURST {
            let now = clock::now();
            let raw = match self.bus.receive_raw() {
                Ok(Some(raw)) => raw,
                Ok(None) => break,
                Err(_) => {
                    app.bus.broken.fetch_add(1, Relaxed);
                    break;
                }
            };
            taken += 1;
            let at = clock::received(now, raw.received_ns);
            app.center.show.hear(at, raw.channel, raw.data);
            let time = nanoseconds(self.epoch, at);
            let told = self.translator.translate(raw.channel, raw.data, &mut |topic, cdr| {
                hub.publish(topic, raw.channel, time, cdr);
            });
            if told.is_err() {
                app.bus.untranslated.fetch_add(1, Relaxed);
            }
        }
        app.bus.lost.store(u32::try_from(self.bus.kernel_dropped()).unwrap_or(u32::MAX), Relaxed);
        hub.wake_viewers();
        taken == BURST
    }
}

/// Message timestamp, ns since the UNIX epoch; no step of the wall clock turns it back.
fn nanoseconds(epoch: Epoch, at: Instant) -> u64 {
    u64::try_from(epoch.timestamp(at)).unwrap_or_default() * 1000
}
