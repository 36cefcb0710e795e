"""``tribox init``: starter cases with comments, and what goes with them."""
