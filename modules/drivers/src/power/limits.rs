//! Greatest currents of the channels: a warning before a channel switches itself off, and what it drew when it did.

use super::config::ChannelConfig;
use base::{Fault, Severity};
use module::Actions;
use rs485::boards::psc1::CHANNELS;

/// Share of the current of a warning below which it ends.
const RELEASE: f64 = 0.95;

/// Limit of a channel, A.
#[derive(Clone, Copy, Debug)]
struct Limit {
    greatest: f64,
    warning: f64,
}

/// Currents of the channels, and their limits.
#[derive(Debug, Default)]
pub(super) struct Limits {
    limits: [Option<Limit>; CHANNELS.len()],
    /// Last measured current while the channel was on, A.
    drawn: [Option<f64>; CHANNELS.len()],
}

impl Limits {
    pub fn new(channels: &[ChannelConfig]) -> Self {
        let mut new = Self::default();
        for config in channels {
            if let Some(channel) = CHANNELS.iter().position(|name| *name == config.name) {
                let greatest = config.current_max_a;
                new.limits[channel] = Some(Limit { greatest, warning: greatest * config.warning_share });
            }
        }
        new
    }

    /// Currents of all channels, A; `state`: those that are on.
    pub fn on_currents(&mut self, state: u8, amperes: &[f64; CHANNELS.len()], out: &mut Actions) {
        for (channel, (current, name)) in amperes.iter().zip(CHANNELS).enumerate() {
            let on = state >> channel & 1 == 1;
            if on {
                self.drawn[channel] = Some(*current);
            }
            let Some(Limit { greatest, warning }) = self.limits[channel] else { continue };
            if on && *current > warning {
                let message = format!(
                    "power channel {name} draws {current:.1} A and may draw {greatest:.1} A: beyond that it switches \
                     itself off; relieve it"
                );
                out.raise(Severity::Warning, Fault::ChannelCurrent, name, message);
            } else if !on || *current < warning * RELEASE {
                out.clear(Fault::ChannelCurrent, name, format!("power channel {name} draws {current:.1} A"));
            }
        }
    }

    /// What a channel drew when it was measured last, as a part of a sentence.
    pub fn drew(&self, channel: usize) -> String {
        let drawn = self.drawn[channel].map(|current| format!("; it last drew {current:.1} A"));
        let limit = self.limits[channel].map(|limit| format!(" of at most {:.1} A", limit.greatest));
        drawn.map_or_else(String::new, |drawn| format!("{drawn}{}", limit.unwrap_or_default()))
    }
}
