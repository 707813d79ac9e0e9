//! Replay of a recorded run's estimator (docs/replay.md).

use super::super::Failed;
use super::{Outcomes, Row, START};
use crate::progress::Progress;
use estimator::filter::{Estimate, Quality};
use host::recorder;
use messages::Message;
use messages::middlelevel::{CmdEstimate, DataEstimate};
use module::admission::Origin;
use module::{Action, Actions, Event};
use navitools::{Motion, Pose};
use record::{Item, Reader};
use robot::recording;
use serde_json::json;
use std::fs;
use std::path::Path;

pub fn estimates(run: &Path, start: Option<[f64; 3]>, sets: &[String]) -> Result<Outcomes, Failed> {
    let path = if run.is_file() { run.into() } else { run.join(recorder::FOLDER).join(estimator::NAME) };
    let named = |what: String| Failed::from(format!("{}: {what}", path.display()));
    let bytes = fs::read(&path).map_err(|error| {
        named(format!("{error}; a run has it when its estimator was recorded with log.inputs = true"))
    })?;
    let mut reader = Reader::open(&bytes).map_err(|refusal| named(refusal.to_string()))?;
    if reader.header().module != estimator::NAME {
        return Err(named(format!("inputs of {}, not of the estimator", reader.header().module)));
    }
    let mut shell = recording::rebuild(reader.header(), sets)?;
    let (mut rows, mut started) = (Vec::new(), start.is_none());
    let mut progress = Progress::new("estimating");
    while let Some(item) = reader.read().map_err(|refusal| named(refusal.to_string()))? {
        let Item::Record(record) = item else { break };
        progress.tell(record.place as u64, bytes.len() as u64);
        let mut out = Actions::new(record.epoch);
        record.call(|call| call.tell(&mut shell, record.at, &mut out)).map_err(|refusal| named(refusal.to_string()))?;
        for action in out.drain() {
            let Action::Publish(Message::MlDataEstimate(estimate)) = action else { continue };
            rows.push(row(&estimate));
            if let Some(pose) = start.filter(|_| !std::mem::replace(&mut started, true)) {
                let message = Message::from(command(estimate.timestamp, pose));
                let event = Event::Message { at: record.at, from: Origin::DUE, message: &message };
                shell.handle(record.at, event, &mut Actions::new(record.epoch));
            }
        }
    }
    Ok(Outcomes { rows, counts: None, assumed: json!({ "from": "the run's configuration", "set": sets }) })
}

fn command(timestamp: i64, [x, y, theta]: [f64; 3]) -> CmdEstimate {
    let [dx, dy, turn] = START.map(|deviation| deviation * deviation);
    CmdEstimate { timestamp, x, y, theta, covariance: [[dx, 0.0, 0.0], [0.0, dy, 0.0], [0.0, 0.0, turn]] }
}

fn row(estimate: &DataEstimate) -> Row {
    let quality = match estimate.quality {
        DataEstimate::FINE => Quality::Fine,
        DataEstimate::COARSE => Quality::Coarse,
        DataEstimate::SEARCHING => Quality::Searching,
        _ => Quality::Lost,
    };
    let motion = Motion { translation: estimate.speed, rotation: estimate.rotation };
    let pose = Pose::new(estimate.x, estimate.y, estimate.theta);
    Row {
        time: estimate.timestamp as f64 * 1e-6,
        believed: Estimate { pose, motion, drift: 0.0, covariance: estimate.covariance, quality },
    }
}
