//! The table of what works with whom, in `docs/lcm.md` between two markers.

use crate::official::root;
use crate::types::DEFECTS;
use std::fmt::Write as _;
use std::fs;

/// Where the table begins and ends in the page.
const MARKERS: [&str; 2] = ["<!-- interop: written by foundation/lcm/tests/interop -->\n", "<!-- interop end -->"];

/// What a peer's library cannot do.
pub const LIMITS: [&str; 3] = [
    "the Java library keeps the kernel's receive buffer of 208 KiB, which three fragments in a row fill",
    "the Java library reads no event without a payload",
    "the bus class in C#, `examples/modules/csharp/Lcm.cs`, is ours: UDPM only, and no logs",
];

/// What was found of one case with one peer. What was not found fails the test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// From us to the peer and from the peer to us.
    Both,
    /// From the peer to us; the other way not, by the place of the reason in [`LIMITS`].
    From(usize),
    /// Both ways, but for what the reason says.
    Partly(usize),
    /// Not with this peer, likewise.
    Limit(usize),
    /// It works.
    Good,
    /// A defect of the peer, by its place in [`DEFECTS`].
    Defect(usize),
}

/// Rows and what stands there.
pub type Cells = Vec<(String, Mark)>;

/// One peer.
pub struct Column {
    /// Its name and version.
    pub name: String,
    /// Whether it was had.
    pub there: bool,
    /// What was found with it.
    pub cells: Cells,
}

impl Column {
    fn cell(&self, row: &str) -> String {
        let mark = self.cells.iter().find(|(name, _)| name == row).map(|(_, mark)| mark);
        match mark {
            Some(Mark::Both) => "→ ←".into(),
            Some(Mark::Good) => "✓".into(),
            Some(Mark::From(number)) => format!("← ({})", DEFECTS.len() + number + 1),
            Some(Mark::Partly(number)) => format!("→ ← ({})", DEFECTS.len() + number + 1),
            Some(Mark::Limit(number)) => format!("({})", DEFECTS.len() + number + 1),
            Some(Mark::Defect(number)) => format!("({})", number + 1),
            None => String::new(),
        }
    }
}

/// Holds the table in the page against what was found, or writes it anew when `LCM_INTEROP_BLESS` is set.
pub fn check(columns: &[Column]) {
    let path = root().join("docs/lcm.md");
    let page = fs::read_to_string(&path).unwrap();
    let (before, rest) = page.split_once(MARKERS[0]).expect("the page has the first marker");
    let (written, after) = rest.split_once(MARKERS[1]).expect("the page has the second marker");
    let found = markdown(columns);
    if std::env::var_os("LCM_INTEROP_BLESS").is_some() {
        assert!(columns.iter().all(|column| column.there), "not without all peers");
        fs::write(&path, format!("{before}{}{found}{}{after}", MARKERS[0], MARKERS[1])).unwrap();
        return;
    }
    let there: Vec<&str> = columns.iter().filter(|column| column.there).map(|column| column.name.as_str()).collect();
    let (written, found) = (only(written, &there), only(&found, &there));
    assert!(
        written == found,
        "docs/lcm.md says\n{written}\nand this run found\n{found}\n(LCM_INTEROP_BLESS=1 writes it)"
    );
}

/// All rows that any column has, in the order in which they first come.
fn rows(columns: &[Column]) -> Vec<&str> {
    let mut rows: Vec<&str> = Vec::new();
    for (row, _) in columns.iter().flat_map(|column| &column.cells) {
        if !rows.contains(&row.as_str()) {
            rows.push(row);
        }
    }
    rows
}

fn markdown(columns: &[Column]) -> String {
    let mut text = String::from("| |");
    columns.iter().for_each(|column| write!(text, " {} |", column.name).unwrap());
    text.push_str("\n|---|");
    columns.iter().for_each(|_| text.push_str("---|"));
    for row in rows(columns) {
        write!(text, "\n| {row} |").unwrap();
        columns.iter().for_each(|column| write!(text, " {} |", column.cell(row)).unwrap());
    }
    text.push_str("\n\n");
    let reasons = DEFECTS.iter().map(|defect| defect.reason).chain(LIMITS);
    for (number, reason) in reasons.enumerate() {
        writeln!(text, "({}) {reason}.  ", number + 1).unwrap();
    }
    text
}

/// The table with these columns only, without rows that have nothing in them, and what stands below it.
fn only(table: &str, names: &[&str]) -> String {
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_string()).collect::<Vec<_>>();
    let head = cells(table.lines().next().unwrap_or_default());
    let wanted = |column: usize| column == 0 || names.contains(&head[column].as_str());
    let mut lines = Vec::new();
    for line in table.lines() {
        if !line.starts_with('|') {
            lines.push(line.to_string());
            continue;
        }
        let kept: Vec<_> =
            cells(line).into_iter().enumerate().filter(|(n, _)| wanted(*n)).map(|(_, cell)| cell).collect();
        if kept[1..].iter().any(|cell| !cell.is_empty()) {
            lines.push(kept.join(" | "));
        }
    }
    lines.join("\n")
}
