"""Scenes made on demand: their data, their pages, and the demonstration."""
