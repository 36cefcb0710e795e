"""The discrete equilibrium of all bodies, contacts and loads, without a solver."""
