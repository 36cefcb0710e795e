"""``tribox report``: a results directory as one HTML page, drawn from its files alone."""
