use base::Instant;
use module::{Actions, Channel, Event, Message, Module};

/// Reports every 100 m of driven distance.
#[derive(Default)]
pub struct Milestones {
    passed: u32,
}

impl Module for Milestones {
    fn subscriptions(&self) -> &[Channel] {
        &[Channel::LlDataOdo]
    }

    fn handle(&mut self, _now: Instant, event: Event<'_>, out: &mut Actions) {
        if let Event::Message { message: Message::LlDataOdo(odo), .. } = event {
            out.working();
            let next_m = f64::from(self.passed + 1) * 100.0;
            if odo.path >= next_m {
                self.passed += 1;
                out.note(format!("{next_m} m driven"));
            }
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}
