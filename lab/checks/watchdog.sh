# What the checks of the computer's own watchdog share: a robot of one critical module, another copy of our executable, so that
# it can be taken away, and a device that resets the machine 4 s after it was fed last.

device=

start() { # IDENTITY OF THE DEVICE: the robot runs and has armed it
    for one in /sys/class/watchdog/watchdog*; do
        [ "$(cat "$one/identity")" != "$1" ] || device=${one##*/}
    done
    [ -n "$device" ] || fail "there is no $1"
    [ -e "$HOME/module" ] || cp "$ADVEE" "$HOME/module"
    cat >conf/advee/modules.toml <<END
hardware_watchdog = "/dev/$device"
hardware_watchdog_timeout_s = 4
[[modules]]
name = "driver_aux"
command = "$HOME/module"
args = ["run", "driver_aux"]
critical = true
END
    "$ADVEE" up --headless --run-dir /run/advee >>"$log" 2>&1 &
    up=$!
    expect "hardware watchdog /dev/$device: resets after 4 s"
    armed || fail "it is not armed"
}

armed() { [ "$(cat "/sys/class/watchdog/$device/state")" = active ]; }

watchdog() { cat "/proc/$up/task/$up/children"; } # the process of our watchdog

module() { sed -n 's/^driver_aux \([0-9]*\) .*/\1/p' /run/advee/processes; } # and of the module
