"""Invented records, as for the decision."""

from tests.fusion.conftest import invented

__all__ = ["invented"]
