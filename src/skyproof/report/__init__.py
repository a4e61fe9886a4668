"""Verdict and series to pictures and one page; computes no results."""
