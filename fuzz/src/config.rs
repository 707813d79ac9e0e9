use robot::config::{Config, ConfigError, parsed_world};
use settings::Node;
use std::path::Path;

/// A robot's file, an override, and an assignment of `--set`, separated by zero bytes.
///
/// A refusal has at least one line, and none of its lines is empty or broken.
pub fn config(data: &[u8]) {
    let Ok(texts) = std::str::from_utf8(data) else { return };
    let mut texts = texts.split('\0').chain(["", "", ""]);
    let [text, over, set] = std::array::from_fn(|_| texts.next().unwrap_or_default());
    let (tree, over) = (Node::parse(Path::new("robot.toml"), text), Node::parse(Path::new("sim.toml"), over));
    for refused in [&tree, &over].into_iter().filter_map(|tree| tree.as_ref().err()) {
        lines(refused);
    }
    let (Ok(mut tree), Ok(over)) = (tree, over) else { return };
    if let Err(ConfigError(refused)) = parsed_world(tree.clone(), Path::new("world.toml"), &[format!("world.{set}")]) {
        lines(&refused);
    }
    let modules = over.clone();
    tree.merge(over);
    if let Err(why) = tree.set(set) {
        lines(&[why]);
    }
    if let Err(ConfigError(refused)) = Config::check(&tree, &modules, true) {
        lines(&refused);
    }
}

fn lines(refused: &[String]) {
    assert!(!refused.is_empty(), "refused without a word");
    for line in refused {
        assert!(!line.is_empty() && !line.contains('\n'), "{line:?}");
    }
}
