"""``python3 -m app``."""

from app.cli import main

main()
