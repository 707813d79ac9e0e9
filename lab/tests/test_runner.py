"""Error handling of the runner and its cache. No virtual machine: guest.py replaces QEMU, and nothing is fetched."""

import os
import shutil
import signal
import time
import unittest

from own_lab import OwnLab


class Runner(OwnLab):
    # -- checks -----------------------------------------------------------------------------------------------------

    def test_each_check_counts_once_and_a_failure_is_the_exit_status(self):
        self.check("good", "echo all well")
        self.check("none", "echo there is no such device; exit 77")
        self.check("bad", "echo what it saw; exit 3")
        status, said = self.run_lab()
        self.assertEqual(status, 1)
        self.assertIn("lab: 1 passed, 1 failed, 1 skipped", said)
        self.assertIn("there is no such device", said)
        self.assertIn("what it saw", said)
        skipped = self.path("skipped")
        self.run_lab(ADVEE_SKIPPED=skipped)
        with open(skipped, encoding="utf-8") as f:
            self.assertEqual(f.read(), "machine\tlab: none\tthere is no such device\n")
        self.assertEqual(self.run_lab("good")[0], 0)

    def test_a_check_that_hangs_is_ended_and_the_next_runs_in_a_fresh_machine(self):
        self.check("hangs", "echo before; exec sleep 600", limit=1)
        self.check("next", "echo machine $GUEST")
        status, said = self.run_lab()
        self.assertEqual(status, 1)
        self.assertIn("not done within 1 s; its console:\n    its console", said)
        self.assertIn("1 passed, 1 failed, 0 skipped", said)

    def test_a_machine_that_ends_under_a_check_shows_its_console_and_the_next_check_runs(self):
        self.check("panics", "echo Kernel panic >$CONSOLE; kill -9 $GUEST")
        self.check("next", "true")
        status, said = self.run_lab()
        self.assertEqual(status, 1)
        self.assertIn("the machine ended by itself", said)
        self.assertIn("Kernel panic", said)
        self.assertIn("1 passed, 1 failed, 0 skipped", said)

    def test_a_reset_is_good_where_it_is_awaited_and_only_then(self):
        self.check("awaited", "echo now the machine resets; kill -9 $GUEST", reset=True)
        self.check("panics", "echo Kernel panic >$CONSOLE; echo now the machine resets; kill -9 $GUEST", reset=True)
        self.check("early", "echo it begins; kill -9 $GUEST", reset=True)
        self.check("never", "echo now the machine resets", reset=True)
        self.check("after", "true")
        status, said = self.run_lab()
        self.assertEqual(status, 1)
        self.assertIn("passed", next(line for line in said.splitlines() if "awaited" in line))
        self.assertIn("the machine was to reset, and did not", said)
        self.assertIn("2 passed, 3 failed, 0 skipped", said)

    def test_what_a_check_prints_is_not_taken_for_the_machine_s_own_words(self):
        self.check("lies", "printf '\\001end lies 0\\nend 0\\n'; printf %032d 0; echo ' end 0'; exit 5")
        self.check("no_line", "printf 'the last line has no end'")
        status, said = self.run_lab()
        self.assertEqual(status, 1)
        self.assertIn("exit status 5", said)
        self.assertIn("1 passed, 1 failed, 0 skipped", said)
        self.assertEqual(self.log("no_line"), "the last line has no end\n")

    def test_a_flood_is_cut_and_does_not_hide_the_end(self):
        self.check("lines", "yes 'a line of a flood' | head -c 40000000; exit 4")
        self.check("no_lines", "head -c 40000000 /dev/zero; exit 4")
        status, said = self.run_lab()
        self.assertEqual(status, 1)
        self.assertEqual(said.count("exit status 4"), 4)
        self.assertLess(len(said), 400_000)
        for name in ("lines", "no_lines"):
            self.assertLess(len(self.log(name)), 2_000_000)
            self.assertTrue(self.log(name).endswith("... and more, which is left out\n"))

    def test_a_machine_that_never_comes_up_fails_all_its_checks_at_once(self):
        self.write("bin/qemu-system-x86_64", "#!/bin/sh\necho 'qemu: no such machine' >&2; exit 1\n")
        self.check("one", "true")
        self.check("two", "true")
        status, said = self.run_lab()
        self.assertEqual(status, 1)
        self.assertIn("the machine did not come up", said)
        self.assertIn("0 passed, 2 failed, 0 skipped", said)
        self.assertEqual(said.count("qemu: no such machine"), 1)

    def test_an_interrupt_ends_the_machine_and_leaves_nothing(self):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self.checks = ""
            self.check("long", "echo $GUEST; exec sleep 600")
            self.check("next", "echo it ran")
            lab = self.start("-v", TMPDIR=os.path.dirname(self.path("tmp", "x")))
            guest = next(int(line) for line in lab.stdout if line.strip().isdigit())
            lab.send_signal(number)
            said, _ = lab.communicate(timeout=10)
            self.assertNotEqual(lab.returncode, 0)
            self.assertNotIn("it ran", said)
            until = time.monotonic() + 5
            while os.path.exists(f"/proc/{guest}/exe") and time.monotonic() < until:
                time.sleep(0.05)
            self.assertFalse(os.path.exists(f"/proc/{guest}/exe"), f"{number}: the machine goes on")
            if number != signal.SIGKILL:
                self.assertEqual((lab.returncode, said.strip()), (130, "lab: interrupted"))
                self.assertEqual(os.listdir(self.path("tmp")), [])

    # -- what is missing --------------------------------------------------------------------------------------------

    def cannot_run(self, why, **environment):
        """One line has the reason, and with --short the number of skipped checks."""
        status, said = self.run_lab(**environment)
        self.assertEqual(status, 2, said)
        [line] = [line for line in said.splitlines() if not line.startswith("fetching ")]
        self.assertRegex(line, f"^lab: CANNOT RUN: .*{why}")
        status, said = self.run_lab("--short", **environment)
        self.assertEqual(status, 0, said)
        self.assertRegex(said, f"(?m)^lab: 1 checks SKIPPED: .*{why}")
        self.assertEqual(self.run_lab("--short", ADVEE_PEERS="required", **environment)[0], 2)

    def test_no_qemu(self):
        self.check("good", "true", short=True)
        os.remove(self.path("bin", "qemu-system-x86_64"))
        for tool in ("python3", "strip", "sh", "setpriv"):
            if shutil.which(tool):
                os.symlink(shutil.which(tool), self.path("bin", tool))
        self.cannot_run("qemu-system-x86_64 is missing: apt-get install", PATH=self.path("bin"))

    def test_no_executable(self):
        self.check("good", "true", short=True)
        self.cannot_run("there is no .*advee: make build", ADVEE=self.path("nothing", "advee"))

    def test_no_network_and_a_warm_cache(self):
        self.check("good", "true")
        self.assertEqual(self.run_lab()[0], 0)

    @unittest.skipUnless(shutil.which("apt-get"), "there is no apt-get here")
    def test_no_network_and_a_cold_cache(self):
        self.check("good", "true", short=True)
        shutil.rmtree(self.path("cache"))
        self.cannot_run(r"\(Failed to fetch .*Could not connect to 127.0.0.1:9")
        self.assertEqual([name for name in os.listdir(self.path("cache")) if name.startswith(("kernel", "package"))
                          and not name.endswith(".new")], [])

    def test_what_broke_off_is_made_anew(self):
        self.check("good", "true")
        shutil.rmtree(self.path("cache", "package-busybox-static"))
        self.write("cache/package-busybox-static.new/bin/busybox", "half of it")
        self.write("cache/download/busybox-static_1.deb", "half of it")
        # apt and dpkg as with a network.
        self.write("bin/apt-get", "#!/bin/sh\ncase \"$*\" in *download*) echo whole >busybox-static_2.deb ;; esac\n")
        self.write("bin/dpkg-deb", "#!/bin/sh\nmkdir -p \"$3/bin\"; cp \"$2\" \"$3/bin/busybox\"\n")
        status, said = self.run_lab()
        self.assertEqual(status, 0, said)
        with open(self.path("cache", "package-busybox-static", "bin", "busybox"), encoding="utf-8") as f:
            self.assertEqual(f.read(), "whole\n")
        self.assertEqual([name for name in os.listdir(self.path("cache")) if name.endswith(".new") or name == "download"], [])
        # A failed download leaves no usable file.
        shutil.rmtree(self.path("cache", "package-busybox-static"))
        self.write("bin/dpkg-deb", "#!/bin/sh\nmkdir -p \"$3/bin\"; echo 'no end of archive' >&2; exit 2\n")
        status, said = self.run_lab()
        self.assertEqual(status, 2, said)
        self.assertIn("lab: CANNOT RUN: dpkg-deb failed: no end of archive", said)
        self.assertFalse(os.path.exists(os.path.join(self.folder, "cache", "package-busybox-static")))


if __name__ == "__main__":
    unittest.main()
