//! What the macro declares, read from texts.

use crate::{
    Blank, Bytes, Choice, Entry, Form, Moves, Need, Node, Off, Parsed, Row, Rows, Rule, Section, Span, Table, Texts,
};
use crate::{ZeroOr, read_as, settings};
use base::Duration;
use std::path::{Path, PathBuf};

settings! {
    /// Colours.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum Colour {
        /// Of tomatoes.
        Red = "red",
        /// Of the sea.
        Blue = "blue",
    }
}

settings! {
    /// `[stick]`
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Stick {
        /// Share of its way.
        dead_zone: f64 = 0.1, 0.0..=0.9;
        /// Its greatest demand, m/s.
        limit_mps was limit: Option<f64> = optional, 0.01..=10.0;
    }
}

settings! {
    /// The keys of `fast` nodes.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Fast {
        /// Turns.
        gear: f64 = required, -1000.0..=1000.0;
    }
}

settings! {
    /// The keys of `slow` nodes.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Slow {
        /// Longest time, s.
        timeout_s as timeout: Duration = 15.0, 1.0..=120.0;
    }
}

settings! {
    /// What a node is.
    #[derive(Clone, Debug, PartialEq)]
    pub enum Drive by driver {
        /// A fast one.
        Fast(Fast) = "fast",
        /// A slow one.
        Slow(Slow) = "slow",
    }
}

settings! {
    /// `[[bus.<name>.nodes]]`
    #[derive(Clone, Debug, PartialEq)]
    pub struct Item {
        /// Address.
        id: u8 = required, 1..=127;
        /// What reports call it.
        name: String = derived format!("node_{id:02x}");
        drive: Drive = flat;
        /// How often it is asked, Hz.
        rate_hz was rate: f64 = 1.0, 0.1..=100.0;
    }
}

settings! {
    /// `[bus.<name>]`
    #[derive(Clone, Debug, PartialEq)]
    pub struct Bus {
        name: String = key;
        /// Frames are published.
        raw: bool = false;
        /// Period of SYNC, s; 0: none.
        sync_s as sync: Option<Duration> = None, Off(ZeroOr(0.001..=10.0));
        /// Its nodes.
        nodes: Vec<Item> = [];
    }
    check Bus::check;
}

impl Bus {
    fn check(&self, table: &Table<'_>) {
        let ids: Vec<u8> = self.nodes.iter().map(|node| node.id).collect();
        table.unique("nodes", "id", &ids, "one that no other node has");
    }
}

fn vowel(text: &str) -> Option<char> {
    text.parse().ok().filter(|letter| "aeiou".contains(*letter))
}

settings! {
    /// A whole file.
    #[derive(Clone, Debug, PartialEq)]
    pub struct File {
        /// What it is called.
        title: String = "untitled";
        /// Where it lies.
        folder: PathBuf = "/tmp";
        /// Size, B.
        size_bytes: u64 = 256_000_000, Bytes(1e6..=1e9);
        /// Shade.
        colour: Colour = Colour::Blue;
        /// Loudness.
        volume: i8 = 3, Choice(&[("low", 1), ("high", 3)]);
        /// A letter.
        letter: char = 'a', Parsed(vowel, "a vowel", "a");
        /// Processors.
        cpus: Vec<u16> = [], 0..=7;
        /// Words.
        words: Vec<String> = ["one", "two"];
        /// Sticks.
        stick was joystick: Stick = table;
        /// Another.
        other: Option<Stick> = optional;
        /// Buses.
        bus: Vec<Bus> = named;
        /// A key that is a word of the language.
        loop as looped: bool = true;
    }
}

fn parse(text: &str) -> Node {
    Node::parse(Path::new("f.toml"), text).expect("good TOML")
}

fn moves() -> Moves {
    Moves::of(&Rows::of::<File>())
}

fn read(text: &str) -> Result<File, Vec<String>> {
    read_as(&parse(text)).map_err(|error| error.0)
}

#[track_caller]
fn refused(text: &str, lines: &[&str]) {
    assert_eq!(read(text).unwrap_err(), lines);
}

#[test]
fn what_is_left_out_has_its_default() {
    let file = read("").unwrap();
    assert_eq!(file, File::usual());
    assert_eq!((file.title.as_str(), file.folder), ("untitled", PathBuf::from("/tmp")));
    assert_eq!((file.size_bytes, file.colour, file.volume), (256_000_000, Colour::Blue, 3));
    assert_eq!((file.letter, file.cpus, file.looped), ('a', vec![], true));
    assert_eq!(file.words, ["one", "two"]);
    assert_eq!(file.stick, Stick { dead_zone: 0.1, limit_mps: None });
    assert_eq!((file.other, file.bus), (None, vec![]));
}

#[test]
fn what_is_written_is_read() {
    let text = "title = \"t\"\nfolder = \"x\"\nsize_bytes = 2e6\ncolour = \"red\"\nvolume = \"low\"\nletter = \"u\"\ncpus = [1, 7]\n\
                words = []\nloop = false\nstick = { dead_zone = 0 }\nother.limit_mps = 2\n\
                [bus.main]\nraw = true\nsync_s = 0.5\n\
                nodes = [{ id = 1, driver = \"fast\", gear = -3 }, { id = 0x7f, name = \"n\", driver = \"slow\", rate_hz = 4 }]";
    let file = read(text).unwrap();
    assert_eq!((file.title.as_str(), file.folder.to_str(), file.size_bytes), ("t", Some("x"), 2_000_000));
    assert_eq!((file.colour, file.volume, file.letter, file.looped), (Colour::Red, 1, 'u', false));
    assert_eq!((file.cpus, file.words), (vec![1, 7], vec![]));
    assert_eq!((file.stick.dead_zone, file.other.unwrap().limit_mps), (0.0, Some(2.0)));
    let bus = &file.bus[0];
    assert_eq!((bus.name.as_str(), bus.raw, bus.sync), ("main", true, Some(Duration::from_millis(500))));
    let fast = Item { id: 1, name: "node_01".into(), drive: Drive::Fast(Fast { gear: -3.0 }), rate_hz: 1.0 };
    let slow = Drive::Slow(Slow { timeout: Duration::from_secs(15) });
    assert_eq!(bus.nodes, [fast, Item { id: 127, name: "n".into(), drive: slow, rate_hz: 4.0 }]);
    assert_eq!((bus.nodes[1].drive.name(), Colour::Red.name(), Colour::ALL.len()), ("slow", "red", 2));
    assert_eq!(read("[bus.b]\nsync_s = 0").unwrap().bus[0].sync, None);
}

#[test]
fn what_is_wrong_is_named_with_its_line_and_what_is_allowed() {
    refused(
        "title = \"\"\nsize_bytes = 1\ncolour = \"green\"\nvolume = 1\nletter = \"x\"\ncpus = [8]\nwords = [1]\nloop = 1",
        &[
            "f.toml:1: title = \"\": expected a text",
            "f.toml:2: size_bytes = 1: expected a number from 1000000 to 1000000000",
            "f.toml:3: colour = \"green\": expected \"red\" or \"blue\"",
            "f.toml:4: volume = 1: expected \"low\" or \"high\"",
            "f.toml:5: letter = \"x\": expected a vowel",
            "f.toml:6: cpus = [1 items]: expected a list of integers from 0 to 7",
            "f.toml:7: words = [1 items]: expected a list of texts",
            "f.toml:8: loop = 1: expected true or false",
        ],
    );
    refused(
        "stick = 1\n[bus]\nmain = 1\n[bus.b]\nsync_s = 20\nnodes = 1\nspeed = 1",
        &[
            "f.toml:1: stick = 1: expected a table",
            "f.toml:3: bus.main = 1: expected a table",
            "f.toml:5: bus.b.sync_s = 20: expected 0, or a number from 0.001 to 10",
            "f.toml:6: bus.b.nodes = 1: expected a list of tables",
            "f.toml:7: bus.b.speed: unknown key, expected one of raw, sync_s, nodes",
        ],
    );
}

#[test]
fn the_keys_of_a_node_are_those_of_its_driver() {
    refused(
        "[bus.b]\nnodes = [\n{ id = 1, driver = \"fast\", timeout_s = 3 },\n{ id = 2, driver = \"fats\", gear = 1 },\n]",
        &[
            "f.toml:3: bus.b.nodes[0].gear: missing, expected a number from -1000 to 1000",
            "f.toml:3: bus.b.nodes[0].timeout_s: unknown key, expected one of id, name, driver, gear, rate_hz",
            "f.toml:4: bus.b.nodes[1].driver = \"fats\": expected \"fast\" or \"slow\"",
        ],
    );
}

#[test]
fn of_each_key_the_first_error_is_told_and_stand_ins_collide_with_nothing() {
    let node = |id: &str| format!("{{ id = {id}, driver = \"slow\" }},\n");
    refused(
        &format!("[bus.b]\nnodes = [\n{}{}{}{}]", node("0"), node("1"), node("200"), node("1")),
        &[
            "f.toml:3: bus.b.nodes[0].id = 0: expected an integer from 1 to 127",
            "f.toml:5: bus.b.nodes[2].id = 200: expected an integer from 1 to 127",
            "f.toml:6: bus.b.nodes[3].id = 1: expected one that no other node has",
        ],
    );
}

#[test]
fn old_names_are_read_in_files_and_overrides() {
    let mut found = Vec::new();
    let text = "joystick = { limit = 2 }\n[bus.b]\nnodes = [{ id = 1, driver = \"slow\", rate = 5 }]";
    let mut node = parse(text);
    moves().rename(&mut node, &mut found).unwrap();
    for set in ["joystick.dead_zone=0.5", "bus.b.nodes.node=1", "bus.b.nodes.0={rate=7}", "other={limit=3}"] {
        let result = moves().set(&mut node, set, &mut found);
        assert_eq!(result.is_err(), set.contains("node="), "{set}: {result:?}");
    }
    let file: File = read_as(&node).unwrap();
    assert_eq!(file.stick, Stick { dead_zone: 0.5, limit_mps: Some(2.0) });
    assert_eq!((file.bus[0].nodes[0].rate_hz, file.other.unwrap().limit_mps), (7.0, Some(3.0)));
    let names: Vec<String> =
        found.iter().map(|moved| format!("{}: {} {}", moved.origin, moved.old, moved.new)).collect();
    let files = ["f.toml:1: joystick stick", "f.toml:1: limit limit_mps", "f.toml:3: rate rate_hz"];
    assert_eq!(
        names,
        [&files[..], &["--set: joystick stick", "--set: rate rate_hz", "--set: limit limit_mps"]].concat()
    );
}

#[test]
fn a_key_under_both_names_is_refused() {
    let mut node = parse("stick = {}\njoystick = { limit = 1, limit_mps = 2 }");
    let error = moves().rename(&mut node, &mut Vec::new()).unwrap_err();
    assert_eq!(error.0, ["f.toml:2: joystick: the old name of stick, which is there, too"]);
    let mut node = parse("joystick = { limit = 1, limit_mps = 2 }");
    let error = moves().rename(&mut node, &mut Vec::new()).unwrap_err();
    assert_eq!(error.0, ["f.toml:1: limit: the old name of limit_mps, which is there, too"]);
}

#[test]
fn a_file_is_given_the_new_names_and_keeps_all_else() {
    let old = "# the joystick\n[ joystick ]  # old\ndead_zone = 0.2\nlimit = 1        # m/s\n\n[bus.b]\nnodes = [\n    { id = 1, \
               driver = \"slow\", \"rate\" = 5 }, # rate\n]\n[[bus.c.nodes]]\nid = 1\ndriver = \"slow\"\nrate = 4 # Hz\n";
    let new = "# the joystick\n[ stick ]     # old\ndead_zone = 0.2\nlimit_mps = 1    # m/s\n\n[bus.b]\nnodes = [\n    { id = 1, \
               driver = \"slow\", rate_hz = 5 }, # rate\n]\n[[bus.c.nodes]]\nid = 1\ndriver = \"slow\"\nrate_hz = 4 # Hz\n";
    let path = Path::new("f.toml");
    assert_eq!(moves().migrate(path, old).unwrap(), new);
    assert_eq!(moves().migrate(path, new).unwrap(), new);
    let headings = "[joystick]\n[bus.b]\n[joystick.x]\n";
    assert_eq!(moves().migrate(path, headings).unwrap(), "[stick]\n[bus.b]\n[stick.x]\n");
    assert!(moves().migrate(path, "joystick = ").is_err());
}

#[test]
fn the_rows_say_what_the_declaration_says() {
    let rows = Rows::of::<File>();
    let row = |name: &str| rows.iter().find(|row| row.name() == name).unwrap_or_else(|| panic!("{name}"));
    let size = row("size_bytes");
    assert_eq!((size.expected.as_str(), size.unit()), ("a number from 1000000 to 1000000000", "B"));
    assert_eq!((&size.need, size.about.as_str()), (&Need::Default("256000000".into()), "Size, B."));
    assert_eq!(
        (row("colour").need.clone(), row("words").need.clone()),
        (Need::Default("\"blue\"".into()), Need::Default("[\"one\", \"two\"]".into()))
    );
    assert_eq!((row("stick").was, row("stick.limit_mps").was), (Some("joystick"), Some("limit")));
    assert_eq!((row("stick.limit_mps").unit(), &row("other.limit_mps").need), ("m/s", &Need::Optional));
    assert_eq!((row("bus.<name>.nodes[].gear").only, row("bus.<name>.nodes[].id").only), ("fast", ""));
    assert_eq!(row("bus.<name>.nodes[].driver").about, "`fast`: A fast one. `slow`: A slow one.");
    assert_eq!(
        (&row("bus.<name>.nodes[].name").need, &row("loop").need),
        (&Need::Derived, &Need::Default("true".into()))
    );
    assert_eq!(row("bus.<name>.sync_s").need, Need::Default("0".into()));
    let names: std::collections::BTreeSet<String> = rows.iter().map(Row::name).collect();
    assert_eq!(names.len(), rows.len(), "each key has one row");
}

#[test]
fn the_page_has_a_section_for_each_table() {
    let page = crate::markdown(&Rows::of::<File>());
    for line in [
        "| `size_bytes` | B | a number from 1000000 to 1000000000 | `256000000` | Size, B. |",
        "### `[stick]`",
        "| `limit_mps` | m/s | a number from 0.01 to 10 | – | Its greatest demand, m/s. (was `limit`) |",
        "### `[bus.<name>]`",
        "### `[[bus.<name>.nodes]]`",
        "| `id` |  | an integer from 1 to 127 | required | Address. |",
        "| `gear` |  | a number from -1000 to 1000 | required | `fast`: Turns. |",
    ] {
        assert!(page.lines().any(|found| found == line), "{line}\n{page}");
    }
}

settings! {
    /// Values of the rarer rules.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Rare {
        /// A device; an empty text for none.
        device: Option<PathBuf> = None, Blank;
        /// Who.
        targets: Vec<String> = required, Texts("a list of names");
        /// How long, s.
        span_s as span: (f64, f64) = (1.0, 2.5), Span(0.0..=10.0);
        /// First and last letter.
        ends: String = String::new(), Form(ends, "a text of two letters", "\"az\"", |_| {});
        /// Not in files.
        place: u8 = unset 7;
        /// Fifteen degrees, rad.
        turn_rad: f64 = 15f64.to_radians(), 0.0..=1.0;
    }
}

fn ends(entry: &Entry<'_>) -> Option<String> {
    let text: String = ().accept(&entry.node.value).filter(|text: &String| text.len() == 2).unwrap_or_default();
    if text.is_empty() {
        entry.refuse("a text of two letters");
    }
    Some(text)
}

#[test]
fn rarer_rules_accept_what_they_say() {
    let read = |text: &str| read_as::<Rare>(&parse(text)).map_err(|error| error.0);
    let rare = read("device = \"\"\ntargets = [\"a\"]\nspan_s = 3\nends = \"xy\"").unwrap();
    assert_eq!((rare.device, rare.span, rare.ends.as_str(), rare.place), (None, (3.0, 3.0), "xy", 7));
    let rare = read("device = \"d\"\ntargets = [\"a\"]\nspan_s = [0, 4.5]").unwrap();
    assert_eq!((rare.device, rare.span), (Some("d".into()), (0.0, 4.5)));
    assert_eq!(
        read("device = 1\ntargets = []\nspan_s = [2, 1]\nends = 3\nplace = 1").unwrap_err(),
        [
            "f.toml:1: device = 1: expected a text",
            "f.toml:2: targets = [0 items]: expected a list of names",
            "f.toml:3: span_s = [2 items]: expected a number from 0 to 10, or a list of two, the lesser first",
            "f.toml:4: ends = 3: expected a text of two letters",
            "f.toml:5: place: unknown key, expected one of device, targets, span_s, ends, turn_rad",
        ]
    );
    let rows = Rows::of::<Rare>();
    let defaults: Vec<&Need> = rows.iter().map(|row| &row.need).collect();
    let given = |text: &str| Need::Default(text.into());
    let expected = [given("\"\""), Need::Required, given("[1, 2.5]"), given("\"az\""), given("0.261799")];
    assert_eq!(defaults, expected.iter().collect::<Vec<_>>());
}

#[test]
fn a_notice_names_the_first_place_and_the_number_of_others() {
    let mut found = Vec::new();
    let text = "joystick = { limit = 2 }\n[bus.b]\nnodes = [{ rate = 5 }, { rate = 4 },\n{ rate = 3 }]";
    moves().rename(&mut parse(text), &mut found).unwrap();
    let known = "is the old name of";
    assert_eq!(
        crate::notices(&found),
        [
            format!("f.toml:1: joystick {known} stick; advee config migrate renames it"),
            format!("f.toml:1: limit {known} limit_mps; advee config migrate renames it"),
            format!("f.toml:3: rate {known} rate_hz, also in 2 other places; advee config migrate renames it"),
        ]
    );
}
