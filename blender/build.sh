#!/bin/sh
# Packs the extension: blender/vtex_texels-VERSION.zip, for Edit → Preferences → Get Extensions → Install from Disk.
set -e
cd "$(dirname "$0")"
version=$(sed -n 's/^version = "\(.*\)"/\1/p' vtex_texels/blender_manifest.toml)
rm -f "vtex_texels-$version.zip"
python3 - "$version" <<'PY'
import sys, zipfile, pathlib
with zipfile.ZipFile(f"vtex_texels-{sys.argv[1]}.zip", "w", zipfile.ZIP_DEFLATED) as z:
    for path in sorted(pathlib.Path("vtex_texels").glob("*")):
        if path.suffix in (".py", ".toml"):
            z.write(path, path.name)
    z.write("LICENSE", "LICENSE")
PY
echo "blender/vtex_texels-$version.zip"
