# Functions shared by the checks. A check that sources it has `set -eu`, and ends with `skip`, `fail`, or by itself. Its
# working folder is the checkout, with the robot's configuration; writes to it go to the guest's memory.

cd "$LAB_SOURCE"
log=$HOME/said # what the robot says

skip() { # WHY
    echo "$*"
    exit 77
}

fail() { # WHY: shown with what the robot said
    echo "FAILED: $*"
    [ ! -e "$log" ] || cat "$log"
    exit 1
}

needs() { # PROGRAM...: all of them, or the check is skipped
    for program in "$@"; do
        command -v "$program" >/dev/null || skip "$program is missing on the machine that the lab runs on"
    done
}

# From here on `expect`, `count` and `once` consider only new lines of the log.
step() { # WHAT
    echo "== $*"
    touch "$log"
    seen=$(wc -l <"$log")
}

news() { tail -n +$((seen + 1)) "$log"; }

count() { news | grep -c -e "$1" || true; } # TEXT

once() { [ "$(count "$1")" = 1 ] || fail "printed $(count "$1") times: $1"; } # TEXT

expect() { # TEXT [SECONDS]: the robot says it, within 30 s of the guest's time unless told
    within "${2:-30}" said "$1" || fail "never printed: $1"
    news | grep -m 1 -e "$1"
}

said() { news | grep -q -e "$1"; }

within() { # SECONDS COMMAND...: until it succeeds
    limit=$(($(date +%s) + $1))
    shift
    until "$@"; do
        [ "$(date +%s)" -lt "$limit" ] || return 1
        sleep 0.25
    done
}

# The simulated robot.

rt_priorities() { # MODULE=PRIORITY...: in $HOME/conf is the checkout's configuration with these
    cp -r conf "$HOME/"
    for given; do
        sed -i "s/^name = \"${given%=*}\"/&\nrt_priority = ${given#*=}/" "$HOME/conf/advee/modules.toml"
        grep -q "^rt_priority = ${given#*=}" "$HOME/conf/advee/modules.toml" || fail "there is no module ${given%=*}"
    done
}

has_priorities() { # as the log says
    ! grep -e "rt_priority:" -e "memory may be paged out" "$log" || fail "real time is refused"
}

truth() { "$ADVEE" lcm echo SIM_DATA_TRUTH --for 0.3 | sed -n "\$s/.* $1=\([^ ]*\).*/\1/p"; } # FIELD

drive() { # it drives when it is told to, for two seconds
    from=$(truth x)
    "$ADVEE" drive 0.3 0.1 --for 2
    to=$(truth x)
    awk "BEGIN { exit !($to - $from > 0.2) }" || fail "it did not drive: x was $from m, is $to m"
}
