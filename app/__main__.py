"""``python3 -m app``."""

import gc

# Imports make a million objects that stay; looking through them again and again costs a tenth of a
# second, and the program itself leaves few cycles.
gc.set_threshold(100_000)

from app.cli import main  # noqa: E402

main()
