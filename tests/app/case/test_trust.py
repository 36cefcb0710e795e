"""Whose code is run: the list of trusted directories, and what lies below them."""

import grp
import os
import pwd
from pathlib import Path

import pytest

from tests.own_law import OWN, documented_law, with_law
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.case.trust import (
    forget_directory,
    list_file,
    require_trust,
    trust_directory,
    trusted_directories,
)
from tribox.app.errors import InputError
from tribox.app.run import command


@pytest.fixture
def places(tmp_path: Path, block: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory ``mine`` with a case and its law, and an empty one for the list."""
    monkeypatch.setenv("TRIBOX_CONFIG", str(tmp_path / "config"))
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "a.toml").write_text(with_law(block))
    (mine / "my_law.py").write_text(documented_law())
    return tmp_path


def needs_trust(path: Path) -> str | None:
    """What is said of a case that may not run its code; None of one that may."""
    try:
        assert require_trust(load_case(path), path, False)
    except InputError as error:
        assert "\n" not in str(error)
        return str(error)
    return None


def test_nothing_is_trusted_unless_the_user_says_so(places, block):
    case = places / "mine" / "a.toml"
    assert trusted_directories() == [] and not list_file().exists()
    said = needs_trust(case) or ""
    law = places / "mine" / "my_law.py"
    assert said.startswith(f'{case}: contact.0.friction.law = "python" makes this case code: {law}')
    assert "--trust" in said and said.endswith(f"tribox trust {places / 'mine'}")
    assert require_trust(load_case(case), case, True)
    plain = places / "plain.toml"
    plain.write_text(block)
    assert not require_trust(load_case(plain), plain, False)


def test_a_trusted_directory_holds_for_all_below_until_it_is_removed(places, monkeypatch):
    mine = places / "mine"
    assert trust_directory(mine) == mine == trust_directory(mine / ".." / "mine")
    assert list_file().read_text() == f"{mine}\n"
    assert list_file().stat().st_mode & 0o777 == 0o600
    below = mine / "deep" / "er"
    below.mkdir(parents=True)
    (below / "b.toml").write_text((mine / "a.toml").read_text())
    (below / "my_law.py").write_text(documented_law())
    assert needs_trust(mine / "a.toml") is needs_trust(below / "b.toml") is None
    monkeypatch.chdir(mine)
    assert needs_trust(Path("a.toml")) is None
    (places / "mine2").mkdir()  # not below, though its name begins like one that is
    (mine / "a.toml").rename(places / "mine2" / "a.toml")
    (mine / "my_law.py").rename(places / "mine2" / "my_law.py")
    assert needs_trust(places / "mine2" / "a.toml")
    with pytest.raises(InputError, match=f"it is trusted as a part of {mine}"):
        forget_directory(below)
    assert forget_directory(mine) == mine
    assert needs_trust(below / "b.toml") and trusted_directories() == []


def test_case_and_law_must_both_be_there_links_resolved(places, block):
    mine, other = places / "mine", places / "other"
    other.mkdir()
    trust_directory(mine)
    (other / "my_law.py").write_text(documented_law())
    (mine / "out.toml").write_text(with_law(block, OWN.replace("my_law.py", "../other/my_law.py")))
    assert f"tribox trust {other}" in (needs_trust(mine / "out.toml") or "")
    (mine / "link.py").symlink_to(other / "my_law.py")
    (mine / "link.toml").write_text(with_law(block, OWN.replace("my_law.py", "link.py")))
    assert needs_trust(mine / "link.toml")
    (other / "in.toml").write_text(with_law(block, OWN.replace("my_law.py", "../mine/my_law.py")))
    assert needs_trust(other / "in.toml")
    (mine / "case.toml").symlink_to(other / "in.toml")
    assert needs_trust(mine / "case.toml")
    (places / "way").symlink_to(mine)
    assert needs_trust(places / "way" / "a.toml") is None
    assert trust_directory(places / "way") == mine


def test_every_value_of_a_sweep_is_looked_at(places, block):
    mine, other = places / "mine", places / "other"
    other.mkdir()
    trust_directory(mine)
    (other / "my_law.py").write_text(documented_law())
    values = '["my_law.py:MyLaw", "../other/my_law.py:MyLaw"]'
    sweep = f'[sweep]\nkey = "contact.0.friction.class"\nvalues = {values}\n'
    (mine / "sweep.toml").write_text(with_law(block) + sweep)
    assert f"{other / 'my_law.py'} would be run" in (needs_trust(mine / "sweep.toml") or "")


@pytest.mark.parametrize("which", ["trusted", "."])
def test_a_list_that_others_may_write_is_refused(places, which):
    trust_directory(places / "mine")
    path = list_file().parent / which
    for mode in (0o020, 0o002):
        path.chmod(path.stat().st_mode | mode)
        with pytest.raises(InputError, match="others may write it, so nothing in it is trusted"):
            trusted_directories()
        assert "others may write it" in (needs_trust(places / "mine" / "a.toml") or "")
        path.chmod(path.stat().st_mode & ~mode)
    assert needs_trust(places / "mine" / "a.toml") is None


def test_a_list_of_somebody_else_is_refused(places, monkeypatch):
    trust_directory(places / "mine")
    if os.getuid() == 0:
        os.chown(list_file(), 12345, 12345)
    else:  # what is ours is somebody else's for another
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(InputError, match="belongs to somebody else"):
        trusted_directories()


def test_what_anybody_may_write_is_not_trusted(places):
    mine = places / "mine"
    trust_directory(mine)
    for path in (mine / "my_law.py", mine):
        path.chmod(path.stat().st_mode | 0o002)
        assert f"(anybody may write {path})" in (needs_trust(mine / "a.toml") or "")
        path.chmod(path.stat().st_mode & ~0o002)
    open_to_all = places / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o1777)
    for wrong, said in [
        (open_to_all, rf"is not to be trusted \(anybody may write {open_to_all}\)"),
        (Path("/"), "is everything there is"),
        (mine / "a.toml", "is no directory"),
        (mine / "none", "no such directory"),
    ]:
        with pytest.raises(InputError, match=said):
            trust_directory(wrong)
    assert trusted_directories() == [mine]


def test_what_a_group_or_somebody_else_may_write_is_not_trusted(places, monkeypatch):
    mine = places / "mine"
    trust_directory(mine)
    me = pwd.getpwuid(os.geteuid())
    group = grp.struct_group(("lab", "x", me.pw_gid, ["somebody"]))
    monkeypatch.setattr(grp, "getgrgid", lambda number: group)
    for path in (mine / "my_law.py", mine / "a.toml", mine):
        path.chmod(path.stat().st_mode | 0o020)
        assert f"(group lab may write {path})" in (needs_trust(mine / "a.toml") or "")
        group = grp.struct_group((me.pw_name, "x", me.pw_gid, []))  # as Debian gives each user
        assert needs_trust(mine / "a.toml") is None
        group = grp.struct_group(("lab", "x", me.pw_gid, ["somebody"]))
        path.chmod(path.stat().st_mode & ~0o020)
    if os.geteuid() == 0:
        for path in (mine / "my_law.py", mine):
            os.chown(path, 12345, 12345)
            assert f"({path} belongs to somebody else)" in (needs_trust(mine / "a.toml") or "")
            os.chown(path, 0, 0)
    places.chmod(0o777)  # who may write here may put another directory in the place of mine
    assert f"(anybody may write {places})" in (needs_trust(mine / "a.toml") or "")


def test_what_is_trusted_is_what_is_opened(places, block, monkeypatch):
    """A link that leads elsewhere, and to the trusted case only while that is looked at."""
    mine, other = places / "mine", places / "other"
    trust_directory(mine)
    other.mkdir()
    (other / "in.toml").write_text(with_law(block, OWN.replace("my_law.py", f"{mine}/my_law.py")))
    link = other / "case.toml"
    link.symlink_to(other / "in.toml")
    ran = []

    def load_and_swap(path: Path, overrides: list[str]) -> Case:
        case = load_case(path, overrides)
        link.unlink()
        link.symlink_to(mine / "a.toml")
        return case

    monkeypatch.setattr(command, "load_case", load_and_swap)
    monkeypatch.setattr(command, "_run_here", lambda case, *more: ran.append(case))
    out = places / "out"
    options = command.RunOptions(
        out, [], 1, False, None, None, False, resume=False, extend=False, inputs_of=None
    )
    command.run_command(link, options)
    assert [case.source for case in ran] == [mine / "a.toml"]


def test_a_law_that_has_become_a_link_is_not_trusted(places):
    mine = places / "mine"
    trust_directory(mine)
    case = load_case(mine / "a.toml")
    (mine / "my_law.py").rename(mine / "other.py")
    (mine / "my_law.py").symlink_to(mine / "other.py")
    with pytest.raises(InputError, match="has become a link"):
        require_trust(case, mine / "a.toml", False)
