#!/usr/bin/env bash
# A DICOM image with Rescale Slope 0 and Rescale Intercept -5.
#
# One would guess: the values are 0 · stored - 5, by the formula of PS3.3 C.11.1.1.2, so all are -5; or the file is refused.
# What happens: pydicom returns -5 for every pixel. SimpleITK (by GDCM) takes the slope for 1 and keeps the intercept, so the
#   picture is there.
# Why it matters: some writers leave 0 where they scale nothing. What follows the formula shows an even grey where a viewer that is
#   built on ITK shows an image, and an automatic threshold has nothing to part.
# Versions: pydicom 3.0.2, SimpleITK 2.5.7, numpy 2.4.6. Written on 2026-11-30.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv env
env/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pydicom==3.0.2 SimpleITK==2.5.7

cat > run.py <<'PYTHON'
import numpy
import pydicom
import SimpleITK
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.pixels import apply_modality_lut
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

for slope in ("1", "0"):
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.TransferSyntaxUID = CTImageStorage, ExplicitVRLittleEndian
    meta.MediaStorageSOPInstanceUID = generate_uid()
    image = Dataset()
    image.file_meta = meta
    image.SOPClassUID, image.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
    image.StudyInstanceUID = image.SeriesInstanceUID = "1.2.3"
    image.Modality, image.PhotometricInterpretation = "CT", "MONOCHROME2"
    image.Rows, image.Columns, image.SamplesPerPixel = 2, 2, 1
    image.BitsAllocated = image.BitsStored = 16
    image.HighBit, image.PixelRepresentation = 15, 1
    image.PixelSpacing, image.ImagePositionPatient = [1, 1], [0, 0, 0]
    image.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    image.RescaleSlope, image.RescaleIntercept = slope, "-5"
    image.PixelData = numpy.arange(4, dtype="<i2").tobytes()
    image["PixelData"].VR = "OW"
    image.save_as("a.dcm", enforce_file_format=True)
    read = pydicom.dcmread("a.dcm")
    print("slope", slope, "pydicom", apply_modality_lut(read.pixel_array, read).ravel().tolist())
    values = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage("a.dcm")).ravel().astype(float).tolist()
    print("slope", slope, "SimpleITK", values)
PYTHON
env/bin/python run.py > seen 2> noise || { cat noise >&2; exit 1; }

cat > expected <<'EXPECTED'
slope 1 pydicom [-5.0, -4.0, -3.0, -2.0]
slope 1 SimpleITK [-5.0, -4.0, -3.0, -2.0]
slope 0 pydicom [-5.0, -5.0, -5.0, -5.0]
slope 0 SimpleITK [-5.0, -4.0, -3.0, -2.0]
EXPECTED

echo "numpy 2.4.6 pydicom 3.0.2 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
