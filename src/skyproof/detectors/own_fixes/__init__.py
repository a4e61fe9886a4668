"""The receiver's own fixes: whether they go on as a platform can."""
