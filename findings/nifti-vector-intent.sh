#!/usr/bin/env bash
# A NIfTI file of vectors (five dimensions, the last of 3), read by SimpleITK.
#
# One would guess: SimpleITK turns the file's RAS axes into its LPS axes, so it negates x and y of the geometry and of the
#   vectors alike; or of neither.
# What happens: the geometry is always turned. The vectors are turned with intent 1006 (displacement vectors) and are left
#   alone with intent 1007 (vectors of any meaning), so there they are no longer in the axes of the image. SimpleITK
#   itself writes 1007.
# Why it matters: directions of fibres, gradients and velocities are stored either way. With 1007, arrows over the anatomy
#   are turned half round the z axis, which a symmetric brain hides well.
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

vectors = numpy.tile(numpy.array([1, 2, 3], numpy.float32), (4, 3, 2, 1, 1))
for intent in (1006, 1007):
    image = nibabel.Nifti1Image(vectors, numpy.eye(4))
    image.header.set_intent(intent)
    nibabel.save(image, "a.nii")
    itk = SimpleITK.ReadImage("a.nii")
    axes = [int(itk.GetDirection()[k]) for k in (0, 4, 8)]
    print("intent", intent, "file [1, 2, 3]", "axes", axes, "vector", list(itk.GetPixel(0, 0, 0)))

itk = SimpleITK.GetImageFromArray(numpy.zeros((2, 3, 4, 3), numpy.float32), isVector=True)
SimpleITK.WriteImage(itk, "b.nii")
print("SimpleITK writes intent", int(nibabel.load("b.nii").header["intent_code"]))
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
intent 1006 file [1, 2, 3] axes [-1, -1, 1] vector [-1.0, -2.0, 3.0]
intent 1007 file [1, 2, 3] axes [-1, -1, 1] vector [1.0, 2.0, 3.0]
SimpleITK writes intent 1007
EXPECTED

echo "numpy 2.4.6 nibabel 5.4.2 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
