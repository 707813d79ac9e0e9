//! Names of the actions and of their services.

/// An action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `navigate_to_pose`.
    ToPose,
    /// `navigate_through_poses`.
    ThroughPoses,
}

impl Kind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::ToPose, Self::ThroughPoses];

    /// Name in ROS, without the namespace.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ToPose => "/navigate_to_pose",
            Self::ThroughPoses => "/navigate_through_poses",
        }
    }

    /// Type in ROS.
    #[must_use]
    pub const fn type_name(self) -> &'static str {
        match self {
            Self::ToPose => "nav2_msgs/action/NavigateToPose",
            Self::ThroughPoses => "nav2_msgs/action/NavigateThroughPoses",
        }
    }

    /// `UNKNOWN` among the error codes of its result.
    pub(super) const fn unknown_error(self) -> u16 {
        match self {
            Self::ToPose => 9000,
            Self::ThroughPoses => 9100,
        }
    }
}

/// A service of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// `send_goal`.
    SendGoal,
    /// `cancel_goal`.
    CancelGoal,
    /// `get_result`.
    GetResult,
}

impl Part {
    /// All.
    pub const ALL: [Self; 3] = [Self::SendGoal, Self::CancelGoal, Self::GetResult];

    /// Name and type of the service.
    #[must_use]
    pub fn service(self, kind: Kind) -> (String, String) {
        let of_kind = |part: &str| format!("{}_{part}", kind.type_name());
        let (name, type_name) = match self {
            Self::SendGoal => ("send_goal", of_kind("SendGoal")),
            Self::CancelGoal => ("cancel_goal", "action_msgs/srv/CancelGoal".to_owned()),
            Self::GetResult => ("get_result", of_kind("GetResult")),
        };
        (format!("{}/_action/{name}", kind.name()), type_name)
    }
}
