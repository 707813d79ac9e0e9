//! The output on a GPIO line of the computer, a port of this module.

use base::gpio::LineId;
use settings::{Rule, Value, settings};
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
        line: LineId = required, Line;
        /// Polarity: false if the feed is cut at the low level, true if it is cut at the high level.
        active_low: bool = false;
    }
}

/// A line by its number or its name.
struct Line;

impl Rule<LineId> for Line {
    fn accept(&self, value: &Value) -> Option<LineId> {
        match value {
            Value::String(name) => (!name.is_empty()).then(|| LineId::Name(name.clone())),
            number => (0..=u32::MAX).accept(number).map(LineId::Number),
        }
    }

    fn expected(&self) -> String {
        "the number of a line, or its name".into()
    }

    fn stand_in(&self) -> LineId {
        LineId::Number(0)
    }

    fn shown(&self, line: &LineId) -> String {
        match line {
            LineId::Number(number) => number.to_string(),
            LineId::Name(name) => format!("{name:?}"),
        }
    }
}
