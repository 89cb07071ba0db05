#!/bin/sh
# Builds the wheel and tests it in a fresh environment, outside of CI: python/test.sh [FOLDER for the wheel]
# PYTHON is the interpreter (3.10 or later; one wheel serves them all). The type hints are held against the module by mypy's
# stubtest, and the example and the tests against the hints by mypy and pyright, which brings a Node of its own.
set -e
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"${PYTHON:-python3}" -m venv "$work/venv"
"$work/venv/bin/pip" install -q 'maturin>=1.9,<2' 'numpy>=1.23' 'pytest>=8' mypy==2.4.1 pyright==1.1.414
(cd "$here" && "$work/venv/bin/maturin" build --release --quiet --out "${1:-$work/wheels}" -i "$work/venv/bin/python")
"$work/venv/bin/pip" install -q --no-deps "${1:-$work/wheels}"/vtex-*.whl
cd "$work"
"$work/venv/bin/python" --version
"$work/venv/bin/mypy" --version
"$work/venv/bin/stubtest" vtex --ignore-missing-stub
"$work/venv/bin/mypy" --strict "$here/examples/profile.py"
"$work/venv/bin/mypy" "$here/tests"
"$work/venv/bin/pyright" --version
"$work/venv/bin/pyright" --pythonpath "$work/venv/bin/python" "$here/examples" "$here/tests"
"$work/venv/bin/python" -m pytest -q "$here/tests"
"$work/venv/bin/python" "$here/examples/profile.py"
