//! Which rows a view lists, in which order, and what each is known by while they move.

use super::app::{App, Tab};
use super::runs::Run;
use base::Instant;
use diagnostics::{ChannelRow, ErrorGroup, ModuleRow, ShownGroup, Slot};
use messages::lowlevel::{DataBus, Node};
use std::cmp::Reverse;

/// A bus, or one of its nodes.
#[derive(Clone, Copy)]
pub enum BusRow<'a> {
    Bus(&'a Slot<DataBus>, &'a DataBus),
    Node(&'a Slot<DataBus>, &'a DataBus, &'a Node),
}

impl BusRow<'_> {
    fn key(&self) -> String {
        match self {
            Self::Bus(_, bus) => bus.bus.clone(),
            Self::Node(_, bus, node) => format!("{}/{}", bus.bus, node.name),
        }
    }
}

pub fn modules(app: &App, now: Instant) -> Vec<ModuleRow> {
    let (model, at) = app.shown(now);
    let mut rows = model.modules(at);
    rows.retain(|row| app.lists(&row.module));
    match app.order() {
        "trouble first" => rows.sort_by_key(|row| (row.well, !row.critical)),
        "cpu" => rows.sort_by(|one, other| other.cpu.total_cmp(&one.cpu)),
        "memory" => rows.sort_by_key(|row| Reverse(row.rss)),
        "restarts" => rows.sort_by_key(|row| Reverse(row.restarts)),
        "name" => rows.sort_by(|one, other| one.module.cmp(&other.module)),
        _ => {}
    }
    rows
}

pub fn buses(app: &App, now: Instant) -> Vec<BusRow<'_>> {
    let mut rows = Vec::new();
    for slot in app.shown(now).0.buses() {
        let Some(bus) = slot.get() else { continue };
        let whole = app.lists(&bus.bus);
        let nodes = bus.nodes.iter().filter(|node| whole || app.lists(&node.name));
        let nodes: Vec<_> = nodes.map(|node| BusRow::Node(slot, bus, node)).collect();
        if whole || !nodes.is_empty() {
            rows.push(BusRow::Bus(slot, bus));
            rows.extend(nodes);
        }
    }
    rows
}

pub fn errors(app: &App, now: Instant) -> Vec<ShownGroup<'_>> {
    let (model, at) = app.shown(now);
    let mut rows = model.errors.groups(at);
    rows.retain(|group| [&group.module, &group.subject, &group.message].into_iter().any(|text| app.lists(text)));
    match app.order() {
        "latest" => rows.sort_by_key(|group| Reverse(group.last)),
        "count" => rows.sort_by_key(|group| Reverse(group.count)),
        _ => {}
    }
    rows
}

pub fn channels(app: &App, now: Instant) -> Vec<ChannelRow> {
    let (model, at) = app.shown(now);
    let mut rows = model.traffic.rows(at);
    rows.retain(|row| app.lists(&row.channel));
    match app.order() {
        "rate" => rows.sort_by(|one, other| other.rate.total_cmp(&one.rate)),
        "bytes" => rows.sort_by(|one, other| other.bandwidth.total_cmp(&one.bandwidth)),
        _ => {}
    }
    rows
}

pub fn runs(app: &App) -> Vec<&Run> {
    app.runs.all().iter().filter(|run| app.lists(&run.name)).collect()
}

/// Key of an error.
pub fn error_key(group: &ErrorGroup) -> String {
    format!("{}/{}/{}", group.module, group.number, group.subject)
}

/// Keys of this view's rows, in order.
pub fn keys(app: &App, now: Instant) -> Vec<String> {
    match app.tab {
        Tab::Overview => Vec::new(),
        Tab::Modules => modules(app, now).into_iter().map(|row| row.module).collect(),
        Tab::Buses => buses(app, now).iter().map(BusRow::key).collect(),
        Tab::Errors => errors(app, now).iter().map(|group| error_key(group)).collect(),
        Tab::Messages => channels(app, now).into_iter().map(|row| row.channel).collect(),
        Tab::Logs => runs(app).into_iter().map(|run| run.name.clone()).collect(),
    }
}
