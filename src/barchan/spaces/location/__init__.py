"""In which cell of a mesh a point lies, where its path leaves the domain, and what a field is there.

Used by the first-order characteristics (seed A, 5.2) and by profiles along any line.
"""

from __future__ import annotations

from barchan.spaces.location.evaluation import evaluate
from barchan.spaces.location.locator import Locator

__all__ = ["Locator", "evaluate"]
