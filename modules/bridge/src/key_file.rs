//! File with the key of a connection: 64 hexadecimal digits, readable by its owner alone.

use crate::auth::{KEY_LEN, Key, NONCE_LEN};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

/// Maximum length of a file that is read, bytes.
const FILE_MAX: u64 = 256;

/// Reads a key file.
///
/// # Errors
/// One line: the file cannot be read, others than its owner have permissions, or it holds no key.
pub fn read(path: &Path) -> Result<Key, String> {
    let named = |why: String| format!("{}: {why}", path.display());
    let file = File::open(path).map_err(|error| named(error.to_string()))?;
    // Of the file that is open, whatever its name leads to by now.
    let about = file.metadata().map_err(|error| named(error.to_string()))?;
    if !about.is_file() {
        return Err(named("not a regular file".into()));
    }
    if about.mode() & 0o077 != 0 {
        let mode = about.mode() & 0o777;
        return Err(named(format!("mode {mode:04o}: only its owner may read a key (chmod 600)")));
    }
    let mut text = String::new();
    file.take(FILE_MAX).read_to_string(&mut text).map_err(|error| named(error.to_string()))?;
    Key::parse(&text).ok_or_else(|| named("no key: expected 64 hexadecimal digits (advee bridge key)".into()))
}

/// Writes a new random key to a file that does not exist yet, of mode 0600.
///
/// # Errors
/// One line: the file exists, or cannot be written, or the kernel provides no random bytes.
pub fn create(path: &Path) -> Result<(), String> {
    let named = |error: std::io::Error| format!("{}: {error}", path.display());
    let key = Key::new(random::<KEY_LEN>()?);
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path).map_err(named)?;
    writeln!(file, "{}", key.to_text()).and_then(|()| file.sync_all()).map_err(named)
}

/// A nonce that was never used before.
///
/// # Errors
/// One line: the kernel provides no random bytes.
pub fn nonce() -> Result<[u8; NONCE_LEN], String> {
    random()
}

fn random<const N: usize>() -> Result<[u8; N], String> {
    let mut bytes = [0; N];
    let drawn = File::open("/dev/urandom").and_then(|mut chance| chance.read_exact(&mut bytes));
    drawn.map_err(|error| format!("/dev/urandom: {error}"))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_key_is_made_once_and_read_while_nobody_else_may() {
        let path = std::env::temp_dir().join(format!("advee-bridge-key-{}", std::process::id()));
        let _ = fs::remove_file(&path);
        create(&path).unwrap();
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o600);
        let key = read(&path).unwrap();
        assert!(create(&path).is_err(), "a key is not replaced");
        assert_eq!(read(&path).unwrap(), key);
        fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        assert!(read(&path).unwrap_err().contains("mode 0640"));
        fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        fs::write(&path, "secret").unwrap();
        assert!(read(&path).unwrap_err().contains("64 hexadecimal digits"));
        fs::remove_file(&path).unwrap();
        assert!(read(&path).unwrap_err().starts_with(&path.display().to_string()));
        assert_ne!(nonce().unwrap(), nonce().unwrap());
    }
}
