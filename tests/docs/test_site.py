"""The site: built without a warning, nothing in it from elsewhere, every link leads somewhere."""

import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

from tests.ranks import LIMIT

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
ELSEWHERE = re.compile(r"(?:https?:)?//")
NO_FILE = ("mailto:", "data:")  # a picture may stand in the page itself
# A page of which each line is wrong, and what is said of it.
WRONG = {
    "[a page](nowhere.md)": "target not found: 'nowhere.md'",
    "[an anchor](index.md#nothing)": "local id not found in doc 'index': 'nothing'",
    "[one of its own](#nothing-here)": "target not found: 'nothing-here'",
    "[a file](../cases/nothing.toml)": "target not found: '../cases/nothing.toml'",
    "![a picture](figures/nothing.png)": "image file not readable: figures/nothing.png",
}
RIGHT = """
[a case](../cases/small.toml) [all](../cases) [what changed](../CHANGELOG.md#added)
[home](../README.md) $x^2$
"""
API = """
```{eval-rst}
.. py:function:: good() -> tribox.Case

   See :class:`tribox.Case`, but not :func:`tribox.no_such_thing`.
```
"""

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(find_spec("sphinx") is None, reason="the site is built by Sphinx"),
]


class Page(HTMLParser):
    """Where the links of a page lead, what a browser loads to show it, and its anchors."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.loads: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.anchors |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.add(found["href"])
        if tag == "link" and found.get("rel") not in ("next", "prev", "index", "search"):
            self.loads.add(found["href"])
        self.loads |= {found[name] for name in ("src", "srcset", "poster") if name in found}


def build(docs: Path, out: Path) -> tuple[int, list[str]]:
    """Exit code and warnings of a strict build."""
    said = out.with_suffix(".warnings")
    strict = ["-q", "-W", "--keep-going", "-w", str(said)]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-b", "html", *strict, str(docs), str(out)],
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        timeout=LIMIT,
    )
    return done.returncode, said.read_text(encoding="utf-8").splitlines()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, list[str]]:
    """The site: where it is, exit code, warnings."""
    out = tmp_path_factory.mktemp("site")
    return out, *build(DOCS, out)


@pytest.fixture(scope="module")
def site(built: tuple[Path, int, list[str]]) -> Path:
    return built[0]


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in sorted(site.rglob("*.html"))}


def test_it_is_built_without_a_warning(built):
    assert built[2] == []
    assert built[1] == 0


def test_every_page_is_there(site, pages):
    for page in DOCS.rglob("*.md"):
        assert site / page.relative_to(DOCS).with_suffix(".html") in pages


def test_nothing_is_loaded_from_elsewhere(site, pages):
    for path, page in pages.items():
        assert not [load for load in page.loads if ELSEWHERE.match(load)], path
    sheets = list(site.rglob("*.css"))
    assert site / "_static/katex/katex.min.css" in sheets
    for sheet in sheets:
        assert not re.search(r"(@import|url\()[\"' ]*(https?:)?//", sheet.read_text()), sheet


def test_links_and_anchors_lead_somewhere(site, pages):
    for path, page in pages.items():
        for link in page.links | page.loads:
            address, anchor = urldefrag(link)
            if ELSEWHERE.match(address) or address.startswith(NO_FILE):
                continue
            target = (path.parent / unquote(address.partition("?")[0])).resolve()
            target = target if address else path
            assert target.is_file(), (path.name, link)
            if anchor and target in pages:
                assert unquote(anchor) in pages[target].anchors, (path.name, link)


def test_formulae_are_set_by_files_beside_the_page(site, pages):
    theory = site / "theory.html"
    assert {"_static/katex/katex.min.js", "_static/formulae.js"} <= {
        load.partition("?")[0] for load in pages[theory].loads
    }
    text = theory.read_text(encoding="utf-8")
    assert r'<div class="formula">' in text and r"\frac{\partial W}{\partial F}" in text
    fonts = re.findall(r"fonts/[\w-]+\.woff2", (site / "_static/katex/katex.min.css").read_text())
    assert len(fonts) > 10
    for font in fonts:
        assert (site / "_static/katex" / font).is_file(), font


def test_the_page_loads_what_marks_its_sections_and_its_icon(site, pages):
    script = (site / "_static/scripts/furo.js").read_text(encoding="utf-8")
    # What is imported as a whole is no constructor; the other builds of furo import nothing.
    assert "import * as Gumshoe" not in script or "new Gumshoe(" not in script
    assert "_static/favicon.svg" in {
        load.partition("?")[0] for load in pages[site / "law.html"].loads
    }


def test_the_search_puts_how_tos_first(site):
    """The order itself is the browser's: here only that it is given the weights, and of what."""
    used = (site / "_static/language_data.js").read_text(encoding="utf-8")
    weights = dict(re.findall(r"\[/(.*?)/, (-?\d+)\],", used.replace("\\/", "/")))
    of = {
        page: sum(int(n) for found, n in weights.items() if re.search(found, page))
        for page in ("how-to/own-law", "meshes", "law", "testing", "more/changelog")
    }
    assert of["how-to/own-law"] == of["meshes"] > of["law"] > of["testing"] > of["more/changelog"]
    for page in re.findall(r"[\w-]+", "meshes map-and-fit reading-results failures pictures"):
        assert (site / f"{page}.html").is_file()


def test_the_sidebar_names_pages_by_their_titles(site):
    sidebar = (site / "index.html").read_text(encoding="utf-8")
    found = re.findall(r'<li class="toctree-l1[^"]*"><a class="reference internal" '
                       r'href="([^"#]+)">(.*?)</a>', sidebar)  # fmt: skip
    assert len(found) > 30
    for page, name in found:
        title = re.search(r"<h1>(.*?)<a class", (site / page).read_text(encoding="utf-8"))
        assert title is not None and title[1] == name, page


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A small project with all kinds of mistakes: where its site is, and what is said."""
    root = tmp_path_factory.mktemp("wrong")
    docs = root / "docs"
    for part in ("extensions", "static"):
        shutil.copytree(DOCS / part, docs / part)
    shutil.copy(DOCS / "conf.py", docs)
    (docs / "more").mkdir()
    (docs / "more/changelog.md").write_text("```{include} ../../CHANGELOG.md\n```\n")
    (root / "CHANGELOG.md").write_text("# Changes\n\n## Added\n\n[here](docs/index.md#top)\n")
    (root / "cases").mkdir()
    (root / "cases/small.toml").write_text('title = "small"\n')
    (docs / "index.md").write_text(
        f"# Top\n{RIGHT}\n" + "\n\n".join(WRONG) + f"\n{API}\n```{{toctree}}\nmore/changelog\n```\n"
    )
    (docs / "lost.md").write_text("# In no list of pages\n")
    code, said = build(docs, root / "site")
    assert code == 1
    return root / "site", said


def test_mistakes_are_found(wrong):
    said = wrong[1]
    for expected in (*WRONG.values(), "tribox.no_such_thing", "lost.md"):
        assert sum(expected in line for line in said) == 1, (expected, said)
    # And nothing else is said: the links that are right are no mistakes.
    assert len([line for line in said if "WARNING" in line]) == len(WRONG) + 2, said


def test_links_out_of_the_docs_lead_to_pages_that_show_them(wrong):
    site = wrong[0]
    links = Page(site / "index.html").links
    shown = {"files/cases/small.toml.html", "files/cases.html", "more/changelog.html#added"}
    assert shown <= links
    assert "small" in (site / "files/cases/small.toml.html").read_text(encoding="utf-8")
    assert "cases/small.toml.html" in Page(site / "files/cases.html").links
    assert "../index.html#top" in Page(site / "more/changelog.html").links
