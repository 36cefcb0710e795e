"""The packages that docs/install.md tells users of Debian to install are those of the image."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
ONLY_IN_THE_IMAGE = {"tini"}  # its first process
ONLY_BY_HAND = {"python3-pip", "python3-venv"}
OF_DEVELOPERS = re.compile(
    r"furo|libjs-katex|python3-(hypothesis|mypy|pytest.*|sphinx.*|myst.*|nb.*|ipy.*|jupyter.*)"
)


def packages(text: str) -> set[str]:
    """The words behind the options of `apt-get install` up to the end of the command."""
    (command,) = re.findall(r"apt-get install(.*?[^\\;])(?:;|\n)", text.replace("\\\n", " "))
    return {word for word in command.split() if not word.startswith("-")}


def test_the_packages_are_those_of_the_image():
    image = packages((ROOT / "Dockerfile").read_text(encoding="utf-8"))
    by_hand = packages((ROOT / "docs" / "install.md").read_text(encoding="utf-8"))
    needed = {name for name in image if not OF_DEVELOPERS.fullmatch(name)}
    assert by_hand - ONLY_BY_HAND == needed - ONLY_IN_THE_IMAGE
