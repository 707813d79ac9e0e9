# Functions shared by the checks of the package. The packages are built on the host at the same time (package_debs):
# two, of which one is an upgrade. The robot is the simulated one unless a check sets another.

. "$LAB_SOURCE/lab/checks/lib.sh"
cd /
advee=/usr/bin/advee
export ADVEE=$advee
export DEBIAN_FRONTEND=noninteractive

# All files that a package could leave, with their owners; except those that change by themselves.
things() {
    # dpkg removes an empty /opt, which no package owns.
    find / -xdev \( -path /proc -o -path /sys -o -path /lab -o -path "$LAB_SOURCE" -o -path /var/log -o -path /var/lib/dpkg -o \
        -path /var/cache -o -path /tmp -o -path /var/tmp -o -path /root \) -prune -o ! -path /opt -printf '%p %u %g %M\n' | sort
    find /run /dev/shm -xdev \( -path /run/lab -o -path /run/systemd -o -path /run/udev -o -path /run/log -o -path /run/dbus \) \
        -prune -o -printf '%p %u %g %M\n' | sort
    getent passwd
    getent group
    dpkg-query -W
}
pristine=/run/lab/pristine # what was there before any package of ours

debs() { # until the host has built them
    [ -e $pristine ] || things >$pristine
    within 300 test -e "$LAB_SHARE/debs/done" || fail "no package was built outside"
    [ ! -e "$LAB_SHARE/debs/skip" ] || skip "$(cat "$LAB_SHARE/debs/skip")"
}

present() { dpkg-query -W -f='${Status}\n' advee 2>/dev/null | grep -q ' installed'; }

install_deb() { # OLD|NEW
    dpkg --force-confold -i "$LAB_SHARE/debs/$1.deb" || fail "the package is not installed"
}

# Installed, with the simulated robot, and running.
running() {
    debs
    present || install_deb old
    sed -i 's/^ADVEE_ARGS=.*/ADVEE_ARGS="--sim --world empty --goal none"/' /etc/default/advee
    is active || systemctl start advee || fail "it does not start"
    within 30 all_run || fail "not all modules RUN"
    homed
}

show() { systemctl show -P "$1" advee.service; } # PROPERTY
is() { [ "$(show ActiveState)" = "$1" ]; }       # STATE
status() { show StatusText; }
all_run() { status | grep -q '^\([0-9]*\) of \1 modules RUN'; }
restarts() { show NRestarts; }
main() { show MainPID; }
module() { # NAME: its process
    for process in /proc/[0-9]*; do
        # The list may be older than the process.
        if [ "$(tr '\0' ' ' 2>/dev/null <"$process/cmdline" | cut -d' ' -f2,3)" = "run $1" ]; then
            echo "${process#/proc/}"
        fi
    done
}
other() { now=$(module "$1") && [ -n "$now" ] && [ "$now" != "$2" ]; } # NAME PROCESS: another one runs
renewed() { now=$(main) && [ "$now" != 0 ] && [ "$now" != "$1" ]; } # PROCESS: the main process is another one
gone() { [ ! -e "/proc/$1" ]; }
motion() { "$advee" lcm echo LL_DATA_MOTION --for 0.3 | tail -n 1; }
homed() { within 60 says_homed || fail "the steering is not homed: $(motion)"; }
says_homed() { motion | grep -q 'homed=true'; }

fail() { # WHY: shown with the journal
    echo "FAILED: $*"
    systemctl --no-pager status advee.service || true
    journalctl --no-pager -n 60 -u advee.service -u advee-web.service
    exit 1
}
