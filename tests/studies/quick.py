"""Rows of quick runs, each made once for all tests of a file, and what every study that is quick must hold."""

import time
from functools import cache

from skyproof.studies import studies
from skyproof.studies.base import Row, StudySettings
from skyproof.studies.validation import check

FOUND = studies()


@cache
def run_study(name: str, **settings: object) -> list[Row]:
    return list(FOUND[name].run(StudySettings(**({"quick": True} | settings))))


def assert_holds(name: str) -> None:
    """Check that a study takes no more than 20 s, and that no claim lacks its figure or is contradicted."""
    start = time.process_time()
    rows = run_study(name)
    assert time.process_time() - start < 20.0
    for item in check(FOUND[name], rows):
        assert item.agrees is not False, item.cells()
        assert "not found" not in item.cells(), item.cells()
