#!/bin/sh
# Finds a Python that runs and lets it set up .venv (tools/bootstrap.py).
# PYTHON: the interpreter to use instead of searching.
cd "$(dirname "$0")/.." || exit 1

version() { # a name on PATH may not run: pyenv leaves such shims behind
    "$1" -I -S -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}

for candidate in ${PYTHON:-.venv/bin/python python3.11 python3.12 python3}; do
    found=$(version "$candidate")
    case $found in
        3.11 | 3.12) exec "$candidate" -I -S tools/bootstrap.py ;;
        "") seen="$seen $candidate: does not run;" ;;
        *) seen="$seen $candidate: Python $found;" ;;
    esac
done
echo "make: wrong Python: 3.11 or 3.12 is needed, found$seen" \
    "install python3.11 with its venv and dev packages, or name one: make PYTHON=/path/to/python3.11" >&2
exit 1
