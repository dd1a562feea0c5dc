"""The stored contact problems of `../shared/data/fc`, by `barchan bench solvers`: its options may follow (see docs/cli.md)."""

from __future__ import annotations

import sys
from pathlib import Path

import _table  # noqa: F401  (finds barchan where it is not installed)
from barchan import cli

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "fc"


def main() -> None:
    """Run the comparison; the results stand in a new runs/bench-solvers-<n> unless --out says otherwise."""
    sys.exit(cli.main(["bench", "solvers", str(DATA), *sys.argv[1:]]))


if __name__ == "__main__":
    main()
