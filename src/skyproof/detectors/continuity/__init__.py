"""One sky that goes on: steps of range, clock and place that no receiver makes."""
