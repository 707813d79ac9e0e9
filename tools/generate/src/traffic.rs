//! Publishers and receivers of each message, as far as the sources tell.
//!
//! A module publishes a message if its code, tests left out, builds one; it receives the channels that it lists in
//! `subscriptions`.

use crate::{parse, protocol};
use messages::Channel;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use syn::visit::{self, Visit};
use syn::{Attribute, Expr, ExprPath, ExprStruct, ImplItemFn, ItemFn, ItemImpl, ItemMod, Meta};

/// Modules, and the place of each: a file, the folder of the same name, or both.
const MODULES: [(&str, &str); 17] = [
    ("`driver_canbus`", "modules/drivers/src/canbus"),
    ("`driver_rs485a`", "modules/drivers/src/rs485a"),
    ("`driver_rs485b`", "modules/drivers/src/rs485b"),
    ("`driver_power`", "modules/drivers/src/power"),
    ("`driver_aux`", "modules/drivers/src/auxiliary"),
    ("`driver_joydev`", "modules/drivers/src/joydev"),
    ("`driver_io`", "modules/drivers/src/io"),
    ("`driver_lidar`", "modules/drivers/src/lidar"),
    ("`driver_imu`", "modules/drivers/src/imu"),
    ("`guard`", "modules/guard/src"),
    ("`estimator`", "modules/estimator/src"),
    ("`planner`", "modules/planner/src"),
    ("`watchdog`", "modules/watchdog/src"),
    ("`logger`", "modules/logger/src"),
    ("`simulator`", "modules/simulator/src"),
    ("`ros2`", "modules/ros2/src"),
    ("`bridge`", "modules/bridge/src"),
];
/// Stands for all modules.
const EVERY: &str = "every module";
/// Tools of operators.
const TERMINAL: &str = "command line";
const PAGE: &str = "web page";
/// Simulation in virtual time on a bus.
const PACED: &str = "`advee up --speed`";
/// Messages that it receives, by their channels.
const PACED_RECEIVES: [&str; 2] = ["SimCmdClock", "SimCmdRun"];
/// Code that several publishers share: the place, and their names. A place inside another one is not part of that one.
const SHARED: [(&str, &[&str]); 8] = [
    ("modules/drivers/src/line", &["`driver_rs485a`", "`driver_rs485b`", "`driver_power`"]),
    ("foundation/module/src", &[EVERY]),
    ("foundation/module/src/holds", &["`driver_canbus`", "`planner`"]),
    ("host/src", &["host"]),
    ("cli/src", &[TERMINAL]),
    ("cli/src/up/paced", &[PACED]),
    ("modules/web/src", &[PAGE]),
    ("foundation/diagnostics/src", &[TERMINAL, PAGE]),
];

/// Programs outside this source that take part in virtual time, and what they publish, by its type.
const STEPPING: (&str, &str) = ("programs in step", "CmdClock");
/// Stands for programs outside this source that offer actions (docs/highlevel.md).
const OFFERING: &str = "modules that offer actions";
/// Message that they receive, by its channel, and message that they publish, by its type.
const OFFERED: (&str, &str) = ("HlCmdAction", "DataAction");

/// Publishers and receivers of the messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    publishers: BTreeMap<String, Vec<String>>,
    receivers: BTreeMap<String, Vec<String>>,
}

/// Messages in a file.
#[derive(Default)]
struct Found {
    /// Names of structs that are constructed.
    built: BTreeSet<String>,
    /// Variants of `Channel` in functions called `subscriptions`.
    subscribed: BTreeSet<String>,
    in_subscriptions: bool,
}

impl Traffic {
    /// From the sources of the repository.
    ///
    /// # Errors
    /// One line: a source that cannot be read, or a channel without a publisher.
    pub fn read(root: &Path) -> Result<Self, String> {
        let mut traffic = Self::default();
        let own = MODULES.iter().map(|(name, place)| (*place, std::slice::from_ref(name)));
        for (place, names) in own.chain(SHARED) {
            let inner = SHARED.iter().map(|(other, _)| *other).filter(|other| other.starts_with(&format!("{place}/")));
            let inner: Vec<String> = inner.map(|other| format!("{other}.rs")).collect();
            for path in files(root, place)?.into_iter().filter(|path| !inner.contains(path)) {
                let file = parse(root, &path)?;
                names.iter().for_each(|name| traffic.add(name, &file));
            }
        }
        let (received, published) = OFFERED;
        for (map, key) in [(&mut traffic.receivers, received), (&mut traffic.publishers, published)] {
            map.entry(key.into()).or_default().push(OFFERING.into());
        }
        for channel in PACED_RECEIVES {
            traffic.receivers.entry(channel.into()).or_default().push(PACED.into());
        }
        let (stepping, published) = STEPPING;
        traffic.publishers.entry(published.into()).or_default().push(stepping.into());
        for channel in Channel::ALL {
            if traffic.publishers(*channel).is_empty() {
                return Err(format!("{}: no publisher found (tools/generate/src/traffic.rs)", channel.name()));
            }
        }
        Ok(traffic)
    }

    /// Adds the messages that a file publishes and receives, under this name.
    pub fn add(&mut self, name: &str, file: &syn::File) {
        let mut found = Found::default();
        found.visit_file(file);
        for (map, keys) in [(&mut self.publishers, found.built), (&mut self.receivers, found.subscribed)] {
            for key in keys {
                let names = map.entry(key).or_default();
                if !names.iter().any(|known| known == name) {
                    names.push(name.to_owned());
                }
            }
        }
    }

    /// Publishers of a channel.
    #[must_use]
    pub fn publishers(&self, channel: Channel) -> Vec<&str> {
        let short = channel.type_name().rsplit('.').next().unwrap_or_default();
        listed(self.publishers.get(&protocol::type_name(short)))
    }

    /// Receivers of a channel.
    #[must_use]
    pub fn receivers(&self, channel: Channel) -> Vec<&str> {
        listed(self.receivers.get(&format!("{channel:?}")))
    }
}

/// Names in order, without those of modules where every module is among them.
fn listed(names: Option<&Vec<String>>) -> Vec<&str> {
    let names = || names.into_iter().flatten().map(String::as_str);
    let all = names().any(|name| name == EVERY);
    names().filter(|name| !all || !MODULES.iter().any(|(module, _)| module == name)).collect()
}

impl<'ast> Visit<'ast> for Found {
    fn visit_item_mod(&mut self, item: &'ast ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_impl(&mut self, item: &'ast ItemImpl) {
        if !is_test(&item.attrs) {
            visit::visit_item_impl(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast ItemFn) {
        if !is_test(&item.attrs) {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast ImplItemFn) {
        let before = self.in_subscriptions;
        self.in_subscriptions |= item.sig.ident == "subscriptions";
        visit::visit_impl_item_fn(self, item);
        self.in_subscriptions = before;
    }

    fn visit_expr_struct(&mut self, item: &'ast ExprStruct) {
        // A changed copy of a received message is not a new message.
        let is_copy = item.rest.as_ref().is_some_and(|rest| !matches!(**rest, Expr::Call(_)));
        if let Some(last) = item.path.segments.last().filter(|_| !is_copy) {
            self.built.insert(last.ident.to_string());
        }
        visit::visit_expr_struct(self, item);
    }

    fn visit_expr_path(&mut self, item: &'ast ExprPath) {
        let names: Vec<String> = item.path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        if let [.., channel, variant] = &names[..]
            && self.in_subscriptions
            && channel == "Channel"
        {
            self.subscribed.insert(variant.clone());
        }
    }
}

/// True for `#[cfg(test)]`.
fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| match &attribute.meta {
        Meta::List(list) => list.path.is_ident("cfg") && list.tokens.to_string() == "test",
        _ => false,
    })
}

/// Rust files of a place, those of tests left out: paths below the root, in order.
fn files(root: &Path, place: &str) -> Result<Vec<String>, String> {
    let file = format!("{place}.rs");
    let mut found = Vec::new();
    if root.join(&file).is_file() {
        found.push(file);
    }
    if root.join(place).is_dir() {
        below(root, place, &mut found)?;
    }
    match found.is_empty() {
        true => Err(format!("{place}: no Rust file (tools/generate/src/traffic.rs)")),
        false => Ok(found),
    }
}

fn below(root: &Path, folder: &str, found: &mut Vec<String>) -> Result<(), String> {
    let wrong = |error: std::io::Error| format!("{folder}: {error}");
    let mut names = Vec::new();
    for entry in fs::read_dir(root.join(folder)).map_err(wrong)? {
        names.push(entry.map_err(wrong)?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    let is_test = |name: &str| {
        let stem = name.trim_end_matches(".rs");
        ["tests", "testing", "bench"].contains(&stem) || stem.ends_with("_tests")
    };
    for name in names.iter().filter(|name| !is_test(name)) {
        let path = format!("{folder}/{name}");
        if root.join(&path).is_dir() {
            below(root, &path, found)?;
        } else if name.ends_with(".rs") {
            found.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_module_stands_for_each() {
        let mut traffic = Traffic::default();
        let file = syn::parse_file("fn f() { DataState {}; }").unwrap();
        for name in ["`planner`", EVERY, PAGE] {
            traffic.add(name, &file);
        }
        assert_eq!(traffic.publishers(Channel::CmDataState), [EVERY, PAGE]);
    }

    #[test]
    fn constructing_a_message_is_publishing_it_except_in_tests_and_copies() {
        let text = "
            impl Module for One {
                fn subscriptions(&self) -> &[Channel] { &[Channel::LlCmdMotion, messages::Channel::LlEventStop] }
                fn turn(&self, out: &mut Actions) {
                    if self.last == Channel::LlDataOdo {
                        out.publish(lowlevel::DataMotion { timestamp, ..Default::default() });
                    }
                    let lowlevel::DataAxes { axes, .. } = other;
                    let again = CmdSdo { data, ..request.clone() };
                }
            }
            #[cfg(test)]
            mod tests { fn f() { DataBus { a: 1 }; } }";
        let mut traffic = Traffic::default();
        traffic.add("one", &syn::parse_file(text).unwrap());
        traffic.add("one", &syn::parse_file("fn f() -> DataMotion { DataMotion { a: 1 } }").unwrap());
        for channel in Channel::ALL {
            let (publishes, receives) = (traffic.publishers(*channel), traffic.receivers(*channel));
            assert_eq!(publishes == ["one"], *channel == Channel::LlDataMotion, "{channel:?}: {publishes:?}");
            let received = [Channel::LlCmdMotion, Channel::LlEventStop].contains(channel);
            assert_eq!(receives == ["one"], received, "{channel:?}: {receives:?}");
        }
    }
}
