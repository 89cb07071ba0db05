#!/usr/bin/env bash
# A MetaImage header with ElementToIntensityFunctionSlope 2 and ElementToIntensityFunctionOffset -100.
#
# One would guess: the values are slope · stored + offset, as the names of MetaIO's own tags say and as NIfTI's scl_slope and
#   DICOM's Rescale Slope are, which the same program applies.
# What happens: SimpleITK returns the stored numbers, keeps their type, and does not have the two tags among its metadata.
# Why it matters: a threshold in the units that the header promises selects other matter; what writes such headers and is read
#   by ITK has to scale the numbers itself.
# Versions: SimpleITK 2.5.7, numpy 2.4.6. Written on 2026-11-30.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 SimpleITK==2.5.7

cat > run.py <<'PYTHON'
import SimpleITK

head = "ObjectType = Image\nNDims = 3\nDimSize = 4 1 1\nElementSpacing = 1 1 1\n"
scale = "ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = -100\n"
stored = bytes([0, 1, 2, 3])
for name, more in (("plain", ""), ("scaled", scale)):
    with open("a.mha", "wb") as out:
        out.write((head + more + "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n").encode() + stored)
    image = SimpleITK.ReadImage("a.mha")
    values = SimpleITK.GetArrayFromImage(image).ravel().tolist()
    told = [key for key in image.GetMetaDataKeys() if "Intensity" in key]
    print(name, image.GetPixelIDTypeAsString(), values, told)
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
plain 8-bit unsigned integer [0, 1, 2, 3] []
scaled 8-bit unsigned integer [0, 1, 2, 3] []
EXPECTED

echo "numpy 2.4.6 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
