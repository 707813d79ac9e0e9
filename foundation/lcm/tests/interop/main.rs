//! Both ways with what others wrote: the official C library 1.5.3 and 1.3.1 from C and C++, the Python package,
//! `lcm-gen`, `lcm-logger` and `lcm-logplayer`. What is found is the table in `docs/lcm.md`: the test holds the two
//! together, and `LCM_INTEROP_BLESS=1` writes the table anew.
//!
//! `make test` gets the peers: 1.5.3 into `.venv`, 1.3.1 into `.peers`; the variable `ADVEE_PYTHON` names another
//! Python. The columns of a peer that is skipped are not checked.
#![cfg(feature = "live")]
#![allow(clippy::disallowed_methods, reason = "real sockets, files and processes")]
#![allow(clippy::unwrap_used, reason = "a test's helpers may panic too")]

mod cases;
#[path = "../common.rs"]
mod common;
mod logs;
mod official;
mod peer;
mod table;
mod types;
#[path = "../../../lcm-gen/tests/vectors/generated.rs"]
#[rustfmt::skip]
#[allow(dead_code, reason = "a peer needs no constants")]
mod vectors;

use cases::cases;
use official::{Language, Official};
use peer::{Both, Serving};
use std::thread;
use table::{Cells, Column, Mark};
use types::Built;

#[test]
fn the_table_in_the_documentation_is_what_this_run_finds() {
    let found = official::VERSIONS.map(|version| Official::find(version, "table"));
    let mut columns = Vec::new();
    // The compilers run side by side; what goes over sockets goes one peer after the other.
    thread::scope(|scope| {
        let mut built = Vec::new();
        for (version, official) in official::VERSIONS.into_iter().zip(&found) {
            for &language in Language::of(version) {
                let name = format!("{language} {version}");
                let there = official.as_ref().filter(|_| language.find().is_some());
                built.push((language, name, there.map(|it| scope.spawn(move || types::build(it, language)))));
            }
        }
        for (language, name, built) in built {
            let built = built.map(|thread| thread.join().unwrap());
            let there = built.is_some();
            columns.push(Column {
                cells: built.map(|built| peer_cells(language, &name, &built)).unwrap_or_default(),
                name,
                there,
            });
        }
    });
    for (version, official) in official::VERSIONS.into_iter().zip(&found) {
        let (name, there) = (format!("lcm-logger, lcm-logplayer {version}"), official.is_some());
        columns.push(Column { name, there, cells: official.as_ref().map(logs::tools).unwrap_or_default() });
    }
    table::check(&columns);
}

/// What is found with one peer.
fn peer_cells(language: Language, name: &str, built: &Built) -> Cells {
    let mut both = Both::start(name, built, peer::urls().map(Into::into));
    let mut cells = Cells::new();
    for case in cases() {
        if language == Language::Java && case.name.contains("MiB") {
            both.raw_from(&case);
            cells.push((case.name, Mark::From(0)));
            continue;
        }
        both.raw(&case);
        cells.push((case.name, Mark::Both));
    }
    for (name, defect) in &built.types {
        if defect.is_none() {
            both.typed(name);
        }
        cells.push((format!("type `{name}`"), defect.map_or(Mark::Both, Mark::Defect)));
    }
    both.end();
    cells.push(("`messages/*.lcm` by the official `lcm-gen`".into(), Mark::Good));

    let over_tcpq = "all these messages over TCPQ and our hub";
    if language == Language::CSharp {
        cells.extend([over_tcpq, logs::ROW].map(|row| (row.into(), Mark::Limit(2))));
        return cells;
    }
    let hub = Serving::hub();
    let mut both = Both::start(name, built, [hub.url.clone(), hub.url.clone()]);
    cases().iter().for_each(|case| both.raw(case));
    both.end();
    cells.push((over_tcpq.into(), Mark::Both));

    let java = language == Language::Java;
    logs::copied(&built.program, !java);
    cells.push((logs::ROW.into(), if java { Mark::Partly(1) } else { Mark::Both }));
    cells
}
