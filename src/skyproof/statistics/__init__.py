"""Distributions, tests and estimates with free leading axes. Knows nothing of satellites."""
