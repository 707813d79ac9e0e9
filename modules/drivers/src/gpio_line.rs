//! A line of a GPIO chip in files.

use base::gpio::LineId;
use settings::{Rule, Value};

/// A line by its number or its name.
pub(crate) struct LineRule;

impl Rule<LineId> for LineRule {
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
