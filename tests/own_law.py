"""A law and a material in Python for tests: the documented ones, spoilt in places, and cases."""

import re
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "law.md"
MATERIAL_PAGE = PAGE.with_name("how-to") / "own-material.md"
OWN = 'law = "python"\nclass = "my_law.py:MyLaw"\nparameters = { mu = 0.3, speed = 1e-6 }'
# A line of its update, behind which a test puts mischief.
CLOSED = "        closed = pressure > 0.0\n"
SLID = "state.slip_path.max(initial=0.0) > 1e-6"


def documented_law(old: str = "", new: str = "") -> str:
    """Source of the law of the documentation, with one text replaced by another."""
    section = PAGE.read_text(encoding="utf-8").split("## A law of your own")[1]
    [code] = re.findall(r"```python\n(.*?)```", section.split("\n## ")[0], re.DOTALL)
    assert old in code
    return code.replace(old, new, 1) if old else code


def documented_material(old: str = "", new: str = "") -> str:
    """Source of the strain energy of the documentation, with one text replaced by another."""
    text = MATERIAL_PAGE.read_text(encoding="utf-8")
    [code] = re.findall(r"<!-- file: gent.py -->\n```python\n(.*?)```", text, re.DOTALL)
    assert old in code
    return code.replace(old, new, 1) if old else code


def documented_material_case(old: str = "", new: str = "") -> str:
    """The case of the documentation with it, likewise."""
    text = MATERIAL_PAGE.read_text(encoding="utf-8")
    [case] = re.findall(r"<!-- file: gent.toml -->\n```toml\n(.*?)```", text, re.DOTALL)
    assert old in case
    return case.replace(old, new, 1) if old else case


def line_of(text: str) -> int:
    """Number of the line of the documented law that a text begins in."""
    code = documented_law()
    return 1 + code[: code.index(text)].count("\n")


def mischief(statement: str) -> str:
    """The documented law, which does something in a step after some slip, beside its work."""
    return documented_law(CLOSED, f"{CLOSED}        if {SLID}:\n            {statement}\n")


def with_law(block: str, law: str = OWN) -> str:
    """A case with another friction table."""
    section = re.compile(r"^\[contact\.friction\]\n(?:(?!\[).*\n)*", re.M)
    assert section.search(block)
    return section.sub(f"[contact.friction]\n{law}\n", block)
