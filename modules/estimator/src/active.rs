//! Selection of the active beacons: the scanner takes a few at once, and a sweep is shared among them.

use crate::filter::Beacon;
use navitools::Pose;

/// Least gain, as the ratio of the determinants of information, that justifies a change: the scanner loses a sweep by
/// it.
const INFORMATION_GAIN_MIN: f64 = 1.5;

/// Numbers of at most `most` beacons, in the order of the map: within `range` (m), those with the most information on a
/// robot at `pose`; without a pose, all in rotation. `before` are the beacons active now.
pub fn choose(
    beacons: &[Beacon],
    most: usize,
    range: f64,
    pose: Option<Pose>,
    before: &[i32],
    turn: usize,
) -> Vec<i32> {
    if beacons.len() <= most {
        return beacons.iter().map(|beacon| beacon.id).collect();
    }
    let Some(pose) = pose else {
        let mut chosen: Vec<usize> = (0..most).map(|n| (turn * most + n) % beacons.len()).collect();
        chosen.sort_unstable();
        return chosen.into_iter().map(|place| beacons[place].id).collect();
    };
    let mut chosen: Vec<usize> = Vec::with_capacity(most);
    let mut information = [[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]];
    while chosen.len() < most {
        let rest = (0..beacons.len()).filter(|place| !chosen.contains(place));
        // Beacons out of range come last, the nearest first.
        let value = |place: usize| {
            let distance = pose.point().distance(beacons[place].at);
            if distance <= range { determinant(&with(&information, &beacons[place], pose)) } else { -distance }
        };
        let Some(best) = rest.max_by(|a, b| value(*a).total_cmp(&value(*b))) else { break };
        information = with(&information, &beacons[best], pose);
        chosen.push(best);
    }
    let active: Vec<&Beacon> = beacons.iter().filter(|beacon| before.contains(&beacon.id)).collect();
    let sum = |list: &mut dyn Iterator<Item = &Beacon>| {
        let seen = list.filter(|beacon| pose.point().distance(beacon.at) <= range);
        determinant(&seen.fold([[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]], |sum, b| with(&sum, b, pose)))
    };
    let (old, new) = (sum(&mut active.iter().copied()), sum(&mut chosen.iter().map(|place| &beacons[*place])));
    if active.len() == most && new < INFORMATION_GAIN_MIN * old {
        return active.iter().map(|beacon| beacon.id).collect();
    }
    chosen.sort_unstable();
    chosen.into_iter().map(|place| beacons[place].id).collect()
}

/// Information on the pose after a bearing of this beacon.
fn with(information: &[[f64; 3]; 3], beacon: &Beacon, pose: Pose) -> [[f64; 3]; 3] {
    let (dx, dy) = (beacon.at.x - pose.x, beacon.at.y - pose.y);
    let square = (dx * dx + dy * dy).max(0.25);
    let by = [dy / square, -dx / square, -1.0];
    core::array::from_fn(|row| core::array::from_fn(|column| information[row][column] + by[row] * by[column]))
}

fn determinant(m: &[[f64; 3]; 3]) -> f64 {
    m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use navitools::Point;

    fn hall() -> Vec<Beacon> {
        let at = |n: i32| Point { x: 5.0 * f64::from(n % 5), y: 8.0 * f64::from(n / 5) };
        (0..10).map(|n| Beacon { id: n + 1, at: at(n) }).collect()
    }

    #[test]
    fn all_are_active_where_the_scanner_takes_all() {
        assert_eq!(choose(&hall()[..6], 8, 15.0, None, &[], 0), [1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn near_ones_all_around_are_chosen_and_kept() {
        let first = choose(&hall(), 4, 9.0, Some(Pose::new(2.5, 4.0, 0.0)), &[], 0);
        assert_eq!(first, [1, 2, 6, 7]);
        assert_eq!(choose(&hall(), 4, 9.0, Some(Pose::new(3.0, 4.0, 0.0)), &first, 0), first);
        assert_eq!(choose(&hall(), 4, 9.0, Some(Pose::new(17.5, 4.0, 0.0)), &first, 0), [4, 5, 9, 10]);
    }

    #[test]
    fn without_a_pose_all_have_their_turn() {
        let mut seen: Vec<i32> = (0..5).flat_map(|turn| choose(&hall(), 4, 9.0, None, &[], turn)).collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen, (1..=10).collect::<Vec<_>>());
    }
}
