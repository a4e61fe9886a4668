"""What holds in all tests of detectors: each finding can be put in words."""

from typing import Any

import pytest

from skyproof.detectors.base import Reporter
from skyproof.explain import explain
from skyproof.records import Finding


@pytest.fixture(autouse=True)
def _explain_each_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Explain each finding once it is made, so that a code without a sentence or a field without data fails."""
    make = Reporter.find

    def find(self: Reporter, *args: Any, **more: Any) -> Finding:
        finding = make(self, *args, **more)
        assert explain(finding, strict=True).sentence
        return finding

    monkeypatch.setattr(Reporter, "find", find)
