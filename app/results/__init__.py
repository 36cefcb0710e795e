"""Results directories: what is in them, and how it gets there without loss."""
