// A round tool above an elastomer pad that lies on a plate. Lengths in metres.
//
//   tribox mesh NAME.geo --force        makes NAME.msh again after a change

radius = 8e-3;        // of the tool's face
wall = 3e-3;          // thickness of the tool
width = 20e-3;        // of the pad
height = 5e-3;        // of the pad
size = 0.5e-3;        // of the elements where bodies touch

// Pad: between y = -height and y = 0.
Point(1) = {-width / 2, -height, 0};
Point(2) = {width / 2, -height, 0};
Point(3) = {width / 2, 0, 0};
Point(4) = {-width / 2, 0, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};

// Tool: a sector of a ring, 45 degrees to both sides, that touches the pad at the origin. Bodies share
// no points: they could not slide on each other.
outer = radius * Sin(Pi / 4);
inner = (radius - wall) * Sin(Pi / 4);
Point(10) = {0, radius, 0};
Point(11) = {-outer, radius - outer, 0};
Point(12) = {0, 0, 0};
Point(13) = {outer, radius - outer, 0};
Point(14) = {inner, radius - inner, 0};
Point(15) = {0, wall, 0};
Point(16) = {-inner, radius - inner, 0};
Circle(11) = {11, 10, 12};
Circle(12) = {12, 10, 13};
Line(13) = {13, 14};
Circle(14) = {14, 10, 15};
Circle(15) = {15, 10, 16};
Line(16) = {16, 11};
Line(17) = {12, 15};
Curve Loop(2) = {11, 17, 15, 16};
Plane Surface(2) = {2};
Curve Loop(3) = {12, 13, 14, -17};
Plane Surface(3) = {3};

// Plate under the pad.
Point(21) = {-0.75 * width, -height - 2e-3, 0};
Point(22) = {0.75 * width, -height - 2e-3, 0};
Point(23) = {0.75 * width, -height, 0};
Point(24) = {-0.75 * width, -height, 0};
Line(21) = {21, 22};
Line(22) = {22, 23};
Line(23) = {23, 24};
Line(24) = {24, 21};
Curve Loop(4) = {21, 22, 23, 24};
Plane Surface(4) = {4};

// Quadrilaterals in rows; the masters (tool and plate) are no finer than the pad, their slave.
Transfinite Curve {1, 3} = Round(width / size) + 1;
Transfinite Curve {2, 4} = Round(height / size / 1.25) + 1;
Transfinite Curve {11, 12, 14, 15} = Round(Pi / 4 * radius / size) + 1;
Transfinite Curve {13, 16, 17} = 4;
Transfinite Curve {21, 23} = Round(1.5 * width / size / 1.5) + 1;
Transfinite Curve {22, 24} = 3;
Transfinite Surface {1, 2, 3, 4};
Recombine Surface {1, 2, 3, 4};

// These names are what the case file calls bodies and surfaces.
Physical Surface("pad") = {1};
Physical Surface("tool") = {2, 3};
Physical Surface("plate") = {4};
Physical Curve("pad_top") = {3};
Physical Curve("pad_bottom") = {1};
Physical Curve("tool_face") = {11, 12};
Physical Curve("tool_back") = {14, 15};
Physical Curve("plate_top") = {23};
Physical Curve("plate_bottom") = {21};
