"""Cost of the friction-map law: ``tribox bench law`` with other numbers of points or dimensions.

From the repository: ``python3 -m benchmarks.law --points 1000000 --dim 2 --repeat 5``.
"""

from __future__ import annotations

import argparse

from tribox.app.bench.law import lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--dim", type=int, choices=(2, 3), default=2)
    parser.add_argument("--repeat", type=int, default=5)
    chosen = parser.parse_args()
    print("\n".join(lines(chosen.points, chosen.dim, chosen.repeat)))


if __name__ == "__main__":
    main()
