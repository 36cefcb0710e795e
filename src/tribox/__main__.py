"""``python3 -m tribox``, and the command ``tribox`` of an installation."""

from __future__ import annotations

import atexit
import gc


def start() -> None:
    """Run the command line as a process of its own, with little time for the garbage collector."""
    from tribox.app.run.process import leave_at_once, obey_signals

    obey_signals(leave_at_once)
    from tribox.app.run.process import begin_process, collect_the_rest, end_process, lasting_imports

    gc.set_threshold(100_000)
    atexit.register(collect_the_rest)
    begin_process()
    with lasting_imports():
        from tribox.app.cli import main

    try:
        obey_signals()
        main()
    finally:
        end_process()


if __name__ == "__main__":
    start()
