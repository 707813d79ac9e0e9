//! The same files, parsed by this project and by python-canopen.

use crate::support::{python, workspace};
use canopen::dictionary::{Access, DataType};
use canopen::eds::{Eds, Object, Setting};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::Command;

const NODE: u8 = 5;

fn files() -> Vec<PathBuf> {
    let folders = ["buses/canopen/eds", "buses/canopen/eds/others", "advee/tests/it/canopen_peers"];
    let entries = folders.iter().flat_map(|folder| std::fs::read_dir(workspace().join(folder)).into_iter().flatten());
    let paths = entries.map(|entry| entry.expect("a folder to read").path());
    let mut files: Vec<_> = paths.filter(|path| path.extension().is_some_and(|e| e == "eds" || e == "dcf")).collect();
    files.sort();
    files
}

fn access(access: Access) -> &'static str {
    match access {
        Access::Const => "const",
        Access::ReadOnly => "ro",
        Access::WriteOnly => "wo",
        Access::ReadWrite => "rw",
        Access::ReadWriteTransmit => "rwr",
        Access::ReadWriteReceive => "rww",
    }
}

/// Object in the form of `eds.py`; numbers only.
fn shown(object: &Object) -> Value {
    let number = |setting: &Option<Setting>| {
        let whole = object.data_type.width().is_some() && !matches!(object.data_type, DataType::F32 | DataType::F64);
        setting.as_ref().filter(|_| whole).map(|setting| setting.number(object.data_type, NODE))
    };
    json!([
        object.index,
        object.sub,
        object.data_type.code(),
        access(object.access),
        object.mappable,
        number(&object.default),
        number(&object.parameter),
    ])
}

#[test]
fn eds_and_dcf_files_are_parsed_like_by_python_canopen() {
    let Some(python) = python() else { return };
    let files = files();
    let output = Command::new(python)
        .arg(workspace().join("advee/tests/it/canopen_peers/eds.py"))
        .arg(NODE.to_string())
        .args(&files)
        .output()
        .unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{err}");
    let theirs: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(theirs.len(), files.len());
    let mut compared = 0;
    for (file, theirs) in files.iter().zip(&theirs) {
        let bytes = std::fs::read(file).unwrap();
        let compact = String::from_utf8_lossy(&bytes).contains("CompactSubObj");
        let eds = Eds::parse(&bytes).unwrap_or_else(|why| panic!("{}: {why}", file.display()));
        let Some(theirs) = theirs.as_array() else { continue };
        for their in theirs {
            let key = (their[0].as_u64().unwrap() as u16, their[1].as_u64().unwrap() as u8);
            // Data types have their own indices; in python-canopen they are dummy objects.
            let Some(ours) = (key.0 >= 0x1000).then(|| eds.object(key.0, key.1)) else { continue };
            let ours = ours.unwrap_or_else(|| panic!("{}: {their} is missing", file.display()));
            let mut ours = shown(ours);
            // A value that python-canopen cannot parse ("0x-80000000") is not compared.
            (5..7).filter(|at| their[*at].is_null()).for_each(|at| ours[at] = Value::Null);
            // Sub-index 0 of a compact array cannot be written (CiA 306-1); in python-canopen it can.
            if key.1 == 0 && compact {
                ours[3] = their[3].clone();
            }
            assert_eq!(&ours, their, "{}", file.display());
            compared += 1;
        }
    }
    println!("{compared} objects compared");
    assert!(compared > 400, "{compared} objects only");
}
