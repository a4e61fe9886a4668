"""Test the receiver's own fixes: they must move as a platform can."""
