#!/usr/bin/env python3
"""Holds landscapes to landscape-1.schema.json; needs the package jsonschema.

    schema.py FILE …           .gltf or .glb; a line for each fault, and exit code 1
"""
import json, struct, sys
from pathlib import Path
from jsonschema import Draft202012Validator

schema = json.loads(Path(__file__).with_name("landscape-1.schema.json").read_text())
Draft202012Validator.check_schema(schema)
validator = Draft202012Validator(schema)
failed = 0
for name in sys.argv[1:]:
    data = Path(name).read_bytes()
    if data[:4] == b"glTF":
        data = data[20:20 + struct.unpack("<I", data[12:16])[0]]
    for error in validator.iter_errors(json.loads(data)):
        failed = 1
        print(f"{name}: {'/'.join(map(str, error.absolute_path))}: {error.message[:200]}")
sys.exit(failed)
