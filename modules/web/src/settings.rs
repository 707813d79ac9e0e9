//! `[web]`: where the robot's web server is reached, and by whom.

use ::settings::Table;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

/// `[web]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Web {
    /// True if the robot starts it, where `modules.toml` lists it; default true. `advee up --headless` says false.
    pub enabled: bool,
    /// Where it listens; default 127.0.0.1:8080. Any other than a loopback address needs `token_file`.
    pub listen: SocketAddr,
    /// Names by which browsers may call it, besides `localhost` and the address that they reached; default none.
    pub hosts: Vec<String>,
    /// Where pages of others may come from that connect to it; default [`ORIGINS`].
    pub origins: Vec<String>,
    /// As many viewers at once, 1..=100; default 20.
    pub viewers: u16,
    /// The file with the credentials that each request must bring, from the configuration folder on; none: whoever
    /// reaches the loopback address may look.
    pub token_file: Option<PathBuf>,
}

/// Foxglove in a browser and on the desktop.
pub const ORIGINS: [&str; 2] = ["https://app.foxglove.dev", "file://"];

impl Default for Web {
    fn default() -> Self {
        Self {
            enabled: true,
            listen: (Ipv4Addr::LOCALHOST, 8080).into(),
            hosts: Vec::new(),
            origins: ORIGINS.map(String::from).into(),
            viewers: 20,
            token_file: None,
        }
    }
}

impl Web {
    /// Reads the table; problems are added to its list.
    pub fn read(mut table: Table<'_>) -> Self {
        let default = Self::default();
        let listen = table.text("listen", Some(&default.listen.to_string()));
        let listen = listen.parse().unwrap_or_else(|_| {
            table.refuse("listen", "an address and port as \"127.0.0.1:8080\" or \"[::1]:8080\"");
            default.listen
        });
        let token_file = table.has("token_file").then(|| table.text("token_file", None).into());
        if !listen.ip().is_loopback() && token_file.is_none() {
            table.refuse("listen", "a loopback address, or web.token_file beside it");
        }
        let hosts = table.texts("hosts");
        if !hosts.iter().all(|host| is_host(host)) {
            table.refuse("hosts", "names as \"advee.local\", without a port");
        }
        let origins = if table.has("origins") { table.texts("origins") } else { default.origins };
        if !origins.iter().all(|origin| is_origin(origin)) {
            table.refuse("origins", "origins as \"https://app.foxglove.dev\", without a path");
        }
        let enabled = table.boolean("enabled", default.enabled);
        let viewers = table.integer("viewers", Some(default.viewers), 1..=100);
        table.end();
        Self { enabled, listen, hosts, origins, viewers, token_file }
    }
}

/// A name as in a request, lower case.
fn is_host(name: &str) -> bool {
    let of_a_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || ".-_".contains(c);
    name.len() <= 253 && name.chars().all(of_a_name)
}

/// An origin as browsers send it; "null", which any page can send, is not accepted.
fn is_origin(origin: &str) -> bool {
    let Some((scheme, authority)) = origin.split_once("://") else { return false };
    let graphic = |text: &str| text.chars().all(|c| c.is_ascii_graphic() && !c.is_ascii_uppercase());
    !scheme.is_empty() && origin.len() <= 300 && graphic(origin) && !authority.contains(['/', '*', ',', '"'])
}
