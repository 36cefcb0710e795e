"""From a case to what is solved: mesh, bodies, contacts, loads, and notes on them."""
