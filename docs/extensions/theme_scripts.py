"""Mends the script of Debian's furo, which highlights no section in the contents of the page.

It imports a script that is no module (``import * as Gumshoe``) and calls the module as if it were
the constructor. That one is in ``window``. Other builds of furo are one file without an import.
"""

from __future__ import annotations

from pathlib import Path

from sphinx.application import Sphinx

_CALL, _MENDED = "new Gumshoe(", "new window.Gumshoe("


def setup(app: Sphinx) -> dict[str, bool]:
    """Change the script once it lies beside the pages."""
    app.connect("build-finished", _mend)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _mend(app: Sphinx, error: Exception | None) -> None:
    script = Path(app.outdir) / "_static" / "scripts" / "furo.js"
    if error is not None or not script.is_file():
        return
    text = script.read_text(encoding="utf-8")
    if "import * as Gumshoe" in text:
        script.write_text(text.replace(_CALL, _MENDED), encoding="utf-8")
