# make setup     a virtual environment in .venv with everything the project needs; asks before it installs system
#                libraries, which YES=1 allows; with EXPORT=1 the compilers and emulators that test `ortilo export`, too
# make fly       set up, fly the paper's scenario 2, write its page and picture to out/
# make tables    set up, fly both scenarios 20 times, print the paper's tables beside ours
# make test      set up, run the quick tests: the equations, the commands, short flights; the tight filter, the filter of
#                recordings and the tube run there as plain Python, compiled in the nightly ones
# make rest      set up, with Rerun and, where there are wheels of it, ROS 2, run the tests in processes of their own, and
#                with PART=K/N the K-th of N parts of the nightly ones
# make nightly   the same with all nightly tests: notebooks, training, real time, videos, every scenario compiled (hours)
# make fuzz      set up, spoil 20,000 files and packets at random instead of the 2,000 of the tests
# make check     set up, run the linters
# make bench     set up, measure the speed
# make docs      set up, with Sphinx, build the documentation site, say where it is; with NOTEBOOKS=1 run the notebooks
#                before, so that it shows their outputs (minutes; what has been run is kept in out/notebooks)
# make exercises set up, copy the notebooks without the solutions of their exercises to out/exercises, for students
# make linkcheck set up, with Sphinx, ask every page that the documentation links to whether it is there (network)
# make mutants   set up, change the code in 400 places and see whether a test notices (docs/mutants.md)

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
TESTS ?= tests
# Tests come in random order: `make test PYTEST_ARGS=--randomly-seed=N` repeats a run that printed that seed.
PYTEST_ARGS ?=
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 # a worker is one core's
PYTEST := $(ONE_THREAD) $(BIN)/python -m pytest -n 2 --dist worksteal $(PYTEST_ARGS)
PART ?= 0/1
REST := notebook or training or real_time or processes or video or long
# In these files no test is quick: `make test` need not import them.
REST_ALONE = $(shell grep -rlE "^pytestmark = .*mark\.($(subst $() or ,|,$(REST)))\b" tests --include='test_*.py')
# Containers often forbid Python to keep its bytecode: then each process compiles 1,600 modules anew, for three seconds.
unexport PYTHONDONTWRITEBYTECODE
# What recorded flights the real-data test reads, where they lie beside the checkout.
ifneq ($(wildcard ../shared/data),)
export ORTILO_FLIGHT_DATA ?= $(abspath ../shared/data)
endif
STAMP := $(VENV)/.set-up-$(shell cat pyproject.toml constraints.txt scripts/setup.sh | cksum | cut -d' ' -f1)

.PHONY: setup extras kernels fly tables test rest nightly fuzz export-check check bench docs exercises linkcheck mutants clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt scripts/setup.sh
	@PYTHON="$(PYTHON)" VENV="$(VENV)" YES="$(YES)" bash scripts/setup.sh
	@touch $@

fly: setup
	@$(BIN)/ortilo fly imu_uwb_yolo --html out/imu_uwb_yolo.html --png out/imu_uwb_yolo.png --json out/imu_uwb_yolo.json

tables: setup
	@$(BIN)/ortilo tables --flights 20 --out out/tables --json out/tables/tables.json

# What few users need and `make setup` leaves out. The wheels of ROS 2 are for Python 3.11 on Linux, not elsewhere.
extras: $(STAMP)-extras

$(STAMP)-extras: $(STAMP)
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --no-compile -c constraints.txt -e '.[rerun,ros2]'
	@touch $@

kernels: $(STAMP)-kernels

$(STAMP)-kernels: $(STAMP) tests/compile_kernels.py $(shell find ortilo_drake/ diagrams/ -name '*.py' -not -path '*/__pycache__/*')
	@$(ONE_THREAD) $(BIN)/python tests/compile_kernels.py
	@touch $@

test: kernels
	@$(PYTEST) -m "not ($(REST))" $(addprefix --ignore=,$(REST_ALONE)) $(TESTS)

rest: extras kernels
	@$(PYTEST) -m "$(REST)" --part $(PART) $(TESTS)

nightly: rest

# Whatever reads ORTILO_FUZZ_CASES.
FUZZ := tests/integration/test_schema_fuzz.py tests/interop/test_file_fuzz.py \
	tests/codegen/test_exported_half.py

fuzz: kernels
	@ORTILO_FUZZ_CASES=$${ORTILO_FUZZ_CASES:-20000} $(PYTEST) $(FUZZ)

# Hours: every exportable ready-made flight on Cortex-M7, aarch64 and x86-64, every bit of every tick.
export-check: setup
	@$(ONE_THREAD) $(BIN)/python scripts/export_check.py

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup
	@$(BIN)/python benchmarks/bench_flight.py
	@$(BIN)/python benchmarks/bench_camera.py
	@$(BIN)/python benchmarks/bench_wire.py
	@$(BIN)/python benchmarks/bench_ensemble.py
	@$(BIN)/python benchmarks/bench_cost.py

# A warning fails the build; no network is needed once Sphinx is there.
docs: $(STAMP)-docs
ifneq ($(NOTEBOOKS),)
	@$(ONE_THREAD) $(BIN)/python scripts/run_notebooks.py
endif
	@$(ONE_THREAD) $(BIN)/python -m sphinx -W --keep-going -b html -d out/doctrees docs out/docs
	@echo "documentation: out/docs/index.html"

exercises: setup
	@$(BIN)/python scripts/make_exercises.py

linkcheck: $(STAMP)-docs
	@$(ONE_THREAD) $(BIN)/python -m sphinx -q -b linkcheck -d out/doctrees docs out/linkcheck

$(STAMP)-docs: $(STAMP)
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --no-compile -c constraints.txt -e '.[docs]'
	@touch $@

mutants: setup
	@$(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt -e '.[mutants]'
	@$(BIN)/python scripts/mutants.py

clean:
	rm -rf $(VENV) out build dist *.egg-info docs/made docs/notebooks docs/reference/modules docs/reference/commands.md docs/reference/settings.md
