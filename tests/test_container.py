"""The container as it really is, through ``./tribox``: what a case or a script can do in it.

Needs a container engine, which the image does not have: there these tests are skipped. On the
machine itself they need nothing but Python: ``python3 -m unittest -v tests.test_container``.
"""

import fcntl
import json
import os
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path
from shutil import which

ROOT = Path(__file__).resolve().parent.parent
CASE = """
title = "a law of somebody else"
bodies.elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
bodies.aluminium = { material = "neo-hookean", E = "70 GPa", nu = 0.33 }
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0 } },
 { surface = "top", displacement = { x = 0, y = "-0.01 mm" } },
]
stage = [{ name = "press", duration = "1 s", steps = 1 }]
[geometry]
kind = "two-blocks"
upper = { width = "1 mm", height = "0.5 mm", elements = [4, 2] }
lower = { width = "2 mm", height = "0.5 mm", elements = [5, 2] }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "python", class = "law.py:Law" }
"""
# Tries to write in each place, and fails as the last attempt did.
LAW = """
from pathlib import Path

written, refused = [], None
for place in PLACES:
    try:
        with Path(place).open("a") as stream:
            stream.write("owned")
        written.append(place)
    except OSError as error:
        refused = error
if written:
    raise SystemExit(f"written: {written}")
raise refused
"""
FACTS = """
import json, os, socket

def attempt(action):
    try:
        action()
    except OSError as error:
        return type(error).__name__
    return "done"

with open("/proc/self/status") as stream:
    status = dict(line.rstrip().split(":\\t", 1) for line in stream if ":\\t" in line)
with open("made.txt", "w") as stream:
    stream.write("by the script")
facts = {
    "user": os.getuid(),
    "powers": [status[name] for name in ("CapPrm", "CapEff", "CapBnd", "CapAmb")],
    "no_new_privileges": status["NoNewPrivs"],
    "network": attempt(lambda: socket.create_connection(("192.0.2.1", 80), 2)),
    "program": attempt(lambda: open("/tribox/app/made.py", "w")),
    "image": attempt(lambda: open("/usr/bin/made", "w")),
    "home": attempt(lambda: open(os.path.expanduser("~/made"), "w")),
}
print(json.dumps(facts))
"""
WAITS = """
import signal, sys, time

def stop(number, frame):
    print(signal.Signals(number).name, flush=True)
    time.sleep(1.0)
    print("saved", flush=True)
    sys.exit(130)

for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, stop)
print("ready", flush=True)
time.sleep(60)
"""
LOCKS = """
import fcntl

with open("lock", "a") as stream:
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("locked")
    else:
        print("free")
"""


def engine_that_answers() -> str:
    """The engine that the launcher uses here; empty if there is none."""
    asked = os.environ.get("TRIBOX_ENGINE")
    for name in [asked] if asked else ["docker", "podman"]:
        if name in ("docker", "podman") and which(name):
            if subprocess.run([name, "info"], capture_output=True).returncode == 0:
                return name
    return ""


ENGINE = engine_that_answers()


def command(*words: str) -> list[str]:
    return [str(ROOT / "tribox"), *words]


@unittest.skipUnless(ENGINE, "no container engine here")
class TestContainer(unittest.TestCase):
    """Each test has a directory of its own, which is the working directory."""

    def setUp(self) -> None:
        temporary = tempfile.TemporaryDirectory(prefix="tribox-")
        self.addCleanup(temporary.cleanup)
        self.directory = Path(temporary.name).resolve() / "work here"
        self.directory.mkdir()
        self.environment = {**os.environ, "TRIBOX_ENGINE": ENGINE, "PYTHONUNBUFFERED": "1"}

    def write(self, name: str, text: str) -> Path:
        path = self.directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    def launch(self, *words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command(*words),
            cwd=cwd or self.directory,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=900,  # the image may have to be made
        )

    def test_a_law_cannot_write_outside_its_results(self) -> None:
        other = self.write("results/other/history.csv", "time\n")
        case, law = self.directory / "case.toml", self.directory / "law.py"
        places = [
            *(ROOT / "app/made-by-a-law.py", ROOT / "results/made", ROOT / "made"),
            *(Path("/tribox/app/made-by-a-law.py"), self.directory.parent / "made", other),
            *(case, law, self.directory / "made", self.directory / "results/made"),
        ]
        self.write("law.py", LAW.replace("PLACES", repr([str(place) for place in places])))
        self.write("case.toml", CASE)
        before = {place: place.read_text() for place in places if place.exists()}
        self.assertEqual(set(before), {case, law, other})
        # From the checkout, which is thus the working directory.
        out = str(self.directory / "results/case")
        done = self.launch("run", str(case), "--trust", "--out", out, cwd=ROOT)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("Read-only file system", done.stderr)
        self.assertIn("law.py", done.stderr)
        after = {place: place.read_text() for place in places if place.exists()}
        self.assertEqual(after, before)

    def test_a_script_has_no_powers_and_its_files_are_the_callers(self) -> None:
        self.write("facts.py", FACTS)
        done = self.launch("python", "facts.py")
        self.assertEqual(done.returncode, 0, done.stderr)
        facts = json.loads(done.stdout)
        self.assertEqual(facts["powers"], ["0000000000000000"] * 4)
        self.assertEqual(facts["no_new_privileges"], "1")
        self.assertEqual((facts["network"], facts["program"]), ("OSError", "OSError"))
        self.assertEqual((facts["image"], facts["home"]), ("OSError", "done"))
        if ENGINE == "podman" or os.getuid() != 0:
            self.assertNotEqual(facts["user"], 0)
        made = (self.directory / "made.txt").stat()
        self.assertEqual((made.st_uid, made.st_gid), (os.getuid(), os.getgid()))

    def test_signals_reach_the_program_and_its_exit_code_comes_back(self) -> None:
        self.write("waits.py", WAITS)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            with self.subTest(number.name):
                started = subprocess.Popen(
                    command("python", "waits.py"),
                    cwd=self.directory,
                    env=self.environment,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    text=True,
                )
                assert started.stdout is not None
                with started.stdout as said:
                    self.assertEqual(said.readline(), "ready\n")
                    started.send_signal(number)
                    self.assertEqual(said.read().split(), [number.name, "saved"])
                self.assertEqual(started.wait(60), 130)

    def test_a_lock_is_seen_by_another_container(self) -> None:
        self.write("locks.py", LOCKS)
        with (self.directory / "lock").open("w") as stream:
            self.assertEqual(self.launch("python", "locks.py").stdout, "free\n")
            fcntl.flock(stream, fcntl.LOCK_EX)
            self.assertEqual(self.launch("python", "locks.py").stdout, "locked\n")

    def test_output_may_be_cut_off(self) -> None:
        piped = subprocess.run(
            ["sh", "-c", '{ "$0" schema; echo "code $?" >&2; } | head -n 1', *command()],
            cwd=self.directory,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=300,
        )
        self.assertEqual((piped.stdout, piped.stderr), ("{\n", "code 0\n"))


if __name__ == "__main__":
    unittest.main()
