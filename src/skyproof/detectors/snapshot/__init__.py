"""Test if the signals of a snapshot stay constant."""
