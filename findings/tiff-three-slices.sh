#!/usr/bin/env bash
# A volume of three or four slices, written by tifffile.imwrite without further arguments.
#
# One would guess: N slices become N pages, as for every other N.
# What happens: with three or four slices the file has one page: an RGB (or RGB and alpha) picture whose planes are the
#   slices, for uint8 as here and also for uint16, int16 and float32. Two or five slices are pages. tifffile gives a
#   warning, which a batch job hides. The argument photometric="minisblack" keeps the slices apart.
# Why it matters: thick-slice scans and tests with small volumes hit 3 and 4. A reader of stacks sees one coloured slice,
#   and SimpleITK turns it into a two-dimensional image.
# Versions: tifffile 2026.3.3, SimpleITK 2.5.7, numpy 2.4.6. Written on 2026-11-28.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 tifffile==2026.3.3 SimpleITK==2.5.7

cat > run.py <<'PYTHON'
import warnings

import numpy
import SimpleITK
import tifffile

warnings.simplefilter("ignore")
for slices, options in ((2, {}), (3, {}), (4, {}), (5, {}), (3, {"photometric": "minisblack"})):
    tifffile.imwrite("a.tif", numpy.zeros((slices, 40, 50), numpy.uint8), **options)
    with tifffile.TiffFile("a.tif") as file:
        kind = file.pages[0].photometric.name
        pages = len(file.pages)
    image = SimpleITK.ReadImage("a.tif")
    size = (image.GetSize(), image.GetNumberOfComponentsPerPixel())
    print(slices, "slices", options or "", "pages", pages, kind, "SimpleITK size, components", *size)
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
2 slices  pages 2 MINISBLACK SimpleITK size, components (50, 40, 2) 1
3 slices  pages 1 RGB SimpleITK size, components (50, 40) 4
4 slices  pages 1 RGB SimpleITK size, components (50, 40) 4
5 slices  pages 5 MINISBLACK SimpleITK size, components (50, 40, 5) 1
3 slices {'photometric': 'minisblack'} pages 3 MINISBLACK SimpleITK size, components (50, 40, 3) 1
EXPECTED

echo "numpy 2.4.6 tifffile 2026.3.3 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
