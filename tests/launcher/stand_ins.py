"""A machine with stand-ins for the container engines, for tests of the launcher."""

import subprocess
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


COPIES = [
    line for line in (ROOT / "Dockerfile").read_text().splitlines() if line.startswith("COPY ")
]


# Of the files that the image is made from, one of each place.
SOURCES = (
    "src/tribox/__init__.py", "forms/bodies/solid.py", "forms/native/plane_kernel.c",
    "geometry/native/closest_points.c", "geometry/meshes/mesh.py", "app/__init__.py",
    "app/errors.py", "app/precompile.py", "app/equilibrium/equilibrium.py",
    "app/results/__init__.py", "app/results/fields.py",
)  # fmt: skip


# Records each call, one argument per line. Images are files in $STATE/images; what else happens
# is decided by the environment.
ENGINE = r"""#!/bin/sh
{ printf '%s\n' "${0##*/}" "$@"; echo =====; } >>"$STATE/calls"
while [ "$1" = --runtime ]; do shift 2; done
case $1 in
    info) echo "[${SECURITY:-}]" ;;
    image) [ -e "$STATE/images/$(echo "$3" | tr '/:' '__')" ] ;;
    pull) [ -n "${PULL_WORKS:-}" ] && touch "$STATE/images/$(echo "$2" | tr '/:' '__')" ;;
    import) touch "$STATE/images/$(echo "$3" | tr '/:' '__')" ;;
    build)
        echo "STEP 1/1: FROM base"
        while [ "$1" != -t ]; do shift; done
        touch "$STATE/images/$(echo "$2" | tr '/:' '__')"
        exit "${BUILD_STATUS:-0}"
        ;;
    run)
        case " $* " in
            *" --entrypoint true "*) [ -z "${NEEDS:-}" ] || case " $* " in
                *"$NEEDS"*) ;;
                *) exit 126 ;;
            esac ;;
            *) exit "${RUN_STATUS:-0}" ;;
        esac
        ;;
esac
"""


MMDEBSTRAP = r"""#!/bin/sh
{ printf '%s\n' mmdebstrap "$@"; echo =====; } >>"$STATE/calls"
for argument; do case $argument in *.tar) touch "$argument" ;; esac; done
"""


ABSENT = "#!/bin/sh\nexit 1\n"


@dataclass
class Machine:
    """A home, a checkout and a search path with stand-ins."""

    home: Path
    checkout: Path
    bin: Path
    state: Path
    environment: dict[str, str] = field(default_factory=dict)

    def install(self, name: str, script: str) -> None:
        path = self.bin / name
        path.write_text(script)
        path.chmod(0o755)

    def launch(
        self, *arguments: str, cwd: Path | None = None, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["/bin/sh", str(self.checkout / "tribox"), *arguments],
            cwd=cwd or self.checkout,
            env={**self.environment, **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=300,
        )

    def calls(self) -> list[list[str]]:
        """All calls of stand-ins: name and arguments."""
        text = (self.state / "calls").read_text() if (self.state / "calls").exists() else ""
        return [call.split("\n") for call in text.split("\n=====\n") if call]

    def calls_of(self, *words: str) -> list[list[str]]:
        return [call for call in self.calls() if all(word in call for word in words)]

    def container(self) -> list[str]:
        """The arguments of the last container started for the program."""
        return [call for call in self.calls_of("run") if "--workdir" in call][-1]


def values(call: list[str], option: str) -> list[str]:
    return [b for a, b in pairwise(call) if a == option]


def mounted(call: list[str], mode: str) -> set[str]:
    """The paths that a container sees at their own place, in mode ``ro`` or ``rw``."""
    split = [value.split(":") for value in values(call, "--volume")]
    return {source for source, target, how in split if source == target and how == mode}


def image_of(call: list[str]) -> str:
    return next(word for word in call if word.startswith("localhost/tribox:"))
