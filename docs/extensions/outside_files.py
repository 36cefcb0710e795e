"""Links to files of the repository outside ``docs``: case files, sources, data.

Such a link is a plain relative one in Markdown. On the site it leads to a page that shows the file,
or lists the directory. A link to a Markdown file or notebook leads to the page of the site that
shows it (``outside_pages`` in ``conf.py``).
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.builders.html import StandaloneHTMLBuilder
from sphinx.environment import BuildEnvironment
from sphinx.transforms import SphinxTransform

_LONGEST = 200_000  # characters of a file that a page shows
_FOLDER = "files"
_WHOLE = re.compile(r"```\{include\}|<!-- notebook: ")  # a page that is another file
_LANGUAGES = {
    ".py": "python",
    ".toml": "toml",
    ".sh": "sh",
    ".c": "c",
    ".geo": "geo",
    ".json": "json",
}


def setup(app: Sphinx) -> dict[str, bool]:
    """Follow links out of ``docs``."""
    app.add_config_value("outside_pages", {}, "env", dict)
    app.add_transform(_OutsideLinks)
    app.connect("env-purge-doc", lambda app, env, name: _shown(env).pop(name, None))
    app.connect("html-collect-pages", _pages)
    return {"parallel_read_safe": False, "parallel_write_safe": True}


def _shown(env: BuildEnvironment) -> dict[str, set[str]]:
    """Files and directories, relative to the repository, that each page links to."""
    shown: dict[str, set[str]] = env.__dict__.setdefault("outside_files", {})
    return shown


class _OutsideLinks(SphinxTransform):
    """Gives links that leave ``docs``, or come in from a file that is included, their places."""

    default_priority = 5  # before Sphinx copies what it takes for downloads

    def apply(self, **_: Any) -> None:
        """Replace the links of one page."""
        docs, source = Path(self.env.srcdir), self._source()
        for link in list(self.document.findall(_is_link)):
            target, anchor = _target(link, docs)
            name = os.path.relpath(os.path.normpath(source.parent / target), docs.parent)
            page = self.config.outside_pages.get(name)
            if page is None and name.startswith("docs/") and not source.is_relative_to(docs):
                page = name.removeprefix("docs/").removesuffix(".md")
            if page is not None and page in self.env.found_docs:
                link.replace_self(_reference(link, page, anchor, self.env.docname))
            elif not name.startswith(("docs/", "..")) and _is_shown(docs.parent / name):
                self._show(link, name)

    def _source(self) -> Path:
        """The file that the links of the page are seen from: what it includes, or itself."""
        page = Path(self.env.doc2path(self.env.docname))
        if not _WHOLE.match(page.read_text(encoding="utf-8")):
            return page
        included = {page: name for name, page in self.config.outside_pages.items()}
        name = included.get(self.env.docname)
        return Path(self.env.srcdir).parent / name if name else page

    def _show(self, link: nodes.Element, name: str) -> None:
        _shown(self.env).setdefault(self.env.docname, set()).add(name)
        uri = self.app.builder.get_relative_uri(self.env.docname, f"{_FOLDER}/{name}")
        link.replace_self(nodes.reference("", "", *link.children, refuri=uri, internal=True))


def _target(link: nodes.Element, docs: Path) -> tuple[str, str | None]:
    """(path as it stands in the page, anchor in it) of a link."""
    path, _, anchor = link["reftarget"].partition("#")
    if link["refdomain"] == "doc":  # Markdown, in the docs or outside, without its suffix
        path = str(docs / f"{path}.md")
    return path, link.get("reftargetid") or anchor or None


def _reference(link: nodes.Element, page: str, anchor: str | None, here: str) -> nodes.Element:
    """A reference to a page, or a heading of it, that Sphinx looks up."""
    found = addnodes.pending_xref("", *link.children, **link.attributes)
    found.update_basic_atts(link)
    found["refdomain"], found["reftype"], found["reftarget"] = "doc", "myst", page
    found["reftargetid"], found["refdoc"] = anchor, here
    return found


def _is_link(node: nodes.Node) -> bool:
    return isinstance(node, addnodes.download_reference | addnodes.pending_xref) and (
        node.get("reftype") == "myst"
    )


def _is_shown(path: Path) -> bool:
    """Whether a page can show it: a directory, or a text that is not long."""
    if path.is_dir() or not path.exists():
        return path.is_dir()
    try:
        return len(path.read_text(encoding="utf-8")) <= _LONGEST
    except UnicodeDecodeError:
        return False


def _pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """A page for each file that is linked to, and for all in directories that are."""
    root = Path(app.srcdir).parent
    waiting = sorted(set().union(*_shown(app.env).values()))
    done: set[str] = set()
    while waiting:
        name = waiting.pop(0)
        if name in done:
            continue
        done.add(name)
        if (root / name).is_dir():
            inside = [f"{name}/{path.name}" for path in _listed(root / name)]
            waiting += inside
            body = _listing(app, name, inside)
        else:
            body = _source(app, root / name)
        title = f"<h1><code>{escape(name)}</code></h1>"
        yield f"{_FOLDER}/{name}", {"title": name, "body": title + body}, "page.html"


def _listed(directory: Path) -> list[Path]:
    return [
        path
        for path in sorted(directory.iterdir())
        if not path.name.startswith((".", "__")) and _is_shown(path)
    ]


def _listing(app: Sphinx, name: str, inside: list[str]) -> str:
    here = f"{_FOLDER}/{name}"
    links = [(app.builder.get_relative_uri(here, f"{_FOLDER}/{path}"), path) for path in inside]
    items = [f'<li><a href="{escape(uri)}">{escape(path)}</a></li>' for uri, path in links]
    return f"<ul>{''.join(items)}</ul>"


def _source(app: Sphinx, path: Path) -> str:
    """The text of a file with its colours."""
    assert isinstance(app.builder, StandaloneHTMLBuilder)
    text = path.read_text(encoding="utf-8")
    language = _LANGUAGES.get(path.suffix, "text")
    return app.builder.highlighter.highlight_block(text, language, force=True)
