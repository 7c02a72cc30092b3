# Two commands on a fresh machine with Python and make: `make run` and `make test`. Each sets up everything it needs.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# As bhm itself sets it: threads of its linear algebra cost more than they give, and those of two workers fight.
export OPENBLAS_NUM_THREADS := 1

.PHONY: run test check bench prove proofs clean batteries golden

run: $(VENV)/.ready
	@$(BIN)/python -m sim.demo

# worksteal: neighbours stay on one core, and what they share is made once.
test: $(VENV)/.ready-dev check
	$(BIN)/pytest -n auto --dist worksteal

check: $(VENV)/.ready-dev
	$(BIN)/ruff check --quiet
	$(BIN)/ruff format --check --quiet
	$(BIN)/lint-imports --no-cache
	$(BIN)/mypy

bench: $(VENV)/.ready-bench
	$(BIN)/pytest tests/benchmarks -p no:xdist --benchmark-disable-gc --benchmark-columns=median,iqr,rounds -o addopts="-q --import-mode=importlib"

# The long proofs of the onboard service: fifty kills in a flight, a day of flights with faults, a million frames.
proofs: $(VENV)/.ready-dev
	$(BIN)/pytest tests/proofs tests/sim/test_pybamm_pack.py -v -p no:xdist -o addopts="--import-mode=importlib"
	$(BIN)/pytest tests -m long -n 2 -o addopts="-q --import-mode=importlib --ignore=tests/benchmarks"

# The whole proof on an exam seed that is drawn now; exit status 1 where a target is missed. The score card goes into
# the README, misses included. The slowest suites come first: no core waits for them at the end. ANSWERER=oracle and the
# like examine the examination; KEEP=--keep keeps the cases.
ANSWERER ?= tool
KEEP ?=
PROOF := $(VENV)/proof/$(shell date -u +%Y%m%d-%H%M%S)
prove: $(VENV)/.ready-truth
	$(BIN)/bhm prove --suite real --suite truth --suite exam --jobs 2 --answerer $(ANSWERER) $(KEEP) -o $(PROOF); \
	status=$$?; \
	if [ $(ANSWERER) = tool ] && [ -f $(PROOF)/score.json ]; then $(BIN)/python -m sim.proof.readme $(PROOF) README.md; fi; \
	exit $$status

# What ships in config/batteries, from the recordings that it was fitted to.
batteries: $(VENV)/.ready
	$(BIN)/python -m bhm_service.identification.generic_lipo ../shared/data/lab/maxamps_lipo5450 config/batteries
	$(BIN)/python -m bhm_service.identification.generic_lihv ../shared/data/flights/wadl_m100 config/batteries

golden: $(VENV)/.ready-dev
	$(BIN)/pytest tests/test_golden.py --update-golden

$(VENV)/.made:
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	printf '*\n' > $(VENV)/.gitignore
	$(BIN)/pip install --quiet --upgrade pip
	touch $@

$(VENV)/.ready: $(VENV)/.made pyproject.toml
	$(BIN)/pip install --quiet --editable .
	touch $@

$(VENV)/.ready-dev: $(VENV)/.ready
	$(BIN)/pip install --quiet --editable '.[dev]'
	# Real peers; the tests that need one are skipped where it has no wheel. MAVProxy without its viewers (900 MB).
	-$(BIN)/pip install --quiet --only-binary :all: --no-deps 'mavsdk==4.1.*'
	-$(BIN)/pip install --quiet --only-binary :all: --no-deps 'MAVProxy==1.8.*'
	touch $@

$(VENV)/.ready-bench: $(VENV)/.ready-dev
	$(BIN)/pip install --quiet --editable '.[dev,bench]'
	touch $@

$(VENV)/.ready-truth: $(VENV)/.ready-dev
	$(BIN)/pip install --quiet --editable '.[dev,truth]'
	touch $@

clean:
	rm -rf $(VENV)
