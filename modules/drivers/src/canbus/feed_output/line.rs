//! The output on a GPIO line of the computer, a port of this module.

use crate::gpio_line::LineRule;
use base::gpio::LineId;
use settings::settings;
use std::path::PathBuf;

settings! {
    /// `[stop.gpio]`: line of a GPIO chip that feeds the motors while it is active: it holds a relay, or the
    /// safe-torque-off input of the propulsion drive. Its circuit must be such that the feed is cut while nobody drives
    /// the line: by a resistor, whatever the chip does at reset and after the end of the process.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct GpioConfig {
        /// Device file of the chip, `"/dev/gpiochip0"`. A name without `/`: the simulator's line, in the run folder.
        chip: PathBuf = required;
        /// Number of the line on the chip, or its name there.
        line: LineId = required, LineRule;
        /// Polarity: false if the feed is cut at the low level, true if it is cut at the high level.
        active_low: bool = false;
    }
}
