# Functions shared by the checks of EIA-485: sourced after lib.sh.
# shellcheck shell=sh

# Files that were read once are in memory: otherwise time passes while the machine waits for a file.
warm() {
    for program in awk cat date grep python3 sed sh sleep tail wc "$ADVEE"; do
        path=$(command -v "$program")
        [ ! -f "$path" ] || ldd "$path" | grep -o '/[^ ]*' | xargs cat "$path" >/dev/null
    done
    find conf -type f -exec cat {} + >/dev/null
    python3 -c 'import collections, fcntl, glob, os, random, select, socket, struct, subprocess, termios, threading, tty'
}

errors() { # BUS: on it, since the start
    "$ADVEE" lcm echo LL_DATA_BUS --for 1.1 | sed -n "s/.*bus=\"rs485.$1\" load=\([^ ]*\) frames=\([^ ]*\) errors=\([^ ]*\) .*/\3/p" | tail -n 1
}

load() { # the last second of each bus: share of the wire's time in use, frames and errors since the start
    "$ADVEE" lcm echo LL_DATA_BUS --for 1.1 | sed -n 's/.*\(bus="rs485[^ ]*" load=[^ ]* frames=[^ ]* errors=[^ ]*\).*/\1/p' | tail -n 3
}

all_run() { [ "$("$ADVEE" state | grep -c " RUN .* RUN ")" = 10 ]; }
