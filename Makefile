PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/up-to-date
JOBS ?= 2

.PHONY: venv lint test test-all mutants arms compare docs results results-tables

venv: $(STAMP)

$(STAMP): constraints.txt pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
		-c constraints.txt -e '.[agents,experiments,cluster,dev]'
	touch $@

lint: venv
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

test: lint
	$(BIN)/pytest -n $(JOBS) -m 'not slow'

test-all: lint
	$(BIN)/pytest -n $(JOBS)

mutants: venv
	$(BIN)/python -m tests.mutants --jobs $(JOBS)

# Other people's arms for slow tests and benchmarks, into build/arms.
arms: venv
	$(BIN)/python -m tests.arms.fetched

docs: venv
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

# Every kept result anew, training and tuning apart. Started again, it goes on where it was.
SUITES := paper arms others rivals learning robustness estimators vision grasp grasp-neural six-dimensions open-questions
BENCHMARKS := coverage sensitivity speed

results: venv $(if $(filter arms,$(SUITES)),arms)
	for suite in $(SUITES); do \
		$(BIN)/python -m experiments run configs/$$suite.yaml --out build/results/$$suite --jobs $(JOBS) \
		&& $(BIN)/python -m experiments keep build/results/$$suite || exit 1; \
	done
	commit=$$($(BIN)/python -c 'from experiments.running.versions import commit; print(commit())') && \
	for part in $(BENCHMARKS); do \
		grep -qs "\"commit\": \"$$commit\"" build/results/$$part.json \
		|| $(BIN)/python -m experiments benchmark $$part --out build/results/$$part.json || exit 1; \
	done
	cp build/results/coverage.json experiments/results/coverage/coverage.json
	cp build/results/sensitivity.json experiments/results/sensitivity/constants.json
	cp build/results/speed.json experiments/results/speed/two_cores.json
	$(BIN)/python -m experiments results-tables

# Tables between markers in README.md and docs/, from the kept results in experiments/results.
results-tables: venv
	$(BIN)/python -m experiments results-tables

compare: venv
	$(BIN)/python -m experiments run configs/quick.yaml --out runs/quick --jobs $(JOBS)
