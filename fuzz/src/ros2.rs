//! Messages of ROS 2, read as commands, and requests to its services. Input: which of them, then the sample.

use messages::Message;
use ros2::action::{read_cancel, read_get_result};
use ros2::incoming::{Command, Input, read};
use ros2::lifecycle::{self, Lifecycle};
use ros2::navigate::Kind;
use ros2::navigate::wire::{POSES_MAX, read_goal};
use ros2::operator;
use ros2::parameters::{Parameter, Service, Value};

/// From this number on the first byte names a service.
const SERVICES: u8 = 128;
/// Longest answer, bytes: what a request of 64 KiB may ask for.
const ANSWER_MAX: usize = 1 << 20;

/// Checks that a pose that is obeyed is finite, that its message can be sent, and that answers are bounded.
pub fn ros2(data: &[u8]) {
    let Some((which, sample)) = data.split_first() else { return };
    if let Some(service) = which.checked_sub(SERVICES) {
        return request(usize::from(service), sample);
    }
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

fn request(service: usize, sample: &[u8]) {
    for kind in Kind::ALL {
        if let Ok((_, poses)) = read_goal(kind, sample) {
            assert!((1..=POSES_MAX).contains(&poses.len()));
            assert!(poses.as_flattened().iter().all(|value| value.is_finite()));
        }
    }
    let _ = (read_cancel(sample), read_get_result(sample));
    let value = [Value::Bool(true), Value::Doubles(vec![1.0; 8])];
    let names = ["use_sim_time", "limits.speed_mps"];
    let parameter = |(name, value): (&str, Value)| Parameter { name: name.into(), value, description: "it".into() };
    let parameters: Vec<Parameter> = names.into_iter().zip(value).map(parameter).collect();
    let answer = Service::ALL[service % Service::ALL.len()].answer(&parameters, sample);
    assert!(answer.is_none_or(|answer| answer.len() <= ANSWER_MAX));
    let mut life = Lifecycle::new(true, false);
    let _ = life.answer(lifecycle::Service::ALL[service % lifecycle::Service::ALL.len()], sample, true);
    let all = operator::Config { steering: true, power: true, outputs: vec!["horn".into()] };
    for service in operator::services(&all) {
        if let Some((message, _)) = service.order(1_000_000, sample) {
            message.encode(&mut Vec::new()).unwrap();
        }
    }
}
