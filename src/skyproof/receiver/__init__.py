"""Samples to signals: acquisition, tracking, telemetry, observables. Never decides who is authentic."""
