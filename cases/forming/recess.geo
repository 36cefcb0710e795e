// A sheet and the rubber pad above it, which is wider. The right half; x = 0 is the middle. In mm;
// the case says so, and gives the sizes of the elements.

half = 16;            // half the length of the sheet, or the radius of a disk
sheet = 1;            // its thickness
round = 0.4;          // radius of its upper edge: a file or a wheel takes the burr off
pad = 24;             // half the width of the pad, up to the container
high = 16;            // its height
gap = 0.01;           // above the sheet: smoothed, its edge bulges a little beyond the facets

// Sheet: its lower side is on y = 0.
Point(1) = {0, 0, 0};
Point(2) = {half, 0, 0};
Point(3) = {half, sheet - round, 0};
Point(4) = {half - round, sheet - round, 0};
Point(5) = {half - round, sheet, 0};
Point(6) = {0, sheet, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Circle(3) = {3, 4, 5};
Line(4) = {5, 6};
Line(5) = {6, 1};
Curve Loop(1) = {1, 2, 3, 4, 5};
Plane Surface(1) = {1};

// Pad: it lies on the sheet.
Point(10) = {0, sheet + gap, 0};

Point(12) = {pad, sheet + gap, 0};
Point(13) = {pad, sheet + high, 0};
Point(14) = {0, sheet + high, 0};
Line(11) = {10, 12};
Line(12) = {12, 13};
Line(13) = {13, 14};
Line(14) = {14, 10};
Curve Loop(2) = {11, 12, 13, 14};
Plane Surface(2) = {2};

Physical Surface("sheet") = {1};
Physical Surface("pad") = {2};
Physical Curve("sheet bottom") = {1};
Physical Curve("sheet top") = {2, 3, 4};       // with its end: the pad bulges over it
Physical Curve("sheet middle") = {5};
Physical Curve("pad face") = {11};
Physical Curve("pad side") = {12};
Physical Curve("pad top") = {13};
Physical Curve("pad middle") = {14};
