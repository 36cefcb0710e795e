"""What ``tribox bench`` compares with what."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tribox.app.bench.process import SOURCES
from tribox.app.bench.sides import sides_of
from tribox.app.errors import InputError


def test_alone_nothing_is_compared():
    assert sides_of(None, (), 1) is None


def a_tree(place):
    for name in ("app/bench", "forms", "geometry"):
        (place / name).mkdir(parents=True)
    (place / "app" / "bench" / "probe.py").touch()


@pytest.mark.parametrize("ranks", [1, 3])
def test_another_tree_is_the_old_one(tmp_path, ranks):
    a_tree(tmp_path)
    old, new = sides_of(tmp_path, (), ranks)
    assert (old.name, old.tree, old.ranks) == ("old", tmp_path, ranks)
    assert (old.package, old.packages) == ("app", ["app", "forms", "geometry"])
    assert (new.name, new.tree, new.ranks) == ("new", SOURCES, ranks)


def test_packages_of_a_tree_are_where_it_has_them(tmp_path):
    a_tree(tmp_path)
    (tmp_path / "src" / "tribox").mkdir(parents=True)
    old, new = sides_of(tmp_path, (), 1)
    assert old.tree == tmp_path / "src"
    assert old.package == new.package == "tribox"
    for side in (old, new):
        assert side.packages == ["tribox/app", "tribox/forms", "tribox/geometry"]
    assert all((new.tree / name).is_dir() for name in new.packages)


def test_changes_are_made_on_the_second_side_only():
    first, second = sides_of(None, ("a=1", "b=2"), 1)
    assert (first.changes, second.changes) == ((), ("a=1", "b=2"))
    assert first.tree == second.tree == SOURCES


def test_ranks_alone_are_compared_with_one():
    first, second = sides_of(None, (), 2)
    assert (first.ranks, second.ranks) == (1, 2)


def test_a_directory_that_is_no_tree_is_refused(tmp_path):
    with pytest.raises(InputError, match=re.escape(f"{tmp_path}: not a source tree of tribox")):
        sides_of(tmp_path, (), 1)
    with pytest.raises(InputError, match="there is no such directory"):
        sides_of(tmp_path / "none", (), 1)
    (tmp_path / "app").mkdir()
    with pytest.raises(InputError, match=r"it has no app/bench/probe\.py"):
        sides_of(tmp_path, (), 1)


def test_two_things_to_compare_with_are_refused():
    with pytest.raises(InputError, match=r"--against /old and --with a=1 .*give one of them"):
        sides_of(Path("/old"), ("a=1",), 1)
