#!/usr/bin/env bash
# A NIfTI file whose xyzt_units say micrometres and milliseconds.
#
# One would guess: readers either all convert to millimetres and seconds, or all hand over the numbers as they are.
# What happens: nibabel's affine and zooms are in the file's own unit (1 for a voxel of 1 micrometre, 2000 for a step of
#   2000 ms); whoever does not ask get_xyzt_units() takes them for mm. SimpleITK converts: 0.001 mm, and 2 s.
# Why it matters: microscopy and small-animal volumes come in micrometres. Laid over a mesh in mm, the same file is either
#   right or a thousand times too large, depending on the reader.
# Versions: nibabel 5.4.2, SimpleITK 2.5.7, numpy 2.4.6. Written on 2026-11-28.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 nibabel==5.4.2 SimpleITK==2.5.7

cat > run.py <<'PYTHON'
import nibabel
import numpy
import SimpleITK

for space, time in (("mm", "sec"), ("micron", "msec"), ("meter", "sec")):
    image = nibabel.Nifti1Image(numpy.zeros((4, 3, 2, 5), numpy.int16), numpy.eye(4))
    image.header.set_zooms((1, 1, 1, 2000))
    image.header.set_xyzt_units(space, time)
    nibabel.save(image, "a.nii")
    read = nibabel.load("a.nii")
    zooms = [float(z) for z in read.header.get_zooms()]
    spacing = [round(s, 6) for s in SimpleITK.ReadImage("a.nii").GetSpacing()]
    print(space, time, "nibabel", zooms, "affine x", float(read.affine[0, 0]), "SimpleITK", spacing)
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
mm sec nibabel [1.0, 1.0, 1.0, 2000.0] affine x 1.0 SimpleITK [1.0, 1.0, 1.0, 2000.0]
micron msec nibabel [1.0, 1.0, 1.0, 2000.0] affine x 1.0 SimpleITK [0.001, 0.001, 0.001, 2.0]
meter sec nibabel [1.0, 1.0, 1.0, 2000.0] affine x 1.0 SimpleITK [1000.0, 1000.0, 1000.0, 2000.0]
EXPECTED

echo "numpy 2.4.6 nibabel 5.4.2 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
