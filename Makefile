# The two commands are `make demo` and `make test`; both do all their own set-up.
# Everything lives in .venv; remove it to start afresh.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
OUTPUT ?= demo-output

# Two tests run at a time; make test WORKERS= runs them one after another.
WORKERS ?= -n 2 --dist worksteal
# The plugin's tests wait much of their time: for flights, for idle moments, for frames.
PLUGIN_WORKERS ?= $(subst -n 2,-n 4,$(WORKERS))

export UNPACK_REQUIRE_GL ?= 1
# Where it is set, every process of the tests would compile a thousand modules anew.
export PYTHONDONTWRITEBYTECODE :=
export NAPARI_CONFIG ?=

# Nothing but what the file names, and only if its hash is right.
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r

.PHONY: setup kernels demo test test-plain test-plugin test-web lint licences requirements audit bench soak fuzz reliability screenshots weights docs wheel dist workflows clean

setup: $(READY)

$(READY): pyproject.toml requirements/dev.txt tools/system-libraries.sh
	@bash tools/system-libraries.sh
	@echo "[setup] virtual environment in $(VENV)"
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; name one with make PYTHON=...")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "[setup] packages (a few minutes the first time)"
	@$(INSTALL) requirements/dev.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

# Kernels compiled before an edit of what they inline; the tests see to it themselves.
kernels: $(READY)
	@$(BIN)/python tools/fresh_kernels.py

# With a screen this opens napari on a packed bag; without one the same plugin runs on a
# virtual screen and writes pictures, a movie and a table to $(OUTPUT).
#   make demo INPUT=scan.npz LABELS=labels.npz
demo: $(READY) kernels
	@bash tools/on-a-screen.sh $(BIN)/napari-unpack demo $(if $(INPUT),"$(INPUT)") \
	  $(if $(LABELS),--labels "$(LABELS)") --output "$(OUTPUT)"

# They open a real viewer.
VIEWER_TESTS := tests/layers tests/viewer tests/widgets

test: test-plain test-plugin

test-plain: $(READY)
	@echo "[test 1/2] algorithms, ray casting, shaders"
	@PYOPENGL_PLATFORM=egl EGL_PLATFORM=surfaceless $(BIN)/python -m pytest $(WORKERS) tests $(addprefix --ignore=,$(VIEWER_TESTS))

test-plugin: $(READY)
	@echo "[test 2/2] the plugin in a real viewer on a virtual screen"
	@VIRTUAL_SCREEN=1 bash tools/on-a-screen.sh $(BIN)/python -m pytest $(PLUGIN_WORKERS) $(VIEWER_TESTS)

# The interactive page in headless Chromium, object by object as in the plugin; $(OUTPUT)/web-steps.png
# shows both. Chromium comes from the system's packages.
test-web: $(READY)
	@$(INSTALL) requirements/web.txt
	@bash tools/system-libraries.sh chromium
	@OUTPUT="$(OUTPUT)" PYOPENGL_PLATFORM=egl EGL_PLATFORM=surfaceless $(BIN)/python -m pytest tests/io/pages_in_a_browser.py

lint: $(READY)
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/mypy
	@PATH="$(CURDIR)/$(BIN):$$PATH" lint-imports
	@$(BIN)/npe2 validate napari_unpack

# Name, version and licence of all that is installed; fails on what is neither permissive nor LGPL.
licences: $(READY)
	@$(BIN)/python tools/licences.py

# The hashed files from pyproject.toml; versions stay unless make requirements UPGRADE=--upgrade.
LOCK = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
  --custom-compile-command "make requirements" $(UPGRADE)
requirements: $(READY)
	@$(INSTALL) requirements/tools.txt
	@$(LOCK) pyproject.toml --group dev -o requirements/dev.txt
	@$(LOCK) --group bench -c requirements/dev.txt -o requirements/bench.txt
	@$(LOCK) --group tools -c requirements/dev.txt -o requirements/tools.txt
	@$(LOCK) --group docs -c requirements/dev.txt -c requirements/tools.txt -o requirements/docs.txt
	@$(LOCK) --group web -c requirements/dev.txt -o requirements/web.txt

# All that ships trained, in place and in the order in which one learns from the other: nine hours on
# two cores, and 8 GB of disk. make weights SHORTEN=130 tries it; `git checkout` of the folder brings
# back what shipped.
WEIGHTS := src/napari_unpack/segmentation/weights
SHORTEN ?= 1
weights: $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --group train
	@$(BIN)/python -m benchmarks.boundaries $(WEIGHTS)/boundary_network.onnx --shorten $(SHORTEN)
	@$(BIN)/python -m benchmarks.segmentation.part_merging_training $(WEIGHTS)/part_merging.npz --workers 2 --shorten $(SHORTEN)
	@$(BIN)/python -m benchmarks.segmentation.part_splitting_training $(WEIGHTS)/part_splitting.npz --workers 2 --shorten $(SHORTEN)
	@$(BIN)/python -m benchmarks.segmentation.border_training $(WEIGHTS)/border_classifier.npz --workers 2 --shorten $(SHORTEN)
	@$(BIN)/python benchmarks/train_oracle.py $(WEIGHTS)/oracle.npz

# The documentation site in site/: open site/index.html. Pages need no network, nor does the build.
docs: $(READY)
	@$(INSTALL) requirements/docs.txt
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# Wheel and sdist in dist/, looked over.
wheel: $(READY)
	@$(INSTALL) requirements/tools.txt
	@rm -rf dist
	@$(BIN)/python -m build --no-isolation --outdir dist . >/dev/null 2>&1 || { echo "the build failed: $(BIN)/python -m build --no-isolation"; exit 1; }
	@$(BIN)/twine check --strict dist/*
	@$(BIN)/check-manifest --no-build-isolation
	@$(BIN)/npe2 validate napari_unpack

# And each tried as a person gets it: installed into a fresh environment, without the repository,
# where the plugin unpacks its sample bag. Installs from the package index; minutes.
dist: wheel
	@VIRTUAL_SCREEN=1 bash tools/on-a-screen.sh $(BIN)/python tools/check_dist.py dist

# The workflows, against their schema and for what is unsafe in them.
workflows: $(READY)
	@$(INSTALL) requirements/tools.txt
	@$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	@$(BIN)/zizmor --offline --quiet .github/workflows

# Known advisories on what the hashed files name (asks the package index).
audit: $(READY)
	@$(INSTALL) requirements/tools.txt
	@$(BIN)/pip-audit --strict --disable-pip --require-hashes $(addprefix -r ,$(wildcard requirements/*.txt))

bench: $(READY) kernels
	@$(INSTALL) requirements/bench.txt
	@VIRTUAL_SCREEN=1 bash tools/on-a-screen.sh $(BIN)/python -m benchmarks $(ROWS)

# 10,000 damaged files of each reader, 200 killed saves, 1,000 rounds of memory; for less of the
# first, make fuzz SECONDS=600.
fuzz: $(READY)
	@$(BIN)/python tests/io/damaged_files.py 10000 $(or $(SECONDS),86400)
	@folder=$$(mktemp -d) && $(BIN)/python tests/io/saves_at_risk.py killed $$folder/killed 200; rm -rf $$folder
	@$(BIN)/python tests/io/memory_rounds.py 1000

# The rows of docs/reliability.md, and how many tests stand behind each.
reliability: $(READY)
	@VIRTUAL_SCREEN=1 bash tools/on-a-screen.sh $(BIN)/python tests/reliability_table.py

# An hour of random commands on the plugin; make soak SECONDS=600 for less.
soak: $(READY) kernels
	@VIRTUAL_SCREEN=1 bash tools/on-a-screen.sh $(BIN)/python tools/soak.py --seconds $(or $(SECONDS),3600)

screenshots: $(READY) kernels
	@VIRTUAL_SCREEN=1 bash tools/on-a-screen.sh $(BIN)/python tools/screenshots.py docs/gallery

clean:
	rm -rf $(VENV) build dist site demo-output src/*.egg-info
