# Two commands: `make run` drives the simulated robot, `make test` checks everything.
# On a fresh Debian 12 with git, make and a Rust tool chain each installs what else it needs.

ADVEE = target/release/advee

.PHONY: run build web web-test e2e screenshots test lint lab lab-short lab-test deb reproducible arm bench clean

run: build
	$(ADVEE) up --sim

build: web
	@tools/require cc
	cargo build --release --locked

# The page of the web diagnostic center: built once, taken into the program.
web: web/dist/index.html

web/dist/index.html: web/package-lock.json web/tsconfig.json web/build.mjs web/icons.mjs $(shell find web/src -type f)
	@tools/require node
	cd web && npm ci --silent && npm run --silent build

# The page's types and units.
web-test: web
	cd web && npm run --silent test

# The page in a browser, against the live simulated robot; without a browser its tests say that they are skipped.
e2e: web
	-@tools/require chromium
	cargo build -p advee --locked
	cd web && npm run --silent e2e

# The pictures of docs/web.md.
screenshots: web
	@tools/require chromium
	cargo build -p advee --locked
	cd web && npm run --silent screenshots

test: lint web-test
	@tools/require cc c++ python3-venv glib
	@tools/venv
	@tools/lcm-1.3.1
	cargo test --workspace --locked
	cargo test -p advee --features sabotage --test sabotage --locked
	$(MAKE) e2e
	$(MAKE) lab-short
	tools/arm-check --short

lint: web
	@tools/require cc
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --locked -- -D warnings

# Real kernel drivers, a real init system: in virtual machines (lab/README.md).
lab: build lab-test
	-@tools/require qemu kbuild can-utils ip i2c-tools deb mmdebstrap python3-venv rt-tests
	-@tools/venv
	cargo build --release --locked --example manual
	lab/lab
	python3 -m unittest discover -q -s lab/tests -p test_machine.py

# What of it belongs to every test; where no machine can be had, it says so and what was left out.
lab-short: lab-test
	-@tools/require qemu kbuild can-utils ip
	cargo build -p advee --locked
	ADVEE=target/debug/advee lab/lab --short

# The lab's runner itself; needs no machine.
lab-test:
	@tools/require python3
	python3 -m unittest discover -q -s lab/tests -p test_runner.py

# target/deb/advee_VERSION_ARCH.deb, for amd64, arm64, armhf or armel (docs/install.md).
deb: web
	@tools/require cc deb
	packaging/deb $(ARCH)

# The same source gives the same executable and the same package: built twice, in two folders.
reproducible: web
	@tools/require cc deb
	packaging/reproducible $(ARCH)

# The packages for arm64, armhf and armel, tried under emulation beside this machine's (docs/arm.md).
arm: deb
	@tools/require cc arm
	tools/arm-check

bench:
	@tools/require cc python3-venv glib ip
	@tools/venv
	cargo bench -p advee --locked --bench start --bench wheel --bench web
	cargo bench -p advee --locked --bench world
	cargo bench -p advee --locked --bench patrol
	cargo bench -p advee --locked --bench faults
	cargo bench -p estimator --locked --bench estimator
	cargo bench -p lcm-gen --locked --bench codec --bench cdr
	cargo bench -p logger --locked --bench ros
	cargo bench -p rs485 --locked --bench rs485
	cargo bench -p i2c --locked --bench i2c
	cargo bench -p advee --locked --bench canopen
	cargo bench -p planner --locked --bench plan
	cargo bench -p lcm --locked --bench lcm

clean:
	cargo clean
	rm -rf .venv .peers run web/dist web/dev web/node_modules
