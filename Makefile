# Two main targets: `make run` starts the simulated robot, `make test` checks everything.
# On a fresh Debian 12 with git, make and a Rust tool chain each target installs its other requirements.

# `make run PROFILE=quick`: builds in a fraction of the time, for use between two edits.
PROFILE = release
# `make run ROBOT=courier`: another robot of conf/.
ROBOT = advee
ADVEE = target/$(PROFILE)/advee
PAGE = modules/web/page

.PHONY: run build web web-test e2e screenshots test test-fast fuzz bad-input lint lint-code lint-docs lab lab-short lab-test deb reproducible arm bench generate docs clean

run: build
	$(ADVEE) up --sim --config conf/$(ROBOT)

build: web
	@tools/require cc
	cargo build --profile $(PROFILE) --locked

# The page of the web diagnostic center: built once, included in the executable.
web: $(PAGE)/dist/index.html

$(PAGE)/dist/index.html: $(PAGE)/package-lock.json $(PAGE)/tsconfig.json $(PAGE)/build.mjs $(PAGE)/icons.mjs $(shell find $(PAGE)/src -type f)
	@tools/require node
	cd $(PAGE) && npm ci --silent && npm run --silent build

# The page's type check and unit tests.
web-test: web
	cd $(PAGE) && npm run --silent test

# The page in a browser, against the live simulated robot; skipped without a browser, except under make test.
e2e: web
	@tools/require chromium || [ "$$ADVEE_PEERS" != required ]
	[ -n "$(BUILT)" ] || cargo build -p advee --locked
	cd $(PAGE) && npm run --silent e2e

# The pictures of docs/web.md.
screenshots: web
	@tools/require chromium
	cargo build -p advee --locked
	cd $(PAGE) && npm run --silent screenshots

# Peers that a package registry provides are required; tests that need a device are skipped without it, and listed.
test: export ADVEE_PEERS := required
test: export ADVEE_SKIPPED := $(CURDIR)/target/skipped
# The executable that the tests were built with: a build of its own selects other features, and compiles all crates anew.
test: export BUILT := yes
test: lint-code web-test
	@tools/require cc c++ cmake python3-venv python3-dev glib java mono rust-bare ip
	@tools/venv
	@tools/ros2-types
	@tools/lcm-1.3.1
	@rm -f $(ADVEE_SKIPPED)
	tools/run-tests --beside tools/sabotage\ build --beside $(MAKE)\ lint-docs
	@tools/require chromium qemu kbuild can-utils ip
	$(MAKE) --jobs 2 --output-sync=recurse e2e beside-e2e
	tools/arm-check --short
	@tools/skipped $(ADVEE_SKIPPED)

# The browser waits most of the time: what computes is done beside it, with SCHED_IDLE.
.PHONY: beside-e2e
beside-e2e:
	chrt --idle 0 tools/sabotage
	$(MAKE) lab-short

# Tests of the changes since main, within some minutes.
test-fast: web
	@tools/require cc
	tools/test-fast

# MINUTES in all, divided equally among the fuzz targets, as many of them at a time as there are processors (fuzz/README.md).
MINUTES = 13
fuzz:
	tools/fuzz $(MINUTES)

# Bad input at a driving simulated robot for MINUTES; SEED=N chooses another course, ROUND=N repeats one round.
bad-input: web
	@tools/require cc
	BAD_INPUT_MINUTES=$(MINUTES) cargo test -p advee --locked --test it bad_input_leaves_the_robot -- --nocapture

lint: lint-code lint-docs

lint-code: web
	@tools/require cc
	cargo fmt --all --check
	rustfmt --edition 2024 --check advee/tests/sabotage/bug.rs advee/tests/sabotage/main.rs
	cargo clippy --workspace --all-targets --locked -- -D warnings

lint-docs: web
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked

# Tests on real kernel drivers and a real init system, in virtual machines (lab/README.md).
lab: build lab-test
	-@tools/require qemu kbuild can-utils ip i2c-tools deb mmdebstrap python3-venv rt-tests
	-@tools/venv
	cargo build --release --locked --example manual
	lab/lab
	python3 -m unittest discover -q -s lab/tests -p test_machine.py

# The part of the lab that belongs to every test; without a virtual machine it lists the skipped checks, except under
# make test.
lab-short: lab-test
	@tools/require qemu kbuild can-utils ip || [ "$$ADVEE_PEERS" != required ]
	[ -n "$(BUILT)" ] || cargo build -p advee --locked
	ADVEE=target/debug/advee lab/lab --short

# Tests of the lab's runner; they need no virtual machine.
lab-test:
	@tools/require python3
	python3 -m unittest discover -q -s lab/tests -p test_runner.py

# target/deb/advee_VERSION_ARCH.deb, for amd64, arm64, armhf or armel (docs/install.md).
deb: web
	@tools/require cc deb
	packaging/deb $(ARCH)

# Checks that the same source gives the same executable and package: builds them twice, in two folders.
reproducible: web
	@tools/require cc deb
	packaging/reproducible $(ARCH)

# The packages for arm64, armhf and armel, tested under emulation, and this machine's (docs/arm.md).
arm: deb
	@tools/require cc arm
	tools/arm-check

bench:
	@tools/require cc python3-venv glib ip
	@tools/venv
	cargo bench -p advee --locked --bench start --bench wheel --bench web
	cargo bench -p advee --locked --bench world
	cargo bench -p advee --locked --bench patrol
	cargo bench -p advee --locked --bench wheel_faults
	cargo bench -p advee --locked --bench faults
	cargo bench -p advee --locked --bench ros2
	cargo bench -p estimator --locked --bench estimator
	cargo bench -p lcm-gen --locked --bench codec --bench cdr
	cargo bench -p logger --locked --bench ros
	cargo bench -p rs485 --locked --bench rs485
	cargo bench -p i2c --locked --bench i2c
	cargo bench -p advee --locked --bench canopen
	cargo bench -p planner --locked --bench plan
	cargo bench -p lcm --locked --bench lcm

# Files that are made from the source: types and numbers of the page, tables of docs/, docs/messages.md.
generate:
	@tools/require cc
	cargo run -q -p generate --locked

# The documentation as a site in target/book; needs mdbook: `cargo install mdbook`, or its package where there is one.
docs:
	@command -v mdbook >/dev/null || { echo "make docs: mdbook is missing: cargo install mdbook"; exit 1; }
	@tools/require python3
	mdbook build
	@echo target/book/index.html

clean:
	cargo clean
	rm -rf .venv .peers run $(PAGE)/dist $(PAGE)/dev $(PAGE)/node_modules
