# The two commands of the README, `make demo` and `make test`, set up whatever they need.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out
# Two scans of one's own: make demo SOURCE=a.ply TARGET=b.ply TRUTH=T.txt
SOURCE ?=
TARGET ?=
TRUTH ?=

# Results of the comparison with other libraries, and options: make bench-peers PEERS_ARGS=--quick
PEERS_OUT ?= out/peers
PEERS_ARGS ?=

RUST_SOURCES := $(shell find rust -name '*.rs') Cargo.toml Cargo.lock rust/py/Cargo.toml
MATURIN := env -u CONDA_PREFIX VIRTUAL_ENV=$(CURDIR)/$(VENV) $(BIN)/maturin

# Named, as the commas would end an argument of `call`.
DEV_EXTRAS := scans,bench,test,dev,docs

# Runs a command whose output matters only where it fails.
quietly = $(1) > $(VENV)/build.log 2>&1 || { cat $(VENV)/build.log; exit 1; }

# Fresh seeds of the property tests: make test-random SEEDS=20
SEEDS ?= 3

# The documentation site.
DOCS_OUT ?= target/site
SPHINX = $(BIN)/python -m sphinx -d target/site-doctrees docs
ADVISORIES := https://github.com/rustsec/advisory-db

# Seconds per target, and which: make fuzz SECONDS=60 FUZZ_TARGETS=features
SECONDS ?= 60
FUZZ_TARGETS ?= $(notdir $(basename $(wildcard fuzz/bins/*.rs)))
FUZZ_PYTHON_TARGETS ?= read_scan read_stored run_command
FUZZ_OUT := target/fuzz
# Bytes of an input; MiB that one block, and all of a process, may come to; seconds that one input may take.
FUZZ_LIMITS := -max_len=2048 -malloc_limit_mb=512 -rss_limit_mb=2048 -timeout=60

# Wheels and source distributions.
DIST ?= dist

# Lets a stable compiler take the flags of sanitizers and of libFuzzer, which would otherwise need a nightly one.
UNSTABLE := RUSTC_BOOTSTRAP=1
HOST := $(shell rustc --print host-tuple 2>/dev/null)

.PHONY: help setup demo test test-rust test-python test-random test-nightly verify-measured test-checked sanitize fuzz fmt lint types docs linkcheck audit package bench bench-peers clean

help: ## show this list
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

setup: $(VENV)/.ready-dev ## install everything that developing needs, and build the package

demo: $(VENV)/.ready-scans ## compare all methods on a generated pair of scans, and register it; or compare on SOURCE, TARGET, TRUTH
ifeq ($(strip $(SOURCE)$(TARGET)$(TRUTH)),)
	@$(BIN)/cgroup demo --out $(OUT)
else
	@test -n "$(SOURCE)" -a -n "$(TARGET)" -a -n "$(TRUTH)" || { \
		echo "Give all three: make demo SOURCE=a.ply TARGET=b.ply TRUTH=T.txt"; exit 2; }
	@$(BIN)/cgroup compare "$(SOURCE)" "$(TARGET)" --truth "$(TRUTH)" --out $(OUT)
endif

test: test-rust test-python ## run every test

test-rust: | check-tools ## run the Rust tests
	cargo test --release --locked

test-python: $(VENV)/.ready-dev ## run the Python tests
	$(BIN)/python -m pytest -n 2 --dist worksteal --durations=20

test-random: $(VENV)/.ready-dev ## run the property tests with SEEDS fresh seeds
	@failed=; for seed in $$($(BIN)/python -c 'import random; print(*random.sample(range(10**6), $(SEEDS)))'); do \
		echo "Seed $$seed:"; \
		PROPTEST_RNG_SEED=$$seed cargo test --release --locked --quiet --test core invariance \
			|| failed="$$failed PROPTEST_RNG_SEED=$$seed"; \
		HYPOTHESIS_PROFILE=random $(BIN)/python -m pytest -q -n 2 --dist worksteal -m hypothesis --hypothesis-seed=$$seed \
			|| failed="$$failed --hypothesis-seed=$$seed"; \
	done; \
	test -z "$$failed" || { echo "Failed with:$$failed"; exit 1; }

test-nightly: $(VENV)/.ready-dev ## run the Python tests that take minutes, on whole data sets
	$(BIN)/python -m pytest -n 2 --dist worksteal -m nightly

verify-measured: $(VENV)/.ready-dev ## measure one value of each method again and compare it with docs/figures/measured
	$(BIN)/python docs/figures/choose.py verify

test-checked: | check-tools ## run the Rust tests with overflow checks and debug assertions
	cargo test --profile checked --locked --lib --tests

sanitize: sanitize-address sanitize-thread ## run Rust tests under the address and the thread sanitizer

.PHONY: sanitize-address sanitize-thread
sanitize-address: | check-tools ## run the Rust tests under the address sanitizer
	$(UNSTABLE) RUSTFLAGS=-Zsanitizer=address cargo test --release --locked --target $(HOST) --target-dir target/address --lib --tests

# What it passes over, and why, stands in tests/races.supp.
sanitize-thread: | check-tools ## run the tests of threads under the thread sanitizer
	$(UNSTABLE) RUSTFLAGS="-Zsanitizer=thread -Cunsafe-allow-abi-mismatch=sanitizer" \
		TSAN_OPTIONS="suppressions=$(CURDIR)/tests/races.supp" \
		cargo test --release --locked --target $(HOST) --target-dir target/thread --test background

fuzz: $(VENV)/.ready-dev ## look for inputs that break something, SECONDS per target
	@command -v cargo-fuzz >/dev/null || { echo "cargo-fuzz is missing: cargo install --locked cargo-fuzz"; exit 1; }
	$(UNSTABLE) cargo fuzz build --target-dir $(FUZZ_OUT)
	@$(BIN)/python -c 'import atheris' 2>/dev/null || $(BIN)/python -m pip install --quiet "atheris>=3" \
		|| echo "The Python targets are left out: atheris has no wheel for $$($(BIN)/python --version)."
	@BINARIES=$(FUZZ_OUT)/$(HOST)/release SECONDS_PER_TARGET=$(SECONDS) PYTHON=$(BIN)/python \
		fuzz/run "$(FUZZ_TARGETS)" "$(FUZZ_PYTHON_TARGETS)" $(FUZZ_LIMITS)

fmt: $(VENV)/.ready-dev ## format the code
	cargo fmt --all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lint: $(VENV)/.ready-dev ## check format, lints and who imports whom
	cargo fmt --all --check
	cargo clippy --release --locked --workspace --all-targets -- -D warnings
	@! cargo tree --locked --package cgroup --edges normal | grep -E ' (pyo3|numpy) ' \
		|| { echo "the core crate must not depend on pyo3 or numpy"; exit 1; }
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/python tools/collect_licenses.py --check
	$(BIN)/python tools/check_version.py
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.dependabot .github/dependabot.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/zizmor --offline --quiet .github
	$(BIN)/shellcheck .ci/run fuzz/run

types: $(VENV)/.ready-dev ## check types, and the stubs against the compiled core
	$(BIN)/basedpyright
	MYPYPATH=python $(BIN)/python -m mypy.stubtest cgroup._core

docs: $(VENV)/.ready-dev ## build the documentation site, and the pages of the Rust interface
	RUSTDOCFLAGS="-D warnings" cargo doc --release --locked --no-deps --package cgroup
	@echo "Building the site: figures, the gallery, some 250 pages (about 6 minutes the first time) ..."
	@$(SPHINX) -b html --fail-on-warning --keep-going --quiet $(DOCS_OUT)
	@echo "Written: $(DOCS_OUT)/index.html, target/doc/cgroup/index.html"

linkcheck: $(VENV)/.ready-dev ## follow every link of the documentation that leaves it; needs the network
	$(SPHINX) -b linkcheck --quiet target/linkcheck

audit: audit-crates audit-python ## check licences, sources and known vulnerabilities of what cgroup builds on

.PHONY: audit-crates audit-python
audit-crates: | check-tools
	@echo "Crates that are linked into the core, and their licences:"
	@sed -nE '/^[A-Za-z0-9_-]+ [0-9][^ ]*: /p' THIRD-PARTY-LICENSES.txt
	@if ! command -v cargo-deny >/dev/null; then \
		echo "The rules of deny.toml are not checked: cargo-deny is missing: cargo install --locked cargo-deny"; \
	else \
		cargo deny --locked --workspace check licenses bans sources || exit 1; \
		if cargo deny --locked --workspace fetch db >/dev/null 2>&1; then cargo deny --locked --workspace check advisories; \
		else echo "Vulnerabilities of crates are not checked: $(ADVISORIES) can't be reached."; fi; \
	fi

audit-python: $(VENV)/.ready-dev
	@$(BIN)/python -m pip install --quiet pip-audit pip-licenses
	$(BIN)/pip-licenses --ignore-packages cgroup
	@if echo numpy==1.26.0 | $(BIN)/pip-audit --no-deps --disable-pip -r /dev/stdin 2>/dev/null | grep -q "could not be audited"; \
		then echo "Vulnerabilities of Python packages are not checked: PyPI's records of them can't be reached."; \
		else $(BIN)/pip-audit --local --skip-editable --progress-spinner off; fi

package: $(VENV)/.ready-dev ## build the wheel and the source distribution into DIST, and check both
	$(BIN)/python tools/check_package.py "$(DIST)"

bench: | check-tools ## run the criterion benches
	cargo bench --locked

bench-peers: $(VENV)/.ready-dev ## compare time and memory with PCL, Open3D, NumPy and others
	@PYTHONPATH=benches $(BIN)/python -m peers.run --out "$(PEERS_OUT)" $(PEERS_ARGS)

clean: ## remove what was built
	rm -rf $(VENV) .venv-peers target $(OUT) $(DIST) python/cgroup/_core*.so \
		docs/_generated docs/gallery docs/reference/api docs/reference/*.rst docs/reference/modules.txt

.PHONY: check-tools
check-tools:
	@command -v cargo >/dev/null || { \
		echo "Rust is missing: install it (https://rustup.rs), then run make again."; exit 1; }

$(VENV)/.created:
	@command -v $(PYTHON) >/dev/null || { \
		echo "$(PYTHON) is missing: install Python 3.10 or newer, or name it: make PYTHON=python3.12."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
		echo "$$($(PYTHON) --version) is too old: cgroup needs 3.10 or newer; name one: make PYTHON=python3.12."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { \
		echo "$(PYTHON) cannot make a virtual environment: install its venv module (Debian: python3-venv)."; exit 1; }
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check "maturin>=1.8,<2"
	@touch $@

$(VENV)/.ready-scans: $(VENV)/.created $(RUST_SOURCES) pyproject.toml | check-tools
	@echo "Building cgroup (a few minutes the first time) ..."
	@$(call quietly,$(MATURIN) develop --release --locked --extras scans)
	@touch $@

$(VENV)/.ready-dev: $(VENV)/.created $(RUST_SOURCES) pyproject.toml | check-tools
	@echo "Building cgroup and installing its development tools (a few minutes the first time) ..."
	@$(call quietly,$(MATURIN) develop --release --locked --extras $(DEV_EXTRAS))
	@touch $@ $(VENV)/.ready-scans
