# Everything a newcomer needs: `make demo`. Each target sets up .venv first if it must.
.POSIX:
.PHONY: help setup demo test lint

PYTHON =
TORCH_INDEX =
SEED = 0
ARGS =

help:
	@echo "make demo            clear a seeded table with real ROS 2 and physics (SEED=0, ARGS=...)"
	@echo "make test            run every check and test"
	@echo "make lint            run only ruff, mypy and import-linter"
	@echo "make setup           make .venv: pinned packages, messages, the neugrasp command"
	@echo "  PYTHON=PATH        take this interpreter, 3.11 or 3.12"
	@echo "  TORCH_INDEX=URL    look here too for torch, to get its CPU build"

setup:
	@PYTHON="$(PYTHON)" TORCH_INDEX="$(TORCH_INDEX)" sh tools/setup.sh

demo: setup
	.venv/bin/neugrasp demo --seed $(SEED) $(ARGS)

test: setup
	@sh tools/check.sh lint library slow ros

lint: setup
	@sh tools/check.sh lint
