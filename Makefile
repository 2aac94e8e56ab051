# make run | test | bench | soak | paper | lint | docs | clean, and for oneself: fast | fix
# PYTHON=python3.12 make run     another interpreter, 3.11 or newer

PYTHON  ?= python3
VENV    := .venv
BIN     := $(VENV)/bin
SECONDS ?= 60
PIP     := PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install -qq -c constraints.txt
FILES   := pyproject.toml constraints.txt

.DEFAULT_GOAL := help
.PHONY: run test fast bench soak paper lint fix docs clean help
.DELETE_ON_ERROR:

help:
	@echo "make run    the dragon, from a bare checkout to its report"
	@echo "make test   the whole suite            make fast   without the slow tests"
	@echo "make lint   style, types, imports      make fix    what can be put right by itself"
	@echo "make paper  the paper's figures made again, quickly, into docs/paper.md"
	@echo "make soak   seeded faults, SECONDS=$(SECONDS)    make bench  the speed tables"
	@echo "make docs   the pages, in site/        make clean  remove what was made"

# $(VENV)/whole says where the environment was finished: one left half-made, or moved since, is made anew.
ifneq ($(shell test -x $(BIN)/python && cat $(VENV)/whole 2>/dev/null),$(CURDIR))
$(shell rm -f $(VENV)/whole $(VENV)/*.stamp)
endif

$(VENV)/user.stamp: $(FILES)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { echo "error: swarmer needs \
	Python 3.11 or newer, and $(PYTHON) is not; name another: make PYTHON=python3.11 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "error: $(PYTHON) comes without venv; \
	install it (Debian: apt install python3-venv)" >&2; exit 1; }
	@echo "making $(VENV); this takes a minute or some ..." >&2
	@test -e $(VENV)/whole || $(PYTHON) -m venv --clear $(VENV)
	@rm -f $(VENV)/whole
	@$(PIP) -e .
	@echo "$(CURDIR)" > $(VENV)/whole && touch $@

$(VENV)/dev.stamp: $(VENV)/user.stamp
	@echo "adding the test tools to $(VENV) ..." >&2
	@rm -f $(VENV)/whole
	@$(PIP) -e ".[dev,docs]"
	@echo "$(CURDIR)" > $(VENV)/whole && touch $@

run: $(VENV)/user.stamp
	@out=$$($(BIN)/swarmer-run --shape dragon --lambda 500) || exit $$?; \
	echo "$$out"; run=$$(echo "$$out" | tail -n 1); \
	$(BIN)/swarmer report "$$run" || exit $$?; \
	printf '\nThe result lies in %s, its report is %s/report.html\n' "$$run" "$$run"; \
	printf 'Watch it:              $(BIN)/swarmer replay %s\n' "$$run"; \
	printf 'or in a browser page:  $(BIN)/swarmer replay --web %s\n' "$$run"

test: $(VENV)/dev.stamp
	@$(BIN)/python -m pytest $(ARGS)

fast: $(VENV)/dev.stamp
	@$(BIN)/python -m pytest -q -m "not slow and not processes and not web" $(ARGS)

bench: $(VENV)/dev.stamp
	@$(BIN)/python scripts/bench.py

soak: $(VENV)/dev.stamp
	@$(BIN)/python -m swarmer simulate --seconds $(SECONDS)

paper: $(VENV)/user.stamp
	@$(BIN)/python scripts/paper_page.py

lint: $(VENV)/dev.stamp
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/codespell
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/mypy
	@$(BIN)/python scripts/settings_reference.py --check

fix: $(VENV)/dev.stamp
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .
	@$(BIN)/python scripts/settings_reference.py

docs: $(VENV)/dev.stamp
	@$(BIN)/python scripts/settings_reference.py
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "site/index.html"

clean:
	@rm -rf $(VENV) build dist site *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis \
	  .import_linter_cache .coverage* htmlcov
	@find swarmer tests scripts -name __pycache__ -type d -prune -exec rm -rf {} +
