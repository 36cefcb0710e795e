"""``tribox verify``: computed cases beside closed forms."""
