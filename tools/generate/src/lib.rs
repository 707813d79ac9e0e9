//! Files of the repository that are made from its source, so that nobody copies them by hand:
//!
//! | file | source |
//! |---|---|
//! | `modules/web/page/src/protocol.ts` | the types that `web` serializes, and the message definitions |
//! | `modules/web/page/src/numbers.ts` | `base::Fault`, `messages::Hold` |
//! | `modules/web/page/src/units.ts` | the message definitions |
//! | `docs/faults.md`, `docs/holds.md`: the tables | the same |
//! | `docs/safety.md`: the hazards | `docs/safety.toml` |
//! | `docs/messages.md` | `messages::Channel`, the message definitions, the modules' sources |
//! | `packaging/ros2/advee_msgs` | `ros2::topics::OWN`, the message definitions |
//!
//! `make generate` writes them; the test `tests/current.rs` compares them with the repository.
//!
//! ```
//! use generate::{numbers, text};
//!
//! // A row of the table of `docs/faults.md`.
//! let table = numbers::faults();
//! assert!(table.lines().any(|row| row.starts_with("| 0x0701 | ChipLost | DEVICE |")));
//!
//! // A doc comment of Rust as one of TypeScript.
//! let plain = text::without_links("Set by [`Shell`](module::Shell), m/s.");
//! assert_eq!(text::comment(&plain, "  "), "  /** Set by `Shell`, m/s. */\n");
//! ```
#![forbid(unsafe_code)]

pub mod channels;
pub mod numbers;
pub mod protocol;
pub mod ros_package;
pub mod safety;
pub mod text;
pub mod traffic;
pub mod typescript;
pub mod units;

use std::borrow::Cow;
use std::fs;
use std::path::{Path, PathBuf};

/// A generated file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Output {
    /// Path below the root of the repository.
    pub path: Cow<'static, str>,
    /// The whole file.
    pub text: String,
}

/// Root of the repository.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("tools/generate is two folders deep").into()
}

/// All generated files of the repository at `root`.
///
/// # Errors
/// One line: a source that cannot be read, or has something that has no equivalent in a generated file.
pub fn outputs(root: &Path) -> Result<Vec<Output>, String> {
    let table = |path: &'static str, source: &str, rows: &str| {
        let text = text::between_marks(&read(root, path)?, source, rows).map_err(|error| format!("{path}: {error}"))?;
        Ok::<_, String>(Output { path: path.into(), text })
    };
    let schema = lcm_gen::Schema::new(messages::LCM_FILES).map_err(|error| error.to_string())?;
    let whole = |path: &'static str, text| Output { path: path.into(), text };
    let mut outputs = vec![
        whole("modules/web/page/src/protocol.ts", protocol::page(root, &schema)?),
        whole("modules/web/page/src/numbers.ts", numbers::page()),
        whole("modules/web/page/src/units.ts", units::page(&schema)?),
        table("docs/faults.md", "foundation/base/src/report.rs", &numbers::faults())?,
        table("docs/holds.md", "messages/src/hold.rs", &numbers::holds())?,
        table("docs/safety.md", safety::SOURCE, &safety::case(root)?)?,
        whole("docs/messages.md", channels::page(&schema, &traffic::Traffic::read(root)?)?),
    ];
    outputs.extend(ros_package::files(&schema)?);
    Ok(outputs)
}

/// A file of the repository.
fn read(root: &Path, path: &str) -> Result<String, String> {
    fs::read_to_string(root.join(path)).map_err(|error| format!("{path}: {error}"))
}

/// A Rust file of the repository.
fn parse(root: &Path, path: &str) -> Result<syn::File, String> {
    syn::parse_file(&read(root, path)?).map_err(|error| format!("{path}: {error}"))
}
