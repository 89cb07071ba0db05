#!/usr/bin/env bash
# A DICOM image with Photometric Interpretation MONOCHROME1 (low values are shown bright).
#
# One would guess: MONOCHROME1 is only about display, so all readers return the stored values.
# What happens: pydicom returns the stored values. SimpleITK inverts them (4095 - stored, for 12 bits) and only then applies
#   slope and intercept, while its metadata still says MONOCHROME1. Whoever inverts because of that does it twice.
# Why it matters: a radiograph's densities come out reversed in one of two common readers. A reader that is checked against
#   the other one will look wrong.
# Versions: pydicom 3.0.2, SimpleITK 2.5.7, numpy 2.4.6. Written on 2026-11-28.
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

stored = numpy.array([[0, 1000, 2000, 4095]], numpy.uint16)
for interpretation in ("MONOCHROME2", "MONOCHROME1"):
    meta = FileMetaDataset()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = CTImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid()
    image = Dataset()
    image.file_meta = meta
    image.SOPClassUID = meta.MediaStorageSOPClassUID
    image.SOPInstanceUID = meta.MediaStorageSOPInstanceUID
    image.Modality = "CT"
    image.Rows, image.Columns = stored.shape
    image.SamplesPerPixel = 1
    image.BitsAllocated, image.BitsStored, image.HighBit = 16, 12, 11
    image.PixelRepresentation = 0
    image.PhotometricInterpretation = interpretation
    image.RescaleSlope, image.RescaleIntercept = 2, -1024
    image.PixelSpacing = [1, 1]
    image.ImagePositionPatient = [0, 0, 0]
    image.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    image.PixelData = stored.tobytes()
    image.save_as("a.dcm", enforce_file_format=True)

    read = pydicom.dcmread("a.dcm")
    print(interpretation, "pydicom", apply_modality_lut(read.pixel_array, read).ravel().astype(int).tolist())
    itk = SimpleITK.ReadImage("a.dcm")
    values = SimpleITK.GetArrayFromImage(itk).ravel().astype(int).tolist()
    print(interpretation, "SimpleITK", values, "metadata", itk.GetMetaData("0028|0004").strip())
PYTHON
env/bin/python run.py > seen

cat > expected <<'EXPECTED'
MONOCHROME2 pydicom [-1024, 976, 2976, 7166]
MONOCHROME2 SimpleITK [-1024, 976, 2976, 7166] metadata MONOCHROME2
MONOCHROME1 pydicom [-1024, 976, 2976, 7166]
MONOCHROME1 SimpleITK [7166, 5166, 3166, -1024] metadata MONOCHROME1
EXPECTED

echo "numpy 2.4.6 pydicom 3.0.2 SimpleITK 2.5.7, $(python3 --version)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
