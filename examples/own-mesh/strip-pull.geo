// An aluminium strip on a rubber pad, which is bonded to an aluminium base. Lengths in mm.

width = 16;           // of the pad
height = 5;           // of the pad
corner = 1;           // radius of its upper corners
length = 36;          // of the strip
thick = 1;            // of the strip

// Base: a block 24 mm wide and 4 mm high. The points 4 and 5 are the feet of the pad.
Point(1) = {-12, -height - 4, 0};
Point(2) = {12, -height - 4, 0};
Point(3) = {12, -height, 0};
Point(4) = {width / 2, -height, 0};
Point(5) = {-width / 2, -height, 0};
Point(6) = {-12, -height, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 5};
Line(5) = {5, 6};
Line(6) = {6, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6};
Plane Surface(1) = {1};

// Pad: its face lies on y = 0. It has line 4 in common with the base, so it is bonded there.
Point(11) = {width / 2, -corner, 0};
Point(12) = {width / 2 - corner, -corner, 0};      // centre of the right corner
Point(13) = {width / 2 - corner, 0, 0};
Point(14) = {-width / 2 + corner, 0, 0};
Point(15) = {-width / 2 + corner, -corner, 0};     // centre of the left corner
Point(16) = {-width / 2, -corner, 0};
Line(11) = {4, 11};
Circle(12) = {11, 12, 13};                         // start, centre, end
Line(13) = {13, 14};
Circle(14) = {14, 15, 16};
Line(15) = {16, 5};
Curve Loop(2) = {11, 12, 13, 14, 15, -4};          // -4: line 4 the other way round
Plane Surface(2) = {2};

// Strip: it lies on the pad but has points of its own, so it can slide.
Point(21) = {-length / 2, 0, 0};
Point(22) = {length / 2, 0, 0};
Point(23) = {length / 2, thick, 0};
Point(24) = {-length / 2, thick, 0};
Line(21) = {21, 22};
Line(22) = {22, 23};
Line(23) = {23, 24};
Line(24) = {24, 21};
Curve Loop(3) = {21, 22, 23, 24};
Plane Surface(3) = {3};

// Names of bodies, then of surfaces. The case file calls them by these names.
Physical Surface("base") = {1};
Physical Surface("pad") = {2};
Physical Surface("strip") = {3};
Physical Curve("base bottom") = {1};
Physical Curve("pad face") = {12, 13, 14};
Physical Curve("strip bottom") = {21};
Physical Curve("strip top") = {23};
Physical Curve("strip end") = {22};
