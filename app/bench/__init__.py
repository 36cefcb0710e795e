"""``tribox bench``: where the time goes."""
