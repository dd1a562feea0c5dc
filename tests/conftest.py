"""Fixtures and settings shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Compilation makes the first example slow, so no deadline; CI draws the same examples every time.
settings.register_profile("barchan", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "barchan")

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of reference data next to the repository; tests that need it skip when it is absent."""
    if not (SHARED / "data").is_dir():
        pytest.skip(f"reference data not found: {SHARED} is kept beside the repository, not in it")
    return SHARED
