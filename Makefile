PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/up-to-date
JOBS ?= 2

.PHONY: venv lint test test-all mutants soak arms real record perturbed compare docs results results-suites results-tables
.NOTPARALLEL:

venv: $(STAMP)

$(STAMP): constraints.txt pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		-c constraints.txt -e '.[agents,experiments,cluster,dev]'
	touch $@

lint: venv
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy -n $(JOBS)

# What agents choose must not hang on how a processor's kernel of linear algebra rounds: the shorter tests once more
# under the oldest that numpy has for x86-64 (elsewhere under the same one again).
ANY_KERNEL := $(addprefix tests/agents/,knowledge memory servo) \
	$(addprefix --ignore=tests/agents/,memory/test_adaptive_memory.py $(addprefix servo/test_,bad_observations.py \
	observation_filter.py perception.py servos.py))

test: lint
	$(BIN)/pytest -n $(JOBS) -m 'not slow'
	OPENBLAS_CORETYPE=Nehalem $(BIN)/pytest -n $(JOBS) -m 'not slow' $(ANY_KERNEL)

test-all: lint
	$(BIN)/pytest -n $(JOBS)

mutants: venv
	$(BIN)/python -m tests.mutants --jobs $(JOBS)

soak: venv
	$(BIN)/python -m tests.soak

# Other people's arms for slow tests and benchmarks, into build/arms.
arms: venv
	$(BIN)/python -m tests.arms.fetched

# LeRobot wants Python 3.12 on, and older packages than ours: environments of its own, made by the first that runs.
REAL := build/real
RECORD := build/record
PYTHON312 ?=
NEWER = $(PYTHON312) python3.12 python3.13 python3.14 python3 $(HOME)/.pyenv/versions/3.1[2-9].*/bin/python

$(REAL)/bin/python $(RECORD)/bin/python:
	for each in $(NEWER); do \
		if $$each -c 'import sys, venv; sys.exit(sys.version_info < (3, 12))' 2> /dev/null; then found=$$each; break; fi; \
	done; \
	test -n "$$found" || { echo 'no Python from 3.12 on runs here: make $(MAKECMDGOALS) PYTHON312=...' >&2; exit 1; }; \
	$$found -m venv $(@:/bin/python=)

# The bench of a real arm on LeRobot's own classes. They use but names of torch, for which there is a stub.
real: $(REAL)/bin/python
	$(REAL)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r constraints-real.txt
	PYTHONPATH=tests/calfree_gym/lerobot/stub $(REAL)/bin/python -m pytest tests/calfree_gym/lerobot \
		tests/calfree_gym/cli -m 'not slow'

# Perturb in other people's environments: those of constraints-perturb.txt, and the same on the newest MuJoCo, which
# skips those that do not run there.
PERTURBED := build/perturbed

perturbed:
	mkdir -p build
	cp constraints-perturb.txt $(PERTURBED)-oldest.txt
	{ grep -v '^mujoco' constraints-perturb.txt; grep '^mujoco' constraints.txt; } > $(PERTURBED)-newest.txt
	for set in oldest newest; do \
		{ test -x $(PERTURBED)-$$set/bin/python || $(PYTHON) -m venv $(PERTURBED)-$$set; } && \
		$(PERTURBED)-$$set/bin/python -m pip install --quiet --disable-pip-version-check --no-deps \
			-r $(PERTURBED)-$$set.txt && \
		MUJOCO_GL=$${MUJOCO_GL:-egl} $(PERTURBED)-$$set/bin/python -m pytest -s -rs \
			tests/calfree_gym/perturb/test_families.py || exit 1; \
	done

# Demonstrations on that bench as a LeRobotDataset, which needs torch: gigabytes.
record: $(RECORD)/bin/python
	$(RECORD)/bin/python -m pip install --quiet --disable-pip-version-check -e . 'lerobot[dataset]==0.6.1'
	PYTHONPATH=. $(RECORD)/bin/python examples/record_lerobot.py

docs: venv
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# Every kept result anew, training and tuning apart. Started again, it goes on where it was.
SUITES := quick learners paper arms unseen-arms body-schema others rivals learning robustness estimators vision grasp grasp-neural six-dimensions open-questions dock remembering wilder \
	first-trials bad-observations later-trials re-aimed-table memory first-grasps
STUDIES := coverage priors insert orientations safe_start
ALONE := changes right_actions sensitivity speed training  # they take all cores, or measure time

results: results-suites
	printf '%s\n' $(STUDIES) | xargs -P $(JOBS) -I{} $(MAKE) benchmark-{}
	$(MAKE) -j 1 $(addprefix benchmark-,$(ALONE))
	$(BIN)/python -m experiments results-tables

results-suites: venv $(if $(filter arms unseen-arms body-schema,$(SUITES)),arms)
	for suite in $(SUITES); do \
		$(BIN)/python -m experiments run configs/$$suite.yaml --out build/results/$$suite --jobs $(JOBS) \
		&& $(BIN)/python -m experiments keep build/results/$$suite || exit 1; \
	done

benchmark-safe_start: arms
benchmark-%: venv
	commit=$$($(BIN)/python -c 'from experiments.running.versions import commit; print(commit())') && \
	grep -qs "\"commit\": \"$$commit\"" build/results/$*.json \
	|| $(BIN)/python -m experiments benchmark $* --out build/results/$*.json
	$(BIN)/python -m experiments keep build/results/$*.json

# Tables between markers in README.md and docs/, from the kept results in experiments/results.
results-tables: venv
	$(BIN)/python -m experiments results-tables

compare: venv
	$(BIN)/python -m experiments run configs/quick.yaml --out runs/quick --jobs $(JOBS)
