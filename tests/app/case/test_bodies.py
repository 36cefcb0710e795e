"""Mistakes in the materials of a case: one clear line for each."""

from __future__ import annotations

import tomllib

import pytest

from tests.app.case.test_case import FILM_CASE
from tribox.app.case.reading import check_case
from tribox.app.case.toml_writer import toml_text

YEOH = {"material": "yeoh", "C10": 1, "K": 9}
OGDEN = {"material": "ogden", "mu": [1], "alpha": [2], "K": 1}
METAL = {"material": "elastoplastic", "E": 7e10, "nu": 0.3}


def flows(law, **keys):
    return METAL | {"hardening": {"law": law, **keys}}


def rated(law, **keys):
    return flows("linear", yield_stress=1) | {"rate": {"law": law, **keys}}


def branched(*branches):
    return flows("linear", yield_stress="80 MPa") | {"kinematic": list(branches)}


RUBBER = {"material": "neo-hookean", "G": 1, "K": 9}
PRONY = RUBBER | {"prony": [[0.2, "10 ms"], [0.1, "1 s"]]}
WLF = {"law": "wlf", "C1": 17.4, "C2": 51.6, "reference": "20 degC", "temperature": "40 degC"}
HOT = {"law": "arrhenius", "energy": "80 kJ/mol", "reference": 293, "temperature": 313}


MISTAKES = [
    ({"material": "steel"}, 'material = "steel": must be one of "neo-hookean", "hencky"'),
    ({"material": "AA1050"}, 'no such material; did you mean "AA1050-O", "AA1100-O"'),
    ({"material": "Mooney-Rivlin"}, 'no such material; did you mean "mooney-rivlin"'),
    ({"material": "hencky", "library": "AA1050-O"}, 'library = "AA1050-O": is of material = "elas'),
    ({"material": "PU-90A", "C10": 1}, 'key "C10" in bodies.aluminium does not go with'),
    ({"material": "AA1050-O", "E": -1}, "bodies.aluminium.E = -1: must be > 0 Pa"),
    ({"material": "AA1050-O", "hardening": {"q": 1}}, 'unknown key "q" in bodies.aluminium.hard'),
    (YEOH | {"C10": 0}, "bodies.aluminium.C10 = 0: must be > 0 Pa"),
    ({"material": "yeoh", "C10": 1}, "bodies.aluminium.K: missing; bulk modulus, in Pa"),
    (YEOH | {"C40": 1}, 'unknown key "C40" in bodies.aluminium; did you mean "C'),
    (OGDEN | {"mu": [1, 2]}, "alpha: has 1 entries and mu 2: must be as many"),
    (OGDEN | {"alpha": [0]}, "bodies.aluminium.alpha.0 = 0: must not be 0"),
    (OGDEN | {"alpha": [99]}, "bodies.aluminium.alpha.0 = 99: must be >= -30 and <= 30"),
    (OGDEN | {"mu": []}, "bodies.aluminium.mu = []: must have at least 1 entry"),
    (OGDEN | {"mu": 3}, "bodies.aluminium.mu = 3: must be an array"),
    (OGDEN | {"mu": [-1]}, "half the sum of mu alpha, is -1 Pa: must be > 0 Pa"),
    (OGDEN | {"mu": ["1 m"]}, 'bodies.aluminium.mu.0 = "1 m": "m" has the wrong dimension'),
    (METAL, "bodies.aluminium.hardening: missing; yield stress over the plastic strain"),
    (METAL | {"hardening": 3}, "bodies.aluminium.hardening = 3: must be a table"),
    (METAL | {"hardening": {}}, 'bodies.aluminium.hardening.law: missing; one of "linear"'),
    (flows("swft"), 'bodies.aluminium.hardening.law = "swft": must be one of "linear"'),
    (flows("linear"), "hardening.yield_stress: missing; yield stress"),
    (flows("linear", yield_stress=0), "hardening.yield_stress = 0: must be > 0 Pa"),
    (flows("linear", yield_stress="-3 MPa"), 'yield_stress = "-3 MPa": must be > 0 Pa'),
    (flows("linear", yield_stress=3, modulus=-1), "hardening.modulus = -1: must be >= 0 Pa"),
    (flows("linear", yield_stress=3, n=1), '"n" in bodies.aluminium.hardening does not go with'),
    (
        flows("voce", yield_stress=3, saturation_stress=2, exponent=9),
        "hardening.saturation_stress = 2.0: must be >= yield_stress = 3 Pa",
    ),
    (flows("swift", K=3, strain0=0.1, n=1.2), "hardening.n = 1.2: must be >= 0 and <= 1"),
    (flows("swift", K=3, strain0=0, n=0.2), "hardening.strain0 = 0: must be > 0"),
    (flows("table", points=[[0, 3], [0.1, 2]]), "points.1.1 = 2.0: must be >= 3 Pa, that of the"),
    (flows("table", points=[[0, 3], [0, 4]]), "points.1.0 = 0: the plastic strain must increase"),
    (flows("table", points=[[0.1, 3]]), "hardening.points.0.0 = 0.1: must be 0"),
    (flows("table", points=3), "points = 3: must be a table of rows [[plastic strain, yield"),
    (flows("table", points=[[0, 0]]), "hardening.points.0.1 = 0: must be > 0 Pa"),
    (flows("table", points=[]), "hardening.points = []: a table needs at least one row"),
    (rated("perzyna", exponent=0.2), "rate.reference_rate: missing; rate of plastic strain"),
    (rated("perzyna", reference_rate=1, exponent=2), "rate.exponent = 2: must be > 0 and <= 1"),
    (rated("johnson-cook", C=0), "rate.C = 0: must be > 0"),
    (RUBBER | {"prony": [[0.6, 1], [0.5, 2]]}, "prony: the shares sum up to 1.1: must be < 1"),
    (RUBBER | {"prony": [[0, 1]]}, "bodies.aluminium.prony.0.0 = 0: must be > 0 and < 1"),
    (RUBBER | {"prony": [[1.2, 1]]}, "bodies.aluminium.prony.0.0 = 1.2: must be > 0 and < 1"),
    (RUBBER | {"prony": [[0.2, 0]]}, "bodies.aluminium.prony.0.1 = 0: must be > 0 s"),
    (RUBBER | {"prony": [[0.2, "1 Hz"]]}, 'prony.0.1 = "1 Hz": "Hz" has the wrong dimension'),
    (RUBBER | {"prony": [[0.2]]}, "prony.0 = [0.2]: must be a pair [share, relaxation time]"),
    (RUBBER | {"prony": []}, "bodies.aluminium.prony = []: a table needs at least one row"),
    (RUBBER | {"moduli": "instantaneous"}, "moduli: needs prony: there are no branches"),
    (PRONY | {"moduli": "short"}, 'bodies.aluminium.moduli = "short": must be '),
    (RUBBER | {"shift": HOT}, "bodies.aluminium.shift: needs prony"),
    (PRONY | {"shift": HOT | {"energy": 0}}, "shift.energy = 0: must be > 0 J/mol"),
    (PRONY | {"shift": WLF | {"temperature": "-60 degC"}}, "shift.temperature: must be > 241.55 K"),
    (PRONY | {"shift": WLF | {"C2": "51 degC"}}, 'shift.C2 = "51 degC":'),
    (PRONY | {"shift": WLF | {"temperature": "-31 degC"}}, "by 1.48e+03 decades: more than 30"),
    (RUBBER | {"mullins": {"r": 1, "m": 1}}, "bodies.aluminium.mullins.r = 1: must be > 1"),
    (RUBBER | {"mullins": {"r": 2, "m": 0}}, "bodies.aluminium.mullins.m = 0: must be > 0 Pa"),
    (RUBBER | {"mullins": {"r": 2, "m": "1 m"}}, 'mullins.m = "1 m": "m" has the wrong dimension'),
    (RUBBER | {"mullins": {"r": 2}}, "bodies.aluminium.mullins.m: missing; strain energy"),
    (RUBBER | {"mullins": {"r": 2, "m": 1, "beta": -1}}, "mullins.beta = -1: must be >= 0"),
    (RUBBER | {"mullins": 2}, "bodies.aluminium.mullins = 2: must be a table"),
    (METAL | flows("linear", yield_stress=1) | {"mullins": {}}, 'key "mullins" in bodies.al'),
    (PRONY | {"nu": 0.4}, "give E and nu, or G and K; found G and K and nu"),
    (METAL | flows("linear", yield_stress=1) | {"prony": [[0.2, 1]]}, 'key "prony" in bodies.al'),
    (rated("cowper"), 'rate.law = "cowper": must be one of "johnson-cook", "perzyna"'),
    (branched(3), "bodies.aluminium.kinematic.0 = 3: must be an array"),
    (branched(["2 GPa"]), "bodies.aluminium.kinematic.0.1: missing entry"),
    (branched(["2 GPa", 50, 1]), "must have at most 2 entries"),
    (branched(["2 GPa", 50], [0, 1]), "bodies.aluminium.kinematic.1.0 = 0: must be > 0 Pa"),
    (branched(["2 m", 50]), 'kinematic.0.0 = "2 m": "m" has the wrong dimension'),
    (branched(["2 GPa", -1]), "bodies.aluminium.kinematic.0.1 = -1: must be >= 0"),
    (branched(*[["1 GPa", 50]] * 9), "must have at most 8 entries"),
    (branched(["100 GPa", 0]), "kinematic.0: c/max(b, 1) is 1e+11 Pa: must be <= 2.69e+10 Pa"),
    (YEOH | {"kinematic": [["1 GPa", 50]]}, 'key "kinematic" in bodies.aluminium does not go'),
    ({"material": "elastoplastic", "E": 1} | {"hardening": {"law": "linear", "yield_stress": 1}},
     "give E and nu, or G and K; found E"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "expected"), MISTAKES, ids=[m[1][:40] for m in MISTAKES])
def test_a_mistake_gives_one_clear_line(body, expected, case_file):
    data = tomllib.loads(FILM_CASE)
    data["bodies"]["aluminium"] = body
    lines = check_case(case_file(toml_text(data)))
    assert len(lines) == 1, lines
    assert expected in lines[0]
    assert "\n" not in lines[0] and "pydantic" not in lines[0] and len(lines[0]) < 320
