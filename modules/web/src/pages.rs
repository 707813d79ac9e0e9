//! Pages for reading: instructions for Foxglove, its layout, the state of the server.

use super::app::App;
use super::center::authority;
use super::stats;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{Html, IntoResponse};
use serde::Serialize;
use serde_json::{Value, json};

/// Layout for import into Foxglove.
const LAYOUT: &str = include_str!("../../../conf/foxglove/advee.json");
/// Template of the page with placeholders `{…}`.
const PAGE: &str = include_str!("foxglove.html");

/// `/foxglove-help`
pub async fn index(State(app): State<App>, headers: HeaderMap) -> impl IntoResponse {
    // The name that the client used will work again.
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let page = PAGE
        .replace("{robot}", &escaped(&app.robot))
        .replace("{version}", env!("CARGO_PKG_VERSION"))
        .replace("{host}", &escaped(host));
    Html(page)
}

/// `/layout.json`
pub async fn layout(State(app): State<App>) -> impl IntoResponse {
    let headers = [
        (header::CONTENT_TYPE, "application/json"),
        (header::CONTENT_DISPOSITION, "attachment; filename=\"advee.json\""),
    ];
    (headers, with_scans(app.hub().names()))
}

/// The layout with the lidars among these topics in its scene: their names are the robot's own.
fn with_scans<'a>(topics: impl Iterator<Item = &'a str>) -> String {
    let Ok(mut layout) = serde_json::from_str::<Value>(LAYOUT) else { return LAYOUT.to_string() };
    for scan in topics.filter(|topic| topic.starts_with("/scan/")) {
        // Without a field Foxglove takes the intensities for colors.
        layout["configById"]["3D!advee"]["topics"][scan] = json!({
            "visible": true, "colorField": "range", "colorMode": "flat", "flatColor": "#0369a1ff", "pointSize": 4,
        });
    }
    layout.to_string()
}

/// State of the server; counters since its start.
#[derive(Serialize)]
struct Health<'a> {
    robot: &'a str,
    version: &'static str,
    uptime_s: f64,
    topics: usize,
    viewers: usize,
    messages: Messages,
    /// Number of messages of the bus that did not reach the server.
    bus_lost: u32,
    /// Number of failed reads from the bus.
    bus_broken: u32,
    /// Messages without a ROS 2 form: of an unknown type, or malformed.
    untranslated: u32,
    refused: stats::Counts,
    /// Commands of pages.
    commands: authority::Counts,
}

#[derive(Serialize)]
struct Messages {
    published: u64,
    queued: u64,
    dropped: u64,
    too_long: u64,
    too_many: u64,
}

/// `/health`
pub async fn health(State(app): State<App>) -> impl IntoResponse {
    let health = serde_json::to_string(&look(&app)).unwrap_or_default();
    ([(header::CONTENT_TYPE, "application/json")], health)
}

fn look(app: &App) -> Health<'_> {
    let hub = app.hub();
    let counts = hub.counts();
    Health {
        robot: &app.robot,
        version: env!("CARGO_PKG_VERSION"),
        uptime_s: app.started.elapsed().as_secs_f64(),
        topics: hub.topics(),
        viewers: hub.viewers(),
        messages: Messages {
            published: counts.published,
            queued: counts.queued,
            dropped: counts.dropped,
            too_long: counts.too_long,
            too_many: counts.too_many,
        },
        bus_lost: app.bus.lost(),
        bus_broken: app.bus.broken(),
        untranslated: app.bus.untranslated(),
        refused: app.stats.counts(),
        commands: app.command_queue.counts(),
    }
}

/// Escapes a text for the page, attributes included.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_text_is_escaped() {
        assert_eq!(escaped("<a href='x'>&\"</a>"), "&lt;a href=&#39;x&#39;&gt;&amp;&quot;&lt;/a&gt;");
    }

    #[test]
    fn the_layout_is_json() {
        let layout: Value = serde_json::from_str(LAYOUT).unwrap();
        assert!(layout["configById"].is_object() && !layout["layout"].is_null());
    }

    #[test]
    fn the_layout_shows_the_lidars_that_the_robot_has() {
        let layout: Value = serde_json::from_str(&with_scans(["/scene", "/scan/top"].into_iter())).unwrap();
        let before: Value = serde_json::from_str(LAYOUT).unwrap();
        let topics = |layout: &Value| layout["configById"]["3D!advee"]["topics"].as_object().unwrap().clone();
        assert_eq!(topics(&layout)["/scan/top"]["visible"], true);
        assert_eq!(topics(&layout).len(), topics(&before).len() + 1, "nothing else");
    }
}
