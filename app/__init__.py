"""What a person runs: command line, case files, simulations, results and figures."""
