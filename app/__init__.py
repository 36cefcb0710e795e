"""What a person runs: command line, case files, simulations, results and figures."""

__version__ = "0.1.0"
