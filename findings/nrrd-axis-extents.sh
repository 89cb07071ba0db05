#!/usr/bin/env bash
# The extents of an NRRD's axes (`axis mins`, `axis maxs`) where it gives no spacings and no directions.
#
# One would guess: a reader takes both the distance of samples and the place of the first from them, or neither.
# What happens: SimpleITK places the first sample half a distance of 1.5, 2 and 3 behind the mins, so it has computed these distances;
#   but the spacing that it gives is 1, 1, 1. pynrrd hands the fields on and uses neither.
# Why it matters: a volume of 30 × 48 × 48 mm comes out as 20 × 24 × 16, at a place that is right.
# Versions: SimpleITK 2.5.7, pynrrd 1.1.3, numpy 2.4.6. Written on 2026-11-29.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check SimpleITK==2.5.7 pynrrd==1.1.3 numpy==2.4.6

cat > run.py <<'PYTHON'
import nrrd
import SimpleITK as sitk

head = ["NRRD0004", "type: uchar", "dimension: 3", "sizes: 20 24 16", "encoding: raw", "centers: cell cell cell",
        "axis mins: 0 0 0", "axis maxs: 30 48 48", "", ""]
open("extents.nrrd", "wb").write("\n".join(head).encode() + bytes(20 * 24 * 16))
image = sitk.ReadImage("extents.nrrd")
print("SimpleITK spacing", image.GetSpacing(), "origin", image.GetOrigin())
header = nrrd.read_header("extents.nrrd")
print("pynrrd", sorted(k for k in header if "spac" in k or "axis" in k))
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
SimpleITK spacing (1.0, 1.0, 1.0) origin (0.75, 1.0, 1.5)
pynrrd ['axis maxs', 'axis mins']
EXPECTED

echo "SimpleITK 2.5.7 pynrrd 1.1.3 numpy 2.4.6, $(env/bin/python --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
