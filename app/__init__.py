"""What a person runs: command line, case files, simulations, results and figures."""

if __name__ == "app":  # beside tribox.app it would hold everything a second time
    raise ImportError("app is imported as tribox.app: put src on the path")
