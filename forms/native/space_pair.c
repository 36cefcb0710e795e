/* A contact pair in space: see pair_tangent.h. */

#define DIM 3
#define CORNERS 9 /* nodes of a slave facet, at most */
#define MOVERS 64 /* nodes that move a master facet, at most */
#define SHAPES 16 /* shape functions of a master facet, at most */

#include "pair_tangent.h"
