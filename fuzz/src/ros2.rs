//! Messages of ROS 2, read as commands. Input: which of them, then the sample.

use messages::Message;
use ros2::incoming::{Command, Input, read};

/// Checks that a pose that is obeyed is finite, and that its message can be sent.
pub fn ros2(data: &[u8]) {
    let Some((which, sample)) = data.split_first() else { return };
    let input = Input::ALL[usize::from(*which) % Input::ALL.len()];
    if let Ok(Command::Message(message)) = read(input, 1_000_000, sample) {
        let finite = match &*message {
            Message::MlCmdGoal(goal) => {
                let numbers = goal.waypoints.iter().flat_map(|at| [at.x, at.y, at.theta]);
                numbers.into_iter().all(f64::is_finite)
            }
            Message::MlCmdEstimate(estimate) => {
                let covariance = estimate.covariance.as_flattened();
                [estimate.x, estimate.y, estimate.theta].iter().chain(covariance).all(|value| value.is_finite())
            }
            _ => false,
        };
        assert!(finite, "{message:?}");
        message.encode(&mut Vec::new()).unwrap();
    }
}
