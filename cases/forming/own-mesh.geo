// A sheet under a punch: a steel tube with a rubber sleeve. The right half; x = 0 is the middle.
// Lengths in mm, which the case says with scale = "mm". Sizes of the elements are in the case too.

half = 28;            // half the length of the sheet
sheet = 1.5;          // its thickness
bore = 5;             // radii of the punch: inside of the tube ...
bond = 7;             // ... where steel and rubber are bonded ...
face = 10;            // ... and outside of the sleeve

// Sheet: its lower side is on y = 0.
Point(1) = {0, 0, 0};
Point(2) = {half, 0, 0};
Point(3) = {half, sheet, 0};
Point(4) = {0, sheet, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};

// Punch: two quarters of rings, one in the other. They have the arc 12 in common, and so the nodes on
// it: they are bonded. Sheet and sleeve touch in a point, but each has its own: they slide.
Point(10) = {0, sheet + face, 0};
Point(11) = {0, sheet + face - bore, 0};
Point(12) = {bore, sheet + face, 0};
Point(13) = {0, sheet + face - bond, 0};
Point(14) = {bond, sheet + face, 0};
Point(15) = {0, sheet, 0};
Point(16) = {face, sheet + face, 0};
Circle(11) = {11, 10, 12};
Circle(12) = {13, 10, 14};
Circle(13) = {15, 10, 16};
Line(14) = {11, 13};
Line(15) = {13, 15};
Line(16) = {12, 14};
Line(17) = {14, 16};
Curve Loop(2) = {14, 12, -16, -11};
Plane Surface(2) = {2};
Curve Loop(3) = {15, 13, -17, -12};
Plane Surface(3) = {3};

// These names are what the case calls bodies and surfaces; they may have spaces.
Physical Surface("aluminium sheet") = {1};
Physical Surface("steel tube") = {2};
Physical Surface("rubber sleeve") = {3};
Physical Curve("sheet bottom") = {1};
Physical Curve("sheet top") = {3};
Physical Curve("sheet middle") = {4};
Physical Curve("sleeve face") = {13};
Physical Curve("punch middle") = {14, 15};   // of tube and sleeve together
Physical Curve("tube bore") = {11};
