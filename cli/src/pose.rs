//! `advee pose X,Y,THETA`: tells the estimator where the robot is.

use super::bus::{Heard, Tool};
use super::{Common, Outcome, finite, print};
use base::Duration;
use diagnostics::orders;
use host::clock;
use messages::middlelevel::DataEstimate;
use messages::{Channel, Message};
use std::process::ExitCode;

#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Pose {
    /// m, m, rad in the map
    #[arg(value_name = "X,Y,THETA", value_parser = pose)]
    pose: [f64; 3],
    /// How sure: deviations of x, y, theta; m, m, rad
    #[arg(long, value_name = "X,Y,THETA", value_parser = pose, default_value = "0.2,0.2,0.1")]
    covariance: [f64; 3],
}

/// The estimator answers within a period of 50 ms.
const ANSWER: Duration = Duration::from_secs(1);

/// Three numbers with commas between.
pub fn pose(text: &str) -> Result<[f64; 3], String> {
    let numbers = text.split(',').map(|number| finite(number.trim())).collect::<Result<Vec<f64>, _>>();
    numbers.ok().and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| "expected x,y,theta".into())
}

pub fn tell(common: &Common, command: &Pose) -> Outcome {
    let [dx, dy, turn] = command.covariance;
    if dx < 0.0 || dy < 0.0 || turn < 0.0 {
        return Err("--covariance: deviations are not below 0".into());
    }
    let mut tool = Tool::join(common, "pose", &[Channel::MlDataEstimate])?;
    let until = clock::now() + ANSWER;
    // Whoever is told must be there first.
    let mut told = false;
    loop {
        match tool.hear(until)? {
            Heard::Message(Message::MlDataEstimate(estimate)) if told => {
                let quality = ["LOST", "SEARCHING", "COARSE", "FINE"][estimate.quality.clamp(0, 3) as usize];
                let DataEstimate { x, y, theta, .. } = estimate;
                print(format_args!("{quality} at {x:.3} m, {y:.3} m, {theta:.4} rad"))?;
                return Ok(ExitCode::SUCCESS);
            }
            Heard::Message(Message::MlDataEstimate(_)) => {
                tool.publish(orders::pose(tool.timestamp(), command.pose, command.covariance))?;
                told = true;
            }
            Heard::Message(_) => {}
            Heard::Nothing => {
                return Err(format!("no estimator is heard on {}; is it in RUN?", common.lcm_url()).into());
            }
            Heard::Interrupt => return Err("interrupted".into()),
        }
    }
}
