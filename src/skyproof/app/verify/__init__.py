"""Whether the outputs and inputs of a run are still the bytes that they were."""

from skyproof.app.verify.run import FileState, Verified, verify

__all__ = ["FileState", "Verified", "verify"]
