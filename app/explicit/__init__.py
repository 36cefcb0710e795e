"""Explicit dynamics: central differences with lumped masses."""
