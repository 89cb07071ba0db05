#!/bin/sh
# Round trips with a real Blender (the bpy package, some 370 MB), outside of CI: blender/tests/run.sh [FOLDER for the pictures]
# PYTHON is a Python that the chosen bpy has a wheel for: 3.11 for bpy 4.2 to 5.0, 3.13 for 5.1 and later. BPY is its version.
# VTEX=path takes another program than that of the release build, which is then not built.
set -e
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
[ -n "$VTEX" ] || (cd "$here/../.." && cargo build --release --bin vtex)
"${PYTHON:-python3.13}" -m venv "$work/venv"
"$work/venv/bin/pip" install -q "bpy==${BPY:-5.3.0}"
zip=$("$here/../build.sh")
VTEX=$(realpath "${VTEX:-$here/../../target/release/vtex}") "$work/venv/bin/python" "$here/roundtrip.py" "$here/../../$zip" "$@"
