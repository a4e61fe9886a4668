"""Correlators of scalar and of vector tracking: distorted or displaced peaks, and whose."""
