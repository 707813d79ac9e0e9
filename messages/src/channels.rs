//! Table of channels and their types.

use std::borrow::Cow;
use std::ops::Deref;

use lcm::codec::{DecodeError, EncodeError, Reader, Type, Writer};
use serde::Serialize;

use crate::{common, highlevel, lowlevel, middlelevel, simulation};

macro_rules! channels {
    ($($variant:ident = $name:literal: $type:ty;)*) => {
        /// Channel of the robot.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Channel {
            $(#[doc = concat!("`", $name, "`")] $variant,)*
        }

        impl Channel {
            /// All channels.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// Name on the bus; for the family `LL_DATA_RAW_<BUS>` the common prefix. [`Message::channel_name`] is the
            /// name under which a message is published.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }

            /// Name of the type with its package: `common.data_state_t`.
            #[must_use]
            pub const fn type_name(self) -> &'static str {
                match self { $(Self::$variant => <$type>::NAME),* }
            }

            /// Fingerprint of the type.
            #[must_use]
            pub const fn fingerprint(self) -> u64 {
                match self { $(Self::$variant => <$type>::FINGERPRINT),* }
            }

            /// Maximum size of a message that a module of this robot accepts, bytes: of the types without arrays 4 KiB,
            /// which leaves room for texts, of the others 256 KiB.
            #[must_use]
            pub const fn size_max(self) -> usize {
                const SMALL: usize = 4 << 10;
                const LARGE: usize = 256 << 10;
                match self {
                    Self::CmDataState
                    | Self::CmCmdState
                    | Self::CmEventError
                    | Self::CmEventText
                    | Self::CmCmdLevel
                    | Self::CmDataLevel
                    | Self::LlDataOdo
                    | Self::LlDataScanner
                    | Self::LlCmdMotion
                    | Self::LlDataMotion
                    | Self::LlCmdVelocity
                    | Self::LlDataVelocity
                    | Self::LlCmdCreep
                    | Self::LlCmdHoming
                    | Self::LlCmdPower
                    | Self::LlCmdOutput
                    | Self::LlEventStop
                    | Self::MlDataEstimate
                    | Self::MlCmdEstimate
                    | Self::MlCmdBeaconUse
                    | Self::MlCmdMode
                    | Self::MlDataMode
                    | Self::MlCmdParameter
                    | Self::HlDataAction
                    | Self::SimDataTruth
                    | Self::SimCmdFault
                    | Self::SimDataClock
                    | Self::SimCmdClock
                    | Self::SimCmdRun
                    | Self::CmCmdLog
                    | Self::CmDataLog
                    | Self::CmDataBridge => SMALL,
                    _ => LARGE,
                }
            }

            fn from_full_name(name: &str) -> Option<Self> {
                match name {
                    $($name => Some(Self::$variant),)*
                    _ => None,
                }
            }
        }

        /// Message of the robot: the variant is the channel. Serialized it is the message alone.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[serde(untagged)]
        pub enum Message {
            $(#[doc = concat!("On `", $name, "`.")] $variant($type),)*
        }

        impl Message {
            /// Channel of the message.
            #[must_use]
            pub const fn channel(&self) -> Channel {
                match self { $(Self::$variant(_) => Channel::$variant),* }
            }

            /// Timestamp, microseconds since the UNIX epoch.
            #[must_use]
            pub fn timestamp(&self) -> i64 {
                match self { $(Self::$variant(message) => message.timestamp),* }
            }

            /// Appends the encoded message to `out`.
            ///
            /// # Errors
            /// The message cannot be represented in LCM: a string contains NUL, or arrays that share a length differ in
            /// theirs. `out` is then unchanged.
            pub fn encode(&self, out: &mut Vec<u8>) -> Result<(), EncodeError> {
                match self { $(Self::$variant(message) => message.encode(out)),* }
            }

            /// Decodes a message received on `channel`. The bus of a raw frame is only in the channel's full name:
            /// [`Message::receive`] sets it, here [`Raw::bus`] stays empty.
            ///
            /// # Errors
            /// `bytes` is not exactly one message of the channel's type.
            pub fn decode(channel: Channel, bytes: &[u8]) -> Result<Self, DecodeError> {
                match channel { $(Channel::$variant => <$type>::decode(bytes).map(Self::$variant)),* }
            }
        }

        $(impl From<$type> for Message {
            fn from(message: $type) -> Self {
                Self::$variant(message)
            }
        })*
    };
}

channels! {
    CmDataState = "CM_DATA_STATE": common::DataState;
    CmCmdState = "CM_CMD_STATE": common::CmdState;
    CmEventError = "CM_EVENT_ERROR": common::Error;
    CmDataFaults = "CM_DATA_FAULTS": common::DataFaults;
    CmEventText = "CM_EVENT_TEXT": common::EventText;
    CmCmdLevel = "CM_CMD_LEVEL": common::CmdLevel;
    CmDataLevel = "CM_DATA_LEVEL": common::DataLevel;
    CmDataProcesses = "CM_DATA_PROCESSES": common::DataProcesses;
    CmCmdLog = "CM_CMD_LOG": common::CmdLog;
    CmDataLog = "CM_DATA_LOG": common::DataLog;
    CmDataBridge = "CM_DATA_BRIDGE": common::DataBridge;
    LlDataOdo = "LL_DATA_ODO": lowlevel::DataOdo;
    LlDataSrfs = "LL_DATA_SRFS": lowlevel::DataSrfs;
    LlDataIrs = "LL_DATA_IRS": lowlevel::DataIrs;
    LlDataRanges = "LL_DATA_RANGES": lowlevel::DataRanges;
    LlDataScan = "LL_DATA_SCAN": lowlevel::DataScan;
    LlDataImu = "LL_DATA_IMU": lowlevel::DataImu;
    LlDataBeacons = "LL_DATA_BEACONS": lowlevel::DataBeacons;
    LlDataScanner = "LL_DATA_SCANNER": lowlevel::DataScanner;
    LlDataActiveBeacons = "LL_DATA_ACTIVE_BEACONS": lowlevel::DataActiveBeacons;
    LlCmdMotion = "LL_CMD_MOTION": lowlevel::CmdMotion;
    LlDataMotion = "LL_DATA_MOTION": lowlevel::DataMotion;
    LlCmdVelocity = "LL_CMD_VELOCITY": lowlevel::CmdVelocity;
    LlDataVelocity = "LL_DATA_VELOCITY": lowlevel::DataVelocity;
    LlDataGuard = "LL_DATA_GUARD": lowlevel::DataGuard;
    LlCmdCreep = "LL_CMD_CREEP": lowlevel::CmdCreep;
    LlDataAxes = "LL_DATA_AXES": lowlevel::DataAxes;
    LlDataWheels = "LL_DATA_WHEELS": lowlevel::DataWheels;
    LlDataHold = "LL_DATA_HOLD": lowlevel::DataHold;
    LlCmdHoming = "LL_CMD_HOMING": lowlevel::CmdHoming;
    LlCmdPower = "LL_CMD_POWER": lowlevel::CmdPower;
    LlDataPower = "LL_DATA_POWER": lowlevel::DataPower;
    LlEventStop = "LL_EVENT_STOP": lowlevel::EventStop;
    LlDataTemperature = "LL_DATA_TEMPERATURE": lowlevel::DataTemperature;
    LlCmdOutput = "LL_CMD_OUTPUT": lowlevel::CmdOutput;
    LlDataIo = "LL_DATA_IO": lowlevel::DataIo;
    LlDataBattery = "LL_DATA_BATTERY": lowlevel::DataBattery;
    LlCmdNodeIo = "LL_CMD_NODE_IO": lowlevel::CmdNodeIo;
    LlDataNodeIo = "LL_DATA_NODE_IO": lowlevel::DataNodeIo;
    LlDataBus = "LL_DATA_BUS": lowlevel::DataBus;
    LlDataRaw = "LL_DATA_RAW_": Raw;
    LlCmdSdo = "LL_CMD_SDO": lowlevel::CmdSdo;
    LlDataSdo = "LL_DATA_SDO": lowlevel::DataSdo;
    LlDataJoydev = "LL_DATA_JOYDEV": lowlevel::DataJoydev;
    MlDataEstimate = "ML_DATA_ESTIMATE": middlelevel::DataEstimate;
    MlCmdEstimate = "ML_CMD_ESTIMATE": middlelevel::CmdEstimate;
    MlDataBeaconUse = "ML_DATA_BEACON_USE": middlelevel::DataBeaconUse;
    MlCmdBeaconUse = "ML_CMD_BEACON_USE": middlelevel::CmdBeaconUse;
    MlCmdGoal = "ML_CMD_GOAL": middlelevel::CmdGoal;
    MlDataGoal = "ML_DATA_GOAL": middlelevel::DataGoal;
    MlDataPlan = "ML_DATA_PLAN": middlelevel::DataPlan;
    MlDataObstacles = "ML_DATA_OBSTACLES": middlelevel::DataObstacles;
    MlDataPersons = "ML_DATA_PERSONS": middlelevel::DataPersons;
    MlCmdMode = "ML_CMD_MODE": middlelevel::CmdMode;
    MlDataMode = "ML_DATA_MODE": middlelevel::DataMode;
    MlCmdParameter = "ML_CMD_PARAMETER": middlelevel::CmdParameter;
    MlDataParameters = "ML_DATA_PARAMETERS": middlelevel::DataParameters;
    HlCmdAction = "HL_CMD_ACTION": highlevel::CmdAction;
    HlDataAction = "HL_DATA_ACTION": highlevel::DataAction;
    SimDataTruth = "SIM_DATA_TRUTH": simulation::DataTruth;
    SimCmdFault = "SIM_CMD_FAULT": simulation::CmdFault;
    SimDataClock = "SIM_DATA_CLOCK": simulation::DataClock;
    SimCmdClock = "SIM_CMD_CLOCK": simulation::CmdClock;
    SimCmdRun = "SIM_CMD_RUN": simulation::CmdRun;
    SimDataRun = "SIM_DATA_RUN": simulation::DataRun;
    SimDataPeople = "SIM_DATA_PEOPLE": simulation::DataPeople;
}

impl Channel {
    /// Channel of this name on the bus; `LL_DATA_RAW_` followed by any bus is [`Channel::LlDataRaw`].
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name.strip_prefix(Self::LlDataRaw.name()) {
            Some("") => None,
            Some(_bus) => Some(Self::LlDataRaw),
            None => Self::from_full_name(name),
        }
    }
}

impl Message {
    /// Name of the channel under which the message is published.
    #[must_use]
    pub fn channel_name(&self) -> Cow<'static, str> {
        match self {
            Self::LlDataRaw(raw) => Cow::Owned(format!("{}{}", Channel::LlDataRaw.name(), raw.bus)),
            other => Cow::Borrowed(other.channel().name()),
        }
    }

    /// Decodes a message received on the channel of this name; `None` if the channel is not one of the robot's.
    ///
    /// # Errors
    /// `bytes` is not exactly one message of the channel's type.
    #[must_use]
    pub fn receive(channel_name: &str, bytes: &[u8]) -> Option<Result<Self, DecodeError>> {
        let channel = Channel::from_name(channel_name)?;
        let mut message = Self::decode(channel, bytes);
        if let Ok(Self::LlDataRaw(raw)) = &mut message {
            raw.bus = channel_name[channel.name().len()..].to_owned();
        }
        Some(message)
    }
}

/// Raw frame with its bus, which is not part of the message but of the channel's name, `LL_DATA_RAW_<BUS>`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Raw {
    /// Bus as in the channel's name: upper case.
    #[serde(skip)]
    pub bus: String,
    /// Message.
    pub frame: lowlevel::DataRaw,
}

impl Deref for Raw {
    type Target = lowlevel::DataRaw;

    fn deref(&self) -> &Self::Target {
        &self.frame
    }
}

impl Type for Raw {
    const FINGERPRINT: u64 = lowlevel::DataRaw::FINGERPRINT;
    const NAME: &'static str = lowlevel::DataRaw::NAME;
    const MIN_SIZE: usize = lowlevel::DataRaw::MIN_SIZE;

    fn body_size(&self) -> usize {
        self.frame.body_size()
    }

    fn encode_body(&self, w: &mut Writer<'_>) -> Result<(), EncodeError> {
        self.frame.encode_body(w)
    }

    fn decode_body(r: &mut Reader<'_>) -> Result<Self, DecodeError> {
        Ok(Self { bus: String::new(), frame: Type::decode_body(r)? })
    }
}
