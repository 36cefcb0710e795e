"""What a drawing for gmsh does beside drawing: its scripts can start programs and write files.

gmsh has no option that forbids it. So a drawing is read word by word first, by the rules of gmsh's
own scanner, and what is not known to draw only is named: commands with a text behind them
(``SystemCall "..."``, ``Merge``, ``Save``), output to files (``Printf(...) > "..."``), fields that
start a process, options that name files, formats that gmsh would overrun its memory with
(``Printf("%n")``), and whatever is not known. A drawing in which nothing is found can be meshed
safely whoever made it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

LONGEST = 1000  # characters of a text; gmsh reads a longer one as a text and then as commands

# Words that may stand before another word or a text, or after which a bracket is no array's.
DRAWING = frozenset(
    """
    Abs Affine BSpline Background Ball Bezier BooleanDifference BooleanFragments
    BooleanIntersection BooleanUnion Bounding BoundingBox Boundary Box Call Catenary CatmullRom
    CenterOfMass Chamfer Characteristic Circle Closed CombinedBoundary Compound Cone Curve Cylinder
    Delete Dilate Disk Ellipse Ellipsoid Else ElseIf EndFor EndIf Extrude Field Fillet For Function
    Geometry Hide Hole If In Layers Length Line List Loop Macro MeshAlgorithm MeshSize
    MeshSizeFromBoundary Nurbs Parametric Periodic Physical Plane Point PointsOf Quadrangles
    QuadTriAddVerts QuadTriNoNewVerts RecombLaterals Recombine Rectangle Recursive Return Reverse
    ReverseMesh Rotate Ruled Show Sin Smoother Sphere Spline Split Surface Symmetry ThickSolid
    ThruSections Torus Transfinite Translate Using Volume Wedge Wire Alternate AlternateLeft
    AlternateRight Left Right Progression Bump Beta Unique Coherence
    """.split()
)
# Words of gmsh's own that may stand behind any name: For i In, = n Using Progression.
RESERVED = frozenset(("In", "Using"))
# Words with a bracket and a text in it.
WITH_TEXT = frozenset(
    """
    Physical Curve Surface Volume Point Line SetFactory Printf Sprintf Str StrCat StrChoice StrCmp
    StrFind StrLen StrReplace StrSub Error Warning Macro Call
    """.split()
)
# Statements that are a word with a bracket.
CALLS = frozenset("Printf SetFactory Error Warning If ElseIf For Macro Call".split())
TELLS = frozenset("Printf Error Warning Print".split())
FORMATS = frozenset("Printf Sprintf Error Warning".split())
# A format that gmsh hands to C's printf, with rooms of 256 and 5000 characters for the outcome.
PLAIN_FORMAT = re.compile(r"""["'](?:[^%]|%[-+]?[0-9]{0,2}(?:\.[0-9]{1,2})?[gGeE]){0,200}["']""")
FIELDS = frozenset(
    """
    Attractor AttractorAnisoCurve AutomaticMeshSizeField Ball BoundaryLayer Box Constant Curvature
    Cylinder Distance Extend Frustum Gradient IntersectAniso Laplacian LonLat MathEval
    MathEvalAniso Max MaxEigenHessian Mean Min MinAniso Octree Param Restrict Sphere Threshold
    """.split()
)
FORBIDDEN = frozenset(
    """
    Abort Exit Plugin OnelabRun OnelabAction ListFromFile ShapeFromFile GetEnv SetString SetNumber
    System SystemCall NonBlockingSystemCall Include Merge MergeWithBoundingBox Save Print Parse
    ParseString Open OpenProject ExternalProcess FileExists AdaptMesh Solver View
    """.split()
)
OPTIONS = frozenset(("Mesh", "Geometry", "General"))
# Names of options that are, or lead to, files and commands.
LEADS_OUT = re.compile(r"file|command|exec|path|dir|script|macro|server", re.IGNORECASE)
TOKEN = re.compile(
    r"""(?P<space>[ \t\n\r\f]+|//[^\n]*|/\*.*?\*/)
    |(?P<text>"[^"]*"|'[^']*')
    |(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[Ee][-+]?[0-9]+)?)
    |(?P<word>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<sign>.)""",
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class Token:
    """A word of a drawing: what kind it is, the word, and its line, from 1."""

    kind: str
    text: str
    line: int


@dataclass(frozen=True, slots=True)
class Beyond:
    """What reaches beyond a drawing, and the line it is in, from 1."""

    what: str
    line: int


def companion(path: Path) -> Path:
    """The file that gmsh reads, and runs, together with another one, whatever that is."""
    return path.with_name(path.name + ".opt")


def beyond_drawing(script: str) -> Beyond | None:
    """The first thing in a drawing that is not known to draw only; None if there is none."""
    odd = re.search(r"\x00|\r(?!\n)", script)
    if odd:  # where gmsh ends lines and comments differently
        return Beyond("a character that is no text", script.count("\n", 0, odd.start()) + 1)
    tokens = list(_tokens(script))
    for at, token in enumerate(tokens):
        if token.kind == "text" and len(token.text) > LONGEST:
            return Beyond("a very long text", token.line)
        if token.text in ('"', "'") or (token.text == "/" and _text(tokens, at + 1) == "*"):
            return Beyond("a text or comment without end", token.line)
        if token.kind == "word" and _reaches_out(tokens, at):
            return Beyond(token.text, token.line)
        if token.text in FORMATS and _text(tokens, at + 1) in "([" and _overruns(tokens, at + 1):
            return Beyond(f"{token.text} with another format than %g", token.line)
    return None


def _tokens(script: str) -> Iterator[Token]:
    line = 1
    for match in TOKEN.finditer(script):
        kind, text = str(match.lastgroup), match.group()
        if kind != "space":
            yield Token(kind, text, line)
        line += text.count("\n")


def _text(tokens: Sequence[Token], at: int) -> str:
    return tokens[at].text if 0 <= at < len(tokens) else ""


def _kind(tokens: Sequence[Token], at: int) -> str:
    return tokens[at].kind if 0 <= at < len(tokens) else ""


def _reaches_out(tokens: Sequence[Token], at: int) -> bool:
    """Whether the word at a place is, or begins, what is not known to draw only."""
    word, after = tokens[at].text, _text(tokens, at + 1)
    if word in FORBIDDEN:
        return True
    if _text(tokens, at - 1) == ".":
        return bool(LEADS_OUT.search(word))
    if after == "." and _kind(tokens, at + 2) == "word":
        return word not in OPTIONS or _kind(tokens, at + 4) == "text"
    if _kind(tokens, at + 1) in ("word", "text"):
        named = _text(tokens, at - 1) in ("Macro", "Function")
        return not (named or word in DRAWING or after in RESERVED)
    if after == "(":
        return _call_reaches_out(tokens, at)
    if word == "Field" and after == "[":
        end = _closing(tokens, at + 1)
        kind = _text(tokens, end + 2)
        return _text(tokens, end + 1) == "=" and kind not in FIELDS
    return False


def _call_reaches_out(tokens: Sequence[Token], at: int) -> bool:
    """The same of a word with a bracket behind it."""
    word, end = tokens[at].text, _closing(tokens, at + 1)
    if _kind(tokens, at + 2) == "text" and word not in WITH_TEXT:
        return True
    if word in TELLS and _text(tokens, end + 1) != ";":  # > "file"
        return True
    begins = _text(tokens, at - 1) in ("", ";", "{", "}", ")")
    return begins and _text(tokens, end + 1) == ";" and word not in CALLS


def _overruns(tokens: Sequence[Token], bracket: int) -> bool:
    """Whether a format, the first in a bracket, is not a short text with one %g for each value."""
    text, after = _text(tokens, bracket + 1), _text(tokens, bracket + 2)
    if _kind(tokens, bracket + 1) != "text" or after not in (",", ")", "]"):
        return True
    values = after == ","
    return not PLAIN_FORMAT.fullmatch(text) or ("%" in text) != values


def _closing(tokens: Sequence[Token], at: int) -> int:
    """Where the bracket that opens at a place is closed; behind all where it is not."""
    depth = 0
    for place in range(at, len(tokens)):
        if tokens[place].kind == "sign":
            depth += (tokens[place].text in "([{") - (tokens[place].text in ")]}")
        if depth == 0:
            return place
    return len(tokens)
