//! What a person does about a fault: one sentence or two for each number, beside its meaning in `docs/faults.md`.

use crate::Fault;

impl Fault {
    /// Action of an operator or engineer, one or more whole sentences. The subject of a report, such as a board, stands
    /// beside it wherever it is shown.
    #[must_use]
    pub const fn what_to_do(self) -> &'static str {
        match self {
            Self::CommandForbidden => "Look at the module's state and at the message, then command what it allows.",
            Self::MessageMalformed => "Find the program that sends on this channel, and give it the robot's types.",
            Self::PortDown => "Check cable, adapter and rights of the port; it is opened again automatically.",
            Self::PortOverrun => "Check the load of the computer (`advee bench`), and end what else runs on it.",
            Self::SenderRefused => {
                "Find the program that sends it; if it may, set `commands` of `[bus]` in robot.toml, else end it."
            }
            Self::SecondRobot => "End the other robot, or give it a message bus of its own (`--lcm-url`).",

            Self::BoardDegraded => "Check plugs, termination and shield of the line near the board.",
            Self::BoardLost => "Check power and cable of the board; it is asked again each second.",
            Self::BoardRefused => "Check that the board is of the configured kind, and its firmware.",
            Self::BoardImplausible => {
                "Check what its sensors measure; switch its power off and on, and replace it if that fails."
            }
            Self::BusBabble => "Unplug the boards of the line one by one until it is quiet, and replace the last one.",
            Self::AddressClash => "Give one of the two boards another address.",
            Self::RangingLost => {
                "Check power and cable of the board. Then release the controls and press again, or send the goal again."
            }
            Self::FloorMissing => {
                "Push the robot back by hand until the corner is over a flat floor; clean the sensor."
            }
            Self::BoardSupply => "Measure the board's supply at its plug; check fuse, cable and power channel.",

            Self::DriveLost => "Check power and CAN cable of the drive; it is booted again automatically.",
            Self::DriveEmergency => {
                "Look up the emergency code in the drive's manual, unless PAUSE or its power explains it."
            }
            Self::DriveBootFailed => {
                "Check the drive's power, type and node id; the boot-up is repeated automatically."
            }
            Self::DriveMismatch => "Install the configured drive, or enter the one that is there in robot.toml.",
            Self::DriveFault => {
                "Look up the code in the drive's manual, unless PAUSE explains it; the fault is reset automatically."
            }
            Self::HomingFailed => "Make room at the front wheels, check the homing switch, then home the axis again.",
            Self::MotionRefused => "Correct the program that the message names: its command is out of limits.",
            Self::MotionContested => "Let one of the two sources stop commanding.",
            Self::CriticalModule => {
                "Wait some seconds: the module is restarted automatically. If not, look at the modules."
            }
            Self::WatchdogSilent => {
                "Wait some seconds: the watchdog is restarted automatically. If not, start advee again."
            }
            Self::CanMalformed => "Check the firmware of the node, and that no foreign device is on the bus.",
            Self::SecondMaster => "End the other program that commands the drives.",
            Self::CanPassive => "Check cable, termination and bit rate of the CAN bus.",
            Self::CanUnacknowledged => {
                "Check cable, termination and bit rate of the CAN bus, and that the drives have power."
            }
            Self::CanErrors => "Check plugs, termination and shield of the CAN bus.",
            Self::CanBabble => "Unplug the node that the message names; without a name, one node after the other.",
            Self::NodeClash => "Give one of the two nodes another id.",
            Self::SpeedExceeded => {
                "Find out why: slope, drive parameters or encoder. Then command driver_canbus to RUN by hand."
            }
            Self::StopFailed => {
                "Find out why the brakes or drives did not obey before the power channel motors is switched on by hand."
            }
            Self::DriveParameter => "Find out who writes to the drive; it is configured again automatically.",
            Self::SecondWayLost => "Check what cuts the motors' feed: power and cable of its node, or its GPIO line.",
            Self::WheelsDisagree => "Check encoders, wheels and their order on the bus; then command zero first.",

            Self::ModuleDied => {
                "Wait some seconds: it is started again. If it ends again, read its texts and exit code."
            }
            Self::ModuleHung => "Wait some seconds: it is started again. If it hangs again, check the computer's load.",
            Self::ModuleUnstartable => "Check program, rights and memory that the message names.",
            Self::BeatsBad => "Check that all modules are of the same version, then restart the module.",
            Self::NameClaimed => "End the other program of this name, or rename it.",
            Self::RestartStorm => {
                "Read the module's texts for the cause and remove it; until then it is restarted again and again."
            }
            Self::ModuleDown => "Command the module to RUN if it is needed.",
            Self::WatchdogLate => "Check the load of the computer (`advee bench`), and end what else runs on it.",

            Self::FaultUnknown => "See what can be broken: `advee fault` lists it.",

            Self::PauseUnknown => "Check that the power controller is on, and its cable.",
            Self::PowerOff => "Nothing is to be done; switch the robot on again when it is off.",
            Self::BatteryLow => "Charge the battery.",
            Self::ChannelStuck => "Switch the channel once more; if it stays, replace the power controller.",
            Self::ChannelTripped => "Find the short circuit or overload on the channel, then switch it on again.",
            Self::ChannelCurrent => "Find what draws so much on the channel before it switches itself off.",
            Self::ComputerStuck => "Look why the computer does not shut down: its screen, its button, its power LED.",

            Self::InputsLost => "Check space and speed of the disk; until then this run cannot be replayed entirely.",
            Self::LogLost => "Check space, speed and health of the disk.",
            Self::LogRefused => "Free space on the disk, or replace it; recording goes on automatically.",
            Self::LogCrowded => "Find the program that publishes on ever new channels, and end it.",

            Self::ChipLost => "Check cable and address of the chip.",
            Self::OverTemperature => "Stop driving, and let it cool down; check fans and air inlets.",
            Self::FanFailed => "Clean the fan and check its plug, else replace it.",
            Self::ThermometerBad => "Check cable and pull-up of the thermometer, else replace it.",
            Self::HostThrottled => "Check fans, air inlets and the supply of the computer, and what loads it.",

            Self::GamepadRefused => "Use another gamepad, or enter its axes and buttons in `[gamepad]` of robot.toml.",
            Self::GamepadNotReleased => {
                "Release the dead-man button with the sticks in the middle, then press it again."
            }

            Self::IoDeviceLost => "Check power, cable and address of the device; it is asked again automatically.",
            Self::IoDeviceRefused => "Compare `[io]` in robot.toml with the manual of the device.",
            Self::OutputRefused => "Correct the name or value in the program that commands the output.",

            Self::LidarLost => "Check power and cable of the lidar, and its address.",
            Self::LidarDirty => "Clean the optics of the lidar with a soft cloth.",
            Self::LidarBlocked => "Clean the optics of the lidar with a soft cloth, and remove what covers them.",
            Self::LidarSpeed => "Check that nothing brakes the lidar's head, and its supply; else replace it.",
            Self::LidarIncomplete => "Check the cable of the lidar, and the load of the computer.",
            Self::LidarDisturbed => "Check plugs and shield of the lidar's line.",
            Self::LidarError => "Look up the code in the lidar's manual.",
            Self::LidarNoResult => {
                "Check that the configured field or output exists in the lidar, and is enabled there."
            }
            Self::LidarWarning => "Look up the code in the lidar's manual, before the lidar fails.",

            Self::ImuLost => "Check power and cable of the unit.",
            Self::ImuDisturbed => "Check plugs and shield of the unit's line.",
            Self::ImuImplausible => "Check how the unit is mounted, and its axes in `[imu]` of robot.toml.",
            Self::ImuFrozen => "Switch the unit's power off and on; replace it if that fails.",
            Self::ImuUncalibrated => "Let the robot stand still until the unit is calibrated.",
            Self::ImuError => "Look up the code in the unit's manual.",

            Self::OdometrySilent => "Check the board or the drives that measure the wheels: power and cable.",
            Self::OdometryStuck => {
                "Check that both wheels and their encoders turn, and that the floor is not slippery."
            }
            Self::BeaconUnknown => "Enter the beacon on the map, or remove what the scanner takes for one.",
            Self::PoseLost => "Set the position by hand, or move the robot to where beacons are visible.",
            Self::MeasurementBad => "Check the sensor that the report is about, or send a pose of finite numbers.",
            Self::RotationDisagrees => "Check floor and wheels for slip, and how the inertial unit is mounted.",

            Self::GoalRefused => "Send a goal that lies on the map, with finite coordinates.",
            Self::EstimateBad => "Restart the estimator; check the clocks of the computers that publish to it.",
            Self::ModeRefused => "Command a mode that the message does not refuse: `advee mode --help` lists them.",
            Self::ParameterRefused => "Choose a value within the range: `advee parameters` lists names and ranges.",

            Self::BridgeDown => {
                "Check cable and network, and that advee runs on the other computer; texts of bridge have the cause."
            }
            Self::BridgeRefused => "Check that both computers have the same key file; else find who connects.",
            Self::RemoteModule => {
                "Look at the modules of the other computer; its watchdog restarts them automatically."
            }
            Self::ClocksDiffer => "Synchronize the clocks of both computers, such as by chrony.",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fault_has_whole_sentences_that_fit_into_a_table() {
        for fault in Fault::ALL {
            let remedy = fault.what_to_do();
            assert!(remedy.starts_with(|c: char| c.is_ascii_uppercase()) && remedy.ends_with('.'), "{remedy}");
            assert!(!remedy.contains(['|', '{', '\n']) && !remedy.contains("  "), "{remedy}");
        }
    }
}
