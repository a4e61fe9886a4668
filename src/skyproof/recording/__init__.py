"""Measure a recording before anything is tracked: spectrum, front end, sampling clock, gaps, repetition."""
