# Every target that needs the environment makes it first. Bare `make` lists the targets.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

.DEFAULT_GOAL := help
.PHONY: help setup demo pages docs fill messages test test-long check bench corpus interop ray lock clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## make .venv with the pinned dependencies, the command skyproof and its compiled kernels

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "skyproof needs Python 3.11 or newer; name one with: make PYTHON=python3.12 setup")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	$(BIN)/python -m skyproof.app.warm
	@touch $(READY)

demo: $(READY) ## simulate two receivers that are jammed and led away, protect them, write demo/report.html
	$(BIN)/skyproof demo --out demo --overwrite

pages: $(READY) ## draw every ready-made scene, and the errors of clocks and inertial units, in docs/pages
	$(BIN)/skyproof simulate --pages docs/pages

docs: $(READY) ## the manual, with its figures, into site/ (no network); open site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

fill: $(READY) ## what is made into the manual's pages and the notebook, where they are read unbuilt
	$(BIN)/python docs/build/fill.py --run

messages: $(READY) ## every sentence of a finding, printed, and every error message that the tests raise, in docs/pages/messages.md
	$(BIN)/python -m pytest -q -s tests/explain/test_sentences.py -k table
	$(BIN)/python -m pytest -n 2 -q -m "not long" --messages docs/pages/messages.md

test: $(READY) ## the tests, at most five minutes; one that hangs ends with a traceback
	$(BIN)/python -m pytest -n 2 -m "not long" -o faulthandler_timeout=300 -o faulthandler_exit_on_timeout=true

test-long: $(READY) ## counts of false alarms and whole scenes: two hours on two quiet cores; the slowest at the end
	$(BIN)/python -m pytest -n 2 --dist worksteal -m long --durations 20 \
	    -o faulthandler_timeout=3600 -o faulthandler_exit_on_timeout=true

check: $(READY) ## ruff (rules and layout), mypy, the import contracts, then the tests
	$(BIN)/ruff check src tests bench interop docs
	$(BIN)/ruff format --check src tests bench interop docs
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(MAKE) --no-print-directory test

bench: $(READY) ## speed, each figure beside what it is compared with
	$(BIN)/python bench/run.py

corpus: $(READY) ## what is said of many scenes and files, into .cache/corpus.jsonl, to hold two trees against each other
	$(BIN)/python bench/corpus.py --out .cache/corpus.jsonl

interop: $(READY) ## the same recordings through independent receivers, signal by signal (where installed)
	$(BIN)/python interop/run.py

ray: $(READY) ## the extra ray into .venv, for fleets on many machines and its tests (240 MB)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-ray.lock

lock: $(READY) ## pin the newest versions anew (needs uv)
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
	    --no-emit-index-url --no-emit-find-links --group dev pyproject.toml -o requirements.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
	    --no-emit-index-url --no-emit-find-links --extra ray --constraints requirements.lock pyproject.toml \
	    -o requirements-ray.lock

clean: ## remove the environment and what was made
	rm -rf .venv demo docs/pages site .cache .mypy_cache .ruff_cache .pytest_cache .hypothesis
