# make setup   a virtual environment in .venv with everything the project needs
# make fly     set up, fly the paper's scenario 2, write its page and picture to out/
# make tables  set up, fly both scenarios 20 times, print the paper's tables beside ours
# make test    set up, run all tests
# make check   set up, run the linters
# make bench   set up, measure the speed

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# The notebooks first: they are one worker's, and would be the long tail.
TESTS ?= tests/integration/test_notebooks.py tests
STAMP := $(VENV)/.set-up-$(shell cat pyproject.toml constraints.txt scripts/setup.sh | cksum | cut -d' ' -f1)

.PHONY: setup fly tables test check bench clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt scripts/setup.sh
	@PYTHON="$(PYTHON)" VENV="$(VENV)" bash scripts/setup.sh
	@touch $@

fly: setup
	@$(BIN)/ortilo fly imu_uwb_yolo --html out/imu_uwb_yolo.html --png out/imu_uwb_yolo.png --json out/imu_uwb_yolo.json

tables: setup
	@$(BIN)/ortilo tables --flights 20 --out out/tables --json out/tables/tables.json

test: setup
	@$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(TESTS)

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup
	@$(BIN)/python benchmarks/bench_flight.py
	@$(BIN)/python benchmarks/bench_camera.py

clean:
	rm -rf $(VENV) out build dist *.egg-info
