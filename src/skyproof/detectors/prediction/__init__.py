"""Hold what a receiver shows against what was to be expected of it."""
