"""The deterministic double of a flow, for tests of storing and resuming."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def fake_flow(load_script: Callable[[Path], ModuleType]) -> ModuleType:
    """The module fake_flow.py beside this file."""
    return load_script(Path(__file__).with_name("fake_flow.py"))
