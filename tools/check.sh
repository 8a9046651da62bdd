#!/bin/sh
# Runs the named groups of checks (lint, library, slow, ros) to their end, then sums up.
cd "$(dirname "$0")/.." || exit 1
summary=""
failed=0

check() { # name, command...
    name=$1
    shift
    printf '\n== %s\n' "$name"
    if "$@"; then
        summary="$summary\n  ok      $name"
    else
        summary="$summary\n  FAILED  $name"
        failed=$((failed + 1))
    fi
}

parallel() { # marker: as many processes as cores, up to 4, one thread each
    env OMP_NUM_THREADS=1 .venv/bin/python -m pytest -m "$1" \
        --numprocesses auto --maxprocesses 4 --dist worksteal
}

for group in "$@"; do
    case $group in
        lint)
            check "ruff check" .venv/bin/ruff check .
            check "ruff format" .venv/bin/ruff format --check .
            check "mypy" .venv/bin/mypy
            check "import contracts" .venv/bin/lint-imports
            ;;
        library) check "library tests" parallel "not ros and not slow" ;;
        slow) check "slow tests" parallel "slow and not ros" ;;
        ros) check "ROS tests" .venv/bin/python -m pytest -m ros ;;
        *) check "$group: lint, library, slow or ros" false ;;
    esac
done
printf "\n== summary$summary\n"
[ "$failed" -eq 0 ]
