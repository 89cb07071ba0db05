#!/usr/bin/env bash
# NRRD with "byte skip" and gzip encoding.
#
# One would guess: a byte skip counts bytes of the file, so it comes before decompression; and -1 ("the data end the file")
#   makes no sense with compressed data.
# What happens: the skip counts decompressed bytes, and -1 takes the last bytes of what was decompressed. SimpleITK (teem)
#   does both. pynrrd does -1, but moves by a positive skip twice, once in the file and once after decompression, so it
#   reports an error for a file that teem reads. With raw encoding all agree.
# Why it matters: scanners' raw files with a header of their own are wrapped in this way. A reader that skips in the file
#   finds no gzip stream, or a wrong one.
# Versions: pynrrd 1.1.3, SimpleITK 2.5.7, numpy 2.4.6. Written on 2026-11-28.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pynrrd==1.1.3 SimpleITK==2.5.7

cat > run.py <<'PYTHON'
import gzip

import nrrd
import SimpleITK

head = "NRRD0005\ntype: uint8\ndimension: 2\nsizes: 3 2\nencoding: {}\nbyte skip: {}\n\n"
body = b"8 BYTES:" + bytes(range(6))  # eight bytes to skip, then the voxels 0 to 5
for encoding, data in (("raw", body), ("gzip", gzip.compress(body))):
    for skip in (8, -1):
        with open("a.nrrd", "wb") as out:
            out.write(head.format(encoding, skip).encode() + data)
        itk = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage("a.nrrd")).ravel().tolist()
        print(encoding, skip, "SimpleITK", itk)
        try:
            print(encoding, skip, "pynrrd", nrrd.read("a.nrrd")[0].ravel("F").tolist())
        except Exception as error:
            print(encoding, skip, "pynrrd", "error", error)
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
raw 8 SimpleITK [0, 1, 2, 3, 4, 5]
raw 8 pynrrd [0, 1, 2, 3, 4, 5]
raw -1 SimpleITK [0, 1, 2, 3, 4, 5]
raw -1 pynrrd [0, 1, 2, 3, 4, 5]
gzip 8 SimpleITK [0, 1, 2, 3, 4, 5]
gzip 8 pynrrd error Error -3 while decompressing data: incorrect header check
gzip -1 SimpleITK [0, 1, 2, 3, 4, 5]
gzip -1 pynrrd [0, 1, 2, 3, 4, 5]
EXPECTED

echo "numpy 2.4.6 pynrrd 1.1.3 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
