"""From a case to the objects that are solved: mesh, bodies, contacts, loads; notes on them."""
