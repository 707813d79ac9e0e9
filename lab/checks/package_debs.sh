#!/bin/sh
# Outside: the packages that the guest installs, of the executable under test, into $LAB_SHARE/debs: old.deb, and
# new.deb with a higher version. Unchanged parts are not built again.
set -eu
cd "$(dirname "$0")/../.."
share=$LAB_SHARE/debs
kept=target/lab/debs
manual=''
for profile in release debug; do
    program=${CARGO_TARGET_DIR:-target}/$profile/examples/manual
    [ -n "$manual" ] || [ ! -x "$program" ] || manual=$program
done
mkdir -p "$share" "$kept"
if [ -z "$manual" ]; then
    echo "no program that writes the manual: cargo build --release --example manual" >"$share/skip"
    : >"$share/done"
    exit 0
fi
executable=$LAB_SHARE/advee
exec 9>"$kept/lock"
flock 9
stamp=$(cat "$executable" "$manual" packaging/deb packaging/*/* conf/advee/* conf/worlds/* docs/install.md CHANGELOG.md | sha256sum)
if [ "$(cat "$kept/stamp" 2>/dev/null)" != "$stamp" ]; then
    rm -rf "$kept/stamp" "$kept/manual"
    "$manual" "$kept/manual"
    for version in 1.0:old 1.1:new; do
        deb=$(CARGO_TARGET_DIR=$kept COMPRESSION=none VERSION=${version%:*} packaging/deb amd64 --trial "$executable" "$kept/manual")
        mv "$deb" "$kept/${version#*:}.deb"
    done
    echo "$stamp" >"$kept/stamp"
fi
cp "$kept/old.deb" "$kept/new.deb" "$share/"
: >"$share/done"
