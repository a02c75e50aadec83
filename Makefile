# Everything sets itself up in .venv; it needs Python 3.11 or later with venv, and make.
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin

.PHONY: demo test lint bench docs docs-pictures sessions format clean

demo: $(VENV)/ready
	$(RUN)/pomolog demo

test: $(VENV)/ready-dev
	$(RUN)/python -m pytest -n auto --dist loadgroup

lint: $(VENV)/ready-dev
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/mypy

bench: $(VENV)/ready-dev
	$(RUN)/python -m benchmarks

docs: $(VENV)/ready-dev # the site of docs/, in results/site/index.html
	$(RUN)/python -m sphinx --builder html --nitpicky --fail-on-warning --quiet docs results/site

docs-pictures: $(VENV)/ready-dev # needs Chromium and Mesa's Vulkan (mesa-vulkan-drivers)
	$(RUN)/python -m tests.visual.documents
	$(RUN)/python -m tests.visual.debugging
	$(RUN)/python -m benchmarks.colours --real ../shared/data --plot docs/orchard-colours.png
	$(RUN)/python -m benchmarks.failures sessions/segmentation-*-test.mcap \
		sessions/matching-*-test.mcap sessions/distance-*.mcap --out docs/pictures

sessions: $(VENV)/ready-orchard # about an hour; also needs LLVM 19 (on Debian: libllvm19)
	$(RUN)/python sessions/make_sessions.py

format: $(VENV)/ready-dev
	$(RUN)/ruff check --fix .
	$(RUN)/ruff format .

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "pomolog needs Python 3.11 or later; try: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2> /dev/null || \
		{ echo "$(PYTHON) comes without venv; on Debian and Ubuntu: sudo apt install python3-venv"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); exit 1; }

$(VENV)/ready: pyproject.toml | $(VENV)/bin/python
	@echo "installing what pomolog needs into $(VENV) (once; 1.2 GB there, some minutes on a slow line)"
	@$(RUN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/ready-dev: pyproject.toml | $(VENV)/bin/python
	@echo "installing what pomolog and its tests need into $(VENV) (once; some minutes on a slow line)"
	@$(RUN)/python -m pip install --quiet --disable-pip-version-check --editable '.[cluster,dev,orchard,s3,train]'
	@touch $@ $(VENV)/ready

$(VENV)/ready-orchard: pyproject.toml | $(VENV)/bin/python
	@echo "installing what the digital orchard needs into $(VENV) (once)"
	@$(RUN)/python -m pip install --quiet --disable-pip-version-check --editable '.[orchard]'
	@touch $@

clean:
	rm -rf $(VENV) results .pytest_cache .mypy_cache .ruff_cache .hypothesis
