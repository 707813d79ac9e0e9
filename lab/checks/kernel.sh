#!/bin/sh
# The machine is as configured: a Debian kernel, our executable in memory, a share that the host reads.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
uname -srv
[ "$(uname -r)" = "$LAB_KERNEL" ] || fail "a different kernel runs"
"$ADVEE" --version
if touch "$LAB_SOURCE/lab/written" && [ -e "$LAB_SOURCE/lab/written" ]; then :; else fail "the root cannot be written"; fi
"$ADVEE" doctor --sim || fail "doctor fails"
