//! What the drives move.

use settings::settings;

settings! {
    /// What a drive moves.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Axis {
        /// The rear wheels.
        Propulsion = "propulsion",
        /// The front wheels' angle.
        Steering = "steering",
        /// The left wheel of a differential base.
        Left = "left",
        /// The right one.
        Right = "right",
        /// A wheel of a base with four.
        FrontLeft = "front_left",
        /// Another one.
        FrontRight = "front_right",
        /// Another one.
        RearLeft = "rear_left",
        /// Another one.
        RearRight = "rear_right",
        /// A wheel of an omni base.
        Wheel1 = "wheel_1",
        /// The next one counter-clockwise.
        Wheel2 = "wheel_2",
        /// The next one.
        Wheel3 = "wheel_3",
        /// The next one.
        Wheel4 = "wheel_4",
        /// The next one.
        Wheel5 = "wheel_5",
        /// The next one.
        Wheel6 = "wheel_6",
    }
}
