#!/usr/bin/env python3
"""Kills commands at each system call that writes, and lets each of these calls fail. Linux, with strace and the right to trace:

    tests/crash.py target/release/vtex

Each command replaces an output, and afterwards the output must be the old file or the new one, to the byte. After SIGKILL at most one
temporary file (`.vtex-*.part`) may be left; after an error none, and the error is one line and exit code 1. Before a file takes its
name, all of it must have been brought to the disk (fsync), so that a machine that loses its power keeps one or the other; and behind the
last name its folder, so that what was said to be done stays done. At last a disk of a few pages, where this may be mounted (as root).
Prints a table; exits with 1 where something is wrong.
"""
import os, re, shutil, subprocess, sys, tempfile
from pathlib import Path

VTEX = str(Path(sys.argv[1]).resolve())
SAMPLES = Path(__file__).resolve().parent.parent / "samples"
# Calls that change what is on the disk.
CALLS = ["write", "pwrite64", "writev", "ftruncate", "fsync", "fdatasync", "fchmod", "fchown", "linkat", "rename", "renameat",
         "renameat2", "unlink", "unlinkat"]
FAILS = {"write": "ENOSPC", "pwrite64": "ENOSPC", "writev": "ENOSPC", "fsync": "EIO", "linkat": "EIO", "rename": "EIO", "renameat2": "EIO"}
# A call that is made more often is hit at so many of its places, evenly.
MOST = 12
COMMANDS = {  # what makes the old output, the command, and the output
    "bake": ("bake fern.glb -r 16 --model neyret -o out.vtex", "bake fern.glb -r 16 -o out.vtex", "out.vtex"),
    "truncate": ("truncate fern.vtex --depth 2 -o out.vtex", "truncate fern.vtex --depth 3 -o out.vtex", "out.vtex"),
    "merge": ("merge fern.vtex fern.vtex -o out.vtex", "merge fern.vtex fern.vtex --translate 0.4,0,0 -o out.vtex", "out.vtex"),
    "export": ("export fern.vtex --title old -o out.html", "export fern.vtex -o out.html", "out.html"),
    "map": ("map terrain.glb --texel fern.vtex --seed 7 -o out.glb", "map terrain.glb --texel fern.vtex -o out.glb", "out.glb"),
    "render": ("render land.glb --camera near --size 48x27 -o out.png", "render land.glb --camera far --size 48x27 -o out.png", "out.png"),
    "depfile": ("truncate fern.vtex --depth 3 -o old.vtex --depfile out.d", "truncate fern.vtex --depth 3 -o new.vtex --depfile out.d", "out.d"),
}
faults = []


def run(words, folder, *, strace=(), code=None):
    done = subprocess.run([*strace, VTEX, *words], cwd=folder, capture_output=True, text=True)
    if code is not None and done.returncode != code:
        sys.exit(f"{words} in {folder}: {done.returncode}: {done.stderr}")
    return done


def names(folder):
    return {p.name for p in folder.iterdir()}


def places(count):
    return sorted({round(1 + i * (count - 1) / max(1, min(count, MOST) - 1)) for i in range(min(count, MOST))})


def calls(log):
    """The calls of a trace, in order: name, and what stands in its brackets and behind."""
    found = []
    for line in log.read_text(errors="replace").splitlines():
        match = re.match(r"(?:\d+ +)?(\w+)\((.*)", line)
        if match and " = -1 " not in line:
            found.append(match.groups())
    return found


def in_order(found):
    """Whether every file that takes its name was synced after it was written, and something behind the last name: the folder."""
    written, dirty = set(), set()
    named, synced = 0, False
    for name, rest in found:
        fd = re.match(r"(\d+)", rest)
        fd = fd.group(1) if fd else None
        if name in ("write", "pwrite64", "writev", "ftruncate") and fd not in ("1", "2"):
            dirty.add(fd), written.add(fd)
        elif name in ("fsync", "fdatasync"):
            dirty.discard(fd)
            synced = True
        elif name == "linkat":
            source = re.search(r"/proc/self/fd/(\d+)", rest).group(1)
            named, synced = named + 1, False
            if source in dirty or source not in written:
                return False
        elif name.startswith("rename"):
            synced = False
            if dirty:
                return False
    return named > 0 and synced


def check(command, what, folder, old, new, output, before, killed, done):
    found = (folder / output).read_bytes()
    state = "old" if found == old else "new" if found == new else "broken"
    left = {n for n in names(folder) - before}
    wrong = state == "broken" or len(left) > (1 if killed else 0) or not all(re.fullmatch(r"\.vtex-.*\.part", n) for n in left)
    if not killed:
        lines = [l for l in done.stderr.splitlines() if l.startswith("error: ")]
        # What cannot be said on stderr is not said: then there is the exit code alone.
        wrong |= not (done.returncode == 1 and len(lines) <= 1 or done.returncode == 0 and state == "new")
    if wrong:
        faults.append(f"{command}, {what}: {state}, exit {done.returncode}, left {left}, {done.stderr.strip()[-200:]!r}")
    for name in left:
        (folder / name).unlink()
    (folder / output).write_bytes(old)
    return state, len(left)


def trial(command, folder):
    earlier, line, output = COMMANDS[command]
    words = [*line.split(), "-q"]
    # Both: a command may have a second output, which is new then and there before.
    for one in (words, [*earlier.split(), "-q"]):
        run(one, folder, code=0)
    old = (folder / output).read_bytes()
    before = names(folder)
    log = folder.parent / "log"
    run(words, folder, strace=["strace", "-f", "-o", str(log), "-e", "trace=" + ",".join("?" + c for c in CALLS)], code=0)
    new = (folder / output).read_bytes()
    found = calls(log)
    if new == old:
        sys.exit(f"{command}: the two outputs are the same")
    ordered = in_order(found)
    if not ordered:
        faults.append(f"{command}: a file takes its name before it is on the disk, or the folder is not brought there")
    (folder / output).write_bytes(old)
    table = {"kills": 0, "old": 0, "new": 0, "left": 0, "errors": 0}
    for call in CALLS:
        for place in places(sum(name == call for name, _ in found)):
            inject = ["strace", "-f", "-o", "/dev/null", "-e", f"trace={call}", "-e"]
            done = run(words, folder, strace=[*inject, f"inject={call}:signal=KILL:when={place}"])
            state, left = check(command, f"killed at {call} {place}", folder, old, new, output, before, True, done)
            table["kills"] += 1
            table["left"] += left
            table[state] = table.get(state, 0) + 1
            if call in FAILS:
                done = run(words, folder, strace=[*inject, f"inject={call}:error={FAILS[call]}:when={place}"])
                check(command, f"{FAILS[call]} at {call} {place}", folder, old, new, output, before, False, done)
                table["errors"] += 1
    return table, ordered


def full_disk(folder):
    """A disk that has room for the old output alone. None where it may not be mounted."""
    small = folder.parent / "small"
    small.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(small)], capture_output=True).returncode:
        return None
    try:
        old = b"x" * 60_000
        wrong = 0
        for words in (["bake", "fern.glb", "-r", "32"], ["export", "fern.vtex"], ["render", "land.glb", "--size", "96x54"]):
            out = small / ("out" + {"bake": ".vtex", "export": ".html", "render": ".exr"}[words[0]])
            out.write_bytes(old)
            done = run([*words, "-o", str(out), "-q"], folder)
            lines = [l for l in done.stderr.splitlines() if l.startswith("error: ")]
            fine = done.returncode == 1 and len(lines) == 1 and "No space left" in lines[0]
            if not fine or out.read_bytes() != old or names(small) != {out.name}:
                faults.append(f"full disk, {words[0]}: exit {done.returncode}, {done.stderr!r}, {names(small)}")
                wrong += 1
            out.unlink(missing_ok=True)
        return wrong
    finally:
        subprocess.run(["umount", str(small)], check=True)


def main():
    if not shutil.which("strace"):
        sys.exit("strace is not installed")
    with tempfile.TemporaryDirectory() as base:
        folder = Path(base) / "work"
        folder.mkdir()
        for name in ("fern.glb", "terrain.glb"):
            shutil.copy(SAMPLES / name, folder)
        run("bake fern.glb -r 32 -o fern.vtex -q".split(), folder, code=0)
        run("map terrain.glb --texel fern.vtex -o land.glb -q".split(), folder, code=0)
        columns = ["kills", "old", "new", "left", "errors"]
        print(f"{'command':10}" + "".join(f"{c:>8}" for c in columns) + "   fsync before the name and behind")
        for command in COMMANDS:
            table, ordered = trial(command, folder)
            print(f"{command:10}" + "".join(f"{table[c]:8}" for c in columns) + f"   {'yes' if ordered else 'NO'}", flush=True)
        wrong = full_disk(folder)
        print("full disk: " + ("not tried, since no disk may be mounted" if wrong is None else f"{wrong} faults"))
    for fault in faults:
        print("WRONG:", fault)
    sys.exit(1 if faults else 0)


main()
