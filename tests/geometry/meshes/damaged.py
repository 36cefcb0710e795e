"""Damages gmsh files at random, and reads what is left of them.

::

    python3 -m tests.geometry.meshes.damaged 400            # seeds 0 to 399
    python3 -m tests.geometry.meshes.damaged 400 --from 1000
"""

import argparse
import random
import re
import tempfile
import time
from collections import Counter
from pathlib import Path

import gmsh
from mpi4py import MPI

from tribox.app.build.mesh import bodies_sharing_nodes
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks, TwoBoxes
from tribox.geometry.meshes.gmsh_model import MeshError, gmsh_session
from tribox.geometry.meshes.mesh import read

BLOCK, BOX = Block(1.0, 0.5, (2, 2)), Box(1.0, 0.5, 1.0, (2, 1, 2))
# Shape, version of the format, whether binary.
FILES = (
    (TwoBlocks(BLOCK, BLOCK), 4.1, False),
    (TwoBlocks(BLOCK, BLOCK, cell="triangle"), 2.2, False),
    (TwoBlocks(BLOCK, BLOCK), 4.1, True),
    (TwoBlocks(BLOCK, BLOCK), 2.2, True),
    (TwoBoxes(BOX, BOX), 4.1, False),
    (TwoBoxes(BOX, BOX, cell="tetrahedron"), 2.2, False),
    (TwoBoxes(BOX, BOX), 4.0, False),
)
NUMBERS = (
    "0 -1 1 2 3 7 255 65536 2147483647 2147483648 -2147483649 4294967296 99999999999999999999 "
    "nan inf -inf 1e308 1e400 1e-320 1e30 0.5 -0.5 x"
).split()
WORDS = (b"", b'""', b'"\xff\xfe"', b'"a b"', b'"{x}"', b'"' + 5000 * b"n" + b'"', b"%s%n", b"\0")


def good_files() -> list[bytes]:
    """Small meshes in several versions of the format."""
    found = []
    with tempfile.TemporaryDirectory() as directory:
        for shape, version, binary in FILES:
            path = Path(directory) / "good.msh"
            with gmsh_session("good"):
                shape.build()
                gmsh.option.setNumber("Mesh.MshFileVersion", version)
                gmsh.option.setNumber("Mesh.Binary", int(binary))
                gmsh.write(str(path))
            found.append(path.read_bytes())
    return found


def flipped(data: bytes, chance: random.Random) -> bytes:
    """With a few other bytes."""
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8))):
        changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def other_lines(data: bytes, chance: random.Random) -> bytes:
    """With lines left out, doubled or in other places."""
    lines = data.split(b"\n")
    for _ in range(chance.choice((1, 1, 3))):
        at, to = chance.randrange(len(lines)), chance.randrange(len(lines))
        kind = chance.randrange(4)
        if kind == 0 and len(lines) > 1:
            del lines[at]
        elif kind == 1:
            lines.insert(to, lines[at])
        elif kind == 2:
            lines[at], lines[to] = lines[to], lines[at]
        else:
            lines[min(at, to) : max(at, to)] = []
    return b"\n".join(lines)


def other_numbers(data: bytes, chance: random.Random) -> bytes:
    """With other numbers."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.choice(list(re.finditer(rb"-?\d+(?:\.\d*)?(?:e[+-]?\d+)?", data)) or [None])
        if at is not None:
            data = data[: at.start()] + chance.choice(NUMBERS).encode() + data[at.end() :]
    return data


def other_words(data: bytes, chance: random.Random) -> bytes:
    """With another name or another heading."""
    at = chance.choice(list(re.finditer(rb'"[^"\n]*"|\$\w+', data)) or [None])
    return data if at is None else data[: at.start()] + chance.choice(WORDS) + data[at.end() :]


def cut(data: bytes, chance: random.Random) -> bytes:
    """Without its end."""
    return data[: chance.randrange(len(data))]


SLOW = 3.0  # s
CHANGES = (flipped, other_lines, other_numbers, other_numbers, other_words, cut)


def damaged(files: list[bytes], seed: int) -> bytes:
    """One of the files, changed in a way that follows from the seed."""
    chance = random.Random(seed)
    data = chance.choice(files)
    for _ in range(chance.choice((1, 1, 2))):
        data = chance.choice(CHANGES)(data, chance) or b"\n"
    return data


def outcome(path: Path) -> str:
    """What reading a file comes to: "read", or the line that refuses it; all else is a fault."""
    try:
        bodies_sharing_nodes(read(path, MPI.COMM_SELF))
    except MeshError as error:
        line = str(error)
        assert line.startswith(f"{path}: "), line
        assert line.isprintable(), repr(line)
        return line.removeprefix(f"{path}: ")
    return "read"


def main() -> None:
    """Read so many damaged files, and count what became of them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("count", type=int)
    parser.add_argument("--from", type=int, default=0, dest="first")
    options = parser.parse_args()
    files, found, slowest = good_files(), Counter[str](), 0.0
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "mesh.msh"
        for seed in range(options.first, options.first + options.count):
            path.write_bytes(damaged(files, seed))
            begin = time.perf_counter()
            try:
                said = outcome(path)
            except Exception as error:
                said = f"FAULT {error!r}"
                print(f"seed {seed}: {said}", flush=True)
            took = time.perf_counter() - begin
            if took > SLOW:
                print(f"seed {seed}: {took:.1f} s, {said}", flush=True)
            slowest = max(slowest, took)
            found[re.sub(r"\d[\d.e+-]*|'[^']*'|\(.*\)", "#", said)[:90]] += 1
    for said, count in found.most_common():
        print(f"{count:6d}  {said}")
    print(f"slowest: {slowest:.1f} s")


if __name__ == "__main__":
    main()
