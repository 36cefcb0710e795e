"""``tribox map``: the friction law at material points, without bodies."""
