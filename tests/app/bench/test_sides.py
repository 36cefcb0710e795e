"""What ``tribox bench`` compares with what."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tribox.app.bench.process import ROOT
from tribox.app.bench.sides import sides_of
from tribox.app.errors import InputError


def test_alone_nothing_is_compared():
    assert sides_of(None, (), 1) is None


@pytest.mark.parametrize("ranks", [1, 3])
def test_another_tree_is_the_old_one(tmp_path, ranks):
    for name in ("app/bench", "forms", "geometry"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("app/__main__.py", "app/bench/probe.py"):
        (tmp_path / name).touch()
    old, new = sides_of(tmp_path, (), ranks)
    assert (old.name, old.tree, old.ranks) == ("old", tmp_path, ranks)
    assert (new.name, new.tree, new.ranks) == ("new", ROOT, ranks)


def test_changes_are_made_on_the_second_side_only():
    first, second = sides_of(None, ("a=1", "b=2"), 1)
    assert (first.changes, second.changes) == ((), ("a=1", "b=2"))
    assert first.tree == second.tree == ROOT


def test_ranks_alone_are_compared_with_one():
    first, second = sides_of(None, (), 2)
    assert (first.ranks, second.ranks) == (1, 2)


def test_a_directory_that_is_no_tree_is_refused(tmp_path):
    with pytest.raises(InputError, match=re.escape(f"{tmp_path}: not a source tree of tribox")):
        sides_of(tmp_path, (), 1)
    with pytest.raises(InputError, match="there is no such directory"):
        sides_of(tmp_path / "none", (), 1)
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "__main__.py").touch()
    with pytest.raises(InputError, match=r"it has no app/bench/probe\.py"):
        sides_of(tmp_path, (), 1)


def test_two_things_to_compare_with_are_refused():
    with pytest.raises(InputError, match=r"--against /old and --with a=1 .*give one of them"):
        sides_of(Path("/old"), ("a=1",), 1)
