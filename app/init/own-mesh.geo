// A pad with rounded corners on a plate. Lengths in metres.
//
//   tribox mesh NAME.geo --force        makes NAME.msh again after a change

width = 10e-3;        // of the pad
height = 4e-3;        // of the pad
corner = 1e-3;        // radius of its lower corners
size = 0.5e-3;        // of the elements

// Pad: its face lies in y = 0.
Point(1) = {-width / 2 + corner, 0, 0, size};
Point(2) = {width / 2 - corner, 0, 0, size};
Point(3) = {width / 2 - corner, corner, 0};
Point(4) = {width / 2, corner, 0, size / 2};
Point(5) = {width / 2, height, 0, size};
Point(6) = {-width / 2, height, 0, size};
Point(7) = {-width / 2, corner, 0, size / 2};
Point(8) = {-width / 2 + corner, corner, 0};
Line(1) = {1, 2};
Circle(2) = {2, 3, 4};
Line(3) = {4, 5};
Line(4) = {5, 6};
Line(5) = {6, 7};
Circle(6) = {7, 8, 1};
Curve Loop(1) = {1, 2, 3, 4, 5, 6};
Plane Surface(1) = {1};

// Plate below. Bodies share no points: they could not slide on each other.
Point(11) = {-width, -3e-3, 0, 2 * size};
Point(12) = {width, -3e-3, 0, 2 * size};
Point(13) = {width, 0, 0, 1.3 * size};
Point(14) = {-width, 0, 0, 1.3 * size};
Line(11) = {11, 12};
Line(12) = {12, 13};
Line(13) = {13, 14};
Line(14) = {14, 11};
Curve Loop(2) = {11, 12, 13, 14};
Plane Surface(2) = {2};

// Quadrilaterals; all cells of a mesh have the same shape.
Mesh.Algorithm = 8;
Recombine Surface {1, 2};
Mesh.RecombinationAlgorithm = 3;

// These names are what the case file calls bodies and surfaces.
Physical Surface("pad") = {1};
Physical Surface("plate") = {2};
Physical Curve("pad_face") = {6, 1, 2};
Physical Curve("pad_top") = {4};
Physical Curve("plate_top") = {13};
Physical Curve("plate_bottom") = {11};
