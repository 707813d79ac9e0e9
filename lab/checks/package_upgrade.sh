#!/bin/sh
# An upgrade stops the robot, keeps configuration and logs, and starts it again; removal stops it; purging leaves
# nothing.
set -eu
. "$LAB_SOURCE/lab/checks/package.sh"
debs
! present || dpkg --purge advee

step "upgraded while it runs: stopped meanwhile, changed files are kept, and it runs again"
install_deb old
systemctl enable advee
running
echo '# ours' >>/opt/advee/conf/robot.toml
within 20 test -n "$(ls /opt/advee/log)" || fail "there are no logs"
run=$(ls /opt/advee/log | head -n 1)
up=$(main)
install_deb new
[ "$(dpkg-query -W -f='${Version}' advee)" = 1.1 ] || fail "it is not the new version"
is active || fail "it does not run again"
[ "$(main)" != "$up" ] || fail "it was not stopped"
[ "$(restarts)" = 0 ] || fail "it failed"
tail -n 1 /opt/advee/conf/robot.toml | grep '# ours' || fail "changes are lost"
grep -- '--sim' /etc/default/advee || fail "its arguments are lost"
[ -d "/opt/advee/log/$run" ] || fail "the logs are lost"
systemctl --quiet is-enabled advee || fail "it is not enabled any more"
within 60 all_run || fail "not all modules RUN"

step "upgraded while stopped: it stays stopped"
systemctl stop advee
install_deb old
is inactive || fail "it was started"

step "a robot that was started otherwise keeps its executable"
install -d -o advee /run/advee
setpriv --reuid=advee --regid=advee --init-groups /opt/advee/bin/advee up --sim --goal none --headless >"$HOME/by-hand" 2>&1 &
by_hand=$!
within 20 test -e /run/advee/lock || fail "it does not start"
if dpkg -i "$LAB_SHARE/debs/new.deb"; then fail "upgraded under a running robot"; fi
[ "$(dpkg-query -W -f='${Version} ${Status}' advee)" = "1.0 install ok installed" ] || fail "dpkg is left in the middle"
kill $by_hand
wait $by_hand || fail "it does not end in order"
install_deb new

step "removed: stopped; configuration and logs stay"
systemctl start advee
dpkg --remove advee
[ -z "$(module watchdog)$(module driver_power)" ] || fail "it runs on"
[ -d "/opt/advee/log/$run" ] && [ -e /opt/advee/conf/robot.toml ] || fail "a file of the owner is lost"
! [ -e /usr/bin/advee ] || fail "it is still there"

step "purged: nothing is left"
dpkg --purge advee
things >"$HOME/after"
diff $pristine "$HOME/after" || fail "the original state is not restored"
