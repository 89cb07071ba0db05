#!/usr/bin/env bash
# A NIfTI file with scl_slope 0 and scl_inter 100.
#
# One would guess: a slope of 0 means "no scaling", as the standard says, so every reader returns the stored numbers.
# What happens: nibabel returns the stored numbers and drops the intercept. SimpleITK takes the slope for 1 but keeps the
#   intercept, so every value is 100 higher (and the type becomes float).
# Why it matters: a threshold or colour map tuned in one tool selects other tissue in the other; slope 0 is what many
#   writers leave in the header when they scale nothing. A reader has to test the slope before it looks at the intercept.
# Versions: nibabel 5.4.2, SimpleITK 2.5.7, numpy 2.4.6. Written on 2026-11-28.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 nibabel==5.4.2 SimpleITK==2.5.7

cat > run.py <<'PYTHON'
import struct

import nibabel
import numpy
import SimpleITK

voxels = numpy.arange(4, dtype=numpy.int16).reshape(4, 1, 1)
for slope in (1.0, 0.0):
    file = bytearray(nibabel.Nifti1Image(voxels, numpy.eye(4)).to_bytes())
    struct.pack_into("<ff", file, 112, slope, 100.0)  # scl_slope, scl_inter
    with open("a.nii", "wb") as out:
        out.write(file)
    print("slope", slope, "nibabel", nibabel.load("a.nii").get_fdata().ravel().tolist())
    image = SimpleITK.ReadImage("a.nii")
    values = SimpleITK.GetArrayFromImage(image).ravel().astype(float).tolist()
    print("slope", slope, "SimpleITK", values)
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
slope 1.0 nibabel [100.0, 101.0, 102.0, 103.0]
slope 1.0 SimpleITK [100.0, 101.0, 102.0, 103.0]
slope 0.0 nibabel [0.0, 1.0, 2.0, 3.0]
slope 0.0 SimpleITK [100.0, 101.0, 102.0, 103.0]
EXPECTED

echo "numpy 2.4.6 nibabel 5.4.2 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
