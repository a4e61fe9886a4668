"""Directions of arrival: several antennas, with and without attitude, and one that turns."""
