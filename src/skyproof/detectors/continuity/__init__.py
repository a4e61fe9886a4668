"""Follow one sky from epoch to epoch: find steps of range, clock and position that no receiver makes."""
