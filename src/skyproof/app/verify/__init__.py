"""Check that the outputs and inputs of a run are unchanged."""

from skyproof.app.verify.run import FileState, Verified, verify

__all__ = ["FileState", "Verified", "verify"]
