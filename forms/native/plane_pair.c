/* A contact pair in the plane: see pair_tangent.h. */

#define DIM 2
#define CORNERS 4 /* nodes of a slave facet, at most */
#define MOVERS 4  /* nodes that move a master facet, at most */

#include "pair_tangent.h"
