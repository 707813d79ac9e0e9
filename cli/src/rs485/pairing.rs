//! Which frame is a question and which its answer: from the direction where a module tells it, else from their order.

use messages::lowlevel::DataRaw;
use rs485::boards::{Board, DO_RESET, GET_VERSION};
use rs485::frame::{OVERHEAD, RESEND, Status};

/// An answer that comes later than this after its request is none, µs.
const ANSWER_WITHIN_US: i64 = 1_000_000;
/// The same where both directions are heard alike: boards answer within 20 ms, masters ask again after that.
const HEARD_WITHIN_US: i64 = 50_000;

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// From the master to a board.
    Request,
    /// From a board that was asked.
    Answer {
        /// Since the request, µs.
        round_trip_us: i64,
    },
    /// From a board, by itself.
    Unasked,
    /// From a board that was not asked for it, or too late.
    Stray,
}

/// Follows one line.
#[derive(Debug, Default)]
pub struct Pairing {
    /// True if frames come with their directions.
    directed: bool,
    /// Address, instruction and time of the request that waits for its answer.
    pending: Option<(i32, u8, i64)>,
}

impl Pairing {
    /// For frames whose direction is known, or for a line that is listened to.
    pub fn new(directed: bool) -> Self {
        Self { directed, pending: None }
    }

    /// What a frame is that starts with an address; `board` is what sits there.
    pub fn way(&mut self, frame: &DataRaw, board: Option<&Board>) -> Way {
        let code = frame.data.first().copied().unwrap_or_default();
        let sent = self.directed && frame.direction == DataRaw::SENT;
        let within = if self.directed { ANSWER_WITHIN_US } else { HEARD_WITHIN_US };
        let waits = self
            .pending
            .filter(|(address, asked, at)| (*address, *asked) == (frame.id, code) && frame.timestamp - at <= within);
        // Where a request that nobody answers is sent again, the second one looks like an answer but for its length.
        let common = [GET_VERSION, DO_RESET].into_iter().find(|common| common.code == code);
        let known = board.and_then(|board| board.instruction(code)).copied().or(common);
        let length = frame.data.len().saturating_sub(OVERHEAD - 1);
        let may_answer = self.directed || known.is_none_or(|known| known.answer.allow(length)) || !is_ok(frame);
        let waits = waits.filter(|_| may_answer);
        let is_unasked = board.is_some_and(|board| board.unasked.iter().any(|unasked| unasked.code == code));
        match waits {
            Some((_, _, at)) if !sent => {
                self.pending = None;
                Way::Answer { round_trip_us: frame.timestamp - at }
            }
            _ if !sent && is_unasked => Way::Unasked,
            _ if sent || !self.directed => {
                self.pending = Some((frame.id, code, frame.timestamp));
                Way::Request
            }
            _ => Way::Stray,
        }
    }
}

/// True if a frame would say OK as an answer; what says RESEND as a request counts, too.
fn is_ok(frame: &DataRaw) -> bool {
    matches!(frame.data.get(1), Some(flags) if *flags == Status::Ok as u8 || *flags == RESEND)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rs485::boards::{psc1, so1};

    /// A request without data, or an answer with two bytes.
    fn frame(ms: i64, direction: i8, id: i32, code: u8) -> DataRaw {
        let data = if direction == 0 { vec![code, 0, 2, 1, 0, 0] } else { vec![code, 0, 0, 0] };
        DataRaw { timestamp: ms * 1000, direction, id, flags: 0, data }
    }

    #[test]
    fn directions_tell_a_request_and_what_answers_it() {
        let (mut pairing, so1) = (Pairing::new(true), Some(&so1::BOARD));
        assert_eq!(pairing.way(&frame(0, 1, 0x20, 1), so1), Way::Request);
        assert_eq!(pairing.way(&frame(2, 0, 0x20, 1), so1), Way::Answer { round_trip_us: 2000 });
        assert_eq!(pairing.way(&frame(3, 0, 0x20, 1), so1), Way::Stray, "nobody asked");
        // A retry counts from itself.
        assert_eq!(pairing.way(&frame(10, 1, 0x20, 1), so1), Way::Request);
        assert_eq!(pairing.way(&frame(30, 1, 0x20, 1), so1), Way::Request);
        assert_eq!(pairing.way(&frame(31, 0, 0x20, 1), so1), Way::Answer { round_trip_us: 1000 });
        assert_eq!(pairing.way(&frame(40, 1, 0x20, 1), so1), Way::Request);
        assert_eq!(pairing.way(&frame(41, 0, 0x10, 1), so1), Way::Stray, "another board");
    }

    #[test]
    fn on_a_line_that_is_listened_to_the_second_of_two_is_the_answer_if_it_can_be() {
        let (mut pairing, so1) = (Pairing::new(false), Some(&so1::BOARD));
        assert_eq!(pairing.way(&frame(0, 1, 0x20, 1), so1), Way::Request);
        assert_eq!(pairing.way(&frame(2, 0, 0x20, 1), so1), Way::Answer { round_trip_us: 2000 });
        assert_eq!(pairing.way(&frame(50, 1, 0x20, 1), so1), Way::Request);
        // Not answered: the next one asks again, late or soon.
        assert_eq!(pairing.way(&frame(120, 1, 0x20, 1), so1), Way::Request);
        assert_eq!(pairing.way(&frame(140, 1, 0x20, 1), so1), Way::Request);
        assert_eq!(pairing.way(&frame(142, 0, 0x20, 1), so1), Way::Answer { round_trip_us: 2000 });
        assert_eq!(pairing.way(&frame(200, 1, 0x21, 0xFE), None), Way::Request);
        assert_eq!(pairing.way(&frame(220, 1, 0x21, 0xFE), None), Way::Request, "a stranger's version, too");
    }

    #[test]
    fn what_a_board_says_by_itself_is_no_question_and_no_answer() {
        let psc1 = Some(&psc1::BOARD);
        for directed in [true, false] {
            let mut pairing = Pairing::new(directed);
            assert_eq!(pairing.way(&frame(0, 1, 0x40, 1), psc1), Way::Request);
            assert_eq!(pairing.way(&frame(1, 0, 0x40, 0x80), psc1), Way::Unasked);
            let status = DataRaw { data: vec![1, 0, 1, 0x09, 0], ..frame(2, 0, 0x40, 1) };
            assert_eq!(pairing.way(&status, psc1), Way::Answer { round_trip_us: 2000 });
        }
    }
}
