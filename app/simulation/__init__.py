"""Runs the stages of a case, measures each step and keeps the energy balance."""
