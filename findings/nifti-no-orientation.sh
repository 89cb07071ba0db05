#!/usr/bin/env bash
# A NIfTI file whose qform_code and sform_code are both 0 ("method 1" of the standard: only pixdim is known).
#
# One would guess: the position of voxel (i, j, k) is (2i, 2j, 2k) for 2 mm voxels, as the standard's method 1 says; or
#   at least, all readers agree.
# What happens: nibabel puts the middle of the volume at the origin and lets x run from right to left (the old ANALYZE
#   convention). SimpleITK puts voxel (0, 0, 0) at the origin, with its own axes (x to the left, y to the back): in RAS,
#   x and y run the other way. The two agree on the sense of x but not of y, and not on the origin. Neither is method 1.
# Why it matters: a mesh or tractogram made over such a volume in one tool lies mirrored and shifted in the other, and
#   each picture looks plausible alone.
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

# An image without an affine gets both codes 0.
image = nibabel.Nifti1Image(numpy.zeros((5, 7, 9), numpy.int16), None)
image.header.set_zooms((2, 2, 2))
nibabel.save(image, "a.nii")

read = nibabel.load("a.nii")
print("codes", int(read.header["qform_code"]), int(read.header["sform_code"]))
itk = SimpleITK.ReadImage("a.nii")
for index in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
    near = (read.affine @ (*index, 1))[:3].tolist()
    x, y, z = itk.TransformIndexToPhysicalPoint(index)
    # SimpleITK works in LPS; RAS has x and y negated. Adding 0 turns -0 into 0.
    print(index, "nibabel RAS mm", near, "SimpleITK RAS mm", [0 - x, 0 - y, z])
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
codes 0 0
(0, 0, 0) nibabel RAS mm [4.0, -6.0, -8.0] SimpleITK RAS mm [0.0, 0.0, 0.0]
(1, 0, 0) nibabel RAS mm [2.0, -6.0, -8.0] SimpleITK RAS mm [-2.0, 0.0, 0.0]
(0, 1, 0) nibabel RAS mm [4.0, -4.0, -8.0] SimpleITK RAS mm [0.0, -2.0, 0.0]
(0, 0, 1) nibabel RAS mm [4.0, -6.0, -6.0] SimpleITK RAS mm [0.0, 0.0, 2.0]
EXPECTED

echo "numpy 2.4.6 nibabel 5.4.2 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
