"""Whose code is run: that of cases in directories that the environment names."""

from pathlib import Path

import pytest

from tests.own_law import OWN, documented_law, with_law
from tribox.app.case.reading import load_case
from tribox.app.case.trust import TRUSTED, require_trust
from tribox.app.errors import InputError


@pytest.fixture
def places(tmp_path: Path, block: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory ``mine``, which is trusted, with a case and its law."""
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "a.toml").write_text(with_law(block))
    (mine / "my_law.py").write_text(documented_law())
    monkeypatch.setenv(TRUSTED, f"{tmp_path}/none:{mine}")
    return tmp_path


def needs_trust(path: Path) -> str | None:
    """What is said of a case that may not run its code; None of one that may."""
    try:
        assert require_trust(load_case(path), path, False)
    except InputError as error:
        assert "\n" not in str(error)
        return str(error)
    return None


def test_nothing_is_trusted_unless_the_user_says_so(places, block, monkeypatch):
    monkeypatch.delenv(TRUSTED)
    case = places / "mine" / "a.toml"
    said = needs_trust(case) or ""
    law = places / "mine" / "my_law.py"
    assert said.startswith(f'{case}: contact.0.friction.law = "python" makes this case code: {law}')
    assert "--trust" in said and said.endswith(f"{TRUSTED}={places / 'mine'}")
    assert require_trust(load_case(case), case, True)
    plain = places / "plain.toml"
    plain.write_text(block)
    assert not require_trust(load_case(plain), plain, False)


@pytest.mark.parametrize("name", ["/", "cases", "/usr/.."])
def test_all_there_is_and_relative_names_are_refused(places, monkeypatch, name):
    monkeypatch.setenv(TRUSTED, f"{places / 'mine'}:{name}")
    said = needs_trust(places / "mine" / "a.toml") or ""
    assert said == f'{TRUSTED}: "{name}" is no directory of your own in full'


def test_a_trusted_directory_holds_for_all_below(places, monkeypatch):
    mine = places / "mine"
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


def test_case_and_law_must_both_be_there_links_resolved(places, block, monkeypatch):
    mine, other = places / "mine", places / "other"
    other.mkdir()
    (other / "my_law.py").write_text(documented_law())
    (mine / "out.toml").write_text(with_law(block, OWN.replace("my_law.py", "../other/my_law.py")))
    assert f"{TRUSTED}={other}" in (needs_trust(mine / "out.toml") or "")
    (mine / "link.py").symlink_to(other / "my_law.py")
    (mine / "link.toml").write_text(with_law(block, OWN.replace("my_law.py", "link.py")))
    assert needs_trust(mine / "link.toml")
    (other / "in.toml").write_text(with_law(block, OWN.replace("my_law.py", "../mine/my_law.py")))
    assert needs_trust(other / "in.toml")
    (mine / "case.toml").symlink_to(other / "in.toml")
    assert needs_trust(mine / "case.toml")
    (places / "way").symlink_to(mine)
    assert needs_trust(places / "way" / "a.toml") is None
    monkeypatch.setenv(TRUSTED, str(places / "way"))
    assert needs_trust(mine / "a.toml") is None


def test_every_value_of_a_sweep_is_looked_at(places, block):
    mine, other = places / "mine", places / "other"
    other.mkdir()
    (other / "my_law.py").write_text(documented_law())
    values = '["my_law.py:MyLaw", "../other/my_law.py:MyLaw"]'
    sweep = f'[sweep]\nkey = "contact.0.friction.class"\nvalues = {values}\n'
    (mine / "sweep.toml").write_text(with_law(block) + sweep)
    assert f"{other / 'my_law.py'} would be run" in (needs_trust(mine / "sweep.toml") or "")
