"""Checkpoints: all that a run needs to go on, written while it goes and read by ``--resume``."""
