"""Position fix, residual tests, consistent sets of signals, smoothing, the clock's label."""
