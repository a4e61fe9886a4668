"""Detect a receiver torn between signals: single codes that no orbit explains, of more satellites than can fail."""
