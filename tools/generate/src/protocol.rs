//! `modules/web/page/src/protocol.ts`: what the page and the robot's web server send each other.

use crate::text::{comment, doc, reflow};
use crate::typescript::{Export, Library};
use crate::{parse, text};
use lcm_gen::{Constant, Definition, Kind, Member, MemberType, Primitive, Schema, Size};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

const fn same(file: &'static str, name: &'static str) -> Export {
    Export { file, rust: name, page: name }
}

const fn renamed(file: &'static str, rust: &'static str, page: &'static str) -> Export {
    Export { file, rust, page }
}

/// The types of the page, in order. Messages follow: those that one of these refers to.
const SECTIONS: [(&str, &[Export]); 3] = [
    (
        "HTTP",
        &[
            same("modules/web/src/center/access.rs", "Role"),
            same("modules/web/src/center/pairing.rs", "Me"),
            same("modules/web/src/center/pairing.rs", "Pair"),
            same("modules/web/src/request.rs", "Refused"),
            same("modules/web/src/center/access.rs", "Device"),
            same("modules/web/src/center/pairing.rs", "Forget"),
            same("modules/web/src/center/pairing.rs", "Invite"),
            renamed("modules/web/src/logs.rs", "Run", "LogRun"),
            renamed("modules/web/src/logs.rs", "Listed", "LogFile"),
            same("modules/web/src/center/events.rs", "RunEvents"),
            same("modules/web/src/center/summaries.rs", "RunSummary"),
            same("modules/web/src/center/events.rs", "RunEvent"),
            same("modules/web/src/center/events.rs", "EventKind"),
        ],
    ),
    (
        "the view",
        &[
            renamed("modules/web/src/center/scene.rs", "Scene", "ScenePart"),
            same("modules/web/src/center/scene.rs", "Demo"),
            same("modules/web/src/center/authority.rs", "Limits"),
            same("modules/web/src/center/scene.rs", "Beam"),
            renamed("modules/web/src/center/scene.rs", "Beacon", "MapBeacon"),
            same("modules/web/src/center/scene.rs", "Route"),
            same("modules/web/src/center/scene.rs", "TemperatureLimit"),
            renamed("modules/web/src/center/scene.rs", "Drive", "DriveNode"),
            renamed("modules/web/src/center/scene.rs", "Faults", "TargetFaults"),
            same("modules/web/src/center/publish.rs", "Publishable"),
            same("modules/web/src/center/parts.rs", "DrivePart"),
            same("modules/web/src/center/parts.rs", "SensorsPart"),
            same("modules/web/src/center/parts.rs", "MapPart"),
            same("modules/web/src/center/parts.rs", "SystemPart"),
            same("modules/web/src/center/inspect.rs", "MessagePart"),
            same("modules/web/src/center/recent.rs", "RecentPart"),
            same("modules/web/src/center/recent.rs", "RecentRow"),
            same("modules/web/src/center/viewer.rs", "Watch"),
            same("modules/web/src/center/demo.rs", "Play"),
            same("modules/web/src/center/demo.rs", "Playing"),
            same("foundation/diagnostics/src/slot.rs", "Shown"),
            same("foundation/diagnostics/src/slot.rs", "Freshness"),
            same("foundation/diagnostics/src/status.rs", "Status"),
            renamed("foundation/diagnostics/src/status.rs", "RobotStatus", "StatusWord"),
            same("foundation/diagnostics/src/concerns.rs", "Concern"),
            same("foundation/diagnostics/src/concerns.rs", "Weight"),
            same("foundation/diagnostics/src/holds.rs", "HoldRow"),
            same("foundation/diagnostics/src/guard.rs", "Bound"),
            same("foundation/diagnostics/src/view.rs", "Ellipse"),
            same("foundation/diagnostics/src/scans.rs", "Scan"),
            same("modules/web/src/center/authority.rs", "Holder"),
            same("foundation/diagnostics/src/modules.rs", "ModuleRow"),
            renamed("foundation/diagnostics/src/errors.rs", "ShownGroup", "ErrorGroup"),
            same("modules/web/src/center/parts.rs", "Report"),
            renamed("foundation/diagnostics/src/texts.rs", "ShownText", "Text"),
            same("foundation/diagnostics/src/traffic.rs", "ChannelRow"),
        ],
    ),
    (
        "commands",
        &[
            same("modules/web/src/center/command.rs", "Command"),
            renamed("modules/web/src/center/command.rs", "WaypointRequest", "Waypoint"),
            same("modules/web/src/center/command.rs", "Answer"),
        ],
    ),
];
/// The Rust file whose comment opens the generated one.
const OVERVIEW: &str = "modules/web/src/center.rs";
/// The tag of the parts of the view.
const PART: &str = "part";

/// The file.
///
/// # Errors
/// One line: a source that cannot be read, or a type that has no equivalent.
pub fn page(root: &Path, schema: &Schema) -> Result<String, String> {
    let all = || SECTIONS.iter().flat_map(|(_, exports)| exports.iter());
    let mut files = BTreeMap::new();
    for export in all() {
        if !files.contains_key(export.file) {
            files.insert(export.file, parse(root, export.file)?);
        }
    }
    let exports: Vec<Export> = all().copied().collect();
    let packages = schema.definitions().iter().map(|definition| definition.package.clone());
    let library = Library::new(files, &exports, packages);
    let mut out = String::from(
        "// Generated by `make generate` from modules/web/src, foundation/diagnostics/src and messages: \
         do not edit.\n//\n",
    );
    for line in reflow(&doc(&parse(root, OVERVIEW)?.attrs), text::WIDTH - 3) {
        let _ = writeln!(out, "{}", format!("// {line}").trim_end());
    }
    for (title, exports) in SECTIONS {
        section(&mut out, title);
        for export in exports {
            let _ = write!(out, "\n{}", library.declaration(export)?);
        }
        let parts: Vec<&str> =
            exports.iter().filter(|export| library.has_tag(export, PART)).map(|export| export.page).collect();
        if !parts.is_empty() {
            let _ = write!(out, "\nexport type Part = {};\n", parts.join(" | "));
        }
    }
    section(&mut out, "messages");
    for definition in reached(schema, &library.used())? {
        let _ = write!(out, "\n{}", interface(schema, definition));
    }
    unique(&out)?;
    Ok(out)
}

fn section(out: &mut String, title: &str) {
    let _ = writeln!(out, "\n// {} {title}", "-".repeat(100));
}

/// Fails if a name is declared twice.
fn unique(page: &str) -> Result<(), String> {
    let mut seen = BTreeSet::new();
    let declared = page.lines().filter_map(|line| {
        let rest = line.strip_prefix("export interface ").or_else(|| line.strip_prefix("export type "))?;
        rest.split([' ', '<']).next()
    });
    match declared.into_iter().find(|name| !seen.insert(*name)) {
        Some(name) => Err(format!("protocol.ts: two types are called {name} (tools/generate/src/protocol.rs)")),
        None => Ok(()),
    }
}

/// Name of a type in Rust and on the page: `data_motion_t` is `DataMotion`.
#[must_use]
pub fn type_name(short: &str) -> String {
    let words = short.strip_suffix("_t").unwrap_or(short).split('_');
    words.map(|word| word[..1].to_uppercase() + &word[1..]).collect()
}

/// The definitions of these messages and of all types that they consist of, in order of the files.
fn reached<'a>(schema: &'a Schema, used: &BTreeSet<(String, String)>) -> Result<Vec<&'a Definition>, String> {
    let mut names = BTreeSet::new();
    for (package, name) in used {
        let mut all = schema.definitions().iter();
        let found = all.find(|definition| definition.package == *package && type_name(&definition.short) == *name);
        collect(schema, found.ok_or_else(|| format!("{package}::{name}: no message"))?, &mut names);
    }
    Ok(schema.definitions().iter().filter(|definition| names.contains(&definition.name())).collect())
}

fn collect(schema: &Schema, definition: &Definition, names: &mut BTreeSet<String>) {
    if names.insert(definition.name()) {
        members_types(schema, definition).for_each(|inner| collect(schema, inner, names));
    }
}

/// The definitions that members of this one have as their types.
pub fn members_types<'a>(schema: &'a Schema, definition: &'a Definition) -> impl Iterator<Item = &'a Definition> {
    definition.members().iter().filter_map(|member| match &member.ty {
        MemberType::Named(name) => schema.get(name),
        MemberType::Primitive(_) => None,
    })
}

/// True for the length of an array, which is not a member in Rust and JSON.
#[must_use]
pub fn is_length(member: &Member, members: &[Member]) -> bool {
    let is_of = |dim: &lcm_gen::Dim| dim.size == Size::Variable && dim.text == member.name;
    members.iter().any(|other| other.dims.iter().any(is_of))
}

/// The constants of a struct in groups, each with its comment: those that were declared together.
#[must_use]
pub fn constants(definition: &Definition) -> Vec<(String, Vec<&Constant>)> {
    let Kind::Struct { constants, .. } = &definition.kind else { return Vec::new() };
    let mut groups: Vec<(String, Vec<&Constant>)> = Vec::new();
    for constant in constants {
        let doc = constant.doc.join(" ");
        match groups.last_mut() {
            Some((known, group)) if doc.is_empty() || *known == doc => group.push(constant),
            _ => groups.push((doc, vec![constant])),
        }
    }
    groups
}

/// `STOP 0, START 1`.
#[must_use]
pub fn values(group: &[&Constant]) -> String {
    group.iter().map(|constant| format!("{} {}", constant.name, constant.text)).collect::<Vec<_>>().join(", ")
}

fn interface(schema: &Schema, definition: &Definition) -> String {
    let mut about = definition.doc.join("\n");
    for (doc, group) in constants(definition) {
        let _ = write!(about, "\n- {}: {doc}", values(&group));
    }
    let mut out = comment(&about, "");
    let _ = writeln!(out, "export interface {} {{", type_name(&definition.short));
    let members = definition.members();
    for member in members.iter().filter(|member| !is_length(member, members)) {
        let doc = comment(&member.doc.join("\n"), "  ");
        let _ = writeln!(out, "{doc}  {}: {};", member.name, member_type(schema, member));
    }
    out + "}\n"
}

/// Type of a member. A `double` may be `null`: any sender may put NaN into it.
fn member_type(schema: &Schema, member: &Member) -> String {
    let element = match &member.ty {
        MemberType::Primitive(Primitive::Boolean) => "boolean".to_owned(),
        MemberType::Primitive(Primitive::String) => "string".to_owned(),
        MemberType::Primitive(Primitive::Float | Primitive::Double) => "number | null".to_owned(),
        MemberType::Primitive(_) => "number".to_owned(),
        MemberType::Named(name) => schema.get(name).map_or_else(|| name.clone(), |named| type_name(&named.short)),
    };
    match member.dims.len() {
        0 => element,
        dims if element.contains(' ') => format!("({element}){}", "[]".repeat(dims)),
        dims => format!("{element}{}", "[]".repeat(dims)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "package lowlevel;
// A bus.
struct data_bus_t
{
    // States.
    const int8_t OK = 0, LOST = 1;
    // Microseconds.
    int64_t timestamp;
    int32_t count;
    // Nodes.
    node_t nodes[count];
    double covariance[3][3];
}
struct node_t { string name; double load; boolean on; byte data[2]; }
struct other_t { int8_t a; }
";

    #[test]
    fn messages_have_no_lengths_and_null_for_what_is_no_number() {
        let schema = Schema::new(&[("a.lcm", TEXT)]).unwrap();
        let used = BTreeSet::from([("lowlevel".to_owned(), "DataBus".to_owned())]);
        let text: String =
            reached(&schema, &used).unwrap().into_iter().map(|definition| interface(&schema, definition)).collect();
        let expected = "/**
 * A bus.
 * - OK 0, LOST 1: States.
 */
export interface DataBus {
  /** Microseconds. */
  timestamp: number;
  /** Nodes. */
  nodes: Node[];
  covariance: (number | null)[][];
}
export interface Node {
  name: string;
  load: number | null;
  on: boolean;
  data: number[];
}
";
        assert_eq!(text, expected);
        assert!(reached(&schema, &BTreeSet::from([("lowlevel".to_owned(), "None".to_owned())])).is_err());
    }

    #[test]
    fn a_name_is_declared_once() {
        assert!(unique("export interface A {\nexport type B =\nexport interface C<T> {").is_ok());
        assert!(unique("export interface A<T> {\nexport type A =").is_err());
    }
}
