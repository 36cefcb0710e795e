"""The [[probe]] tables: what goes together, and what is said where it does not."""

import tomllib

import pytest

from tribox.app.case.case import Case, resolved_toml
from tribox.app.case.reading import check_case, load_case

PROBES = """
[[probe]]
name = "one"
point = ["1 mm", "0.1 mm"]
[[probe]]
name = "some"
line = { from = ["1 mm", "0.1 mm"], to = [1e-3, 3e-4], points = 3 }
[[probe]]
name = "all"
body = "elastomer"
[[probe]]
name = "along"
contact = "elastomer_contact-aluminium_contact"
points = 7
[[probe]]
name = "shape"
surface = "top"
"""


def test_probes_are_read_and_written(block, case_file):
    case = load_case(case_file(block + PROBES))
    assert [probe.kind for probe in case.probe] == ["point", "line", "body", "contact", "surface"]
    assert case.probe[1].line.start == (1e-3, 1e-4)
    again = Case.model_validate(tomllib.loads(resolved_toml(case)))
    assert again == case
    # Without probes a resolved case has room for them.
    plain = resolved_toml(load_case(case_file(block)))
    assert "probe" not in plain
    assert len(Case.model_validate(tomllib.loads(plain + PROBES)).probe) == 5


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ("0.point=[1e-3]", "probe.0.point = [0.001]: must have 2 coordinates in this mesh"),
        ("0.point=[1e-3, 0, 0]", "probe.0.point = [0.001, 0.0, 0.0]: must have 2 coordinates"),
        ('0.point=["1 s", 0]', 'probe.0.point.0 = "1 s": "s" has the wrong dimension'),
        ("0.at=vertex", 'probe.0.at = "vertex": must be "interpolated" or "node"'),
        ("0.body=rubber", 'probe.0.body = "rubber": no such body; there are elastomer, aluminium'),
        ("0.body=elastomr", 'no such body; did you mean "elastomer"?'),
        ("0.points=3", "probe.0.points = 3: goes with contact only"),
        ("0.contact=elastomer_contact-aluminium_contact", "found point, contact"),
        ("1.at=node", 'probe.1.at = "node": goes with point only'),
        ("1.line.points=1", "probe.1.line.points = 1: must be at least 2"),
        ("1.line.to=[1e-3, 1e-4]", "probe.1.line.to = [0.001, 0.0001]: must differ from from"),
        ("1.line.from=[0]", "probe.1.line.from = [0.0]: must have 2 coordinates"),
        ("1.name=one", 'probe.1.name = "one": is what probe.0 is called already'),
        ("2.name=", 'probe.2.name = "": must not be empty'),
        ("3.contact=elastomer_contact-aluminium", 'did you mean "elastomer_contact-aluminium_con'),
        ("3.points=1", "probe.3.points = 1: must be at least 2"),
        ("3.bend=[0, 1]", "probe.3.bend: goes with surface only"),
        ("4.opposite=top", 'probe.4.opposite = "top": must differ from surface'),
        ("4.bend=[2, 1]", "probe.4.bend: must go from a smaller to a larger arc length"),
        ("4.straight=[[0, 2], [1, 3]]", "probe.4.straight: the second piece must begin behind"),
        ("4.body=elastomer", 'probe.4.body = "elastomer": does not go with surface'),
        ("4.point=[0, 0]", "give one of point, line, contact and surface, found point, surface"),
        ("3.body=elastomer", 'probe.3.body = "elastomer": does not go with contact'),
        ("3.pionts=3", 'unknown key "pionts" in probe.3; did you mean "points"?'),
    ],
)
def test_mistakes_are_told_by_their_keys(block, case_file, changes, line):
    problems = check_case(case_file(block + PROBES), [f"probe.{changes}"])
    assert len(problems) == 1
    assert line in problems[0]


def test_a_probe_must_follow_something(block, case_file):
    [problem] = check_case(case_file(block + '[[probe]]\nname = "nothing"\n'))
    assert problem.endswith("probe.0: follows nothing; give point, line, body, contact or surface")


def test_in_space_contacts_have_vertices_only_and_surfaces_no_line(case_file):
    from tests.app.conftest import BOXES

    text = BOXES + PROBES.replace('"0.1 mm"]', '"0.1 mm", 0]').replace("3e-4]", "3e-4, 0]")
    problems = check_case(case_file(text))
    assert len(problems) == 2
    assert "probe.3.points = 7: goes with meshes in the plane" in problems[0]
    assert 'probe.4.surface = "top": goes with meshes in the plane' in problems[1]
