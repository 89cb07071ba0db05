#!/usr/bin/env python3
"""A table of the demo's landscapes: what each takes, and how far its picture is from the truth.

    bench/landscapes.py VTEX [-o FOLDER] [--size 640x360] [--samples 64] [NAME ...]

runs the scripts of samples/landscapes as they are, but for this: every texel gets the mesh of its source (`vtex export`), so that
a reference can be traced, and each picture is rendered at SIZE, by one lane and without haze or tone, beside its reference of
SAMPLES samples a pixel under the same sky. Sources without a mesh, as hypertextures, have no reference: a dash. One line a
picture, as Markdown: seconds of the whole script, of the picture (wall clock, two threads), peak memory, bytes read of bytes
there, FLIP and bias under a sky with occlusion. Not for CI: it takes some ten minutes a landscape.
"""
import argparse
import json
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = ROOT / "samples" / "landscapes"
# Of bake's options, those that a mesh of the source knows, and how many words they take. Light that comes through is the texel's: a
# mesh has one colour of it for each material, and a texel that of each place.
OF_SOURCES = {"-r": 1, "--albedo": 1, "--tint": 0, "--material": 1, "--define": 1, "--seed": 1}
# What a picture has of its own, and a measurement not.
LEFT_OUT = {"--size": 1, "--lanes": 1, "--haze": 1, "-o": 1, "--tonemap": 1, "--frames": 1, "--fps": 1, "--exposure": 1}


def options(words, known):
    """The options among `words` that are `known`, and all other words."""
    taken, rest, i = [], [], 0
    while i < len(words):
        more = known.get(words[i])
        if more is None:
            rest.append(words[i])
            i += 1
        else:
            taken.append(words[i : i + 1 + more])
            i += 1 + more
    return taken, rest


def commands(script):
    """The words of each of the script's commands of vtex; a backslash continues a line."""
    text = script.read_text().replace("\\\n", " ").replace("$S", str(ROOT / "samples"))
    return [shlex.split(line)[1:] for line in text.splitlines() if line.startswith("vtex ")]


class Landscape:
    def __init__(self, vtex, name, folder):
        self.vtex, self.name, self.folder = vtex, name, folder
        self.meshes, self.seconds = {}, 0.0
        folder.mkdir(parents=True, exist_ok=True)

    def run(self, words, may_fail=False):
        start = time.monotonic()
        done = subprocess.run([self.vtex, *words], cwd=self.folder, capture_output=True, text=True)
        if done.returncode != 0 and not may_fail:
            sys.exit(f"{shlex.join(['vtex', *words])}: {done.stderr.strip()}")
        return done, time.monotonic() - start

    def bake(self, words):
        _, seconds = self.run(words + ["-q"])
        self.seconds += seconds
        output = words[words.index("-o") + 1]
        source = words[1]
        if source.endswith(".glb"):
            self.meshes[output] = source
            return
        taken, _ = options(words[2:], OF_SOURCES)
        mesh = output.replace(".vtex", ".glb")
        done, _ = self.run(["export", source, "-o", mesh, *sum(taken, []), "-q"], may_fail=True)
        if done.returncode == 0:
            self.meshes[output] = mesh

    def export(self, words):
        _, seconds = self.run(words + ["-q"])
        self.seconds += seconds

    def map(self, words):
        _, words = options(words, {"--geometry": 1})
        texels = [words[i + 1] for i, word in enumerate(words) if word == "--texel"]
        own = [self.meshes.get(texel) for texel in texels]
        if all(own):
            words = words + sum((["--geometry", mesh] for mesh in own), [])
        else:
            self.meshes[""] = None
        _, seconds = self.run(words + ["-q"])
        self.seconds += seconds

    def render(self, words, size, samples):
        taken, rest = options(words, LEFT_OUT)
        frames = any(option[0] == "--frames" for option in taken)
        view = [*rest, "--size", size, "--background", "0.6,0.7,0.8", *(["--time", "1"] if frames else [])]
        _, seconds = self.run(words + ["-q"])
        self.seconds += seconds
        name = [option[1] for option in taken if option[0] == "-o"][0].split(".")[0]
        done, _ = self.run([*view, "-o", f"{name}-drawn.exr", "--stats", "--json", "-q"])
        stats = json.loads(done.stdout)
        flip = bias = None
        if "" not in self.meshes:
            self.run([*view, "-o", f"{name}-truth.exr", "--reference", str(samples), "-q"])
            done, _ = self.run(["compare", f"{name}-drawn.exr", f"{name}-truth.exr", "--json"])
            compared = json.loads(done.stdout)
            flip, bias = compared["all"]["flip"], compared["all"]["relative_bias"]
        return name, seconds, stats, flip, bias


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vtex")
    parser.add_argument("names", nargs="*")
    parser.add_argument("-o", "--output", default="vtex-landscapes")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--samples", type=int, default=64)
    args = parser.parse_args()
    vtex = os.path.realpath(args.vtex)
    print("| landscape | picture | all, s | picture, s | MiB | read of MB | FLIP | bias |\n|---|---|---|---|---|---|---|---|")
    for script in sorted(SCRIPTS.glob("*.sh")):
        if args.names and script.stem not in args.names:
            continue
        land = Landscape(vtex, script.stem, Path(args.output).resolve() / script.stem)
        for words in commands(script):
            if words[0] == "render":
                row = land.render(words, args.size, args.samples)
                print(line(land, *row), flush=True)
            else:
                getattr(land, words[0])(words)


def line(land, name, seconds, stats, flip, bias):
    figure = lambda v, form: "–" if v is None else form.format(v)
    read, there = stats["bytes_read"] / 1e6, stats["bytes_in_files"] / 1e6
    memory = stats["peak_bytes"] / 2**20
    return (f"| {land.name} | {name} | {land.seconds:.0f} | {seconds:.0f} | {memory:.0f} | {read:.1f} of {there:.1f} | "
            f"{figure(flip, '{:.3f}')} | {figure(bias, '{:+.1%}')} |")


if __name__ == "__main__":
    main()
