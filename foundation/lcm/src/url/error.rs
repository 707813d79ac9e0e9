//! What is odd or wrong in a URL.

use core::fmt;

/// An option that changes nothing. One line for people by `Display`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Warning {
    /// Unknown option of this provider.
    Unknown {
        /// The option, with its value.
        option: String,
        /// Known options.
        known: &'static str,
    },
    /// LCM once had this option.
    Obsolete(String),
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { option, known: "" } => {
                write!(f, "LCM URL: unknown option `{option}` ignored; this provider has none")
            }
            Self::Unknown { option, known } => {
                write!(f, "LCM URL: unknown option `{option}` ignored; known are {known}")
            }
            Self::Obsolete(option) => write!(f, "LCM URL: option `{option}` is obsolete and ignored"),
        }
    }
}

/// Why a URL was refused. One line for people by `Display`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UrlError {
    /// No known provider at the start.
    Provider(String),
    /// The group is not an IPv4 multicast address. Host names are not resolved.
    Group(String),
    /// The hub is not an IPv4 address. Host names are not resolved.
    Address(String),
    /// The port is not 1..=65535.
    Port(String),
    /// Invalid network part: present where none is allowed, or absent.
    Network {
        /// Network part found.
        network: String,
        /// Network part allowed.
        allowed: &'static str,
    },
    /// The value of an option is not in its range.
    Value {
        /// The option.
        key: &'static str,
        /// Value found.
        value: String,
        /// Values allowed.
        allowed: &'static str,
    },
}

impl fmt::Display for UrlError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Provider(url) => {
                write!(f, "LCM URL `{url}`: starts with none of udpm://, tcpq://, memq://, file://")
            }
            Self::Group(group) => {
                write!(f, "LCM URL: `{group}` is not an IPv4 multicast address (224.0.0.0 to 239.255.255.255)")
            }
            Self::Address(address) => write!(f, "LCM URL: `{address}` is not an IPv4 address; names are not resolved"),
            Self::Port(port) => write!(f, "LCM URL: port `{port}` is not within 1 to 65535"),
            Self::Network { network, allowed } => write!(f, "LCM URL: `{network}` where {allowed} must stand"),
            Self::Value { key, value, allowed } => write!(f, "LCM URL: {key}=`{value}`; allowed is {allowed}"),
        }
    }
}

impl core::error::Error for UrlError {}
