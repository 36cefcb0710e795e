"""Measures contact over curved tools: film, pressure, ploughing, ridges.

See ``python3 -m benchmarks.curved_contact --help``.
"""
