"""A platform file from what the inputs themselves say, with everything else as lines to fill in."""

from skyproof.app.init.run import InitResult, init

__all__ = ["InitResult", "init"]
