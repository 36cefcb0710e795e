"""What a drawing does beside drawing: found in every way there is to say it, and only there."""

from pathlib import Path

import pytest

from tribox.geometry.meshes.drawing_words import beyond_drawing

INIT = Path(__file__).parents[3] / "app" / "init"

# What people draw with; the last ones are of gmsh's own tutorials in kind.
DRAWS = """
// SystemCall "in a comment"; /* and a " here */
/* Merge "x.geo"; */
SetFactory("OpenCASCADE");
lc = DefineNumber[0.1]; name = "SystemCall 'touch x'";
If (lc > 0.05 && lc < 1) n = 4; ElseIf (lc == 2) n = 5; Else n = 6; EndIf
Point(1) = {0, 0, 0, lc}; Point(2) = {1, .5e-1, 0.};
Line(1) = {1, 2}; Curve Loop(1) = {1}; Plane Surface(1) = {1};
For i In {0:3} Point(newp) = {i, Sqrt(i), 0}; EndFor
pts[] = {}; pts[] += newp; pts(0) = 3; a() = Point{1};
Rectangle(7) = {0, 0, 0, 1, 1}; Disk(8) = {0, 0, 0, .5};
out[] = Extrude {0, 0, 1} { Surface{1}; Layers{3}; Recombine; };
BooleanDifference(9) = { Surface{7}; Delete; }{ Surface{8}; Delete; };
Physical Surface("pad", 3) = {1}; Physical Curve("top") = {1, 2};
Physical Curve(StrCat("side", Sprintf("%g", n))) = {3};
Transfinite Curve {1, 3} = Round(n / 2) + 1 Using Progression 1.1;
Transfinite Surface {1} Left; Recombine Surface {1, 2};
Field[1] = Distance; Field[1].CurvesList = {1}; Field[2] = MathEval; Field[2].F = "0.1 + x";
Background Field = 2;
Mesh.CharacteristicLengthMax = 0.2; Mesh.Algorithm = 6; Geometry.Tolerance = 1e-9;
General.Terminal = 0; Characteristic Length {1, 2} = 0.1;
Macro Corner Point(newp) = {1, 2, 3}; Return
Call Corner;
Printf("%g nodes, %-6.3g and %E", n, 2, 3); Printf("done, 'as said'"); Coherence;
Rotate {{0, 0, 1}, {0, 0, 0}, Pi/4} { Duplicata { Point{1}; } }
"""


def test_what_draws_only_is_left_alone():
    assert beyond_drawing(DRAWS) is None
    for drawing in INIT.glob("*.geo"):
        assert beyond_drawing(drawing.read_text(encoding="utf-8")) is None


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ('SystemCall "touch x";', "SystemCall"),
        ("SystemCall\n/* */ name;", "SystemCall"),
        ('System "touch x";', "System"),
        ('NonBlockingSystemCall "touch x";', "NonBlockingSystemCall"),
        ('Include "x.geo";', "Include"),
        ('Merge StrCat("x", ".geo");', "Merge"),
        ('Save "x.msh";', "Save"),
        ("Print name;", "Print"),
        ('NewCommand "x";', "NewCommand"),
        ("NewCommand name;", "NewCommand"),
        ('NewCommand("x");', "NewCommand"),
        ("NewCommand(name);", "NewCommand"),
        ('Printf("a") > "x";', "Printf"),
        ("Printf(Sprintf(name)) >> name;", "Printf"),
        ('Error("a") > "x";', "Error"),
        *(
            (words, f"{words.split('(')[0].split('[')[0]} with another format than %g")
            for words in (
                *('Printf("%n");', 'Printf("%s%s", n);', 'Error("%n", n);', 'Warning("%d");'),
                *(
                    "Printf(name);",
                    'Printf("%99999g", n);',
                    'Printf("%f", 1e300);',
                    'Printf("", l());',
                ),
                *('Sprintf["%n", n];', 'Printf("%*g", n);'),
                f'Printf("{"a" * 300} %g", n);',
            )
        ),
        ('OnelabRun("name", "touch x");', "OnelabRun"),
        ("Plugin(NewView).Run;", "Plugin"),
        ("Field[1] = ExternalProcess;", "Field"),
        ("Field[ 1 ]\n= Structured;", "Field"),
        ('Field[1].CommandLine = "touch x";', "CommandLine"),
        ("Field[1].FileName = name;", "FileName"),
        ('General.ErrorFileName = "x";', "General"),
        ("General.ErrorFileName = name;", "ErrorFileName"),
        ('Solver.Executable0 = "x";', "Solver"),
        ("PostProcessing.Smoothing = 1;", "PostProcessing"),
        ('SetString("General.ErrorFileName", "x");', "SetString"),
        ('a[] = ListFromFile("x");', "ListFromFile"),
        ('a = GetEnv("HOME");', "GetEnv"),
        ("Exit;", "Exit"),
        (f'a = "{"A" * 1023}";', "a very long text"),
        ('a = "no end;', "a text or comment without end"),
        ("/* no end", "a text or comment without end"),
        ('// a comment\rSystemCall "touch x";', "a character that is no text"),
        ('a = 1;\0 SystemCall "touch x";', "a character that is no text"),
    ],
    ids=lambda words: words[:30],
)
def test_what_does_more_is_named_with_its_line(words, named):
    found = beyond_drawing(DRAWS + words)
    assert found is not None
    assert (found.what, found.line) == (named, DRAWS.count("\n") + 1)
