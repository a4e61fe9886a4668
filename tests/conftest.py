"""Shared by all tests: where the recordings are, if they are."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real and rendered recordings: $SKYPROOF_DATA, or the one beside the checkout. Skips without it."""
    folder = Path(os.environ.get("SKYPROOF_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set SKYPROOF_DATA to the folder that holds them")
    return folder
