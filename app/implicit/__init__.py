"""Quasi-static implicit steps: predictor, Newton's method, linear solver."""
